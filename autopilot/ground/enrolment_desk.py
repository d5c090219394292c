"""Enrolment at the Directory: codes given out, and requests judged by them.

A code is for one device and one time. Its key lies in the Directory's state: whoever reads that may sign tokens anyway.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from autopilot.ground import directory_papers as papers
from autopilot.ground.directory import grant
from autopilot.ground.directory_folders import node_tokens
from autopilot.ground.directory_papers import Directory, signed_bundle, signed_token
from autopilot.ground.directory_store import DirectoryError, changing
from autopilot.ground.enrolment import (
    ANSWER,
    REQUEST,
    REQUEST_BYTES_MAX,
    EnrolmentError,
    authenticated,
    check_mac,
    check_possession,
    new_code,
    read,
    secret_of,
)
from autopilot.trust import documents
from autopilot.trust.documents import DocumentError
from autopilot.trust.keys import Random, digest
from autopilot.wire.directory_pb2 import (
    Authenticated,
    DirectoryState,
    EnrolmentAnswer,
    EnrolmentRequest,
    Invitation,
)
from events.schema.waypoint_pb2 import IdentityToken

NEEDS: Final = ("epoch", "token")  # the purpose keys that an admission takes
OPEN_MAX: Final = 256  # codes that may be out at once


class Refused(Exception):
    """A request is not granted; the text is the counter's name. Nobody is told more than that."""


def invite(
    folder: Path, described: IdentityToken, life_ms: int, now_ms: int, valid_ms: int, random: Random
) -> tuple[str, Invitation]:
    """Make a code for a device that is to be `described`, void after `valid_ms`. Raises DirectoryError, OSError."""
    code = new_code(random)
    secret = secret_of(code)
    with changing(folder) as state:
        directory = papers.opened(folder, state, ())
        _check_described(directory, described, life_ms, now_ms)
        kept = [each for each in state.invitations if now_ms <= each.expires_ms]
        if len(kept) >= OPEN_MAX:
            raise DirectoryError(f"{folder}: {len(kept)} codes are open; wait until some have run out")
        invitation = Invitation(
            enrolment_id=secret.enrolment_id,
            mac_key=secret.mac_key,
            token=described,
            life_ms=life_ms,
            expires_ms=now_ms + valid_ms,
        )
        del state.invitations[:]
        state.invitations.extend([*kept, invitation])
    return code, invitation


def admit(folder: Path, data: bytes, now_ms: int, random: Random) -> tuple[bytes, IdentityToken]:
    """Judge a request; return the answer and the token. Raises Refused, DirectoryError, OSError.

    1. It is short, and parses strictly.
    2. Its code was given out here.
    3. It was made by someone who knows the code; only from here on is anything written.
    4. The code has not run out.
    5. The code is unused; or it was used by these very bytes, whose answer was lost: then it is given again.
    6. Whoever asks holds the signing key, and no device here has it.
    7. The token stays in its bounds, and its principal is not revoked.
    """
    try:
        message = read(Authenticated, data, REQUEST_BYTES_MAX)  # 1
        request = read(EnrolmentRequest, message.body, REQUEST_BYTES_MAX)
    except EnrolmentError as error:
        raise Refused("malformed") from error
    asked = digest(message.body)
    with changing(folder) as state:
        invitation = _invitation(state, request, message)  # 2, 3
        if now_ms > invitation.expires_ms:  # 4
            raise Refused("expired")
        directory = papers.opened(folder, state, NEEDS)
        if invitation.used_by:  # 5
            token = _given(directory, invitation, asked, request, now_ms)
        else:
            token = _new_token(directory, invitation, request, now_ms, random)  # 6, 7
            invitation.used_by = asked
            state.tokens.append(token)
    return _answer(papers.open_directory(folder, NEEDS), invitation, asked, token, now_ms), token


def _invitation(state: DirectoryState, request: EnrolmentRequest, message: Authenticated) -> Invitation:
    for invitation in state.invitations:
        if invitation.enrolment_id == request.enrolment_id:
            try:
                check_mac(REQUEST, invitation.mac_key, message)
            except EnrolmentError as error:
                raise Refused("mac") from error
            return invitation
    raise Refused("code")


def _given(
    directory: Directory, invitation: Invitation, asked: bytes, request: EnrolmentRequest, now_ms: int
) -> IdentityToken:
    for token in directory.live(now_ms):
        if invitation.used_by == asked and token.device_sign_pk == request.sign_key:
            return token
    raise Refused("used")


def _new_token(
    directory: Directory, invitation: Invitation, request: EnrolmentRequest, now_ms: int, random: Random
) -> IdentityToken:
    token = IdentityToken()
    token.CopyFrom(invitation.token)
    try:
        check_possession(request)
        if any(request.sign_key == held.device_sign_pk for held in directory.state.tokens):
            raise EnrolmentError("another device has this key")
        grant(directory, token, request.sign_key, request.box_key, invitation.life_ms, now_ms, random)
        documents.check_token(token)
    except (EnrolmentError, DocumentError) as error:
        raise Refused("keys") from error
    except DirectoryError as error:
        raise Refused("revoked") from error
    return token


def _answer(directory: Directory, invitation: Invitation, asked: bytes, token: IdentityToken, now_ms: int) -> bytes:
    answer = EnrolmentAnswer(
        v=1,
        request_digest=asked,
        trust_root=directory.state.trust_root,
        token=signed_token(directory, token),
        revocations=directory.state.revocations,
        epoch=signed_bundle(directory, directory.epoch_at(now_ms), token),
        nodes=node_tokens(directory, now_ms).values(),
    )
    return authenticated(ANSWER, invitation.mac_key, answer)


def _check_described(directory: Directory, described: IdentityToken, life_ms: int, now_ms: int) -> None:
    """Refuse now what could not become a token later."""
    trial = IdentityToken()
    trial.CopyFrom(described)
    grant(directory, trial, bytes([1]) * 32, bytes([1]) * 32, life_ms, now_ms, lambda count: bytes([1]) * count)
    try:
        documents.check_token(trial)
    except DocumentError as error:
        raise DirectoryError(f"{described.principal_id}: {error}") from error
