"""A Directory's documents through a verifying relay: bounded questions go outward, what proves itself comes inward.

A node behind the relay asks as if the Directory were beside it. The relay asks outside in its own name, and gives back
the newest answer that is signed by the key of its purpose under the trust root that it holds. What the Directory
publishes comes in alike. Verified is all that can be without a secret:

| document | asked with | passes where |
|---|---|---|
| TrustRoot | nothing | it follows the root that is held, or is that one |
| RevocationList | nothing | it is not older than the list that is held, nor another of its version |
| EpochBundles | a device's key id | each is for that device, not void by the list, not over |
| TimeBeacon | a challenge | it answers that challenge |

Of a root or list that is newer the relay's own gate makes use as well (`relay_papers`). Enrolment and renewal do not
pass: what answers them is under a code, or concerns nobody but who renews. Nothing is raised or kept on disk here.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Final

from autopilot.adapters.mesh.lane import Lane
from autopilot.adapters.mesh.link import Reply, Wire
from autopilot.adapters.mesh.trust_client import DOCUMENTS_MAX
from autopilot.ground.relay_papers import Judged, Papers, fault
from autopilot.trust.clock import Clock, wall_ms
from autopilot.trust.documents import DocumentError, parse, verify_epoch_bundle, verify_time_beacon
from autopilot.trust.limits import (
    CHALLENGE_BYTES,
    DOCUMENT_BYTES_MAX,
    KEY_BYTES,
    KEY_ID_BYTES,
    OVERLAP_MS,
    SKEW_MS,
    WRAPPED_KEY_BYTES,
)
from autopilot.trust.window import TokenBucket
from autopilot.wire.directory_pb2 import Documents as Several
from autopilot.wire.keys import BUNDLES, EPOCHS, REVOCATIONS, TIMES, TRUST_ROOTS, Channel, trust_key

ASKED: Final = (TRUST_ROOTS, REVOCATIONS, EPOCHS, TIMES)
PUBLISHED: Final = (TRUST_ROOTS, REVOCATIONS, BUNDLES)
QUESTION_BYTES: Final = {TRUST_ROOTS: 0, REVOCATIONS: 0, EPOCHS: KEY_ID_BYTES, TIMES: CHALLENGE_BYTES}
# Bytes of an answer at most: a root of a hundred keys, a full list, four bundles of near 400, a beacon of near 170.
ANSWER_BYTES: Final = {
    TRUST_ROOTS: 16_384,
    REVOCATIONS: DOCUMENT_BYTES_MAX,
    EPOCHS: 8_192,
    BUNDLES: 2_048,
    TIMES: 1_024,
}
# Questions of one kind a second and at once, of all askers together: what a Directory answers of most kinds.
ASKED_PER_S, ASKED_BURST = 20.0, 100
# Documents of one kind that are published: a change is rare, and each costs a verification.
HEARD_PER_S, HEARD_BURST = 20.0, 100
PATIENCE_S: Final = 1.5  # less than the two seconds that a node waits for the relay
STALE_NS: Final = 2_000_000_000  # whoever asked longer ago no longer waits
WAITING_MAX: Final = 64
OWN_EVERY_NS: Final = 60_000_000_000  # the relay itself asks for root and list: nobody inside need have asked

Counts = dict[str, int]
QUESTIONS: Final = ("asked", "answered", "unanswered", "size", "rate", "busy", "late")


class Documents:
    """Passes questions outward and documents inward."""

    def __init__(
        self,
        papers: Papers,
        clock: Clock,
        outer: Wire,
        inner: Wire,
        *,
        give: Callable[[str, bytes], None],
        believe: Callable[[], None],
    ) -> None:
        """Make the passage. `give` puts what is published inside; `believe` is told of a newer trust root."""
        self._papers, self._clock, self._outer, self._inner = papers, clock, outer, inner
        self._give, self._believe = give, believe
        self._asking = {channel: TokenBucket(ASKED_PER_S, ASKED_BURST) for channel in ASKED}
        self._hearing = {channel: TokenBucket(HEARD_PER_S, HEARD_BURST) for channel in PUBLISHED}
        self._lanes = {name: Lane(f"relay-{name}", WAITING_MAX) for name in ("documents", "time")}
        self._own_ns: int | None = None
        self._lock = threading.Lock()
        self._questions: Counter[str] = Counter()
        self._documents: dict[Channel, Counter[str]] = {channel: Counter() for channel in ANSWER_BYTES}

    def start(self) -> None:
        """Begin to answer inside and to hear outside."""
        deployment = self._papers.trust.deployment_id
        for channel in ASKED:
            self._inner.answer(trust_key(channel, deployment), partial(self.ask, channel))
        for channel in PUBLISHED:
            pattern = trust_key(channel, deployment).replace("<device_key_id>", "*")
            self._outer.subscribe(pattern, partial(self.hear, channel))
        for lane in self._lanes.values():
            lane.start()

    def stop(self) -> None:
        """Stop; what waits is forgotten."""
        for lane in self._lanes.values():
            lane.stop(PATIENCE_S + 1)

    def turn(self) -> None:
        """Ask for root and list in the relay's own name, where it is time to."""
        now_ns = self._clock.mono_ns()
        if self._own_ns is None or now_ns - self._own_ns >= OWN_EVERY_NS:
            self._own_ns = now_ns
            for channel in (TRUST_ROOTS, REVOCATIONS):
                self.ask(channel, b"", lambda _: None)

    def ask(self, channel: Channel, question: bytes, reply: Reply) -> None:
        """Take a question from inside, or count why not. Never raises, never waits."""
        came_ns = self._clock.mono_ns()
        if len(question) != QUESTION_BYTES[channel]:
            self._count_question("size")
        elif not self._takes(self._asking[channel], came_ns):
            self._count_question("rate")
        elif self._lane(channel).put(lambda: self._pass(channel, question, reply, came_ns)):
            self._count_question("asked")
        else:
            self._count_question("busy")

    def hear(self, channel: Channel, key_expr: str, payload: bytes) -> None:
        """Take a document that was published outside. Never raises, never waits."""
        if not self._takes(self._hearing[channel], self._clock.mono_ns()):
            self._count(channel, "rate")
        elif not self._lane(channel).put(lambda: self._pass_published(channel, key_expr, payload)):
            self._count(channel, "busy")

    def counts(self) -> dict[str, Counts]:
        """Return what became of questions, and of documents by kind.

        Questions that were asked are answered, unanswered, late, or wait; of documents, received = passed + the rest.
        """
        with self._lock:
            found = {"questions": {name: self._questions[name] for name in QUESTIONS}}
            for channel, counts in self._documents.items():
                received = {"received": counts.total(), "passed": counts["passed"]}
                found[channel.name] = received | {name: count for name, count in sorted(counts.items()) if count}
        return found

    def _pass(self, channel: Channel, question: bytes, reply: Reply, came_ns: int) -> None:
        """Ask outside; give back the newest answer that may pass, the first of several that are alike."""
        if self._clock.mono_ns() - came_ns > STALE_NS:
            self._count_question("late")
            return
        key_expr = trust_key(channel, self._papers.trust.deployment_id)
        best: tuple[int, bytes] | None = None
        for answer in self._outer.ask(key_expr, question, PATIENCE_S):
            judged = self._judged(channel, question, answer)
            if not judged.because and (best is None or judged.version > best[0]):
                best = judged.version, answer
            self._count(channel, judged.because or "passed")
        if best is not None:
            reply(best[1])
        self._count_question("unanswered" if best is None else "answered")

    def _pass_published(self, channel: Channel, key_expr: str, payload: bytes) -> None:
        judged = self._judged(channel, _device_in(key_expr) if channel is BUNDLES else b"", payload)
        self._count(channel, judged.because or "passed")
        if not judged.because:
            self._give(key_expr, payload)

    def _judged(self, channel: Channel, about: bytes, data: bytes) -> Judged:
        """Judge a document by what was asked, or by whom it was published for. Never raises."""
        if len(data) > ANSWER_BYTES[channel]:
            return Judged("size")
        try:
            return self._checked(channel, about, data)
        except Exception:  # noqa: BLE001 - the boundary: nobody's odd input may stop the relay
            return Judged("internal")

    def _checked(self, channel: Channel, about: bytes, data: bytes) -> Judged:
        if channel is TRUST_ROOTS:
            before = self._papers.trust
            judged = self._papers.take_root(data, wall_ms(self._clock))
            if self._papers.trust is not before:
                self._believe()
            return judged
        if channel is REVOCATIONS:
            return self._papers.take_list(data)
        if channel is TIMES:
            return Judged(self._wrong_beacon(about, data))
        if channel is BUNDLES:
            return Judged(self._wrong_bundle(about, data))
        return Judged(self._wrong_bundles(about, data))

    def _wrong_beacon(self, challenge: bytes, data: bytes) -> str:
        try:
            beacon = verify_time_beacon(data, self._papers.trust)
        except DocumentError as error:
            return fault(error, data, self._papers.trust, "time")
        return "" if beacon.challenge == challenge else "unasked"

    def _wrong_bundles(self, device_key_id: bytes, data: bytes) -> str:
        try:
            several = parse(Several, data).documents
        except DocumentError:
            return "malformed"
        if not 0 < len(several) <= DOCUMENTS_MAX:
            return "malformed"
        return next(filter(None, (self._wrong_bundle(device_key_id, one) for one in several)), "")

    def _wrong_bundle(self, device_key_id: bytes, data: bytes) -> str:
        try:
            bundle = verify_epoch_bundle(data, self._papers.trust)
        except DocumentError as error:
            return fault(error, data, self._papers.trust, "epoch")
        if (len(bundle.wrapped_key), len(bundle.key_commitment)) != (WRAPPED_KEY_BYTES, KEY_BYTES):
            return "malformed"
        if bundle.recipient_device_key_id != device_key_id or not device_key_id:
            return "foreign"
        is_over = bundle.retire_at_ms + OVERLAP_MS + SKEW_MS < wall_ms(self._clock)
        return "old" if is_over or bundle.epoch_id < self._papers.revocations().min_epoch_id else ""

    def _lane(self, channel: Channel) -> Lane:
        return self._lanes["time" if channel is TIMES else "documents"]

    def _takes(self, bucket: TokenBucket, now_ns: int) -> bool:
        with self._lock:
            return bucket.take(now_ns)

    def _count(self, channel: Channel, word: str) -> None:
        with self._lock:
            self._documents[channel][word] += 1

    def _count_question(self, word: str) -> None:
        with self._lock:
            self._questions[word] += 1


def _device_in(key_expr: str) -> bytes:
    """Return the device that a bundle is published for; nothing where the key names none."""
    try:
        return bytes.fromhex(key_expr.rpartition("/")[2])
    except ValueError:
        return b""
