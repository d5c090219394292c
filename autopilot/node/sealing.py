"""Sealing: signed checkpoints over an open flight's log, by a key that lives as long as the flight (design, section 4).

The key is made when the flight begins, certified by the device's key, kept beside the log while the flight is open,
and erased when it is closed: whoever takes the disk afterwards can sign no other past with it. What is durable is
signed, what is signed is stored, and what is stored is published, in this order. A log that is not what was signed
before is never signed again. When a flight begins and ends is decided in `flights`; all calls are on the node's thread.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from autopilot.node.cosigned import Cosigned
from autopilot.ports.edges import Clock
from autopilot.trust.cosignatures import parted
from autopilot.trust.identity import ROOT_FILE, TOKEN_FILE, Identity
from autopilot.trust.keys import SecretFileError, SignKey, read_secret, write_file
from autopilot.trust.limits import KEY_BYTES
from autopilot.trust.notes import (
    Checkpoint,
    LogKey,
    NoteInvalid,
    StateMark,
    open_note,
    read_checkpoint,
    read_log_key,
    sign_note,
    signed_checkpoint,
)
from events.store import Appender, Flight, Reader, StoreFailed
from events.tree import Peaks
from statecharts import State
from statecharts.codec import LAYOUT
from statecharts.digest import Rows, StateDigest

KEY_FILE, CERTIFICATE_FILE = "log_key", "log_key.note"
# Signed at the latest after so many records or so long, whichever comes first: the stretch that nobody vouches for.
EVERY_RECORDS = 1000
EVERY_NS = 10_000_000_000


class Known(NamedTuple):
    """What is known of a log without reading it whole: of its first records, and of the state that they lead to."""

    size: int
    peaks: tuple[bytes, ...]
    digest: StateDigest  # follows the state, which may have gone on since


class Sealed(NamedTuple):
    """What a checkpoint was signed over."""

    size: int
    leaf: bytes
    peaks: tuple[bytes, ...]
    rows: Rows  # of the state that changed since the checkpoint before


class Sealer:
    """Opens the seals of one node's flights."""

    def __init__(self, identity: Identity, clock: Clock, random_bytes: Callable[[int], bytes] = os.urandom) -> None:
        self._identity = identity
        self._clock = clock
        self._random = random_bytes

    def open(self, flight: Flight, store: Appender, state: State, known: Known | None = None) -> Sealing:
        """Return the seal of an open flight, with the key that it has or with a fresh one. Raises StoreFailed.

        `state` is that after everything in the log, whenever it is sealed.
        """
        return self._sealing(flight, store, self._known(flight, store) or self._fresh(flight, store), state, known)

    def reopen(self, flight: Flight, store: Appender, state: State, known: Known | None = None) -> Sealing | None:
        """Return the seal of a flight that is only to be closed; None where it has no key any more."""
        key = self._known(flight, store)
        return None if key is None else self._sealing(flight, store, key, state, known)

    def signed(self, flight: Flight, reader: Reader, size: int) -> Checkpoint | None:
        """Return the checkpoint over `size` records that the certified log key signed; None where there is none."""
        signer = f"waypoint/{self._identity.deployment_id}/{self._identity.principal_id}"
        try:
            certificate = (flight.folder / CERTIFICATE_FILE).read_text("utf-8")
            note = dict(reader.checkpoints()).get(size, "")
            log_key, checkpoint = signed_checkpoint(certificate, note, signer, self._identity.public_key)
        except (OSError, UnicodeDecodeError, NoteInvalid):
            return None
        return checkpoint if (log_key.flight_id, checkpoint.size) == (reader.flight_id, size) else None

    def _sealing(self, flight: Flight, store: Appender, key: SignKey, state: State, known: Known | None) -> Sealing:
        certified = self._certificate(flight, store, key)
        note = sign_note(certified.text(), certified.signer, self._identity.sign_key)
        known = known or Known(0, (), StateDigest(state))
        return Sealing(flight.folder, store, key, certified.origin, note, self._clock, state, known)

    def _certificate(self, flight: Flight, store: Appender, key: SignKey) -> LogKey:
        return LogKey(
            deployment_id=self._identity.deployment_id,
            node=self._identity.principal_id,
            flight_number=flight.number,
            flight_id=store.flight_id,
            public_key=key.public,
        )

    def _known(self, flight: Flight, store: Appender) -> SignKey | None:
        """Return the key that lies beside the log, where it can be used and its certificate is ours."""
        try:
            key = SignKey.from_seed(read_secret(flight.folder / KEY_FILE))
            note = (flight.folder / CERTIFICATE_FILE).read_text("utf-8")
            certified = self._certificate(flight, store, key)
            found = read_log_key(open_note(note, certified.signer, self._identity.public_key))
        except (SecretFileError, OSError, NoteInvalid, UnicodeDecodeError):
            return None
        return key if found == certified else None

    def _fresh(self, flight: Flight, store: Appender) -> SignKey:
        """Make the only key that there is, certify it, and lay beside the log what a stranger needs to judge it."""
        for left in flight.folder.parent.glob(
            f"*/{KEY_FILE}"
        ):  # of a flight that could not be closed: its log is damaged
            _erase(left)
        key = SignKey.from_seed(self._random(KEY_BYTES))
        certified = self._certificate(flight, store, key)
        note = sign_note(certified.text(), certified.signer, self._identity.sign_key)
        try:
            write_file(flight.folder / KEY_FILE, key.seed, secret=True)
            write_file(flight.folder / CERTIFICATE_FILE, note.encode())
            write_file(flight.folder / TOKEN_FILE, self._identity.token_bytes)
            write_file(flight.folder / ROOT_FILE, (self._identity.folder / ROOT_FILE).read_bytes())
        except OSError as error:
            raise StoreFailed(f"the log's key can't be laid beside it: {error}") from error
        return key


