"""Flights by seed, recorded by a node of which one thing is not as the log says. Nothing here checks anything."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from random import Random
from typing import Any

from google.protobuf.message import Message

from events import NO_CAUSE, Record, kind_of, make_record
from events.schema.flight_pb2 import FlightOpened, Limits
from statecharts import evolve, step
from tests import flights, random_flights
from tests.flights import NS_PER_MS, Flight

LIKELY = ("frame", "frame", "frame", "order", "order", "judge", "answered", "gimbal", "wait", "link", "published")
WHATS = (*LIKELY, *random_flights._MAKE)


class Recorder(Flight):
    """A flight that leaves one observation out of its log, where `lost` names its place among what is told."""

    def __init__(self, limits: Limits, lost: int = -1, decisions_stay: bool = False) -> None:
        """`decisions_stay`: what followed from the lost observation is logged all the same."""
        self._lost, self._told, self._decisions_stay = lost, 0, decisions_stay
        self.lost = "nothing"
        super().__init__(*flights.opened_well(limits))

    def tell(self, message: Message, after_ms: int = 0) -> tuple[Record, ...]:
        """As every flight does; the lost observation is acted on and not logged."""
        self._told += 1
        if self._told - 1 != self._lost:
            return super().tell(message, after_ms)
        self.now_ns += after_ms * NS_PER_MS
        self.lost = kind_of(message).name
        seq = self.store.head.seq + 1
        observation = make_record(seq, NO_CAUSE, self.moment(), message)
        made = step(self.state, observation)
        self.due = made.due
        if not self._decisions_stay:
            self.state.next_seq.set(seq)
            return ()
        return self._log_without(observation, made.records[1:])

    def _log_without(self, observation: Record, decisions: Sequence[Record]) -> tuple[Record, ...]:
        self.state.journal.rollback()
        evolve(self.state, observation)
        moved = tuple(
            make_record(decision.seq - 1, observation.seq, decision.at, decision.message) for decision in decisions
        )
        self.state.next_seq.set(observation.seq)
        for record in moved:
            evolve(self.state, record)
        self.store.append(moved)
        self.records.extend(moved)
        return moved


def drawn(chance: Random) -> list[random_flights.Draw]:
    """Return what happens in a flight."""
    count = chance.randint(30, 70)
    number = partial(chance.randint, 0, 5)
    return [(chance.choice(WHATS), number(), number(), number()) for _ in range(count)]


def bounds(**changes: Any) -> Limits:
    """Return limits under which much happens in a short flight."""
    values: dict[str, Any] = {
        "scan_enabled": True,
        "sightings_to_ask": 2,
        "frame_rate_floor_mhz": 1_000,
        "asks_per_minute": 2,
    }
    return flights.limits(**(values | changes))


def fly(chance: Random, limits: Limits, **lost: Any) -> Recorder:
    """Return a flight: one of four tells the whole story, the others are drawn."""
    flight = Recorder(limits, **lost)
    if chance.random() < 0.25:
        _tell_a_story(flight)
        return flight
    for what, one, two, three in drawn(chance):
        flight.wait(random_flights.PAUSES_MS[two % 4] if what == "wait" else 30)
        if what != "wait":
            flight.tell(random_flights._MAKE[what](flight, one, two, three))
    flight.tell(flights.closed(), 500)
    return flight


def _tell_a_story(flight: Flight) -> None:
    flight.tell(flights.position(0, 0), 500)
    with suppress(StopIteration, ValueError):  # what the story waits for does not happen under every limit
        flights._point(flight)
        flights._find(flight)
        flights._judge(flight)
    flights._misuse(flight)
    flight.wait(130_000)
    flight.tell(flights.closed(), 1000)


def manifest_of(records: Sequence[Record]) -> FlightOpened:
    """Return a manifest like that of a log, to be changed."""
    opened = FlightOpened()
    recorded = records[0].message
    assert isinstance(recorded, FlightOpened)
    opened.CopyFrom(recorded)
    return opened


def under(records: Sequence[Record], limits: Limits) -> list[Record]:
    """Return a log whose manifest claims other limits."""
    opened = manifest_of(records)
    opened.configuration.limits.CopyFrom(limits)
    return [make_record(0, NO_CAUSE, records[0].at, opened), *records[1:]]
