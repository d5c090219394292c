"""A small world of identities for the tests of trust, mesh and ground: two Directories, a clock, a wire, a forge.

Everything comes from seeds; nothing here tests anything.
"""

from __future__ import annotations

import hashlib
import random
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from autopilot.adapters.mesh.link import Answer, LinkDown
from autopilot.ground import directory
from autopilot.trust import documents, pae
from autopilot.trust.envelope import MessageType, seal, sealing_key, signature_input
from autopilot.trust.gate import Gate
from autopilot.trust.identity import Identity, load_identity
from autopilot.trust.keys import Random, digest
from autopilot.trust.pae import le64
from autopilot.trust.verdict import Sealed
from events.schema.waypoint_pb2 import AuthEnvelope, EnvelopeHeader, IdentityToken, PrincipalKind, SealedBody

NOW_MS = 1_790_000_000_000
COMMAND_ID = "0b7c5e2a-6f0e-4d3a-9a51-3f1f5a0c9d11"
KEY = f"waypoint/global/cmd/wasp-01/{COMMAND_ID}"
ISSUERS = frozenset({PrincipalKind.OPERATOR})


_FOLDER = TemporaryDirectory(prefix="people-")  # removed when the interpreter ends


@dataclass
class FakeClock:
    """A clock that moves when it is told to."""

    now_ms: int = NOW_MS

    def mono_ns(self) -> int:
        """Monotonic nanoseconds, in step with the wall."""
        return (self.now_ms - NOW_MS + 1_000_000) * 1_000_000

    def wall_ns(self) -> int:
        """Wall nanoseconds."""
        return self.now_ms * 1_000_000


@dataclass
class FakeWire:
    """A link that remembers what was put on it."""

    up: bool = True
    refuses: bool = False
    puts: list[tuple[str, bytes, bool]] = field(default_factory=list)
    subscriptions: dict[str, Callable[[str, bytes], None]] = field(default_factory=dict)
    answerers: dict[str, Answer] = field(default_factory=dict)
    answers: list[bytes] = field(default_factory=list)
    asked: list[tuple[str, bytes]] = field(default_factory=list)

    def linked(self) -> bool:
        """Say whether it is up."""
        return self.up

    def put(self, key_expr: str, payload: bytes, *, urgent: bool) -> None:
        """Remember a message."""
        if self.refuses:
            raise LinkDown("no session")
        self.puts.append((key_expr, payload, urgent))

    def subscribe(self, key_expr: str, receive: Callable[[str, bytes], None]) -> None:
        """Remember who listens."""
        self.subscriptions[key_expr] = receive

    def answer(self, key_expr: str, receive: Answer) -> None:
        """Remember who answers."""
        self.answerers[key_expr] = receive

    def ask(self, key_expr: str, question: bytes, timeout_s: float) -> list[bytes]:
        """Give the answers that are laid ready."""
        self.asked.append((key_expr, question))
        return self.answers

    def start(self) -> None:
        """Nothing to open."""

    def stop(self) -> None:
        """Nothing to close."""


def seeded(seed: int) -> Random:
    """Chance that is the same every time."""
    return random.Random(seed).randbytes


@dataclass(frozen=True)
class People:
    """The identities of one Directory."""

    directory: directory.Directory
    alice: Identity
    bob: Identity
    viewer: Identity
    wasp: Identity
    hornet: Identity


@cache
def people(seed: int = 1) -> People:
    """Make a Directory and its identities; another seed is another Directory of the same deployment."""
    folder = Path(_FOLDER.name) / str(seed)
    chance = seeded(seed)
    made = directory.init(folder / "directory", deployment_id="coast-watch", now_ms=NOW_MS - 1000, random=chance)

    def issued(principal: str, kind: str, *roles: str) -> Identity:
        out = folder / principal
        directory.issue(
            made, principal, out, kind=kind, roles=roles, callsign=principal.upper(), now_ms=NOW_MS, random=chance
        )
        return load_identity(out, NOW_MS)

    wasp, hornet = issued("wasp-01", "node"), issued("hornet-02", "node")
    return People(
        directory=made,
        alice=issued("alice", "operator", "operator"),
        bob=issued("bob", "operator", "operator"),
        viewer=issued("vic", "operator", "viewer"),
        wasp=wasp,
        hornet=hornet,
    )


