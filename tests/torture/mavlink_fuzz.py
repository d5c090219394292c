"""Frames of every message that is read, broken in every way that a wire and a bad autopilot know, into a session.

Nothing may escape; what is heard has numbers that are numbers, in range; and so has what the node is told. Each share
is a session with a vehicle, commands in flight and an upload under way, so that broken answers find what they answer.
Everything comes from a seed.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from random import Random
from typing import Any

from google.protobuf.message import Message
from pymavlink.dialects.v20 import common as dialect

from autopilot.adapters.vehicle import ingress
from autopilot.adapters.vehicle.heard import Item, Rejected
from tests.autopilot.vehicle.vehicles import (
    PEER,
    Bench,
    arm,
    at_angles,
    at_place,
    attitude,
    gimbal,
    go_to_item,
    heartbeat,
    mode,
    position,
    upload,
)

FRAMES = 1_000_000
SHARE = 20_000  # frames a session
STEP_S = 0.01
Report = Callable[[str], None]

_SPECIAL = (0, 1, 2, 3, 127, 128, 254, 255)
_LIKELY = {
    "target_system": (1, 1, 1, 0),
    "target_component": (191, 191, 191, 0),
    "command": (176, 195, 1000, 400, 224, 16, 21, 22, 178),
    "seq": (0, 1, 2, 3, 4, 5, 6, 7, 65_535),
    "count": (7, 7, 6, 0),
    "result": (0, 1, 4, 5, 7, 8, 9),
    "type": (0, 0, 1, 3, 13, 15, 200),
    "mission_type": (0, 0, 0, 1),
}
_FLOATS = (math.nan, math.inf, -math.inf, 0.0, -0.0, 1e38, -1e38, 1e-45, 0.7071, 3.14159, 1e7, 90.0)
_RANGES = {
    "latitude_e7": (-900_000_000, 900_000_000),
    "longitude_e7": (-1_800_000_000, 1_800_000_000),
    "altitude_mm": (-1_000_000, 100_000_000),
    "height_mm": (-1_000_000, 100_000_000),
    "heading_cdeg": (0, 35_999),
    "yaw_cdeg": (0, 35_999),
    "pitch_cdeg": (-9_000, 9_000),
    "error_cdeg": (0, 18_000),
    "charge_percent": (0, 100),
    "voltage_mv": (0, 500_000),
    "landed_state": (1, 4),
    "vehicle": (1, 1),
}


def run(count: int | None, seed: int, report: Report) -> dict[str, Any]:
    """Throw `count` frames, the full count for None. Raises AssertionError naming the first that did harm."""
    frames, told = FRAMES if count is None else count, Counter[str]()
    for number in range(max(1, frames // SHARE)):
        told += share_of(seed * 1_000 + number, min(frames, SHARE))
        report(f"{(number + 1) * min(frames, SHARE)} frames")
    return {"frames": max(1, frames // SHARE) * min(frames, SHARE), "came_to": dict(sorted(told.items()))}


def share_of(seed: int, frames: int) -> Counter[str]:
    """Throw frames at one session, and return what they came to, by name."""
    random, bench = Random(f"mavlink {seed}"), Bench()
    for number in range(frames):
        if number % 500 == 0:
            _refresh(bench, number * STEP_S, number)
        datagram = b"".join(_broken(random) for _ in range(random.choice((1, 1, 1, 2, 3))))
        where = f"seed {seed}, frame {number}: {datagram.hex()}"
        for heard in ingress.read(datagram):
            assert isinstance(heard, Rejected) or not list(_wrong(heard)), where
        _hear(bench, number * STEP_S, datagram, where)
    return bench.session.rejected + Counter(type(report).__name__ for report in bench.reports)


def _refresh(bench: Bench, at_s: float, number: int) -> None:
    """Let the vehicle be there, and ask something of it."""
    boot_ms = round(at_s * 1000)
    bench.hear(at_s, heartbeat(armed=True), position(boot_ms), attitude(boot_ms, 90), gimbal(boot_ms, -30, 0))
    for seq, effect in enumerate((at_place(), at_angles(), mode("RETURN"), arm(), go_to_item(1), upload())):
        bench.perform(at_s, number * 10 + seq, effect)
    bench.sent.clear()


def _hear(bench: Bench, at_s: float, datagram: bytes, where: str) -> None:
    told = len(bench.reports)
    try:
        bench.hear(at_s, datagram, peer=PEER)
    except Exception as escaped:
        raise AssertionError(where) from escaped
    for report in bench.reports[told:]:
        assert not list(out_of_range(report)), f"{where}: {report}"
    bench.sent.clear()


def _wrong(heard: Any) -> Iterator[str]:
    """Yield the fields of a value that are no numbers, or out of range. A parameter of an item may be unset."""
    for field in fields(heard):
        value = getattr(heard, field.name)
        if is_dataclass(value):
            yield from _wrong(value)
        elif isinstance(heard, Item) and field.name == "parameters":
            yield from (field.name for one in value if math.isinf(one) or abs(one) > 1e7)
        elif isinstance(value, float) and not math.isfinite(value):
            yield field.name
        elif isinstance(value, int) and field.name in _RANGES:
            low, high = _RANGES[field.name]
            if not low <= value <= high:
                yield field.name


def out_of_range(report: Message) -> Iterator[str]:
    """Yield the fields of an observation that no vehicle can be at."""
    for field, value in report.ListFields():
        if isinstance(value, Message):
            yield from out_of_range(value)
        elif field.name in _RANGES:
            low, high = _RANGES[field.name]
            if not low <= value <= high:
                yield field.name


def _broken(random: Random) -> bytes:
    """Return a frame of a message that is read: with a good checksum mostly, for else nothing looks inside."""
    message_id = random.choice(sorted(ingress.READERS))
    kind = dialect.mavlink_map[message_id]
    return random.choice(_WAYS)(random, message_id, _payload(random, kind))


def _payload(random: Random, kind: Any) -> bytes:
    """Return fields of the right kinds with values that are likely to hurt."""
    ways = ("floats", "bytes", "plain")
    way, size = random.choice(ways), kind.unpacker.size
    if way == "bytes":
        return random.randbytes(size)
    values = [_value(random, letter, hurting=way == "floats") for letter in _letters(kind.unpacker.format)]
    names = kind.ordered_fieldnames
    if len(names) == len(values) and random.random() < 0.7:  # no arrays: so that it answers what was asked
        values = [random.choice(_LIKELY.get(name, (value,))) for name, value in zip(names, values, strict=True)]
    return bytes(kind.unpacker.pack(*values))


def _letters(form: str) -> Iterator[str]:
    """Yield one letter for each value of a struct's format."""
    repeat = ""
    for letter in form.lstrip("<"):
        if letter.isdigit():
            repeat += letter
            continue
        yield from [f"{repeat or 1}s"] if letter == "s" else [letter] * int(repeat or 1)
        repeat = ""


