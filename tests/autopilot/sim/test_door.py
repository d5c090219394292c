"""The door into the small world: each order does what it says, a bad one is refused in words."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autopilot.sim.door import LINE_BYTES, Door, apply
from autopilot.sim.footprints import Footprints
from autopilot.sim.gimbal import Angles
from autopilot.sim.missions import Item
from autopilot.sim.modes import Doing
from autopilot.sim.vehicle import Vehicle
from autopilot.sim.world import FIELD_OF_VIEW_DEG, HEIGHT_PX, WIDTH_PX
from tests.autopilot.sim.ground import at

WITHIN_S = 20.0


def footprints() -> Footprints:
    return Footprints(FIELD_OF_VIEW_DEG, WIDTH_PX, HEIGHT_PX)


def told(vehicle: Vehicle, order: Any) -> dict[str, Any]:
    return apply(vehicle, footprints(), json.dumps(order).encode())


@pytest.mark.parametrize(
    ("order", "look", "value"),
    [
        ({"battery_percent": 12}, lambda v: v.flight.battery.charge_percent, 12),
        ({"battery_percent": 300}, lambda v: v.flight.battery.charge_percent, 100),
        ({"gps_jump_m": 500}, lambda v: (v.flight.gps.jump_east_m, v.flight.gps.jump_north_m), (500, 0)),
        ({"gps_jump_m": [3, -4]}, lambda v: (v.flight.gps.jump_east_m, v.flight.gps.jump_north_m), (3, -4)),
        ({"gps_fix": 1, "satellites": 3}, lambda v: (v.flight.gps.fix, v.flight.gps.satellites), (1, 3)),
        ({"clock_jump_s": -60}, lambda v: v.clock_jump_s, -60),
        ({"take_gimbal": [255, 190]}, lambda v: v.gimbal.primary, (255, 190)),
        ({"point_gimbal": [-30, 40]}, lambda v: v.gimbal.aim, Angles(-30, 40, False)),
        ({"gimbal_fitted": False}, lambda v: v.gimbal_fitted, False),
        ({"wind_m_s": [5, -1]}, lambda v: (v.flight.wind.east_m_s, v.flight.wind.north_m_s), (5, -1)),
        ({"mode": 6}, lambda v: v.flight.doing, Doing.RETURN),
        ({"launch": 30}, lambda v: (v.flight.armed, v.flight.doing), (True, Doing.MANUAL)),
        ({"launch": 30, "disarm": True}, lambda v: v.flight.armed, False),
        ({"disarm": False, "launch": 30}, lambda v: v.flight.armed, True),
        ({"link": {"lost": 0.3}}, lambda v: (v.inward.weather.lost, v.outward.weather.lost), (0.3, 0.3)),
        ({"link_in": {"twice": 1}}, lambda v: (v.inward.weather.twice, v.outward.weather.twice), (1, 0)),
        ({"link_out": {"late_s": 2}}, lambda v: (v.inward.weather.late_s, v.outward.weather.late_s), (0, 2)),
        ({"unkind": {"ack_lost": 1, "only_int": True}}, lambda v: (v.unkind.ack_lost, v.unkind.only_int), (1, True)),
        ({"unkind": {"frames_refused": [0, 5]}}, lambda v: v.unkind.frames_refused, (0, 5)),
        ({"ground_station_lost_s": 5}, lambda v: v.ground_station_lost_s, 5),
        ({"ground_station_lost_s": None}, lambda v: v.ground_station_lost_s, None),
        ({}, lambda v: v.flight.armed, False),
    ],
)
def test_orders(order: dict[str, Any], look: Callable[[Vehicle], Any], value: Any) -> None:
    vehicle = Vehicle(1)
    assert told(vehicle, order) == {"ok": True}
    assert look(vehicle) == value


@pytest.mark.parametrize(("value", "silent_s"), [(True, 3.0), (0.5, 0.5)])
def test_reboot(value: Any, silent_s: float) -> None:
    vehicle = Vehicle(1)
    vehicle.meet(("127.0.0.1", 1))
    assert told(vehicle, {"reboot": value}) == {"ok": True}
    vehicle.step(silent_s - 0.1)
    assert vehicle.take() == []
    vehicle.step(0.2)
    assert vehicle.take() != []


def test_the_truth_is_told() -> None:
    vehicle = Vehicle(1)
    vehicle.flight.gps.jump_east_m = 500
    vehicle.flight.body.east_m = 7
    state = told(vehicle, {"state": True})["state"]
    assert (state["east_m"], state["armed"], state["mode"], state["landed_state"]) == (7, False, 0, 1)
    assert (state["items"], state["current"], state["gimbal_primary"]) == (0, 0, [0, 0])


def test_coverage_is_told() -> None:
    vehicle, seen = Vehicle(1), footprints()
    vehicle.flight.body.up_m = 50
    vehicle.gimbal.pitch_deg = -90
    seen.add(vehicle.motion, vehicle.gimbal)
    region = [[x / 1e7, y / 1e7] for x, y in (at(-5, -5), at(5, -5), at(5, 5), at(-5, 5))]
    answer = apply(vehicle, seen, json.dumps({"coverage": region}).encode())
    assert answer["coverage"] == pytest.approx(1)
    assert told(vehicle, {"coverage": region})["coverage"] == 0


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (b"", "Expecting value"),
        (b"[1]", "an order is a JSON object"),
        (b'{"fly": 1}', "unknown order 'fly'"),
        (b'{"battery_percent": "low"}', "'low' is no number"),
        (b'{"battery_percent": true}', "True is no number"),
        (b'{"battery_percent": NaN}', "nan is no number"),
        (b'{"take_gimbal": [1]}', "no list of 2 numbers"),
        (b'{"take_gimbal": 1}', "no list of 2 numbers"),
        (b'{"mode": 17}', "doesn't take mode 17"),
        (b'{"link": 3}', "3 is no object"),
        (b'{"link": {"lots": 1}}', "unknown field 'lots'"),
        (b'{"coverage": [[0, 0], [0, 1]]}', "at least"),
        (b'{"coverage": [[95, 0], [0, 1], [1, 1]]}', "latitude"),
        (b'{"coverage": 5}', "not iterable"),
        (b'"\xff"', "decode"),
    ],
)
def test_refusals(line: bytes, words: str) -> None:
    assert words in apply(Vehicle(1), footprints(), line)["error"]


def test_what_stands_before_a_refused_key_is_done() -> None:
    vehicle = Vehicle(1)
    assert "error" in told(vehicle, {"battery_percent": 9, "fly": 1, "clock_jump_s": 5})
    assert (vehicle.flight.battery.charge_percent, vehicle.clock_jump_s) == (9, 0)


JSON = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5)),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=5), inner, max_size=3)),
    max_leaves=5,
)
KEYS = [
    *(
        "battery_percent",
        "gps_jump_m",
        "gps_fix",
        "satellites",
        "clock_jump_s",
        "reboot",
        "take_gimbal",
        "gimbal_fitted",
    ),
    *("wind_m_s", "mode", "launch", "disarm", "link", "link_in", "link_out", "unkind", "ground_station_lost_s"),
    *("state", "coverage", "x"),
]


@given(st.dictionaries(st.sampled_from(KEYS), JSON, max_size=3))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_no_order_upsets_it(order: dict[str, Any]) -> None:
    vehicle = Vehicle(1)
    vehicle.meet(("127.0.0.1", 1))
    answer = told(vehicle, order)
    assert set(answer) & {"ok", "error"}
    json.dumps(answer)
    vehicle.step(0.2)
    vehicle.take()
    assert math.isfinite(vehicle.flight.battery.charge_percent)


@pytest.mark.whole
def test_the_door_is_a_line_of_json_each_way() -> None:
    async def story() -> None:
        vehicle = Vehicle(1)
        vehicle.flight.items.append(Item(command=16))
        door = Door(vehicle, footprints())
        await door.start("127.0.0.1", 0)
        async with asyncio.timeout(WITHIN_S):
            reader, writer = await asyncio.open_connection("127.0.0.1", door.port)
            writer.write(b'{"battery_percent": 12}\n{"state": true}\nnonsense\n')
            answers = [json.loads(await reader.readline()) for _ in range(3)]
            assert answers[0] == {"ok": True}
            assert (answers[1]["state"]["battery_percent"], answers[1]["state"]["items"]) == (12, 1)
            assert "error" in answers[2]
            writer.write(b"x" * (2 * LINE_BYTES))
            assert await reader.read() == b""
            writer.close()
        door.stop()

    asyncio.run(story())


def test_a_probability_that_was_a_whole_number_takes_a_part_of_one() -> None:
    """The process's options may have set 0 and not 0.0."""
    vehicle = Vehicle(1)
    vehicle.unkind.ack_lost = 0
    assert told(vehicle, {"unkind": {"ack_lost": 0.5}}) == {"ok": True}
    assert vehicle.unkind.ack_lost == 0.5
