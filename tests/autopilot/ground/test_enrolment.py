"""Enrolment: who may come in by a code, who may not, and whom the device believes."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.ground import enrolment, enrolment_device
from autopilot.ground import enrolment_desk as desk
from autopilot.ground.directory import HOUR_MS, DirectoryError, described
from autopilot.ground.enrolment import (
    ANSWER,
    REQUEST,
    REQUEST_BYTES_MAX,
    EnrolmentError,
    authenticated,
    make_request,
    new_code,
    secret_of,
)
from autopilot.trust.identity import load_identity
from autopilot.trust.keys import BoxKey, SignKey
from autopilot.wire.directory_pb2 import Authenticated, EnrolmentAnswer, EnrolmentRequest
from tests.autopilot.ground.directories import World, digests, world
from tests.autopilot.trust.world import NOW_MS, seeded


@dataclass
class Meeting:
    """A Directory, a code, and a device that has it."""

    made: World
    code: str
    out: Path

    @property
    def secret(self) -> enrolment.Secret:
        """What the code says."""
        return secret_of(self.code)

    def ask(self) -> bytes:
        """The device asks."""
        return enrolment_device.ask(self.out, self.secret, seeded(7))

    def admit(self, request: bytes, at_ms: int = NOW_MS) -> bytes:
        """The Directory answers."""
        return desk.admit(self.made.folder, request, at_ms, self.made.random)[0]

    def settle(self, answer: bytes, at_ms: int = NOW_MS) -> str:
        """The device believes; returns who it is."""
        return enrolment_device.settle(self.out, self.secret, answer, at_ms).principal_id


@pytest.fixture
def meeting(tmp_path: Path) -> Meeting:
    """A code for hornet-02."""
    made = world(tmp_path)
    return Meeting(made, made.invite(), tmp_path / "device")


def check_refused(meeting: Meeting, because: str, request: bytes, at_ms: int = NOW_MS) -> None:
    """Check that a request is refused, by this counter, and leaves no trace in the Directory."""
    before = digests(meeting.made.folder)
    with pytest.raises(desk.Refused, match=because):
        meeting.admit(request, at_ms)
    assert digests(meeting.made.folder) == before


def check_not_believed(meeting: Meeting, words: str, answer: bytes, at_ms: int = NOW_MS) -> None:
    """Check that an answer is not believed, and that the folder stays as it was."""
    before = digests(meeting.out)
    with pytest.raises(EnrolmentError, match=words):
        meeting.settle(answer, at_ms)
    assert digests(meeting.out) == before


def other_device(meeting: Meeting, code: str | None = None) -> bytes:
    """Return the request of another device with the same code, or with one of its own."""
    return make_request(
        secret_of(code or meeting.code), SignKey.from_seed(b"\x05" * 32), BoxKey.from_secret(b"\x06" * 32)
    )


def changed_request(meeting: Meeting, change: EnrolmentRequest) -> bytes:
    """Return the device's request with some fields changed, by somebody who knows the code."""
    request = EnrolmentRequest.FromString(Authenticated.FromString(meeting.ask()).body)
    request.MergeFrom(change)
    return authenticated(REQUEST, meeting.secret.mac_key, request)


def changed_answer(meeting: Meeting, answer: bytes, change: Callable[[EnrolmentAnswer], object]) -> bytes:
    """Return an answer with one change, by somebody who knows the code."""
    found = EnrolmentAnswer.FromString(Authenticated.FromString(answer).body)
    change(found)
    return authenticated(ANSWER, meeting.secret.mac_key, found)


