"""A vehicle from the outside: what it tells asked and unasked, and the misfortunes that can be brought upon it."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as dialect

from autopilot.sim.modes import Doing
from autopilot.sim.vehicle import UNIX_S, PersonalityName, Vehicle
from tests.autopilot.sim.ground import ARM, MODE, PEER, START, TAKE_OFF, Ground, Row, at, ground, row

UNASKED = {"HEARTBEAT", "SYS_STATUS", "TIMESYNC", "HOME_POSITION", "GPS_GLOBAL_ORIGIN"}
ON_REQUEST = {
    33: "GLOBAL_POSITION_INT",
    30: "ATTITUDE",
    24: "GPS_RAW_INT",
    147: "BATTERY_STATUS",
    245: "EXTENDED_SYS_STATE",
    2: "SYSTEM_TIME",
    42: "MISSION_CURRENT",
    148: "AUTOPILOT_VERSION",
    285: "GIMBAL_DEVICE_ATTITUDE_STATUS",
}


def hovering(name: PersonalityName = "ardupilot") -> Ground:
    """Return a station whose copter is 20 m up."""
    station = ground(name)
    if name == "ardupilot":
        assert station.long(MODE, 1, 4) + station.long(ARM, 1) + station.long(TAKE_OFF, 0, 0, 0, 0, 0, 0, 20) == [0] * 3
    else:
        assert station.long(TAKE_OFF, 0, 0, 0, math.nan, 0, 0, 508) + station.long(ARM, 1) == [0] * 2
    station.pass_time(15)
    assert station.vehicle.flight.body.up_m == pytest.approx(20, abs=0.5)
    return station


def told(station: Ground, message_id: int) -> Any:
    """Ask for a message once and return it."""
    before = len(station.heard)
    assert station.long(512, message_id) == [0]
    return next(message for message in station.heard[before:] if message.get_msgId() == message_id)


def test_little_is_sent_unasked_and_the_rest_when_asked() -> None:
    station = ground()
    station.pass_time(25)
    assert {message.get_type() for message in station.heard} == UNASKED
    assert len(station.of("HEARTBEAT")) == pytest.approx(25, abs=1)
    assert len(station.of("TIMESYNC")) == 3
    for message_id, name in ON_REQUEST.items():
        assert station.long(511, message_id, 200_000) == [0]
        assert told(station, message_id).get_type() == name
    station.heard.clear()
    station.pass_time(10)
    for name in ON_REQUEST.values():
        assert len(station.of(name)) == pytest.approx(50, abs=3), name


def test_px4_tells_more_unasked() -> None:
    station = ground("px4")
    station.pass_time(5)
    kinds = {message.get_type() for message in station.heard}
    assert kinds > UNASKED | {"MISSION_CURRENT", "EXTENDED_SYS_STATE", "BATTERY_STATUS", "GLOBAL_POSITION_INT"}
    assert len(station.of("MISSION_CURRENT")) == pytest.approx(5, abs=1)


@pytest.mark.parametrize(
    ("name", "frame", "autopilot", "kind"),
    [("ardupilot", "copter", 3, 2), ("ardupilot", "plane", 3, 1), ("px4", "copter", 12, 2), ("px4", "plane", 12, 1)],
)
def test_it_says_what_it_is(name: Any, frame: Any, autopilot: int, kind: int) -> None:
    station = ground(name, frame)
    station.pass_time(1)
    beat = station.of("HEARTBEAT")[-1]
    assert (beat.autopilot, beat.type, beat.base_mode & 128, beat.system_status) == (autopilot, kind, 0, 3)
    assert (beat.get_srcSystem(), beat.get_srcComponent()) == (1, 1)


def test_armed_and_landed_state_are_told() -> None:
    station = ground()
    states = [told(station, 245).landed_state]
    station.long(MODE, 1, 4)
    station.long(ARM, 1)
    station.long(TAKE_OFF, 0, 0, 0, 0, 0, 0, 20)
    station.pass_time(3)
    states.append(told(station, 245).landed_state)
    station.pass_time(15)
    assert station.of("HEARTBEAT")[-1].base_mode & 128
    states.append(told(station, 245).landed_state)
    station.long(21)
    station.pass_time(3)
    states.append(told(station, 245).landed_state)
    station.until(lambda: not station.vehicle.flight.armed)
    states.append(told(station, 245).landed_state)
    assert states == [1, 3, 2, 4, 1]


def test_where_it_is_told_to_be() -> None:
    station = hovering()
    station.by_int(192, 3, *at(30, 40), 25)
    station.pass_time(20)
    place = told(station, 33)
    assert (place.lat, place.lon) == pytest.approx(at(30, 40), abs=10)
    assert (place.relative_alt, place.alt) == pytest.approx((25_000, 513_000), abs=300)


def test_time_is_told_and_synchronised() -> None:
    station = ground()
    station.pass_time(7)
    station.send(dialect.MAVLink_timesync_message(0, 123_456))
    station.pass_time(0.1)
    (reply,) = [message for message in station.of("TIMESYNC") if message.tc1]
    assert reply.ts1 == 123_456
    assert reply.tc1 == pytest.approx(7e9, abs=0.2e9)
    asked = len(station.of("TIMESYNC"))
    station.send(dialect.MAVLink_timesync_message(5, 6))
    station.pass_time(0.1)
    assert len(station.of("TIMESYNC")) == asked
    before = told(station, 2)
    assert before.time_unix_usec == pytest.approx((UNIX_S + station.vehicle.time_s) * 1e6, abs=1e6)
    station.vehicle.clock_jump_s = 3_600
    after = told(station, 2)
    assert after.time_unix_usec - before.time_unix_usec == pytest.approx(3.6e9, abs=1e6)
    assert after.time_boot_ms - before.time_boot_ms < 1_000


def test_the_battery_sags_with_use_and_can_be_edited() -> None:
    station = ground()
    idle = told(station, 1)
    station = hovering()
    flying = told(station, 1)
    assert flying.voltage_battery < idle.voltage_battery - 200
    assert flying.current_battery > idle.current_battery + 1_000
    station.vehicle.flight.battery.charge_percent = 12.0
    low = told(station, 1)
    assert low.battery_remaining == 12
    assert low.voltage_battery < flying.voltage_battery - 1_000
    cells = told(station, 147)
    assert (cells.battery_remaining, cells.voltages[0] * 4) == (12, pytest.approx(low.voltage_battery, abs=20))
    station.pass_time(60)
    assert station.vehicle.flight.battery.charge_percent < 11.5
    station.vehicle.flight.battery.charge_percent = 0.0
    station.until(lambda: not station.vehicle.flight.armed)
    assert "Battery 1 is critical, landing" in station.texts()


def test_wind_costs_charge() -> None:
    calm, windy = hovering(), hovering()
    windy.vehicle.flight.wind.east_m_s = 10
    for station in (calm, windy):
        station.pass_time(60)
    assert windy.vehicle.flight.battery.charge_percent < calm.vehicle.flight.battery.charge_percent - 0.3


def test_a_jump_of_the_receiver_is_believed_and_steered_against() -> None:
    station = hovering()
    before = told(station, 33)
    station.vehicle.flight.gps.jump_east_m = 50
    after = told(station, 33)
    assert (after.lon - before.lon) * 1e-7 * 111_320 * math.cos(math.radians(47.4)) == pytest.approx(50, abs=1)
    station.pass_time(20)
    assert station.vehicle.flight.body.east_m == pytest.approx(-50, abs=1)
    assert told(station, 33).lon == pytest.approx(before.lon, abs=20)


def test_without_satellites_it_lands() -> None:
    station = hovering()
    station.vehicle.flight.gps.fix = 1
    station.pass_time(4)
    assert (station.vehicle.custom_mode, told(station, 24).fix_type) == (4, 1)
    assert not told(station, 1).onboard_control_sensors_health & 32
    station.pass_time(2)
    assert station.vehicle.custom_mode == 9
    assert "EKF Failsafe: changed to LAND Mode" in station.texts()


@pytest.mark.parametrize("name", ["ardupilot", "px4"])
def test_a_reboot_in_flight(name: PersonalityName) -> None:
    """Silent for three seconds; then armed in its first mode, its clock anew, what was asked for forgotten."""
    station = hovering(name)
    assert station.upload([row(16, 0, 0, 0), row(22, 0, 0, 20), row(16, 300, 0, 20)]) == 0
    station.long(511, 285, 100_000)
    station.long(1001, 255, 190)
    station.vehicle.reboot()
    station.heard.clear()
    assert station.long(31999) == []
    station.pass_time(2.8)
    assert station.heard == []
    station.pass_time(2)
    assert station.of("COMMAND_ACK") == []  # what came while it was silent wasn't heard
    assert station.of("HEARTBEAT")[-1].base_mode & 128
    assert station.of("HEARTBEAT")[-1].custom_mode == station.vehicle.personality.modes[Doing.MANUAL]
    assert station.of("GIMBAL_DEVICE_ATTITUDE_STATUS") == []
    assert station.vehicle.gimbal.primary == (0, 0)
    assert told(station, 2).time_boot_ms < 5_000
    assert station.vehicle.flight.body.up_m == pytest.approx(20, abs=1)
    rows = station.download()
    assert rows is not None
    assert len(rows) == 3


def test_a_reboot_forgets_answers_that_were_late() -> None:
    station = ground()
    station.vehicle.unkind.ack_late_s = 20
    station.long(197)
    station.vehicle.reboot()
    station.pass_time(25)
    assert station.of("COMMAND_ACK") == []


def test_a_reboot_ends_an_upload() -> None:
    station = ground()
    station.send(dialect.MAVLink_mission_count_message(1, 1, 3, 0))
    station.vehicle.reboot(1.0)
    station.pass_time(15)
    assert station.of("MISSION_ACK") == []


def test_a_lost_ground_station_brings_it_home_where_that_is_wanted() -> None:
    station = hovering()
    station.beats = False
    station.pass_time(20)
    assert station.vehicle.custom_mode == 4
    station.vehicle.ground_station_lost_s = 5
    station.pass_time(1)
    assert station.vehicle.custom_mode == 6


def test_an_onboard_computer_is_no_ground_station() -> None:
    station = hovering()
    station.vehicle.ground_station_lost_s = 5
    station.beats = False
    for _ in range(10):
        station.send(dialect.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
        station.pass_time(1)
    assert station.vehicle.custom_mode == 6


@pytest.mark.parametrize(
    ("unkind", "results"),
    [
        ({"ack_lost": 1.0}, []),
        ({"ack_twice": 1.0}, [0, 0]),
        ({"ack_in_progress": 1.0}, [5, 0]),
        ({"ack_forever": 1.0}, [5]),
        ({"ack_stranger": 1.0}, [4, 0]),
        ({"only_int": True}, [8]),
        ({}, [0]),
    ],
)
def test_unkind_answers(unkind: dict[str, Any], results: list[int]) -> None:
    station = ground()
    for name, value in unkind.items():
        setattr(station.vehicle.unkind, name, value)
    station.long(197)
    station.pass_time(2)
    answers = station.of("COMMAND_ACK")
    assert [answer.result for answer in answers] == results
    strangers = [answer for answer in answers if answer.get_srcSystem() != 1]
    assert len(strangers) == (results == [4, 0])


def test_forms_that_are_refused() -> None:
    station = ground()
    station.vehicle.unkind.only_long = True
    assert station.by_int(195, 0, *at(5, 5), 488) + station.long(197) == [7, 0]
    station.vehicle.unkind.only_long = False
    station.vehicle.unkind.frames_refused = (0,)
    assert station.by_int(195, 0, *at(5, 5), 488) + station.by_int(195, 5, *at(5, 5), 488) == [9, 0]


def test_late_answers_and_lost_streams() -> None:
    station = ground()
    station.vehicle.unkind.ack_late_s = 60
    assert station.long(197) == []
    station.pass_time(60)
    assert len(station.of("COMMAND_ACK")) == 1
    station.heard.clear()
    station.vehicle.unkind.stream_lost = 1
    station.pass_time(3)
    assert station.of("HEARTBEAT") == []


def test_a_bad_link_bites_both_ways() -> None:
    station = ground()
    station.vehicle.inward.weather.lost = 1
    assert station.long(197) == []
    station.vehicle.inward.weather.lost = 0
    station.vehicle.outward.weather.lost = 1
    station.heard.clear()
    station.pass_time(3)
    assert station.heard == []
    station.vehicle.outward.weather.lost = 0
    station.vehicle.inward.weather.least_s = 2
    station.long(197)
    station.pass_time(1.5)
    assert station.of("COMMAND_ACK") == []
    station.pass_time(0.6)
    assert len(station.of("COMMAND_ACK")) == 1


def test_a_mission_points_the_camera() -> None:
    station = ground()
    rows = [row(16, 0, 0, 0), row(22, 0, 0, 20), row(195, 100, 0, 0), row(16, 0, 60, 20), Row(197)]
    assert station.upload([*rows, Row(1000, p1=-80, p2=0), row(16, 0, 90, 20)]) == 0
    station.long(MODE, 1, 4)
    station.long(ARM, 1)
    station.long(START)
    station.until(lambda: station.vehicle.flight.body.north_m > 50)
    motion, gimbal = station.vehicle.motion, station.vehicle.gimbal
    bearing_deg = math.degrees(math.atan2(100 - motion.east_m, -motion.north_m)) % 360
    assert (motion.yaw_deg + gimbal.yaw_deg) % 360 == pytest.approx(bearing_deg, abs=3)
    station.until(lambda: station.vehicle.flight.body.north_m > 85)
    assert station.vehicle.gimbal.pitch_deg == pytest.approx(-80)


def test_the_same_calls_the_same_flight() -> None:
    def datagrams() -> list[bytes]:
        vehicle, found = Vehicle(7), []
        vehicle.outward.weather.lost = vehicle.outward.weather.twice = 0.3
        station = Ground(vehicle)
        station.long(MODE, 1, 4)
        station.long(ARM, 1)
        station.long(TAKE_OFF, 0, 0, 0, 0, 0, 0, 20)
        for _ in range(300):
            vehicle.step(0.05)
            found += [data for _, data in vehicle.take()]
        return found

    assert datagrams() == datagrams()


def test_steps_of_any_length_give_the_same_flight() -> None:
    ends = []
    for dt_s in (0.01, 0.05, 0.7):
        vehicle = Vehicle(1)
        vehicle.launch(20)
        for _ in range(round(14 / dt_s)):
            vehicle.step(dt_s)
        ends.append(vehicle.flight.body)
    assert ends[0] == ends[1] == ends[2]


def test_peers_are_bounded_and_forgotten() -> None:
    vehicle = Vehicle(1)
    for port in range(50):
        vehicle.hear(
            ("127.0.0.1", port), bytes(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(dialect.MAVLink(None)))
        )
    assert len({peer for peer, _ in vehicle.take()}) == 8
    vehicle.step(16)
    assert vehicle.take() == []


@given(st.binary(max_size=200))
@settings(max_examples=50, deadline=None, derandomize=True)
def test_garbage_does_not_upset_it(datagram: bytes) -> None:
    station = ground()
    station.vehicle.hear(PEER, datagram)
    assert station.long(31999) == [3]


COMMANDS = st.sampled_from([16, 17, 20, 21, 22, 176, 178, 192, 193, 195, 197, 201, 224, 300, 400, 511, 512, 1000, 1001])
NUMBERS = st.one_of(st.floats(width=32), st.sampled_from([0.0, 1.0, 2.0, 3.0, 4.0, 10.0, math.nan]))


@given(
    st.lists(st.tuples(COMMANDS, st.lists(NUMBERS, min_size=7, max_size=7), st.booleans()), min_size=1, max_size=8),
    st.sampled_from(["ardupilot", "px4"]),
    st.sampled_from(["copter", "plane"]),
)
@settings(max_examples=60, deadline=None, derandomize=True)
def test_no_command_upsets_it(story: list[tuple[int, list[float], bool]], name: Any, frame: Any) -> None:
    """Each is answered once, and it stays where one can be, on the ground or in the air."""
    station = ground(name, frame)
    station.vehicle.launch(30)
    station.pass_time(2)
    for command, numbers, as_int in story:
        if as_int:
            found = station.by_int(command, 3, *at(50, 50), numbers[6], *numbers[:4])
        else:
            found = station.long(command, *numbers)
        assert len(found) == 1
        station.pass_time(1)
    body = station.vehicle.flight.body
    assert all(math.isfinite(value) for value in (body.east_m, body.north_m, body.up_m, body.yaw_deg))
    assert station.of("HEARTBEAT")
