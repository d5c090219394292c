"""The translation contract of seed 004, and what is said of a mission that can't be flown."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from autopilot.planning import Plan, PlannedItem, for_vehicle
from autopilot.planning import items as translation
from autopilot.planning.items import COMMAND_NAMES
from autopilot.wire.mission import MissionRefused
from tests.autopilot.planning.missions import (
    AROUND,
    HOME,
    SQUARE,
    Metres,
    fence,
    plan_of,
    planned,
    region,
    tree,
    uid,
    vertex,
    waypoint,
)

SHORT = {"NAV_WAYPOINT": "WP", "NAV_TAKEOFF": "UP", "NAV_LAND": "LAND", "NAV_RETURN_TO_LAUNCH": "RTL"}
BREAK = {"kind": "target_follow_breakpoint"}


def words(plan: Plan) -> str:
    """Return the commands of a plan in short, those of a search counted."""
    names = [SHORT.get(COMMAND_NAMES[item.command], "SPEED") for item in plan.items]
    return " ".join(names)


def check_items(made: dict[str, Any], expected: str, **settings: Any) -> Plan:
    """Check the commands that a mission becomes."""
    plan = planned(made, **settings)
    assert words(plan) == expected
    assert [item.seq for item in plan.items] == list(range(len(plan.items)))
    assert [item.current for item in plan.items] == [True] + [False] * (len(plan.items) - 1)
    assert [item.auto_continue for item in plan.items] == [True] * (len(plan.items) - 1) + [False]
    assert {item.frame for item in plan.items} == {mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT}
    return plan


def check_refused(made: dict[str, Any], expected: str, **settings: Any) -> None:
    """Check everything that is said of a mission that can't be flown."""
    found = plan_of(made, **settings)
    assert isinstance(found, MissionRefused)
    assert str(found).splitlines() == [line.strip() for line in expected.strip().splitlines()]


@pytest.mark.parametrize(
    ("items", "copter", "plane"),
    [
        ([waypoint((10, 20))], "UP WP LAND", "WP"),
        ([waypoint((10, 20)), waypoint((30, 20))], "UP WP WP LAND", "WP WP"),
        ([waypoint((10, 20), cruise_speed_mps=9)], "UP SPEED WP LAND", "SPEED WP"),
        ([waypoint((10, 20)), {"kind": "return"}], "UP WP RTL LAND", "WP RTL"),
        (
            [waypoint((10, 20)), {"kind": "return", "cruise_speed_mps": 9}],
            "UP WP SPEED RTL LAND",
            "WP SPEED RTL",
        ),
        ([waypoint((10, 20)), {"kind": "return", "at": vertex((5, 5), 2)}], "UP WP LAND", "WP LAND"),
        ([waypoint((10, 20)), BREAK, waypoint((30, 20))], "UP WP WP LAND", "WP WP"),
        ([region()], "UP" + " WP" * 10 + " LAND", " ".join(["WP"] * 10)),
        ([region(cruise_speed_mps=5)], "UP SPEED" + " WP" * 10 + " LAND", "SPEED" + " WP" * 10),
        ([{"kind": "search", "at": vertex((100, 100), 40)}], "UP WP LAND", " ".join(["WP"] * 9)),
    ],
)
def test_what_each_item_becomes(items: list[dict[str, Any]], copter: str, plane: str) -> None:
    """A copter takes off and lands, a plane does neither."""
    check_items(tree(*items), copter, airframe="copter")
    check_items(tree(*items), plane, airframe="plane")


def test_numbers_are_mavlinks() -> None:
    """Commands, frame and kinds of speed."""
    for number, name in COMMAND_NAMES.items():
        assert getattr(mavlink, f"MAV_CMD_{name}") == number
    assert translation.GLOBAL_RELATIVE_ALT == mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
    assert (mavlink.SPEED_TYPE_AIRSPEED, mavlink.SPEED_TYPE_GROUNDSPEED) == (
        translation.AIRSPEED,
        translation.GROUND_SPEED,
    )


def test_places_heights_and_sources() -> None:
    """In 1e-7 degrees and millimetres above home; each item says where it comes from."""
    plan = planned(tree(waypoint((10, 20), 42.5), {"kind": "return"}))
    up, there, back, down = plan.items
    home = (475_402_000, 87_214_000)
    assert (up.lat_e7, up.lon_e7, up.height_mm, up.source) == (*home, 42_500, "")
    at = vertex((10, 20))
    assert (there.lat_e7, there.lon_e7) == (round(at["latitude"] * 1e7), round(at["longitude"] * 1e7))
    assert (there.height_mm, there.source, there.params) == (42_500, uid(0), (0.0, 0.0, 0.0, None))
    assert (back.lat_e7, back.height_mm, back.source, back.params) == (0, 0, uid(1), (0.0, 0.0, 0.0, 0.0))
    assert (down.lat_e7, down.lon_e7, down.height_mm, down.source) == (*home, 0, "")


