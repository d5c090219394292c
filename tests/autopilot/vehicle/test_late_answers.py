"""Late answers, commands of the flight, failsafes and forms, as tables over injected time."""

from __future__ import annotations

from autopilot.adapters.vehicle.orders import Form, other_form
from tests.autopilot.vehicle.exchanges import COPTER, PX4, check_exchange


def test_a_late_answer_is_nobody_s() -> None:
    """A pointing that was given up may be answered late; the next leaves at once, and is believed when it can be."""
    check_exchange(
        """
        0    | order 1 place 2100 | send 1 #0
        0    | sent 1             | sent 1
        700  | tick               | send 1 #1
        700  | sent 1             |
        1400 | tick               | send 1 #2
        1400 | sent 1             |
        2100 | tick               | unanswered 1 no answer of 3
        2200 | answer place 0     | (late answer)
        2300 | order 2 place 9000 | send 2 #0
        2300 | sent 2             | sent 2
        2400 | answer place 4     | (late answer)
        3000 | tick               | send 2 #1
        3700 | tick               | send 2 #2
        4400 | tick               | send 2 #3
        5099 | answer place 5 50  | (late answer)
        5100 | tick               | send 2 #4
        5100 | answer place 0     | answered 2 0 0% of 1
        """
    )


def test_what_left_twice_is_answered_twice() -> None:
    check_exchange(
        """
        0    | order 1 angles 5000 | send 1 #0
        0    | sent 1              | sent 1
        700  | tick                | send 1 #1
        700  | sent 1              |
        800  | answer angles 0     | answered 1 0 0% of 2
        810  | order 2 angles 5000 | send 2 #0
        810  | sent 2              | sent 2
        900  | answer angles 0     | (late answer)
        1510 | tick                | send 2 #1
        3800 | answer angles 0     | answered 2 0 0% of 1
        """
    )


def test_what_is_sent_once_waits_until_no_answer_to_another_can_come() -> None:
    check_exchange(
        """
        0    | order 1 loiter 5000 | send 1 #0
        0    | sent 1              | sent 1
        700  | tick                |
        2099 | tick                |
        2100 | tick                | unanswered 1 no answer of 1
        2200 | order 2 guided 5000 |
        2300 | answer loiter 0     | (late answer)
        5099 | tick                |
        5100 | tick                | send 2 #0
        5100 | sent 2              | sent 2
        5200 | answer guided 0     | answered 2 0 0% of 1
        5300 | answer guided 0     | (late answer)
        5400 | order 3 arm 1000    | send 3 #0
        5500 | order 4 guided 1000 |
        6500 | tick                | unanswered 4 expired before sending of 0
        """
    )


def test_nothing_that_takes_the_aircraft_from_a_pilot_is_sent_again() -> None:
    for name in ("loiter", "guided", "arm", "start", "item", "fly"):
        check_exchange(
            f"""
            0    | order 1 {name} 9000 | send 1 #0
            0    | sent 1              | sent 1
            700  | tick                |
            2099 | tick                |
            2100 | tick                | unanswered 1 no answer of 1
            """
        )


def test_a_return_is_sent_again() -> None:
    for name in ("rtl", "land", "ordered_rtl"):
        check_exchange(
            f"""
            0   | order 1 {name} 9000 | send 1 #0
            0   | sent 1              | sent 1
            700 | tick                | send 1 #1
            """
        )


def test_commands_of_the_flight_wait_in_their_order() -> None:
    """None supersedes another, and a pointing supersedes none."""
    check_exchange(
        """
        0    | order 1 loiter 9000 | send 1 #0
        0    | sent 1              | sent 1
        10   | order 2 guided 9000 |
        20   | order 3 loiter 9000 |
        30   | order 4 place 50    | send 4 #0
        100  | answer loiter 0     | answered 1 0 0% of 1
        3100 | tick                | unanswered 4 no vehicle of 0; send 2 #0
        """
    )


