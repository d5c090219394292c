"""Every promise that can be broken, broken once: what the harness must find, and what it must not take for a breach."""

from __future__ import annotations

from dataclasses import replace

import pytest

from events.records import NO_CAUSE, Moment, make_record
from events.schema.flight_pb2 import TimePassed
from events.store import MemoryStore
from tests.checks import check_equal
from tests.disk.promises import (
    ALARM,
    FAILED,
    LOST,
    OPEN,
    REPLACED,
    TWICE,
    UNRECORDED,
    UNSEALED,
    Committed,
    Outcome,
    Performed,
    Promised,
    Sealed,
    broken,
    print_of,
)

F, G = b"flight", b"another"
LOG = b"".join(bytes([number]) * 8 for number in range(1, 5))
ORDERED = Performed(F, 2, bytes([3]) * 8, "alpha/a1")
ACK = Performed(F, 3, bytes([4]) * 8, None)
KEPT = Outcome(("go on",), {F: LOG}, frozenset({Sealed(F, 3)}), (), {"alpha/a1": "timeout"})


def promised() -> Promised:
    """Return what a node has promised: four records, an order performed, an answer sent, a checkpoint."""
    promises = Promised()
    for promise in (Committed(F, 0, LOG[:24], 1), ORDERED, Committed(F, 3, LOG[24:], 2), ACK, Sealed(F, 3)):
        promises.add(promise)
    return promises


@pytest.mark.parametrize(
    ("outcome", "expected"),
    [
        (KEPT, []),
        (replace(KEPT, logs={F: LOG + b"a record more", G: b"of the next start"}), []),
        (replace(KEPT, performed=(ACK, Performed(G, 2, b"", "alpha/a2"), Performed(G, 3, b"", ""))), []),
        (replace(KEPT, sealed=frozenset({Sealed(F, 3), Sealed(F, 4)})), []),
        (replace(KEPT, logs={F: LOG[:-8]}), [LOST, UNRECORDED]),
        (replace(KEPT, logs={G: LOG}), [LOST, UNRECORDED, UNRECORDED]),
        (replace(KEPT, logs={F: b"x" * 8 + LOG[8:]}), [REPLACED]),
        (replace(KEPT, logs={F: LOG[:16] + b"x" * 8 + LOG[24:]}), [REPLACED, UNRECORDED]),
        (replace(KEPT, logs={F: b"x" * 8}), [LOST, REPLACED, UNRECORDED, UNRECORDED]),
        (replace(KEPT, performed=(ORDERED,)), [TWICE]),
        (replace(KEPT, performed=(Performed(G, 9, b"", "alpha/a1"),)), [TWICE]),
        (replace(KEPT, performed=(Performed(F, 2, b"", ""),)), [TWICE]),
        (replace(KEPT, orders={"alpha/a1": "intended"}), [OPEN]),
        (replace(KEPT, orders={}), [OPEN]),
        (replace(KEPT, sealed=frozenset({Sealed(G, 3), Sealed(F, 2)})), [UNSEALED]),
        (replace(KEPT, actions=("pass it over", "keep it as it was found")), [ALARM]),
        (replace(KEPT, failure="why"), [f"{FAILED}: why"]),
    ],
)
def test_a_broken_promise_is_found(outcome: Outcome, expected: list[str]) -> None:
    """And nothing else is."""
    check_equal(list(broken(promised(), outcome)), expected)


def test_promises_are_counted_and_copied() -> None:
    """A copy does not hear of what is promised later; a commit follows the one before it."""
    promises = promised()
    copy = promises.copy()
    promises.add(Committed(F, 4, b"8 bytes.", 1))
    check_equal((copy.synced, promises.synced, len(copy.logs[F])), (3, 4, 32))
    with pytest.raises(AssertionError, match="begins at 3"):
        promises.add(Committed(F, 3, b"", 0))


def test_what_was_durable_without_a_promise_may_be_anything() -> None:
    """A cut log may hold a commit that never returned; what follows it is promised all the same."""
    promises = promised()
    promises.add(Committed(F, 5, b"8 bytes.", 1))
    for between in (b"x" * 8, b"y" * 8):
        check_equal(list(broken(promises, replace(KEPT, logs={F: LOG + between + b"8 bytes."}))), [])
    check_equal(list(broken(promises, replace(KEPT, logs={F: LOG + b"x" * 8 + b"another."}))), [REPLACED])
    check_equal(list(broken(promises, replace(KEPT, logs={F: LOG + b"x" * 8}))), [LOST])


def test_a_record_is_told_from_every_other() -> None:
    """By each of its columns; stored, it is the same one."""
    at = Moment(1, 2, 3, 4, 2)
    record = make_record(0, NO_CAUSE, at, TimePassed())
    others = [
        replace(record, seq=1),
        replace(record, cause=0),
        replace(record, at=at._replace(wall_ns=5)),
        replace(record, body=b"x"),
        replace(record, version=2),
    ]
    check_equal(len({print_of(one) for one in (record, *others)}), 6)
    store = MemoryStore(bytes(16), bytes(32))
    store.append([record])
    check_equal([print_of(stored) for stored in store.stored()], [print_of(record)])
