"""Which autopilot is the vehicle, at which address, and whether it is still there.

The configured system id wins where it is heard. Where it is not, exactly one other autopilot heard
within 3 s of the first heartbeat is adopted; of several none is, for a guess would point another
aircraft's camera. After silence everything is judged afresh. In `listen` mode the address of the
adopted autopilot's heartbeat becomes the peer; MAVLink without signing has no stronger proof.

Time is an argument; no socket here.
"""

from __future__ import annotations

from dataclasses import dataclass

from autopilot.adapters.vehicle.heard import Heartbeat, Sender
from autopilot.ports.config import VehicleSection

Address = tuple[str, int]

ADOPTION_NS = 3_000_000_000
CANDIDATES_MAX = 8  # more autopilots on one link than anybody flies


@dataclass(frozen=True, slots=True)
class Vehicle:
    """The adopted autopilot."""

    sender: Sender
    peer: Address


class Presence:
    """Follows the heartbeats of autopilots; `vehicle` is None while none is there."""

    def __init__(self, settings: VehicleSection) -> None:
        self._configured = settings.system_id
        self._timeout_ns = round(settings.link_timeout_s * 1e9)
        self._candidates: dict[Sender, Address] = {}
        self._decide_ns = 0
        self._heard_ns = 0
        self.vehicle: Vehicle | None = None

    @property
    def system(self) -> int:
        """The system id that this node speaks with: the vehicle's own, configured until it is heard."""
        return self._configured if self.vehicle is None else self.vehicle.sender.system

    def hear(self, now_ns: int, heartbeat: Heartbeat, peer: Address) -> None:
        """Note a heartbeat; it may make its sender the vehicle."""
        if self.vehicle is not None:
            if self.vehicle == Vehicle(heartbeat.sender, peer):
                self._heard_ns = now_ns
            return
        if not self._candidates:
            self._decide_ns = now_ns + ADOPTION_NS
        if len(self._candidates) < CANDIDATES_MAX:
            self._candidates.setdefault(heartbeat.sender, peer)
        if heartbeat.sender.system == self._configured:
            self._adopt(now_ns, Vehicle(heartbeat.sender, peer))

    def tick(self, now_ns: int) -> None:
        """Adopt the only one heard when the time for it has come; let go of one that fell silent."""
        if self.vehicle is not None:
            if now_ns >= self._heard_ns + self._timeout_ns:
                self.vehicle = None
        elif self._candidates and now_ns >= self._decide_ns:
            (sender, peer), *others = self._candidates.items()
            self._candidates.clear()
            if not others:
                self._adopt(now_ns, Vehicle(sender, peer))

    def due_ns(self) -> int | None:
        """Return when `tick` must be called next, or None."""
        if self.vehicle is not None:
            return self._heard_ns + self._timeout_ns
        return self._decide_ns if self._candidates else None

    def _adopt(self, now_ns: int, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self._heard_ns = now_ns
        self._candidates.clear()