def test_a_copter_climbs_to_its_first_height_and_never_less_than_its_own() -> None:
    """Over home, before it sets off; it lands at the return point."""
    made = tree(waypoint((10, 20), 5), back=(30, 40))
    plan = planned(made, takeoff_height_m=12, home=HOME)
    assert plan.items[0].height_mm == 12_000
    end = vertex((30, 40))
    assert (plan.items[-1].lat_e7, plan.items[-1].lon_e7) == (
        round(end["latitude"] * 1e7),
        round(end["longitude"] * 1e7),
    )
    assert planned(tree(waypoint((10, 20), 55))).items[0].height_mm == 55_000


@pytest.mark.parametrize(("airframe", "kind"), [("copter", 1.0), ("plane", 0.0)])
def test_the_speed_is_in_parameter_2(airframe: str, kind: float) -> None:
    """Parameter 1 is its kind (over ground, through the air); the throttle stays."""
    plan = planned(tree(waypoint((10, 20), cruise_speed_mps=9.5)), airframe=airframe)
    (speed,) = (item for item in plan.items if item.command == translation.DO_CHANGE_SPEED)
    assert (speed.params, speed.source) == ((kind, 9.5, -1.0, 0.0), uid(0))


def test_a_copter_looks_around_and_a_plane_goes_round() -> None:
    """A hold in parameter 1; corners on a circle that ends where it began."""
    made = tree({"kind": "search", "at": vertex((300, 100), 40)})
    assert planned(made, search_hold_s=12).items[1].params[0] == 12.0
    plan = planned(made, airframe="plane", search_radius_m=70)
    assert {round(math.dist(leg.path[-1], (300, 100))) for leg in plan.legs} == {70}
    assert (plan.items[0].lat_e7, plan.items[0].lon_e7) == (plan.items[-1].lat_e7, plan.items[-1].lon_e7)


def test_breakpoints_keep_their_place() -> None:
    """The index of what comes next, the takeoff counted."""
    made = tree(waypoint((10, 20)), BREAK, waypoint((30, 20), cruise_speed_mps=3), BREAK)
    assert [marker.seq for marker in planned(made).breakpoints] == [2, 4]
    assert [marker.seq for marker in planned(made, airframe="plane").breakpoints] == [1, 3]
    assert [marker.item for marker in planned(made).breakpoints] == [uid(1), uid(3)]


def test_ardupilot_has_home_first_and_no_nan() -> None:
    """Seq 0 is a placeholder, which is the current one; PX4 takes the plan as it is."""
    plan = planned(tree(waypoint((10, 20))))
    assert for_vehicle(plan, "px4") == plan.items
    sent = for_vehicle(plan, "ardupilot")
    assert sent[0] == PlannedItem(
        seq=0, command=16, current=True, params=(0, 0, 0, 0), lat_e7=475_402_000, lon_e7=87_214_000
    )
    assert [(item.seq, item.command, item.current) for item in sent[1:]] == [
        (item.seq + 1, item.command, False) for item in plan.items
    ]
    assert [item.params[3] for item in sent] == [0.0] * 4
    assert [item.auto_continue for item in sent] == [True, True, True, False]


def test_a_region_is_told_of() -> None:
    """Area, lanes and what is seen; the height is that of its corners, else the configured one."""
    plan = planned(tree(region(SQUARE, 50)), side_overlap=0.2)
    (told,) = plan.searched
    assert (round(told.area_m2, -2), told.lanes, round(told.spacing_m, 1), told.item) == (60_000, 5, 46.2, uid(0))
    assert told.coverage == pytest.approx(1.0)
    assert told.frame_period_s == pytest.approx(2 * 50 * math.tan(math.radians(30)) / (16 / 9) * 0.7 / 8)
    assert {item.height_mm for item in plan.items if item.source} == {50_000}
    plan = planned(tree(region(SQUARE, None)), search_height_m=33)
    assert {item.height_mm for item in plan.items if item.source} == {33_000}
    assert sum(leg.length_m for leg in plan.legs) == pytest.approx(plan.length_m)


