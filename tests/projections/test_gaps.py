"""The bundle of a redacted copy: whole steps are folded, the others are named, and nothing is made up."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings

from projections.bundle import build, build_redacted
from projections.words import ranges
from tests.flights import story
from tests.random_flights import Draw, draws, fly
from tests.replay.changes import at
from tests.replay.copies import Copy, removals

STORY = story()
WHOLE = build(STORY.records)


def bundle(*remove: int) -> dict[str, Any]:
    """Return the bundle of the story without these records."""
    return build_redacted(Copy(STORY.store, set(remove)).stored())


def check_gaps(found: dict[str, Any], removed: str, left_out: str) -> None:
    """Check what a bundle says that it does without."""
    assert found["gaps"] == {"removed": removed, "left_out": left_out}


def test_a_copy_without_gaps_gives_the_same_bundle() -> None:
    """But for the empty gaps."""
    assert bundle() == WHOLE | {"gaps": {"removed": "", "left_out": ""}}


def test_half_a_step_is_left_out() -> None:
    """An answer whose move was removed would be read as an order under a reused id."""
    found = bundle(7)
    check_gaps(found, "7", "6,8-13")
    assert [row["what"] for row in found["audit"]].count("reused id") == 0
    assert {6, 9, 10, 11}.isdisjoint(row["seq"] for row in found["audit"])


def test_what_has_nothing_to_rest_on_is_left_out() -> None:
    """A judgement on a question that nobody opened; a classification of a frame that is gone is no other frame's."""
    found = bundle(49)
    check_gaps(found, "49", "50-52,55-56,67,71")
    assert [one["seq"] for one in found["pois"]] == []
    found = bundle(45)
    check_gaps(found, "45", "46")
    assert {one["raw_evidence"]["seq"] for one in found["observations"]} == {48, 74}


def test_a_flight_that_lacks_something_is_no_bundle() -> None:
    """Of a log that is no copy a record that can't be placed is an error; and without a manifest there is none."""
    with pytest.raises(LookupError):
        build([record for record in STORY.records if record.seq != at(STORY, "item_ignored")])
    with pytest.raises(LookupError, match="no manifest"):
        bundle(0)


@settings(max_examples=60, deadline=None)
@given(draws, removals)
def test_any_copy_has_a_bundle(drawn: list[Draw], remove: frozenset[int]) -> None:
    """Every removed record is named, and none of those that are there is lost without a word."""
    flight = fly(drawn)
    found = build_redacted(Copy(flight.store, remove).stored())
    assert found["gaps"]["removed"] == ranges(one.seq for one in flight.records if one.seq in remove)
