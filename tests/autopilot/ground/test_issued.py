"""The issuer's own audit: a row before an order leaves, a row at its last word, numbers that only grow."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from autopilot.ground import compose
from autopilot.ground.issued import FILE, JUMP, AuditRow, IssuedStore, NotRecorded
from autopilot.ground.issuer import Issuer
from autopilot.trust.identity import load_identity
from events.schema.waypoint_pb2 import AckResult, DeviceCommand, ResultState
from tests.autopilot.ground.test_issuer import Desk
from tests.autopilot.trust.world import NOW_MS, FakeClock, FakeWire, people

BODY = b"body"


class WatchedWire(FakeWire):
    """A wire that looks at the store before it lets a byte out."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self._store = IssuedStore(folder)
        self.seen: list[list[str]] = []

    def put(self, key_expr: str, payload: bytes, *, urgent: bool) -> None:
        """Note what an outside reader finds in the store, then publish."""
        self.seen.append([row.state for row in self._store.rows()])
        super().put(key_expr, payload, urgent=urgent)


@pytest.fixture
def desk(tmp_path: Path) -> Desk:
    return Desk(tmp_path)


def states(rows: tuple[AuditRow, ...]) -> list[tuple[int, str, str]]:
    """Return of each row which order it is of, its state and its result."""
    return [(row.of, row.state, row.result) for row in rows]


def test_a_row_is_there_before_the_first_byte(tmp_path: Path) -> None:
    """As another process sees it; and it says who ordered what, when, of whom."""
    folder = Path(shutil.copytree(people().alice.folder, tmp_path / "alice"))
    wire = WatchedWire(folder)
    issuer = Issuer(load_identity(folder), clock=FakeClock(), wire=wire)
    order = issuer.send("wasp-01", compose.release())
    assert wire.seen == []
    issuer.turn()
    assert wire.seen == [["pending"]]
    (row,) = issuer.history()
    assert (row.id, row.of, row.state, row.at_ms) == (1, 1, "pending", NOW_MS)
    assert (row.node, row.command_id, row.order_seq) == ("wasp-01", order.command_id, order.order_seq)
    assert DeviceCommand.FromString(row.content).WhichOneof("command") == "camera_release"
    assert (folder / FILE).stat().st_mode & 0o777 == 0o600


