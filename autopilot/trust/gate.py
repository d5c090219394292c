"""The gate: what a message must pass before one byte of its content is believed.

It authenticates, opens and decodes. Whether the sender may order what it orders (target, role,
dedup, order sequence) is decided elsewhere, from a record. Nothing here answers a sender.
"""

from __future__ import annotations

import hashlib
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable
from typing import Final, Generic, TypeVar

from autopilot.trust import limits
from autopilot.trust.believing import Believing, Fixed, Heard
from autopilot.trust.clock import Clock
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
from autopilot.trust.freshness import Time, life_of, nonce_life_of
from autopilot.trust.identity import Epoch, Identity
from autopilot.trust.keyless import Drop as _Drop
from autopilot.trust.keyless import container, header_of
from autopilot.trust.keyless import drop as _drop
from autopilot.trust.keys import SealBroken, SignatureInvalid, digest, key_id, verify
from autopilot.trust.tally import Tally
from autopilot.trust.verdict import Malformed, Opened, Rejected, Sealed, Sender, Unreadable
from autopilot.trust.window import ReplayWindow, TokenBucket
from events.schema.waypoint_pb2 import AuthEnvelope, EnvelopeHeader, IdentityToken, PrincipalKind, SealedBody

NS_PER_MS: Final = 1_000_000
T = TypeVar("T")


