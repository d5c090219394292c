"""What a running Directory answers, and to whom not: bounded in rate and size, counted, and it never raises.

Everything it says is signed or under an enrolment code, and the only secrets in it are wrapped for one device, so
anybody may ask. It needs the keys for token, epoch and time; never the root's, nor the one for revocations.
"""

from __future__ import annotations

import os
import threading
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Final

from autopilot.ground import directory_changes as changes
from autopilot.ground import enrolment_desk
from autopilot.ground.directory_folders import node_tokens
from autopilot.ground.directory_papers import Directory, open_directory, signed_beacon, signed_bundle, signed_token
from autopilot.ground.directory_store import STATE_FILE
from autopilot.ground.enrolment import REQUEST_BYTES_MAX
from autopilot.ground.renewal import check_renewal, read_renewal
from autopilot.trust.clock import Clock, wall_ms
from autopilot.trust.documents import DocumentError
from autopilot.trust.keys import Random, key_id
from autopilot.trust.limits import CHALLENGE_BYTES, KEY_ID_BYTES
from autopilot.trust.window import TokenBucket
from autopilot.wire import keys
from autopilot.wire.directory_pb2 import Documents
from autopilot.wire.keys import Channel
from events.schema.waypoint_pb2 import IdentityToken

NEEDS: Final = ("epoch", "time", "token")
RENEWAL_BYTES_MAX: Final = 256  # a request has near 170

# Answers a second and at once. A fleet that wakes up asks each kind once a device; enrolling is done by hand, and a
# renewal costs a commit to the disk.
RATES: Final[dict[str, tuple[float, int]]] = {
    keys.TRUST_ROOTS.name: (20.0, 100),
    keys.REVOCATIONS.name: (20.0, 100),
    keys.EPOCHS.name: (20.0, 100),
    keys.TIMES.name: (50.0, 100),
    keys.NODES.name: (5.0, 50),
    keys.RENEWALS.name: (5.0, 50),
    keys.ENROLMENTS.name: (1.0, 5),
}
# Lengths of a question, in bytes: at least and at most.
SIZES: Final[dict[str, tuple[int, int]]] = {
    keys.TRUST_ROOTS.name: (0, 0),
    keys.REVOCATIONS.name: (0, 0),
    keys.NODES.name: (0, 0),
    keys.EPOCHS.name: (KEY_ID_BYTES, KEY_ID_BYTES),
    keys.TIMES.name: (CHALLENGE_BYTES, CHALLENGE_BYTES),
    keys.RENEWALS.name: (1, RENEWAL_BYTES_MAX),
    keys.ENROLMENTS.name: (1, REQUEST_BYTES_MAX),
}
ASKED: Final = (keys.TRUST_ROOTS, keys.REVOCATIONS, keys.EPOCHS, keys.TIMES, keys.NODES, keys.RENEWALS, keys.ENROLMENTS)
REFUSED: Final = b""  # the answer to an enrolment that is not granted; it is a hint, for anybody could give it


