"""Mutated frames of every message that is read, by seed: no exception, nothing infinite, nothing out of its range."""

from __future__ import annotations

import math
import random
import struct
from collections import Counter
from dataclasses import fields, is_dataclass
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as dialect

from autopilot.adapters.vehicle.heard import Rejected
from autopilot.adapters.vehicle.ingress import READERS, read
from events import encode
from tests.autopilot.vehicle.vehicles import Bench, S, framed, heartbeat

SAMPLES = 400  # of each message
ODD_FLOATS = (math.nan, math.inf, -math.inf, 1e38, -1e38, 1e-45, -0.0, math.pi, 7.0)
ODD_INTEGERS = (0, 1, -1, 127, 128, 255, 32_767, 65_535, 2**31 - 1, -(2**31), 2**32 - 1, 2**63 - 1, -(2**63), 2**64 - 1)


def payload_of(message_id: int, chance: random.Random) -> bytes:
    """Return a payload of a message with odd values in its fields, cut or lengthened now and then."""
    layout = dialect.mavlink_map[message_id].unpacker.format.lstrip("<")
    payload, repeat = b"", ""
    for letter in layout:
        if letter.isdigit():
            repeat += letter
            continue
        for _ in range(int(repeat or 1)):
            payload += _value(letter, chance)
        repeat = ""
    cut = chance.random()
    if cut < 0.1:
        return payload[: chance.randint(0, len(payload))]
    return (payload + chance.randbytes(chance.randint(1, 20)))[:255] if cut < 0.2 else payload


def _value(letter: str, chance: random.Random) -> bytes:
    size = struct.calcsize("<" + letter)
    if letter in "fd":
        odd = chance.choice(ODD_FLOATS) if chance.random() < 0.4 else chance.uniform(-1.5, 1.5)
        return struct.pack("<" + letter, odd)
    number = chance.choice(ODD_INTEGERS) if chance.random() < 0.5 else chance.getrandbits(8 * size)
    return (number % (1 << (8 * size))).to_bytes(size, "little")


def mutated(frame: bytes, chance: random.Random) -> bytes:
    """Return a frame with a few bytes changed, cut, or doubled: its checksum then seldom holds."""
    data = bytearray(frame)
    for _ in range(chance.randint(0, 3)):
        data[chance.randrange(len(data))] = chance.getrandbits(8)
    if chance.random() < 0.2:
        del data[chance.randrange(1, len(data)) :]
    return bytes(data) * chance.choice((1, 1, 2))


def check_finite(value: Any) -> None:
    """Every number in a value, and in those inside it, is one."""
    if is_dataclass(value):
        for one in fields(value):
            check_finite(getattr(value, one.name))
    elif isinstance(value, float):
        assert math.isfinite(value)


@pytest.mark.parametrize("message_id", sorted(READERS))
def test_odd_values_of_each_message_that_is_read(message_id: int) -> None:
    """With a right checksum: a value that is fit, or a rejection by name."""
    chance, found = random.Random(f"ingress {message_id}"), Counter[str]()
    for _ in range(SAMPLES):
        for item in read(framed(message_id, payload_of(message_id, chance))):
            check_finite(item)
            found[item.because if isinstance(item, Rejected) else "read"] += 1
    assert set(found) <= {"read", "not finite", "out of range", "no position"}
    assert found.total() <= SAMPLES


@pytest.mark.parametrize("message_id", sorted(READERS))
def test_mutated_frames_of_each_message_that_is_read(message_id: int) -> None:
    """Through a whole session with a vehicle, so that whatever is read is also used."""
    chance, bench = random.Random(f"frames {message_id}"), Bench()
    bench.hear(0, heartbeat())
    for number in range(SAMPLES):
        at_s = number / 50
        bench.session.hear(
            round(at_s * S), ("127.0.0.1", 14550), mutated(framed(message_id, payload_of(message_id, chance)), chance)
        )
        bench.turn(at_s)
    assert bench.session.rejected.total() > SAMPLES // 4
    assert all(encode(report) for report in bench.reports)
