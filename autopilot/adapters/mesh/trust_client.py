"""Fetches documents from a Directory over the mesh, and takes what it publishes; the book of trust judges all of it.

Nothing is believed here: anybody on the mesh may answer and publish. What comes is bounded in size, number and rate,
and offered on a thread of this file's, for taking a document may write to the disk. The time is asked for on a
thread of its own, so that no other question delays it.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable
from typing import Final

from google.protobuf.message import DecodeError

from autopilot.adapters.mesh.lane import Lane
from autopilot.adapters.mesh.link import Wire
from autopilot.trust.clock import Clock
from autopilot.trust.documents import is_canonical
from autopilot.trust.fetching import Offer, What
from autopilot.trust.limits import CHALLENGE_BYTES, DOCUMENT_BYTES_MAX
from autopilot.trust.window import TokenBucket
from autopilot.wire import keys
from autopilot.wire.directory_pb2 import Documents
from autopilot.wire.keys import bundle_key, trust_key

TIMEOUT_S: Final = 2.0  # a journey over a radio link and back, and a commit there
DOCUMENTS_MAX: Final = 4  # in one answer: bundles in use and next, and room
# Documents taken a second and at once: each costs a signature's verification, and a change is rare.
TAKEN_PER_S, TAKEN_BURST = 5.0, 20

_CHANNELS: Final = {
    "trust_root": keys.TRUST_ROOTS,
    "revocations": keys.REVOCATIONS,
    "epoch": keys.EPOCHS,
    "time": keys.TIMES,
}


class TrustClient:
    """A `Fetch` over a link that somebody else starts and stops."""

    def __init__(
        self,
        wire: Wire,
        clock: Clock,
        offer: Offer,
        *,
        deployment_id: str,
        device_key_id: bytes,
        timeout_s: float = TIMEOUT_S,
    ) -> None:
        """Fetch for one device. The link must take answers of DOCUMENT_BYTES_MAX."""
        self._wire, self._clock, self._offer = wire, clock, offer
        self._deployment_id, self._device_key_id = deployment_id, device_key_id
        self._timeout_s = timeout_s
        self._bucket = TokenBucket(TAKEN_PER_S, TAKEN_BURST)
        self._lock = threading.Lock()
        self._counts: Counter[str] = Counter()
        self._lanes = {name: Lane(f"trust-{name}") for name in ("documents", "time")}

    def start(self) -> None:
        """Begin to take what is published and to ask; returns at once."""
        for what, key in self._published().items():
            self._wire.subscribe(key, self._receiver(what))
        for lane in self._lanes.values():
            lane.start()

    def stop(self) -> None:
        """Stop asking and offering."""
        for lane in self._lanes.values():
            lane.stop(self._timeout_s)

    def request(self, what: What, challenge: bytes | None = None) -> None:
        """Begin to fetch `what`. Any thread; never blocks, never raises."""
        if (what == "time") != (challenge is not None and len(challenge) == CHALLENGE_BYTES):
            self._count(what, "unasked")
            return
        lane = self._lanes["time" if what == "time" else "documents"]
        if not lane.put(lambda: self._fetch(what, challenge)):
            self._count(what, "busy")

    def counts(self) -> Counter[str]:
        """Return what became of questions and documents since start, by kind."""
        with self._lock:
            return Counter(self._counts)

    def _published(self) -> dict[What, str]:
        return {
            "trust_root": trust_key(keys.TRUST_ROOTS, self._deployment_id),
            "revocations": trust_key(keys.REVOCATIONS, self._deployment_id),
            "epoch": bundle_key(self._deployment_id, self._device_key_id),
        }

    def _receiver(self, what: What) -> Callable[[str, bytes], None]:
        def receive(_key: str, payload: bytes) -> None:
            if not self._lanes["documents"].put(lambda: self._give(what, payload)):
                self._count(what, "busy")

        return receive

    def _fetch(self, what: What, challenge: bytes | None) -> None:
        question = challenge or (self._device_key_id if what == "epoch" else b"")
        answers = self._wire.ask(trust_key(_CHANNELS[what], self._deployment_id), question, self._timeout_s)
        if not answers:
            self._count(what, "unanswered")
        for answer in answers:
            for document in self._parts(answer) if what == "epoch" else [answer]:
                self._give(what, document)

    def _give(self, what: What, document: bytes) -> None:
        if len(document) > DOCUMENT_BYTES_MAX:
            self._count(what, "size")
        elif not self._bucket_takes():
            self._count(what, "rate")
        else:
            self._count(what, self._offer(what, document).value)

    def _parts(self, answer: bytes) -> list[bytes]:
        found = Documents()
        try:
            found.ParseFromString(answer)
        except DecodeError:
            self._count("epoch", "malformed")
            return []
        if not is_canonical(found, answer) or len(found.documents) > DOCUMENTS_MAX:
            self._count("epoch", "malformed")
            return []
        return list(found.documents)

    def _bucket_takes(self) -> bool:
        with self._lock:
            return self._bucket.take(self._clock.mono_ns())

    def _count(self, what: What, word: str) -> None:
        with self._lock:
            self._counts[f"{what}: {word}"] += 1
