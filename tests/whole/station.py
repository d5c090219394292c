"""Another ground station on the vehicle's link: it may send the vehicle anywhere, as a real one may."""

from __future__ import annotations

import socket
from typing import TYPE_CHECKING, Any, Self

from pymavlink.dialects.v20 import common as dialect

from autopilot.cli.demonstration.mission_stage import place

if TYPE_CHECKING:
    from tests.whole.flights import Mission


class Station:
    """Speaks MAVLink to the simulated vehicle by an address of its own."""

    def __init__(self, port: int, sender: tuple[int, int]) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._vehicle = ("127.0.0.1", port)
        self._link: Any = dialect.MAVLink(None, *sender)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self._socket.close()

    def fly_to(self, flight: Mission, east_m: float, north_m: float, up_m: float) -> None:
        """Send the vehicle to a place (MAV_CMD_DO_REPOSITION, changing its mode), until it goes there."""
        there = place(east_m, north_m)
        x, y = round(there["latitude"] * 1e7), round(there["longitude"] * 1e7)
        command = dialect.MAVLink_command_int_message(
            *(1, 1, 6, dialect.MAV_CMD_DO_REPOSITION, 0, 0), *(-1.0, 1.0, 0.0, 0.0), x, y, up_m
        )
        self._socket.sendto(command.pack(self._link), self._vehicle)
        flight.truth(lambda one: one["doing"] != "mission", "the vehicle to obey the other station")
