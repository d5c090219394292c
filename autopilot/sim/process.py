"""The simulated aircraft and its world as a process: MAVLink over UDP, boxes over TCP, in real time.

`python -m autopilot.sim.process --seed 1 --seconds 60 --mavlink-port 14550 --eyes-port 14560` says
"ready" on stdout once its ports listen, flies a circle by itself, and stands answering on the ground
until SIGTERM. With `--pilot node` it flies what it is told instead: `--personality ardupilot|px4`,
`--frame copter|plane`; `--door-port` then opens `door.py`. Each DetectionBatch goes to every client of
the eyes' port behind a 4-byte big-endian length; a client that does not read loses frames. All is bound
to loopback. Port 0 lets the system choose. `--speed-up 5` lets five seconds of the whole simulated world
pass in one, the protocols' times and the rates of its streams included.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import signal
import struct
from collections.abc import Sequence
from typing import Protocol

from autopilot.ports.edges import Clock
from autopilot.sim.aircraft import HOME, Address, Aircraft, Unkindness
from autopilot.sim.door import Door
from autopilot.sim.footprints import Footprints
from autopilot.sim.gimbal import Gimbal
from autopilot.sim.route import Motion, Route
from autopilot.sim.vehicle import Vehicle
from autopilot.sim.world import FIELD_OF_VIEW_DEG, FRAMES_PER_S, HEIGHT_PX, LOWEST_M, WIDTH_PX, World
from autopilot.trust.clock import HostClock
from autopilot.wire.detections_pb2 import DetectionBatch

LOOPBACK = "127.0.0.1"
STEP_S = 0.02
LATENCY_S = 0.06  # from capture to message, like a small network on a small computer
CLIENT_BUFFER_BYTES = 65_536  # more than this unread: the client loses the frame
_LENGTH = struct.Struct(">I")


class Craft(Protocol):
    """What flies: an `Aircraft` on its own route, or a `Vehicle` that is told."""

    time_s: float

    @property
    def gimbal(self) -> Gimbal:
        """The gimbal."""

    @property
    def motion(self) -> Motion:
        """Where it is and how it moves."""

    def step(self, dt_s: float) -> None:
        """Let time pass."""

    def hear(self, peer: Address, datagram: bytes) -> None:
        """Take a datagram."""

    def take(self) -> list[tuple[Address, bytes]]:
        """Return the datagrams that are due."""


class Simulation(asyncio.DatagramProtocol):
    """Runs an aircraft and its world on the current loop; `start`, look at the ports, `stop`."""

    def __init__(
        self, aircraft: Craft, world: World, clock: Clock, *, hold: bool = False, speed_up: float = 1.0
    ) -> None:
        self.aircraft = aircraft
        self.world = world
        self._clock = clock
        self.footprints = Footprints(FIELD_OF_VIEW_DEG, WIDTH_PX, HEIGHT_PX)
        self._speed_up = speed_up
        if isinstance(aircraft, Aircraft):
            aircraft.held = hold
        self._stepped_ns = 0
        self._frame_ns = 0
        self._frames: list[tuple[int, DetectionBatch]] = []  # captured, on their way through the detector
        self._clients: set[asyncio.StreamWriter] = set()
        self._transport: asyncio.DatagramTransport | None = None
        self._server: asyncio.Server | None = None
        self._timer: asyncio.TimerHandle | None = None
        self.mavlink_port = 0
        self.eyes_port = 0

    async def start(self, mavlink_port: int = 0, eyes_port: int = 0) -> None:
        """Listen and begin; raises OSError where a port is taken."""
        loop = asyncio.get_running_loop()
        self._transport, _ = await loop.create_datagram_endpoint(lambda: self, local_addr=(LOOPBACK, mavlink_port))
        self._server = await asyncio.start_server(self._client, LOOPBACK, eyes_port)
        self.mavlink_port = self._transport.get_extra_info("sockname")[1]
        self.eyes_port = self._server.sockets[0].getsockname()[1]
        self._stepped_ns = self._frame_ns = self._clock.mono_ns()
        self._turn()

    async def stop(self) -> None:
        """Tell the eyes' clients that it is over, and close everything."""
        if self._timer is not None:
            self._timer.cancel()
        if self._server is not None:
            self._server.close()
        self._publish(DetectionBatch(camera=1, ended_because="the simulation was stopped"))
        for client in list(self._clients):
            client.close()
        if self._transport is not None:
            self._transport.close()

    def datagram_received(self, data: bytes, addr: Address) -> None:
        """Take a datagram (called by asyncio); the first one lets a held aircraft go."""
        if isinstance(self.aircraft, Aircraft):
            self.aircraft.held = False
        self.aircraft.hear((addr[0], addr[1]), data)

    def _turn(self) -> None:
        """One step of the world."""
        now_ns = self._clock.mono_ns()
        self.aircraft.step((now_ns - self._stepped_ns) / 1e9 * self._speed_up)
        self._stepped_ns = now_ns
        if self._transport is not None:
            for peer, datagram in self.aircraft.take():
                self._transport.sendto(datagram, peer)
        self._see(now_ns)
        self._timer = asyncio.get_running_loop().call_later(STEP_S, self._turn)

    def _see(self, now_ns: int) -> None:
        """Capture a frame when it is time, and publish those that the detector is done with."""
        if now_ns >= self._frame_ns:
            self._frame_ns = max(self._frame_ns + round(1e9 / FRAMES_PER_S / self._speed_up), now_ns)
            aircraft = self.aircraft
            motion = aircraft.motion
            seconds = aircraft.flown_s if isinstance(aircraft, Aircraft) else aircraft.time_s
            self._frames.append((now_ns, self.world.look(seconds, now_ns, motion, aircraft.gimbal)))
            if motion.up_m >= LOWEST_M:
                self.footprints.add(motion, aircraft.gimbal)
        while self._frames and now_ns - self._frames[0][0] >= LATENCY_S * 1e9:
            captured_ns, batch = self._frames.pop(0)
            batch.latency_us = (now_ns - captured_ns) // 1000
            self._publish(batch)

    def _publish(self, batch: DetectionBatch) -> None:
        data = batch.SerializeToString()
        for client in self._clients:
            if client.transport.get_write_buffer_size() < CLIENT_BUFFER_BYTES:
                client.write(_LENGTH.pack(len(data)) + data)

    async def _client(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one client until it goes; what it says is thrown away."""
        self._clients.add(writer)
        try:
            with contextlib.suppress(OSError):
                while await reader.read(4096):
                    pass
        finally:
            self._clients.discard(writer)
            writer.close()


def craft_of(arguments: argparse.Namespace, clock: Clock) -> Craft:
    """Return what is to fly."""
    if arguments.pilot == "node":
        home = tuple(arguments.home)
        vehicle = Vehicle(arguments.seed, arguments.personality, arguments.frame, home, clock.wall_ns() / 1e9)
        vehicle.unkind.ack_lost = arguments.answer_lost
        vehicle.unkind.ack_late_s = arguments.answer_late
        vehicle.unkind.ack_in_progress = arguments.in_progress
        vehicle.unkind.stream_lost = arguments.stream_lost
        return vehicle
    unkind = Unkindness(
        answer_lost=arguments.answer_lost,
        answer_late_s=arguments.answer_late,
        in_progress=arguments.in_progress,
        stream_lost=arguments.stream_lost,
    )
    return Aircraft(arguments.seed, arguments.seconds, tuple(arguments.home), unkind)


async def fly(arguments: argparse.Namespace) -> None:
    """Run until SIGTERM or SIGINT."""
    clock = HostClock()
    craft = craft_of(arguments, clock)
    world = World(arguments.seed, Route(arguments.seed, arguments.seconds))
    simulation = Simulation(craft, world, clock, hold=arguments.hold, speed_up=arguments.speed_up)
    over = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, over.set)
    await simulation.start(arguments.mavlink_port, arguments.eyes_port)
    door = Door(craft, simulation.footprints) if isinstance(craft, Vehicle) else None
    if door is not None and arguments.door_port is not None:
        await door.start(LOOPBACK, arguments.door_port)
    print("ready", flush=True)
    await over.wait()
    if door is not None:
        door.stop()
    await simulation.stop()


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    made = argparse.ArgumentParser(prog="python -m autopilot.sim.process", description="A simulated aircraft.")
    made.add_argument("--seed", type=int, default=1, help="everything that happens by chance comes from it")
    made.add_argument("--seconds", type=float, default=60, help="length of the flight, at least 15")
    made.add_argument("--mavlink-port", type=int, required=True, help="UDP port on loopback; peers speak first")
    made.add_argument("--eyes-port", type=int, required=True, help="TCP port on loopback that serves detections")
    made.add_argument("--pilot", choices=("self", "node"), default="self", help="who flies it")
    made.add_argument("--personality", choices=("ardupilot", "px4"), default="ardupilot", help="with --pilot node")
    made.add_argument("--frame", choices=("copter", "plane"), default="copter", help="with --pilot node")
    made.add_argument("--door-port", type=int, help="TCP port on loopback of the door; with --pilot node")
    made.add_argument("--speed-up", type=float, default=1.0, help="simulated seconds in a second")
    made.add_argument("--home", type=float, nargs=3, default=HOME, metavar=("LAT", "LON", "ALT_M"), help="home, AMSL")
    made.add_argument("--hold", action="store_true", help="stay on the ground until somebody speaks MAVLink")
    made.add_argument("--answer-lost", type=float, default=0, help="probability that an answer is lost")
    made.add_argument("--answer-late", type=float, default=0, help="answers come late by up to this many seconds")
    made.add_argument("--in-progress", type=float, default=0, help="probability of IN_PROGRESS before an answer")
    made.add_argument("--stream-lost", type=float, default=0, help="probability that a telemetry message is lost")
    return made


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the process."""
    asyncio.run(fly(parser().parse_args(arguments)))


if __name__ == "__main__":
    main()
