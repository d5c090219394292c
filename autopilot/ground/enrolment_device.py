"""Enrolment on the device: keys are made here and stay here; what is believed comes under the code.

A folder goes from empty to *asking* (keys and the request) to an identity (the token is written last). Whatever dies in
between is begun again with the same code, which sends the same request.
"""

from __future__ import annotations

import stat
from pathlib import Path
from typing import Final

from autopilot.ground.directory_folders import write_identity, write_keys
from autopilot.ground.directory_store import durable
from autopilot.ground.enrolment import (
    ANSWER,
    ANSWER_BYTES_MAX,
    REQUEST_BYTES_MAX,
    EnrolmentError,
    Secret,
    check_mac,
    make_request,
    read,
)
from autopilot.trust import documents, identity
from autopilot.trust.documents import DocumentError, Trust
from autopilot.trust.identity import open_epoch
from autopilot.trust.keys import BoxKey, Random, SealBroken, SecretFileError, SignKey, digest, read_secret
from autopilot.trust.limits import KEY_BYTES
from autopilot.wire.directory_pb2 import Authenticated, EnrolmentAnswer
from events.schema.waypoint_pb2 import IdentityToken

REQUEST_FILE: Final = "enrolment.request"
FOLDER_MODE: Final = 0o700


def ask(out: Path, secret: Secret, random: Random) -> bytes:
    """Return the request of the device whose folder this is; make its keys where there are none.

    The same code gives the same request, also after a crash. Raises EnrolmentError, OSError.
    """
    if (out / identity.TOKEN_FILE).exists():
        raise EnrolmentError(f"{out}: holds an identity already; choose another folder or remove it")
    _make_folder(out)
    if not (out / identity.SIGN_FILE).exists() or not (out / identity.BOX_FILE).exists():
        write_keys(out, SignKey.from_seed(random(KEY_BYTES)), BoxKey.from_secret(random(KEY_BYTES)))
    request = make_request(secret, *_keys(out))
    durable(out / REQUEST_FILE, request)
    return request


def settle(out: Path, secret: Secret, data: bytes, now_ms: int) -> IdentityToken:
    """Believe the Directory's answer, and make the folder an identity. Raises EnrolmentError, OSError.

    1. It parses strictly.
    2. Whoever made it knows the code.
    3. It answers the request that lies here.
    4. The root is whole and in time; it is the one that will be believed.
    5. The token is for the keys that lie here, and in time.
    6. The list and the group key are signed, and the key opens here.
    """
    sign_key, box_key = _keys(out)
    asked = read(Authenticated, _bytes(out / REQUEST_FILE), REQUEST_BYTES_MAX)
    try:
        message = read(Authenticated, data, ANSWER_BYTES_MAX)  # 1
        check_mac(ANSWER, secret.mac_key, message)  # 2
        answer = read(EnrolmentAnswer, message.body, ANSWER_BYTES_MAX)
        if answer.v != 1 or answer.request_digest != digest(asked.body):  # 3
            raise EnrolmentError("it is to another request")
        trust, token = _believed(answer, sign_key, box_key, now_ms)  # 4, 5
        documents.verify_revocations(answer.revocations, trust)  # 6
        open_epoch(documents.verify_epoch_bundle(answer.epoch, trust), sign_key, box_key)
        nodes = {documents.verify_token(node, trust).principal_id: node for node in answer.nodes}
    except (EnrolmentError, DocumentError, SealBroken) as error:
        raise EnrolmentError(f"the answer is not believed ({error}); ask again with the same code") from error
    write_identity(out, answer.trust_root, answer.token, answer.revocations, answer.epoch, nodes)
    (out / REQUEST_FILE).unlink()
    return token


def _believed(answer: EnrolmentAnswer, sign_key: SignKey, box_key: BoxKey, now_ms: int) -> tuple[Trust, IdentityToken]:
    trust = documents.verify_trust_root(answer.trust_root)
    token = documents.verify_token(answer.token, trust)
    if (token.device_sign_pk, token.device_box_pk) != (sign_key.public, box_key.public):
        raise EnrolmentError("it is for other keys")
    if now_ms >= min(trust.expires_ms, token.not_after_ms):
        raise EnrolmentError("it has expired, or this computer's clock is wrong")
    return trust, token


def _make_folder(out: Path) -> None:
    out.mkdir(mode=FOLDER_MODE, parents=True, exist_ok=True)
    mode = out.stat().st_mode
    if mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise EnrolmentError(f"{out}: others may write there (mode {mode & 0o777:04o}); run: chmod 700 {out}")


def _keys(out: Path) -> tuple[SignKey, BoxKey]:
    try:
        sign_key = SignKey.from_seed(read_secret(out / identity.SIGN_FILE))
        return sign_key, BoxKey.from_secret(read_secret(out / identity.BOX_FILE))
    except SecretFileError as error:
        raise EnrolmentError(str(error)) from error


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise EnrolmentError(f"{path}: {error.strerror}; ask first: `autopilot enrol --request`") from error
