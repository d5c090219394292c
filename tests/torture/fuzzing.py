"""What is thrown at the gate: envelopes changed by somebody without a key, and envelopes signed by one who has one.

Each case says what may become of it. Everything comes from a seed.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from random import Random
from typing import Any

from autopilot.trust.envelope import MessageType, seal, sealing_key, signature_input
from autopilot.trust.identity import Identity
from autopilot.trust.keys import digest, key_id
from autopilot.trust.pae import le64
from events.schema.waypoint_pb2 import (
    AuthEnvelope,
    CameraPitchYaw,
    CameraRoi,
    DeviceCommand,
    EnvelopeHeader,
    PoiConfirm,
    SealedBody,
)
from tests.autopilot.trust.world import COMMAND_ID, KEY, Forge, people
from tests.vectors import independent

OPENED, MALFORMED = "opened", "malformed"
ANY_REJECTION = ""  # any counter but `internal`
PARTS = ("header", "token", "ciphertext", "device_signature")
ELSEWHERE = KEY[:-1] + "2"


@dataclass(frozen=True, slots=True)
class Case:
    """A sample, and what may become of it: a counter, `opened`, `malformed`, or any rejection."""

    kind: str
    payload: bytes
    expected: tuple[str, ...] = (ANY_REJECTION,)
    key_expr: str = KEY


@cache
def order() -> bytes:
    """Return an order as it should be."""
    roi = CameraRoi(lat_e7=521_000_000, lon_e7=43_000_000, altitude_dm=125)
    command = DeviceCommand(command_id=COMMAND_ID, target_node_pubkey=people().wasp.public_key, camera_roi=roi)
    return command.SerializeToString(deterministic=True)


@cache
def originals() -> tuple[bytes, ...]:
    """Return three good envelopes, of two senders."""
    alice = Forge(people().alice, content=order())
    return (alice.envelope(), replace(alice, seq=2).envelope(), replace(alice, identity=people().bob).envelope())


def splices() -> list[Case]:
    """Return every combination of the parts of three envelopes, on their key and on another."""
    whole = [AuthEnvelope.FromString(data) for data in originals()]
    cases: list[Case] = []
    for number in range(3**4):
        picks = [number // 3**at % 3 for at in range(4)]
        parts = {part: getattr(whole[pick], part) for part, pick in zip(PARTS, picks, strict=True)}
        payload = AuthEnvelope(v=1, **parts).SerializeToString(deterministic=True)
        good = (OPENED, "replay") if payload in originals() else (ANY_REJECTION,)
        cases += [Case("splice", payload, good), Case("splice", payload, key_expr=ELSEWHERE)]
    return cases


def outsider(random: Random) -> Case:
    """Return an envelope that somebody without a key has changed; it is never one that was good."""
    name, change = random.choice(OUTSIDERS)
    data = random.choice(originals())
    changed = change(random, data)
    while changed in originals():
        changed = _bits(random, changed)
    return Case(name, changed)


def _bits(random: Random, data: bytes) -> bytes:
    spoiled = bytearray(data)
    for _ in range(random.choice((1, 1, 1, 2, 8))):
        spoiled[random.randrange(len(data))] ^= 1 << random.randrange(8)
    return bytes(spoiled)


def _cut(random: Random, data: bytes) -> bytes:
    return data[: random.randrange(len(data))]


def _longer(random: Random, data: bytes) -> bytes:
    more = random.randbytes(random.choice((1, 2, 16, random.randrange(1, 4200))))
    return random.choice((data + more, more + data))


def _spliced(random: Random, data: bytes) -> bytes:
    other = random.choice(originals())
    return data[: random.randrange(len(data))] + other[random.randrange(len(other)) :]


def _block(random: Random, data: bytes) -> bytes:
    """Zero, repeat, drop or exchange a block."""
    at, size = random.randrange(len(data)), random.randrange(1, 65)
    block = data[at : at + size]
    new = random.choice((bytes(len(block)), b"", block * 2, block[::-1], random.randbytes(len(block))))
    return data[:at] + new + data[at + size :]


def _noise(random: Random, _data: bytes) -> bytes:
    return random.randbytes(random.randrange(200, 4097))


def _of_fields(random: Random, data: bytes) -> bytes:
    """Change the envelope or its header as a protobuf: drop, double, exchange, empty, retype a field."""
    inside = random.random() < 0.6
    fields = independent.spans(data)
    if not inside:
        return _fields(random, data)
    header = fields[1]
    assert isinstance(header[1], bytes)
    changed = _fields(random, header[1])
    rest = [(number, value) for number, value, _, _ in fields[2:]]
    return independent.encoded([(1, 1), (2, changed), *rest])


def _fields(random: Random, data: bytes) -> bytes:
    chunks = [(number, data[start:stop]) for number, _, start, stop in independent.spans(data)]
    at, other = random.randrange(len(chunks)), random.randrange(len(chunks))
    number = chunks[at][0]
    what = random.randrange(7)
    if what == 0:
        del chunks[at]
    elif what == 1:
        chunks.insert(at, chunks[at])
    elif what == 2:
        chunks[at], chunks[other] = chunks[other], chunks[at]
    else:
        wire = random.choice((0, 1, 2, 5, 3))
        number = random.choice((number, number, random.randrange(1, 30)))
        chunks[at] = (number, independent.varint(number << 3 | wire) + _value(random, wire))
    return b"".join(chunk for _, chunk in chunks)


def _value(random: Random, wire: int) -> bytes:
    if wire == 0:
        number = random.choice((0, 1, 2, 127, 128, 2**31, 2**32, 2**63, 2**64 - 1, random.getrandbits(64)))
        return independent.varint(number) if random.random() < 0.8 else b"\x80" * random.randrange(1, 12) + b"\x00"
    if wire == 2:
        size = random.choice((0, 1, 15, 16, 24, 31, 32, 33, 64, 128, 600))
        claimed = random.choice((size, size, size, size + 1, 2**31))
        return independent.varint(claimed) + random.randbytes(size)
    return random.randbytes({1: 8, 5: 4, 3: 1}[wire])


OUTSIDERS: tuple[tuple[str, Callable[[Random, bytes], bytes]], ...] = (
    ("bits", _bits),
    ("bits", _bits),
    ("cut", _cut),
    ("longer", _longer),
    ("spliced", _spliced),
    ("block", _block),
    ("noise", _noise),
    ("fields", _of_fields),
    ("fields", _of_fields),
)


@dataclass(frozen=True, slots=True)
class Insider:
    """What an insider signs: any header, any plaintext, any ciphertext; everything but another's key."""

    identity: Identity
    header: dict[str, Any]
    content: bytes
    body: bytes | None = None
    ciphertext: bytes | None = None
    encoding: Callable[[bytes], bytes] = bytes

    def envelope(self, seq: int, now_ms: int, salt: bytes) -> bytes:
        """Seal and sign it."""
        body = SealedBody(order_seq=seq, content=self.content).SerializeToString(deterministic=True)
        plaintext = salt + (body if self.body is None else self.body)
        fields = self._fields(seq, now_ms, salt) | {"body_commitment": hashlib.sha256(plaintext).digest()}
        header = EnvelopeHeader(**{name: value for name, value in (fields | self.header).items() if value})
        encoded = self.encoding(header.SerializeToString(deterministic=True))
        key = sealing_key(MessageType.ORDER, self.identity.epochs[1], header.device_key_id)
        sealed = seal(key, header.nonce[:24].ljust(24, b"\0"), encoded, plaintext)
        sealed = sealed if self.ciphertext is None else self.ciphertext
        signature = self.identity.sign_key.sign(signature_input(encoded, self.identity.token_bytes, sealed))
        parts = {"header": encoded, "token": self.identity.token_bytes, "ciphertext": sealed}
        return AuthEnvelope(v=1, device_signature=signature, **parts).SerializeToString(deterministic=True)

    def _fields(self, seq: int, now_ms: int, salt: bytes) -> dict[str, Any]:
        return {
            "type": 1,
            "key_expr": KEY,
            "owner_principal_id": self.identity.principal_id,
            "device_key_id": key_id(self.identity.public_key),
            "token_digest": digest(self.identity.token_bytes),
            "nonce": le64(seq) + salt[:16],
            "epoch_id": 1,
            "issued_at_ms": now_ms,
            "ttl_ms": 10_000,
            "seq": seq,
            "revocation_version": 1,
            "deployment_id": self.identity.deployment_id,
        }