def test_a_device_comes_in_by_its_code(meeting: Meeting) -> None:
    """Its keys were made there; the folder is an identity like one that was issued."""
    assert meeting.settle(meeting.admit(meeting.ask())) == "hornet-02"
    hornet = load_identity(meeting.out, NOW_MS)
    assert (hornet.token.kind, list(hornet.epochs), set(hornet.known_nodes)) == (2, [1], {"wasp-01", "hornet-02"})
    assert meeting.made.live() == ["wasp-01", "alice", "hornet-02"]
    assert (meeting.out.stat().st_mode & 0o777, not (meeting.out / "enrolment.request").exists()) == (0o700, True)
    modes = {name: (meeting.out / name).stat().st_mode & 0o777 for name in ("device.sign", "device.box")}
    assert set(modes.values()) == {0o600}


def test_no_secret_of_the_device_travels(meeting: Meeting) -> None:
    """Nor the code, nor the Directory's keys."""
    request = meeting.ask()
    answer = meeting.admit(request)
    secrets = [(meeting.out / name).read_bytes() for name in ("device.sign", "device.box")]
    secrets += [path.read_bytes() for path in meeting.made.folder.glob("*.key")]
    secrets += [path.read_bytes() for path in meeting.made.folder.glob("*.secret")]
    secrets += [meeting.secret.mac_key]
    assert [secret for secret in secrets if secret in request + answer] == []
    assert meeting.secret.mac_key.hex() not in repr(meeting.secret)


def test_a_lost_answer_is_given_again(meeting: Meeting) -> None:
    """To the same request only, and it mints nothing; a device that crashed asks with the same bytes."""
    first = meeting.ask()
    meeting.admit(first)
    assert meeting.ask() == first
    again = meeting.admit(first, NOW_MS + HOUR_MS)
    assert len(meeting.made.open().state.tokens) == 3
    assert meeting.settle(again) == "hornet-02"


def test_a_code_is_used_once(meeting: Meeting) -> None:
    """A second device is refused, whether the first is still there or revoked."""
    request = meeting.ask()
    meeting.admit(request)
    check_refused(meeting, "used", other_device(meeting))
    own = SignKey.from_seed((meeting.out / "device.sign").read_bytes())
    check_refused(meeting, "used", make_request(meeting.secret, own, BoxKey.from_secret(b"\x06" * 32)))
    meeting.made.revoke("hornet-02")
    check_refused(meeting, "used", request)


def test_a_code_runs_out(meeting: Meeting) -> None:
    """Used or not."""
    request = meeting.ask()
    check_refused(meeting, "expired", request, NOW_MS + HOUR_MS + 1)
    meeting.admit(request, NOW_MS + HOUR_MS)
    check_refused(meeting, "expired", request, NOW_MS + HOUR_MS + 1)
    meeting.made.invite()  # forgets what has run out
    later = desk.invite(
        meeting.made.folder, described("x", "node", (), ""), 1, NOW_MS + HOUR_MS + 1, 1, meeting.made.random
    )
    assert list(meeting.made.open().state.invitations) == [later[1]]


def test_a_wrong_code_is_refused(meeting: Meeting) -> None:
    """Another Directory's, or a guessed one under a name that was heard."""
    check_refused(meeting, "code", other_device(meeting, new_code(seeded(9))))
    message = Authenticated.FromString(other_device(meeting, new_code(seeded(9))))
    request = EnrolmentRequest.FromString(message.body)
    request.enrolment_id = meeting.secret.enrolment_id
    guessed = authenticated(REQUEST, secret_of(new_code(seeded(9))).mac_key, request)
    check_refused(meeting, "mac", guessed)


def test_swapped_keys_are_refused(meeting: Meeting) -> None:
    """By somebody on the way, who does not know the code; and by somebody who does, but lacks the key he names."""
    request, other = meeting.ask(), EnrolmentRequest.FromString(Authenticated.FromString(other_device(meeting)).body)
    for name in ("sign_key", "box_key", "possession", "enrolment_id"):
        message = Authenticated.FromString(request)
        body = EnrolmentRequest.FromString(message.body)
        setattr(body, name, getattr(other, name)[::-1])
        message.body = body.SerializeToString(deterministic=True)
        check_refused(meeting, "mac|code", message.SerializeToString(deterministic=True))
    for name in ("sign_key", "box_key"):
        check_refused(meeting, "keys", changed_request(meeting, EnrolmentRequest(**{name: getattr(other, name)})))
    meeting.admit(request)


