"""Chart `map`: what a sighting is to the map, NEW or EXISTING (seed 004, section 3).

Theory of operation. Every placed detection of a class in a class group is classified once, against objects of the
same group whose last place is within `same_object_mm`. The nearest object that no other detection of the same frame
has matched wins, the lower number on a tie, so two people side by side stay two. The answer for the whole frame is one
decision, `sightings_classified`; it is the move of every object that it names, so none is recorded a second time.
It must never measure with floats (places come as integer millimetres from the edge), never merge class groups, and
never ask a person anything: that is `poi`.

Candidates come from an integer grid of `same_object_mm` cells: nine cells hold every object that can match.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from google.protobuf.message import Message

from events.records import Record
from events.schema.eyes_pb2 import FrameObserved
from events.schema.findings_pb2 import EXISTING, NEW, Sighting, SightingsClassified
from statecharts.facts import MapObject, Spot
from statecharts.part import Part
from statecharts.state import State
from statecharts.table import Chart, ignore, move


@dataclass(frozen=True, slots=True)
class _Facts:
    pass


_NO_FACTS = _Facts()

CHART: Chart[_Facts] = Chart(
    name="map",
    initial="unseen",
    states=("unseen", "mapped"),
    terminal=(),
    triggers=("sighted",),
    rows=(
        move("unseen", "sighted", "mapped", "NEW: nothing of its class group was near"),
        ignore("mapped", "sighted", "EXISTING: matches an object of its class group"),
    ),
)


def decide(state: State, record: Record) -> tuple[Message, ...]:
    """Return the classification of a frame; nothing for a frame without a placed detection."""
    frame = record.message
    assert isinstance(frame, FrameObserved)
    taken: dict[int, None] = {}
    sightings = []
    next_number = len(state.objects) + 1
    for index, detection in enumerate(frame.detections):
        group = state.flight.group_of.get(detection.class_name)
        if group is None or not detection.HasField("place"):
            continue
        found = _nearest(state, group, Spot.of(detection.place), taken)
        row = CHART.ask("unseen" if found is None else "mapped", "sighted", _NO_FACTS)
        if found is None:
            number, distance_mm, diff = next_number, 0, NEW
            next_number += 1
        else:
            (distance_mm, number), diff = found, EXISTING
        assert (row.target != row.source) == (diff == NEW)
        taken[number] = None
        sightings.append(
            Sighting(detection=index, diff=diff, object=number, class_group=group, distance_mm=distance_mm)
        )
    return (SightingsClassified(sightings=sightings),) if sightings else ()


def _nearest(state: State, group: str, spot: Spot, taken: dict[int, None]) -> tuple[int, int] | None:
    """Return distance in millimetres and number of the nearest free object, or None."""
    limit_mm = state.flight.limits.same_object_mm
    objects, limit, best = state.objects, limit_mm * limit_mm, None
    for number in _candidates(state, group, spot, limit_mm):
        there = objects[number].spot
        east, north = there.east_mm - spot.east_mm, there.north_mm - spot.north_mm
        square = east * east + north * north
        if square <= limit and number not in taken and (best is None or (square, number) < best):
            best = (square, number)
    return None if best is None else (_root(best[0]), best[1])


def _root(square: int) -> int:
    """Return the integer square root, by Newton's method on integers."""
    if square < 2:
        return square
    guess = 1 << (square.bit_length() + 1) // 2
    while (better := (guess + square // guess) // 2) < guess:
        guess = better
    return guess


def _cell(spot: Spot, size_mm: int) -> tuple[int, int]:
    return spot.east_mm // size_mm, spot.north_mm // size_mm


def _candidates(state: State, group: str, spot: Spot, size_mm: int) -> list[int]:
    east, north = _cell(spot, size_mm)
    found: list[int] = []
    get = state.grid.get
    for cell_east in (east - 1, east, east + 1):
        for cell_north in (north - 1, north, north + 1):
            found.extend(get((group, cell_east, cell_north)) or ())
    return found


def place_object(state: State, thing: MapObject) -> None:
    """Put an object on the map, or to its new place; for `evolve` only.

    The grid follows from the objects alone, whatever way they came: each cell that has any names them in order.
    """
    size_mm = state.flight.limits.same_object_mm
    before = state.objects.get(thing.number)
    here = (thing.class_group, *_cell(thing.spot, size_mm))
    state.objects.put(thing.number, thing)
    if before is not None:
        there = (before.class_group, *_cell(before.spot, size_mm))
        if there == here:
            return
        left = tuple(number for number in state.grid[there] if number != thing.number)
        if left:
            state.grid.put(there, left)
        else:
            state.grid.drop(there)
    state.grid.put(here, tuple(sorted((*(state.grid.get(here) or ()), thing.number))))


def grid_of(objects: Iterable[MapObject], size_mm: int) -> dict[tuple[str, int, int], tuple[int, ...]]:
    """Return the grid that `place_object` leads to for these objects, which come in the order of their numbers."""
    cells: dict[tuple[str, int, int], list[int]] = {}
    for thing in objects:
        spot = thing.spot
        cells.setdefault((thing.class_group, spot.east_mm // size_mm, spot.north_mm // size_mm), []).append(
            thing.number
        )
    return {cell: tuple(numbers) for cell, numbers in cells.items()}


class FrameMissing(LookupError):
    """A classification came without the frame that it classifies: the log is not in order."""


def _apply(state: State, record: Record) -> None:
    classified = record.message
    assert isinstance(classified, SightingsClassified)
    frame = state.frame.value
    if frame is None or frame.seq != record.cause:
        raise FrameMissing(f"record {record.seq} classifies frame {record.cause}, which was not applied")
    observed = frame.message
    assert isinstance(observed, FrameObserved)
    for sighting in classified.sightings:
        detection = observed.detections[sighting.detection]
        spot = Spot.of(detection.place)
        before = state.objects.get(sighting.object)
        if before is None:
            confidence = detection.confidence_e4
            thing = MapObject(sighting.object, detection.class_name, sighting.class_group, spot, confidence, 1)
        else:
            thing = before._replace(spot=spot, confidence_e4=detection.confidence_e4, sightings=before.sightings + 1)
        place_object(state, thing)


def _remember_frame(state: State, record: Record) -> None:
    state.frame.set(record)


PART = Part(
    chart=CHART,
    alphabet=frozenset({"frame_observed"}),
    decide=decide,
    evolve={"frame_observed": _remember_frame, "sightings_classified": _apply},
)
