"""What can be judged of an envelope without any secret: its shape, its header, whose it is and whether it is old.

The steps that parse are shared with the node's gate. `KeylessGate` is a relay's: the same order up to revocation, then
what a relay may decide on the signed cleartext. It never opens anything, for it could not.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, NoReturn, TypeVar

from google.protobuf.message import DecodeError, Message

from autopilot.trust import limits
from autopilot.trust.clock import Clock, wall_ms
from autopilot.trust.documents import (
    DocumentError,
    DocumentUnsigned,
    Revocations,
    Trust,
    is_canonical,
    verify_token,
)
from autopilot.trust.envelope import VERSION, MessageType, ciphertext_limit, envelope_limit, signature_input
from autopilot.trust.keys import SignatureInvalid, digest, key_id, verify
from autopilot.trust.window import ReplayWindow, TokenBucket
from events.schema.waypoint_pb2 import AuthEnvelope, EnvelopeHeader, IdentityToken, PrincipalKind

M = TypeVar("M", bound=Message)

DEVICES_MAX: Final = 256  # buckets kept; only a device whose signature held has one
RELAY_REASONS: Final = (
    *("rate", "size", "parse_env", "noncanonical_env", "shape", "version", "parse_hdr", "noncanonical_hdr", "type"),
    *("route", "deployment", "ttl", "clock_future", "clock_stale", "replay"),
    *("token_digest", "parse_token", "token_sig", "token_binding", "token_kind", "token_expired", "policy_old"),
    *("classification", "device_sig", "revoked", "owner", "device_rate", "window_full", "internal"),
)


class Drop(Exception):
    """Leaves a gate for the counter that it names."""


def drop(reason: str) -> NoReturn:
    """Leave the gate for the counter `reason`. Raises Drop."""
    raise Drop(reason)


def parsed(message: type[M], data: bytes, part: str) -> M:
    """Parse one part of an envelope strictly. Raises Drop."""
    made = message()
    try:
        made.ParseFromString(data)
    except DecodeError:
        drop(f"parse_{part}")
    if not is_canonical(made, data):
        drop(f"noncanonical_{part}")
    return made


def container(payload: bytes, message_type: MessageType) -> AuthEnvelope:
    """Take the container apart and check the length of each part. Raises Drop."""
    if not limits.ENVELOPE_BYTES_MIN <= len(payload) <= envelope_limit(message_type):
        drop("size")
    envelope = parsed(AuthEnvelope, payload, "env")
    if not 0 < len(envelope.header) <= limits.HEADER_BYTES_MAX:
        drop("shape")
    if not 0 < len(envelope.token) <= limits.TOKEN_BYTES_MAX:
        drop("shape")
    if not limits.TAG_BYTES < len(envelope.ciphertext) <= ciphertext_limit(message_type):
        drop("shape")
    if len(envelope.device_signature) != limits.SIGNATURE_BYTES:
        drop("shape")
    if envelope.v != VERSION:
        drop("version")
    return envelope


def header_of(envelope: AuthEnvelope, message_type: MessageType) -> EnvelopeHeader:
    """Parse the header and check its type and the length of each field. Raises Drop."""
    header = parsed(EnvelopeHeader, envelope.header, "hdr")
    if header.type != message_type:
        drop("type")
    lengths = (
        (len(header.device_key_id), limits.KEY_ID_BYTES),
        (len(header.token_digest), limits.KEY_BYTES),
        (len(header.nonce), limits.NONCE_BYTES),
        (len(header.body_commitment), limits.KEY_BYTES),
    )
    if any(length != wanted for length, wanted in lengths) or len(header.in_reply_to) not in (0, limits.KEY_BYTES):
        drop("shape")
    if int.from_bytes(header.nonce[:8], "little") != header.seq or len(header.node_challenge) not in (0, 16):
        drop("shape")
    texts = (header.key_expr, header.owner_principal_id, header.deployment_id)
    if any(len(text) > limits.TEXT_CHARACTERS_MAX for text in texts):
        drop("shape")
    return header


@dataclass(slots=True)
class Passage:
    """Received = passed + the sum of `dropped`, after every message."""

    received: int = 0
    passed: int = 0
    dropped: dict[str, int] = field(default_factory=lambda: dict.fromkeys(RELAY_REASONS, 0))

    def copy(self) -> Passage:
        """Return a copy that no longer changes."""
        return Passage(self.received, self.passed, dict(self.dropped))


@dataclass(frozen=True, slots=True, kw_only=True)
class Rates:
    """How much is judged, and how much of it one device may send. Samples a second, and at once."""

    samples_per_s: float
    samples_burst: int
    device_per_s: float
    device_burst: int


class KeylessGate:
    """Judges messages of one type as a relay does, in this order; each step has its own counters.

    1.  rate: what the processor can verify; whoever pays for it is not known yet       rate
    2.  size, then the container                            size parse_env noncanonical_env shape version
    3.  header                                              parse_hdr noncanonical_hdr type shape
    4.  route: signed key is the key it came on, and one that is relayed                route deployment
    5.  clock                                               ttl clock_future clock_stale
    6.  nonce not seen yet (a look, nothing is written)     replay
    7.  token: digest, then cache or the Directory's signature      token_digest parse_token token_sig
    8.  token and header belong together                    token_binding token_kind token_expired policy_old
                                                            classification
    9.  the device's signature                              device_sig
    10. revocation of principal, device key and token       revoked
    11. the relay's own gate on the signed cleartext        owner classification
    12. the bucket of the device, which has signed for it   device_rate
    13. the nonce is remembered; a full window refuses      window_full

    Only here, behind the signature, does anything grow: buckets and the window. The first bucket stands before it and
    takes real and forged alike, so it must be as wide as the processor allows, not as narrow as people order.
    Anything unforeseen is `internal`.
    """

    def __init__(
        self,
        trust: Trust,
        revocations: Callable[[], Revocations],
        message_type: MessageType,
        *,
        kinds: frozenset[PrincipalKind.ValueType],
        is_ours: Callable[[str], bool],
        admits: Callable[[EnvelopeHeader, IdentityToken], str],
        clock: Clock,
        rates: Rates,
    ) -> None:
        """Make a gate. `revocations` gives the newest list; `admits` gives a reason to drop, or nothing."""
        self._trust, self._revocations, self._type = trust, revocations, message_type
        self._kinds, self._is_ours, self._admits = kinds, is_ours, admits
        self._clock, self._rates = clock, rates
        self._bucket = TokenBucket(rates.samples_per_s, rates.samples_burst)
        self._devices: OrderedDict[bytes, TokenBucket] = OrderedDict()
        self._window = ReplayWindow()
        self._tokens: OrderedDict[bytes, IdentityToken] = OrderedDict()
        self._passage = Passage()
        self._lock = threading.Lock()

    def passage(self) -> Passage:
        """Return a copy of the counts; safe from any thread."""
        with self._lock:
            return self._passage.copy()

    def judge(self, key_expr: str, payload: bytes) -> str:
        """Judge one message: empty when it may pass, else why not. Never raises; counts it exactly once."""
        with self._lock:
            because = self._judged(key_expr, payload)
            self._passage.received += 1
            if because:
                self._passage.dropped[because] += 1
            else:
                self._passage.passed += 1
            return because

    def _judged(self, key_expr: str, payload: bytes) -> str:
        try:
            self._check(key_expr, payload)
        except Drop as dropped:
            return str(dropped)
        except Exception:  # noqa: BLE001 - the boundary: nobody's odd input may stop the relay
            return "internal"
        return ""

    def _check(self, key_expr: str, payload: bytes) -> None:
        now_ms = wall_ms(self._clock)
        # 1. Rate.
        if not self._bucket.take(self._clock.mono_ns()):
            drop("rate")
        # 2. Container.
        envelope = container(payload, self._type)
        # 3. Header.
        header = header_of(envelope, self._type)
        # 4. Route.
        if header.key_expr != key_expr or not self._is_ours(key_expr):
            drop("route")
        if header.deployment_id != self._trust.deployment_id:
            drop("deployment")
        # 5. Clock.
        _check_clock(header, now_ms)
        # 6. Nonce, read only.
        if self._window.seen(header.device_key_id, header.nonce):
            drop("replay")
        # 7. Token.
        token = self._token(header, envelope.token)
        # 8. Token and header.
        revocations = self._revocations()
        self._check_binding(header, token, now_ms, revocations)
        # 9. Device signature.
        signed = signature_input(envelope.header, envelope.token, envelope.ciphertext)
        try:
            verify(token.device_sign_pk, signed, envelope.device_signature)
        except SignatureInvalid:
            drop("device_sig")
        # 10. Revocation.
        if revocations.covers(token):
            drop("revoked")
        # 11. The relay's own gate.
        if because := self._admits(header, token):
            drop(because)
        # 12. The device's bucket.
        if not self._bucket_of(header.device_key_id).take(self._clock.mono_ns()):
            drop("device_rate")
        # 13. Remember the nonce.
        if not self._window.has_room(header.device_key_id, now_ms):
            drop("window_full")
        issued_ms = now_ms if _is_undated(header) else header.issued_at_ms
        forget_ms = issued_ms + header.ttl_ms + 2 * limits.SKEW_MS
        self._window.insert(header.device_key_id, header.nonce, forget_ms)

    def _token(self, header: EnvelopeHeader, data: bytes) -> IdentityToken:
        if digest(data) != header.token_digest:
            drop("token_digest")
        token = self._tokens.get(header.token_digest)
        if token is not None:
            self._tokens.move_to_end(header.token_digest)
            return token
        try:
            token = verify_token(data, self._trust)
        except DocumentUnsigned:
            drop("token_sig")
        except DocumentError:
            drop("parse_token")
        self._tokens[header.token_digest] = token
        if len(self._tokens) > limits.TOKEN_CACHE:
            self._tokens.popitem(last=False)
        return token

    def _check_binding(
        self, header: EnvelopeHeader, token: IdentityToken, now_ms: int, revocations: Revocations
    ) -> None:
        if header.device_key_id != key_id(token.device_sign_pk):
            drop("token_binding")
        if header.owner_principal_id not in ("", token.principal_id):
            drop("token_binding")
        if token.kind not in self._kinds:
            drop("token_kind")
        if not token.not_before_ms - limits.SKEW_MS <= now_ms <= token.not_after_ms:
            drop("token_expired")
        if token.policy_version < revocations.min_policy_version:
            drop("policy_old")
        if header.classification > token.max_classification:
            drop("classification")

    def _bucket_of(self, device_key_id: bytes) -> TokenBucket:
        bucket = self._devices.pop(device_key_id, None)
        if bucket is None:
            bucket = TokenBucket(self._rates.device_per_s, self._rates.device_burst)
        self._devices[device_key_id] = bucket
        if len(self._devices) > DEVICES_MAX:
            self._devices.popitem(last=False)
        return bucket


def _check_clock(header: EnvelopeHeader, now_ms: int) -> None:
    if not 0 < header.ttl_ms <= limits.TTL_MS_MAX:
        drop("ttl")
    if _is_undated(header):
        return
    if header.issued_at_ms > now_ms + limits.SKEW_MS:
        drop("clock_future")
    if now_ms > header.issued_at_ms + header.ttl_ms + limits.SKEW_MS:
        drop("clock_stale")


def _is_undated(header: EnvelopeHeader) -> bool:
    """Whether it is the answer or status of a node that does not know what time it is: its reader judges that."""
    return header.type in (MessageType.ACK, MessageType.STATUS) and not header.HasField("issued_at_ms")
