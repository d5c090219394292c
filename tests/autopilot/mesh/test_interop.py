"""The source system's numbers: what its generated code would write is read here, and the other way round.

The bytes are put together by hand from field numbers and wire types (protobuf encoding: a tag is number << 3 | type,
sint32 is zigzag), so that a renumbered schema does not agree with itself.
"""

from __future__ import annotations

import pytest
from google.protobuf.message import Message

from events.schema.waypoint_pb2 import AckResult, CameraPitchYaw, CameraRoi, CommandAck, DeviceCommand
from tests.autopilot.trust.world import COMMAND_ID
from tests.checks import check_equal

VARINT, BYTES = 0, 2
KEY = b"k" * 32


def varint(number: int) -> bytes:
    """Encode an unsigned number."""
    low, rest = number & 0x7F, number >> 7
    return bytes([low | 0x80]) + varint(rest) if rest else bytes([low])


def zigzag(number: int) -> int:
    """Encode a sint32."""
    return number << 1 if number >= 0 else (-number << 1) - 1


def field(number: int, value: int | bytes) -> bytes:
    """Encode one field."""
    if isinstance(value, int):
        return varint(number << 3 | VARINT) + varint(value)
    return varint(number << 3 | BYTES) + varint(len(value)) + value


ROI = field(1, zigzag(521_000_000)) + field(2, zigzag(-43_000_000)) + field(3, zigzag(-125))
ANGLES = field(1, zigzag(-4_500)) + field(2, 35_900)
ADDRESSED = field(1, COMMAND_ID.encode()) + field(5, KEY)
WRITTEN = [
    (
        ADDRESSED + field(10, ROI),
        DeviceCommand(
            command_id=COMMAND_ID,
            target_node_pubkey=KEY,
            camera_roi=CameraRoi(lat_e7=521_000_000, lon_e7=-43_000_000, altitude_dm=-125),
        ),
    ),
    (
        ADDRESSED + field(11, ANGLES),
        DeviceCommand(
            command_id=COMMAND_ID,
            target_node_pubkey=KEY,
            camera_pitch_yaw=CameraPitchYaw(pitch_cdeg=-4_500, yaw_cdeg=35_900),
        ),
    ),
    (
        field(1, COMMAND_ID.encode()) + field(2, 4) + field(3, b"role not permitted") + field(4, 1_790_000_000_000),
        CommandAck(
            command_id=COMMAND_ID,
            result=AckResult.ACK_UNAUTHORISED,
            detail="role not permitted",
            acked_at_ms=1_790_000_000_000,
        ),
    ),
]


@pytest.mark.parametrize(("written", "message"), WRITTEN, ids=["place", "angles", "ack"])
def test_the_numbers_are_those_of_the_source_system(written: bytes, message: Message) -> None:
    check_equal(type(message).FromString(written), message)
    check_equal(message.SerializeToString(deterministic=True), written)


def test_the_answers_are_those_of_the_source_system() -> None:
    """5 is read and never given: who can't prove himself is not answered."""
    names = ("ACCEPTED", "REJECTED", "TIMEOUT", "UNSUPPORTED", "UNAUTHORISED", "INVALID_SIGNATURE")
    check_equal(dict(AckResult.items()), {f"ACK_{name}": number for number, name in enumerate(names)})


def test_what_is_ours_begins_at_20() -> None:
    """A later number of the source system does not meet one of ours."""
    theirs: list[tuple[Message, set[int]]] = [
        (DeviceCommand(), {1, 5, 10, 11}),
        (CommandAck(), {1, 2, 3, 4}),
        (CameraRoi(), {1, 2, 3}),
        (CameraPitchYaw(), {1, 2}),
    ]
    for message, numbers in theirs:
        check_equal({each.number for each in message.DESCRIPTOR.fields if each.number < 20}, numbers)