@dataclass(frozen=True)
class Forge:
    """Makes envelopes part by part, so that a test may spoil exactly one of them and sign the rest."""

    identity: Identity
    message_type: MessageType = MessageType.ORDER
    key_expr: str = KEY
    content: bytes = b"content"
    order_seq: int = 7
    issued_at_ms: int = NOW_MS
    ttl_ms: int = 10_000
    seq: int = 1
    salt: bytes = b"\x07" * 32
    body: bytes | None = None
    plaintext_sealed: bytes | None = None
    spoil_header: Callable[[EnvelopeHeader], None] = lambda _: None
    spoil_encoding: Callable[[bytes], bytes] = lambda encoded: encoded
    spoil_envelope: Callable[[AuthEnvelope], None] = lambda _: None

    def header(self, plaintext: bytes) -> EnvelopeHeader:
        """Make the header that belongs to `plaintext`."""
        identity = self.identity
        header = EnvelopeHeader(
            type=self.message_type,
            key_expr=self.key_expr,
            owner_principal_id=identity.principal_id,
            device_key_id=identity.sign_key.key_id,
            token_digest=identity.token_digest,
            nonce=le64(self.seq) + hashlib.sha256(le64(self.seq)).digest()[:16],
            epoch_id=1,
            issued_at_ms=self.issued_at_ms,
            ttl_ms=self.ttl_ms,
            seq=self.seq,
            revocation_version=1,
            deployment_id=identity.deployment_id,
            body_commitment=hashlib.sha256(plaintext).digest(),
        )
        self.spoil_header(header)
        return header

    def plaintext(self) -> bytes:
        """Salt and sealed body."""
        if self.body is not None:
            return self.salt + self.body
        body = SealedBody(order_seq=self.order_seq, content=self.content)
        return self.salt + body.SerializeToString(deterministic=True)

    def envelope(self) -> bytes:
        """Seal, sign, then spoil the finished envelope."""
        identity, plaintext = self.identity, self.plaintext()
        header = self.header(plaintext)
        encoded = self.spoil_encoding(header.SerializeToString(deterministic=True))
        key = sealing_key(self.message_type, identity.epochs[1], header.device_key_id)
        sealed = plaintext if self.plaintext_sealed is None else self.plaintext_sealed
        ciphertext = seal(key, header.nonce[:24].ljust(24, b"\0"), encoded, sealed)
        signature = identity.sign_key.sign(signature_input(encoded, identity.token_bytes, ciphertext))
        envelope = AuthEnvelope(
            v=1, header=encoded, token=identity.token_bytes, ciphertext=ciphertext, device_signature=signature
        )
        self.spoil_envelope(envelope)
        return envelope.SerializeToString(deterministic=True)


def resigned(envelope: AuthEnvelope, identity: Identity) -> None:
    """Sign an envelope again as `identity`, over whatever its parts are now."""
    signed = signature_input(envelope.header, envelope.token, envelope.ciphertext)
    envelope.device_signature = identity.sign_key.sign(signed)


def retokened(identity: Identity, change: Callable[[IdentityToken], None], signer: str = "token") -> Identity:
    """Give `identity` a token with one change, signed by a purpose key of its own Directory."""
    token = IdentityToken()
    token.CopyFrom(identity.token)
    change(token)
    signed = documents.sign(pae.IDENTITY_TOKEN, token, [people().directory.purpose_keys[signer]])
    return replace(identity, token=token, token_bytes=signed, token_digest=digest(signed))


def node_gate(
    identity: Identity | None = None, clock: FakeClock | None = None, *, per_s: float = 1e6, burst: int = 100_000
) -> Gate[bytes]:
    """The gate of node wasp-01, whose reader takes any content."""
    return Gate(
        identity or people().wasp,
        MessageType.ORDER,
        kinds=ISSUERS,
        is_ours=lambda key: key.startswith("waypoint/global/cmd/wasp-01/"),
        reader=_as_it_is,
        clock=clock or FakeClock(),
        samples_per_s=per_s,
        samples_burst=burst,
    )


def _as_it_is(_message: Sealed, content: bytes) -> bytes:
    return content
