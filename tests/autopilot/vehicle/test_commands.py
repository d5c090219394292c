"""Answers, re-sends, timeouts and superseding, as tables over injected time."""

from __future__ import annotations

from autopilot.adapters.vehicle.commands import Exchange
from autopilot.ports.config import VehicleSection
from tests.autopilot.vehicle.exchanges import AUTOPILOT, MS, check_exchange, do


def test_accepted() -> None:
    check_exchange(
        """
        0   | order 1 place 5000 | send 1 #0
        0   | sent 1             | sent 1
        300 | answer place 0     | answered 1 0 0% of 1
        900 | tick               |
        901 | answer place 0     | (unmatched answer)
        """
    )


def test_every_result_is_passed_on_raw() -> None:
    for result in (0, 1, 2, 3, 4, 6, 7, 9, 200):
        check_exchange(
            f"""
            0   | order 1 angles 5000     | send 1 #0
            0   | sent 1                  | sent 1
            300 | answer angles {result}  | answered 1 {result} 0% of 1
            """
        )


def test_no_answer_after_three_attempts() -> None:
    check_exchange(
        """
        0    | order 1 angles 5000 | send 1 #0
        0    | sent 1              | sent 1
        699  | tick                |
        700  | tick                | send 1 #1
        700  | sent 1              |
        1400 | tick                | send 1 #2
        1400 | sent 1              |
        2099 | tick                |
        2100 | tick                | unanswered 1 no answer of 3
        9000 | tick                |
        """
    )


def test_an_answer_to_the_last_attempt_counts() -> None:
    check_exchange(
        """
        0    | order 1 angles 5000 | send 1 #0
        0    | sent 1              | sent 1
        700  | tick                | send 1 #1
        700  | sent 1              |
        1399 | answer angles 4     | answered 1 4 0% of 2
        """
    )


def test_nothing_is_sent_after_its_life() -> None:
    check_exchange(
        """
        0   | order 1 place 700 | send 1 #0
        0   | sent 1            | sent 1
        700 | tick              | unanswered 1 no answer of 1
        """
    )
    check_exchange(
        """
        0 | order 1 place 0 | unanswered 1 expired before sending of 0
        """
    )


def test_what_waits_expires() -> None:
    check_exchange(
        """
        0   | order 1 place 5000 | send 1 #0
        0   | sent 1             | sent 1
        10  | order 2 place 100  |
        109 | tick               |
        110 | tick               | unanswered 2 expired before sending of 0
        700 | tick               | unanswered 1 no answer of 1
        """
    )


def test_in_progress_waits_longer_and_ends_the_re_sends() -> None:
    check_exchange(
        """
        0    | order 1 place 9000 | send 1 #0
        0    | sent 1             | sent 1
        600  | answer place 5 10  | answered 1 5 10% of 1
        700  | tick               |
        3000 | answer place 5 10  |
        3500 | answer place 5 60  | answered 1 5 60% of 1
        6499 | tick               |
        6499 | answer place 0     | answered 1 0 0% of 1
        """
    )
    check_exchange(
        """
        0    | order 1 place 9000 | send 1 #0
        0    | sent 1             | sent 1
        600  | answer place 5 255 | answered 1 5 255% of 1
        3599 | tick               |
        3600 | tick               | unanswered 1 no answer of 1
        """
    )


def test_one_of_a_command_in_flight_and_the_newest_waits() -> None:
    check_exchange(
        """
        0   | order 1 place 5000 | send 1 #0
        0   | sent 1             | sent 1
        10  | order 2 place 5000 |
        20  | order 3 place 5000 | unanswered 2 superseded of 0
        100 | answer place 0     | answered 1 0 0% of 1; send 3 #0
        100 | sent 3             | sent 3
        150 | answer place 0     | answered 3 0 0% of 1
        """
    )


def test_a_superseded_one_in_flight_is_not_sent_again_but_its_answer_counts() -> None:
    check_exchange(
        """
        0   | order 1 place 5000  | send 1 #0
        0   | sent 1              | sent 1
        10  | order 2 angles 5000 | send 2 #0
        10  | sent 2              | sent 2
        20  | answer angles 0     | answered 2 0 0% of 1
        699 | tick                |
        700 | tick                | unanswered 1 no answer of 1
        """
    )
    check_exchange(
        """
        0   | order 1 place 5000   | send 1 #0
        0   | sent 1               | sent 1
        10  | order 2 release 5000 | send 2 #0
        10  | sent 2               | sent 2
        20  | answer place 0       | answered 1 0 0% of 1
        """
    )


def test_no_vehicle() -> None:
    check_exchange(
        """
        0  | aim off            |
        0  | order 1 place 5000 | unanswered 1 no vehicle of 0
        10 | aim on             |
        20 | tick               |
        """
    )


def test_bytes_that_never_left() -> None:
    check_exchange(
        """
        0    | order 1 angles 5000 | send 1 #0
        700  | tick                | send 1 #1
        700  | sent 1              | sent 1
        1400 | tick                | send 1 #2
        2100 | tick                | unanswered 1 no answer of 1
        """
    )
    check_exchange(
        """
        0   | order 1 place 500 | send 1 #0
        700 | tick              | unanswered 1 no vehicle of 0
        """
    )


def test_what_is_due_next() -> None:
    exchange = Exchange(VehicleSection(answer_timeout_s=0.7))
    assert exchange.due_ns() is None
    exchange.aim(AUTOPILOT)
    do(exchange, 0, ["order", "1", "place", "5000"])
    assert exchange.due_ns() == 700 * MS
    do(exchange, 0, ["order", "2", "place", "300"])
    assert exchange.due_ns() == 300 * MS
    do(exchange, 0, ["order", "3", "arm", "9000"])
    exchange.take()
    exchange.sent(3)
    do(exchange, 400 * MS, ["tick"])
    do(exchange, 700 * MS, ["answer", "place", "0"])
    do(exchange, 700 * MS, ["answer", "arm", "0"])
    assert exchange.due_ns() is None
    do(exchange, 800 * MS, ["order", "4", "arm", "9000"])
    assert exchange.due_ns() == 3_700 * MS


def test_an_item_goes_as_a_message_to_a_vehicle_that_does_not_know_the_command() -> None:
    """Once, while the order lives and nothing stronger came; the answer is reported as it is."""
    check_exchange(
        """
        0     | order 1 item 5000  | send 1 #0
        1     | sent 1             | sent 1
        100   | answer item 3      | answered 1 3 0% of 1; send 1 #0 as MESSAGE
        200   | answer item 3      | (late answer)
        4000  | order 2 item 1000  | send 2 #0
        4001  | sent 2             | sent 2
        4100  | answer item 2      | answered 2 2 0% of 1
        8000  | order 3 item 1000  | send 3 #0
        8001  | sent 3             | sent 3
        9000  | answer item 3      | answered 3 3 0% of 1
        20000 | order 4 item 5000  | send 4 #0
        20001 | sent 4             | sent 4
        20002 | order 5 rtl 5000   | send 5 #0
        20100 | answer item 3      | answered 4 3 0% of 1
        30000 | order 6 start 5000 | send 6 #0
        30001 | sent 6             | sent 6
        30100 | answer start 3     | answered 6 3 0% of 1
        """
    )
