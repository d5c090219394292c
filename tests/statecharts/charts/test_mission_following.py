"""The chart `mission` where a camera follows something: the waypoint in the middle, and whose plan has it."""

from __future__ import annotations

import pytest

from events.schema.mission_pb2 import WaypointPosted
from tests import flying
from tests.checks import check_chart, check_equal, seen
from tests.statecharts.charts.test_mission import AIR
from tests.stories import Story


def followed(items: str = "takeoff,go,go,home") -> Story:
    """Return a story in the air, with a finding that a person has confirmed."""
    tale = Story(*flying.opening(sightings_to_ask=1, frame_rate_floor_mhz=0))
    planned, uploads = f"| planned items={items}", f"upload {items.count(',') + 1} "
    tale = check_chart("mission", AIR.replace("| planned", planned, 1).replace("upload 4 ", uploads), tale)
    for words in ("frame person@5,5", "time", "order c confirm p1 by=bravo", "at 2 reached=1"):
        tale.tell(words)
    return tale


def test_what_is_followed_gets_a_waypoint() -> None:
    """The office is asked, the changed plan is uploaded in the air, the vehicle waits there, and goes on behind it."""
    check_chart(
        "mission",
        """
        at_s | observe                    | state       | say                   | why
        10   | order f follow p1 by=bravo | 1 flying | post before 2 at 30 m | asks for a waypoint at what is followed
        11   | posted                     | -           | -                     | -
        12   | planned rev=b items=takeoff,go,go,go,home | 1 uploading | upload 5 | the plan has changed
        13   | mode mission               | -           | -                     | -
        14   | uploaded                   | 1 engaging  | item 2; go mission    | the vehicle has the plan, in the air
        15   | mode mission               | 1 flying    | -                     | goes on with the mission
        20   | time                       | -           | -                     | -
        20   | at 2                       | -           | -                     | -
        21   | at 3 reached=2             | 1 following | go loiter             | waits at what is followed
        22   | mode loiter                | -           | -                     | -
        30   | order t turn by=bravo      | 1 engaging  | item 3; go mission    | goes on where it left the mission
        31   | mode mission               | 1 flying    | -                     | goes on with the mission
        """,
        followed(),
    )


def test_a_waypoint_that_comes_late_is_turned_back_for() -> None:
    """Where the vehicle is past its number already, by the plan before: that is not waiting at it."""
    check_chart(
        "mission",
        """
        at_s | observe                    | state       | say                   | why
        10   | order f follow p1 by=bravo | 1 flying | post before 2 at 30 m | asks for a waypoint at what is followed
        11   | at 3 reached=2             | -           | -                     | -
        12   | posted                     | -           | -                     | -
        13   | at 4 reached=3             | -           | -                     | -
        14   | planned rev=b items=takeoff,go,go,go,go,go,go,home | 1 uploading | upload 8 | the plan has changed
        15   | at 5 reached=4             | -           | -                     | -
        16   | uploaded                   | 1 engaging  | item 2; go mission    | the vehicle has the plan, in the air
        17   | at 5                       | -           | -                     | -
        18   | mode mission               | 1 flying    | -                     | goes on with the mission
        20   | time                       | -           | -                     | -
        20   | at 6 reached=5             | -           | -                     | -
        21   | at 2                       | -           | -                     | -
        22   | at 3 reached=2             | 1 following | go loiter             | waits at what is followed
        """,
        followed("takeoff,go,go,go,go,go,home"),
    )


def test_a_plan_of_somebody_else_has_no_such_waypoint() -> None:
    """Nor the plan of before: only the one that came of the asking, once the vehicle holds it."""
    tale = followed("takeoff,go,go,go,home")
    for words in ("order f follow p1 by=bravo", "at 3 reached=2", "planned rev=c items=takeoff,go,go,go,home of=7"):
        tale.tell(words)
    for words in ("uploaded", "mode mission", "at 2", "at 3"):
        tale.tell(words)
    check_equal(tale.flight.state.missions[1].state, "flying")
    for words, state in (("planned rev=d items=takeoff,go,go,go,go,home", "uploading"), ("at 2", "uploading")):
        tale.tell(words)
        check_equal((words, tale.flight.state.missions[1].state), (words, state))
    for words, state in (("uploaded", "engaging"), ("mode mission", "flying"), ("at 3", "following")):
        tale.tell(words)
        check_equal((words, tale.flight.state.missions[1].state), (words, state))


def test_what_was_passed_while_nobody_looked_is_not_waited_at_later() -> None:
    """Past the waypoint before the mission goes on: the camera follows, the vehicle goes its way."""
    tale = followed("takeoff,go,go,go,home")
    for words in ("order f follow p1 by=bravo", "planned rev=b items=takeoff,go,go,go,go,home", "uploaded", "at 3"):
        tale.tell(words)
    for words in ("mode mission", "at 4"):
        tale.tell(words)
        check_equal((words, tale.flight.state.missions[1].state), (words, "flying"))


