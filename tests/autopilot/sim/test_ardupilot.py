"""ArduPilot's manners as tables: a command in, an answer out, what the vehicle is then; as a real copter was seen."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import common as dialect

from autopilot.sim.modes import Doing
from tests.autopilot.sim.ground import (
    ARM,
    CHOOSE,
    LAND,
    MODE,
    NAN,
    PAUSE,
    REPOSITION,
    RETURN,
    SPEED,
    START,
    TAKE_OFF,
    Ground,
    Row,
    at,
    ground,
    row,
)

ACCEPTED, LATER, DENIED, UNSUPPORTED, FAILED = range(5)
AUTO, GUIDED, LOITER, RTL, LANDING = 3, 4, 5, 6, 9

MISSION = [
    row(16, 0, 0, 0),
    row(22, 0, 0, 20),
    Row(178, p2=8),
    row(16, 60, 0, 20),
    Row(197),
    row(16, 60, 60, 25),
    Row(20),
]


def airborne(mode: int = GUIDED) -> Ground:
    """Return a station whose copter hovers at 15 m."""
    station = ground()
    assert station.upload(MISSION) == 0
    assert station.long(MODE, 1, GUIDED) + station.long(ARM, 1) + station.long(TAKE_OFF, 0, 0, 0, 0, 0, 0, 15) == [
        0,
        0,
        0,
    ]
    station.until(lambda: station.vehicle.flight.seen_m[2] > 14.5)
    station.pass_time(3)
    if mode != GUIDED:
        assert station.long(MODE, 1, mode) == [ACCEPTED]
    return station


def check_copter(story: str, with_mission: bool = True, flying: bool = False) -> Ground:
    """Play a table: command and parameters | results | mode | armed. A pause is `wait SECONDS`."""
    station = airborne() if flying else ground()
    if with_mission and not flying:
        assert station.upload(MISSION) == 0
    for line in story.strip().splitlines():
        asked, results, mode, armed = (part.strip() for part in line.split("|"))
        verb, *numbers = asked.split()
        if verb == "wait":
            station.pass_time(float(numbers[0]))
            found: list[int] = []
        else:
            found = station.long(int(verb), *(float(number) for number in numbers))
        assert found == [int(one) for one in results.split()], line
        assert station.vehicle.custom_mode == int(mode), line
        assert station.vehicle.flight.armed == (armed == "armed"), line
    return station


def test_the_way_into_the_air() -> None:
    """Not armable in AUTO; GUIDED, arm, AUTO, and it stays on the ground until MISSION_START."""
    station = check_copter(
        """
        176 1 3 | 0 | 3 | disarmed
        400 1   | 4 | 3 | disarmed
        176 1 4 | 0 | 4 | disarmed
        400 1   | 0 | 4 | armed
        400 1   | 0 | 4 | armed
        176 1 3 | 0 | 3 | armed
        wait 5  |   | 3 | armed
        """
    )
    assert station.vehicle.flight.body.up_m == 0
    assert "Arm: AUTO mode not armable" in station.texts()
    assert station.long(START) == [ACCEPTED]
    station.pass_time(5)
    assert station.vehicle.flight.body.up_m > 2


def test_an_idle_copter_disarms_by_itself() -> None:
    check_copter(
        """
        176 1 4 | 0 | 4 | disarmed
        400 1   | 0 | 4 | armed
        wait 9  |   | 4 | armed
        wait 2  |   | 4 | disarmed
        """
    )


def test_an_empty_mission_is_started_on_the_ground() -> None:
    check_copter("300 | 0 | 3 | disarmed", with_mission=False)


def test_armed_an_empty_mission_is_refused_and_one_without_a_take_off_too() -> None:
    check_copter(
        """
        400 1   | 0 | 0 | armed
        176 1 3 | 4 | 0 | armed
        300     | 4 | 0 | armed
        """,
        with_mission=False,
    )
    station = ground()
    assert station.upload([row(16, 0, 0, 0), row(16, 50, 0, 20)]) == 0
    assert station.long(ARM, 1) + station.long(MODE, 1, AUTO) == [ACCEPTED, FAILED]
    assert "Auto: Missing Takeoff Cmd" in station.texts()


@pytest.mark.parametrize(
    ("story", "flying"),
    [
        ("176 0 4 | 2 | 0 | disarmed", False),  # no custom mode asked for
        ("176 1 17 | 4 | 0 | disarmed", False),  # no such mode
        ("400 2 | 3 | 0 | disarmed", False),
        ("400 0 | 0 | 0 | disarmed", False),
        ("22 0 0 0 0 0 0 10 | 4 | 0 | disarmed", False),
        ("300 1 | 2 | 0 | disarmed", False),
        ("300 0 3 | 2 | 0 | disarmed", False),
        ("224 3 | 0 | 0 | disarmed", False),
        ("224 7 | 2 | 0 | disarmed", False),
        ("224 -1 | 2 | 0 | disarmed", False),
        ("178 1 5 | 4 | 0 | disarmed", False),  # in STABILIZE
        ("192 | 3 | 0 | disarmed", False),  # a COMMAND_LONG
        ("193 0 | 4 | 0 | disarmed", False),
        ("31999 | 3 | 0 | disarmed", False),
        ("530 | 3 | 0 | disarmed", False),
        ("20 | 0 | 6 | disarmed", False),
        ("21 | 0 | 9 | disarmed", False),
        ("17 | 0 | 5 | disarmed", False),
        ("400 0 | 4 | 4 | armed", True),  # in the air
        ("400 0 21196 | 0 | 4 | disarmed", True),
        ("22 0 0 0 0 0 0 10 | 4 | 4 | armed", True),  # lower than it is
        ("22 0 0 0 0 0 0 30 | 0 | 4 | armed", True),
        ("178 1 5 | 0 | 4 | armed", True),
        ("178 1 0 | 4 | 4 | armed", True),
        ("178 1 -3 | 4 | 4 | armed", True),
        ("193 0 | 0 | 4 | armed", True),
        ("193 2 | 2 | 4 | armed", True),
        ("20 | 0 | 6 | armed", True),
        ("21 | 0 | 9 | armed", True),
        ("300 | 0 | 3 | armed", True),
    ],
)
def test_answers(story: str, flying: bool) -> None:
    check_copter(story, flying=flying)


@pytest.mark.parametrize("mode", [RTL, LANDING])
def test_modes_that_are_not_armable(mode: int) -> None:
    check_copter(f"176 1 {mode} | 0 | {mode} | disarmed\n400 1 | 4 | {mode} | disarmed")


def test_without_satellites_only_the_sticks_fly() -> None:
    station = ground()
    station.vehicle.flight.gps.fix = 1
    assert station.long(MODE, 1, GUIDED) + station.long(ARM, 1) == [FAILED, ACCEPTED]
    station.vehicle.flight.gps.fix = 3
    assert station.long(ARM, 0) + station.long(MODE, 1, GUIDED) == [ACCEPTED, ACCEPTED]
    station.vehicle.flight.gps.fix = 2
    assert station.long(ARM, 1) == [FAILED]


def test_reposition_is_taken_on_the_ground_and_does_nothing_there() -> None:
    station = ground()
    assert station.by_int(REPOSITION, 3, *at(40, 0), 20, -1, 1) == [ACCEPTED]
    assert station.vehicle.custom_mode == GUIDED
    assert station.long(ARM, 1) == [ACCEPTED]
    station.pass_time(5)
    assert station.vehicle.flight.body.east_m == 0


@pytest.mark.parametrize(
    ("frame", "place", "up_m", "flags", "result"),
    [
        (3, at(40, 0), 20, 0, ACCEPTED),
        (0, at(40, 0), 508, 0, ACCEPTED),
        (6, at(40, 0), 20, 1, ACCEPTED),
        (1, at(40, 0), 20, 1, DENIED),
        (3, at(40, 0), NAN, 1, DENIED),
        (3, (950_000_000, 0), 20, 1, DENIED),
        (3, (0, 1_900_000_000), 20, 1, DENIED),
    ],
)
def test_reposition_in_the_air(frame: int, place: tuple[int, int], up_m: float, flags: int, result: int) -> None:
    station = airborne()
    assert station.by_int(REPOSITION, frame, *place, up_m, -1, flags) == [result]
    station.pass_time(15)
    came = (station.vehicle.flight.body.east_m, station.vehicle.flight.body.up_m)
    expected = (40, 20) if result == ACCEPTED else (0, 15)
    assert came == pytest.approx(expected, abs=0.5)


def test_reposition_in_another_mode_needs_its_flag() -> None:
    station = airborne(LOITER)
    assert station.by_int(REPOSITION, 3, *at(40, 0), 20, -1, 0) == [DENIED]
    assert station.by_int(REPOSITION, 3, *at(40, 0), 20, -1, 1) == [ACCEPTED]
    assert station.vehicle.custom_mode == GUIDED


def test_who_is_answered() -> None:
    station = ground()
    assert station.long(31999, target=(2, 1)) == []
    for target in ((1, 0), (0, 0), (1, 2), (1, 100), (1, 154)):
        assert station.long(31999, target=target) == [UNSUPPORTED]
    ack = station.of("COMMAND_ACK")[-1]
    assert (ack.get_srcSystem(), ack.get_srcComponent()) == (1, 1)
    assert (ack.target_system, ack.target_component, ack.progress, ack.result_param2) == (255, 190, 0, 0)


def test_set_mode_is_acknowledged_by_its_own_number() -> None:
    station = ground()
    for base, mode, result in ((1, GUIDED, ACCEPTED), (1, 17, FAILED), (0, GUIDED, DENIED)):
        assert station.ask(dialect.MAVLink_set_mode_message(1, base, mode)) == [result]
    assert {ack.command for ack in station.of("COMMAND_ACK")} == {11}
    assert station.ask(dialect.MAVLink_set_mode_message(2, 1, GUIDED)) == []


def test_pause_stops_a_mission_and_it_goes_on() -> None:
    station = airborne()
    assert station.long(START) == [ACCEPTED]
    station.until(lambda: station.vehicle.flight.body.east_m > 20)
    assert station.long(PAUSE, 0) == [ACCEPTED]
    station.pass_time(10)
    stopped_m = station.vehicle.flight.body.east_m
    assert 20 < stopped_m < 40
    station.pass_time(5)
    assert station.vehicle.flight.body.east_m == pytest.approx(stopped_m, abs=0.05)
    assert station.long(PAUSE, 1) == [ACCEPTED]
    station.until(lambda: station.vehicle.flight.body.east_m > 58, 30)


def test_speed_is_changed_in_flight() -> None:
    station = airborne()
    station.by_int(REPOSITION, 3, *at(500, 0), 15)
    for speed_m_s in (5.0, 2.0, 9.0):
        assert station.long(SPEED, 1, speed_m_s) == [ACCEPTED]
        station.pass_time(6)
        assert station.vehicle.flight.body.east_m_s == pytest.approx(speed_m_s, abs=0.2)


def test_a_mission_is_chosen_into_by_command_and_by_message() -> None:
    station = airborne()
    assert station.long(START) == [ACCEPTED]
    assert station.long(CHOOSE, 5) == [ACCEPTED]
    assert station.vehicle.flight.runner.current == 5
    station.send(dialect.MAVLink_mission_set_current_message(1, 1, 3))
    station.pass_time(0.1)
    assert station.of("MISSION_CURRENT")[-1].seq == 3
    station.send(dialect.MAVLink_mission_set_current_message(1, 1, 30))
    assert station.vehicle.flight.runner.current == 3


@pytest.mark.parametrize("verb", [RETURN, LAND])
def test_it_comes_down_and_disarms(verb: int) -> None:
    station = airborne()
    station.by_int(REPOSITION, 3, *at(60, 0), 15)
    station.pass_time(15)
    assert station.long(verb) == [ACCEPTED]
    station.until(lambda: not station.vehicle.flight.armed)
    where_m = {RETURN: 0, LAND: 60}[verb]
    assert station.vehicle.flight.body.east_m == pytest.approx(where_m, abs=0.5)
    assert station.vehicle.flight.grounded


def test_a_mission_is_flown_and_told_as_a_real_copter_tells_it() -> None:
    """A waypoint with DO items behind it isn't told itself; only NAV items are current, and 0 after disarming."""
    station = ground()
    rows = [*MISSION[:2], Row(178, p2=8), MISSION[3], row(195, 30, 30, 0), MISSION[5], Row(178, p2=3)]
    rows += [row(16, 0, 60, 25), Row(1000, p1=-30), Row(197), Row(20)]
    assert station.upload(rows) == 0
    assert station.long(511, 42, 200_000) == [ACCEPTED]
    station.long(MODE, 1, GUIDED)
    station.long(ARM, 1)
    station.long(START)
    station.until(lambda: not station.vehicle.flight.armed)
    station.pass_time(1)
    assert [message.seq for message in station.of("MISSION_ITEM_REACHED")] == [2, 4, 6, 9]
    current = [message.seq for message in station.of("MISSION_CURRENT")]
    assert list(dict.fromkeys(current[1:-1])) == [0, 1, 3, 5, 7, 10]
    assert current[-1] == 0
    reached = [text for text in station.texts() if text.startswith("Reached")]
    assert reached == [f"Reached command #{seq}" for seq in (1, 3, 5, 7)]
    assert station.vehicle.custom_mode == AUTO


