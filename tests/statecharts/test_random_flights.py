"""Flights that nobody thought of: words drawn at random, watched by the monitors and restarted at the end.

Time passes as the shell lets it: at every deadline that the core has asked for, unless the flight says that the
shell was late.
"""

from __future__ import annotations

from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from events import read_record
from events.schema.flight_pb2 import BaselineCarried
from statecharts import State, carry_over, restore, step, steps_of
from statecharts.engine import Step
from tests import flying
from tests.checks import check_equal, check_moves_are_the_state, check_same
from tests.flights import opened_well
from tests.monitors import complaints
from tests.stories import Story
from tests.stories_of_safety import SAFE_LIMITS

NAMES = st.sampled_from("abcd")
GOOD = st.sampled_from(["", " by=bravo"])
POIS = st.sampled_from(["p1", "p2", "p3"])
WHO = st.sampled_from(
    ["", " by=bravo", " by=bravo roles=viewer", " roles=", " target=x", " life=0", " seq=1", " nonce=n"]
)
JUDGE = st.sampled_from(["confirm", "decline"])
VERBS = st.one_of(
    st.sampled_from(["point", "turn", "release", "point camera=2", "point at=null", "dance"]),
    st.builds("{} {}".format, JUDGE, POIS),
)
THINGS = st.builds(
    "{}@{},{}:{}".format,
    st.sampled_from(["person", "person", "car", "ball"]),
    st.integers(-3, 3).map(lambda number: number * 7),
    st.integers(-1, 1).map(lambda number: number * 7),
    st.sampled_from([39, 40, 70, 100]),
)
OUTCOMES = st.sampled_from(
    [*(f"answered newest {result}" for result in (0, 0, 0, 2, 3, 5)), "unanswered newest silence", "sent newest"]
)
DANGERS = st.one_of(
    st.sampled_from(["battery 90", "battery 25", "battery 15", "battery 9", "heard alpha", "start no clock"]),
    st.sampled_from(["flies", "flies", "flies return", "flies land", "grounded"]),
    st.sampled_from(["fence in=-50,-50,50,50", "fence in=-50,-50,50,50 in2=40,-50,150,50 out=-9,-9,9,9", "fence"]),
    st.builds("spot {},{} speed={},0".format, *[st.sampled_from([-60, -20, 0, 45, 50, 150])] * 2, st.integers(-30, 30)),
    st.builds(
        "order {} override {} for={}".format,
        st.text("mnop", min_size=2, max_size=3),
        st.sampled_from(["battery", "link", "fence", "landing"]),
        st.sampled_from([0, 1, 20, 600, 601]),
    ),
)
MISSIONS = st.one_of(
    st.sampled_from(
        ["planned", "planned", "planned rev=b items=takeoff,go,home", "planned wing=1", "no-mission final=1"]
    ),
    st.sampled_from(["report pass", "report pass", "report pass,degraded", "report fail", "report-of 7"]),
    st.sampled_from(["uploaded", "uploaded", "uploaded", "uploaded 9", "not-uploaded"]),
    st.sampled_from(["did 0", "did 0", "did 0", "did 4", "did 5", "did-not", "posted", "posted refused"]),
    st.sampled_from(["disarmed", "armed", "mode guided", "mode mission", "mode mission", "mode loiter", "mode return"]),
    st.builds("at {} reached={}".format, st.integers(0, 4), st.integers(0, 4)),
    st.sampled_from(["pushed", "pushed left=2", "pushed left=2 again=", "pushed 7"]),
)
ASKED = st.builds(
    "order {} {}{}".format,
    st.text("qrst", min_size=2, max_size=4),
    st.one_of(
        st.sampled_from(
            ["begin", "begin", "turn roles=camera", "pause", "resume", "abort", "acknowledge 20", "go-into loiter"]
        ),
        st.sampled_from(["fly", "fly to=60,0", "fly to=0,0"]),
    ),
    st.sampled_from(["", "", " by=bravo", " roles=camera"]),
)
FOLLOWING = st.builds("order {} follow {}".format, st.text("uvwx", min_size=2, max_size=4), POIS)
# What leads into the air, and to a waypoint where something is followed; a flight may begin with any part of it.
WAY = tuple(
    """
    disarmed|planned|report pass|order {0} begin|uploaded|did 0|armed|mode mission|did 0|at 1|mode mission|lens zooms
    frame person@5,5|time|order {0}c confirm p1|order {0}f follow p1|posted|planned rev=b items=takeoff,go,go,go,home
    uploaded|mode mission|at 2 reached=1|mode loiter
    """.strip()
    .replace("\n", "|")
    .split("|")
)
WORDS = st.one_of(
    OUTCOMES,
    OUTCOMES,
    OUTCOMES,
    st.builds("order {} {}{}".format, NAMES, VERBS, WHO),
    st.builds("order {} {}{}".format, st.text("efghijkl", min_size=2, max_size=4), VERBS, GOOD),
    st.builds("order {} {} {}".format, st.text("efghijkl", min_size=2, max_size=4), JUDGE, POIS),
    st.builds("again {}".format, NAMES),
    st.builds("again {} body=evil".format, NAMES),
    st.builds("sent {}".format, st.sampled_from(["newest", "newest", "newest", *"abcd"])),
    st.builds(
        "answered {} {}".format,
        st.sampled_from(["newest", "newest", "newest", *"abcd", "own", "3"]),
        st.sampled_from([0, 0, 2, 3, 5]),
    ),
    st.builds(
        "unanswered {} {}".format,
        st.sampled_from(["newest", "newest", "newest", *"abcd", "own"]),
        st.sampled_from(["silence", "superseded"]),
    ),
    st.builds("published {}{}".format, NAMES, st.sampled_from(["", " failure=x"])),
    st.builds(
        "gimbal {} error={}".format,
        st.sampled_from(["newest", "newest", "newest", *"abcd", "own"]),
        st.sampled_from([0, 100, 101]),
    ),
    st.lists(THINGS, max_size=4).map(lambda things: " ".join(["frame", *things])),
    st.lists(THINGS, max_size=4).map(lambda things: " ".join(["frame", *things])),
    st.sampled_from(["vehicle down", "vehicle up", "vehicle up", "start", "malformed e", "malformed a"]),
    DANGERS,
    DANGERS,
    MISSIONS,
    MISSIONS,
    ASKED,
    FOLLOWING,
)
LATER = st.sampled_from([0, 0, 0, 1, 50, 50, 500, 500, 3_000, 15_000, 40_000, 200_000])
SOON = st.sampled_from([0, 20, 20, 500, 3_000, 11_000])
STEPS = st.lists(st.tuples(LATER, WORDS), min_size=10, max_size=40)
AIRBORNE = st.builds(
    lambda upto, name, steps: [*((20, words.strip().format(name)) for words in WAY[:upto]), *steps],
    st.integers(1, len(WAY)),
    st.text("yz", min_size=2, max_size=3),
    st.lists(st.tuples(SOON, st.one_of(MISSIONS, MISSIONS, ASKED, FOLLOWING, DANGERS, WORDS)), max_size=30),
)
FLIGHTS = st.one_of(STEPS, AIRBORNE)
LIMITS = (
    flying.LIMITS
    | SAFE_LIMITS
    | {
        "sightings_to_ask": 1,
        "asks_per_minute": 2,
        "scan_enabled": True,
        "frame_rate_floor_mhz": 200,
        "failsafe_again_ms": 20_000,
    }
)


