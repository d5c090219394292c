"""The chart `mission` where it is paused, and the vehicle is still heard to say what it had said before."""

from __future__ import annotations

from typing import Any

from tests.checks import check_chart, check_equal, seen
from tests.statecharts.charts.test_mission import AIR, GROUND, story
from tests.stories import Story


def returning(**changes: Any) -> Story:
    """Return a story of a vehicle that returns by itself, and was told to hold."""
    return check_chart(
        "mission",
        """
        at_s | observe       | state       | say       | why
        8    | mode return   | 1 returning | -         | the vehicle goes home by itself
        9    | order p pause | 1 paused    | go loiter | an operator pauses it
        """,
        story(AIR, **changes),
    )


def test_a_return_that_was_paused_is_not_believed_again_at_once() -> None:
    """A heartbeat that left before the pause says nothing new; a vehicle that was seen to stop means what it says."""
    check_chart(
        "mission",
        """
        at_s | observe     | state       | say       | why
        9.1  | mode return | -           | -         | -
        9.2  | did 0       | -           | -         | -
        9.3  | mode return | -           | -         | -
        10   | mode loiter | -           | -         | -
        11   | mode return | 1 returning | -         | the vehicle goes home
        12   | order q pause | 1 paused  | go loiter | an operator pauses it
        13   | mode land   | 1 returning | -         | the vehicle goes home
        """,
        returning(),
    )
    check_chart(
        "mission",
        """
        at_s | observe        | state      | say                | why
        9.1  | mode return    | -          | -                  | -
        9.2  | order r resume | 1 engaging | item 0; go mission | an operator lets it go on
        9.3  | mode return    | -          | -                  | -
        10   | mode loiter    | -          | -                  | -
        11   | mode mission   | 1 flying   | -                  | goes on with the mission
        """,
        returning(),
    )
    check_chart(
        "mission",
        """
        at_s | observe        | state       | say                | why
        9.2  | order r resume | 1 engaging  | item 0; go mission | an operator lets it go on
        10   | mode loiter    | -           | -                  | -
        11   | mode return    | 1 returning | -                  | the vehicle goes home by itself
        """,
        returning(),
    )


def test_a_vehicle_that_keeps_returning_returns() -> None:
    """It is asked to hold as often as a step is tried, refused or not; then it is said as it is."""
    check_chart(
        "mission",
        """
        at_s | observe       | state       | say       | why
        10   | did 4         | -           | -         | -
        19   | time          | 1 paused    | go loiter | it does not hold: asked again
        20   | mode return   | -           | -         | -
        29   | time          | 1 paused    | go loiter | it does not hold: asked again
        39   | time          | 1 returning | -         | it does not stop returning
        40   | order q pause | 1 paused    | go loiter | an operator pauses it
        41   | disarmed      | 1 landed    | -         | disarmed
        """,
        returning(),
    )


def test_a_plan_that_goes_up_while_a_return_ends() -> None:
    """Resumed by a changed plan: the return of before is not believed there either, a new one is."""
    for words, expected in (("mode return", "-"), ("mode land", "1 returning")):
        tale = returning()
        for told in ("planned rev=b", "order r resume"):
            tale.tell(told)
        check_equal(tale.flight.state.missions[1].state, "uploading")
        check_equal((words, seen(tale, "mission", tale.tell(words))["state"]), (words, expected))


def test_a_failsafe_is_believed_at_once() -> None:
    """Whatever the vehicle had said before: what a failsafe demands and the vehicle does is no word of the past."""
    limits = {"battery_return_percent": 25, "failsafe_again_ms": 5_000}
    check_chart(
        "mission",
        """
        at_s | observe     | state       | say | why
        9.1  | battery 20  | -           | -   | -
        9.2  | mode return | 1 returning | -   | the vehicle goes home
        """,
        returning(**limits),
    )
    check_chart(
        "mission",
        """
        at_s | observe     | state       | say | why
        9.1  | battery 20  | -           | -   | -
        19   | time        | 1 returning | -   | it does not stop returning
        """,
        returning(**limits),
    )
    check_chart(
        "mission",
        """
        at_s | observe        | state       | say                | why
        9.1  | order r resume | 1 engaging  | item 0; go mission | an operator lets it go on
        9.2  | battery 20     | -           | -                  | -
        9.3  | mode return    | 1 returning | -                  | the vehicle goes home by itself
        """,
        returning(**limits),
    )


def test_after_a_silence_it_is_believed_as_it_is() -> None:
    """What happened meanwhile nobody knows: a vehicle that is heard again returns, or flies, where it says so."""
    for told in (("vehicle down", "vehicle up"), ("start", "vehicle up")):
        tale = returning()
        for words in told:
            tale.tell(words)
        found = seen(tale, "mission", tale.tell("mode return"))
        check_equal((told, found["state"], found["why"]), (told, "1 returning", "the vehicle goes home"))


def test_a_pause_is_not_undone_by_a_word_of_before() -> None:
    """The mission's own mode neither, said once more; it is asked to hold for as long as it flies on."""
    check_chart(
        "mission",
        """
        at_s | observe       | state    | say       | why
        9    | order p pause | 1 paused | go loiter | an operator pauses it
        9.1  | mode mission  | -        | -         | -
        19   | time          | 1 paused | go loiter | it does not hold: asked again
        29   | time          | 1 paused | go loiter | it does not hold: asked again
        39   | time          | 1 paused | go loiter | it does not hold: asked again
        40   | mode loiter   | -        | -         | -
        41   | mode mission  | 1 flying | -         | somebody put it back into the mission
        """,
        story(AIR),
    )


def test_who_is_not_told_to_hold_is_not_waited_for() -> None:
    """On the ground nothing is commanded, down nothing is waited for; and a silent vehicle is believed afterwards."""
    check_chart(
        "mission",
        """
        at_s | observe                 | state      | say       | why
        3    | uploaded                | 1 readying | go guided | the vehicle has the plan, read back
        4    | mode mission disarmed=1 | -          | -         | -
        5    | order p pause           | 1 paused   | -         | an operator pauses it
        """,
        story(GROUND),
    )
    tale = check_chart(
        "mission",
        """
        at_s | observe                 | state    | say       | why
        7    | order p pause           | 1 paused | go loiter | an operator pauses it
        8    | mode mission disarmed=1 | -        | -         | -
        """,
        story(AIR[: AIR.index("    7    | did 0")]),
    )
    check_equal(tale.flight.state.waiting("mission"), ())
    tale = story(AIR, mission_tries=1)
    for words in ("planned rev=b", "vehicle down", "not-uploaded"):
        tale.tell(words)
    check_equal((tale.flight.state.missions[1].state, tale.flight.state.waiting("mission")), ("paused", ()))
    for words, state in (("vehicle up", "paused"), ("mode mission", "flying")):
        tale.tell(words)
        check_equal((words, tale.flight.state.missions[1].state), (words, state))
