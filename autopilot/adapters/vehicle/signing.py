"""MAVLink 2 signing of one link: what is sent is signed, and nothing is taken that is not.

Signature (MAVLink guide, "Message Signing"): link id, 48 bits of time in 10 us since 2015, 6 bytes of
SHA-256(key || frame || link id || time). A frame is judged in this order, and nothing is remembered of one that fails:

1.  it is signed                                            else "unsigned"
2.  its signature is this key's                             else "bad signature"
3.  its time is later than the last of its stream (system, component, link), or, of a new stream, not more than a minute
    older than the latest time that this link has verified or the clock is sure of              else "old signature"

A forged frame with a time far ahead so changes nothing. The clock counts with what it is sure of (`earliest`): GPS
moves no signing time of ours (ArduPilot #13860). Times that are sent strictly rise, also over a restart: the file
beside the key names a time that was never reached, kept a step ahead. What it stops are strays: the key is shared, and
48 bits are no proof to anybody else.
"""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Callable
from pathlib import Path
from typing import Final

from autopilot.adapters.vehicle.frames import SIGNATURE_BYTES, as_signed, is_signed
from autopilot.trust.keys import SecretFileError, read_secret, sync_folder, write_file

KEY_BYTES: Final = 32
EPOCH_MS: Final = 1_420_070_400_000  # 2015-01-01
TICKS_PER_MS: Final = 100
TICKS_MAX: Final = (1 << 48) - 1
MINUTE: Final = 60_000 * TICKS_PER_MS
AHEAD: Final = 2 * MINUTE  # so far is the kept time ahead of what is sent; it is kept again when half is used up
STREAMS_MAX: Final = 64  # more senders with this key than any vehicle has
LINK_ID: Final = 0


class SigningKeyError(Exception):
    """The key can't be used; the text names the file and the reason."""


def read_key(path: Path) -> bytes:
    """Return the link's key, 32 bytes. Raises SigningKeyError where there is none, or others may read it."""
    try:
        return read_secret(path, KEY_BYTES)
    except SecretFileError as error:
        raise SigningKeyError(str(error).partition(";")[0]) from error


class Kept:
    """The times that outlive this process, in a file beside the key: `NAME.time`, two numbers in ticks of 10 us."""

    def __init__(self, key_file: Path) -> None:
        self._path = key_file.with_name(key_file.name + ".time")

    def read(self) -> tuple[int, int]:
        """Return what was kept: the time ahead of all that was sent, the latest that was verified; 0 for none.

        Raises SigningKeyError where it can't be read: going on without would send times again.
        """
        try:
            sent, heard = self._path.read_text("ascii").split()
            return int(sent), int(heard)
        except FileNotFoundError:
            return 0, 0
        except (OSError, ValueError) as error:
            raise SigningKeyError(f"{self._path}: can't be read ({error}); times sent before are not known") from error

    def write(self, sent: int, heard: int) -> None:
        """Keep times, durably. Raises OSError."""
        write_file(self._path, f"{sent} {heard}\n".encode("ascii"), secret=True)
        sync_folder(self._path.parent)


class Signing:
    """Signs and verifies the frames of one link."""

    def __init__(self, key: bytes, kept: Kept, earliest_ms: Callable[[], int]) -> None:
        """Begin where `kept` ends; `earliest_ms` tells what the present is not before. Raises SigningKeyError."""
        self._key = key
        self.kept = kept
        self._sent, self._heard = kept.read()
        self._earliest_ms = earliest_ms
        self._ahead = 0  # what is kept now
        self._streams: dict[tuple[int, int, int], int] = {}

    def sign(self, frame: bytes) -> bytes:
        """Return an unsigned frame with its signature, at a time that was never used."""
        self._sent = min(max(self._sent + 1, self._heard, self._now()), TICKS_MAX)
        signed = as_signed(frame) + bytes([LINK_ID]) + self._sent.to_bytes(6, "little")
        return signed + self._mac(signed)

    def admit(self, frame: bytes) -> str:
        """Judge a whole frame; return "", or the name of what is wrong with it."""
        if not is_signed(frame):
            return "unsigned"
        if not hmac.compare_digest(self._mac(frame[:-6]), frame[-6:]):
            return "bad signature"
        link_id, at = frame[-SIGNATURE_BYTES], int.from_bytes(frame[-12:-6], "little")
        stream = (frame[5], frame[6], link_id)
        latest = self._streams.get(stream)
        if latest is None:
            if at < max(self._heard, self._now()) - MINUTE:
                return "old signature"
            if len(self._streams) >= STREAMS_MAX:
                return "too many signers"
        elif at <= latest:
            return "old signature"
        self._streams[stream] = at
        self._heard = max(self._heard, at)
        return ""

    def to_keep(self) -> tuple[int, int] | None:
        """Return the times that are to be kept before more is sent, or None while what is kept is far enough ahead."""
        reached = max(self._sent, self._heard, self._now())
        if self._ahead - reached >= AHEAD // 2:
            return None
        self._ahead = reached + AHEAD
        return self._ahead, self._heard

    def _now(self) -> int:
        return max(0, self._earliest_ms() - EPOCH_MS) * TICKS_PER_MS

    def _mac(self, signed: bytes) -> bytes:
        return hashlib.sha256(self._key + signed).digest()[:6]


def open_signing(key_file: Path, earliest_ms: Callable[[], int]) -> Signing:
    """Return the signing of a link by its key, its times kept ahead. Raises SigningKeyError: then nothing may start."""
    signing = Signing(read_key(key_file), Kept(key_file), earliest_ms)
    try:
        if (times := signing.to_keep()) is not None:
            signing.kept.write(*times)
    except OSError as error:
        raise SigningKeyError(f"{key_file}: its times can't be kept beside it ({error.strerror})") from error
    return signing
