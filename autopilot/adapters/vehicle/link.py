"""UDP around a `Session`: a socket, a timer, and observations that are kept until the node takes them.

All protocol is in `session`; this holds the only socket of the adapter and the only clock reading.
It decodes nothing and decides nothing. It lives on one asyncio loop.
"""

from __future__ import annotations

import asyncio
import socket
from collections import deque
from collections.abc import Callable, Mapping

from google.protobuf.message import Message

from autopilot.adapters.vehicle.heard import GimbalLimits
from autopilot.adapters.vehicle.presence import Address
from autopilot.adapters.vehicle.session import Report, Session, Transmit
from autopilot.adapters.vehicle.telemetry import MakePlace
from autopilot.ports.config import VehicleSection
from autopilot.ports.edges import Clock, InputClass, Offer, Pose, VehicleFacts
from events.schema.common_pb2 import Place

OFFER_AGAIN_NS = 50_000_000


class VehicleLink(asyncio.DatagramProtocol):
    """Performs effects of pointing and of the flight over MAVLink 2 and reports what the vehicle says.

    `place` makes a Place of latitude, longitude (degrees) and altitude (m AMSL), or returns None
    before the origin is set. `on_first_fix` is called once, on the loop, with the first 3D fix, so that
    the node can set the origin. While `healthy` is False no heartbeat leaves. Observations about
    effects, state and link are OUTCOME and offered until taken; position and gimbal are TELEMETRY.
    Everything runs on the loop that `start` ran on.
    """

    def __init__(
        self,
        settings: VehicleSection,
        offer: Offer,
        clock: Clock,
        place: Callable[[float, float, float], Place | None],
        on_first_fix: Callable[[float, float, float], None],
        healthy: Callable[[], bool],
        *,
        arrival_tolerance_deg: float = 1.0,
        drift_deg: float = 2.0,
    ) -> None:
        self._settings = settings
        self._offer = offer
        self._clock = clock
        self._make: Callable[[Address | None], Session] = lambda peer: _session(
            settings, place, on_first_fix, healthy, (arrival_tolerance_deg, drift_deg), peer
        )
        self._session = self._make(None)
        self._kept: deque[Message] = deque()  # outcomes that the inbox refused, oldest first
        self._transport: asyncio.DatagramTransport | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._failures = 0

    @property
    def rejected(self) -> Mapping[str, int]:
        """How often something that arrived was not taken, by reason."""
        return self._session.rejected

    @property
    def limits(self) -> GimbalLimits | None:
        """How far the gimbal turns, once it told."""
        return self._session.limits

    def facts(self) -> VehicleFacts:
        """Return what is known of the vehicle now, for the self-test. On the loop."""
        return self._session.reports.facts(self._clock.mono_ns())

    @property
    def address(self) -> Address | None:
        """Own address, once started."""
        if self._transport is None:
            return None
        host, port = self._transport.get_extra_info("sockname")[:2]
        return host, port

    async def start(self) -> None:
        """Open the socket and speak up.

        Raises ValueError where `[vehicle]` names no usable address, OSError where it can't be opened.
        """
        loop = asyncio.get_running_loop()
        peer = None
        if self._settings.connect:
            family, peer = await _resolve("connect", self._settings.connect)
            own: Address = ("::" if family == socket.AF_INET6 else "0.0.0.0", 0)
            self._session = self._make(peer)
        else:
            family, own = await _resolve("listen", self._settings.listen)
        transport, _ = await loop.create_datagram_endpoint(lambda: self, local_addr=own, family=family)
        self._transport = transport
        self._turn()

    async def stop(self) -> None:
        """Close the socket. Effects that still wait for an answer stay without one."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._transport is not None:
            self._transport.close()
            self._transport = None

    def perform(self, seq: int, effect: Message, recorded_mono_ns: int) -> None:
        """Perform the effect of record `seq`; its life counts from `recorded_mono_ns`."""
        deadline_ns = recorded_mono_ns + int(getattr(effect, "life_ms", 0)) * 1_000_000
        self._session.perform(self._clock.mono_ns(), seq, effect, deadline_ns)
        self._turn()

    def pose_at(self, mono_ns: int) -> Pose | None:
        """Return the camera's pose at a moment, or None where it is not known."""
        return self._session.telemetry.poses.pose_at(mono_ns)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """Take a datagram (called by asyncio)."""
        self._session.hear(self._clock.mono_ns(), (addr[0], addr[1]), data)
        self._turn()

    def error_received(self, exc: Exception) -> None:
        """Count a send that the network refused, or an ICMP error (called by asyncio)."""
        del exc
        self._failures += 1

    def _turn(self) -> None:
        """Work off what is due and what the session wants, then sleep until the next thing."""
        now_ns = self._clock.mono_ns()
        self._session.tick(now_ns)
        while outputs := self._session.take():
            for output in outputs:
                if isinstance(output, Report):
                    self._report(output)
                elif self._send(output) and output.effect_seq is not None:
                    self._session.sent(output.effect_seq)
        self._offer_kept()
        self._sleep(now_ns)

    def _send(self, output: Transmit) -> bool:
        """Return whether the bytes left. asyncio tells of a failure by calling `error_received` meanwhile."""
        if self._transport is None:
            return False
        before = self._failures
        self._transport.sendto(output.data, output.peer)
        return self._failures == before

    def _report(self, report: Report) -> None:
        if report.input_class is InputClass.OUTCOME:
            self._kept.append(report.observation)
        else:
            self._offer(report.input_class, report.observation)

    def _offer_kept(self) -> None:
        """Offer outcomes in their order until one is refused."""
        while self._kept and self._offer(InputClass.OUTCOME, self._kept[0]):
            self._kept.popleft()

    def _sleep(self, now_ns: int) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._transport is None:
            return
        due_ns = self._session.due_ns()
        if self._kept:
            due_ns = min(due_ns, now_ns + OFFER_AGAIN_NS)
        delay_s = max(0, due_ns - now_ns) / 1e9
        self._timer = asyncio.get_running_loop().call_later(delay_s, self._turn)


def _session(
    settings: VehicleSection,
    place: MakePlace,
    on_first_fix: Callable[[float, float, float], None],
    healthy: Callable[[], bool],
    bounds_deg: tuple[float, float],
    peer: Address | None,
) -> Session:
    tolerance_deg, drift_deg = bounds_deg
    return Session(
        settings, place, on_first_fix, healthy, arrival_tolerance_deg=tolerance_deg, drift_deg=drift_deg, peer=peer
    )


async def _resolve(key: str, text: str) -> tuple[int, Address]:
    """Return family and address of host:port; raises ValueError with the key and what it should look like."""
    host, colon, port = text.rpartition(":")
    if not colon or not host or not port.isdecimal() or int(port) > 65535:
        raise ValueError(f'[vehicle] {key} = "{text}": write host:port, e.g. "127.0.0.1:14550"')
    loop = asyncio.get_running_loop()
    try:
        found = await loop.getaddrinfo(host.strip("[]"), int(port), type=socket.SOCK_DGRAM)
    except socket.gaierror as error:
        raise ValueError(f'[vehicle] {key} = "{text}": {host} is not known here ({error.strerror})') from error
    family, _, _, _, address = found[0]
    return family, (str(address[0]), int(address[1]))
