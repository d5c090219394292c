"""A plan as each vehicle is given it, and what of it may come back otherwise."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from autopilot.adapters.vehicle.heard import Item
from autopilot.adapters.vehicle.mission_form import Unflyable, difference, given, kept
from autopilot.adapters.vehicle.modes import Family, Kind, flight_mode
from events.schema.common_pb2 import Place
from events.schema.mission_pb2 import PlannedItem
from events.schema.safety_pb2 import FlightMode
from tests.autopilot.vehicle.vehicles import LATITUDE_E7, LONGITUDE_E7, plan, planned

NAN = math.nan


def check_refused(items: list[PlannedItem], because: str, family: Family = Family.COPTER) -> None:
    with pytest.raises(Unflyable, match=because):
        given(items, family)


def one(command: int, family: Family, **changes: Any) -> Item:
    """Return one item as a vehicle is given it."""
    return given([planned(), planned(command, **changes), planned()], family)[2 if family.is_ardupilot else 1]


def check_back(sent: Item, family: Family, expected: str, **changes: Any) -> None:
    """What the vehicle is known to give back, changed so, differs in these words."""
    assert difference(sent, replace(kept(sent, family), **changes), family) == expected


def test_a_plan_for_ardupilot_begins_with_home() -> None:
    items = given(plan(), Family.COPTER)
    assert [item.command for item in items] == [16, 22, 178, 16, 16, 20, 21]
    assert [item.seq for item in items] == list(range(7))
    assert [item.current for item in items] == [True] + [False] * 6
    assert [item.goes_on for item in items] == [True] * 6 + [False]
    assert [item.frame for item in items] == [0, 3, 3, 3, 3, 3, 3]
    assert (items[0].x, items[0].y, items[0].z) == (LATITUDE_E7, LONGITUDE_E7, 0.0)
    assert items[3].parameters == (2.5, 0.0, 0.0, 0.0)
    assert (items[3].x, items[3].y, items[3].z) == (LATITUDE_E7 + 5_000, LONGITUDE_E7, 30.0)


def test_a_plan_for_px4_is_as_it_is() -> None:
    items = given(plan(), Family.PX4)
    assert [item.command for item in items] == [22, 178, 16, 16, 20, 21]
    assert [item.frame for item in items] == [3, 2, 3, 3, 2, 3]
    assert [str(item.parameters[3]) for item in items] == ["nan", "0.0", "nan", "nan", "0.0", "nan"]
    assert items[1].parameters[:3] == (1.0, 8.0, -1.0)


def test_a_yaw_that_is_set_is_given() -> None:
    for family in Family:
        assert one(16, family, parameter_4_e3=90_500).parameters[3] == 90.5


def test_what_can_not_be_given_is_refused_by_name() -> None:
    check_refused([], "no items")
    check_refused([planned(183)], "item 0: command 183 is not on the list")
    check_refused([planned(), PlannedItem(command=16)], "item 1: command 16")
    check_refused([planned(20)], "no item has a place")
    check_refused([planned(), PlannedItem(command=20, place=planned().place)], "item 1: command 20")
    check_refused([PlannedItem(command=16, place=Place())], "not on the Earth")
    check_refused([PlannedItem(command=16, place=Place(latitude_e7=900_000_001, longitude_e7=1))], "not on the Earth")
    check_refused(
        [PlannedItem(command=16, place=Place(latitude_e7=1, longitude_e7=-1_800_000_001))], "not on the Earth"
    )
    check_refused([planned(height_mm=20_000_001)], "height")
    check_refused([planned(height_mm=-500_001)], "height")
    check_refused([planned(parameter_1_e3=65_536_000)], "parameter 1")
    check_refused([planned(parameter_1_e3=-1)], "parameter 1")
    assert given([planned(parameter_1_e3=65_536_000)], Family.PX4)
    assert given([planned(20)], Family.PX4)


@pytest.mark.parametrize("family", list(Family))
def test_what_a_vehicle_is_known_to_give_back_is_no_difference(family: Family) -> None:
    for item in given(plan(), family):
        check_back(item, family, "")


def test_what_ardupilot_makes_of_an_item() -> None:
    copter, plane = Family.COPTER, Family.PLANE
    parameters = {"parameter_1_e3": 2_900, "parameter_2_e3": 3_900, "parameter_3_e3": -999_900}
    assert kept(one(16, copter, **parameters), copter).parameters == (2, 0, 0, 0)
    assert kept(one(16, plane, **parameters), plane).parameters == (0, 3, 255, 0)
    assert kept(one(22, copter, **parameters), copter).parameters == (2, 0, 0, 0)
    assert kept(one(21, copter, **parameters), copter).parameters == (2, 0, 0, 1)
    assert kept(one(21, copter, parameter_4_e3=-1_000), copter).parameters == (0, 0, 0, -1)
    speed = kept(one(178, copter, parameter_1_e3=1_900, parameter_2_e3=7_500, parameter_3_e3=-1_000), copter)
    assert (speed.parameters, speed.frame) == ((1, 7.5, -1, 0), 0)
    home = kept(one(20, copter, **parameters), copter)
    assert (home.parameters, home.frame, home.x, home.y, home.z) == ((0, 0, 0, 0), 0, 0, 0, 0)


def test_what_px4_makes_of_an_item() -> None:
    parameters = {"parameter_1_e3": 2_900, "parameter_2_e3": 3_900, "parameter_3_e3": 4_000}

    def back(command: int) -> str:
        return str([round(value, 3) for value in kept(one(command, Family.PX4, **parameters), Family.PX4).parameters])

    assert back(16) == "[2.9, 3.9, 0.0, nan]"
    assert back(21) == "[0.0, 3.0, 0.0, nan]"
    assert back(22) == "[0.0, 0.0, 0.0, nan]"
    assert back(20) == "[2.9, 3.9, 4.0, 0.0]"
    assert kept(one(16, Family.OTHER, **parameters), Family.OTHER) == one(16, Family.OTHER, **parameters)


def test_a_difference_is_named() -> None:
    for family in (Family.COPTER, Family.PX4, Family.OTHER):
        sent = one(16, family, parameter_1_e3=2_000)
        fourth = kept(sent, family).parameters[3]
        check_back(sent, family, "command 21 for 16", command=21)
        check_back(sent, family, "frame 0 for 3", frame=0)
        check_back(sent, family, "frame 10 for 3", frame=10)
        check_back(sent, family, "", frame=6)
        check_back(sent, family, f"place {sent.x + 1}, {sent.y} for {sent.x}, {sent.y}", x=sent.x + 1)
        check_back(sent, family, f"place {sent.x}, {sent.y - 1} for {sent.x}, {sent.y}", y=sent.y - 1)
        check_back(sent, family, "height 30.02 for 30.0", z=30.02)
        check_back(sent, family, "parameter 1 3.0 for 2.0", parameters=(3.0, 0.0, 0.0, fourth))
        check_back(sent, family, "parameter 2 1.0 for 0.0", parameters=(2.0, 1.0, 0.0, fourth))
        check_back(sent, family, "parameter 3 -1.0 for 0.0", parameters=(2.0, 0.0, -1.0, fourth))


def test_a_centimetre_is_ardupilot_s_own_rounding() -> None:
    check_back(one(16, Family.COPTER), Family.COPTER, "", z=29.99)
    check_back(one(16, Family.PX4), Family.PX4, "height 29.99 for 30.0", z=29.99)
    check_back(one(16, Family.COPTER), Family.COPTER, "", goes_on=False)
    check_back(one(16, Family.PX4), Family.PX4, "autocontinue 0 for 1", goes_on=False)
    check_back(given(plan(), Family.PX4)[-1], Family.PX4, "", goes_on=True)


def test_unset_is_not_zero_where_it_matters() -> None:
    sent = one(16, Family.PX4)
    check_back(sent, Family.PX4, "parameter 4 0.0 for nan", parameters=(0.0, 0.0, 0.0, 0.0))
    check_back(one(16, Family.PX4, parameter_4_e3=0), Family.PX4, "parameter 4 nan for 0.0", parameters=(0, 0, 0, NAN))
    check_back(one(16, Family.COPTER), Family.COPTER, "parameter 4 nan for 0.0", parameters=(0, 0, 0, NAN))


def test_a_yaw_of_px4_is_a_turn() -> None:
    sent = one(16, Family.PX4, parameter_4_e3=-90_000)
    check_back(sent, Family.PX4, "", parameters=(0, 0, 0, 270.004))
    check_back(sent, Family.PX4, "parameter 4 271.0 for -90.0", parameters=(0, 0, 0, 271.0))
    speed = one(178, Family.PX4, parameter_4_e3=0)
    check_back(speed, Family.PX4, "parameter 4 360.0 for 0.0", parameters=(0, 0, 0, 360.0))
    check_back(
        one(16, Family.OTHER, parameter_4_e3=0), Family.OTHER, "parameter 4 360.0 for 0.0", parameters=(0, 0, 0, 360.0)
    )


def test_home_is_the_vehicle_s_own() -> None:
    home = given(plan(), Family.COPTER)[0]
    assert difference(home, replace(home, x=1, y=1, z=500.0), Family.COPTER) == ""
    assert difference(home, replace(home, command=22), Family.COPTER) == "item 0 is command 22, not home"
    first = given(plan(), Family.PX4)[0]
    assert difference(first, replace(first, x=1), Family.PX4)


@pytest.mark.parametrize(
    ("autopilot", "vehicle_type", "custom_mode", "name"),
    [
        *((3, 2, number, name) for number, name in ((3, "MISSION"), (4, "GUIDED"), (5, "LOITER"), (6, "RETURN"))),
        *((3, 14, number, name) for number, name in ((9, "LAND"), (21, "RETURN"), (27, "RETURN"), (0, None))),
        *((3, 1, number, name) for number, name in ((10, "MISSION"), (11, "RETURN"), (12, "LOITER"), (15, "GUIDED"))),
        *((3, 20, number, name) for number, name in ((19, "LOITER"), (20, "LAND"), (21, "RETURN"), (25, "LAND"))),
        *((3, 1, number, name) for number, name in ((26, "LAND"), (3, None), (6, None))),
        *((12, 2, 4 << 16 | sub << 24, name) for sub, name in ((4, "MISSION"), (3, "LOITER"), (5, "RETURN"))),
        *((12, 2, 4 << 16 | sub << 24, name) for sub, name in ((6, "LAND"), (9, "LAND"), (2, None))),
        *((12, 2, number, None) for number in (4, 5 << 24, 1 << 16 | 5 << 24)),
        *((3, 10, 11, None), (0, 2, 3, None), (8, 18, 4, None)),
    ],
)
def test_what_a_custom_mode_means(autopilot: int, vehicle_type: int, custom_mode: int, name: str | None) -> None:
    mode = flight_mode(Kind(autopilot=autopilot, vehicle_type=vehicle_type), custom_mode)
    words = None if mode is None else FlightMode.Name(mode).removeprefix("FLIGHT_MODE_")
    assert words == name
