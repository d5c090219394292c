"""The gate: what a message must pass before one byte of its content is believed.

It authenticates, opens and decodes. Whether the sender may order what it orders (target, role,
dedup, order sequence) is decided elsewhere, from a record. Nothing here answers a sender.
"""

from __future__ import annotations

import hashlib
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable
from typing import Generic, TypeVar

from autopilot.trust import limits
from autopilot.trust.clock import Clock, wall_ms
from autopilot.trust.documents import (
    DocumentError,
    DocumentMalformed,
    DocumentUnsigned,
    parse,
    verify_token,
)
from autopilot.trust.envelope import (
    MessageType,
    open_sealed,
    sealing_key,
    signature_input,
)
from autopilot.trust.identity import Epoch, Identity
from autopilot.trust.keyless import Drop as _Drop
from autopilot.trust.keyless import container, header_of
from autopilot.trust.keyless import drop as _drop
from autopilot.trust.keys import SealBroken, SignatureInvalid, digest, key_id, verify
from autopilot.trust.tally import Tally
from autopilot.trust.verdict import Malformed, Opened, Rejected, Sealed, Sender, Unreadable
from autopilot.trust.window import ReplayWindow, TokenBucket
from events.schema.waypoint_pb2 import AuthEnvelope, EnvelopeHeader, IdentityToken, PrincipalKind, SealedBody

T = TypeVar("T")


