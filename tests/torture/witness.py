"""Nodes that lie about their logs, before a witness that hears some of what they say; and what proofs cost.

`run` makes seeded nodes that grow, restart, roll back, fork, answer garbage or nothing, and checks what the witness may
never do: call an honest node a liar, count as proven what does not go on from what was proven, or miss a contradiction
between two checkpoints that it was given the proofs of.
"""

from __future__ import annotations

import random
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

from autopilot.ground.witness import Outcome, Witness
from autopilot.node.proving import Prover
from events.records import NO_CAUSE, Moment, make_record
from events.schema.flight_pb2 import TimePassed
from events.store import create_flight
from tests.autopilot.ground.logs import NODE, Log
from tests.autopilot.trust.world import people

HISTORIES, RECORDS, PROOFS = 2_000, 1_000_000, 200
STEPS = 25
BATCH = 2000


def run(count: int | None, seed: int, report: Callable[[str], None]) -> dict[str, Any]:
    """Torture a witness with so many histories; return what was counted. Raises AssertionError: a promise is broken.

    Only the full run (None) times proofs over a long log.
    """
    histories = HISTORIES if count is None else count
    counts = Counter[str]()
    for number in range(histories):
        with TemporaryDirectory(prefix="witness-") as folder, patch("autopilot.ground.kept.write_file", _written):
            counts.update(_history(Path(folder), random.Random(seed * 1_000_003 + number)))
        if number % 100 == 0:
            report(f"{number} of {histories} histories")
    timed = _timed(RECORDS, PROOFS) if count is None else {}
    return {"histories": histories, "seed": seed, **dict(sorted(counts.items())), **timed}


def _written(path: Path, data: bytes) -> None:
    """Write without waiting for the disk: power is not cut here."""
    path.write_bytes(data)


def _history(folder: Path, chance: random.Random) -> Counter[str]:
    """Let one node publish, restart, lie and answer; a witness hears all of it and asks after each."""
    honest = chance.random() < 0.5
    log, size, at_ms = Log(), chance.randrange(1, 40), 100_000
    counts, key, newest = Counter[str](), people().wasp.public_key, 0
    for step in range(STEPS):
        at_ms += 10_000
        size += chance.randrange(0, 30)
        if not honest and chance.random() < 0.15:
            log, size = _lied(log, size, step, chance)
            counts["lies"] += 1
        witness = Witness(folder, "coast-watch")
        wrong = witness.see(NODE, key, log.status(size, at_ms))
        assert not (honest and wrong), wrong
        assert bool(wrong) >= (size < newest), "a roll-back behind what was heard was missed"
        counts["roll-backs and forks found as they were heard"] += bool(wrong)
        newest = max(newest, size) if not wrong else newest
        counts.update(_asked(witness, log, chance, honest=honest))
        chain = witness.newest(NODE, key)
        assert chain is not None
        newest = chain.newest.checkpoint.size
    counts["honest nodes" if honest else "lying nodes"] += 1
    return counts


def _lied(log: Log, size: int, step: int, chance: random.Random) -> tuple[Log, int]:
    """Return another history, and where it stands: forked somewhere, and shorter, as long, or longer."""
    forked_at = chance.randrange(0, size)
    return Log(salt=f"{step}/{chance.random()}", forked_at=forked_at), max(size + chance.randrange(-20, 20), 1)


def _asked(witness: Witness, log: Log, chance: random.Random, *, honest: bool) -> Counter[str]:
    """Have everything proved that waits, by a node that may answer in vain first."""
    counts, key = Counter[str](), people().wasp.public_key
    while (asked := witness.question(NODE, key)) is not None:
        old, new = asked.proven.checkpoint, asked.fresh.checkpoint
        if chance.random() < 0.3:
            assert witness.answered(NODE, key, asked, _garbage(log, asked.request(), chance)) is Outcome.NOTHING
            counts["answers that proved nothing"] += 1
            if chance.random() < 0.3:
                break
            continue
        goes_on = log.grown(new.size).root(old.size) == old.root
        signed_here = log.grown(new.size).root(new.size) == new.root
        outcome = witness.answered(NODE, key, asked, log.answer(asked.request()))
        counts[f"answers: {outcome.value}"] += 1
        assert not honest or outcome is Outcome.PROVEN
        assert outcome is _expected(goes_on=goes_on, signed_here=signed_here)
        if outcome is Outcome.NOTHING:
            break
    return counts


def _expected(*, goes_on: bool, signed_here: bool) -> Outcome:
    if not signed_here:
        return Outcome.NOTHING  # the node has left the history that it signed: it can't prove anything of it
    return Outcome.PROVEN if goes_on else Outcome.CONTRADICTS


def _garbage(log: Log, request: bytes, chance: random.Random) -> bytes:
    """Return the true answer with a bit flipped, cut, lengthened, or none at all."""
    true = bytearray(log.answer(request))
    match chance.randrange(4):
        case 0:
            place = chance.randrange(len(true))
            true[place] ^= 1 << chance.randrange(8)
        case 1:
            del true[chance.randrange(len(true)) :]
        case 2:
            true += chance.randbytes(chance.randrange(1, 60))
        case _:
            return chance.randbytes(chance.randrange(0, 500))
    return bytes(true)


def _timed(records: int, proofs: int) -> dict[str, Any]:
    """Write a log of so many records; return what the first proof and the next ones take, in milliseconds."""
    with TemporaryDirectory(prefix="witness-") as folder:
        _, store = create_flight(Path(folder), 1, bytes(16), bytes(32))
        for start in range(0, records, BATCH):
            at = Moment(start, start, 1, start, 2)
            batch = range(start, min(start + BATCH, records))
            store.append([make_record(seq, NO_CAUSE, at, TimePassed()) for seq in batch])
        prover, chance = Prover(Path(folder)), random.Random(1)
        first_ms = _proof_ms(prover, records // 2, records)
        times = sorted(_proof_ms(prover, chance.randrange(1, records), records) for _ in range(proofs))
        store.close()
    return {
        "records": records,
        "first_proof_ms": round(first_ms, 1),
        "proof_p50_ms": round(times[len(times) // 2], 2),
        "proof_p99_ms": round(times[len(times) * 99 // 100], 2),
    }


def _proof_ms(prover: Prover, old: int, new: int) -> float:
    before_ns = time.perf_counter_ns()
    assert prover.proof(1, old, new) is not None
    return (time.perf_counter_ns() - before_ns) / 1e6