class Sealing:
    """The seal of one open flight."""

    def __init__(
        self,
        folder: Path,
        store: Appender,
        key: SignKey,
        origin: str,
        certificate: str,
        clock: Clock,
        state: State,
        known: Known,
    ) -> None:
        self._folder = folder
        self._store = store
        self._key = key
        self._clock = clock
        self._origin = origin
        self._state = state
        self._digest = known.digest
        self._peaks = Peaks(known.size, known.peaks)
        self._sealed = 0  # records under the newest checkpoint
        self._sealed_mono_ns: int | None = None  # None: not yet since this start
        self._armed = False
        self.certificate = certificate
        self.cosigned = Cosigned(origin, key.public, store, clock)
        self.on_sealed: Callable[[Sealed], None] = _nothing
        self.newest = ""  # the newest checkpoint that is stored, as a note; read from other threads
        self.refusal = self._resume()

    def turn(self, *, armed: bool, flight_ns: int) -> None:
        """Sign what is durable where it is time: often enough, and when the vehicle arms or disarms.

        Raises StoreFailed.
        """
        last_ns, now_ns = self._sealed_mono_ns, self._clock.mono_ns()
        grown = self._store.head.seq + 1 - self._sealed
        if last_ns is None or now_ns - last_ns >= EVERY_NS or grown >= EVERY_RECORDS or armed != self._armed:
            self._armed, self._sealed_mono_ns = armed, now_ns
            self.seal(flight_ns)

    def seal(self, flight_ns: int) -> None:
        """Sign what is durable now, store that, and let it be published. Raises StoreFailed."""
        rows = self._digest.advance()
        if self.refusal:
            return
        head = self._store.head
        self._advance(head.seq + 1)
        size = self._peaks.size
        assert self._state.next_seq.value == size, "the state is not that of what is durable"
        root, state = self._peaks.root(), StateMark(LAYOUT, self._digest.value)
        text = Checkpoint(self._origin, size, root, flight_ns, state).text()
        note = sign_note(text, self._origin, self._key)
        self._store.add_checkpoint(size, note)
        self.cosigned.signed(size, root)
        self._sealed, self.newest = size, note
        self.on_sealed(Sealed(size, head.leaf, self._peaks.peaks, rows))

    def close(self, flight_ns: int) -> None:
        """Sign the whole flight and erase the key. Raises StoreFailed."""
        self.seal(flight_ns)
        _erase(self._folder / KEY_FILE)

    def _resume(self) -> str:
        """Go on from the newest checkpoint; return why the log can't be its continuation, "" where it is."""
        stored = self._store.checkpoints()
        if not stored:
            return ""
        size, note = stored[-1]
        durable = self._store.head.seq + 1
        if durable < size:
            return f"{size} records were signed, and the log holds {durable}"
        try:
            text, bare, _ = parted(note)
            signed = read_checkpoint(text)
        except NoteInvalid as error:
            return f"the checkpoint over {size} records can't be read: {error}"
        self._advance(size)
        if (signed.origin, signed.size, signed.root) != (self._origin, size, self._peaks.root()):
            return f"the first {size} records are not those that were signed"
        self._sealed, self.newest = size, bare
        self.cosigned.resume(size, signed.root, note)
        return ""

    def _advance(self, size: int) -> None:
        for stored in self._store.stored(self._peaks.size, size):
            self._peaks.append(stored.leaf)


def _nothing(_sealed: Sealed) -> None:
    pass


def _erase(path: Path) -> None:
    """Overwrite and remove a key. Flash may keep the old block all the same. Raises StoreFailed."""
    try:
        with path.open("r+b") as file:
            file.write(bytes(KEY_BYTES))
            file.flush()
            os.fsync(file.fileno())
        path.unlink()
    except FileNotFoundError:
        return
    except OSError as error:
        raise StoreFailed(f"{path}: the key of a log can't be erased: {error}") from error
