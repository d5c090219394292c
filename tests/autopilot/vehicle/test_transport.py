"""Ways to a vehicle over real sockets and a pair of terminals: frames in, frames out; what breaks is opened again."""

from __future__ import annotations

import asyncio
import os
import threading
import tty
from collections import Counter
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from autopilot.adapters.vehicle.frames import Deframer
from autopilot.adapters.vehicle.presence import Address
from autopilot.adapters.vehicle.transport import FAILED, UNSENT_BYTES_MAX, Transport, open_transport
from autopilot.ports.config import VehicleSection
from events.schema.vehicle_pb2 import CommandAnswered, VehicleStateReported
from tests.autopilot.vehicle.test_link import Inbox, link_to
from tests.autopilot.vehicle.vehicles import answer, at_angles, attitude, decode, heartbeat

pytestmark = pytest.mark.whole
WITHIN_S = 20.0
TURN_S = 0.01


class Ears:
    """What a transport handed over, and what it counted."""

    def __init__(self) -> None:
        self.heard: list[tuple[Address, bytes]] = []
        self.counts: Counter[str] = Counter()

    def hear(self, peer: Address, data: bytes) -> None:
        self.heard.append((peer, data))


async def until(holds: Callable[[], object]) -> None:
    """Wait for a condition. Raises TimeoutError."""
    async with asyncio.timeout(WITHIN_S):
        while not holds():
            await asyncio.sleep(TURN_S)


@asynccontextmanager
async def opened(**settings: Any) -> AsyncIterator[tuple[Transport, Ears]]:
    ears = Ears()
    transport = await open_transport(VehicleSection(reconnect_s=0.05, **settings), ears.hear, ears.counts)
    try:
        yield transport, ears
    finally:
        transport.close()
        await asyncio.sleep(0)


class Server:
    """A vehicle behind TCP, one client at a time."""

    def __init__(self) -> None:
        self.clients: list[asyncio.StreamWriter] = []
        self.read = b""
        self.gone = 0
        self._server: asyncio.Server | None = None

    async def start(self, port: int = 0) -> int:
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", port)
        found: int = self._server.sockets[0].getsockname()[1]
        return found

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.clients.append(writer)
        with suppress(OSError):
            while data := await reader.read(4_096):
                self.read += data
        self.gone += 1

    def stop(self) -> None:
        for client in self.clients:
            client.close()
        self.clients.clear()
        if self._server is not None:
            self._server.close()


def run(story: Callable[[], Coroutine[Any, Any, None]]) -> None:
    asyncio.run(story())


def test_tcp_cuts_a_stream_into_frames_and_connects_again() -> None:
    async def story() -> None:
        server = Server()
        port = await server.start()
        async with opened(connect=f"tcp://127.0.0.1:{port}") as (transport, ears):
            await until(lambda: server.clients)
            both = heartbeat() + attitude(1, 2)
            server.clients[0].write(b"noise" + both[:30])
            await until(lambda: ears.heard)
            server.clients[0].write(both[30:])
            await until(lambda: len(ears.heard) == 2)
            assert ears.heard == [(("127.0.0.1", port), heartbeat()), (("127.0.0.1", port), attitude(1, 2))]
            assert (transport.peer, transport.own) == (("127.0.0.1", port), None)
            assert transport.write(heartbeat(), ("127.0.0.1", port))
            await until(lambda: server.read == heartbeat())
            server.clients[0].write(attitude(3, 4)[:10])
            server.stop()
            await until(lambda: ears.counts[FAILED] >= 2)
            assert not transport.write(heartbeat(), ("127.0.0.1", port))
            await server.start(port)
            await until(lambda: server.clients)
            server.clients[0].write(attitude(5, 6))
            await until(lambda: len(ears.heard) == 3)
            assert ears.heard[-1][1] == attitude(5, 6)
            assert ears.counts["garbage"] == 1
        await until(lambda: server.gone == 2)  # closed for good: it does not come back
        server.stop()

    run(story)


def test_what_a_stream_does_not_take_is_not_sent_late() -> None:
    async def story() -> None:
        server = Server()
        port = await server.start()
        async with opened(connect=f"tcp://127.0.0.1:{port}") as (transport, _):
            await until(lambda: server.clients)
            server.clients[0].transport.pause_reading()  # type: ignore[attr-defined]
            frame, left = heartbeat() * 1_000, 0
            while transport.write(frame, ("127.0.0.1", port)):
                left += 1
                assert left < 10_000
            assert transport._out.get_write_buffer_size() < UNSENT_BYTES_MAX + len(frame)  # type: ignore[attr-defined]
        server.stop()

    run(story)


class Spy:
    """asyncio's side of a stream: notes what is written, and on which thread."""

    def __init__(self) -> None:
        self.written: list[tuple[bytes, int]] = []

    def is_closing(self) -> bool:
        return False

    def get_write_buffer_size(self) -> int:
        return 0

    def write(self, data: bytes) -> None:
        self.written.append((data, threading.get_ident()))


