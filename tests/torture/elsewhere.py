"""Flights whose charts decide by something else than the log: recorded in one process, replayed in another.

    python -m tests.torture.elsewhere record SEED COUNT      flights, recorded under patches, to stdout
    python -m tests.torture.elsewhere judge                  flights from stdin; what replay finds, to stdout
    python -m tests.torture.elsewhere again PATCH            what `replay.blame.again` does, under a patch

Each process has a hash seed of its own. What they hand over is pickled: they are one program on one machine.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Iterator
from itertools import islice
from random import Random
from typing import NamedTuple

import pytest

from events import Moment, Record, kind_numbered, make_record
from replay.blame import blame
from replay.blame.again import Again, answer
from replay.blame.findings import Cause
from replay.verify import verify
from tests.flights import resealed
from tests.house import REPO
from tests.torture.mutations import SOFTWARE, first_seq
from tests.torture.patches import ANOTHER_INTERPRETER, ENVIRONMENT, RECORDING, Patch
from tests.torture.recorder import bounds, fly, manifest_of

MODULE = "tests.torture.elsewhere"
RECORDS_WITH, JUDGES_WITH = 5, 6  # hash seeds
ATTEMPTS, TURNS = 6, 2  # flights that are tried of a patch; turns for each flight that is wanted
Row = tuple[int, int, tuple[int, ...], int, bytes]


class Judged(NamedTuple):
    """What replay found of one flight."""

    name: str
    true_seq: int
    found_seq: int | None
    blamed: Cause | None


def judged(seed: int, count: int) -> list[Judged]:
    """Record flights in one process and judge them in another; those that come out alike are passed over."""
    flights = _run("record", RECORDS_WITH, b"", str(seed), str(count))
    found: list[Judged] = pickle.loads(_run("judge", JUDGES_WITH, flights, str(count)))
    return found


def _run(what: str, hash_seed: int, given: bytes, *words: str) -> bytes:
    environ = os.environ | {"PYTHONHASHSEED": str(hash_seed), "PYTHONPATH": str(REPO)}
    command = [sys.executable, "-m", MODULE, what, *words]
    return subprocess.run(command, cwd=REPO, env=environ, input=given, stdout=subprocess.PIPE, check=True).stdout


def record(seed: int, count: int) -> list[tuple[str, list[Row]]]:
    """Return flights under each patch in turn, more than are wanted: not every one comes out otherwise."""
    return [_recorded(seed, turn) for turn in range(TURNS * count * ATTEMPTS)]


def _recorded(seed: int, turn: int) -> tuple[str, list[Row]]:
    patches = ENVIRONMENT | RECORDING
    name = sorted(patches)[turn // ATTEMPTS % len(patches)]
    with pytest.MonkeyPatch.context() as monkeypatch:
        patches[name](monkeypatch)
        fly(Random(f"{seed}/before"), bounds())  # what leaks from step to step leaks from flight to flight
        records = fly(Random(f"{seed}/environment/{turn}"), bounds()).records
    if name == ANOTHER_INTERPRETER:
        opened = manifest_of(records)
        opened.python = "3.9.1"
        records[0] = make_record(0, records[0].cause, records[0].at, opened)
    return name, [(one.seq, one.cause, tuple(one.at), one.kind.number, one.body) for one in records]


def judge(flights: list[tuple[str, list[Row]]]) -> Iterator[Judged]:
    """Yield what replay finds of the first flight of each turn that comes out otherwise in this process."""
    for turn in range(0, len(flights), ATTEMPTS):
        for name, rows in flights[turn : turn + ATTEMPTS]:
            records = [_record(row) for row in rows]
            with pytest.MonkeyPatch.context() as monkeypatch:
                _here(name)(monkeypatch)
                true_seq = first_seq(records)
            if true_seq is not None:
                yield _judge(name, records, true_seq)
                break


def _here(name: str) -> Patch:
    """Return the patch that holds while a flight is replayed."""
    return ENVIRONMENT.get(name, lambda _monkeypatch: None)


def _judge(name: str, records: list[Record], true_seq: int) -> Judged:
    again = Again(child=("-m", MODULE, "again", name))
    try:
        with pytest.MonkeyPatch.context() as monkeypatch:
            _here(name)(monkeypatch)
            reader = resealed(records)
            first = verify(reader).first
            if first is None:
                return Judged(name, true_seq, None, None)
            found = blame(reader, first, again=again, software=SOFTWARE)
            return Judged(name, true_seq, first.seq, found.cause)
    finally:
        again.close()


def _record(row: Row) -> Record:
    seq, cause, at, number, body = row
    kind = kind_numbered(number)
    return Record(seq, cause, Moment(*at), kind, kind.version, body, kind.message.FromString(body))


def main(what: str, *words: str) -> None:
    """Do one of the three."""
    if what == "record":
        pickle.dump(record(*map(int, words)), sys.stdout.buffer)
    elif what == "judge":
        pickle.dump(list(islice(judge(pickle.load(sys.stdin.buffer)), int(words[0]))), sys.stdout.buffer)
    else:
        with pytest.MonkeyPatch.context() as monkeypatch:
            _here(words[0])(monkeypatch)
            answer(sys.stdin.buffer, sys.stdout.buffer)


if __name__ == "__main__":
    from tests.torture import elsewhere  # so that what is pickled names this module, not __main__

    elsewhere.main(*sys.argv[1:])
