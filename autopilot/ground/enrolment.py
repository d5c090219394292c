"""Enrolment, what both sides know: the code that is carried by hand, and the two messages that it authenticates.

The code holds 128 random bits, so nothing that is heard on the way helps to guess it. From it come a name that may be
told and a key for keyed BLAKE2b (RFC 7693), under which the device sends its public keys and the Directory answers with
the TrustRoot that the device will believe. The answer names the request, so neither can be put in another's place.

    K       = BLAKE2b-256(key=code, person="wp.enrol.key.v1")
    id      = BLAKE2b-128(key=K, person="wp.enrol.id.v1")
    mac     = BLAKE2b-256(key=K, person="wp.enrol.mac.v1", data=PAE(context, body))
    context = "autopilot/v1/EnrolmentRequest" or "autopilot/v1/EnrolmentAnswer"
"""

from __future__ import annotations

import hashlib
import hmac
from base64 import b32decode, b32encode
from dataclasses import dataclass, field
from typing import Final, TypeVar

from google.protobuf.message import DecodeError, Message

from autopilot.trust.documents import is_canonical
from autopilot.trust.keys import BoxKey, Random, SignatureInvalid, SignKey, verify
from autopilot.trust.limits import KEY_BYTES, KEY_ID_BYTES
from autopilot.trust.pae import pae
from autopilot.wire.directory_pb2 import Authenticated, EnrolmentRequest

REQUEST: Final = b"autopilot/v1/EnrolmentRequest"
ANSWER: Final = b"autopilot/v1/EnrolmentAnswer"
POSSESSION: Final = b"autopilot/v1/EnrolmentRequest/possession"

CODE_BYTES: Final = 16
REQUEST_BYTES_MAX: Final = 512  # a request has 237
ANSWER_BYTES_MAX: Final = 786_432  # a full revocation list, and the tokens of a thousand nodes

M = TypeVar("M", bound=Message)


class EnrolmentError(Exception):
    """An enrolment can't go on; the text says why and what to do."""


@dataclass(frozen=True, slots=True)
class Secret:
    """What is made from a code."""

    mac_key: bytes = field(repr=False)
    enrolment_id: bytes


def new_code(random: Random) -> str:
    """Make a code: 128 random bits and a check of 8, as seven groups of four letters and digits (RFC 4648, base 32)."""
    raw = random(CODE_BYTES)
    text = b32encode(raw + _check(raw)).decode().rstrip("=")
    return "-".join(text[start : start + 4] for start in range(0, len(text), 4))


def secret_of(code: str) -> Secret:
    """Read a code as it was typed, in any case and grouping. Raises EnrolmentError."""
    text = "".join(code.split()).replace("-", "").upper()
    try:
        data = b32decode(text + "=" * (-len(text) % 8))
    except ValueError:
        data = b""
    raw, check = data[:CODE_BYTES], data[CODE_BYTES:]
    if len(raw) != CODE_BYTES or check != _check(raw):
        raise EnrolmentError("the code is mistyped: it has seven groups of four letters and digits; type it again")
    mac_key = hashlib.blake2b(key=raw, digest_size=KEY_BYTES, person=b"wp.enrol.key.v1").digest()
    enrolment_id = hashlib.blake2b(key=mac_key, digest_size=KEY_ID_BYTES, person=b"wp.enrol.id.v1").digest()
    return Secret(mac_key, enrolment_id)


def make_request(secret: Secret, sign_key: SignKey, box_key: BoxKey) -> bytes:
    """Return the device's request: its public keys, signed by the one that signs, under the code."""
    request = EnrolmentRequest(v=1, enrolment_id=secret.enrolment_id, sign_key=sign_key.public, box_key=box_key.public)
    request.possession = sign_key.sign(_claimed(request))
    return authenticated(REQUEST, secret.mac_key, request)


def check_possession(request: EnrolmentRequest) -> None:
    """Check that whoever asks holds the signing key that he names. Raises EnrolmentError."""
    try:
        verify(request.sign_key, _claimed(request), request.possession)
    except SignatureInvalid as error:
        raise EnrolmentError("the request is not signed by the key that it names") from error


def authenticated(context: bytes, mac_key: bytes, body: Message) -> bytes:
    """Return `body` encoded, with the mac of whoever knows the code."""
    encoded = body.SerializeToString(deterministic=True)
    message = Authenticated(body=encoded, mac=_mac(context, mac_key, encoded))
    return message.SerializeToString(deterministic=True)


def read(message: type[M], data: bytes, bytes_max: int) -> M:
    """Parse strictly what nobody has vouched for yet. Raises EnrolmentError."""
    parsed, name = message(), message.DESCRIPTOR.name
    if len(data) > bytes_max:
        raise EnrolmentError(f"{name} is longer than {bytes_max} bytes")
    try:
        parsed.ParseFromString(data)
    except DecodeError as error:
        raise EnrolmentError(f"{name} can't be parsed") from error
    if not is_canonical(parsed, data):
        raise EnrolmentError(f"{name} is not in canonical encoding")
    return parsed


def check_mac(context: bytes, mac_key: bytes, message: Authenticated) -> None:
    """Check that the sender knows the code. Raises EnrolmentError."""
    if not hmac.compare_digest(_mac(context, mac_key, message.body), message.mac):
        raise EnrolmentError("it was not made with this code")


def _mac(context: bytes, mac_key: bytes, body: bytes) -> bytes:
    framed = pae(context, body)
    return hashlib.blake2b(framed, key=mac_key, digest_size=KEY_BYTES, person=b"wp.enrol.mac.v1").digest()


def _claimed(request: EnrolmentRequest) -> bytes:
    bare = EnrolmentRequest()
    bare.CopyFrom(request)
    bare.ClearField("possession")
    return pae(POSSESSION, bare.SerializeToString(deterministic=True))


def _check(raw: bytes) -> bytes:
    return hashlib.blake2b(raw, digest_size=1, person=b"wp.enrol.chk.v1").digest()
