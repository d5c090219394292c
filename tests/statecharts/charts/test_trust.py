"""What the core makes of the node's trust: orders under a list that is overdue or lost, and what is carried."""

from __future__ import annotations

from events.schema.flight_pb2 import BaselineCarried
from statecharts import carry_over
from statecharts.facts import Trusted
from tests.checks import check_chart, check_equal
from tests.flights import opened_well
from tests.stories import Story


def test_a_list_that_is_overdue_allows_less_and_less() -> None:
    """A camera for 72 h, anything else for one; to the millisecond. A repeat is told the stored result."""
    check_chart(
        "command",
        """
        at_s | observe                          | state          | say             | why
        0    | order a point overdue=259200000  | a intended     | look 1,1        | all gates passed
        1    | order b point overdue=259200001  | b unauthorised | b unauthorised  | revocation stale
        2    | order c release overdue=259200001 | c unauthorised | c unauthorised | revocation stale
        3    | order d turn overdue=3600001     | d intended     | turn -30,90     | all gates passed
        4    | order e odd overdue=3600000      | e unsupported  | e unsupported   | unknown kind of order
        5    | order f odd overdue=3600001      | f unauthorised | f unauthorised  | revocation stale
        6    | again b                          | -              | b unauthorised again | revocation stale
        """,
    )


def test_limits_are_those_of_the_manifest() -> None:
    """Each for its kind of order."""
    check_chart(
        "command",
        """
        at_s | observe                  | state          | say            | why
        0    | order a point overdue=10 | a intended     | look 1,1       | all gates passed
        1    | order b point overdue=11 | b unauthorised | b unauthorised | revocation stale
        2    | order c odd overdue=20   | c unsupported  | c unsupported  | unknown kind of order
        3    | order d odd overdue=21   | d unauthorised | d unauthorised | revocation stale
        """,
        Story(overdue_camera_ms=10, overdue_flight_ms=20),
    )


def test_with_an_uncertain_time_only_a_camera_is_ordered() -> None:
    """What is not known to be harmless waits for a clock."""
    check_chart(
        "command",
        """
        at_s | observe                      | state          | say            | why
        0    | order a point time_uncertain | a intended     | look 1,1       | all gates passed
        1    | order b odd time_uncertain   | b unauthorised | b unauthorised | this node's time is uncertain
        """,
    )


def test_what_may_have_been_done_before_the_log_was_lost_is_not_done_again() -> None:
    """Its outcome is unknown, and that is the answer."""
    check_chart(
        "command",
        """
        at_s | observe                     | state     | say             | why
        0    | order a point before_memory | a timeout | a timeout       | unknown after restart
        1    | again a                     | -         | a timeout again | unknown after restart
        2    | order b point               | b intended | look 1,1       | all gates passed
        """,
    )


def test_a_list_that_was_lost_allows_nothing_until_it_is_back() -> None:
    """Older than one that was held, or another of the same version; each key of the Directory for itself."""
    check_chart(
        "command",
        """
        at_s | observe          | state          | say            | why
        0    | list 13          | -              | -              | -
        1    | order a point    | a intended     | look 1,1       | all gates passed
        2    | list 12          | -              | -              | -
        3    | order b point    | b unauthorised | b unauthorised | revocation list lost: it must be fetched
        4    | list 13          | -              | -              | -
        5    | order c point    | c intended     | look 1,1       | all gates passed
        6    | list 13 body=x   | -              | -              | -
        7    | order d point    | d unauthorised | d unauthorised | revocation list lost: it must be fetched
        8    | list 1 key=k     | -              | -              | -
        9    | order e point    | e intended     | look 1,1       | all gates passed
        10   | root 3           | -              | -              | -
        11   | root 2           | -              | -              | -
        12   | order f point    | f unauthorised | f unauthorised | revocation list lost: it must be fetched
        13   | root 3           | -              | -              | -
        14   | order g point    | g intended     | look 1,1       | all gates passed
        """,
    )


def test_role_and_reception_come_first() -> None:
    """Who may not command learns nothing of the node's lists."""
    check_chart(
        "command",
        """
        at_s | observe                                | say            | why
        0    | order a point roles=viewer overdue=9999999999 | a unauthorised | role not permitted
        1    | order b point target=else overdue=9999999999  | b unauthorised | not for this node
        """,
    )


def told() -> Story:
    """Return a flight that has learned something of everything."""
    story = Story()
    for words in ("list 13", "list 2 key=k", "root 4", "epoch 7", "epoch 6", "floor 900", "floor 800", "list 12"):
        story.tell(words)
    return story


def test_the_highest_is_remembered() -> None:
    """Whatever comes after it."""
    state = told().flight.state
    check_equal(dict(state.lists.items()), {b"-" * 16: (13, b"-" * 32), b"k" * 16: (2, b"-" * 32)})
    expected = Trusted(list_behind=True, root_behind=False, root_version=4, epoch_id=7, time_floor_ms=900)
    check_equal(state.trusted.value, expected)


def test_the_next_flight_begins_with_it() -> None:
    """Also with the word that something is lost."""
    for more in ("root 4", "root 1", "list 13"):
        story = told()
        story.tell(more)
        old = story.flight.state
        manifest, _started, *_rest = opened_well()
        new = Story(manifest, BaselineCarried(state=carry_over(old, 0))).flight.state
        check_equal(dict(new.lists.items()), dict(old.lists.items()))
        check_equal(new.trusted.value, old.trusted.value)
