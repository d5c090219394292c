"""Frames as bytes: where one begins in a stream, checksums without definitions, fields behind those that are known."""

from __future__ import annotations

import random
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as dialect

from autopilot.adapters.vehicle.extensions import extension
from autopilot.adapters.vehicle.frames import (
    Deframer,
    as_signed,
    is_intact,
    is_signed,
    length_of,
    message_id,
    without_signature,
)
from tests.autopilot.vehicle.vehicles import attitude, decode, framed, heartbeat, position, signed

FRAMES = [heartbeat(), attitude(5, 10), signed(position(7), b"k" * 32, 9), framed(444_444, b"who knows")]
KEY = b"k" * 32


def test_a_frame_tells_its_length_and_what_it_is() -> None:
    assert [length_of(frame) for frame in FRAMES] == [len(frame) for frame in FRAMES]
    assert [message_id(frame) for frame in FRAMES] == [0, 30, 33, 444_444]
    assert [is_signed(frame) for frame in FRAMES] == [False, False, True, False]
    assert length_of(heartbeat()[:11]) is None


@pytest.mark.parametrize("frame", FRAMES)
def test_a_changed_bit_is_seen_where_the_message_is_known(frame: bytes) -> None:
    assert is_intact(frame)
    end = len(frame) - 13 * is_signed(frame)
    known = message_id(frame) != 444_444
    broken = [frame[:at] + bytes([frame[at] ^ 1]) + frame[at + 1 :] for at in range(10, end)]
    assert [is_intact(one) for one in broken] == [not known] * len(broken)


@pytest.mark.parametrize(
    "frame", [heartbeat(), attitude(5, 10), position(7), framed(444_444, b"who knows"), framed(9, b"")]
)
def test_signing_and_unsigning_keep_the_checksum_right(frame: bytes) -> None:
    """As another implementation signs it, also for a message that nobody here knows."""
    assert as_signed(frame) == signed(frame, KEY, 9)[:-13]
    assert without_signature(signed(frame, KEY, 9)) == frame
    assert without_signature(frame) == frame


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.lists(st.sampled_from(FRAMES), max_size=8), st.integers(0, 2**32), st.integers(1, 40))
def test_a_stream_gives_every_frame_however_it_is_cut(frames: list[bytes], seed: int, longest: int) -> None:
    chance, deframer, found = random.Random(seed), Deframer(), []
    stream = b"".join(frames)
    while stream:
        size = chance.randint(1, longest)
        found += list(deframer.feed(stream[:size]))
        stream = stream[size:]
    assert found == frames
    assert deframer.skipped_bytes == 0


def test_what_is_no_frame_swallows_none() -> None:
    """Noise, a start without a frame, a cut frame: what is whole behind them is found."""
    noise = [b"\xfd\xff\x00", b"hello", heartbeat()[:-3], b"\xfd", b"\xfd\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00"]
    deframer = Deframer()
    found = [frame for bad in noise for frame in deframer.feed(bad + attitude(1, 2) + attitude(3, 4))]
    found += deframer.feed(bytes(300))
    assert found == [attitude(1, 2), attitude(3, 4)] * len(noise)
    assert deframer.skipped_bytes == sum(map(len, noise)) + 300


def test_a_stream_that_never_frames_holds_little() -> None:
    deframer = Deframer()
    for _ in range(1_000):
        assert list(deframer.feed(b"\xfd\xff\x00\x01" * 100)) == []
    assert len(deframer._held) < 600


@pytest.mark.parametrize(
    ("frame", "offset", "layout", "values"),
    [
        (framed(111, struct.pack("<qqBB", 1, 2, 7, 191)), 16, "BB", (7, 191)),
        (framed(111, struct.pack("<qqB", 1, 2, 7)), 16, "BB", (7, 0)),
        (framed(111, struct.pack("<qq", 1, 2)), 16, "BB", (0, 0)),
        (framed(111, b"\x01"), 16, "BB", (0, 0)),
        (framed(47, struct.pack("<BBBBI", 1, 1, 0, 0, 77)), 4, "I", (77,)),
        (framed(44, struct.pack("<HBBBI", 3, 1, 1, 0, 2**32 - 1)), 5, "I", (2**32 - 1,)),
        (framed(44, struct.pack("<HBBBH", 3, 1, 1, 0, 513)), 5, "I", (513,)),
    ],
)
def test_fields_that_the_dialect_drops(frame: bytes, offset: int, layout: str, values: tuple[int, ...]) -> None:
    assert extension(decode(frame), offset, layout) == values


def test_the_dialect_still_drops_them() -> None:
    """Where this fails the fields can be read by their names."""
    assert "target_system" not in dialect.MAVLink_timesync_message.fieldnames
