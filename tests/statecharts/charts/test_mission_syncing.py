"""The chart `mission` after the landing: what was seen is pushed, and then it is done, whatever the office does."""

from __future__ import annotations

from typing import Any

import pytest

from statecharts.carry import carry_over
from tests.checks import check_chart, check_equal
from tests.statecharts.charts.test_mission import AIR, story
from tests.stories import Story


def synced(**changes: Any) -> Story:
    """Return a story that has landed, at second 9."""
    return check_chart(
        "mission",
        """
        at_s | observe  | state    | say | why
        9    | disarmed | 1 landed | -   | disarmed
        """,
        check_chart("mission", AIR, story(**changes)),
    )


def test_without_an_office_nothing_is_pushed() -> None:
    """A mission from a file is done when its flight is."""
    tale = check_chart(
        "mission",
        """
        at_s | observe | state  | say | why
        19   | time    | 1 done | -   | the flight of the mission is over
        """,
        synced(push_ms=0),
    )
    check_equal(tale.flight.state.missions[1].begun, False)


SYNCING = """
    at_s | observe | state     | say            | why
    19   | time    | 1 syncing | push m in 60 s | over: what was seen goes to the mission office
"""


@pytest.mark.parametrize(
    ("end", "why"),
    [
        ("pushed", "what was seen is with the mission office"),
        ("pushed left=2", "the mission office did not take it all: the rest stays here"),
    ],
)
def test_what_was_seen_is_pushed(end: str, why: str) -> None:
    """It waits for its own push and for its last word; what else happens there changes nothing, and no order does."""
    tale = check_chart(
        "mission",
        f"""
        {SYNCING.strip()}
        20   | pushed 3             | -      | - | -
        20.5 | order b begin        | -      | - | -
        21   | pushed left=2 again= | -      | - | -
        22   | armed                | -      | - | -
        23   | mode mission         | -      | - | -
        25   | order p pause        | -      | - | -
        26   | order x abort        | -      | - | -
        27   | order r resume       | -      | - | -
        28   | disarmed             | -      | - | -
        29   | planned rev=b        | -      | - | -
        30   | vehicle down         | -      | - | -
        31   | {end}                | 1 done | - | {why}
        32   | {end}                | -      | - | -
        """,
        synced(),
    )
    check_equal([tale.flight.state.orders[f"alpha/{name}"].state for name in "bpxr"], ["rejected"] * 4)


def test_a_push_without_a_word_ends() -> None:
    """Its life, and 5 s for the adapter to say so."""
    check_chart(
        "mission",
        f"""
        {SYNCING.strip()}
        84   | time          | 1 done     | -     | no word of the mission office: what was seen stays here
        85   | order b begin | 1 checking | fetch | a person lets it begin again
        """,
        synced(),
    )


def test_a_start_while_it_is_pushed_pushes_again() -> None:
    """Also where the vehicle is not heard any more; the push before it counts no longer, and its time begins anew."""
    tale = synced()
    first = tale.flight.state.next_seq.value + 2
    check_chart(
        "mission",
        f"""
        {SYNCING.strip()}
        20   | vehicle down   | -         | -              | -
        21   | start          | 1 syncing | push m in 60 s | started again: pushed again
        22   | pushed {first} | -         | -              | -
        86   | time           | 1 done    | -              | no word of the mission office: what was seen stays here
        """,
        tale,
    )


def test_a_flight_that_ends_meanwhile_has_been_flown() -> None:
    """The next one does not begin the same mission by itself: that it was flown is handed over from the push on."""
    tale = check_chart("mission", SYNCING, synced())
    check_equal(carry_over(tale.flight.state, tale.flight.now_ns).flown_revision, "a")
    check_equal(tale.flight.state.missions[1].begun, False)