def insider(random: Random, seq: int, now_ms: int) -> Case:
    """Return an envelope that a member signed with his own key, malformed in one way."""
    name, make = random.choice(INSIDERS)
    signed, expected = make(random, seq, now_ms)
    return Case(name, signed.envelope(seq, now_ms, random.randbytes(32)), expected)


Made = tuple[Insider, tuple[str, ...]]


def _good(random: Random, _seq: int, _now_ms: int) -> Made:
    return Insider(random.choice((people().alice, people().bob)), {}, order()), (OPENED,)


def _headed(counter: str, **header: Any) -> Made:
    return Insider(people().alice, header, order()), (counter,)


def _lengths(random: Random, _seq: int, _now_ms: int) -> Made:
    name, size = random.choice((("device_key_id", 16), ("token_digest", 32), ("body_commitment", 32)))
    wrong = random.choice([length for length in (0, 1, 15, 17, 31, 33, 64, 128) if length != size])
    return _headed("shape", **{name: random.randbytes(wrong)})


def _nonces(random: Random, seq: int, _now_ms: int) -> Made:
    wrong = random.choice((b"", le64(seq), le64(seq) + bytes(15), le64(seq) + bytes(17), le64(seq + 1) + bytes(16)))
    return _headed("shape", nonce=wrong)


