"""The door through which a test or a demo changes the small world while it runs: a line of JSON in, one out.

Loopback TCP; whoever connects may do anything. A line is an object; each of its keys is done in order:

| key | value | what happens |
|---|---|---|
| `battery_percent` | number | the charge is this |
| `gps_jump_m` | number or [east, north] | the receiver is wrong by this, until it is 0 again |
| `gps_fix`, `satellites` | number | what the receiver has; a fix below 3 can't be flown by |
| `clock_jump_s` | number | SYSTEM_TIME is wrong by this |
| `reboot` | true or seconds | the autopilot starts again and is silent for so long |
| `take_gimbal` | [system, component] | another station takes primary control of the gimbal; [0, 0] nobody |
| `point_gimbal` | [pitch, yaw] | somebody else points it: degrees, up and from the nose clockwise |
| `gimbal_fitted` | bool | without a gimbal a copter turns its nose |
| `wind_m_s` | [east, north] | where the air moves to |
| `mode` | custom_mode | the pilot's switch: the mode by its number |
| `launch` | metres | the pilot arms and takes off by hand, and stays at that height |
| `disarm` | true | the motors stop, wherever it is |
| `link` | object | a bad link, both ways: fields of `lossy.Weather`; `link_in`, `link_out` one way |
| `unkind` | object | bad answers: fields of `unkind.Unkind` |
| `ground_station_lost_s` | seconds or null | the vehicle returns by itself without a ground station for so long |
| `state` | true | tells where it truly is and what it does |
| `coverage` | [[latitude, longitude], ...] | tells which part of this region the camera has truly seen |

The answer is an object: `{"ok": true, ...}` with what was asked for, or `{"error": words}` for the first
key that can't be done; what stood before it is done.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
from collections.abc import Callable
from dataclasses import asdict, fields
from typing import Any

from autopilot.sim.footprints import Footprints, coverage, region_m
from autopilot.sim.gimbal import Angles
from autopilot.sim.lossy import Weather
from autopilot.sim.unkind import Unkind
from autopilot.sim.vehicle import Vehicle

LINE_BYTES = 65_536


class Refused(ValueError):
    """An order that can't be done, in words."""


def apply(vehicle: Vehicle, footprints: Footprints, line: bytes) -> dict[str, Any]:
    """Do what a line says and return the answer; never raises."""
    try:
        order = json.loads(line)
        if not isinstance(order, dict):
            raise Refused("an order is a JSON object")
        answer: dict[str, Any] = {"ok": True}
        for key, value in order.items():
            answer |= _apply_one(vehicle, footprints, key, value)
    except (ValueError, TypeError, OverflowError, RecursionError) as error:
        return {"error": str(error)}
    return answer


def _apply_one(vehicle: Vehicle, footprints: Footprints, key: str, value: Any) -> dict[str, Any]:
    if key == "state":
        return {"state": state_of(vehicle)}
    if key == "coverage":
        region = region_m(vehicle.home, [_numbers(corner, 2) for corner in value])
        return {"coverage": coverage(region, footprints.seen)}
    handler = _ORDERS.get(key)
    if handler is None:
        raise Refused(f"unknown order {key!r}; there are {', '.join(sorted([*_ORDERS, 'coverage', 'state']))}")
    handler(vehicle, value)
    return {}


def state_of(vehicle: Vehicle) -> dict[str, Any]:
    """Return the truth: place in metres from home, mode, mission, charge, and who controls the gimbal."""
    flight = vehicle.flight
    return {
        **asdict(vehicle.motion),
        "time_s": round(vehicle.time_s, 3),
        "doing": flight.doing.value,
        "landed_state": flight.landed_state,
        "current": flight.runner.current,
        "items": len(flight.items),
        "battery_percent": flight.battery.charge_percent,
        "gimbal_pitch_deg": vehicle.gimbal.pitch_deg,
        "gimbal_yaw_deg": vehicle.gimbal.yaw_deg,
        "gimbal_primary": list(vehicle.gimbal.primary),
    }


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise Refused(f"{value!r} is no number")
    return float(value)


def _numbers(value: Any, count: int) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) != count:
        raise Refused(f"{value!r} is no list of {count} numbers")
    return _number(value[0]), _number(value[1])


def _battery(vehicle: Vehicle, value: Any) -> None:
    vehicle.flight.battery.charge_percent = min(max(_number(value), 0.0), 100.0)


def _jump(vehicle: Vehicle, value: Any) -> None:
    east_m, north_m = _numbers(value, 2) if isinstance(value, list) else (_number(value), 0.0)
    vehicle.flight.gps.jump_east_m, vehicle.flight.gps.jump_north_m = east_m, north_m


def _fix(vehicle: Vehicle, value: Any) -> None:
    vehicle.flight.gps.fix = int(min(max(_number(value), 0), 8))


