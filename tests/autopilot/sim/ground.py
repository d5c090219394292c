"""A small ground station for tests: commands and the mission protocol, written from the guide, not from the simulator.

It holds a vehicle, lets its time pass, and hears all that it sends. `upload` and `download` are the client's end of
the mission protocol: items are resent when asked for, requests are repeated, all by the vehicle's own time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import common as dialect

from autopilot.geo import offset
from autopilot.sim.aircraft import HOME
from autopilot.sim.vehicle import FrameName, PersonalityName, Vehicle

PEER = ("127.0.0.1", 1)
NAN = math.nan
TICK_S = 0.05

ARM, MODE, TAKE_OFF, START, CHOOSE, REPOSITION = 400, 176, 22, 300, 224, 192
RETURN, LAND, SPEED, PAUSE = 20, 21, 178, 193
HOME_E7 = (round(HOME[0] * 1e7), round(HOME[1] * 1e7))


@dataclass(frozen=True)
class Row:
    """A mission item as a client has it."""

    command: int
    frame: int = 3
    p1: float = 0.0
    p2: float = 0.0
    p3: float = 0.0
    p4: float = 0.0
    x: int = 0
    y: int = 0
    z: float = 0.0


def at(east_m: float, north_m: float) -> tuple[int, int]:
    """Return 1e-7 degrees of a point near home."""
    latitude_deg, longitude_deg = offset(HOME[0], HOME[1], east_m, north_m)
    return round(latitude_deg * 1e7), round(longitude_deg * 1e7)


def row(command: int, east_m: float, north_m: float, up_m: float, frame: int = 3, **more: float) -> Row:
    """Return an item with a place."""
    x, y = at(east_m, north_m)
    return Row(command, frame, x=x, y=y, z=up_m, **more)


class Ground:
    """One ground station and its vehicle."""

    def __init__(self, vehicle: Vehicle, system: int = 255, component: int = 190, peer: tuple[str, int] = PEER) -> None:
        self.vehicle = vehicle
        self.peer = peer
        self.heard: list[Any] = []
        self.beats = True  # sends a heartbeat each second
        self._link = dialect.MAVLink(None, system, component)
        self._identity = (system, component)
        self._beats_s = 0.0

    def send(self, message: Any) -> None:
        """Send a message."""
        self.vehicle.hear(self.peer, bytes(message.pack(self._link)))
        self._link.seq = (self._link.seq + 1) % 256

    def listen(self) -> None:
        """Take what the vehicle has for this station; what is for others on its address too."""
        reader = dialect.MAVLink(None)
        for peer, datagram in self.vehicle.take():
            if peer == self.peer:
                self.heard += reader.parse_buffer(datagram) or []

    def pass_time(self, seconds: float) -> None:
        """Let time pass, listen, and be heard."""
        for _ in range(round(seconds / TICK_S)):
            self.vehicle.step(TICK_S)
            self.listen()
            if self.beats and self.vehicle.time_s >= self._beats_s:
                self._beats_s = self.vehicle.time_s + 1.0
                self.send(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))

    def until(self, fits: Callable[[], bool], within_s: float = 600.0) -> None:
        """Let time pass until something is so. Fails where that takes too long."""
        for _ in range(round(within_s / TICK_S)):
            if fits():
                return
            self.pass_time(TICK_S)
        raise AssertionError(f"not within {within_s} s; {self.vehicle.flight.body}, {self.texts()[-5:]}")

    def of(self, kind: str) -> list[Any]:
        """Return the messages of a kind that were heard."""
        return [message for message in self.heard if message.get_type() == kind]

    def texts(self) -> list[str]:
        """Return what was told in words."""
        return [message.text for message in self.of("STATUSTEXT")]

    def ask(self, message: Any) -> list[int]:
        """Send a command and return the results of its answers within a moment."""
        before = len(self.of("COMMAND_ACK"))
        self.send(message)
        self.pass_time(TICK_S)
        return [ack.result for ack in self.of("COMMAND_ACK")[before:]]

    def long(self, command: int, *parameters: float, target: tuple[int, int] = (1, 1)) -> list[int]:
        """Ask by COMMAND_LONG."""
        filled = (*parameters, *(0.0,) * (7 - len(parameters)))
        return self.ask(dialect.MAVLink_command_long_message(*target, command, 0, *filled))

    def by_int(
        self, command: int, frame: int, x: int, y: int, z: float, *parameters: float, target: tuple[int, int] = (1, 1)
    ) -> list[int]:
        """Ask by COMMAND_INT."""
        filled = (*parameters, *(0.0,) * (4 - len(parameters)))
        return self.ask(dialect.MAVLink_command_int_message(*target, frame, command, 0, 0, *filled, x, y, z))

    def item(self, seq: int, one: Row, current: int = 0) -> Any:
        """Return an item as MISSION_ITEM_INT."""
        parameters = (one.p1, one.p2, one.p3, one.p4, one.x, one.y, one.z)
        return dialect.MAVLink_mission_item_int_message(1, 1, seq, one.frame, one.command, current, 1, *parameters, 0)

    def upload(self, rows: list[Row], within_s: float = 60.0, retry_s: float = 1.5) -> int | None:
        """Upload a mission; return the MAV_MISSION_RESULT, None where none came in time."""
        self.send(dialect.MAVLink_mission_count_message(1, 1, len(rows), 0))
        heard, count_s, waited_s, asked = len(self.heard), 0.0, 0.0, False
        while waited_s < within_s:
            self.pass_time(TICK_S)
            waited_s, count_s = waited_s + TICK_S, count_s + TICK_S
            news, heard = self.heard[heard:], len(self.heard)
            for message in news:
                kind = message.get_type()
                if kind == "MISSION_ACK":
                    return int(message.type)
                if kind in ("MISSION_REQUEST", "MISSION_REQUEST_INT") and message.seq < len(rows):
                    asked = True
                    self.send(self.item(message.seq, rows[message.seq]))
            if not asked and count_s >= retry_s:
                count_s = 0.0
                self.send(dialect.MAVLink_mission_count_message(1, 1, len(rows), 0))
        return None

    def download(self, within_s: float = 60.0, retry_s: float = 0.5) -> list[Row] | None:
        """Download the mission; None where it didn't come in time."""
        listing = dialect.MAVLink_mission_request_list_message(1, 1, 0)
        counts = self._ask_until(listing, lambda message: message.get_type() == "MISSION_COUNT", within_s, retry_s)
        if counts is None:
            return None
        rows = []
        for seq in range(counts.count):
            request = dialect.MAVLink_mission_request_int_message(1, 1, seq, 0)
            found = self._ask_until(request, lambda m, n=seq: _is_item(m, n), within_s, retry_s)  # type: ignore[misc]
            if found is None:
                return None
            rows.append(_row_of(found))
        self.send(dialect.MAVLink_mission_ack_message(1, 1, 0, 0))
        return rows

    def _ask_until(self, request: Any, fits: Callable[[Any], bool], within_s: float, retry_s: float) -> Any:
        waited_s, heard, due_s = 0.0, len(self.heard), 0.0
        while waited_s < within_s:
            if waited_s >= due_s:
                due_s = waited_s + retry_s
                self.send(request)
            self.pass_time(TICK_S)
            waited_s += TICK_S
            news, heard = self.heard[heard:], len(self.heard)
            for message in news:
                if fits(message):
                    return message
        return None


def _is_item(message: Any, seq: int) -> bool:
    return bool(message.get_type() == "MISSION_ITEM_INT" and message.seq == seq)


def _row_of(message: Any) -> Row:
    return Row(
        message.command,
        message.frame,
        message.param1,
        message.param2,
        message.param3,
        message.param4,
        message.x,
        message.y,
        message.z,
    )


def ground(personality: PersonalityName = "ardupilot", frame: FrameName = "copter", seed: int = 1) -> Ground:
    """Return a station with a vehicle that has heard of it."""
    station = Ground(Vehicle(seed, personality, frame))
    station.send(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    station.listen()
    return station


def custom_mode(main: int, sub: int = 0) -> int:
    """Return PX4's custom_mode."""
    return main << 16 | sub << 24
