"""The simulator as a process: it says ready, speaks MAVLink and boxes, and ends when asked. And to another's client."""

from __future__ import annotations

import asyncio
import signal
import socket
import struct
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, closing

import pytest
from pymavlink.dialects.v20 import common as dialect

from autopilot.sim.aircraft import Aircraft
from autopilot.sim.process import Simulation, craft_of, parser
from autopilot.sim.route import Route
from autopilot.sim.vehicle import Vehicle
from autopilot.sim.world import World
from autopilot.trust.clock import HostClock
from autopilot.wire.detections_pb2 import DetectionBatch

WITHIN_S = 30.0


def free_ports() -> tuple[int, int]:
    """Return a UDP and a TCP port of loopback that nobody has."""
    found = []
    for kind in (socket.SOCK_DGRAM, socket.SOCK_STREAM):
        with closing(socket.socket(socket.AF_INET, kind)) as probe:
            probe.bind(("127.0.0.1", 0))
            found.append(int(probe.getsockname()[1]))
    return found[0], found[1]


async def batch_from(reader: asyncio.StreamReader) -> DetectionBatch:
    (length,) = struct.unpack(">I", await reader.readexactly(4))
    return DetectionBatch.FromString(await reader.readexactly(length))


@asynccontextmanager
async def simulation(seconds: float = 60) -> AsyncIterator[Simulation]:
    aircraft = Aircraft(1, seconds)
    running = Simulation(aircraft, World(1, aircraft.route), HostClock())
    await running.start()
    try:
        yield running
    finally:
        await running.stop()


@pytest.mark.whole
def test_boxes_reach_every_client_and_the_end_is_told() -> None:
    async def story() -> None:
        async with asyncio.timeout(WITHIN_S):
            async with simulation() as running:
                running.aircraft.step(20)
                ends = [await asyncio.open_connection("127.0.0.1", running.eyes_port) for _ in range(2)]
                batches = [await batch_from(reader) for reader, _ in ends for _ in range(5)]
                for of_one in (batches[:5], batches[5:]):
                    numbers = [batch.frame_seq for batch in of_one]
                    assert numbers == [*range(numbers[0], numbers[0] + 5)]
                    stamps = [batch.captured_ns for batch in of_one]
                    assert sorted(set(stamps)) == stamps
                assert all(batch.latency_us >= 60_000 for batch in batches)
            last = batches[0]
            while not last.ended_because:
                last = await batch_from(ends[0][0])
            for _, writer in ends:
                writer.close()

    asyncio.run(story())


@pytest.mark.whole
def test_a_process_of_its_own() -> None:
    async def story() -> None:
        mavlink_port, eyes_port = free_ports()
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "autopilot.sim.process", "--seed", "1", "--seconds", "15"),
            *("--mavlink-port", str(mavlink_port), "--eyes-port", str(eyes_port)),
            stdout=asyncio.subprocess.PIPE,
        )
        try:
            async with asyncio.timeout(WITHIN_S):
                assert process.stdout is not None
                assert await process.stdout.readline() == b"ready\n"
                reader, writer = await asyncio.open_connection("127.0.0.1", eyes_port)
                assert (await batch_from(reader)).model == "simulated"
                writer.close()
                with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as peer:
                    peer.setblocking(False)
                    hello = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(dialect.MAVLink(None, 255, 190))
                    loop = asyncio.get_running_loop()
                    await loop.sock_sendto(peer, bytes(hello), ("127.0.0.1", mavlink_port))
                    data = await loop.sock_recv(peer, 300)
                (message,) = dialect.MAVLink(None).parse_buffer(data)
                assert (message.get_srcSystem(), message.get_srcComponent()) == (1, 1)
                process.send_signal(signal.SIGTERM)
                assert await process.wait() == 0
        finally:
            if process.returncode is None:
                process.kill()
                await process.wait()

    asyncio.run(story())


@pytest.mark.whole
def test_a_vehicle_is_flown_faster_than_time_and_its_footprints_are_kept() -> None:
    async def story() -> None:
        vehicle = Vehicle(1)
        vehicle.gimbal.pitch_deg = -90
        running = Simulation(vehicle, World(1, Route(1, 60)), HostClock(), speed_up=20)
        await running.start()
        vehicle.launch(20)
        async with asyncio.timeout(WITHIN_S):
            reader, writer = await asyncio.open_connection("127.0.0.1", running.eyes_port)
            while vehicle.motion.up_m < 19:
                last = await batch_from(reader)
            writer.close()
        assert last.model == "simulated"
        assert vehicle.time_s > 7
        heights_m = [one.height_m for one in running.footprints.seen]
        assert heights_m == sorted(heights_m)
        assert heights_m[0] >= 1
        await running.stop()

    asyncio.run(story())


@pytest.mark.parametrize(
    ("options", "kind"),
    [
        ([], Aircraft),
        (["--pilot", "self", "--answer-lost", "0.5"], Aircraft),
        (["--pilot", "node", "--answer-lost", "0.5"], Vehicle),
    ],
)
def test_who_flies(options: list[str], kind: type) -> None:
    arguments = parser().parse_args(["--mavlink-port", "0", "--eyes-port", "0", *options])
    assert type(craft_of(arguments, HostClock())) is kind


def test_what_the_options_make_of_a_vehicle() -> None:
    options = ["--pilot", "node", "--personality", "px4", "--frame", "plane", "--home", "10", "20", "30"]
    options += ["--answer-lost", "0.1", "--answer-late", "2", "--in-progress", "0.3", "--stream-lost", "0.4"]
    vehicle = craft_of(parser().parse_args(["--mavlink-port", "0", "--eyes-port", "0", *options]), HostClock())
    assert isinstance(vehicle, Vehicle)
    unkind = vehicle.unkind
    assert (unkind.ack_lost, unkind.ack_late_s, unkind.ack_in_progress, unkind.stream_lost) == (0.1, 2, 0.3, 0.4)
    assert (vehicle.personality.autopilot, vehicle.flight.frame.hovers) == (12, False)
    assert (vehicle.home.latitude_deg, vehicle.home.longitude_deg, vehicle.home.altitude_m) == (10, 20, 30)


@pytest.mark.whole
def test_a_taken_port_is_an_error() -> None:
    async def story() -> None:
        async with simulation() as running:
            aircraft = Aircraft(2, 60)
            other = Simulation(aircraft, World(2, aircraft.route), HostClock())
            with pytest.raises(OSError, match="in use"):
                await other.start(running.mavlink_port)

    asyncio.run(story())
