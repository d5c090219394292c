"""MAVLink 2 signing: against an implementation that is not ours, against forgers and replays, and over restarts."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as dialect

from autopilot.adapters.vehicle.signing import (
    AHEAD,
    EPOCH_MS,
    MINUTE,
    STREAMS_MAX,
    TICKS_PER_MS,
    Kept,
    Signing,
    SigningKeyError,
    open_signing,
)
from autopilot.ports.config import VehicleSection
from tests.autopilot.trust.papers import HostClocks
from tests.autopilot.trust.world import NOW_MS
from tests.autopilot.vehicle.test_link import Inbox, link_to
from tests.autopilot.vehicle.vehicles import PEER, attitude, framed, heartbeat, signed

KEY, OTHER_KEY = bytes(range(32)), bytes(32)
NOW = (NOW_MS - EPOCH_MS) * TICKS_PER_MS
FAR = (1 << 48) - 1


class Times(Kept):
    """Kept times in memory."""

    def __init__(self, sent: int = 0, heard: int = 0) -> None:
        self.times = sent, heard

    def read(self) -> tuple[int, int]:
        return self.times

    def write(self, sent: int, heard: int) -> None:
        self.times = sent, heard


def signing(sent: int = 0, heard: int = 0, earliest_ms: int = NOW_MS) -> Signing:
    return Signing(KEY, Times(sent, heard), lambda: earliest_ms)


def check_admitted(one: Signing, *stories: tuple[bytes, str]) -> None:
    """Each frame in its turn gets this judgement."""
    assert [one.admit(frame) for frame, _ in stories] == [because for _, because in stories]


def time_of(frame: bytes) -> int:
    return int.from_bytes(frame[-12:-6], "little")


def test_another_implementation_believes_what_is_sent() -> None:
    """Pymavlink as the vehicle; it refuses what is not signed, or not with its key."""
    peer = dialect.MAVLink(None, 1, 1)
    peer.signing.secret_key, peer.signing.timestamp = KEY, NOW
    sender = signing()
    for frame in (heartbeat(), attitude(1, 2), heartbeat()):
        (message,) = peer.parse_buffer(sender.sign(frame))
        assert message.get_signed()
    peer.signing.secret_key = OTHER_KEY
    with pytest.raises(dialect.MAVError, match="signature"):
        peer.parse_buffer(sender.sign(heartbeat()))


def test_what_another_implementation_signs_is_admitted() -> None:
    peer = dialect.MAVLink(None, 1, 1)
    peer.signing.secret_key, peer.signing.sign_outgoing, peer.signing.timestamp = KEY, True, NOW
    message = dialect.MAVLink_attitude_message(1, 0, 0, 0.5, 0, 0, 0)
    check_admitted(signing(), *((bytes(message.pack(peer)), "") for _ in range(3)))


def test_frames_are_judged() -> None:
    frame = heartbeat()
    check_admitted(
        signing(),
        (frame, "unsigned"),
        (signed(frame, OTHER_KEY, NOW), "bad signature"),
        (signed(frame, KEY, NOW)[:-1] + b"\x00", "bad signature"),
        (signed(frame, KEY, NOW - MINUTE - 1), "old signature"),
        (signed(frame, KEY, NOW - MINUTE), ""),
        (signed(frame, KEY, NOW - MINUTE), "old signature"),
        (signed(frame, KEY, NOW - MINUTE + 1), ""),
        (signed(attitude(1, 2), KEY, NOW - MINUTE + 1), "old signature"),
        (signed(frame, KEY, NOW - MINUTE + 1, link_id=1), ""),
        (signed(framed(0, frame[10:-2], (1, 2)), KEY, NOW), ""),
    )


def test_a_forged_frame_changes_nothing() -> None:
    """One with a time far ahead would lock out the vehicle, were its time remembered before it is verified."""
    one, frame = signing(), heartbeat()
    check_admitted(
        one,
        (signed(frame, KEY, NOW), ""),
        (signed(frame, OTHER_KEY, FAR), "bad signature"),
        (signed(frame, OTHER_KEY, FAR, link_id=1), "bad signature"),
        (signed(frame, KEY, NOW + 1), ""),
        (signed(frame, KEY, NOW, link_id=1), ""),
    )
    assert time_of(one.sign(frame)) < NOW + MINUTE


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.binary(max_size=80), st.integers(0, 79), st.integers(1, 255))
def test_no_changed_byte_passes(payload: bytes, at: int, change: int) -> None:
    frame = bytearray(signed(framed(30, payload), KEY, NOW))
    at = 3 + at % (len(frame) - 3)
    frame[at] ^= change
    assert signing().admit(bytes(frame)) == "bad signature"


def test_a_new_stream_is_held_to_the_latest_time_that_was_verified() -> None:
    """Also where the clock knows less, and after a restart."""
    lost = signing(earliest_ms=EPOCH_MS)
    check_admitted(
        lost,
        (signed(heartbeat(), KEY, NOW), ""),
        (signed(heartbeat(), KEY, NOW - MINUTE - 1, link_id=1), "old signature"),
    )
    again = signing(heard=NOW, earliest_ms=EPOCH_MS)
    check_admitted(again, (signed(heartbeat(), KEY, NOW - MINUTE - 1), "old signature"))
    assert time_of(lost.sign(heartbeat())) == NOW


def test_streams_take_no_more_than_their_place() -> None:
    one = signing()
    stories = [(signed(framed(0, b"x", (1, number)), KEY, NOW), "") for number in range(STREAMS_MAX)]
    check_admitted(one, *stories, (signed(heartbeat(9), KEY, NOW), "too many signers"))
    check_admitted(one, (signed(framed(0, b"x", (1, 1)), KEY, NOW + 1), ""))


def test_times_that_are_sent_rise_also_where_the_clock_does_not() -> None:
    earliest = [NOW_MS]
    one = Signing(KEY, Times(), lambda: earliest[0])
    first = time_of(one.sign(heartbeat()))
    assert first == NOW
    earliest[0] -= 3_600_000
    assert [time_of(one.sign(heartbeat())) for _ in range(3)] == [NOW + 1, NOW + 2, NOW + 3]
    earliest[0] = NOW_MS + 1
    assert time_of(one.sign(heartbeat())) == NOW + TICKS_PER_MS


def test_the_kept_time_is_ahead_of_all_that_is_sent() -> None:
    """At each moment a restart begins behind what was sent, also without a clock; it is kept each minute."""
    earliest, times, kept = [NOW_MS], Times(), 0
    one = Signing(KEY, times, lambda: earliest[0])
    for second in range(300):
        earliest[0] = NOW_MS + 1_000 * second
        if (to_keep := one.to_keep()) is not None:
            times.write(*to_keep)
            kept += 1
        sent = time_of(one.sign(heartbeat()))
        again = Signing(KEY, Times(*times.times), lambda: EPOCH_MS)
        assert time_of(again.sign(heartbeat())) > sent
    assert kept == 5
    assert times.times[0] > NOW + 240_000 * TICKS_PER_MS + AHEAD // 2


def key_file(folder: Path, mode: int = 0o600, key: bytes = KEY) -> Path:
    path = folder / "link.key"
    path.write_bytes(key)
    path.chmod(mode)
    return path


def test_times_outlive_the_process(tmp_path: Path) -> None:
    path = key_file(tmp_path)
    sent = time_of(open_signing(path, lambda: NOW_MS).sign(heartbeat()))
    assert time_of(open_signing(path, lambda: EPOCH_MS).sign(heartbeat())) > sent
    assert (tmp_path / "link.key.time").stat().st_mode & 0o777 == 0o600


def check_refuses_to_start(path: Path, words: str) -> None:
    """Neither the signing nor the link begins, and both say why; the link names the key of the configuration."""
    with pytest.raises(SigningKeyError, match=words):
        open_signing(path, lambda: NOW_MS)
    settings_ = VehicleSection(listen="127.0.0.1:0", signing="required", signing_key_file=str(path))
    with pytest.raises(ValueError, match=rf"\[vehicle\] signing_key_file: .*{words}"):
        asyncio.run(link_to(settings_, Inbox()).start())


def test_without_its_key_it_refuses_to_start(tmp_path: Path) -> None:
    check_refuses_to_start(tmp_path / "none", "No such file")
    check_refuses_to_start(key_file(tmp_path, key=bytes(31)), "31 bytes")
    check_refuses_to_start(key_file(tmp_path, mode=0o640), "others may read")


def test_without_its_times_it_refuses_to_start(tmp_path: Path) -> None:
    path = key_file(tmp_path)
    times = tmp_path / "link.key.time"
    times.write_text("garbage")
    check_refuses_to_start(path, "times sent before are not known")
    times.unlink()
    (tmp_path / "link.key.time.part").mkdir()
    check_refuses_to_start(path, "can't be kept")


def test_a_link_that_signs_takes_nothing_else_and_says_nothing_else(tmp_path: Path) -> None:
    """Counted by name; the vehicle is adopted by its signed heartbeat, and hears signed frames."""
    path = key_file(tmp_path)
    settings_ = VehicleSection(listen="127.0.0.1:0", signing="required", signing_key_file=str(path))

    async def story() -> None:
        inbox = Inbox()
        link = link_to(settings_, inbox, HostClocks())
        await link.start()
        assert link._transport is not None
        sent: list[bytes] = []

        def write(data: bytes, peer: object) -> bool:
            sent.append(data)
            return True

        link._transport.write = write  # type: ignore[method-assign]
        try:
            link.hear(PEER, heartbeat() + signed(heartbeat(), OTHER_KEY, NOW))
            assert (inbox.taken, sent) == ([], [])
            link.hear(PEER, signed(heartbeat(), KEY, NOW))
            assert [type(told).__name__ for _, told in inbox.taken] == ["VehicleLinkChanged", "VehicleStateReported"]
            link.hear(PEER, signed(heartbeat(), KEY, NOW))
        finally:
            await link.stop()
        assert dict(link.rejected) == {"unsigned": 1, "bad signature": 1, "old signature": 1}
        assert sent
        times = [time_of(frame) for frame in sent]
        assert times == sorted(set(times))
        check_admitted(signing(), *((frame, "") for frame in sent))

    asyncio.run(story())