def test_a_last_word_is_a_row_before_anybody_is_told(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    """Only what was believed; once; pending answers are none."""
    order, told = desk.send(), list[str]()
    (opened,) = desk.arrived()
    end = IssuedStore.end

    def watched(store: IssuedStore, of: int, state: str, **values: object) -> None:
        told.append(order.answer.state)
        end(store, of, state, **values)  # type: ignore[arg-type]

    monkeypatch.setattr(IssuedStore, "end", watched)
    desk.answer(order, opened.message.digest, people().hornet)
    desk.answer(order, opened.message.digest, result_state=ResultState.PENDING)
    assert states(desk.issuer.history()) == [(1, "pending", "")]
    desk.clock.now_ms += 1
    for _ in range(2):
        desk.clock.now_ms += 1
        desk.answer(order, opened.message.digest, result=AckResult.ACK_REJECTED, detail="no vehicle is heard")
    assert told == ["pending"]
    assert states(desk.issuer.history()) == [(1, "pending", ""), (1, "final", "rejected")]
    assert (desk.issuer.history()[1].detail, desk.issuer.history()[1].at_ms) == ("no vehicle is heard", NOW_MS + 2)


def test_an_order_that_nobody_answers_has_a_row_too(desk: Desk) -> None:
    """After its life and a grace; a last word that comes even later is still one."""
    order = desk.send(life_s=3)
    (opened, *_) = desk.arrived()
    desk.later(4_999)
    assert states(desk.issuer.history()) == [(1, "pending", "")]
    desk.later(1)
    desk.later(10_000)
    assert states(desk.issuer.history()) == [(1, "pending", ""), (1, "unanswered", "")]
    desk.answer(order, opened.message.digest)
    assert states(desk.issuer.history())[2:] == [(1, "final", "accepted")]
    assert order.answer.result == "accepted"


def test_what_cannot_be_sent_is_told_in_the_audit(desk: Desk) -> None:
    """An order that never left ended as well."""
    desk.clock.now_ms += 40 * 24 * 3_600_000
    desk.send()
    assert states(desk.issuer.history())[1:] == [(1, "final", "failed")]
    assert "group key" in desk.issuer.history()[1].detail


def test_a_repeat_is_an_order_of_its_own_in_the_audit(desk: Desk) -> None:
    """Under the same id and number, with a last word of its own."""
    order = desk.send()
    (first,) = desk.arrived()
    desk.answer(order, first.message.digest)
    repeat = desk.issuer.repeat(order)
    (second,) = desk.later(10)
    desk.answer(repeat, second.message.digest, duplicate=True)
    rows = desk.issuer.history()
    accepted = [(1, "pending", ""), (1, "final", "accepted"), (3, "pending", ""), (3, "final", "accepted")]
    assert states(rows) == accepted
    assert len({(row.command_id, row.order_seq, row.content) for row in rows}) == 1


def test_without_a_row_nothing_leaves(desk: Desk) -> None:
    """A store that can't be written refuses the order, also a repeat of one; then it works again."""
    (desk.issuer._identity.folder / FILE).mkdir()
    with pytest.raises(NotRecorded, match=FILE):
        desk.issuer.send("wasp-01", compose.release())
    desk.issuer.turn()
    assert desk.wire.puts == []
    (desk.issuer._identity.folder / FILE).rmdir()
    assert desk.send().answer.state == "waiting"


def test_a_last_word_that_cannot_be_recorded_is_still_told(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    """The answer is true whether or not the disk takes it; that the row is missing is said."""
    order = desk.send()
    (opened,) = desk.arrived()

    def full(*_args: object, **_values: object) -> None:
        raise NotRecorded("no space left")

    monkeypatch.setattr(IssuedStore, "end", full)
    desk.answer(order, opened.message.digest)
    assert (order.answer.state, desk.issuer.unrecorded()) == ("final", ("no space left",))


def begin(store: IssuedStore, at_ms: int, life_ms: int = 1000) -> int:
    """Begin an order; return its number."""
    return store.begin("n", "c", BODY, "alice", at_ms, life_ms).order_seq


def test_numbers_grow_over_restarts_shells_and_clocks(tmp_path: Path) -> None:
    """A new store jumps; then each number is above all before it, whoever asks and whatever the clock says."""
    one, other = IssuedStore(tmp_path), IssuedStore(tmp_path)
    assert begin(one, NOW_MS) == NOW_MS + JUMP
    assert begin(other, NOW_MS - 1_000_000) == NOW_MS + JUMP + 1
    assert begin(one, NOW_MS) == NOW_MS + JUMP + 2
    one.close()
    assert begin(IssuedStore(tmp_path), NOW_MS) == NOW_MS + JUMP + 3
    assert begin(one, NOW_MS + 2 * JUMP) == NOW_MS + 2 * JUMP
    assert begin(other, NOW_MS) == NOW_MS + 2 * JUMP + 1
    (tmp_path / FILE).unlink()
    for beside in ("-wal", "-shm"):
        (tmp_path / f"{FILE}{beside}").unlink(missing_ok=True)
    assert begin(IssuedStore(tmp_path), NOW_MS + JUMP + 10) > NOW_MS + 2 * JUMP + 1


def test_what_a_process_left_open_is_closed_by_the_next(tmp_path: Path) -> None:
    """When its life and the grace are over, once, and not the order of a process that still waits."""
    first = IssuedStore(tmp_path)
    begin(first, NOW_MS, life_ms=1000)
    begin(first, NOW_MS, life_ms=30_000)
    done = first.begin("n", "d", BODY, "alice", NOW_MS, 1000)
    first.end(done.row, "final", at_ms=NOW_MS, result="accepted")
    store = IssuedStore(tmp_path)
    begin(store, NOW_MS + 3_000)
    assert [row.of for row in store.rows() if row.state == "unanswered"] == []
    store = IssuedStore(tmp_path)
    begin(store, NOW_MS + 3_001)
    begin(store, NOW_MS + 60_000)
    left = [row for row in store.rows() if row.state == "unanswered"]
    assert [(row.of, row.detail) for row in left] == [(1, "the program ended before an answer")]


def test_an_end_is_written_once_for_each_state(tmp_path: Path) -> None:
    store = IssuedStore(tmp_path)
    row = store.begin("n", "c", BODY, "alice", NOW_MS, 1000).row
    for result in ("accepted", "rejected"):
        store.end(row, "final", at_ms=NOW_MS, result=result)
    assert states(store.rows()) == [(1, "pending", ""), (1, "final", "accepted")]


KILLED = """
import os, signal, sys
from autopilot.ground import compose
from autopilot.ground.issuer import Issuer
from autopilot.trust.identity import load_identity
from tests.autopilot.trust.world import FakeClock, FakeWire

class Deadly(FakeWire):
    def put(self, key_expr, payload, *, urgent):
        os.kill(os.getpid(), signal.SIGKILL)

issuer = Issuer(load_identity(sys.argv[1]), clock=FakeClock(), wire=Deadly())
issuer.send("wasp-01", compose.release(), 1)
issuer.turn()
"""


@pytest.mark.whole
def test_killed_at_the_first_byte(tmp_path: Path) -> None:
    """The row is there, the number is used, and the next process says that nothing was heard."""
    folder = Path(shutil.copytree(people().alice.folder, tmp_path / "alice"))
    for number in range(1, 4):
        killed = subprocess.run([sys.executable, "-c", KILLED, str(folder)], env={**os.environ}, check=False)
        assert killed.returncode == -signal.SIGKILL
        assert states(IssuedStore(folder).rows()) == [(one, "pending", "") for one in range(1, number + 1)]
    assert len({row.order_seq for row in IssuedStore(folder).rows()}) == 3
    assert begin(IssuedStore(folder), NOW_MS + 10_000) == NOW_MS + JUMP + 3
    assert [row.of for row in IssuedStore(folder).rows() if row.state == "unanswered"] == [1, 2, 3]
