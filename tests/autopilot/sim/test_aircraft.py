"""The simulated ArduCopter answers as a real one was seen to, from the outside: bytes in, bytes out."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as dialect

from autopilot.adapters.vehicle.heard import GimbalAttitude
from autopilot.adapters.vehicle.ingress import read
from autopilot.geo import offset
from autopilot.sim.aircraft import HOME, Aircraft, Unkindness
from autopilot.sim.gimbal import Angles, Gimbal, Spot
from autopilot.sim.route import Route

PEER, OTHER = ("127.0.0.1", 1), ("127.0.0.1", 2)
ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED, IN_PROGRESS = range(6)
NAN = math.nan
LAT_E7, LON_E7 = 473_980_000, 85_460_000


def packed(message: Any, system: int = 255, component: int = 190) -> bytes:
    return bytes(message.pack(dialect.MAVLink(None, system, component)))


def long(command: int, *parameters: float, target: tuple[int, int] = (1, 1)) -> bytes:
    filled = (*parameters, *(0.0,) * (7 - len(parameters)))
    return packed(dialect.MAVLink_command_long_message(*target, command, 0, *filled))


def integer(command: int, frame: int, x: int, y: int, z: float, target: tuple[int, int] = (1, 1)) -> bytes:
    return packed(dialect.MAVLink_command_int_message(*target, frame, command, 0, 0, 0, 0, 0, 0, x, y, z))


def out(aircraft: Aircraft) -> list[tuple[tuple[str, int], Any]]:
    """Return what is due, decoded."""
    reader = dialect.MAVLink(None)
    return [(peer, reader.parse_buffer(data)[0]) for peer, data in aircraft.take()]


def kinds(aircraft: Aircraft, seconds: float) -> dict[str, int]:
    """Return how many of each message come within a time."""
    found: dict[str, int] = {}
    for _ in range(round(seconds / 0.02)):
        aircraft.step(0.02)
        for _, message in out(aircraft):
            found[message.get_type()] = found.get(message.get_type(), 0) + 1
    return found


def check_answer(datagram: bytes, result: int | None) -> Aircraft:
    """One answer with that result, to whoever asked; None: no answer at all."""
    aircraft = Aircraft(1, 60)
    aircraft.hear(PEER, datagram)
    answers = [(peer, message) for peer, message in out(aircraft) if message.get_type() == "COMMAND_ACK"]
    assert [message.result for _, message in answers] == [result for result in [result] if result is not None]
    for peer, message in answers:
        assert peer == PEER
        assert (message.get_srcSystem(), message.get_srcComponent()) == (1, 1)
        assert (message.target_system, message.target_component) == (255, 190)
        assert (message.progress, message.result_param2) == (0, 0)
    return aircraft


@pytest.mark.parametrize(
    ("datagram", "result"),
    [
        (integer(195, 0, LAT_E7, LON_E7, 488), ACCEPTED),
        (integer(195, 5, LAT_E7, LON_E7, 488), ACCEPTED),
        (integer(195, 3, LAT_E7, LON_E7, 0), ACCEPTED),
        (integer(195, 10, LAT_E7, LON_E7, 0), ACCEPTED),
        (integer(195, 1, LAT_E7, LON_E7, 0), DENIED),
        (integer(195, 2, LAT_E7, LON_E7, 0), DENIED),
        (integer(195, 0, LAT_E7, LON_E7, NAN), DENIED),
        (integer(195, 0, 950_000_000, LON_E7, 0), FAILED),
        (integer(195, 0, 2**31 - 1, 0, 0), FAILED),
        (long(195, 0, 0, 0, 0, 47.398, 8.546, 0), ACCEPTED),
        (long(195, 0, 0, 0, 0, 95, 8.546, 0), FAILED),
        (long(195, 0, 0, 0, 0, NAN, 8.546, 0), FAILED),
        (long(195, 0, 0, 0, 0, 1e30, 8.546, 0), FAILED),
        (long(201, 0, 0, 0, 0, 47.398, 8.546, 0), ACCEPTED),
        (long(197), ACCEPTED),
        (long(1000, -30, 40, NAN, NAN, 0, 0, 0), ACCEPTED),
        (long(1000, -30, 40, NAN, NAN, 0, 0, 1), ACCEPTED),
        (long(1000, -30, 40, NAN, NAN, 0, 0, 2), FAILED),
        (long(1000, -30, 40, NAN, NAN, 0, 0, 154), FAILED),
        (long(1000, -30, NAN, NAN, NAN, 0, 0, 0), FAILED),
        (long(1000, NAN, NAN, 1, 1, 0, 0, 0), ACCEPTED),
        (long(1000, -120, 200, NAN, NAN, 0, 0, 0), ACCEPTED),
        (long(1001, 255, 190, -1, -1), ACCEPTED),
        (long(1001, -4, 190), FAILED),
        (long(1001, 256, 190), FAILED),
        (long(511, 33, 200_000), ACCEPTED),
        (long(511, 158, 200_000), DENIED),
        (long(511, NAN, 200_000), DENIED),
        (long(512, 280), ACCEPTED),
        (long(512, 283), FAILED),
        (long(512, 77777), FAILED),
        (long(512, 259), ACCEPTED),
        (long(31999), UNSUPPORTED),
        (integer(31999, 0, 0, 0, 0), UNSUPPORTED),
        (long(531), UNSUPPORTED),
        (long(192, 0), UNSUPPORTED),
        (long(2000), FAILED),
        (long(400, 1), FAILED),
        (long(197, target=(1, 0)), ACCEPTED),
        (long(197, target=(0, 0)), ACCEPTED),
        (long(197, target=(1, 154)), ACCEPTED),
        (long(197, target=(2, 1)), None),
        (b"garbage", None),
        (long(197)[:-1], None),
    ],
)
def test_answers(datagram: bytes, result: int | None) -> None:
    check_answer(datagram, result)


@pytest.mark.parametrize(
    ("datagram", "up_m"),
    [
        (integer(195, 0, LAT_E7, LON_E7, 500), 12),
        (integer(195, 3, LAT_E7, LON_E7, 12), 12),
        (long(195, 0, 0, 0, 0, 47.398, 8.546, 12), 12),
    ],
)
def test_the_frame_of_an_altitude(datagram: bytes, up_m: float) -> None:
    spot = check_answer(datagram, ACCEPTED).gimbal.aim
    assert isinstance(spot, Spot)
    assert spot.up_m == pytest.approx(up_m)
    assert (spot.east_m, spot.north_m) == pytest.approx((30.2, 33.4), abs=0.6)


def test_zero_and_roi_none_cancel_a_place_but_not_angles() -> None:
    for cancel in (integer(195, 0, 0, 0, 0), long(197)):
        aircraft = check_answer(integer(195, 0, LAT_E7, LON_E7, 488), ACCEPTED)
        aircraft.hear(PEER, cancel)
        assert aircraft.gimbal.aim == Angles(-35, 0, False)
        aircraft.hear(PEER, long(1000, -50, 20, NAN, NAN, 0, 0, 0))
        aircraft.hear(PEER, cancel)
        assert aircraft.gimbal.aim == Angles(-50, 20, False)


def test_out_of_range_is_clamped_in_silence() -> None:
    aircraft = check_answer(long(1000, -120, 200, NAN, NAN, 0, 0, 0), ACCEPTED)
    for _ in range(100):
        aircraft.step(0.1)
    assert (aircraft.gimbal.pitch_deg, aircraft.gimbal.yaw_deg) == pytest.approx((-90, -160))


def test_the_gimbal_takes_its_time() -> None:
    gimbal, motion = Gimbal(rate_deg_s=10, pitch_deg=0), Route(1, 60).at(0)
    gimbal.aim = Angles(-30, 170, False)
    gimbal.yaw_deg = -170
    gimbal.step(1, motion)
    assert (gimbal.pitch_deg, gimbal.yaw_deg) == pytest.approx((-10, -180))
    gimbal.step(2, motion)
    assert (gimbal.pitch_deg, gimbal.yaw_deg) == pytest.approx((-30, 170))


def test_a_locked_yaw_holds_north_while_the_aircraft_turns() -> None:
    aircraft = Aircraft(1, 60)
    aircraft.hear(PEER, long(1000, -30, 90, NAN, NAN, 16, 0, 0))
    for _ in range(3_000):
        aircraft.step(0.01)
    assert (aircraft.motion.yaw_deg + aircraft.gimbal.yaw_deg - 90) % 360 == pytest.approx(0, abs=1e-6)


def test_little_is_sent_unasked_and_the_rest_when_asked() -> None:
    aircraft = Aircraft(1, 60)
    assert kinds(aircraft, 3) == {}
    aircraft.hear(PEER, packed(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)))
    assert set(kinds(aircraft, 10)) == {"HEARTBEAT", "SYS_STATUS", "HOME_POSITION", "GPS_GLOBAL_ORIGIN"}
    aircraft.hear(PEER, long(511, 33, 200_000))
    aircraft.hear(PEER, long(511, 285, 100_000))
    aircraft.hear(PEER, long(512, 280))
    found = kinds(aircraft, 10)
    assert found["HEARTBEAT"] == pytest.approx(10, abs=1)
    assert found["GLOBAL_POSITION_INT"] == pytest.approx(50, abs=3)
    assert found["GIMBAL_DEVICE_ATTITUDE_STATUS"] == pytest.approx(100, abs=5)
    assert found["GIMBAL_MANAGER_INFORMATION"] == 1
    aircraft.hear(PEER, long(511, 33, -1))
    assert "GLOBAL_POSITION_INT" not in kinds(aircraft, 2)


def test_an_unknown_stream_is_named_in_a_text() -> None:
    aircraft = Aircraft(1, 60)
    aircraft.hear(PEER, long(511, 158, 1))
    texts = [message.text for _, message in out(aircraft) if message.get_type() == "STATUSTEXT"]
    assert texts == ["No ap_message for mavlink id (158)"]


def test_streams_go_to_every_peer_and_answers_to_one() -> None:
    aircraft = Aircraft(1, 60)
    aircraft.hear(OTHER, long(512, 281))
    aircraft.hear(PEER, long(197))
    messages = out(aircraft)
    assert {peer for peer, message in messages if message.get_type() == "GIMBAL_MANAGER_STATUS"} == {PEER, OTHER}
    assert [peer for peer, message in messages if message.get_type() == "COMMAND_ACK"] == [OTHER, PEER]


def test_silent_peers_are_forgotten_and_their_number_is_bounded() -> None:
    aircraft = Aircraft(1, 60)
    for port in range(50):
        aircraft.hear(("127.0.0.1", port), packed(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)))
    assert len({peer for peer, _ in aircraft.take()}) == 8
    aircraft.step(16)
    assert aircraft.take() == []


def test_it_tells_where_it_is() -> None:
    aircraft = Aircraft(1, 60)
    aircraft.step(30)
    aircraft.hear(PEER, long(512, 33))
    (told,) = [message for _, message in out(aircraft) if message.get_type() == "GLOBAL_POSITION_INT"]
    motion = aircraft.motion
    latitude_deg, longitude_deg = offset(HOME[0], HOME[1], motion.east_m, motion.north_m)
    assert (told.lat, told.lon) == pytest.approx((latitude_deg * 1e7, longitude_deg * 1e7), abs=1)
    assert (told.alt, told.relative_alt) == pytest.approx(((488 + motion.up_m) * 1000, motion.up_m * 1000), abs=1)
    assert (told.vx, told.vy) == pytest.approx((motion.north_m_s * 100, motion.east_m_s * 100), abs=1)
    assert told.hdg == pytest.approx(motion.yaw_deg * 100, abs=1)


def test_it_tells_how_fast_it_climbs() -> None:
    aircraft = Aircraft(1, 60)
    aircraft.step(6)
    aircraft.hear(PEER, long(512, 33))
    (told,) = [message for _, message in out(aircraft) if message.get_type() == "GLOBAL_POSITION_INT"]
    assert told.vz == pytest.approx(-aircraft.motion.up_m_s * 100, abs=1)
    assert told.vz < -100


@pytest.mark.parametrize(("flags", "locked"), [(4 | 8 | 32, False), (4 | 8 | 16 | 32, True)])
def test_the_gimbal_tells_its_yaw_from_the_nose(flags: int, locked: bool) -> None:
    aircraft = Aircraft(1, 60)
    aircraft.hear(PEER, long(1000, -40, 130, NAN, NAN, 16 * locked, 0, 0))
    aircraft.step(20)
    aircraft.hear(PEER, long(512, 285))
    sent = [data for _, data in aircraft.take() if int.from_bytes(data[7:10], "little") == 285]
    (heard,) = read(sent[0])
    assert isinstance(heard, GimbalAttitude)
    assert (heard.pitch_deg, heard.yaw_deg) == pytest.approx((-40, aircraft.gimbal.yaw_deg), abs=1e-3)
    assert heard.from_north is False
    assert dialect.MAVLink(None).parse_buffer(sent[0])[0].flags == flags


def test_held_it_stays_on_the_ground() -> None:
    aircraft = Aircraft(1, 60)
    aircraft.held = True
    aircraft.step(30)
    assert (aircraft.time_s, aircraft.motion.up_m, aircraft.motion.armed) == (30, 0, False)


def results(aircraft: Aircraft, seconds: float) -> list[int]:
    found = []
    for _ in range(round(seconds / 0.1)):
        found += [message.result for _, message in out(aircraft) if message.get_type() == "COMMAND_ACK"]
        aircraft.step(0.1)
    return found


def test_unkindness() -> None:
    aircraft = Aircraft(1, 60, unkind=Unkindness(answer_lost=1))
    aircraft.hear(PEER, long(197))
    assert results(aircraft, 1) == []
    aircraft.unkind = Unkindness(in_progress=1)
    aircraft.hear(PEER, long(197))
    assert results(aircraft, 0.2) == [IN_PROGRESS]
    assert results(aircraft, 1) == [ACCEPTED]
    aircraft.unkind = Unkindness(answer_late_s=100)
    aircraft.hear(PEER, long(197))
    assert results(aircraft, 0.2) == []
    assert results(aircraft, 100) == [ACCEPTED]
    aircraft.unkind = Unkindness(stream_lost=1)
    aircraft.hear(PEER, packed(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)))
    assert kinds(aircraft, 3) == {}


@given(st.binary(max_size=200))
@settings(max_examples=100, deadline=None, derandomize=True)
def test_garbage_does_not_upset_it(datagram: bytes) -> None:
    aircraft = Aircraft(1, 60)
    aircraft.hear(PEER, datagram)
    aircraft.hear(PEER, long(197))
    assert "COMMAND_ACK" in {message.get_type() for _, message in out(aircraft)}


@given(st.lists(st.floats(width=32), min_size=7, max_size=7), st.sampled_from([195, 197, 201, 1000, 1001, 511, 512]))
@settings(max_examples=200, deadline=None, derandomize=True)
def test_no_parameter_upsets_it(parameters: list[float], command: int) -> None:
    aircraft = Aircraft(1, 60)
    aircraft.hear(PEER, long(command, *parameters))
    aircraft.step(0.1)
    assert len([1 for _, message in out(aircraft) if message.get_type() == "COMMAND_ACK"]) == 1
    assert math.isfinite(aircraft.gimbal.pitch_deg + aircraft.gimbal.yaw_deg)
