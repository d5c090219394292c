"""Documents for tests of what changes in flight: a Directory that signs what a test wants, and a node that takes it.

Nothing here tests anything.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass, field
from pathlib import Path

from google.protobuf.message import Message

from autopilot.trust import documents, pae
from autopilot.trust.book import TrustBook
from autopilot.trust.freshness import TrustClock
from autopilot.trust.identity import Identity, load_identity
from autopilot.trust.judging import Floors
from autopilot.trust.keys import SignKey, key_id, wrap
from events.schema.waypoint_pb2 import (
    EpochBundle,
    PurposeKey,
    RevocationList,
    SignedDoc,
    TimeBeacon,
    TrustRoot,
)
from tests.autopilot.trust.world import NOW_MS, people, seeded

HOUR_MS = 3_600_000
KEYS = people().directory.purpose_keys
OTHER = {purpose: SignKey.from_seed(bytes([number]) * 32) for number, purpose in enumerate(documents.PURPOSES, 1)}
CHALLENGE = b"c" * 16


@dataclass
class HostClocks:
    """A computer's two clocks, each moved on its own."""

    mono_ms: int = 1_000_000
    wall_ms: int = NOW_MS

    def mono_ns(self) -> int:
        """Monotonic nanoseconds."""
        return self.mono_ms * 1_000_000

    def wall_ns(self) -> int:
        """Wall nanoseconds."""
        return self.wall_ms * 1_000_000

    def pass_ms(self, milliseconds: int) -> None:
        """Let time pass on both."""
        self.mono_ms += milliseconds
        self.wall_ms += milliseconds


def a_list(version: int, *out: str, key: SignKey = KEYS["revoke"], **values: object) -> bytes:
    """Return a revocation list that names `out`."""
    body = RevocationList(
        v=1,
        deployment_id="coast-watch",
        version=version,
        issued_at_ms=NOW_MS,
        next_update_ms=NOW_MS + 72 * HOUR_MS,
        prev_digest=bytes(32),
        principals=sorted(out),
    )
    for name, value in values.items():
        setattr(body, name, value)
    return documents.sign(pae.REVOCATION_LIST, body, [key])


def a_bundle(
    epoch_id: int, *, recipient: Identity | None = None, key: SignKey = KEYS["epoch"], **values: object
) -> bytes:
    """Return the bundle of an epoch whose secret follows from its id, for wasp-01."""
    wasp, secret = recipient or people().wasp, epoch_secret(epoch_id)
    body = EpochBundle(
        v=1,
        deployment_id="coast-watch",
        epoch_id=epoch_id,
        key_commitment=documents.epoch_commitment(epoch_id, secret),
        not_before_ms=NOW_MS,
        retire_at_ms=NOW_MS + 24 * HOUR_MS,
        min_revocation_version=1,
        recipient_device_key_id=key_id(wasp.public_key),
        wrapped_key=wrap(secret, wasp.box_key.public, seeded(epoch_id)),
    )
    for name, value in values.items():
        setattr(body, name, value)
    return documents.sign(pae.EPOCH_BUNDLE, body, [key])


def epoch_secret(epoch_id: int) -> bytes:
    """Return the secret that `a_bundle` wraps."""
    return bytes([epoch_id % 256]) * 32


def a_root(
    version: int, *, key: SignKey | None = None, deployment_id: str = "coast-watch", **rotated: SignKey
) -> bytes:
    """Return a TrustRoot of the same root with purpose keys replaced."""
    keys = KEYS | rotated
    body = TrustRoot()
    body.ParseFromString(SignedDoc.FromString((people().wasp.folder / "trust_root").read_bytes()).body)
    body.version, body.deployment_id = version, deployment_id
    del body.keys[:]
    body.keys.extend(PurposeKey(purpose=each, public_key=keys[each].public) for each in documents.PURPOSES)
    return documents.sign(pae.TRUST_ROOT, body, [key or people().directory.root_key])


def a_beacon(challenge: bytes, time_ms: int, *, key: SignKey = KEYS["time"]) -> bytes:
    """Return a beacon."""
    body = TimeBeacon(v=1, deployment_id="coast-watch", challenge=challenge, time_ms=time_ms)
    return documents.sign(pae.TIME_BEACON, body, [key])


@dataclass
class Asked:
    """A fetch that remembers what it was asked for."""

    requests: list[tuple[str, bytes | None]] = field(default_factory=list)

    def request(self, what: str, challenge: bytes | None = None) -> None:
        """Remember it."""
        self.requests.append((what, challenge))

    def take(self) -> list[str]:
        """Return what was asked for since the last call."""
        taken, self.requests = [what for what, _ in self.requests], []
        return taken


class Log:
    """A log as far as the book needs one: takes observations, makes them durable when it is told to."""

    def __init__(self) -> None:
        self.told: list[Message] = []
        self.refuses = False
        self.commits = True
        self.book: TrustBook | None = None

    def __call__(self, observation: Message) -> bool:
        """Take one in; durable at once, unless commits are held back."""
        if self.refuses:
            return False
        self.told.append(observation)
        if self.commits and self.book is not None:
            self.book.recorded(observation)
        return True

    def commit(self) -> None:
        """Make everything durable."""
        assert self.book is not None
        for observation in self.told:
            self.book.recorded(observation)

    def kinds(self) -> list[str]:
        """Return the names of the messages so far."""
        return [type(each).__name__ for each in self.told]


@dataclass
class Device:
    """A node's identity folder, its clocks, its book; `restart` is the next start of its daemon."""

    folder: Path
    host: HostClocks
    log: Log
    asked: Asked
    clock: TrustClock
    book: TrustBook
    host_trusted: bool = True

    def restart(self, floors: Floors | None = None, time_floor_ms: int = 0, host: HostClocks | None = None) -> Device:
        """Return the device after a start that finds this folder and, in the log, these floors."""
        again = device(self.folder, host or self.host, host_trusted=self.host_trusted)
        again.book.resume(floors or Floors({}), time_floor_ms)
        return again


def device(folder: Path, host: HostClocks | None = None, *, host_trusted: bool = True) -> Device:
    """Return wasp-01 in a folder of its own."""
    if not folder.exists():
        shutil.copytree(people().wasp.folder, folder)
    host, log, asked = host or HostClocks(), Log(), Asked()
    clock = TrustClock(host, host_trusted=host_trusted, random=seeded(5))
    book = TrustBook(load_identity(folder), clock, record=log, fetch=asked)
    log.book = book
    return Device(folder, host, log, asked, clock, book, host_trusted)
