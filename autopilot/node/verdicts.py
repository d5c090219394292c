"""The verdict of the self-replay: each flight that is over is run again by a child process, and the answer is signed.

It is a note beside the log, by the node's own key, that names the log's head: REPLAYS, DIVERGES@seq, INTENDED@seq
(what differs is what a later logic of this node decides otherwise), or INCOMPLETE(seq-) where the log can't be followed
from that record on. A flight that was closed while the process ended, or that a boot closed, is judged at the next
start. Nothing is decided here; the child is `autopilot replay verify`.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from autopilot.node.board import Board
from autopilot.node.sealing import CERTIFICATE_FILE
from autopilot.trust.identity import Identity
from autopilot.trust.keys import write_file
from autopilot.trust.notes import sign_note
from autopilot.trust.replayed import VERDICT_FILE, SignedVerdict
from events.store import Flight, flights_in

_LOOK_EVERY_S = 1.0
_NICEST = 19  # the child has all the time; the node has not


def verdict_of(found: dict[str, Any]) -> str:
    """Return what `autopilot replay verify --json` found, as the one word that is signed."""
    match found["outcome"]:
        case "identical":
            return "REPLAYS"
        case "intended difference":
            return f"INTENDED@{found['first']['seq']}"
        case "diverges":
            return f"DIVERGES@{found['first']['seq']}"
    return f"INCOMPLETE({found['seq']}-)"


class Verdicts:
    """Judges the flights below a folder, one after the other, while the node runs."""

    def __init__(self, root: Path, identity: Identity, software: str, board: Board) -> None:
        self._root = root
        self._identity = identity
        self._software = software
        self._board = board
        self._tried: set[Path] = set()

    async def run(self) -> None:
        """Judge what is over whenever another flight is open. Ends by being cancelled, and its child with it."""
        seen: Flight | None = None
        while True:
            if (opened := self._board.session.flight) != seen:
                seen = opened
                for flight in await asyncio.to_thread(self._unjudged, opened):
                    await self._judge(flight)
            await asyncio.sleep(_LOOK_EVERY_S)

    def _unjudged(self, opened: Flight) -> list[Flight]:
        return [
            flight
            for flight in flights_in(self._root)
            if flight != opened
            and flight.folder not in self._tried
            and (flight.folder / CERTIFICATE_FILE).exists()
            and not (flight.folder / VERDICT_FILE).exists()
        ]

    async def _judge(self, flight: Flight) -> None:
        self._tried.add(flight.folder)
        try:
            found = json.loads(await _replayed(flight.folder))
            await asyncio.to_thread(self._sign, flight, found)
        except (OSError, ValueError, KeyError, TypeError) as error:
            print(f"autopilot: {flight.folder} has no verdict: {error}", file=sys.stderr, flush=True)

    def _sign(self, flight: Flight, found: dict[str, Any]) -> None:
        signer = f"waypoint/{self._identity.deployment_id}/{self._identity.principal_id}"
        said = SignedVerdict(
            origin=f"{signer}/{flight.number}",
            flight_id=found["flight_id"],
            seq=found["records"] - 1,
            leaf=found["leaf"],
            software=self._software,
            verdict=verdict_of(found),
        )
        note = sign_note(said.text(), signer, self._identity.sign_key)
        write_file(flight.folder / VERDICT_FILE, note.encode())


async def _replayed(folder: Path) -> bytes:
    """Run a flight again in a child process; return what it prints. Raises OSError."""
    child = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "autopilot.cli.main", "replay", "verify", str(folder), "--json"),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.DEVNULL,
    )
    try:
        with suppress(ProcessLookupError):
            os.setpriority(os.PRIO_PROCESS, child.pid, _NICEST)
        printed, _ = await child.communicate()
        return printed
    finally:
        if child.returncode is None:
            child.kill()
            await child.wait()
