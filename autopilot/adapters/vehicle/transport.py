"""Ways to a vehicle: UDP (speaking first, or waiting for the peer), TCP as a client, a serial device.

`open_transport` opens what the configuration names. Datagrams are handed over as they come, streams frame by frame.
A stream that can't be opened or breaks off is tried again every `reconnect_s` until `close`, and each failure is
counted; a socket for datagrams is opened once, for it has no connection to lose. Nothing here decides.
"""

from __future__ import annotations

import asyncio
import os
import socket
import threading
from collections import Counter
from collections.abc import Callable
from typing import Any, Protocol

import serial

from autopilot.adapters.vehicle.frames import Deframer
from autopilot.adapters.vehicle.presence import Address
from autopilot.ports.addresses import Where, parse, parse_listening
from autopilot.ports.config import VehicleSection

Hear = Callable[[Address, bytes], None]
UNSENT_BYTES_MAX = 8_192  # more than this unsent on a stream: what comes then is not sent, for it would come late
FAILED = "connection failed"


class Transport(Protocol):
    """An open way to the vehicle. It lives on one asyncio loop; `write` alone may be called from any thread."""

    @property
    def own(self) -> Address | None:
        """Own address; None where there is none (a device, a stream that is not connected)."""

    @property
    def peer(self) -> Address | None:
        """The only peer there can be; None where anybody may speak first."""

    def write(self, data: bytes, peer: Address) -> bool:
        """Return whether the bytes left."""

    def close(self) -> None:
        """Close it; nothing is heard afterwards."""


async def open_transport(settings: VehicleSection, hear: Hear, counts: Counter[str]) -> Transport:
    """Open what `[vehicle]` names; `hear` is called with each datagram or frame, `counts` gets failures by name.

    Raises ValueError where it names no usable address, OSError where a socket can't be opened.
    """
    key, text = ("connect", settings.connect) if settings.connect else ("listen", settings.listen)
    try:
        where = parse(text) if settings.connect else parse_listening(text)
        if where.transport == "udp":
            return await _open_datagrams(where, hear, speaks_first=bool(settings.connect))
    except ValueError as error:
        raise ValueError(f"[vehicle] {key} = {error}") from error
    return Stream(where, hear, counts, settings.reconnect_s)


class Datagrams(asyncio.DatagramProtocol):
    """UDP; made by `open_transport`. What the socket does not take at once is not sent: it would come late."""

    def __init__(self, hear: Hear, peer: Address | None, out: socket.socket) -> None:
        """`out` is the socket that asyncio hears on, and has made non-blocking: sending needs no loop."""
        self._hear = hear
        self._transport: asyncio.DatagramTransport | None = None
        self._out = out
        self.peer = peer

    @property
    def own(self) -> Address | None:
        """Own address."""
        if self._transport is None:
            return None
        host, port = self._transport.get_extra_info("sockname")[:2]
        return host, port

    def connection_made(self, transport: Any) -> None:
        """Begin (called by asyncio)."""
        self._transport = transport

    def datagram_received(self, data: bytes, addr: tuple[Any, ...]) -> None:
        """Hand over a datagram (called by asyncio)."""
        if self._transport is not None:
            self._hear((addr[0], addr[1]), data)

    def write(self, data: bytes, peer: Address) -> bool:
        """Return whether the bytes left: not where the network refuses them, nor once it is closed."""
        try:
            self._out.sendto(data, peer)
        except OSError:
            return False
        return True

    def close(self) -> None:
        """Close the socket."""
        if self._transport is not None:
            self._transport.close()
            self._transport = None


class Stream(asyncio.Protocol):
    """TCP as a client, or a serial device: opened again for as long as it is wanted."""

    def __init__(self, where: Where, hear: Hear, counts: Counter[str], reconnect_s: float) -> None:
        """Begin to open it on the running loop; returns at once."""
        self._where = where
        self._hear = hear
        self._counts = counts
        self._reconnect_s = reconnect_s
        self._deframer = Deframer()
        self._out: asyncio.WriteTransport | None = None
        self._gone = asyncio.Event()
        self.peer: Address = (where.name, where.number)
        self._asyncio_loop, self._thread = asyncio.get_running_loop(), threading.get_ident()
        self._task = self._asyncio_loop.create_task(self._keep_open())

    @property
    def own(self) -> Address | None:
        """A stream has no address that anybody could write to."""
        return None

    def connection_lost(self, exc: Exception | None) -> None:
        """Note that it broke off (called by asyncio)."""
        del exc
        self._out = None
        self._gone.set()

    def data_received(self, data: bytes) -> None:
        """Hand over the frames that these bytes end (called by asyncio)."""
        skipped = self._deframer.skipped_bytes
        for frame in self._deframer.feed(data):
            self._hear(self.peer, frame)
        if self._deframer.skipped_bytes != skipped:
            self._counts["garbage"] += 1

    def write(self, data: bytes, peer: Address) -> bool:
        """Return whether the bytes left, or will at once: what another thread writes, in the loop's next turn."""
        del peer
        if self._out is None or self._out.is_closing() or self._out.get_write_buffer_size() > UNSENT_BYTES_MAX:
            return False
        if threading.get_ident() == self._thread:
            self._out.write(data)
            return True
        try:
            self._asyncio_loop.call_soon_threadsafe(self._out.write, data)
        except RuntimeError:  # the loop is closed
            return False
        return True

    def close(self) -> None:
        """Close it for good."""
        self._task.cancel()

    async def _keep_open(self) -> None:
        while True:
            opened: list[asyncio.BaseTransport] = []
            try:
                self._gone.clear()
                opened = await self._open()
                await self._gone.wait()
            except (OSError, serial.SerialException):
                pass
            finally:
                self._out = None
                for transport in opened:
                    transport.close()
            self._counts[FAILED] += 1
            self._deframer = Deframer()
            await asyncio.sleep(self._reconnect_s)

    async def _open(self) -> list[asyncio.BaseTransport]:
        loop, where = asyncio.get_running_loop(), self._where
        if where.transport == "tcp":
            transport, _ = await loop.create_connection(lambda: self, where.name, where.number)
            self._out = transport
            return [transport]
        device = serial.Serial(where.name, where.number, timeout=0, write_timeout=0)
        reading, _ = await loop.connect_read_pipe(lambda: self, device)
        copy = os.fdopen(os.dup(device.fileno()), "wb", buffering=0)
        self._out, _ = await loop.connect_write_pipe(asyncio.BaseProtocol, copy)
        return [reading, self._out]


async def _open_datagrams(where: Where, hear: Hear, *, speaks_first: bool) -> Datagrams:
    loop = asyncio.get_running_loop()
    try:
        found = await loop.getaddrinfo(where.name, where.number, type=socket.SOCK_DGRAM)
    except socket.gaierror as error:
        raise ValueError(f'"{where.name}": the host is not known here ({error.strerror})') from error
    family, _, _, _, address = found[0]
    named: Address = (str(address[0]), int(address[1]))
    anywhere: Address = ("::" if family == socket.AF_INET6 else "0.0.0.0", 0)
    own, peer = (anywhere, named) if speaks_first else (named, None)
    out = socket.socket(family, socket.SOCK_DGRAM)
    try:
        out.bind(own)
        _, protocol = await loop.create_datagram_endpoint(lambda: Datagrams(hear, peer, out), sock=out)
    except BaseException:
        out.close()
        raise
    return protocol
