"""PX4's manners as tables: a command in, an answer out, and what the vehicle is then."""

from __future__ import annotations

import pytest

from tests.autopilot.sim.ground import (
    ARM,
    CHOOSE,
    LAND,
    MODE,
    NAN,
    PAUSE,
    REPOSITION,
    RETURN,
    START,
    TAKE_OFF,
    Ground,
    Row,
    at,
    custom_mode,
    ground,
    row,
)

ACCEPTED, LATER, DENIED, UNSUPPORTED, FAILED = range(5)
MANUAL, HOLD, MISSION, RETURNS, LANDS, TAKES_OFF = (1, 0), (4, 3), (4, 4), (4, 5), (4, 6), (4, 2)
ROWS = [row(22, 0, 0, 20), Row(178, 2, p2=8), row(16, 60, 0, 20), row(16, 60, 60, 25), Row(20, 2)]


def check_px4(story: str, with_mission: bool = True) -> Ground:
    """Play a table: command and parameters | results | main and sub mode | armed. A pause is `wait SECONDS`."""
    station = ground("px4")
    if with_mission:
        assert station.upload(ROWS) == 0
    for line in story.strip().splitlines():
        asked, results, mode, armed = (part.strip() for part in line.split("|"))
        verb, *numbers = asked.split()
        if verb == "wait":
            station.pass_time(float(numbers[0]))
            found: list[int] = []
        else:
            found = station.long(int(verb), *(float(number) for number in numbers))
        assert found == [int(one) for one in results.split()], line
        main, sub = (int(part) for part in mode.split())
        assert station.vehicle.custom_mode == custom_mode(main, sub), line
        assert station.vehicle.flight.armed == (armed == "armed"), line
    return station


@pytest.mark.parametrize(
    "story",
    [
        "300 0 0 | 0 | 4 4 | armed",  # arms by itself
        "300 3 0 | 0 | 4 4 | armed",
        "300 5 0 | 2 | 1 0 | disarmed",
        "300 -2 0 | 2 | 1 0 | disarmed",
        "176 1 4 4 | 0 | 4 4 | disarmed\n400 1 | 0 | 4 4 | armed",
        "176 1 4 99 | 1 | 1 0 | disarmed",
        "176 0 4 4 | 1 | 1 0 | disarmed",
        "176 1 6 | 0 | 6 0 | disarmed\n400 1 | 1 | 6 0 | disarmed",  # disarmed any mode; offboard not armable
        "400 1 | 0 | 1 0 | armed\n176 1 6 | 1 | 1 0 | armed",
        "400 2 | 3 | 1 0 | disarmed",
        "22 0 0 0 nan 0 0 nan | 0 | 4 2 | disarmed",
        "22 0 0 0 0 0 0 480 | 1 | 1 0 | disarmed",  # below home: its altitude is above the sea
        "193 0 | 3 | 1 0 | disarmed",
        "192 | 3 | 1 0 | disarmed",  # no change of mode asked for
        "224 3 | 0 | 1 0 | disarmed",
        "224 5 | 2 | 1 0 | disarmed",
        "178 1 5 | 0 | 1 0 | disarmed",
        "20 | 0 | 4 5 | disarmed",
        "21 | 0 | 4 6 | disarmed",
        "31999 | 3 | 1 0 | disarmed",
        "1000 -30 0 nan nan | 2 | 1 0 | disarmed",  # without primary control
        "1001 -2 -2 | 0 | 1 0 | disarmed\n1000 -30 0 nan nan | 0 | 1 0 | disarmed",
        "1001 999 | 0 | 1 0 | disarmed",
    ],
)
def test_answers(story: str) -> None:
    check_px4(story)


@pytest.mark.parametrize(
    "story",
    [
        "300 0 0 | 2 | 1 0 | disarmed",
        "176 1 4 4 | 0 | 4 4 | disarmed\n400 1 | 1 | 4 4 | disarmed",
        "400 1 | 0 | 1 0 | armed\n176 1 4 4 | 1 | 1 0 | armed",
        "224 0 | 2 | 1 0 | disarmed",
    ],
)
def test_answers_without_a_mission(story: str) -> None:
    check_px4(story, with_mission=False)


def test_why_no_mission_is_started_is_told() -> None:
    station = check_px4("300 0 0 | 2 | 1 0 | disarmed", with_mission=False)
    assert station.texts() == ["Mission start denied! No valid mission"]


