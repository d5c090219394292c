"""What comes off the wire: values, or rejections by name, and never an exception."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as dialect

from autopilot.adapters.vehicle.heard import (
    Attitude,
    CameraInformation,
    CameraSettings,
    Fix,
    GimbalAttitude,
    GimbalLimits,
    GimbalStatus,
    Heard,
    Heartbeat,
    Reception,
    Rejected,
    Sender,
)
from autopilot.adapters.vehicle.ingress import READERS, read
from tests.autopilot.vehicle.vehicles import (
    answer,
    attitude,
    camera,
    controlled,
    gimbal,
    heartbeat,
    information,
    packed,
    position,
    quaternion,
    system_time,
    zoomed,
)

YEARS_MS = (1_420_070_400_000, 4_102_444_799_999)  # the first and the last that are taken


def check_rejected(datagram: bytes, because: str) -> None:
    assert list(read(datagram)) == [Rejected(because)]


def one(datagram: bytes) -> Heard | Rejected:
    (item,) = read(datagram)
    return item


def gps(fix_type: int, latitude_e7: int = 1, longitude_e7: int = 1) -> bytes:
    return packed(dialect.MAVLink_gps_raw_int_message(1, fix_type, latitude_e7, longitude_e7, 500_000, 1, 1, 1, 1, 9))


def gimbal_raw(q: list[float], flags: int = 32) -> bytes:
    return packed(dialect.MAVLink_gimbal_device_attitude_status_message(0, 0, 1, flags, q, 0, 0, 0, 0))


def limits(*values: float) -> bytes:
    return packed(dialect.MAVLink_gimbal_manager_information_message(1, 0, 1, 0, 0, *values))


@pytest.mark.parametrize(
    ("datagram", "because"),
    [
        (b"\x00", "garbage"),
        (b"GET / HTTP/1.1\r\n\r\n", "garbage"),
        (b"\xfe" + bytes(20), "garbage"),
        (b"\xfd", "truncated"),
        (heartbeat()[:-1], "truncated"),
        (heartbeat()[:-1] + bytes([heartbeat()[-1] ^ 1]), "bad checksum"),
        (heartbeat()[:12] + b"\xff" + heartbeat()[13:], "bad checksum"),
        (heartbeat()[:2] + b"\x02" + heartbeat()[3:], "incompatible"),
        (heartbeat(0), "out of range"),
        (attitude(1, math.nan), "not finite"),
        (attitude(1, 0, math.inf), "not finite"),
        (attitude(1, 1_000), "out of range"),
        (position(1, lat=0, lon=0), "no position"),
        (system_time(1_420_070_399_999), "out of range"),
        (system_time(4_102_444_800_000), "out of range"),
        (system_time((1 << 64) // 1000), "out of range"),
        (position(1, lat=900_000_001), "out of range"),
        (position(1, lon=-1_800_000_001), "out of range"),
        (position(1, alt=2**31 - 1), "out of range"),
        (position(1, relative_alt=-(2**31)), "out of range"),
        (position(1, hdg=36_000), "out of range"),
        (gimbal_raw([math.nan, 0, 0, 0]), "not finite"),
        (gimbal_raw([0, 0, 0, 0]), "out of range"),
        (gimbal_raw([3, 0, 0, 0]), "out of range"),
        (gps(3, 0, 0), "no position"),
        (limits(math.inf, 0, 0, 0), "not finite"),
        (limits(1, -1, 0, 0), "out of range"),
        (limits(0, 1, 0, 7), "out of range"),
        (controlled(255, 0), "out of range"),
        (controlled(0, 190), "out of range"),
        (zoomed(100.1), "out of range"),
        (zoomed(-0.1), "out of range"),
        (zoomed(math.inf), "not finite"),
    ],
)
def test_bad_input_has_a_name(datagram: bytes, because: str) -> None:
    check_rejected(datagram, because)


@given(st.binary(max_size=300))
@settings(max_examples=300, deadline=None, derandomize=True)
def test_garbage_never_raises(datagram: bytes) -> None:
    for prefix in (b"", b"\xfd", heartbeat()):
        for item in read(prefix + datagram):
            assert item is not None


@given(st.sampled_from(range(40)), st.binary(min_size=1, max_size=60), st.integers(0, 20))
@settings(max_examples=300, deadline=None, derandomize=True)
def test_messages_with_any_body_never_raise(kind: int, noise: bytes, at: int) -> None:
    """A valid checksum over nonsense, as a broken autopilot would send it."""
    ids = sorted(READERS)
    message_id = ids[kind % len(ids)]
    header = bytes([len(noise), 0, 0, at, 1, 1]) + message_id.to_bytes(3, "little")
    crc = dialect.x25crc(header + noise + bytes([dialect.mavlink_map[message_id].crc_extra])).crc
    items = list(read(b"\xfd" + header + noise + crc.to_bytes(2, "little")))
    assert len(items) <= 1


def test_several_messages_in_one_datagram() -> None:
    items = list(read(heartbeat() + attitude(5, 10) + b"\x00trailing" + heartbeat()))
    assert [type(item) for item in items] == [Heartbeat, Attitude, Rejected]


def test_a_signature_is_skipped() -> None:
    mav = dialect.MAVLink(None, 1, 1)
    mav.signing.secret_key, mav.signing.sign_outgoing = bytes(32), True
    signed = bytes(dialect.MAVLink_attitude_message(1, 0, 0, 0.5, 0, 0, 0).pack(mav))
    assert [type(item) for item in read(signed + heartbeat())] == [Attitude, Heartbeat]


def test_what_nobody_needs_is_passed_over() -> None:
    assert list(read(packed(dialect.MAVLink_statustext_message(4, b"hello")))) == []
    assert list(read(heartbeat(autopilot=8))) == []
    assert [type(item) for item in read(gps(2, 0, 0))] == [Reception]
    assert list(read(system_time(0))) == []  # the autopilot does not know


def test_values() -> None:
    assert one(heartbeat(armed=True, mode=3)) == Heartbeat(
        sender=one(heartbeat()).sender,  # type: ignore[union-attr]
        autopilot=3,
        vehicle_type=2,
        armed=True,
        custom_mode=3,
    )
    heard = one(position(7, vx=100, vz=-50, hdg=65535))
    assert (heard.north_cm_s, heard.down_cm_s, heard.heading_cdeg) == (100, -50, None)  # type: ignore[union-attr]
    heard = one(answer(195, 4, (9, 8), 50))
    assert (heard.command, heard.result, heard.progress) == (195, 4, 50)  # type: ignore[union-attr]
    assert isinstance(one(gps(3)), Fix)
    assert [one(system_time(at_ms)).wall_ms for at_ms in YEARS_MS] == list(YEARS_MS)  # type: ignore[union-attr]
    heard = one(limits(-math.pi / 2, 0.1, -math.pi, math.pi))
    assert isinstance(heard, GimbalLimits)
    assert heard.pitch_deg == pytest.approx((-90, math.degrees(0.1)))
    assert heard.yaw_deg == pytest.approx((-180, 180))


@pytest.mark.parametrize(
    ("datagram", "pitch_told", "yaw_told", "has_yaw", "endless"),
    [
        (limits(math.nan, 0, -1, 1), False, True, None, False),
        (limits(-1, 1, 0, math.nan), True, False, None, False),
        (limits(0, 0, 0, 0), False, False, None, False),
        (limits(-1, 0, 0, 0), True, True, None, False),
        (information(flags=256 | 2048), True, True, True, True),
        (information(flags=32), True, True, False, False),
        (information(flags=1), True, True, None, False),
    ],
)
def test_what_a_gimbal_does_not_tell(
    datagram: bytes, pitch_told: bool, yaw_told: bool, has_yaw: bool | None, endless: bool
) -> None:
    heard = one(datagram)
    assert isinstance(heard, GimbalLimits)
    assert (heard.pitch_deg is not None, heard.yaw_deg is not None) == (pitch_told, yaw_told)
    assert (heard.has_yaw, heard.turns_endlessly) == (has_yaw, endless)


def test_control_and_cameras() -> None:
    heard = one(controlled(255, 190))
    assert isinstance(heard, GimbalStatus)
    assert heard.primary == Sender(system=255, component=190)
    cameras = [one(camera(flags)) for flags in (64, 63, 0xFFFF)]
    assert [heard.zooms for heard in cameras if isinstance(heard, CameraInformation)] == [True, False, True]
    told = [one(zoomed(value)) for value in (0, 100, math.nan)]
    assert [heard.zoom_percent for heard in told if isinstance(heard, CameraSettings)] == [0, 100, None]


@pytest.mark.parametrize(
    ("flags", "from_north"),
    [(44, False), (60, False), (32, False), (64, True), (80, True), (16, True), (0, False)],
)
def test_the_frame_of_yaw(flags: int, from_north: bool) -> None:
    heard = one(gimbal_raw(quaternion(-30, 40), flags))
    assert isinstance(heard, GimbalAttitude)
    assert heard.from_north is from_north


@pytest.mark.parametrize(("pitch_deg", "yaw_deg"), [(0, 0), (-35, 170), (20, -90), (-89.9, 45), (-90, 45), (-90, -170)])
def test_the_view_of_a_quaternion(pitch_deg: float, yaw_deg: float) -> None:
    heard = one(gimbal(1, pitch_deg, yaw_deg))
    assert isinstance(heard, GimbalAttitude)
    assert (heard.pitch_deg, heard.yaw_deg) == pytest.approx((pitch_deg, yaw_deg), abs=0.06)