class Gate(Generic[T]):
    """Judges messages of one type, in this order; each step has its own counters.

    1.  rate: the token bucket of the link                                  rate
    2.  size, then the container: strict parse, lengths of its parts        size parse_env noncanonical_env
                                                                            shape version
    3.  header: strict parse, type, lengths                                 parse_hdr noncanonical_hdr type shape
    4.  route: signed key is the key it came on, and one of ours            route deployment
    5.  clock: life within its cap, not from the future, not too old        ttl clock_future clock_stale
    6.  nonce not seen yet (a look, nothing is written)                     replay
    7.  token: digest, then cache or the Directory's signature              token_digest parse_token token_sig
    8.  token and header belong together; kind, validity, policy            token_binding token_kind token_expired
                                                                            policy_old classification
    9.  the device's signature                                              device_sig
    10. revocation of principal, device key and token                       revoked
    11. epoch known and in use                                              unknown_epoch epoch_retired
    12. open, then the header's commitment to the plaintext                 open commitment
    13. the nonce is remembered; a full window refuses                      window_full
    14. decode: sealed body, then the reader's content                      (malformed)

    Steps 1 to 6 cost microseconds and stand before the signature for that reason; verification
    still comes before opening, and opening before decoding (seed 000, Node verification
    pipeline). Nothing that is not authenticated changes a table: the token cache grows after the
    Directory's signature, the window after the open. Anything unforeseen is `internal`.
    """

    def __init__(
        self,
        identity: Identity,
        message_type: MessageType,
        *,
        kinds: frozenset[PrincipalKind.ValueType],
        is_ours: Callable[[str], bool],
        reader: Callable[[Sealed, bytes], T],
        clock: Clock,
        samples_per_s: float = 200,
        samples_burst: int = 50,
    ) -> None:
        """Make a gate.

        `kinds` may sign this type; `is_ours` says whether a key expression is one that this
        receiver listens on; `reader` decodes and checks the content or raises Unreadable.
        """
        self._identity = identity
        self._type = message_type
        self._kinds = kinds
        self._is_ours = is_ours
        self._reader = reader
        self._clock = clock
        self._bucket = TokenBucket(samples_per_s, samples_burst)
        self._window = ReplayWindow()
        self._tokens: OrderedDict[bytes, IdentityToken] = OrderedDict()
        self._tally = Tally()
        self._lock = threading.Lock()

    def tally(self) -> Tally:
        """Return a copy of the counts; safe from any thread."""
        with self._lock:
            return self._tally.copy()

    def restore(self, entries: Iterable[tuple[bytes, bytes, int]]) -> None:
        """Fill the replay window from the log: (device_key_id, nonce, milliseconds that remain)."""
        with self._lock:
            self._window.restore(entries, wall_ms(self._clock))

    def judge(self, key_expr: str, payload: bytes) -> Opened[T] | Malformed | Rejected:
        """Judge one message that arrived on `key_expr`. Never raises; counts it exactly once."""
        with self._lock:
            verdict = self._judged(key_expr, payload)
            self._tally.received += 1
            if isinstance(verdict, Rejected):
                self._tally.rejected[verdict.reason] += 1
            elif isinstance(verdict, Malformed):
                self._tally.malformed += 1
            else:
                self._tally.opened += 1
            return verdict

    def _judged(self, key_expr: str, payload: bytes) -> Opened[T] | Malformed | Rejected:
        try:
            message = self._authenticated(key_expr, payload)
            # 14. Decode.
            try:
                return self._decoded(message)
            except Unreadable as error:
                return Malformed(message, str(error))
        except _Drop as drop:
            return Rejected(str(drop))
        except Exception:  # noqa: BLE001 - the boundary: an insider's odd input must not stop the receiver
            return Rejected("internal")

    def _authenticated(self, key_expr: str, payload: bytes) -> Sealed:
        """Steps 1 to 13."""
        now_ms = wall_ms(self._clock)
        # 1. Rate.
        if not self._bucket.take(self._clock.mono_ns()):
            _drop("rate")
        # 2. Container.
        envelope = container(payload, self._type)
        # 3. Header.
        header = header_of(envelope, self._type)
        # 4. Route.
        if header.key_expr != key_expr or not self._is_ours(key_expr):
            _drop("route")
        if header.deployment_id != self._identity.deployment_id:
            _drop("deployment")
        # 5. Clock.
        self._check_clock(header, now_ms)
        # 6. Nonce, read only.
        if self._window.seen(header.device_key_id, header.nonce):
            _drop("replay")
        # 7. Token.
        token = self._token(header, envelope.token)
        # 8. Token and header.
        self._check_binding(header, token, now_ms)
        # 9. Device signature.
        signed = signature_input(envelope.header, envelope.token, envelope.ciphertext)
        try:
            verify(token.device_sign_pk, signed, envelope.device_signature)
        except SignatureInvalid:
            _drop("device_sig")
        # 10. Revocation.
        if self._identity.revocations.covers(token):
            _drop("revoked")
        # 11. Epoch.
        epoch = self._epoch(header.epoch_id, now_ms)
        # 12. Open.
        plaintext = self._opened(header, envelope, epoch)
        # 13. Remember the nonce.
        if not self._window.has_room(header.device_key_id, now_ms):
            _drop("window_full")
        forget_ms = header.issued_at_ms + header.ttl_ms + 2 * limits.SKEW_MS
        self._window.insert(header.device_key_id, header.nonce, forget_ms)
        return Sealed(
            sender=_sender(token, header.device_key_id),
            key_expr=key_expr,
            nonce=header.nonce,
            issued_at_ms=header.issued_at_ms,
            ttl_ms=header.ttl_ms,
            life_ms=min(header.ttl_ms, max(0, header.issued_at_ms + header.ttl_ms - now_ms)),
            nonce_life_ms=forget_ms - now_ms,
            digest=digest(signed),
            in_reply_to=header.in_reply_to,
            revocation_version=header.revocation_version,
            plaintext=plaintext,
            envelope=payload,
        )

    def _check_clock(self, header: EnvelopeHeader, now_ms: int) -> None:
        if not 0 < header.ttl_ms <= limits.TTL_MS_MAX:
            _drop("ttl")
        if header.issued_at_ms > now_ms + limits.SKEW_MS:
            _drop("clock_future")
        if now_ms > header.issued_at_ms + header.ttl_ms + limits.SKEW_MS:
            _drop("clock_stale")

    def _token(self, header: EnvelopeHeader, data: bytes) -> IdentityToken:
        if digest(data) != header.token_digest:
            _drop("token_digest")
        token = self._tokens.get(header.token_digest)
        if token is not None:
            self._tokens.move_to_end(header.token_digest)
            return token
        try:
            token = verify_token(data, self._identity.trust)
        except DocumentUnsigned:
            _drop("token_sig")
        except DocumentError:
            _drop("parse_token")
        self._tokens[header.token_digest] = token
        if len(self._tokens) > limits.TOKEN_CACHE:
            self._tokens.popitem(last=False)
        return token

    def _check_binding(self, header: EnvelopeHeader, token: IdentityToken, now_ms: int) -> None:
        if header.device_key_id != key_id(token.device_sign_pk):
            _drop("token_binding")
        if header.owner_principal_id not in ("", token.principal_id):
            _drop("token_binding")
        if token.kind not in self._kinds:
            _drop("token_kind")
        if not token.not_before_ms - limits.SKEW_MS <= now_ms <= token.not_after_ms:
            _drop("token_expired")
        if token.policy_version < self._identity.revocations.min_policy_version:
            _drop("policy_old")
        if header.classification > token.max_classification:
            _drop("classification")

    def _epoch(self, epoch_id: int, now_ms: int) -> Epoch:
        epoch = self._identity.epochs.get(epoch_id)
        if epoch is None:
            _drop("unknown_epoch")
        in_use = epoch.not_before_ms - limits.SKEW_MS <= now_ms <= epoch.retire_at_ms + limits.OVERLAP_MS
        if not in_use or epoch_id < self._identity.revocations.min_epoch_id:
            _drop("epoch_retired")
        return epoch

    def _opened(self, header: EnvelopeHeader, envelope: AuthEnvelope, epoch: Epoch) -> bytes:
        key = sealing_key(self._type, epoch, header.device_key_id)
        try:
            plaintext = open_sealed(key, header.nonce, envelope.header, envelope.ciphertext)
        except SealBroken:
            _drop("open")
        if hashlib.sha256(plaintext).digest() != header.body_commitment:
            _drop("commitment")
        return plaintext

    def _decoded(self, message: Sealed) -> Opened[T]:
        """Step 14. Raises Unreadable."""
        try:
            body = parse(SealedBody, message.plaintext[limits.SALT_BYTES :])
        except DocumentMalformed as error:
            raise Unreadable(str(error)) from error
        return Opened(message, body.order_seq, body.content, self._reader(message, body.content))


def _sender(token: IdentityToken, device_key_id: bytes) -> Sender:
    return Sender(
        principal_id=token.principal_id,
        callsign=token.callsign,
        kind=token.kind,
        roles=tuple(token.roles),
        public_key=token.device_sign_pk,
        device_key_id=device_key_id,
    )
