"""The ground as a witness: it keeps what nodes sign, has them prove that their logs only grow, and finds out what lies.

A checkpoint is heard in a status and believed when the log's key signed it and the node's key certified that one. It
counts as proven when a consistency path leads from the one proven before to it; until then it waits, and is shown so.
A path is answered by whoever is on the mesh and proves itself: it leads to the root that the node signed, and to the
root before that it claims. Where that is the one that was kept, the log grew in order. Where it is another one, the
node signed two histories, and the two notes with the path show it to anybody. All else proves nothing, either way.
"""

from __future__ import annotations

import fcntl
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path

from autopilot.ground.kept import FOLDER, Chain, Kept, Memory
from autopilot.trust.documents import DocumentMalformed, parse
from autopilot.trust.limits import KEY_BYTES
from autopilot.trust.notes import NoteInvalid
from events.schema.waypoint_pb2 import ConsistencyAnswer, ConsistencyRequest, NodeStatus
from events.tree import ProofFailed, check_consistency

# A status may arrive this much after a newer one (the longest life of an envelope): late, and no lie.
LATE_MS = 30_000
# Checkpoints that wait for their proof, ten minutes of them; then the newest takes the place of the last.
WAITING_MAX = 64


class Outcome(Enum):
    """What an answer is worth."""

    PROVEN = "proven"
    CONTRADICTS = "contradicts"
    NOTHING = "proves nothing"


