"""Chart `safety`: what is one episode and what another, in tables and by chance.

By chance, each command is held against a model of episodes that shares nothing with the chart: it knows what was
reported and when, and has neither states nor deadlines.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st

from events import Record
from events.schema.common_pb2 import Moved
from statecharts import steps_of
from tests.checks import check_chart, check_equal
from tests.monitors import complaints
from tests.statecharts.charts.test_safety import SQUARE, flight
from tests.stories import Story

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


def test_who_obeyed_and_breaks_the_fence_again_is_commanded_at_once() -> None:
    """An operator let the mission go on once the vehicle was back inside: that is another episode, a second later."""
    check_chart(
        "safety",
        """
        at_s | observe                | state             | say
        0    | spot 200,0             | 1/fence returning | return: outside an inclusion fence
        0.4  | flies return           | 1/fence complying | -
        1    | spot 99,0 speed=-20,0  | 1/fence ok        | -
        1.2  | flies mission          | -                 | -
        1.3  | spot 99,0 speed=5,0    | 1/fence returning | return: on the way out of an inclusion fence
        1.5  | spot 98,0 speed=-1,0   | 1/fence settling  | -
        1.6  | flies return           | 1/fence ok        | -
        1.7  | flies mission          | -                 | -
        1.8  | spot 101,0             | 1/fence returning | return: outside an inclusion fence
        1.9  | flies return           | 1/fence complying | -
        2.0  | flies mission          | 1/fence pending   | -
        6.8  | time                   | 1/fence returning | return: outside an inclusion fence
        """,
        flight(SQUARE),
    )


def test_a_place_that_flickers_at_an_edge_is_no_flood_of_commands() -> None:
    """Twice a second in and out: commanded at its rate where the vehicle does not obey, and never where it does."""
    for obeys, commands in ((False, 4), (True, 1)):
        story = flight(SQUARE)
        for number in range(80):
            let_pass(story, 250 * number)
            story.tell(f"spot {99 + number % 2 * 2},0")
            if obeys and number == 1:
                story.tell("flies return")
        said = [record for record in story.flight.records if record.kind.name == "set_vehicle_mode"]
        check_equal((obeys, len(said)), (obeys, commands))


def let_pass(story: Story, until_ms: int) -> None:
    """Let time pass up to a moment, as a prompt shell does."""
    story.flight.wait(until_ms - story.flight.now_ns // 1_000_000)


def test_a_second_of_calm_ends_an_episode_that_nobody_obeyed() -> None:
    """To the millisecond, and also for a shell that is late; and so does the age of the last command."""
    check_chart(
        "safety",
        """
        at_s  | observe     | state               | say
        0     | battery 20  | 1/battery returning | return: battery at 20 %
        1     | battery 30  | 1/battery settling  | -
        1.999 | battery 20  | 1/battery pending   | -
        2     | battery 30  | 1/battery settling  | -
        3     | time        | 1/battery ok        | -
        3.1   | battery 20  | 1/battery returning | return: battery at 20 %
        3.2   | battery 30  | 1/battery settling  | -
        4.2   | battery 20  | 1/battery returning | return: battery at 20 %
        9     | battery 30  | 1/battery settling  | -
        9.2   | battery 31  | 1/battery ok        | -
        9.3   | battery 20  | 1/battery returning | return: battery at 20 %
        14.3  | time        | 1/battery returning | return: battery at 20 %
        19.2  | vehicle down | 1/battery unreachable | -
        19.3  | battery 30  | 1/battery ok        | -
        """,
        flight(),
    )


def test_who_is_not_seen_is_not_seen_to_be_safe() -> None:
    """A start, or a silence of the vehicle, ends no episode at a fence; a place inside does, at its time."""
    check_chart(
        "safety",
        """
        at_s | observe      | state               | say
        0    | spot 200,0   | 1/fence returning   | return: outside an inclusion fence
        1    | spot 0,0     | 1/fence settling    | -
        1.2  | start        | 1/fence unreachable | -
        2.6  | vehicle up   | -                   | -
        2.8  | flies        | -                   | -
        3    | spot 200,0   | 1/fence pending     | -
        3.1  | vehicle down | 1/fence unreachable | -
        4    | vehicle up   | -                   | -
        4.1  | spot 0,0     | 1/fence settling    | -
        4.2  | spot 200,0   | 1/fence pending     | -
        5    | time         | 1/fence returning   | return: outside an inclusion fence
        6    | vehicle down | 1/fence unreachable | -
        7    | fence        | 1/fence settling    | -
        8    | time         | 1/fence ok          | -
        9    | vehicle up   | -                   | -
        """,
        flight(SQUARE),
    )


def test_who_is_at_rest_before_a_silence_is_so_after_it() -> None:
    """What obeyed and was over is over; nobody calls an unknown place a breach."""
    check_chart(
        "safety",
        """
        at_s | observe                 | state             | say
        0    | spot 0,0                | -                 | -
        1    | start                   | -                 | -
        2    | vehicle up              | -                 | -
        3    | spot 200,0              | 1/fence returning | return: outside an inclusion fence
        4    | order a override fence  | -                 | -
        4    | time                    | 1/fence held_off  | -
        5    | start                   | -                 | -
        6    | vehicle up              | -                 | -
        """,
        flight(SQUARE),
    )


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
    story, model, at_ms = flight(), Model(), 0
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
    story, at_ms = flight(), 0
    story.tell("fence in=-100,-100,100,100")
    for pause_ms, one in words:
        at_ms += pause_ms
        story.flight.wait(pause_ms)
        story.tell(one)
    said = [record.at.flight_ns for record in story.flight.records if record.kind.name == "set_vehicle_mode"]
    check_equal([later - one for one, later in pairwise(said) if later - one < 1_000_000_000], [])