def _satellites(vehicle: Vehicle, value: Any) -> None:
    vehicle.flight.gps.satellites = int(min(max(_number(value), 0), 255))


def _clock(vehicle: Vehicle, value: Any) -> None:
    vehicle.clock_jump_s = min(max(_number(value), -1e9), 1e9)


def _reboot(vehicle: Vehicle, value: Any) -> None:
    if value is True:
        vehicle.reboot()
    else:
        vehicle.reboot(_number(value))


def _take_gimbal(vehicle: Vehicle, value: Any) -> None:
    system, component = _numbers(value, 2)
    vehicle.gimbal.primary = int(system) & 0xFF, int(component) & 0xFF


def _point_gimbal(vehicle: Vehicle, value: Any) -> None:
    vehicle.gimbal.aim = Angles(*_numbers(value, 2), False)


def _gimbal_fitted(vehicle: Vehicle, value: Any) -> None:
    vehicle.gimbal_fitted = bool(value)


def _wind(vehicle: Vehicle, value: Any) -> None:
    vehicle.flight.wind.east_m_s, vehicle.flight.wind.north_m_s = _numbers(value, 2)


def _mode(vehicle: Vehicle, value: Any) -> None:
    if vehicle.switch_mode(int(_number(value))):
        raise Refused(f"the vehicle doesn't take mode {value}")


def _launch(vehicle: Vehicle, value: Any) -> None:
    vehicle.launch(_number(value))


def _disarm(vehicle: Vehicle, value: Any) -> None:
    if value is True:
        vehicle.flight.disarm()


def _link_in(vehicle: Vehicle, value: Any) -> None:
    _set_fields(vehicle.inward.weather, value)


def _link_out(vehicle: Vehicle, value: Any) -> None:
    _set_fields(vehicle.outward.weather, value)


def _link(vehicle: Vehicle, value: Any) -> None:
    _link_in(vehicle, value)
    _link_out(vehicle, value)


def _unkind(vehicle: Vehicle, value: Any) -> None:
    _set_fields(vehicle.unkind, value)


def _ground_station(vehicle: Vehicle, value: Any) -> None:
    vehicle.ground_station_lost_s = None if value is None else _number(value)


def _set_fields(target: Weather | Unkind, value: Any) -> None:
    """Set fields of a dataclass of plain values, each to a value of its own type."""
    if not isinstance(value, dict):
        raise Refused(f"{value!r} is no object")
    known = {one.name: type(getattr(target, one.name)) for one in fields(target)}
    for name, part in value.items():
        if name not in known:
            raise Refused(f"unknown field {name!r}; there are {', '.join(sorted(known))}")
        if known[name] in (int, float):  # whoever set 0 meant 0.0
            setattr(target, name, _number(part))
        elif known[name] is bool:
            setattr(target, name, bool(part))
        else:
            setattr(target, name, tuple(int(_number(one)) for one in part))


_ORDERS: dict[str, Callable[[Vehicle, Any], None]] = {
    "battery_percent": _battery,
    "gps_jump_m": _jump,
    "gps_fix": _fix,
    "satellites": _satellites,
    "clock_jump_s": _clock,
    "reboot": _reboot,
    "take_gimbal": _take_gimbal,
    "point_gimbal": _point_gimbal,
    "gimbal_fitted": _gimbal_fitted,
    "wind_m_s": _wind,
    "mode": _mode,
    "launch": _launch,
    "disarm": _disarm,
    "link": _link,
    "link_in": _link_in,
    "link_out": _link_out,
    "unkind": _unkind,
    "ground_station_lost_s": _ground_station,
}


class Door:
    """Serves the door of a vehicle on the current loop."""

    def __init__(self, vehicle: Vehicle, footprints: Footprints) -> None:
        self._vehicle = vehicle
        self._footprints = footprints
        self._server: asyncio.Server | None = None
        self._clients: set[asyncio.StreamWriter] = set()
        self.port = 0

    async def start(self, host: str, port: int) -> None:
        """Listen; port 0 lets the system choose. Raises OSError where the port is taken."""
        self._server = await asyncio.start_server(self._client, host, port, limit=LINE_BYTES)
        self.port = self._server.sockets[0].getsockname()[1]

    def stop(self) -> None:
        """Listen no more, and close what is open."""
        if self._server is not None:
            self._server.close()
        for client in list(self._clients):
            client.close()

    async def _client(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one client until it goes; a line that is too long ends it."""
        self._clients.add(writer)
        try:
            with contextlib.suppress(OSError, ValueError):
                while line := await reader.readline():
                    answer = apply(self._vehicle, self._footprints, line)
                    writer.write(json.dumps(answer).encode() + b"\n")
                    await writer.drain()
        finally:
            self._clients.discard(writer)
            writer.close()