def test_the_plan_is_not_the_vehicles_before_it_holds_it() -> None:
    """A second waypoint, of which the plan is known and not uploaded: nothing is waited at, though one was before."""
    tale = followed("takeoff,go,go,go,go,home")
    first = (
        "order f follow p1 by=bravo",
        "planned rev=b items=takeoff,go,go,go,go,go,home",
        "uploaded",
        "mode mission",
    )
    for words in (
        *first,
        "at 3 reached=2",
        "order t turn by=bravo",
        "mode mission",
        "at 3",
        "order g follow p1 by=bravo",
    ):
        tale.tell(words)
    check_equal(tale.flight.state.missions[1].middle_item, 3)
    for words in (
        "at 3",
        "order p pause",
        "mode loiter",
        "planned rev=c items=takeoff,go,go,go,go,go,go,home",
        "mode mission",
    ):
        tale.tell(words)
    for words, state in (("at 3", "flying"), ("at 4 reached=3", "flying"), ("mode mission", "uploading")):
        tale.tell(words)
        check_equal((words, tale.flight.state.missions[1].state), (words, state))
    for words, state in (
        ("uploaded", "engaging"),
        ("mode mission", "flying"),
        ("at 3", "flying"),
        ("at 4", "following"),
    ):
        tale.tell(words)
        check_equal((words, tale.flight.state.missions[1].state), (words, state))


def test_a_vehicle_that_is_before_the_waypoint_goes_on_where_it_is() -> None:
    """Nothing of the mission is left out on the way to it."""
    tale = followed()
    for words in ("order f follow p1 by=bravo", "at 1", "planned rev=b items=takeoff,go,go,go,home"):
        tale.tell(words)
    check_equal(seen(tale, "mission", tale.tell("uploaded"))["say"], "item 1; go mission")


def test_what_the_office_said_to_an_older_question_is_not_about_this_one() -> None:
    """The waypoint that was asked for last is still to come."""
    tale = followed()
    tale.tell("order f follow p1 by=bravo")
    for seq, left in ((3, 2), (flying.newest(tale.flight.records, "post_waypoint"), -1)):
        tale.flight.tell(WaypointPosted(effect_seq=seq, failure="too late"))
        check_equal(tale.flight.state.missions[1].middle_item, left)


def test_it_is_waited_once_at_a_waypoint() -> None:
    """Whoever resumes a mission that was paused there lets it go on behind it, though the camera follows on."""
    tale = followed("takeoff,go,go,go,home")
    for words in ("order f follow p1 by=bravo", "planned rev=b items=takeoff,go,go,go,go,home", "uploaded"):
        tale.tell(words)
    for words in ("mode mission", "at 3 reached=2", "mode loiter", "order p pause", "order r resume", "mode mission"):
        tale.tell(words)
    for words in ("at 3 reached=2", "at 4"):
        tale.tell(words)
        check_equal((words, tale.flight.state.missions[1].state), (words, "flying"))
    check_equal([one.state for one in tale.flight.state.scans.values()], ["following"])


@pytest.mark.parametrize(("told", "left"), [("", -1), ("posted", -1), ("planned rev=b", 2)])
def test_a_start_waits_for_no_waypoint_that_was_asked_for_before(told: str, left: int) -> None:
    """Who asked the office died with the process; a waypoint that came is kept. Another may be asked for later."""
    tale = followed()
    for words in ("order f follow p1 by=bravo", told, "start"):
        if words:
            tale.tell(words)
    check_equal(tale.flight.state.missions[1].middle_item, left)


def test_following_without_a_waypoint() -> None:
    """The office refuses, or nobody wants one: the camera follows and the vehicle goes its way."""
    tale = check_chart(
        "mission",
        """
        at_s | observe                    | state    | say                   | why
        10   | order f follow p1 by=bravo | 1 flying | post before 2 at 30 m | asks for a waypoint at what is followed
        11   | posted no such mission     | -        | -                     | -
        12   | at 3 reached=2             | 1 returning | -                  | the mission is on its way home
        13   | order t turn by=bravo      | -        | -                     | -
        """,
        followed(),
    )
    check_equal(tale.flight.state.missions[1].middle_item, -1)
    tale = followed()
    tale.flight.state.flight.limits.follow_by_waypoint = False
    check_chart(
        "mission",
        """
        at_s | observe                    | state | say | why
        10   | order f follow p1 by=bravo | -     | -   | -
        """,
        tale,
    )


@pytest.mark.parametrize(
    ("words", "state", "say"),
    [
        ("order p pause", "1 paused", "go loiter"),
        ("order x abort", "1 aborting", "go return"),
        ("mode return", "1 returning", "-"),
        ("disarmed", "1 landed", "-"),
        ("mode loiter", "-", "-"),
    ],
)
def test_while_it_waits_at_what_is_followed(words: str, state: str, say: str) -> None:
    """Whatever comes there ends it as in the mission itself."""
    tale = followed()
    for told in ("order f follow p1 by=bravo", "planned rev=b items=takeoff,go,go,go,home", "uploaded"):
        tale.tell(told)
    for told in ("mode mission", "at 3 reached=2", "mode mission"):
        tale.tell(told)
    found = seen(tale, "mission", tale.tell(words))
    check_equal((found["state"], found["say"]), (state, say))