def test_a_failsafe_goes_before_everything_and_at_once() -> None:
    """Also where its command is in flight, and where answers to others may still come: 500 ms are all it has."""
    check_exchange(
        """
        0    | order 1 loiter 9000 | send 1 #0
        0    | sent 1              | sent 1
        10   | order 2 guided 9000 |
        20   | order 3 rtl 9000    | unanswered 2 superseded of 0; unanswered 1 superseded of 1; send 3 #0
        20   | sent 3              | sent 3
        30   | answer loiter 4     | (late answer)
        720  | tick                | send 3 #1
        1420 | tick                | send 3 #2
        2120 | tick                | send 3 #3
        2820 | tick                | send 3 #4
        3020 | answer rtl 0        | answered 3 0 0% of 1
        """
    )
    check_exchange(
        """
        0    | order 1 ordered_rtl 9000 | send 1 #0
        0    | sent 1                   | sent 1
        20   | order 2 land 9000        | unanswered 1 superseded of 1; send 2 #0
        30   | order 3 ordered_rtl 9000 |
        40   | order 4 land 9000        | unanswered 3 superseded of 0; unanswered 2 superseded of 0; send 4 #0
        """
    )


def test_a_failsafe_leaves_what_points_alone() -> None:
    check_exchange(
        """
        0  | order 1 place 9000 | send 1 #0
        0  | sent 1             | sent 1
        10 | order 2 place 9000 |
        20 | order 3 rtl 9000   | send 3 #0
        30 | answer place 0     | answered 1 0 0% of 1; send 2 #0
        """
    )


def test_what_a_failsafe_supersedes_in_flight_is_not_sent_again() -> None:
    check_exchange(
        """
        0    | order 1 ordered_rtl 9000 | send 1 #0
        0    | order 2 fly 9000         | send 2 #0
        0    | sent 2                   | sent 2
        20   | order 3 rtl 9000         | unanswered 1 superseded of 0; send 3 #0
        900  | answer fly 0             | answered 2 0 0% of 1
        """
    )


def test_another_form_is_tried_once() -> None:
    check_exchange(
        """
        0   | order 1 angles 5000 | send 1 #0
        0   | sent 1              | sent 1
        100 | answer angles 8     | send 1 #0 as INT
        100 | sent 1              |
        200 | answer angles 8     | (late answer)
        300 | answer angles 0     | answered 1 0 0% of 2
        """
    )
    check_exchange(
        """
        0   | order 1 angles 5000 | send 1 #0
        0   | sent 1              | sent 1
        100 | answer angles 8     | send 1 #0 as INT
        100 | sent 1              |
        200 | answer angles 7     | answered 1 7 0% of 2
        """
    )
    check_exchange(
        """
        0   | order 1 fly 5000 | send 1 #0
        0   | sent 1           | sent 1
        100 | answer fly 9     | send 1 #0 as INT_OTHER_FRAME
        100 | sent 1           |
        200 | answer fly 9     | answered 1 9 0% of 2
        """
    )
    check_exchange(
        """
        0   | order 1 fly 100 | send 1 #0
        0   | sent 1          | sent 1
        100 | answer fly 9    | answered 1 9 0% of 1
        """
    )


def test_a_place_goes_long_to_whom_reads_its_altitude_alike() -> None:
    table = """
        0   | order 1 place 5000 | send 1 #0
        0   | sent 1             | sent 1
        100 | answer place 7     | ANSWER
        """
    check_exchange(table.replace("ANSWER", "send 1 #0 as LONG"), PX4)
    check_exchange(table.replace("ANSWER", "answered 1 7 0% of 1"), COPTER)


def test_in_progress_for_ever_ends() -> None:
    check_exchange(
        """
        0     | order 1 arm 5000 | send 1 #0
        0     | sent 1           | sent 1
        100   | answer arm 5 10  | answered 1 5 10% of 1
        3000  | answer arm 5 10  |
        6000  | answer arm 5 20  | answered 1 5 20% of 1
        9000  | answer arm 5 30  | answered 1 5 30% of 1
        10099 | tick             |
        10100 | tick             | unanswered 1 no answer of 1
        """
    )


def test_each_form_is_asked_for_of_one_that_has_another() -> None:
    """The one switch there is, from each form; nothing asks for the form that it is in."""
    asked = {(form, result): other_form(form, result) for form in Form for result in (0, 7, 8, 9)}
    assert {key: form for key, form in asked.items() if form is not None} == {
        (Form.INT, 7): Form.LONG,
        (Form.INT_OTHER_FRAME, 7): Form.LONG,
        (Form.LONG, 8): Form.INT,
        (Form.INT, 9): Form.INT_OTHER_FRAME,
    }
