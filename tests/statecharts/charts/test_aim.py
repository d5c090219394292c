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


def test_drifted() -> None:
    """Off by more than the bound for long enough, with the angle; back within the tolerance it has arrived again."""
    story = check_chart(
        "aim",
        """
        at_s | observe              | state       | why
        0    | order a point        | 1/1 moving  | asked to look somewhere
        1    | gimbal a error=90    | 1/1 arrived | measured within the tolerance
        2    | gimbal a error=200   | -           | -
        3    | gimbal a error=201   | -           | -
        4    | gimbal a error=900   | -           | -
        5    | time                 | 1/1 drifted | 9.0 deg off
        6    | gimbal a error=101   | -           | -
        7    | gimbal a error=100   | 1/1 arrived | back within the tolerance
        8    | gimbal a error=214   | -           | -
        10   | time                 | 1/1 drifted | 2.1 deg off
        11   | answered a 4         | -           | -
        12   | order b point        | 1/1 moving  | asked to look somewhere
        13   | gimbal b error=0     | 1/1 arrived | measured within the tolerance
        14   | gimbal b error=500   | -           | -
        15   | gimbal b error=150   | -           | -
        17   | gimbal b error=500   | -           | -
        18   | order c release      | 1/1 idle    | let go
        18.1 | order d point        | 1/1 moving  | asked to look somewhere
        18.2 | gimbal d error=150   | -           | -
        18.3 | answered d 0         | -           | -
        18.4 | answered b 0         | -           | -
        18.5 | answered c 0         | -           | -
        28.1 | time                 | 1/1 missed  | not there in time
        """,
        drift_cdeg=200,
        drift_settle_ms=2_000,
    )
    check_equal(story.flight.due is None or story.flight.due > 20_000_000_000, True)


def test_who_took_it_is_named() -> None:
    """By its MAVLink ids, where control changed since it was asked, or where another had it all along."""
    check_chart(
        "aim",
        """
        at_s | observe              | state       | why
        0    | control 255/190      | -           | -
        0.1  | order a point        | 1/1 moving  | asked to look somewhere
        1    | gimbal a error=90    | 1/1 arrived | measured within the tolerance
        2    | gimbal a error=300   | -           | -
        4    | time                 | 1/1 drifted | 255/190 controls it
        5    | gimbal a error=30    | 1/1 arrived | back within the tolerance
        5.1  | control 9/1          | -           | -
        6    | gimbal a error=300   | -           | -
        8    | time                 | 1/1 drifted | 9/1 took it
        9    | order b point        | 1/1 moving  | asked to look somewhere
        19   | time                 | 1/1 missed  | not there in time: 9/1 controls it
        20   | control 0/0          | -           | -
        """,
        drift_cdeg=200,
        drift_settle_ms=2_000,
    )


def test_where_nothing_measures_it_is_commanded() -> None:
    """A servo mount says what its servos were told; the reason tells, and it may drift by demand as well."""
    story = check_chart(
        "aim",
        """
        at_s | observe                     | state       | why
        0    | order a point               | 1/1 moving  | asked to look somewhere
        1    | gimbal a demanded error=101 | -           | -
        2    | gimbal a demanded error=100 | 1/1 arrived | commanded there: nothing measures it
        3    | gimbal a demanded error=300 | -           | -
        4    | time                        | 1/1 drifted | 3.0 deg off
        """,
        drift_cdeg=200,
        drift_settle_ms=1_000,
    )
    check_equal(story.flight.state.aims["1/1"].demanded, True)


def test_no_drift_is_told_that_nobody_measures() -> None:
    """A start ends the wait; a flight whose limits do not ask for it never waits; the tolerance bounds it below."""
    check_chart(
        "aim",
        """
        at_s | observe            | state       | why
        0    | order a point      | 1/1 moving  | asked to look somewhere
        1    | gimbal a error=90  | 1/1 arrived | measured within the tolerance
        2    | gimbal a error=900 | -           | -
        3    | start              | -           | -
        9    | answered a 0       | -           | -
        """,
        drift_cdeg=200,
        drift_settle_ms=5_000,
    )
    for drift_cdeg, drift_settle_ms, error_cdeg in ((200, 0, 900), (50, 1_000, 100)):
        check_chart(
            "aim",
            f"""
            at_s | observe            | state       | why
            0    | order a point      | 1/1 moving  | asked to look somewhere
            1    | gimbal a error=90  | 1/1 arrived | measured within the tolerance
            2    | gimbal a error={error_cdeg} | -           | -
            9    | answered a 0       | -           | -
            """,
            drift_cdeg=drift_cdeg,
            drift_settle_ms=drift_settle_ms,
        )