def test_a_flight_by_commands() -> None:
    station = check_px4(
        """
        22 0 0 0 nan 0 0 503 | 0 | 4 2 | disarmed
        400 1                | 0 | 4 2 | armed
        wait 12              |   | 4 3 | armed
        400 0                | 1 | 4 3 | armed
        192 -1 1 0 nan 0 0 0 | 0 | 4 3 | armed
        """
    )
    assert station.by_int(REPOSITION, 3, *at(50, 0), 513, -1, 1) == [ACCEPTED]
    station.pass_time(20)
    body = station.vehicle.flight.body
    assert (body.east_m, body.up_m) == pytest.approx((50, 25), abs=0.5)  # the frame isn't looked at
    assert station.long(RETURN) == [ACCEPTED]
    station.until(lambda: not station.vehicle.flight.armed)
    assert body.east_m == pytest.approx(0, abs=0.5)


def test_landing_where_it_is() -> None:
    station = check_px4("300 0 0 | 0 | 4 4 | armed\nwait 20 | | 4 4 | armed")
    where_m = station.vehicle.flight.body.east_m
    assert station.long(LAND) == [ACCEPTED]
    station.until(lambda: not station.vehicle.flight.armed)
    assert station.vehicle.flight.body.east_m == pytest.approx(where_m, abs=15)


def test_every_item_is_told_as_reached_and_then_it_holds() -> None:
    station = ground("px4")
    assert station.upload(ROWS[:4]) == 0
    assert station.long(START, 0, 0) == [ACCEPTED]
    station.until(lambda: station.vehicle.custom_mode == custom_mode(4, 3))
    station.pass_time(1.5)
    assert [message.seq for message in station.of("MISSION_ITEM_REACHED")] == [0, 1, 2, 3]
    assert station.of("MISSION_CURRENT")[-1].mission_state == 5


def test_other_components_are_not_answered_for() -> None:
    station = ground("px4")
    assert [station.long(31999, target=target) for target in ((1, 1), (1, 0), (0, 0))] == [[UNSUPPORTED]] * 3
    assert [station.long(31999, target=target) for target in ((1, 154), (2, 1))] == [[], []]


def test_who_controls_the_gimbal() -> None:
    station, desk = ground("px4"), ground("px4").vehicle.desk
    desk = station.vehicle.desk
    for ids, primary in (
        ((-2, -2), (255, 190)),
        ((-1, -1), (255, 190)),
        ((7, 1), (7, 1)),
        ((-3, -3), (7, 1)),
        ((255, 190), (255, 190)),
        ((-3, -3), (0, 0)),
    ):
        assert station.long(1001, *ids) == [ACCEPTED]
        assert desk.gimbal.primary == primary


def test_a_place_to_look_at_is_above_the_sea_and_from_anybody() -> None:
    station = ground("px4")
    assert station.by_int(195, 3, *at(30, 40), 500) == [ACCEPTED]
    aim = station.vehicle.gimbal.aim
    assert (aim.east_m, aim.north_m, aim.up_m) == pytest.approx((30, 40, 12), abs=0.1)  # type: ignore[union-attr]


@pytest.mark.parametrize(("place", "up_m"), [((950_000_000, 0), 500), ((0, 1_900_000_000), 500)])
def test_a_place_off_the_earth_is_accepted_and_not_flown_to(place: tuple[int, int], up_m: float) -> None:
    station = ground("px4")
    assert station.by_int(REPOSITION, 0, *place, up_m, -1, 1) == [ACCEPTED]


def test_without_satellites() -> None:
    station = ground("px4")
    assert station.upload(ROWS) == 0
    station.vehicle.flight.gps.fix = 1
    assert station.long(ARM, 1) == [LATER]
    assert station.long(START) == [LATER]


def test_chosen_items_are_flown_from_there() -> None:
    station = ground("px4")
    assert station.upload(ROWS) == 0
    assert station.long(CHOOSE, 3) == [ACCEPTED]
    assert station.long(TAKE_OFF, 0, 0, 0, NAN, 0, 0, NAN) + station.long(ARM, 1) == [ACCEPTED, ACCEPTED]
    station.until(lambda: station.vehicle.custom_mode == custom_mode(4, 3))
    assert station.long(MODE, 1, 4, 4) == [ACCEPTED]
    station.until(lambda: not station.vehicle.flight.armed)
    assert [message.seq for message in station.of("MISSION_ITEM_REACHED")] == [3]
    assert station.long(PAUSE, 0) == [UNSUPPORTED]
