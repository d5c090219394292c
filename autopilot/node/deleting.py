"""Deletes flights, so that a power cut at any point leaves either the flight or something that is finished later.

    bury      the folder gets a name that no reader of flights knows, and the name is made durable
    empty     what is in it is removed, the receipt last: with it the node can still say what is gone
    forget    the open flight has taken the observation `flight_deleted`; the receipt and the folder go

A start finishes what it finds. Cut between taking and forgetting, the deletion is said twice.
"""

from __future__ import annotations

import asyncio
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

from autopilot.node.receipts import NAME as RECEIPT
from autopilot.node.receipts import Receipt, read_receipt
from autopilot.node.retention import Candidate, Plan, Policy, plan
from autopilot.node.stock import stock_of
from autopilot.ports.config import RetentionSection
from autopilot.ports.edges import Clock, InputClass, Offer
from autopilot.trust.clock import wall_ms
from events.schema.flight_pb2 import FlightDeleted
from events.store.flights import Flight, flights_in
from events.store.sqlite import sync_folder

EVERY_S = 3600.0
OFFER_AGAIN_S = 1.0
_PREFIX = ".deleted-"
_MS_PER_DAY = 86_400_000


def policy_of(settings: RetentionSection) -> Policy:
    """Return the policy that is configured."""
    return Policy(settings.keep_newest, int(settings.keep_days * _MS_PER_DAY), settings.min_free_mib << 20)


def planned(root: Path, settings: RetentionSection, now_ms: int, *, open_number: int | None = None) -> Plan:
    """Return what is to go at this moment. The flight that is open, and any after it, never is. Raises OSError."""
    flights = [one.candidate() for one in stock_of(root)]
    closed = [_kept_open(one, open_number) for one in flights]
    return plan(closed, policy_of(settings), now_ms=now_ms, free_bytes=shutil.disk_usage(root).free)


def _kept_open(one: Candidate, open_number: int | None) -> Candidate:
    return one if open_number is None or one.number < open_number else one._replace(closed=False)


def bury(flight: Flight) -> Path:
    """Take a flight out of sight, durably; return where it lies now. Raises OSError."""
    grave = flight.folder.with_name(_PREFIX + flight.folder.name)
    flight.folder.rename(grave)
    sync_folder(grave.parent)
    return grave


def graves(root: Path) -> list[Path]:
    """Return what is buried below a folder and not forgotten."""
    return sorted(folder for folder in root.glob(f"{_PREFIX}*") if folder.is_dir())


def empty(grave: Path) -> Receipt | None:
    """Remove everything but the receipt; return that, None where there is none to be read. Raises OSError."""
    for inside in grave.iterdir():
        if inside.is_dir() and not inside.is_symlink():
            shutil.rmtree(inside)
        elif inside.name != RECEIPT:
            inside.unlink()
    return read_receipt(grave)


def forget(grave: Path) -> None:
    """Remove what is left. Raises OSError."""
    (grave / RECEIPT).unlink(missing_ok=True)
    grave.rmdir()
    sync_folder(grave.parent)


def prune(root: Path, numbers: tuple[int, ...]) -> None:
    """Bury and empty flights; the next start of the daemon says so in its log and forgets them. Raises OSError."""
    for flight in flights_in(root):
        if flight.number in numbers:
            empty(bury(flight))


class Retention:
    """Applies the policy while the daemon runs: at its start, and then every hour."""

    def __init__(
        self,
        root: Path,
        settings: RetentionSection,
        clock: Clock,
        offer: Offer,
        open_number: Callable[[], int],
        say_short: Callable[[str], None],
    ) -> None:
        self._root = root
        self._settings = settings
        self._clock = clock
        self._offer = offer
        self._open_number = open_number
        self._say_short = say_short

    async def run(self) -> None:
        """Delete what may go, again and again, until cancelled. What can't be done is said, and tried in an hour."""
        while True:
            try:
                await self.turn()
            except OSError as error:
                print(f"autopilot: what was pushed can't be deleted: {error}", file=sys.stderr, flush=True)
            await asyncio.sleep(EVERY_S)

    async def turn(self) -> None:
        """Delete what may go now, and finish what was begun. Raises OSError."""
        found = await asyncio.to_thread(self._bury_what_may_go)
        self._say_short(found.short)
        for grave in graves(self._root):
            receipt = await asyncio.to_thread(empty, grave)
            if receipt is not None:
                await self._say(receipt)
            await asyncio.to_thread(forget, grave)

    def _bury_what_may_go(self) -> Plan:
        found = planned(self._root, self._settings, wall_ms(self._clock), open_number=self._open_number())
        for flight in flights_in(self._root):
            if flight.number in found.delete:
                bury(flight)
                print(f"autopilot: {flight.folder} was pushed and is deleted", file=sys.stderr, flush=True)
        return found

    async def _say(self, receipt: Receipt) -> None:
        """Offer the observation until it is taken."""
        while not self._offer(InputClass.OUTCOME, deleted(receipt)):
            await asyncio.sleep(OFFER_AGAIN_S)


def deleted(receipt: Receipt) -> FlightDeleted:
    """Return what the log is told of a flight that is gone."""
    return FlightDeleted(
        flight_number=receipt.flight_number,
        flight_id=bytes.fromhex(receipt.flight_id),
        last_seq=receipt.last_seq,
        last_leaf=bytes.fromhex(receipt.last_leaf),
        pushed_to=receipt.to,
    )
