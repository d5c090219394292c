"""A step decided again in another process, with another hash seed: what differs then depends on the process.

`python -m replay.blame.again` is the child. It reads jobs from stdin until there are no more: the steps up to and with
the one in question, as the charts see them; it answers each with the decisions that it comes to. Parent and child are
the same program on the same machine, so the jobs are pickled tuples.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Iterable, Sequence
from typing import BinaryIO

from events import Moment, Record, encode, kind_numbered
from statecharts import State, restore, step

SEEDS = (1, 2, 3, 4)
CHILD = ("-m", "replay.blame.again")

Decisions = tuple[tuple[int, bytes], ...]  # kind number and body of each
_Row = tuple[int, int, tuple[int, ...], int, int, bytes]


class ChildFailed(RuntimeError):
    """The other process gave no answer."""


def said(records: Iterable[Record]) -> Decisions:
    """Return what decisions say, in a form that two processes can compare."""
    return tuple((record.kind.number, record.body) for record in records)


class Again:
    """Other processes, started when they are first asked and kept for the next question."""

    def __init__(self, seeds: Sequence[int] = SEEDS, child: Sequence[str] = CHILD) -> None:
        """`child` is what the interpreter is given to run; it must behave as this module does."""
        self.seeds = tuple(seeds)
        self._child = tuple(child)
        self._running: dict[int, subprocess.Popen[bytes]] = {}

    def decide(self, seed: int, steps: Sequence[Sequence[Record]]) -> Decisions:
        """Return the decisions of the last step, under this hash seed. Raises ChildFailed."""
        rows = [[_plain(record) for record in records] for records in steps]
        child = self._running.get(seed) or self._start(seed)
        assert child.stdin is not None
        assert child.stdout is not None
        try:
            pickle.dump(rows, child.stdin)
            child.stdin.flush()
            answer: Decisions = pickle.load(child.stdout)
        except (OSError, EOFError, pickle.UnpicklingError) as error:
            raise ChildFailed(f"the process with hash seed {seed} gave no answer: {error}") from error
        return answer

    def _start(self, seed: int) -> subprocess.Popen[bytes]:
        environ = os.environ | {"PYTHONHASHSEED": str(seed), "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        child = subprocess.Popen(
            [sys.executable, *self._child],
            env=environ,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        self._running[seed] = child
        return child

    def close(self) -> None:
        """End the processes."""
        for child in self._running.values():
            child.communicate()
        self._running.clear()


def _plain(record: Record) -> _Row:
    body = encode(record.message)  # as the charts see it: what was lifted stays lifted
    return record.seq, record.cause, tuple(record.at), record.kind.number, record.version, body


def _record(row: _Row) -> Record:
    seq, cause, at, number, version, body = row
    kind = kind_numbered(number)
    return Record(seq, cause, Moment(*at), kind, version, body, kind.message.FromString(body))


def answer(jobs: BinaryIO, answers: BinaryIO) -> None:
    """Answer jobs until there are no more: the child's whole work."""
    while True:
        try:
            rows: list[list[_Row]] = pickle.load(jobs)
        except EOFError:
            return
        state = State()
        *before, last = [[_record(row) for row in step_of] for step_of in rows]
        for records in before:
            restore(state, records)
        pickle.dump(said(step(state, last[0]).records[1:]), answers)
        answers.flush()


if __name__ == "__main__":
    answer(sys.stdin.buffer, sys.stdout.buffer)