class Desk:
    """Answers questions from a Directory's folder, which commands may change meanwhile."""

    def __init__(self, folder: Path, clock: Clock, random: Random) -> None:
        """Open the folder. Raises DirectoryError, OSError."""
        self._folder, self._clock, self._random = folder, clock, random
        self._lock = threading.Lock()
        self._buckets = {name: TokenBucket(*rate) for name, rate in RATES.items()}
        self._counts: Counter[str] = Counter()
        self._bundles: dict[tuple[int, bytes], bytes] = {}
        self._seen = self._mark()
        self._opened = open_directory(folder, NEEDS)
        self._answers: dict[str, Callable[[Directory, bytes], bytes]] = {
            keys.TRUST_ROOTS.name: lambda directory, _: directory.state.trust_root,
            keys.REVOCATIONS.name: lambda directory, _: directory.state.revocations,
            keys.EPOCHS.name: self._epochs,
            keys.TIMES.name: lambda directory, challenge: signed_beacon(directory, challenge, wall_ms(self._clock)),
            keys.NODES.name: self._nodes,
            keys.RENEWALS.name: self._renewal,
            keys.ENROLMENTS.name: self._enrolment,
        }

    def answer(self, channel: Channel, question: bytes) -> bytes | None:
        """Return the answer, or None where there is none. Any thread; never raises."""
        with self._lock:
            try:
                answered, word = self._judged(channel.name, question)
            except enrolment_desk.Refused as error:
                answered, word = REFUSED, str(error)
            except DocumentError:
                answered, word = None, "unreadable"
            except Exception:  # noqa: BLE001 - the boundary of a callback: the disk, or a command's half-known change
                answered, word = None, "failed"
            self._counts[f"{channel.name}: {word}"] += 1
        return answered

    def count(self, channel: Channel, word: str) -> None:
        """Count a question that never came to the desk. Any thread."""
        with self._lock:
            self._counts[f"{channel.name}: {word}"] += 1

    def counts(self) -> Counter[str]:
        """Return how many questions were answered and not, since start, by channel and reason."""
        with self._lock:
            return Counter(self._counts)

    def directory(self) -> Directory:
        """Return the Directory as it is now. Raises DirectoryError, OSError."""
        with self._lock:
            return self._current()

    def bundles(self, directory: Directory, token: IdentityToken, now_ms: int) -> list[bytes]:
        """Return a device's bundles, in use and next. Raises DirectoryError."""
        first = directory.epoch_at(now_ms).epoch_id
        found = []
        for epoch in directory.state.epochs:
            if epoch.epoch_id >= first:
                place = (epoch.epoch_id, key_id(token.device_sign_pk))
                if place not in self._bundles:
                    self._bundles[place] = signed_bundle(directory, epoch, token)
                found.append(self._bundles[place])
        return found

    def _judged(self, name: str, question: bytes) -> tuple[bytes | None, str]:
        least, most = SIZES[name]
        if not least <= len(question) <= most:
            return None, "size"
        if not self._buckets[name].take(self._clock.mono_ns()):
            return None, "rate"
        return self._answers[name](self._current(), question), "answered"

    def _epochs(self, directory: Directory, device_key_id: bytes) -> bytes:
        token = _live(directory, device_key_id, wall_ms(self._clock))
        return _several(self.bundles(directory, token, wall_ms(self._clock)))

    def _nodes(self, directory: Directory, _: bytes) -> bytes:
        return _several(list(node_tokens(directory, wall_ms(self._clock)).values()))

    def _renewal(self, directory: Directory, question: bytes) -> bytes:
        asked = read_renewal(question)
        now_ms = wall_ms(self._clock)
        token = _live(directory, asked.device_key_id, now_ms)
        check_renewal(question, token)
        if asked.token_id == token.token_id:  # else it was renewed since: a replay, or the answer was lost
            token = changes.renew(self._folder, asked.device_key_id, now_ms, self._random)
        return signed_token(directory, token)

    def _enrolment(self, _directory: Directory, question: bytes) -> bytes:
        return enrolment_desk.admit(self._folder, question, wall_ms(self._clock), self._random)[0]

    def _current(self) -> Directory:
        mark = self._mark()
        if mark != self._seen:
            self._opened = open_directory(self._folder, NEEDS)
            self._seen = mark
            self._bundles.clear()
        return self._opened

    def _mark(self) -> tuple[int, int, int]:
        found = os.stat(self._folder / STATE_FILE)
        return found.st_ino, found.st_size, found.st_mtime_ns


def _live(directory: Directory, device_key_id: bytes, now_ms: int) -> IdentityToken:
    for token in directory.live(now_ms):
        if key_id(token.device_sign_pk) == device_key_id:
            return token
    raise DocumentError("no live device has this key id")


def _several(documents: list[bytes]) -> bytes:
    return Documents(documents=documents).SerializeToString(deterministic=True)