def _texts(random: Random, _seq: int, _now_ms: int) -> Made:
    name = random.choice(("owner_principal_id", "deployment_id", "key_expr"))
    return _headed("shape", **{name: random.choice("aé\U0001f680\0") * random.randrange(129, 140)})


def _huge(random: Random, _seq: int, _now_ms: int) -> Made:
    size = random.randrange(520, 3000)
    made = Insider(people().alice, {"owner_principal_id": "a" * size}, order())
    return made, ("shape", "size")


def _utf8(random: Random, _seq: int, _now_ms: int) -> Made:
    bad = random.choice((b"\xff\xfe", b"\xc0\x80", b"\xed\xa0\x80", b"\xf8\x88\x80\x80\x80"))

    def spoil(encoded: bytes) -> bytes:
        at = encoded.index(b"coast-watch")
        return encoded[:at] + bad + encoded[at + len(bad) :]

    return Insider(people().alice, {}, order(), encoding=spoil), ("parse_hdr",)


def _encodings(random: Random, _seq: int, _now_ms: int) -> Made:
    junk = random.choice((b"\xa0\x06\x01", b"\x20\x00", b"\x08\x01", b"\xba\x06\x00", b"\x9b\x06\x9c\x06"))
    return Insider(people().alice, {}, order(), encoding=lambda encoded: encoded + junk), ("noncanonical_hdr",)


def _nested(random: Random, _seq: int, _now_ms: int) -> Made:
    depth = random.choice((10, 99, 101, 400))
    junk = b"\xa3\x06" * depth + b"\xa4\x06" * depth
    made = Insider(people().alice, {}, order(), encoding=lambda encoded: junk[:200] + encoded)
    return made, ("parse_hdr", "noncanonical_hdr", "shape", "size")


def _times(random: Random, _seq: int, now_ms: int) -> Made:
    counter, header = random.choice(
        (
            ("ttl", {"ttl_ms": 0}),
            ("ttl", {"ttl_ms": random.randrange(30_001, 2**32)}),
            ("clock_future", {"issued_at_ms": now_ms + random.randrange(5_001, 10**9)}),
            ("clock_future", {"issued_at_ms": 2**64 - 1}),
            ("clock_stale", {"issued_at_ms": now_ms - random.randrange(15_001, 10**12)}),
            ("clock_stale", {"issued_at_ms": 0}),
        )
    )
    return _headed(counter, **header)


def _wrong(random: Random, _seq: int, _now_ms: int) -> Made:
    counter, header = random.choice(
        (
            ("type", {"type": random.randrange(2, 2**32)}),
            ("route", {"key_expr": "waypoint/global/cmd/hornet-02/" + COMMAND_ID}),
            ("deployment", {"deployment_id": "elsewhere"}),
            ("token_digest", {"token_digest": random.randbytes(32)}),
            ("token_binding", {"device_key_id": random.randbytes(16)}),
            ("token_binding", {"owner_principal_id": "bob"}),
            ("classification", {"classification": random.randrange(1, 2**32)}),
            ("unknown_epoch", {"epoch_id": random.choice((0, 2, 2**64 - 1))}),
            ("commitment", {"body_commitment": random.randbytes(32)}),
        )
    )
    return _headed(counter, **header)


def _short(random: Random, _seq: int, _now_ms: int) -> Made:
    size = random.randrange(1, 40)
    made = Insider(people().alice, {}, order(), ciphertext=random.randbytes(size))
    return made, (("shape",) if size <= 16 else ("open",))


