"""The vehicle's post: who it speaks to, what is to be sent and when, and the bad links in and out.

Whoever speaks becomes a peer, until it is silent for a while; there are only so many. Datagrams go
through a `Lossy` link each way. Nothing here knows what a message means.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from pymavlink.dialects.v20 import common as dialect

from autopilot.sim.aircraft import COMPONENT, PEER_SILENCE_S, PEERS_MAX, SYSTEM
from autopilot.sim.lossy import Lossy
from autopilot.sim.transfer import Address

US = (SYSTEM, COMPONENT)


class Post:
    """Peers, letters and links of one vehicle; `now_s` is the vehicle's time."""

    def __init__(self, seed: int) -> None:
        self.inward: Lossy[tuple[Address, bytes]] = Lossy(f"inward {seed}")
        self.outward: Lossy[tuple[Address, bytes]] = Lossy(f"outward {seed}")
        self._peers: dict[Address, float] = {}
        self._letters: list[tuple[float, Address, Any, tuple[int, int]]] = []
        self._links: dict[tuple[int, int], Any] = {}

    def meet(self, now_s: float, peer: Address) -> None:
        """Send to this address from now on, where there is room."""
        if peer in self._peers or len(self._peers) < PEERS_MAX:
            self._peers[peer] = now_s

    def arrived(self, now_s: float) -> list[tuple[Address, Any]]:
        """Return the messages that have come through the link; what isn't MAVLink is dropped."""
        found = []
        for peer, datagram in self.inward.due(now_s):
            reader = dialect.MAVLink(None)
            reader.robust_parsing = True
            messages = reader.parse_buffer(datagram) or []
            found += [(peer, message) for message in messages if message.get_type() != "BAD_DATA"]
        return found

    def write(self, at_s: float, peer: Address, message: Any, source: tuple[int, int] = US) -> None:
        """Send a message to one peer, at a time."""
        self._letters.append((at_s, peer, message, source))

    def burn(self) -> None:
        """Forget what isn't sent yet."""
        self._letters.clear()

    def send(self, now_s: float, for_all: Iterable[Any]) -> None:
        """Put on the link the letters that are due, and messages for every peer."""
        self._peers = {peer: at_s for peer, at_s in self._peers.items() if now_s - at_s < PEER_SILENCE_S}
        due = [letter for letter in self._letters if letter[0] <= now_s]
        self._letters = [letter for letter in self._letters if letter[0] > now_s]
        for _, peer, message, source in due:
            self.outward.put(now_s, (peer, self._pack(message, source)))
        for message in for_all:
            packed = self._pack(message, US)
            for peer in self._peers:
                self.outward.put(now_s, (peer, packed))

    def _pack(self, message: Any, source: tuple[int, int]) -> bytes:
        link = self._links.setdefault(source, dialect.MAVLink(None, *source))
        packed = bytes(message.pack(link))
        link.seq = (link.seq + 1) % 256
        return packed
