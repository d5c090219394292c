"""Flights that diverge for one known reason: what is replayed differs in one thing from what was recorded.

Each is made from a seed. What is true of it is known by construction: its cause, and, by running the log through the
charts side by side with what it says (not by the verifier), the first record that comes out otherwise. Only what does
come out otherwise counts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from random import Random
from typing import Any

import pytest

from events import Record, make_record
from events.kinds import Role
from replay.blame.case import Lifting
from replay.blame.findings import Cause
from statecharts import State, restore, step, steps_of
from tests.torture import liftings
from tests.torture.patches import BODIES, ROWS
from tests.torture.recorder import bounds, fly, manifest_of, under

SOFTWARE = "0.1.0"
OLDER = "0.0.9"
ATTEMPTS = 12  # flights that are tried before another mutation is


@dataclass(frozen=True)
class Mutation:
    """A log that diverges, and why."""

    cause: Cause
    name: str
    records: Sequence[Record]
    seq: int  # the first record that comes out otherwise
    lifting: Lifting = field(default_factory=Lifting)
    patch: str = ""  # of the environment, which must hold while it is replayed


def first_seq(records: Sequence[Record]) -> int | None:
    """Return the first record that the charts decide otherwise, None where there is none."""
    state = State()
    for observation, *recorded in steps_of(records):
        made = step(state, observation).records[1:]
        one = [(record.seq, record.cause, record.at, record.kind.number, record.body) for record in made]
        other = [(record.seq, record.cause, record.at, record.kind.number, record.body) for record in recorded]
        if one != other:
            alike = [mine == theirs for mine, theirs in zip(one, other, strict=False)]
            return observation.seq + 1 + (alike.index(False) if False in alike else len(alike))
        state.journal.rollback()
        restore(state, (observation, *recorded))
    return None


def code(chance: Random, number: int) -> tuple[str, list[Record], Lifting]:
    """Record with another row, or another body of a function; every third of those by software of another version."""
    patches, turn = (ROWS, number // 3) if number % 3 == 0 else (BODIES, number - number // 3 - 1)
    name = sorted(patches)[turn % len(patches)]
    with pytest.MonkeyPatch.context() as monkeypatch:
        patches[name](monkeypatch)
        records = fly(chance, bounds()).records
    if number % 3 == 1:
        opened = manifest_of(records)
        opened.software = OLDER
        records = [make_record(0, -1, records[0].at, opened), *records[1:]]
        name += ", told by its version"
    return name, records, _noise(chance, records)


CHANGES: dict[str, tuple[Any, ...]] = {
    "command_enabled": (False,),
    "camera_roles": (["viewer"], ["camera", "viewer"], []),
    "operator_hold_ms": (5_000, 20_000, 45_000, 90_000),
    "release_pause_ms": (500, 1_000, 10_000),
    "arrival_tolerance_cdeg": (10, 50, 70, 200),
    "arrival_patience_ms": (2_000, 5_000, 30_000),
    "same_object_mm": (2_000, 5_000, 12_000, 20_000),
    "same_poi_mm": (5_000, 8_000, 30_000),
    "ask_confidence_e4": (3_000, 5_000, 6_500, 8_500),
    "asks_per_minute": (1, 3, 5),
    "decide_shortest_ms": (10_000, 20_000, 60_000),
    "decide_longest_ms": (60_000, 90_000, 300_000),
    "queue_longest_ms": (30_000, 60_000),
    "ask_again_ms": (10_000, 60_000),
    "look_ms": (1_000, 2_500, 8_000),
    "frame_rate_floor_mhz": (500, 5_000, 15_000, 40_000),
    "sweep_pitch_cdeg": (-4_500, -2_000, 0),
    "scan_enabled": (False,),
    "sightings_to_ask": (1, 3, 5),
    "own_command_life_ms": (2_000, 4_000, 8_000),
}


def configuration(chance: Random, _number: int) -> tuple[str, list[Record], Lifting]:
    """Record under one limit that is not the manifest's."""
    name = chance.choice(sorted(CHANGES))
    value = chance.choice(CHANGES[name])
    records = under(fly(chance, bounds(**{name: value})).records, bounds())
    return f"{name} {value}", records, _noise(chance, records)