def _value(random: Random, letter: str, *, hurting: bool) -> Any:
    if letter.endswith("s"):
        return random.randbytes(int(letter[:-1]))
    if letter in "fd":
        return random.choice(_FLOATS) if hurting else random.uniform(-200, 200)
    bits = {"b": 8, "h": 16, "i": 32, "q": 64}[letter.lower()]
    low, high = (0, 2**bits - 1) if letter.isupper() else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    choices = (low, high, low + 1, high - 1, random.choice(_SPECIAL), random.randint(low, high))
    return min(high, max(low, random.choice(choices)))


def _frame(
    message_id: int, payload: bytes, *, system: int = 1, component: int = 1, flags: int = 0, crc_off: int = 0
) -> bytes:
    head = bytes([len(payload), flags, 0, 0, system, component]) + message_id.to_bytes(3, "little")
    crc = dialect.x25crc(head + payload + bytes([dialect.mavlink_map[message_id].crc_extra])).crc ^ crc_off
    signature = bytes(13) if flags & 1 else b""
    return b"\xfd" + head + payload + int(crc).to_bytes(2, "little") + signature


def _whole(_random: Random, message_id: int, payload: bytes) -> bytes:
    return _frame(message_id, payload)


def _cut(random: Random, message_id: int, payload: bytes) -> bytes:
    """A payload whose end was cut off, as MAVLink 2 does with zeros."""
    return _frame(message_id, payload[: random.randint(0, len(payload))])


def _longer(random: Random, message_id: int, payload: bytes) -> bytes:
    """A payload of a newer dialect, with extensions."""
    return _frame(message_id, (payload + random.randbytes(random.randint(1, 40)))[:255])


def _flipped(random: Random, message_id: int, payload: bytes) -> bytes:
    frame = bytearray(_frame(message_id, payload))
    frame[random.randrange(len(frame))] ^= 1 << random.randrange(8)
    return bytes(frame)


def _stranger(random: Random, message_id: int, payload: bytes) -> bytes:
    return _frame(message_id, payload, system=random.choice(_SPECIAL), component=random.choice(_SPECIAL))


def _flagged(random: Random, message_id: int, payload: bytes) -> bytes:
    return _frame(message_id, payload, flags=random.choice((1, 1, 2, 255)))


def _torn(random: Random, message_id: int, payload: bytes) -> bytes:
    frame = _frame(message_id, payload)
    return frame[: random.randrange(len(frame))]


_WAYS: tuple[Callable[[Random, int, bytes], bytes], ...] = (
    *(_whole, _whole, _whole, _cut, _longer, _flipped, _stranger, _flagged, _torn),
)
