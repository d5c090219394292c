"""The simulated aircraft and its world as a process: MAVLink over UDP, boxes over TCP, in real time.

`python -m autopilot.sim.process --seed 1 --seconds 60 --mavlink-port 14550 --eyes-port 14560` says
"ready" on stdout once both ports listen, flies, and stands answering on the ground until SIGTERM.
Each DetectionBatch goes to every client of the eyes' port behind a 4-byte big-endian length; a
client that does not read loses frames. All is bound to loopback. Port 0 lets the system choose.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import signal
import struct
from collections.abc import Sequence

from autopilot.ports.edges import Clock
from autopilot.sim.aircraft import HOME, Address, Aircraft, Unkindness
from autopilot.sim.world import FRAMES_PER_S, World
from autopilot.trust.clock import HostClock
from autopilot.wire.detections_pb2 import DetectionBatch

LOOPBACK = "127.0.0.1"
STEP_S = 0.02
LATENCY_S = 0.06  # from capture to message, like a small network on a small computer
CLIENT_BUFFER_BYTES = 65_536  # more than this unread: the client loses the frame
_LENGTH = struct.Struct(">I")


class Simulation(asyncio.DatagramProtocol):
    """Runs an aircraft and its world on the current loop; `start`, look at the ports, `stop`."""

    def __init__(self, aircraft: Aircraft, world: World, clock: Clock, *, hold: bool = False) -> None:
        self.aircraft = aircraft
        self.world = world
        self._clock = clock
        self.aircraft.held = hold
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
        self.aircraft.held = False
        self.aircraft.hear((addr[0], addr[1]), data)

    def _turn(self) -> None:
        """One step of the world."""
        now_ns = self._clock.mono_ns()
        self.aircraft.step((now_ns - self._stepped_ns) / 1e9)
        self._stepped_ns = now_ns
        if self._transport is not None:
            for peer, datagram in self.aircraft.take():
                self._transport.sendto(datagram, peer)
        self._see(now_ns)
        self._timer = asyncio.get_running_loop().call_later(STEP_S, self._turn)

    def _see(self, now_ns: int) -> None:
        """Capture a frame when it is time, and publish those that the detector is done with."""
        if now_ns >= self._frame_ns:
            self._frame_ns = max(self._frame_ns + round(1e9 / FRAMES_PER_S), now_ns)
            aircraft = self.aircraft
            self._frames.append((now_ns, self.world.look(aircraft.flown_s, now_ns, aircraft.motion, aircraft.gimbal)))
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


async def fly(arguments: argparse.Namespace) -> None:
    """Run until SIGTERM or SIGINT."""
    unkind = Unkindness(
        answer_lost=arguments.answer_lost,
        answer_late_s=arguments.answer_late,
        in_progress=arguments.in_progress,
        stream_lost=arguments.stream_lost,
    )
    aircraft = Aircraft(arguments.seed, arguments.seconds, tuple(arguments.home), unkind)
    simulation = Simulation(aircraft, World(arguments.seed, aircraft.route), HostClock(), hold=arguments.hold)
    over = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, over.set)
    await simulation.start(arguments.mavlink_port, arguments.eyes_port)
    print("ready", flush=True)
    await over.wait()
    await simulation.stop()


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    made = argparse.ArgumentParser(prog="python -m autopilot.sim.process", description="A simulated aircraft.")
    made.add_argument("--seed", type=int, default=1, help="everything that happens by chance comes from it")
    made.add_argument("--seconds", type=float, default=60, help="length of the flight, at least 15")
    made.add_argument("--mavlink-port", type=int, required=True, help="UDP port on loopback; peers speak first")
    made.add_argument("--eyes-port", type=int, required=True, help="TCP port on loopback that serves detections")
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
