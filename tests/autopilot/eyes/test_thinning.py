"""Frames with nothing in them: counted, told often enough, and nothing is decided otherwise for it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autopilot.adapters.eyes.thinning import Empties
from events.schema.common_pb2 import Moved
from events.schema.eyes_pb2 import FrameObserved
from tests.flights import Flight, detection, frame, limits

S = 1_000_000_000
PERIOD_S = 1.0
TENTH_MS = 100


def passed(*frames: tuple[float, int], period_s: float = PERIOD_S) -> list[tuple[float, int]]:
    """Return capture time and `empty_before` of the frames that are told, of those given as seconds and detections."""
    empties, told = Empties(period_s), list[tuple[float, int]]()
    for at_s, count in frames:
        seen = FrameObserved(captured_ns=round(at_s * S), detections=[detection(0, 0)] * count)
        if empties.news(seen):
            told.append((at_s, seen.empty_before))
    return told


def test_empty_frames_are_counted() -> None:
    """One a second, with how many came between; all that have something in them, and the first after."""
    assert passed(*((tenth / 10, 0) for tenth in range(25))) == [(0, 0), (1.0, 9), (2.0, 9)]
    assert passed((0, 0), (0.1, 0), (0.2, 1), (0.3, 1), (0.4, 0), (0.5, 0), (1.4, 0)) == [
        *((0, 0), (0.2, 1), (0.3, 0), (0.4, 0), (1.4, 1))
    ]
    assert passed((0, 0), (0.1, 0), period_s=0) == [(0, 0), (0.1, 0)]


def test_time_that_goes_back_is_another_source() -> None:
    """It is told at once, and so is the first frame of one that was opened again."""
    assert passed((5, 0), (5.1, 0), (0, 0), (0.1, 0)) == [(5, 0), (0, 1)]
    empties = Empties(PERIOD_S)
    told = []
    for at_ns in (0, 1, 2):
        told.append(empties.news(FrameObserved(captured_ns=at_ns)))
        if at_ns == 1:
            empties.begin()
    assert told == [True, False, True]


def flown(seen: Sequence[int], period_s: float, every_ms: int = TENTH_MS) -> Flight:
    """Return a flight in which frames with so many detections came, one each `every_ms`; empty ones are thinned."""
    flight, empties = Flight(limits=limits(scan_enabled=True, frame_rate_floor_mhz=5_000)), Empties(period_s)
    for number, count in enumerate(seen):
        found = [detection(nth * 40_000, 0) for nth in range(count)]
        observed = frame(number, *found, every_ms=every_ms)
        flight.wait(every_ms)
        if empties.news(observed):
            flight.tell(observed)
    return flight


def decided(flight: Flight) -> list[tuple[int, str, str]]:
    """Return when and how the scan moved."""
    moves = [(one.at.flight_ns, one.message) for one in flight.records if isinstance(one.message, Moved)]
    return [(at_ns, move.from_state, move.to_state) for at_ns, move in moves if move.chart == "scan"]


def found(flight: Flight) -> list[tuple[int, bytes]]:
    """Return when and what was found: classifications with something in them, and questions."""
    kinds = ("sightings_classified", "poi_opened")
    return [(one.at.flight_ns, one.body) for one in flight.records if one.kind.name in kinds and one.body]


STRETCHES = st.lists(st.tuples(st.integers(0, 3), st.integers(1, 40)), min_size=1, max_size=6)


@settings(max_examples=40, deadline=None)
@given(STRETCHES)
def test_nothing_is_found_otherwise(stretches: list[tuple[int, int]]) -> None:
    """What was seen is classified and asked about in the same moment; the rate is the same within a frame."""
    seen = [count for count, length in stretches for _ in range(length)]
    whole, thinned = flown(seen, 0), flown(seen, PERIOD_S)
    assert found(thinned) == found(whole)
    moves = list(zip(decided(whole), decided(thinned), strict=False))
    assert [one[1:] for one, _ in moves] == [two[1:] for _, two in moves]
    late_ns = [two[0] - one[0] for one, two in moves]
    assert [late for nth, late in enumerate(late_ns, 1) if not 0 <= late <= nth * PERIOD_S * S] == []


@pytest.mark.parametrize(("every_ms", "states"), [(100, []), (150, []), (250, ["blocked"])])
def test_the_frame_rate_is_that_of_all_frames(every_ms: int, states: list[str]) -> None:
    """Frames without a record count, so that a thinned camera is not taken for a slow one."""
    flight = flown([0] * 60, PERIOD_S, every_ms)
    assert [to_state for _, _, to_state in decided(flight)] == states
    captures = flight.state.scans["1/1"].captures
    assert len(captures) == 10
    assert {later - before for before, later in pairwise(captures)} == {every_ms * 1_000_000}
