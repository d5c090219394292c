"""Flights that diverge, and the doors that tests of blame go through. Nothing here tests anything."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from events import Record
from replay.blame import blame
from replay.blame.again import Again, said
from replay.blame.findings import Blame, Cause, Weight
from replay.verify import verify
from statecharts import State, engine, step
from tests.flights import (
    Flight,
    answered,
    detection,
    frame,
    gimbal,
    judge,
    limits,
    point_at_place,
    release,
    resealed,
)
from tests.replay.changes import renumbered


class Alike(Again):
    """Other processes that decide as this one does, without the time that it takes to start them."""

    def __init__(self, *odd: int) -> None:
        """`odd`: hash seeds under which something else comes out."""
        super().__init__()
        self.odd = odd

    def decide(self, seed: int, steps: Sequence[Sequence[Record]]) -> tuple[tuple[int, bytes], ...]:
        """Decide here."""
        if seed in self.odd:
            return ()
        state = State()
        for records in steps[:-1]:
            engine.restore(state, records)
        return said(step(state, steps[-1][0]).records[1:])


def look(records: Sequence[Record], **given: Any) -> Blame:
    """Return what replay finds of a log that diverges."""
    reader = resealed(records)
    first = verify(reader).first
    assert first is not None
    return blame(reader, first, **({"again": Alike()} | given))


def check_blamed(records: Sequence[Record], cause: Cause, weight: Weight, words: str, **given: Any) -> Blame:
    """Check which finding is believed, how much it weighs, and a part of what it says."""
    found = look(records, **given)
    first = found.findings[0]
    assert (first.cause, first.weight) == (cause, weight), found.plain()
    assert words in first.words
    assert sorted(one.cause.value for one in found.findings) == sorted(one.value for one in Cause)
    return found


def pointed(**bounds: Any) -> Flight:
    """Return a flight with an order, two reports of the gimbal, and the end of the hold."""
    flight = Flight(limits=limits(**bounds))
    flight.tell(point_at_place("a", 20_000, 30_000), 100)
    effect = flight.effect()
    flight.tell(answered(effect), 20)
    flight.tell(gimbal(-100, 100, effect, 80), 300)
    flight.tell(gimbal(-100, 100, effect, 30), 300)
    flight.wait(100_000)
    return flight


def ordered(**bounds: Any) -> Flight:
    """Return a flight with two orders."""
    flight = Flight(limits=limits(**bounds))
    flight.tell(point_at_place("a"), 100)
    flight.tell(release("b", order_seq=2), 100)
    return flight


def sighted(**bounds: Any) -> Flight:
    """Return a flight in which something is seen five times, asked about, and declined."""
    flight = Flight(limits=limits(**bounds))
    for number in range(1, 6):
        flight.tell(frame(number, detection(1_000 * number, 0)), 80)
    for poi_id in flight.surfaced():
        flight.tell(judge("j", poi_id, confirmed=False), 500)
    for number in range(6, 9):
        flight.tell(frame(number, detection(1_000 * number, 500)), 80)
    return flight


def put(records: Sequence[Record], seq: int, **changes: Any) -> list[Record]:
    """Return the records with other columns in one of them."""
    return [replace(one, **changes) if one.seq == seq else one for one in records]


def without(records: Sequence[Record], seq: int) -> list[Record]:
    """Return the records without the step that begins at `seq`."""
    gone = [one.seq for one in records if one.seq == seq or one.cause == seq]
    return renumbered([one for one in records if one.seq not in gone], seq, -len(gone))