def test_a_key_that_another_device_has_is_refused(meeting: Meeting) -> None:
    """Even by its owner: two principals would share it."""
    wasp = meeting.made.identity("wasp-01")
    check_refused(meeting, "keys", make_request(meeting.secret, wasp.sign_key, wasp.box_key))


def test_keys_out_of_bounds_are_refused(meeting: Meeting) -> None:
    """All zero is no key, for nobody has to hold its secret."""
    sign_key = SignKey.from_seed(b"\x05" * 32)
    zero = make_request(meeting.secret, sign_key, BoxKey(b"", bytes(32)))
    check_refused(meeting, "keys", zero)


def test_a_revoked_principal_does_not_come_in(meeting: Meeting) -> None:
    """Though his code was given out before."""
    meeting.made.revoke("hornet-02")
    check_refused(meeting, "revoked", meeting.ask())


@given(st.binary(max_size=REQUEST_BYTES_MAX + 8))
def test_noise_is_malformed(data: bytes) -> None:
    """Nothing else is ever raised, and no folder is opened for it."""
    with pytest.raises(desk.Refused, match=r"malformed|code"):
        desk.admit(_FOLDER.folder, data, NOW_MS, os.urandom)


def test_every_bit_of_a_request_counts(meeting: Meeting) -> None:
    """One flipped, one byte cut off or added."""
    request = meeting.ask()
    for place in range(len(request) * 8):
        spoilt = bytearray(request)
        spoilt[place // 8] ^= 1 << place % 8
        with pytest.raises(desk.Refused):
            meeting.admit(bytes(spoilt))
    for data in (request[:-1], request + b"\x00", request * 3, request + b"\x18\x01"):
        check_refused(meeting, "malformed", data)


def test_what_is_read_before_it_is_vouched_for_is_bounded() -> None:
    """To the byte."""
    data = Authenticated(body=b"b" * 60).SerializeToString()
    assert enrolment.read(Authenticated, data, len(data)).body == b"b" * 60
    with pytest.raises(EnrolmentError, match="longer than 61 bytes"):
        enrolment.read(Authenticated, data, len(data) - 1)


def test_a_stranger_is_not_taken_for_the_directory(meeting: Meeting) -> None:
    """He knows no code: neither his answer nor an echo of the device's own message is believed."""
    request = meeting.ask()
    stranger = world(meeting.made.root / "stranger", seed=2)
    code = stranger.invite()
    device = SignKey.from_seed((meeting.out / "device.sign").read_bytes())
    box = BoxKey.from_secret((meeting.out / "device.box").read_bytes())
    theirs = desk.admit(stranger.folder, make_request(secret_of(code), device, box), NOW_MS, os.urandom)[0]
    check_not_believed(meeting, "not made with this code", theirs)
    check_not_believed(meeting, "not made with this code", request)
    check_not_believed(meeting, "parsed|canonical|code", b"")
    honest = meeting.admit(request)
    spoilt = bytearray(honest)
    spoilt[len(spoilt) // 2] ^= 1
    check_not_believed(meeting, "canonical|code|parsed", bytes(spoilt))
    assert meeting.settle(honest) == "hornet-02"


@pytest.mark.parametrize(
    ("words", "change"),
    [
        ("another request", lambda answer: setattr(answer, "request_digest", b"\x01" * 32)),
        ("another request", lambda answer: setattr(answer, "v", 2)),
        ("signed by", lambda answer: answer.ClearField("trust_root")),
        ("signed by", lambda answer: answer.ClearField("token")),
        ("signed by", lambda answer: answer.ClearField("revocations")),
        ("signed by", lambda answer: answer.ClearField("epoch")),
        ("unknown key", lambda answer: answer.nodes.append(answer.epoch)),
    ],
)
def test_an_answer_is_believed_whole_or_not(
    meeting: Meeting, words: str, change: Callable[[EnrolmentAnswer], object]
) -> None:
    """Even from somebody who knows the code: the documents must fit each other and the request."""
    answer = meeting.admit(meeting.ask())
    check_not_believed(meeting, words, changed_answer(meeting, answer, change))


def test_an_answer_for_others_is_not_believed(meeting: Meeting) -> None:
    """Another device's token or group key under this code; or one that has expired."""
    answer = meeting.admit(meeting.ask())
    alice = meeting.made.root / "alice"
    for theirs, words in (
        (EnrolmentAnswer(token=(alice / "token").read_bytes()), "other keys"),
        (EnrolmentAnswer(epoch=(alice / "epoch").read_bytes()), "wrapped for another"),
    ):
        change = partial(_merge, theirs)
        check_not_believed(meeting, words, changed_answer(meeting, answer, change))
    check_not_believed(meeting, "expired", answer, NOW_MS + 30 * 24 * HOUR_MS)


def _merge(change: EnrolmentAnswer, answer: EnrolmentAnswer) -> None:
    answer.MergeFrom(change)


def test_loose_permissions_are_refused(meeting: Meeting) -> None:
    """A secret that others may read, a folder that others may write to."""
    answer = meeting.admit(meeting.ask())
    os.chmod(meeting.out / "device.box", 0o644)
    check_not_believed(meeting, "chmod 600", answer)
    with pytest.raises(EnrolmentError, match="chmod 600"):
        meeting.ask()
    os.chmod(meeting.out / "device.box", 0o600)
    for mode in (0o770, 0o702):
        os.chmod(meeting.out, mode)
        with pytest.raises(EnrolmentError, match="chmod 700"):
            meeting.ask()


def test_an_identity_is_not_overwritten(meeting: Meeting) -> None:
    """Nor settled without having asked."""
    with pytest.raises(EnrolmentError, match=r"directory issue|No such file"):
        meeting.settle(b"")
    answer = meeting.admit(meeting.ask())
    meeting.settle(answer)
    with pytest.raises(EnrolmentError, match="holds an identity already"):
        meeting.ask()
    with pytest.raises(EnrolmentError, match="ask first"):
        meeting.settle(answer)


def test_a_code_is_read_as_it_is_typed() -> None:
    """In any case and grouping; a slip is noticed before it is sent."""
    code = new_code(seeded(3))
    assert secret_of(code) == secret_of(f" {code.replace('-', ' ').lower()}\n")
    slips = [code[:place] + {"A": "B"}.get(code[place], "A") + code[place + 1 :] for place in range(0, 24, 5)]
    for wrong in (*slips, "", "hello", code[:-1], code + "AAAA", "1" * 28):
        with pytest.raises(EnrolmentError, match="type it again"):
            secret_of(wrong)


def test_what_could_not_become_a_token_is_refused_at_once(meeting: Meeting) -> None:
    """Not when the device asks."""
    for principal, kind, words in (("No Name", "node", "principal_id"), ("alice", "operator", "is revoked")):
        meeting.made.revoke("alice")
        with pytest.raises(DirectoryError, match=words):
            meeting.made.invite(principal, kind)


def test_codes_are_bounded(meeting: Meeting) -> None:
    """A script gone wild does not fill the state."""
    for _ in range(desk.OPEN_MAX - 1):
        meeting.made.invite()
    with pytest.raises(DirectoryError, match="codes are open"):
        meeting.made.invite()


class _Folder:
    """A Directory for the noise, made once."""

    def __init__(self) -> None:
        from tempfile import TemporaryDirectory

        self._kept = TemporaryDirectory(prefix="noise-")
        self.folder = world(Path(self._kept.name)).folder


_FOLDER = _Folder()