def test_another_thread_may_write_to_a_stream() -> None:
    """It is written on the loop, in order; not where there is no connection, nor once the loop is gone."""
    spy, peer = Spy(), ("127.0.0.1", 1)

    async def story() -> Transport:
        server = Server()
        async with opened(connect=f"tcp://127.0.0.1:{await server.start()}") as (transport, _):
            assert not transport.write(b"none", peer)
            await until(lambda: server.clients and transport._out)  # type: ignore[attr-defined]
            transport._out = spy  # type: ignore[attr-defined]
            assert await asyncio.to_thread(lambda: [transport.write(data, peer) for data in (b"a", b"b")]) == [True] * 2
            await until(lambda: len(spy.written) == 2)
            assert transport.write(b"c", peer)
            assert spy.written == [(data, threading.get_ident()) for data in (b"a", b"b", b"c")]
        server.stop()
        return transport

    transport = asyncio.run(story())
    transport._out = spy  # type: ignore[attr-defined]
    late: list[bool] = []
    thread = threading.Thread(target=lambda: late.append(transport.write(b"d", peer)))
    thread.start()
    thread.join(WITHIN_S)
    assert late == [False]


def test_udp_says_what_did_not_leave() -> None:
    """What the network refuses, what no loop is needed for, and what comes when it is closed."""

    async def story() -> None:
        async with opened(connect="127.0.0.1:9") as (transport, _):
            assert transport.own is not None
            ear = Ears()
            other = await open_transport(VehicleSection(listen="127.0.0.1:0"), ear.hear, ear.counts)
            assert other.own is not None
            assert not transport.write(bytes(70_000), other.own)
            assert await asyncio.to_thread(transport.write, heartbeat(), other.own)
            await until(lambda: ear.heard)
            assert ear.heard == [(("127.0.0.1", transport.own[1]), heartbeat())]
            other.close()
        assert not transport.write(heartbeat(), ("127.0.0.1", 9))

    run(story)


def test_a_port_that_is_taken_is_an_error() -> None:
    async def story() -> None:
        async with opened(listen="127.0.0.1:0") as (transport, _):
            assert transport.own is not None
            with pytest.raises(OSError, match="in use"):
                await open_transport(VehicleSection(listen=f"127.0.0.1:{transport.own[1]}"), Ears().hear, Counter())

    run(story)


class Terminals:
    """A serial line: the vehicle's end is a file descriptor, ours a device's path that can be unplugged."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "ttyTEST"
        self.heard = b""
        self.plug()

    def plug(self) -> None:
        self.vehicle, ours = os.openpty()
        tty.setraw(ours)
        os.set_blocking(self.vehicle, False)
        self.path.unlink(missing_ok=True)
        self.path.symlink_to(os.ttyname(ours))
        self._ours = ours

    def unplug(self) -> None:
        self.path.unlink()
        os.close(self.vehicle)
        os.close(self._ours)

    def read(self) -> bytes:
        """Return everything that came over the line so far."""
        with suppress(BlockingIOError):
            self.heard += os.read(self.vehicle, 4_096)
        return self.heard


def test_a_serial_device_is_read_written_and_opened_again(tmp_path: Path) -> None:
    async def story() -> None:
        line = Terminals(tmp_path)
        async with opened(connect=f"serial://{line.path}:57600") as (transport, ears):
            await until(lambda: transport.write(heartbeat(), (str(line.path), 57_600)))
            await until(lambda: line.read() == heartbeat())
            os.write(line.vehicle, heartbeat()[:7])
            os.write(line.vehicle, heartbeat()[7:] + attitude(1, 2))
            await until(lambda: len(ears.heard) == 2)
            assert [data for _, data in ears.heard] == [heartbeat(), attitude(1, 2)]
            line.unplug()
            await until(lambda: ears.counts[FAILED] >= 2)
            assert not transport.write(heartbeat(), (str(line.path), 57_600))
            line.plug()
            await until(lambda: transport.write(heartbeat(), (str(line.path), 57_600)))
            os.write(line.vehicle, attitude(3, 4))
            await until(lambda: len(ears.heard) == 3)
        line.unplug()

    run(story)


def test_a_vehicle_on_a_serial_device_is_commanded(tmp_path: Path) -> None:
    """The whole link, over a line that cuts frames where it likes."""

    async def story() -> None:
        line, inbox = Terminals(tmp_path), Inbox()
        link = link_to(VehicleSection(connect=f"serial://{line.path}:921600"), inbox)
        await link.start()
        try:

            async def told(kind: type[Any]) -> Any:
                async with asyncio.timeout(WITHIN_S):
                    while not list(inbox.of(kind)):
                        os.write(line.vehicle, heartbeat())
                        if b"\xe8\x03" in line.read():  # command 1000
                            os.write(line.vehicle, answer(1000))
                        await asyncio.sleep(TURN_S)
                return next(inbox.of(kind))

            assert (await told(VehicleStateReported)).system_id == 1
            link.perform(5, at_angles(), link._clock.mono_ns())
            assert (await told(CommandAnswered)).mav_result == 0
            line_read = Deframer()
            assert {decode(frame).get_type() for frame in line_read.feed(line.heard)} >= {"COMMAND_LONG"}
            assert line_read.skipped_bytes == 0
        finally:
            await link.stop()
            line.unplug()

    run(story)


def test_a_device_that_is_not_there_is_waited_for(tmp_path: Path) -> None:
    async def story() -> None:
        async with opened(connect=f"serial://{tmp_path}/none:57600") as (transport, ears):
            await until(lambda: ears.counts[FAILED] >= 3)
            assert not transport.write(heartbeat(), ("", 0))

    run(story)


def test_udp_names_the_key_of_a_host_that_is_not_known() -> None:
    async def story() -> None:
        with pytest.raises(ValueError, match=r"\[vehicle\] connect = .*host is not known"):
            await open_transport(VehicleSection(connect="no-such-host.invalid:1"), Ears().hear, Counter())

    run(story)
