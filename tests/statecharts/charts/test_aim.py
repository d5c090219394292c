"""The chart `aim` as tables: a command that was accepted is no arrival; measured, or missed."""

from __future__ import annotations

import pytest

from tests.checks import check_chart, check_equal


def test_arrived_is_measured() -> None:
    """Accepted is not arrived; the tolerance itself is near enough; afterwards nothing is waited for."""
    story = check_chart(
        "aim",
        """
        at_s | observe            | state       | why
        0    | gimbal             | -           | -
        0    | order a point      | 1/1 moving  | asked to look somewhere
        0.1  | answered a 0       | -           | -
        0.2  | gimbal a error=101 | -           | -
        0.2  | gimbal             | -           | -
        0.3  | gimbal a error=100 | 1/1 arrived | measured within the tolerance
        0.4  | gimbal a error=900 | -           | -
        """,
    )
    aim = story.flight.state.aims["1/1"]
    check_equal((aim.error_cdeg, aim.order, aim.asked_ns), (900, "alpha/a", 0))


def test_missed() -> None:
    """Ten seconds without arrival, a refusal, or a command that never left; a later measurement changes nothing."""
    check_chart(
        "aim",
        """
        at_s | observe                | state      | why
        0    | order a point          | 1/1 moving | asked to look somewhere
        5    | answered a 0           | -          | -
        10   | time                   | 1/1 missed | not there in time
        11   | gimbal a error=0       | -          | -
        12   | order b turn           | 1/1 moving | asked to look somewhere
        13   | answered b 5           | -          | -
        14   | answered b 4           | 1/1 missed | the vehicle did not take the command
        15   | order c turn           | 1/1 moving | asked to look somewhere
        16   | unanswered c no answer | 1/1 missed | the vehicle did not take the command
        17   | order d release        | 1/1 idle   | let go
        18   | order e release        | -          | -
        19   | gimbal d error=0       | -          | -
        """,
    )


@pytest.mark.parametrize("late", ["answered a 4", "unanswered a superseded", "gimbal a error=0"])
def test_only_the_newest_effect_counts(late: str) -> None:
    """What becomes of the effect before says nothing about this one; patience starts over."""
    check_chart(
        "aim",
        f"""
        at_s | observe       | state      | why
        0    | order a point | 1/1 moving | asked to look somewhere
        4    | order b point | 1/1 moving | asked to look elsewhere
        5    | {late}        | -          | -
        14   | time          | 1/1 missed | not there in time
        """,
    )


def test_a_gimbal_that_is_let_go_does_not_arrive() -> None:
    """Also while it moves: nothing is asked of it any more."""
    story = check_chart(
        "aim",
        """
        at_s | observe          | state      | why
        0    | order a point    | 1/1 moving | asked to look somewhere
        1    | order b release  | 1/1 idle   | let go
        2    | gimbal a error=0 | -          | -
        3    | answered a 4     | -          | -
        4    | time             | -          | -
        """,
    )
    aim = story.flight.state.aims["1/1"]
    check_equal((aim.state, aim.effect_seq, aim.order, aim.error_cdeg), ("idle", -1, "", None))


def test_a_new_wish_forgets_the_old_measurement() -> None:
    """The error that is shown belongs to what is asked now."""
    story = check_chart(
        "aim",
        """
        at_s | observe           | state       | why
        0    | order a point     | 1/1 moving  | asked to look somewhere
        1    | gimbal a error=90 | 1/1 arrived | measured within the tolerance
        2    | order b point     | 1/1 moving  | asked to look somewhere
        """,
    )
    check_equal(story.flight.state.aims["1/1"].error_cdeg, None)


def test_a_start_ends_the_measurement() -> None:
    """Nobody measures any more, which is no miss; what had arrived or missed stays."""
    check_chart(
        "aim",
        """
        at_s | observe              | state       | why
        0    | order a point        | 1/1 moving  | asked to look somewhere
        1    | start                | 1/1 idle    | started again: nobody measures it any more
        21   | start                | -           | -
        22   | vehicle up           | -           | -
        23   | order b turn         | 1/1 moving  | asked to look somewhere
        24   | gimbal b error=40    | 1/1 arrived | measured within the tolerance
        25   | start                | -           | -
        26   | vehicle up           | -           | -
        27   | order c turn         | 1/1 moving  | asked to look somewhere
        37   | time                 | 1/1 missed  | not there in time
        41   | start                | -           | -
        """,
    )
