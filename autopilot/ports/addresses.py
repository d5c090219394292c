"""Where a vehicle is reached, as one text of the configuration; nothing is opened or looked up here.

udp://HOST:PORT or HOST:PORT        datagrams; `connect` speaks first, `listen` waits for the peer
tcp://HOST:PORT                     `connect` only
serial:///DEVICE:BAUD               `connect` only, for instance serial:///dev/ttyAMA0:921600
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

EXAMPLES: Final = "udp://127.0.0.1:14550, tcp://127.0.0.1:5760 or serial:///dev/ttyAMA0:921600"
PORT_MAX: Final = 65_535
BAUD: Final = range(1_200, 4_000_001)  # what adapters of today can do


@dataclass(frozen=True, slots=True)
class Where:
    """A parsed address: host and port, or device and baud rate."""

    transport: Literal["udp", "tcp", "serial"]
    name: str  # host, without the brackets of IPv6, or the device's path
    number: int  # port, or bits a second


def parse(text: str) -> Where:
    """Return what an address names; raises ValueError with what it should look like."""
    scheme, separator, rest = text.partition("://")
    if not separator:
        scheme, rest = "udp", text
    name, colon, digits = rest.rpartition(":")
    if not (colon and name and digits.isascii() and digits.isdecimal()):
        raise ValueError(f'"{text}" is not an address: write host:port, {EXAMPLES}')
    number = int(digits)
    if scheme == "serial":
        if not name.startswith("/") or number not in BAUD:
            raise ValueError(f'"{text}" needs the path of a device and its baud rate, as in {EXAMPLES}')
        return Where("serial", name, number)
    if number > PORT_MAX or "/" in name:
        raise ValueError(f'"{text}" is not an address: write host:port, {EXAMPLES}')
    if scheme == "udp":
        return Where("udp", name.strip("[]"), number)
    if scheme == "tcp":
        return Where("tcp", name.strip("[]"), number)
    raise ValueError(f'"{text}" begins with {scheme}://, which is not known: write {EXAMPLES}')


def parse_listening(text: str) -> Where:
    """Return where to wait for the peer; raises ValueError: only datagrams can be waited for."""
    where = parse(text)
    if where.transport != "udp":
        raise ValueError(f'"{text}": a node listens for datagrams only, as in udp://127.0.0.1:14550; use connect')
    return where