def test_the_way_on_from_a_region_goes_around_and_is_the_regions_own() -> None:
    """Between the last lane and the next waypoint stands a fence; the waypoint stays one item."""
    wall = [(60.0, 262.0), (340.0, 262.0), (340.0, 300.0), (60.0, 300.0)]
    made = tree(region(), waypoint((200, 350)), fences=[fence(AROUND, "INCLUSION"), fence(wall)])
    plan = planned(made, airframe="plane")
    assert sum(item.source == uid(0) for item in plan.items) > 10
    assert sum(item.source == uid(1) for item in plan.items) == 1
    assert plan.site.airspace.allows(*(point for leg in plan.legs for point in leg.path[-1:]))
    assert all(plan.site.airspace.allows(*leg.path) for leg in plan.legs)


BOW: list[Metres] = [(0, 0), (100, 100), (100, 0), (0, 100)]
WALL: list[Metres] = [(90, -50), (110, -50), (110, 50), (90, 50)]


@pytest.mark.parametrize(
    ("made", "expected"),
    [
        (
            tree(region(BOW)),
            "$.items[0].region: crosses or touches itself; list its corners once, in order around it",
        ),
        (
            tree(waypoint((1, 1)), fences=[fence(BOW)]),
            "$.geofences[0].vertices: crosses or touches itself; list its corners once, in order around it",
        ),
        (
            tree(waypoint((30_000, 0))),
            "$.items[0].at: is 30.0 km from home, farther than 20 km; check latitude and longitude, or raise reach_m",
        ),
        (
            tree(waypoint((500, 0)), fences=[fence(AROUND, "INCLUSION")]),
            """$.items[0].at: is forbidden by $.geofences[0] (INCLUSION); move it, or change the fence""",
        ),
        (
            tree(waypoint((100, 0)), fences=[fence(AROUND, "INCLUSION"), fence(WALL)]),
            "$.items[0].at: is forbidden by $.geofences[1] (EXCLUSION); move it, or change the fence",
        ),
        (
            tree(waypoint((100, 20)), back=(200, 0), fences=[fence([(-20, -20), (20, -20), (0, 20)])]),
            "$.geofences: home is forbidden by $.geofences[0] (EXCLUSION); leave home out of it",
        ),
        (
            tree(
                waypoint((100, 20)),
                back=(200, 0),
                fences=[fence([(50, -99), (300, -99), (300, 99), (50, 99)], "INCLUSION")],
            ),
            "$.geofences: home is forbidden by $.geofences[0] (INCLUSION); let home lie inside it",
        ),
        (
            tree(waypoint((100, 20)), back=(0, 210), fences=[fence([(-50, 190), (50, 190), (0, 260)])]),
            "$.return_point: is forbidden by $.geofences[0] (EXCLUSION); move it, or change the fence",
        ),
        (
            tree(
                waypoint((1, 1)),
                fences=[fence([(0, 0), (9, 0), (9, 9)], "INCLUSION"), fence([(30, 0), (39, 0), (39, 9)], "INCLUSION")],
            ),
            "$.geofences: leave no room to fly in; let the inclusions overlap",
        ),
        (
            tree(waypoint((1, 1)), {"kind": "return"}, BREAK, waypoint((2, 2))),
            "$.items[3]: comes after the return, and would never be flown; put the return last",
        ),
        (tree({"kind": "return"}), "$.items: have nothing to fly to; add a waypoint, a search or a region_search"),
        (tree(BREAK), "$.items: have nothing to fly to; add a waypoint, a search or a region_search"),
        (
            tree({"kind": "region_search", "region": [vertex((0, 0), 10), vertex((99, 0), 10), vertex((0, 99), 20)]}),
            "$.items[0].region: has corners of different heights; give all the same altitude_m, or none",
        ),
        (
            tree(region(SQUARE, 0)),
            "$.items[0].region: is searched from 0 m above home; search from above the ground",
        ),
    ],
)
def test_what_is_refused(made: dict[str, Any], expected: str) -> None:
    """Each with its path, the reason and the fix; home is where it is said to be."""
    check_refused(made, expected, home=HOME)


