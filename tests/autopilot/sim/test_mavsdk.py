"""Another implementation of MAVLink, MAVSDK, finds the simulated aircraft, commands it, and flies missions with it."""

from __future__ import annotations

import json
import queue
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

import pytest
from mavsdk import ComponentType, Configuration, ConnectionResult, Mavsdk
from mavsdk.plugins.action import Action
from mavsdk.plugins.mission_raw import MissionItem, MissionRaw, MissionRawError
from mavsdk.plugins.telemetry import Telemetry, TelemetryResult

from tests.autopilot.sim.ground import Row, row
from tests.autopilot.sim.test_process import WITHIN_S, free_ports

FLIGHT_S = 60.0


@contextmanager
def aircraft(*more: str) -> Iterator[int]:
    """Yield the MAVLink port of a simulated aircraft in its own process."""
    mavlink_port, eyes_port = free_ports()
    command = [sys.executable, "-m", "autopilot.sim.process", "--seconds", "60"]
    command += ["--mavlink-port", str(mavlink_port), "--eyes-port", str(eyes_port), *more]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == b"ready\n"
            yield mavlink_port
        finally:
            process.terminate()


@contextmanager
def system_at(port: int) -> Iterator[Any]:
    """Yield MAVSDK's view of the vehicle on a port."""
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    with Mavsdk(configuration) as mavsdk:
        assert mavsdk.add_any_connection(f"udpout://127.0.0.1:{port}") == ConnectionResult.SUCCESS
        system = mavsdk.first_autopilot(WITHIN_S)
        assert system is not None
        assert system.get_system_id() == 1
        yield system


@contextmanager
def vehicle(personality: str) -> Iterator[tuple[Any, Any]]:
    """Yield MAVSDK's view of a vehicle that flies what it is told, and its door."""
    _, door_port = free_ports()
    options = ("--pilot", "node", "--personality", personality, "--door-port", str(door_port), "--speed-up", "4")
    with (
        aircraft(*options) as port,
        system_at(port) as system,
        closing(socket.create_connection(("127.0.0.1", door_port), WITHIN_S)) as door,
    ):
        yield system, door.makefile("rw")


def at_the_door(door: Any, order: dict[str, Any]) -> Any:
    """Say something at the door and return the answer."""
    door.write(json.dumps(order) + "\n")
    door.flush()
    return json.loads(door.readline())


def raw(rows: list[Row]) -> list[MissionItem]:
    """Return items as MAVSDK has them."""
    return [
        MissionItem(
            seq=seq,
            frame=one.frame,
            command=one.command,
            current=int(seq == 0),
            autocontinue=1,
            param1=one.p1,
            param2=one.p2,
            param3=one.p3,
            param4=one.p4,
            x=one.x,
            y=one.y,
            z=one.z,
            mission_type=0,
        )
        for seq, one in enumerate(rows)
    ]


@pytest.mark.whole
def test_mavsdk_finds_it_and_is_answered() -> None:
    with aircraft() as port, system_at(port) as system:
        telemetry: Any = Telemetry(system)
        places: queue.Queue[Any] = queue.Queue()
        handle = telemetry.subscribe_position(lambda place, _: places.put(place))
        assert telemetry.set_rate_position(10.0) == TelemetryResult.SUCCESS
        place = places.get(timeout=WITHIN_S)
        telemetry.unsubscribe_position(handle)
        assert (place.latitude_deg, place.longitude_deg) == pytest.approx((47.3977, 8.5456), abs=1e-3)


FLOWN = [row(22, 0, 0, 12, frame=6), row(16, 30, 0, 12, frame=6), row(16, 30, 30, 15, frame=6), Row(20, 2)]


@pytest.mark.whole
@pytest.mark.parametrize("personality", ["ardupilot", "px4"])
def test_mavsdk_uploads_and_reads_back(personality: str) -> None:
    rows = [row(16, 0, 0, 0, frame=6), *FLOWN] if personality == "ardupilot" else FLOWN
    with vehicle(personality) as (system, door):
        missions: Any = MissionRaw(system)
        missions.upload_mission(raw(rows))
        assert at_the_door(door, {"state": True})["state"]["items"] == len(rows)
        back = missions.download_mission()
        assert [item.command for item in back] == [one.command for one in rows]
        placed = [(item.x, item.y) for item in back if item.command == 16]
        assert placed[-1] == (rows[-2].x, rows[-2].y)
        with pytest.raises(MissionRawError, match=r"INVALID|UNSUPPORTED|ERROR"):
            missions.upload_mission(raw([rows[0], Row(31_000, 6)]))
        missions.clear_mission()
        left = at_the_door(door, {"state": True})["state"]["items"]
        assert left == int(personality == "ardupilot")  # to clear one it uploads a mission of home alone


@pytest.mark.whole
@pytest.mark.parametrize("personality", ["ardupilot", "px4"])
def test_mavsdk_flies_a_mission(personality: str) -> None:
    rows = [row(16, 0, 0, 0, frame=6), *FLOWN] if personality == "ardupilot" else FLOWN
    with vehicle(personality) as (system, door):
        missions: Any = MissionRaw(system)
        action: Any = Action(system)
        telemetry: Any = Telemetry(system)
        armed: queue.Queue[bool] = queue.Queue()
        progress: queue.Queue[Any] = queue.Queue()
        missions.upload_mission(raw(rows))
        telemetry.subscribe_armed(lambda is_armed, _: armed.put(is_armed))
        missions.subscribe_mission_progress(lambda made, _: progress.put((made.current, made.total)))
        action.arm()
        while not armed.get(timeout=WITHIN_S):
            pass
        missions.start_mission()
        while armed.get(timeout=FLIGHT_S):
            pass
        state = at_the_door(door, {"state": True})["state"]
        assert (state["armed"], state["up_m"]) == (False, 0)
        assert (state["east_m"], state["north_m"]) == pytest.approx((0, 0), abs=1)
        made = []
        while not progress.empty():
            made.append(progress.get())
        assert max(current for current, _ in made) >= len(rows) - 2