def test_behind_the_last_waypoint_it_hovers() -> None:
    station = ground()
    assert station.upload(MISSION[:4]) == 0
    for command in ((MODE, 1, GUIDED), (ARM, 1), (START,)):
        assert station.long(*command) == [ACCEPTED]
    station.pass_time(60)
    body = station.vehicle.flight.body
    assert (body.east_m, body.up_m) == pytest.approx((60, 20), abs=1.5)
    assert (station.vehicle.custom_mode, station.vehicle.flight.armed) == (AUTO, True)


def test_a_plane_waits_for_its_pilot() -> None:
    """Its pilot takes off by hand and switches to AUTO; behind the mission it comes home and circles."""
    station = ground(frame="plane")
    assert station.upload([row(16, 0, 0, 0), row(16, 300, 0, 80), row(16, 300, 300, 80)]) == 0
    station.vehicle.launch(80)
    station.pass_time(40)
    assert (station.vehicle.custom_mode, station.vehicle.flight.armed) == (0, True)
    assert station.vehicle.switch_mode(10) == ACCEPTED
    station.until(lambda: station.vehicle.custom_mode == 11)
    assert [message.seq for message in station.of("MISSION_ITEM_REACHED")] == [1, 2]
    station.pass_time(60)
    body = station.vehicle.flight.body
    assert (body.east_m**2 + body.north_m**2) ** 0.5 < 120
    assert station.vehicle.flight.doing is Doing.RETURN