def _long(random: Random, _seq: int, _now_ms: int) -> Made:
    made = Insider(people().alice, {}, order(), ciphertext=random.randbytes(random.randrange(2049, 4000)))
    return made, ("shape", "size")


def _kinds(random: Random, _seq: int, _now_ms: int) -> Made:
    return Insider(people().hornet, {}, order()), ("token_kind",)


def _bodies(random: Random, _seq: int, _now_ms: int) -> Made:
    body = random.choice(
        (
            *(b"", b"\xff\xff", b"\x08\x00", b"\x10\x01", b"\x12\x00", b"\x12\x05a", b"\x0a\x01a"),
            *(b"\x08\x01\x08\x01\x12\x01a", b"\x08\x81\x00\x12\x01a", random.randbytes(random.randrange(1, 99))),
        )
    )
    return Insider(people().alice, {}, b"", body=body), (MALFORMED,)


def _commands(random: Random, _seq: int, _now_ms: int) -> Made:
    """An order with one field out of its range."""
    far = random.choice((2**31 - 1, -(2**31)))
    angles = random.choice((9_001, -9_001, 2**31 - 1, -(2**31)))
    command = random.choice(
        (
            DeviceCommand(camera_roi=CameraRoi(lat_e7=random.choice((900_000_001, -900_000_001, far)))),
            DeviceCommand(camera_roi=CameraRoi(lon_e7=random.choice((1_800_000_001, -1_800_000_001, far)))),
            DeviceCommand(camera_roi=CameraRoi(altitude_dm=random.choice((200_001, -5_001, far)))),
            DeviceCommand(camera_pitch_yaw=CameraPitchYaw(pitch_cdeg=angles)),
            DeviceCommand(camera_pitch_yaw=CameraPitchYaw(yaw_cdeg=random.choice((36_000, 2**32 - 1)))),
            DeviceCommand(poi_confirm=PoiConfirm(poi_id=random.choice(("", "x" * 500, COMMAND_ID.upper())))),
        )
    )
    command.command_id = COMMAND_ID
    return Insider(people().alice, {}, command.SerializeToString()), (MALFORMED,)


def _identifiers(random: Random, _seq: int, _now_ms: int) -> Made:
    wrong = (COMMAND_ID.upper(), COMMAND_ID[:-1] + "2", "", "a" * 900, "{" + COMMAND_ID + "}", COMMAND_ID + "\0", "é")
    content = DeviceCommand(command_id=random.choice(wrong)).SerializeToString()
    return Insider(people().alice, {}, content), (MALFORMED,)


def _contents(random: Random, _seq: int, _now_ms: int) -> Made:
    """What no parser takes, or what the wire type makes of other numbers: floats, NaN, bad text, deep groups."""
    junk = random.choice(
        (
            *(b"\x0a\x02\xff\xfe", b"\x0a\xff\xff\xff\xff\x0f", b"\x52\x7fa", b"\x0b" * 150, b"\xff" * 11),
            *(b"\x52\x09\x09" + struct.pack("<d", float("nan")), b"\x5a\x05\x0d" + struct.pack("<f", float("inf"))),
            *(random.randbytes(random.randrange(1, 200)), b"\x52\x06\x08\xff\xff\xff\xff\xff"),
        )
    )
    return Insider(people().alice, {}, junk), (MALFORMED,)


def _unknown(random: Random, _seq: int, _now_ms: int) -> Made:
    """A variant from the future is readable, with nothing ordered; the core refuses it."""
    head = DeviceCommand(command_id=COMMAND_ID, target_node_pubkey=random.randbytes(random.choice((0, 31, 32, 33))))
    tag = random.choice((12, 19, 99, 5000))
    data = random.randbytes(random.randrange(0, 60))
    variant = independent.varint(tag << 3 | 2) + independent.varint(len(data)) + data
    return Insider(people().alice, {}, head.SerializeToString() + variant), (OPENED,)


INSIDERS: tuple[tuple[str, Callable[[Random, int, int], Made]], ...] = (
    ("good", _good),
    ("lengths", _lengths),
    ("nonces", _nonces),
    ("texts", _texts),
    ("huge", _huge),
    ("bad text", _utf8),
    ("encodings", _encodings),
    ("nested", _nested),
    ("times", _times),
    ("wrong", _wrong),
    ("short ciphertext", _short),
    ("long ciphertext", _long),
    ("kinds", _kinds),
    ("bodies", _bodies),
    ("out of range", _commands),
    ("identifiers", _identifiers),
    ("contents", _contents),
    ("unknown variant", _unknown),
)
