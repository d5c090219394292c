"""The ground as a witness: what it keeps, what it finds out, and what it does not mistake for a lie."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from autopilot.ground.witness import FOLDER, Witness
from autopilot.trust.keys import SignKey
from autopilot.trust.notes import Checkpoint, LogKey, sign_note
from events.schema.waypoint_pb2 import NodeStatus
from tests.autopilot.trust.world import people

KEY = SignKey.from_seed(b"k" * 32)
ROOT = bytes(range(32))


def status(
    size: int,
    *,
    flight: int = 3,
    flight_id: int = 1,
    root: bytes = ROOT,
    at_ms: int = 100_000,
    node: str = "wasp-01",
    signer: str = "waypoint/coast-watch/wasp-01",
) -> NodeStatus:
    """Return what wasp-01 publishes of its log."""
    log_key = LogKey(
        deployment_id="coast-watch",
        node=node,
        flight_number=flight,
        flight_id=bytes([flight_id]) * 16,
        public_key=KEY.public,
    )
    note = sign_note(Checkpoint(log_key.origin, size, root, at_ms).text(), log_key.origin, KEY)
    certificate = sign_note(log_key.text(), signer, people().wasp.sign_key)
    return NodeStatus(at_ms=at_ms, log_checkpoint=note, log_key=certificate)


def see(folder: Path, *statuses: NodeStatus) -> list[str]:
    """Return what witnesses of the same folder, each a process of its own, say of these."""
    wasp = people().wasp
    return [Witness(folder).see("coast-watch", "wasp-01", wasp.public_key, one) for one in statuses]


def check_found(folder: Path, before: NodeStatus, after: NodeStatus, because: str) -> None:
    """Check that `after` contradicts `before`, which stays kept, and lies beside it as evidence."""
    first, second = see(folder, before, after)
    assert (first, because in second) == ("", True), second
    kept = json.loads((folder / FOLDER / "wasp-01.json").read_text(encoding="utf-8"))
    assert kept["checkpoint"] == before.log_checkpoint
    other = json.loads((folder / FOLDER / "wasp-01.json.contradiction").read_text(encoding="utf-8"))
    assert other["checkpoint"] == after.log_checkpoint


def check_fits(folder: Path, *statuses: NodeStatus, kept: int) -> None:
    """Check that nothing is wrong, and which of them is kept at the end."""
    assert see(folder, *statuses) == [""] * len(statuses)
    found = json.loads((folder / FOLDER / "wasp-01.json").read_text(encoding="utf-8"))
    assert found["checkpoint"] == statuses[kept].log_checkpoint
    assert len(list((folder / FOLDER).iterdir())) == 1


def test_a_log_that_grows_fits(tmp_path: Path) -> None:
    """Also one that stands still, and the next flight, however short."""
    said = [status(5), status(5), status(9, root=bytes(32)), status(1, flight=4)]
    for number, one in enumerate(said):
        one.at_ms += number
    check_fits(tmp_path, *said, kept=3)


def test_what_comes_late_is_no_lie(tmp_path: Path) -> None:
    """An older status that was overtaken on its way."""
    check_fits(tmp_path, status(9), status(5, at_ms=70_000), kept=0)


@pytest.mark.parametrize(
    ("after", "because"),
    [
        (status(4, at_ms=100_001), "now only 4: it was rolled back"),
        (status(4, at_ms=69_999), "rolled back"),
        (status(5, root=bytes(32)), "two logs of 5 records"),
        (status(9, flight_id=2), "two flights 3"),
        (status(9, flight=2), "back from flight 3 to flight 2"),
    ],
)
def test_what_contradicts_is_found(tmp_path: Path, after: NodeStatus, because: str) -> None:
    """Each way of going back behind what was signed."""
    check_found(tmp_path, status(5), after, because)


def test_what_is_not_signed_is_not_kept(tmp_path: Path) -> None:
    """By the node's key the certificate, by the log's key the checkpoint, and both about this log."""
    good, other = status(5), status(7, flight=4)
    hornet = sign_note("x\n", "waypoint/coast-watch/wasp-01", people().hornet.sign_key)
    bad = [
        NodeStatus(at_ms=1, log_checkpoint=good.log_checkpoint, log_key=other.log_key),
        NodeStatus(at_ms=1, log_checkpoint=good.log_checkpoint.replace("5", "6", 1), log_key=good.log_key),
        NodeStatus(at_ms=1, log_checkpoint=good.log_checkpoint, log_key=hornet),
        NodeStatus(at_ms=1, log_checkpoint=good.log_checkpoint, log_key=""),
        status(5, node="hornet-02"),
        status(5, signer="waypoint/coast-watch/hornet-02"),
    ]
    assert [bool(wrong) for wrong in see(tmp_path, *bad)] == [True] * len(bad)
    assert see(tmp_path, NodeStatus(at_ms=1)) == [""]
    assert not (tmp_path / FOLDER).exists()


def test_a_damaged_memory_is_said_so(tmp_path: Path) -> None:
    """It is not taken for a clean sheet."""
    see(tmp_path, status(5))
    (tmp_path / FOLDER / "wasp-01.json").write_text("{}", encoding="utf-8")
    assert "can't be read" in see(tmp_path, status(9))[0]