def upcast(chance: Random, _number: int) -> tuple[str, list[Record], Lifting]:
    """Lift one kind wrongly."""
    records = fly(chance, bounds()).records
    return liftings.wrong(chance, records)


def missing(chance: Random, number: int) -> tuple[str, list[Record], Lifting]:
    """Leave an observation out of the log that the node acted on; every fifth with its decisions left in."""
    lost, stays = chance.randint(5, 60), number % 5 == 4
    flight = fly(chance, bounds(), lost=lost, decisions_stay=stays)
    return (
        f"{flight.lost} {lost}{', its decisions stay' if stays else ''}",
        flight.records,
        _noise(chance, flight.records),
    )


def reordered(chance: Random, number: int) -> tuple[str, list[Record], Lifting]:
    """Exchange two neighbouring observations, with their moments or without; or change the moment of one."""
    records = fly(chance, bounds()).records
    places = [place for place, record in enumerate(records) if record.kind.role is Role.OBSERVATION and place > 5]
    if number % 3 == 2:
        return _skewed(chance, records, places)
    index = chance.randrange(len(places) - 1)
    one, other = records[places[index]], records[places[index + 1]]
    name, times = f"{one.seq} and {other.seq}", number % 3 == 1
    changed = list(records)
    changed[one.seq] = replace(other, seq=one.seq, at=other.at if times else one.at)
    changed[other.seq] = replace(one, seq=other.seq, at=one.at if times else other.at)
    return f"{name} exchanged{' with their moments' if times else ''}", changed, _noise(chance, changed)


def _skewed(chance: Random, records: Sequence[Record], places: Sequence[int]) -> tuple[str, list[Record], Lifting]:
    """Change the moment of one observation, and of its decisions: all clocks alike, or flight time alone."""
    place = chance.choice(places)
    by_ns = chance.choice((-1, 1)) * chance.randrange(10 ** chance.choice((8, 9, 10, 11)))
    alone = chance.random() < 0.5
    at = records[place].at
    by_ns = max(by_ns, -at.flight_ns)  # no clock goes below zero
    moved = at._replace(
        flight_ns=at.flight_ns + by_ns,
        mono_ns=at.mono_ns + by_ns * (not alone),
        wall_ns=at.wall_ns + by_ns * (not alone),
    )
    same_step = [one for one in range(len(records)) if one == place or records[one].cause == place]
    changed = [replace(record, at=moved) if one in same_step else record for one, record in enumerate(records)]
    told = f"{place} moved by {by_ns // 1_000_000} ms{', flight time alone' if alone else ''}"
    return told, changed, _noise(chance, changed)


def _noise(chance: Random, records: Sequence[Record]) -> Lifting:
    """Return a lifting that is right, of a kind that has nothing to do with it, for one flight of three."""
    return liftings.right(chance, records) if chance.random() < 0.34 else Lifting()


Maker = Callable[[Random, int], tuple[str, list[Record], Lifting]]
MAKERS: dict[Cause, Maker] = {
    Cause.CODE: code,
    Cause.CONFIGURATION: configuration,
    Cause.UPCAST: upcast,
    Cause.MISSING: missing,
    Cause.REORDERED: reordered,
}


def made(cause: Cause, seed: int, count: int) -> Iterator[Mutation]:
    """Yield so many mutations of a cause. Those that change no decision are passed over; some never do."""
    turn = found = 0
    while found < count:
        mutation = next((one for one in _attempts(cause, seed, turn) if one is not None), None)
        turn += 1
        if mutation is not None:
            found += 1
            yield mutation


def _attempts(cause: Cause, seed: int, turn: int) -> Iterator[Mutation | None]:
    for attempt in range(ATTEMPTS):
        name, records, lifting = MAKERS[cause](Random(f"{seed}/{cause.value}/{turn}/{attempt}"), turn)
        seq = first_seq(records)
        yield None if seq is None else Mutation(cause, name, records, seq, lifting)
