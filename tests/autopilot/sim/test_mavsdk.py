"""Another implementation of MAVLink, MAVSDK, finds the simulated aircraft, commands it and reads where it is."""

from __future__ import annotations

import queue
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from mavsdk import ComponentType, Configuration, ConnectionResult, Mavsdk
from mavsdk.plugins.telemetry import Telemetry, TelemetryResult

from tests.autopilot.sim.test_process import WITHIN_S, free_ports


@contextmanager
def aircraft() -> Iterator[int]:
    """Yield the MAVLink port of a simulated aircraft in its own process."""
    mavlink_port, eyes_port = free_ports()
    command = [sys.executable, "-m", "autopilot.sim.process", "--seconds", "60"]
    command += ["--mavlink-port", str(mavlink_port), "--eyes-port", str(eyes_port)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == b"ready\n"
            yield mavlink_port
        finally:
            process.terminate()


@pytest.mark.whole
def test_mavsdk_finds_it_and_is_answered() -> None:
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    with aircraft() as port, Mavsdk(configuration) as mavsdk:
        assert mavsdk.add_any_connection(f"udpout://127.0.0.1:{port}") == ConnectionResult.SUCCESS
        system = mavsdk.first_autopilot(WITHIN_S)
        assert system is not None
        assert system.get_system_id() == 1
        telemetry: Any = Telemetry(system)
        places: queue.Queue[Any] = queue.Queue()
        handle = telemetry.subscribe_position(lambda place, _: places.put(place))
        assert telemetry.set_rate_position(10.0) == TelemetryResult.SUCCESS
        place = places.get(timeout=WITHIN_S)
        telemetry.unsubscribe_position(handle)
        assert (place.latitude_deg, place.longitude_deg) == pytest.approx((47.3977, 8.5456), abs=1e-3)