@dataclass(frozen=True, slots=True)
class Question:
    """What a node is asked to prove."""

    proven: Kept
    fresh: Kept

    def request(self) -> bytes:
        """Return the question as it goes over the mesh."""
        asked = ConsistencyRequest(
            flight_number=self.proven.log_key.flight_number,
            old_size=self.proven.checkpoint.size,
            new_size=self.fresh.checkpoint.size,
        )
        return asked.SerializeToString(deterministic=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Standing:
    """What is known of a node's newest flight."""

    flight_number: int
    proven_size: int  # records up to which the log is proven to have grown in order
    heard_size: int  # records under the newest checkpoint that was heard
    waiting_since_ms: int | None  # the node's clock at the oldest checkpoint that is not proven; None: all are


class Witness:
    """Remembers what nodes have signed. Safe from several threads and processes."""

    def __init__(self, folder: Path, deployment_id: str) -> None:
        """Keep files below the operator's `folder`."""
        self._folder = folder
        self._deployment_id = deployment_id
        self._seen: dict[str, tuple[str, str]] = {}  # what each node said last, so that a repeat costs nothing
        self._lock = threading.Lock()

    def see(self, node: str, public_key: bytes, status: NodeStatus) -> str:
        """Judge and keep what `node` publishes in an authentic status; return what is wrong, "" where it fits.

        What is kept is never replaced by what contradicts it: that is laid beside it, as evidence. Raises OSError.
        """
        said = {"log_key": status.log_key, "checkpoint": status.log_checkpoint, "at_ms": status.at_ms}
        if not status.log_checkpoint or self._seen.get(node) == (status.log_key, status.log_checkpoint):
            return ""
        try:
            memory = self._memory(node, public_key)
            fresh = memory.opened(said)
            with self._alone():
                wrong = _kept(memory, fresh)
        except NoteInvalid as error:
            return str(error)
        if not wrong:
            self._seen[node] = (status.log_key, status.log_checkpoint)
        return wrong

    def question(self, node: str, public_key: bytes) -> Question | None:
        """Return what the node is to prove next, newest flight first; None: nothing waits. Raises NoteInvalid."""
        with self._alone():
            waiting = (chain for chain in self._memory(node, public_key).chains() if chain.waiting)
            chain = next(waiting, None)
        return None if chain is None else Question(chain.proven, chain.waiting[0])

    def answered(self, node: str, public_key: bytes, asked: Question, answer: bytes) -> Outcome:
        """Judge an answer and keep what it shows. Raises NoteInvalid and OSError."""
        outcome, said = judged(asked, answer)
        memory = self._memory(node, public_key)
        with self._alone():
            if outcome is Outcome.CONTRADICTS:
                proof = {"old_root": said.old_root.hex(), "path": [one.hex() for one in said.path]}
                memory.keep_evidence(asked.proven, asked.fresh, contradiction(asked), proof)
            for chain in memory.chains():
                if outcome is not Outcome.NOTHING and (chain.proven, chain.waiting[:1]) == (
                    asked.proven,
                    (asked.fresh,),
                ):
                    memory.keep(_after(chain, outcome))
        return outcome

    def newest(self, node: str, public_key: bytes) -> Chain | None:
        """Return what is kept of the node's newest flight. Raises NoteInvalid where the file was damaged."""
        return self._memory(node, public_key).newest()

    def standing(self, node: str, public_key: bytes) -> Standing | None:
        """Return what is known of a node; None: nothing. Raises NoteInvalid."""
        chain = self.newest(node, public_key)
        if chain is None:
            return None
        return Standing(
            flight_number=chain.flight_number,
            proven_size=chain.proven.checkpoint.size,
            heard_size=chain.newest.checkpoint.size,
            waiting_since_ms=chain.waiting[0].at_ms if chain.waiting else None,
        )

    def _memory(self, node: str, public_key: bytes) -> Memory:
        return Memory(self._folder, self._deployment_id, node, public_key)

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """Keep other threads, and other shells of the same operator, from writing at the same time."""
        (self._folder / FOLDER).mkdir(exist_ok=True)
        with self._lock, (self._folder / FOLDER / "lock").open("a") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield


def judged(asked: Question, answer: bytes) -> tuple[Outcome, ConsistencyAnswer]:
    """Say what an answer is worth; anybody may have given it."""
    try:
        said = parse(ConsistencyAnswer, answer)
    except DocumentMalformed:
        return Outcome.NOTHING, ConsistencyAnswer()
    old, new = asked.proven.checkpoint, asked.fresh.checkpoint
    about = (said.flight_number, said.old_size, said.new_size)
    if about != (asked.proven.log_key.flight_number, old.size, new.size):
        return Outcome.NOTHING, said
    # A hash that lends a byte to its neighbour gives the same parent, and another root before.
    if any(len(each) != KEY_BYTES for each in said.path):
        return Outcome.NOTHING, said
    try:
        check_consistency(old.size, said.old_root, new.size, new.root, said.path)
    except ProofFailed:
        return Outcome.NOTHING, said
    return Outcome.PROVEN if said.old_root == old.root else Outcome.CONTRADICTS, said


def contradiction(asked: Question) -> str:
    """Return in words what a path to another root shows."""
    old, new = asked.proven.checkpoint, asked.fresh.checkpoint
    flight = asked.proven.log_key.flight_number
    return f"signed {new.size} records of flight {flight} that do not begin with the {old.size} that it signed before"


def _kept(memory: Memory, fresh: Kept) -> str:
    """Keep a checkpoint that was heard, or what contradicts; return what is wrong. Raises NoteInvalid and OSError."""
    chain = memory.newest()
    if chain is None:
        memory.keep(Chain(fresh))
        return ""
    newest = chain.newest
    if newest.at_ms - LATE_MS <= fresh.at_ms < newest.at_ms:
        return ""
    if wrong := _contradiction(newest, fresh):
        memory.keep_evidence(newest, fresh, wrong)
        return wrong
    memory.keep(_grown(chain, fresh))
    return ""


def _grown(chain: Chain, fresh: Kept) -> Chain:
    """Return the chain with what was heard now, which does not contradict the newest."""
    if fresh.log_key.flight_number != chain.flight_number:
        return Chain(fresh)
    if fresh.checkpoint.size == chain.proven.checkpoint.size:
        return Chain(fresh)  # the same records, signed anew
    before = [one for one in chain.waiting if one.checkpoint.size < fresh.checkpoint.size]
    return replace(chain, waiting=(*before[: WAITING_MAX - 1], fresh))


def _after(chain: Chain, outcome: Outcome) -> Chain:
    """Return the chain after its first waiting checkpoint was proven, or shown to be of another history."""
    if outcome is Outcome.PROVEN:
        return Chain(chain.waiting[0], chain.waiting[1:])
    return Chain(chain.proven, ())


def _contradiction(kept: Kept, fresh: Kept) -> str:
    """Return why `fresh` can't be said by the node that said `kept`, "" where it can."""
    was, now = kept.checkpoint, fresh.checkpoint
    before, after = kept.log_key, fresh.log_key
    if after.flight_number != before.flight_number:
        back = after.flight_number < before.flight_number
        return f"went back from flight {before.flight_number} to flight {after.flight_number}" if back else ""
    if after.flight_id != before.flight_id:
        return f"there are two flights {before.flight_number}: {before.flight_id.hex()} and {after.flight_id.hex()}"
    if now.size < was.size:
        return (
            f"signed {was.size} records of flight {before.flight_number}, and now only {now.size}: it was rolled back"
        )
    if now.size == was.size and now.root != was.root:
        return f"signed two logs of {was.size} records in flight {before.flight_number}"
    return ""