@pytest.mark.parametrize(
    ("command", "numbers", "result"),
    [
        (TAKE_OFF, (0, 0, 0, 0, 0, 0, 50), UNSUPPORTED),
        (LAND, (), UNSUPPORTED),
        (MODE, (1, 13), ACCEPTED),
        (MODE, (1, 9), FAILED),
        (ARM, (1,), ACCEPTED),
    ],
)
def test_a_plane_answers(command: int, numbers: tuple[float, ...], result: int) -> None:
    station = ground(frame="plane")
    assert station.long(command, *numbers) == [result]


def test_a_plane_takes_off_and_lands_by_mission() -> None:
    """Armed in AUTO it goes at once."""
    station = ground(frame="plane")
    rows = [row(16, 0, 0, 0), row(22, 0, 0, 50), row(16, 0, 500, 60), row(16, 400, 500, 40), row(21, 0, 400, 0)]
    assert station.upload(rows) == 0
    assert station.long(MODE, 1, 10) + station.long(ARM, 1) == [ACCEPTED, ACCEPTED]
    station.until(lambda: not station.vehicle.flight.armed)
    assert [message.seq for message in station.of("MISSION_ITEM_REACHED")] == [1, 2, 3]
    body = station.vehicle.flight.body
    assert (body.east_m, body.north_m) == pytest.approx((0, 400), abs=120)


def test_an_unfitted_gimbal_turns_the_nose_and_refuses_angles() -> None:
    station = airborne()
    station.vehicle.gimbal_fitted = False
    assert station.by_int(195, 0, *at(300, 0), 488) == [ACCEPTED]
    station.pass_time(5)
    assert station.vehicle.flight.body.yaw_deg == pytest.approx(90, abs=2)
    assert station.long(1000, -30, 0, NAN, NAN) == [FAILED]
    assert station.long(197) == [ACCEPTED]
    assert station.vehicle.flight.frame.nose_at_m is None  # type: ignore[attr-defined]