class Gate(Generic[T]):
    """Judges messages of one type, in this order; each step has its own counters.

    1.  rate: the token bucket of the link                                  rate
    2.  size, then the container: strict parse, lengths of its parts        size parse_env noncanonical_env
                                                                            shape version
    3.  header: strict parse, type, lengths                                 parse_hdr noncanonical_hdr type shape
    4.  route: signed key is the key it came on, and one of ours            route deployment
    5.  clock: life within its cap; not from the future, not too old. While the receiver's time is
        uncertain: an echo of its challenge instead                         ttl clock_future clock_stale challenge
    6.  nonce not seen yet (a look, nothing is written); and not from before a start that remembers
        no nonces                                                           replay horizon
    7.  token: digest, then cache or the Directory's signature              token_digest parse_token token_sig
    8.  token and header belong together; kind, validity, policy            token_binding token_kind token_expired
                                                                            policy_old classification
    9.  the device's signature                                              device_sig
    10. revocation of principal, device key and token                       revoked
    11. epoch known, in use, and the list that it needs is held             unknown_epoch epoch_retired list_old
    12. open, then the header's commitment to the plaintext                 open commitment
    13. the nonce is remembered; a full window refuses                      window_full
    14. decode: sealed body, then the reader's content                      (malformed)

    What follows is the core's, from the record: target, reception, role, the revocation list's age, nonce
    again, dedup, order sequence, intent (`statecharts.charts.command`).

    Steps 1 to 6 cost microseconds and stand before the signature for that reason; verification
    still comes before opening, and opening before decoding (seed 000, Node verification
    pipeline). Nothing that is not authenticated changes a table: the token cache grows after the
    Directory's signature, the window after the open. The nonce is remembered before the role is
    known, so that an insider who may not command can't make the same envelope cost an opening and
    a record again and again; what an insider fills is the quota of its own device. A full window
    refuses what is new and never lets go of what is alive. Between 10 and 11 whoever listens is
    told which list and epoch the sender knows. All of one judgement goes by one snapshot of what
    is believed. Anything unforeseen is `internal`.
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
        believing: Believing | None = None,
        takes_undated: bool = False,
    ) -> None:
        """Make a gate.

        `kinds` may sign this type; `is_ours` says whether a key expression is one that this
        receiver listens on; `reader` decodes and checks the content or raises Unreadable.
        `believing` is what the receiver believes, where that changes; else it is `identity`, and
        `clock` is right. `takes_undated`: messages without a time pass, of senders whose time is
        uncertain; whoever takes them must know by other means that they are not old.
        """
        self._believing: Believing = believing or Fixed(identity, clock)
        self._takes_undated = takes_undated
        self._type = message_type
        self._kinds = kinds
        self._is_ours = is_ours
        self._reader = reader
        self._clock = clock
        self._bucket = TokenBucket(samples_per_s, samples_burst)
        self._window = ReplayWindow()
        self._tokens: OrderedDict[bytes, IdentityToken] = OrderedDict()
        self._tokens_by: object = None  # the TrustRoot under which they were verified
        self._remembers_since_ns: int | None = None  # a start that remembers nothing from before it
        self._tally = Tally()
        self._lock = threading.Lock()

    def tally(self) -> Tally:
        """Return a copy of the counts; safe from any thread."""
        with self._lock:
            return self._tally.copy()

    def restore(self, entries: Iterable[tuple[bytes, bytes, int]], *, whole: bool = True) -> None:
        """Fill the replay window from the log: (device_key_id, nonce, milliseconds that remain).

        Where they are not all that were alive (`whole` is False: a log is lost), nothing that may have been sent
        before now passes, until everything sent before has run out (RFC 8446, section 8.2).
        """
        with self._lock:
            self._window.restore(entries, self._mono_ms())
            self._remembers_since_ns = None if whole else self._clock.mono_ns()

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
        held, time = self._believing.held, self._believing.time()
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
        if header.deployment_id != held.deployment_id:
            _drop("deployment")
        # 5. Clock.
        self._check_clock(header, time)
        # 6. Nonce, read only; and the horizon of what is remembered.
        if self._window.seen(header.device_key_id, header.nonce):
            _drop("replay")
        before_memory = self._before_memory(header, time)
        # 7. Token.
        token = self._token(header, envelope.token, held)
        # 8. Token and header.
        self._check_binding(header, token, held, time)
        # 9. Device signature.
        signed = signature_input(envelope.header, envelope.token, envelope.ciphertext)
        try:
            verify(token.device_sign_pk, signed, envelope.device_signature)
        except SignatureInvalid:
            _drop("device_sig")
        # 10. Revocation.
        if held.revocations.covers(token):
            _drop("revoked")
        self._believing.heard(Heard(header.revocation_version, header.epoch_id, token.not_before_ms))
        # 11. Epoch.
        epoch = _epoch(held, header.epoch_id, time)
        # 12. Open.
        plaintext = self._opened(header, envelope, epoch)
        # 13. Remember the nonce.
        nonce_life_ms = nonce_life_of(header, time)
        self._remember(header, nonce_life_ms)
        return Sealed(
            sender=_sender(token, header.device_key_id),
            key_expr=key_expr,
            nonce=header.nonce,
            issued_at_ms=header.issued_at_ms,
            ttl_ms=header.ttl_ms,
            life_ms=life_of(header, time),
            nonce_life_ms=nonce_life_ms,
            digest=digest(signed),
            in_reply_to=header.in_reply_to,
            revocation_version=header.revocation_version,
            plaintext=plaintext,
            envelope=payload,
            time_uncertain=not time.trusted,
            overdue_ms=max(0, time.earliest_ms - held.revocations.next_update_ms),
            before_memory=before_memory,
        )

    def _check_clock(self, header: EnvelopeHeader, time: Time) -> None:
        if not 0 < header.ttl_ms <= limits.TTL_MS_MAX:
            _drop("ttl")
        if self._takes_undated and not header.HasField("issued_at_ms"):
            return
        if not time.trusted:
            if not self._believing.echoes(header.node_challenge):
                _drop("challenge")
            return
        if header.issued_at_ms > time.now_ms + limits.SKEW_MS:
            _drop("clock_future")
        if time.now_ms > header.issued_at_ms + header.ttl_ms + limits.SKEW_MS:
            _drop("clock_stale")

    def _before_memory(self, header: EnvelopeHeader, time: Time) -> bool:
        """Return whether it may repeat what was sent before a start that remembers nothing; drop what may be that."""
        if self._remembers_since_ns is None:
            return False
        passed_ms = (self._clock.mono_ns() - self._remembers_since_ns) // NS_PER_MS
        if passed_ms > limits.HORIZON_MS:
            return False
        horizon_ms = time.now_ms - passed_ms + limits.SKEW_MS
        if time.trusted and header.issued_at_ms <= horizon_ms:
            _drop("horizon")
        first_ms = header.issued_at_ms + header.ttl_ms - limits.TTL_MS_MAX  # it may be a repeat of one so old
        return not time.trusted or first_ms <= horizon_ms

    def _remember(self, header: EnvelopeHeader, life_ms: int) -> None:
        now_ms = self._mono_ms()
        if not self._window.has_room(header.device_key_id, now_ms):
            _drop("window_full")
        self._window.insert(header.device_key_id, header.nonce, now_ms + life_ms)

    def _mono_ms(self) -> int:
        return self._clock.mono_ns() // NS_PER_MS

    def _token(self, header: EnvelopeHeader, data: bytes, held: Identity) -> IdentityToken:
        if self._tokens_by is not held.trust:
            self._tokens.clear()
            self._tokens_by = held.trust
        if digest(data) != header.token_digest:
            _drop("token_digest")
        token = self._tokens.get(header.token_digest)
        if token is not None:
            self._tokens.move_to_end(header.token_digest)
            return token
        try:
            token = verify_token(data, held.trust)
        except DocumentUnsigned:
            _drop("token_sig")
        except DocumentError:
            _drop("parse_token")
        self._tokens[header.token_digest] = token
        if len(self._tokens) > limits.TOKEN_CACHE:
            self._tokens.popitem(last=False)
        return token

    def _check_binding(self, header: EnvelopeHeader, token: IdentityToken, held: Identity, time: Time) -> None:
        if header.device_key_id != key_id(token.device_sign_pk):
            _drop("token_binding")
        if header.owner_principal_id not in ("", token.principal_id):
            _drop("token_binding")
        if token.kind not in self._kinds:
            _drop("token_kind")
        if time.earliest_ms > token.not_after_ms or time.latest_ms < token.not_before_ms - limits.SKEW_MS:
            _drop("token_expired")
        if token.policy_version < held.revocations.min_policy_version:
            _drop("policy_old")
        if header.classification > token.max_classification:
            _drop("classification")

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


def _epoch(held: Identity, epoch_id: int, time: Time) -> Epoch:
    epoch = held.epochs.get(epoch_id)
    if epoch is None:
        _drop("unknown_epoch")
    if time.latest_ms < epoch.not_before_ms - limits.SKEW_MS or held.is_over(epoch, time.earliest_ms):
        _drop("epoch_retired")
    if epoch.min_revocation_version > held.revocations.version:
        _drop("list_old")
    return epoch


def _sender(token: IdentityToken, device_key_id: bytes) -> Sender:
    return Sender(
        principal_id=token.principal_id,
        callsign=token.callsign,
        kind=token.kind,
        roles=tuple(token.roles),
        public_key=token.device_sign_pk,
        device_key_id=device_key_id,
    )
