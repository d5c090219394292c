"""What the node believes of the Directory, kept for guards that ask, and for a start that must not believe less.

No chart, nothing is decided: documents are judged at the edge, which alone has the keys.
"""

from __future__ import annotations

from events.records import Record
from events.schema.trust_pb2 import EpochTaken, RevocationsTaken, RootTaken, TimeLearned
from statecharts.part import Evolve
from statecharts.state import State


def _list_taken(state: State, record: Record) -> None:
    taken = record.message
    assert isinstance(taken, RevocationsTaken)
    newest = state.lists.get(taken.key_id) or (0, b"")
    found = (taken.list_version, taken.digest)
    if taken.list_version > newest[0]:
        state.lists.put(taken.key_id, found)
        newest = found
    state.trusted.set(state.trusted.value._replace(list_behind=found != newest))


def _root_taken(state: State, record: Record) -> None:
    taken = record.message
    assert isinstance(taken, RootTaken)
    before = state.trusted.value
    newest = max(before.root_version, taken.root_version)
    state.trusted.set(before._replace(root_version=newest, root_behind=taken.root_version < newest))


def _epoch_taken(state: State, record: Record) -> None:
    taken = record.message
    assert isinstance(taken, EpochTaken)
    before = state.trusted.value
    state.trusted.set(before._replace(epoch_id=max(before.epoch_id, taken.epoch_id)))


def _time_learned(state: State, record: Record) -> None:
    learned = record.message
    assert isinstance(learned, TimeLearned)
    before = state.trusted.value
    state.trusted.set(before._replace(time_floor_ms=max(before.time_floor_ms, learned.floor_ms)))


EVOLVE: dict[str, Evolve] = {
    "revocations_taken": _list_taken,
    "root_taken": _root_taken,
    "epoch_taken": _epoch_taken,
    "time_learned": _time_learned,
}