def test_a_fence_in_the_way_is_told_with_a_way_around() -> None:
    """A waypoint stays one item, so the way around is for the author to draw; drawn so, it can be flown."""
    made = tree(waypoint((200, 0)), fences=[fence(WALL)])
    found = plan_of(made, home=HOME)
    assert isinstance(found, MissionRefused)
    there, back = found.problems
    assert there.path == "$.items[0]"
    assert there.reason == "the straight way to it is forbidden by $.geofences[0] (EXCLUSION)"
    assert back.path == "$.return_point"
    words = there.fix.removeprefix("go around it on waypoints at ")
    around = [tuple(map(float, spot.split())) for spot in words.split(", then ")]
    assert len(around) == 2
    corners = [
        {"kind": "waypoint", "at": {"latitude": latitude, "longitude": longitude, "altitude_m": 40}}
        for latitude, longitude in around
    ]
    assert isinstance(
        plan_of(tree(*corners, waypoint((200, 0)), *corners[::-1], fences=[fence(WALL)]), home=HOME), Plan
    )


def test_a_planes_circle_may_not_break_a_fence() -> None:
    """Its place may be allowed and the circle not."""
    made = tree({"kind": "search", "at": vertex((400, 100), 40)}, fences=[fence(AROUND, "INCLUSION")])
    check_refused(
        made,
        "$.items[0]: is circled at 80 m, which is forbidden by $.geofences[0] (INCLUSION); "
        "move it, or lower search_radius_m",
        airframe="plane",
    )
    assert isinstance(plan_of(made, airframe="plane", search_radius_m=40), Plan)


def test_more_items_than_the_vehicle_holds() -> None:
    """Counted with takeoff and landing."""
    made = tree(region())
    assert len(planned(made, max_planned=12).items) == 12
    check_refused(
        made,
        "$.items: need 12 items on the vehicle, more than 11; "
        "search from higher up, split the mission, or raise max_planned",
        max_planned=11,
    )


def test_a_region_that_cannot_be_searched_is_told_at_its_path() -> None:
    """The words of the sweep, split into reason and fix."""
    yard = [(-100.0, -100.0), (30.0, -100.0), (30.0, 400.0), (-100.0, 400.0)]
    check_refused(
        tree(region(), fences=[fence(yard, "INCLUSION")]),
        "$.items[0].region: the fences leave nothing of it; move the region, or change the fences",
    )


@pytest.mark.parametrize(
    ("made", "expected"),
    [
        (tree(waypoint((9, 9)), fences=[fence(AROUND, "INCLUSION")]), []),
        (tree(waypoint((9, 9))), ["no INCLUSION: nothing bounds the flight but its reach"]),
        (
            tree(waypoint((9, 9), 4), fences=[fence(AROUND, "INCLUSION")]),
            ["items[0] is less than 5 m above home"],
        ),
        (
            tree(waypoint((9, 9)), {"kind": "return"}, back=(90, 0), fences=[fence(AROUND, "INCLUSION")]),
            ["a return goes to where the vehicle started, 90 m from the return point"],
        ),
        (
            tree(region(), fences=[fence([(-100, -100), (300, -100), (300, 400), (-100, 400)], "INCLUSION")]),
            ["items[0]: 1.00 ha of the region are forbidden by the fences and not searched"],
        ),
    ],
)
def test_what_is_worth_knowing(made: dict[str, Any], expected: list[str]) -> None:
    """No mistakes, and yet said."""
    assert list(planned(made, home=HOME).notes) == expected


def test_too_little_seen_is_said() -> None:
    """A margin that is wider than what the camera shows leaves a strip along the fence unseen."""
    plan = planned(
        tree(region(SQUARE, 20), fences=[fence([(-100, -100), (350, -100), (350, 400), (-100, 400)], "INCLUSION")]),
        fence_margin_m=40,
    )
    assert len(plan.notes) == 1
    assert plan.notes[0].endswith("% of the region is not seen, because lanes keep 40 m from the fences")


def test_home_is_where_it_is_said_to_be() -> None:
    """Heights count from there, the takeoff is there; without it the return point is home."""
    made = tree(waypoint((10, 20)), back=(30, 0))
    assert planned(made, home=HOME).home.lon_e7 == 87_214_000
    assert planned(made).home.lon_e7 == round(vertex((30, 0))["longitude"] * 1e7)


def test_time_and_length_add_up() -> None:
    """There and back at cruise speed, and the hold of a search."""
    plan = planned(tree({"kind": "search", "at": vertex((80, 0), 40)}), search_hold_s=30, cruise_speed_mps=8)
    assert (round(plan.length_m), round(plan.time_s)) == (160, 50)
    plan = planned(tree(waypoint((80, 0), cruise_speed_mps=4)))
    assert round(plan.time_s) == 40
