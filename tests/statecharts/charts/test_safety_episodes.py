"""Chart `safety` by chance: when exactly it commands, held against a model of episodes that shares nothing with it.

The model knows what was reported and when; it has neither states nor deadlines.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st

from events import Record
from events.schema.common_pb2 import Moved
from statecharts import steps_of
from tests.checks import check_equal
from tests.monitors import complaints
from tests.stories import Story
from tests.stories_of_safety import SAFE_LIMITS

AGAIN_MS, CALM_MS = 5_000, 1_000
PAUSES_MS = st.sampled_from([0, 100, 250, 500, 999, 1_000, 2_500, 6_000])
WORDS = st.sampled_from(
    [
        *("spot 0,0", "spot 0,0", "spot 0,0", "spot 200,0", "spot 200,0", "battery 90", "battery 20"),
        *("flies return", "flies return", "flies mission", "flies mission", "grounded"),
        *("vehicle down", "vehicle up", "start"),
    ]
)
FLIGHTS = st.lists(st.tuples(PAUSES_MS, WORDS), min_size=4, max_size=40)


@dataclass
class Episode:
    """One failsafe: its last command, as long as that counts, and since when nothing is demanded."""

    commanded_ms: int | None = None
    calm_since_ms: int | None = None


@dataclass
class Model:
    """What was reported of the vehicle."""

    heard: bool = True
    armed: bool = True
    returns: bool = False
    outside: bool | None = False  # None: not known
    low: bool = False
    episodes: dict[str, Episode] = field(default_factory=lambda: {"fence": Episode(), "battery": Episode()})

    def hear(self, words: str) -> None:
        """Take in a report."""
        match words.split():
            case ["spot", where]:
                self.outside = where == "200,0"
            case ["battery", charge]:
                self.low = charge == "20"
            case ["flies", mode]:
                self.armed, self.returns = True, mode == "return"
            case ["grounded"]:
                self.armed, self.returns = False, False
            case ["vehicle", "up"]:
                self.heard = True
            case ["vehicle", "down"] | ["start"]:
                self.heard, self.outside = False, None

    def commands(self, now_ms: int) -> list[str]:
        """Return which failsafes command now."""
        demands = {"battery": self.low, "fence": self.outside}
        said = [name for name, demand in demands.items() if self._commands(name, self.armed and demand, now_ms)]
        return sorted(said)

    def _commands(self, name: str, demand: bool | None, now_ms: int) -> bool:
        episode = self.episodes[name]
        calm_ms = -1 if episode.calm_since_ms is None else now_ms - episode.calm_since_ms
        if calm_ms >= CALM_MS and demand is not None:
            episode.commanded_ms = None
        if demand is False:
            episode.calm_since_ms = now_ms if episode.calm_since_ms is None else episode.calm_since_ms
            if self.returns or not self.armed:
                episode.commanded_ms = None
            return False
        episode.calm_since_ms = None
        waits = episode.commanded_ms is not None and now_ms - episode.commanded_ms < AGAIN_MS
        if not demand or not self.heard or self.returns or waits:
            return False
        episode.commanded_ms = now_ms
        return True


def commanded(step: tuple[Record, ...]) -> list[str]:
    """Return which failsafes command in a step; each move that does has its command behind it."""
    moves = [record.message for record in step if isinstance(record.message, Moved)]
    said = [one.instance.partition("/")[2] for one in moves if (one.chart, one.to_state) == ("safety", "returning")]
    check_equal(sum(record.kind.name == "set_vehicle_mode" for record in step), len(said))
    return sorted(said)


@settings(max_examples=200, deadline=None)
@given(FLIGHTS, st.booleans())
def test_it_commands_when_an_episode_begins_and_at_its_rate_within_one(
    words: list[tuple[int, str]], prompt: bool
) -> None:
    """At once and no more often, on a shell that is prompt and on one that is late; and no monitor minds."""
    story, model, at_ms = Story(**SAFE_LIMITS | {"operator_lost_ms": 0}), Model(), 0
    story.tell("fence in=-100,-100,100,100")
    story.tell("spot 0,0")
    for pause_ms, one in words:
        at_ms += pause_ms
        while prompt and (due := story.flight.due) is not None and due <= at_ms * 1_000_000:
            story.flight.now_ns = max(due, story.flight.now_ns)
            check_equal(commanded(story.tell("time")), model.commands(story.flight.now_ns // 1_000_000))
        story.at(at_ms)
        model.hear(one)
        check_equal((at_ms, one, commanded(story.tell(one))), (at_ms, one, model.commands(at_ms)))
    check_equal(complaints(list(steps_of(story.flight.records))), [])


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(st.integers(50, 999), st.sampled_from(["spot 0,0", "spot 200,0"])), max_size=60))
def test_a_place_that_flickers_is_bounded(words: list[tuple[int, str]]) -> None:
    """A vehicle that never obeys is not told twice within a second, however its places come and go."""
    story, at_ms = Story(**SAFE_LIMITS | {"operator_lost_ms": 0}), 0
    story.tell("fence in=-100,-100,100,100")
    for pause_ms, one in words:
        at_ms += pause_ms
        story.flight.wait(pause_ms)
        story.tell(one)
    said = [record.at.flight_ns for record in story.flight.records if record.kind.name == "set_vehicle_mode"]
    check_equal([later - one for one, later in pairwise(said) if later - one < 1_000_000_000], [])
