"""The verdict after a flight: what is signed for each end of a replay, and that a child process finds it."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest

from autopilot.cli import replay
from autopilot.node.sealing import CERTIFICATE_FILE
from autopilot.node.verdicts import Verdicts, verdict_of
from autopilot.trust.notes import NoteInvalid, sign_note
from autopilot.trust.replayed import VERDICT_FILE, SignedVerdict, read_verdict
from events import Record
from events.schema.flight_pb2 import FlightOpened
from events.store import Flight, MemoryStore, create_flight
from replay.verify import verify
from tests.autopilot.cli.flown import run
from tests.autopilot.trust.world import people
from tests.flights import FLIGHT_ID, SECRET, opened_well, resealed
from tests.flights import Flight as Flown
from tests.replay.changes import Tampered, forged, small

SIGNER = "waypoint/coast-watch/wasp-01"


def test_each_end_of_a_replay_has_its_word() -> None:
    """As `autopilot replay verify --json` tells it."""
    flight = small()
    assert isinstance(flight.store, MemoryStore)
    rows = list(flight.store.stored())
    check_word(flight.store, "REPLAYS")
    check_word(Tampered(flight.store, [*rows[:8], *rows[9:]]), "INCOMPLETE(8-)")
    seq = next(record.seq for record in flight.records if record.kind.name == "send_ack")
    check_word(resealed(forged(flight, seq, detail="forged")), f"DIVERGES@{seq}")


def check_word(store: Any, expected: str) -> None:
    """Check the word for a flight."""
    assert verdict_of(verify(store).plain()) == expected


def of_wasp() -> list[Record]:
    """Return a short flight whose manifest names wasp-01."""
    opening = opened_well()
    assert isinstance(opening[0], FlightOpened)
    opening[0].node, opening[0].deployment_id = "wasp-01", "coast-watch"
    opening[0].node_public_key = people().wasp.public_key
    return Flown(*opening).records


def on_disk(root: Path, number: int, *, sealed: bool = True) -> Flight:
    """Write a flight that is over."""
    flight, store = create_flight(root, number, FLIGHT_ID[:1] * 15 + bytes([number]), SECRET)
    store.close()
    if sealed:
        (flight.folder / CERTIFICATE_FILE).touch()
    return flight


class OpenFlight:
    """A board that only knows which flight is open."""

    def __init__(self, flight: Flight) -> None:
        self.session, self.flight = self, flight


@pytest.mark.whole
def test_a_child_judges_what_is_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every closed and sealed flight once; the open one, and one that nobody sealed, not at all."""
    flight, store = create_flight(tmp_path, 3, FLIGHT_ID, SECRET)
    store.append(of_wasp())
    head = store.head
    store.close()
    (flight.folder / CERTIFICATE_FILE).touch()
    unsealed, judged_before = on_disk(tmp_path, 1, sealed=False), on_disk(tmp_path, 2)
    (judged_before.folder / VERDICT_FILE).write_text("before", encoding="utf-8")
    empty, opened = on_disk(tmp_path, 4), on_disk(tmp_path, 5)
    board: Any = OpenFlight(opened)
    asyncio.run(judged(Verdicts(tmp_path, people().wasp, "0.1.0", board), empty.folder / VERDICT_FILE))
    found_in = [path.parent for path in sorted(tmp_path.glob(f"*/{VERDICT_FILE}"))]
    assert found_in == [judged_before.folder, flight.folder, empty.folder]
    assert (judged_before.folder / VERDICT_FILE).read_text(encoding="utf-8") == "before"
    assert not (unsealed.folder / VERDICT_FILE).exists()
    found = read_verdict(flight.folder, people().wasp.public_key, SIGNER)
    assert found == SignedVerdict(
        origin=f"{SIGNER}/3",
        flight_id=FLIGHT_ID.hex(),
        seq=head.seq,
        leaf=head.leaf.hex(),
        software="0.1.0",
        verdict="REPLAYS",
    )
    nothing = read_verdict(empty.folder, people().wasp.public_key, SIGNER)
    assert nothing is not None
    assert nothing.verdict == "INCOMPLETE(0-)"
    check_told(flight.folder, f"signed by wasp-01: REPLAYS up to record {head.seq}", capsys)


async def judged(verdicts: Verdicts, last: Path) -> None:
    """Run until the last verdict is there."""
    task = asyncio.create_task(verdicts.run())
    async with asyncio.timeout(60):
        while not last.exists():
            await asyncio.sleep(0.05)
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


def check_told(folder: Path, expected: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Check what `replay verify` says of the verdict beside the log; its own is not moved by it."""
    assert run(replay, ["replay", "verify", str(folder)]) == 0
    assert expected in capsys.readouterr().err
    assert run(replay, ["replay", "verify", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["outcome"] == "identical"


def test_a_verdict_that_is_not_the_nodes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By another key, of another log, or no verdict at all."""
    flight, store = create_flight(tmp_path, 1, FLIGHT_ID, SECRET)
    store.append(of_wasp())
    store.close()
    said = SignedVerdict(
        origin=f"{SIGNER}/1", flight_id=FLIGHT_ID.hex(), seq=2, leaf="00" * 32, software="1", verdict="REPLAYS"
    )
    wasp, hornet = people().wasp, people().hornet
    for note, expected in (
        (sign_note(said.text(), SIGNER, hornet.sign_key), "not to be believed"),
        (sign_note("REPLAYS\n", SIGNER, wasp.sign_key), "not to be believed"),
        (sign_note(said.text(), SIGNER, wasp.sign_key), "of another log than this"),
    ):
        (flight.folder / VERDICT_FILE).write_text(note, encoding="utf-8")
        check_told(flight.folder, expected, capsys)
    with pytest.raises(NoteInvalid):
        read_verdict(flight.folder, hornet.public_key, SIGNER)
    assert read_verdict(tmp_path, wasp.public_key, SIGNER) is None
