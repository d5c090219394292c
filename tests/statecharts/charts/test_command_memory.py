"""The chart `command`: which nonces it remembers, and for how long."""

from __future__ import annotations

from tests.checks import check_chart, check_equal
from tests.stories import Story


def test_malformed_orders_are_answered_and_their_nonce_counts() -> None:
    """Rejected with the field's name; an order that brings the same nonce is a replay."""
    story = check_chart(
        "command",
        """
        at_s | observe     | state | say        | why
        0    | malformed a | -     | a rejected | camera_roi.lat_e7: 95 degrees
        0    | malformed a | -     | a rejected | camera_roi.lat_e7: 95 degrees
        """,
    )
    check_equal(len(story.flight.state.nonces), 1)
    check_equal(len(story.flight.state.owed_acks), 0)


def test_malformed_orders_alone_do_not_fill_the_window() -> None:
    """Their nonces are forgotten as others are, also where no order ever comes."""
    story = Story()
    for number in range(60):
        story.at(number * 10_000)
        story.tell(f"malformed m{number}")
    assert len(story.flight.state.nonces) < 10


def test_a_nonce_is_forgotten_after_its_life() -> None:
    """Until 45 s after the order it is a replay, from then on a fresh order."""
    check_chart(
        "command",
        """
        at_s    | observe               | state         | say           | why
        0       | order a dance nonce=n | a unsupported | a unsupported | unknown kind of order
        44.999  | order b dance nonce=n | b rejected    | b rejected    | replayed
        89.998  | order c dance nonce=n | c rejected    | c rejected    | replayed
        134.998 | order d dance nonce=n | d unsupported | d unsupported | unknown kind of order
        """,
    )