CHANGES: tuple[dict[str, Any], ...] = (
    {},
    {"operator_lost_ms": 0},
    {"operator_lost_ms": 0, "battery_return_percent": 0},
    {"mission_begun_by_order": False},
    {"pilot_starts": True},
    {"mission_enabled": False},
    {"mission_enabled": False, "flight_enabled": False},
    {"follow_by_waypoint": False, "mission_tries": 1},
    {"push_ms": 0},
)


def fly(steps: list[tuple[int, str]], prompt: bool, changes: dict[str, Any] | None = None) -> Story:
    """Tell a flight; a prompt shell lets time pass at every deadline, another only when something else happens."""
    story = Story(**LIMITS | (changes or {}))
    at_ms = 0
    for after_ms, words in steps:
        at_ms += after_ms
        let_time_pass(story, at_ms, prompt)
        story.at(at_ms)
        if words.startswith("again") and words.split()[1] not in story._orders:
            continue
        check_moves_are_the_state(story.flight.state, story.tell(words))
    let_time_pass(story, at_ms + 400_000, prompt)
    return story


def let_time_pass(story: Story, until_ms: int, prompt: bool) -> None:
    """Record `time_passed` at each deadline up to a time, or once at its end; a core that spins is an error."""
    for _ in range(200):
        due = story.flight.due
        if due is None or due > until_ms * 1_000_000:
            return
        story.flight.now_ns = max(due, story.flight.now_ns) if prompt else until_ms * 1_000_000
        check_moves_are_the_state(story.flight.state, story.tell("time"))
        later = story.flight.due
        assert later is None or later > story.flight.now_ns, "a deadline that has passed is offered a second time"
    raise AssertionError("the core spins")


@settings(max_examples=120, deadline=None)
@given(FLIGHTS, st.booleans(), st.sampled_from(CHANGES))
def test_monitors_have_nothing_to_say_and_a_restart_changes_nothing(
    steps: list[tuple[int, str]], prompt: bool, changes: dict[str, Any]
) -> None:
    """Safety holds, nothing raises, and both a restart from the stored bytes and a replay find the same."""
    story = fly(steps, prompt, changes)
    records = [read_record(stored) for stored in story.flight.store.stored()]
    check_equal(records, story.flight.records)
    groups = list(steps_of(records))
    check_equal(complaints(groups), [])
    check_equal([record.seq for record in records if record.kind.name == "step_failed"], [])
    found, again = State(), State()
    for group in groups:
        due = restore(found, group)
        check_equal(step(again, group[0]), Step(group, due))
    check_same(found, story.flight.state)
    check_same(again, story.flight.state)


@settings(max_examples=60, deadline=None)
@given(FLIGHTS, st.integers(0, 100_000))
def test_the_next_flight_begins_where_this_one_ends(steps: list[tuple[int, str]], later_ns: int) -> None:
    """What is carried over and loaded is carried over the same again; orders under way end as unknown."""
    story = fly(steps[:20], prompt=True)
    carried = carry_over(story.flight.state, story.flight.now_ns + later_ns)
    manifest, started, *rest = opened_well(story.flight.state.flight.limits)
    after = Story(manifest, BaselineCarried(state=carried))
    check_equal(carry_over(after.flight.state, 0), carried)
    underway = {one.command_id for one in carried.unanswered}
    after.flight.tell(started)
    acks = [record.message for record in after.flight.records if record.kind.name == "send_ack"]
    check_equal({ack.command_id for ack in acks}, underway)  # type: ignore[attr-defined]
    check_equal(
        {order.state for order in after.flight.state.orders.values()} & {"intended", "sent", "in_progress"}, set()
    )
    for message in rest:
        after.flight.tell(message)
    check_equal(complaints(list(steps_of(after.flight.records))), [])
