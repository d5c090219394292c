"""A `Session` in the world: a transport, a timer, signatures, files, and observations kept until the node takes them.

All protocol is in `session`; this reads the only clock of the adapter, decodes nothing and decides nothing. It hears
and keeps time on one asyncio loop; an effect is performed on the thread that brings it, for a change of threads costs
an order more than the encoding. One lock holds the session together. Every frame that comes passes `_admit` before
anything of it is read: the signature is judged there, and what is admitted, and what is sent, goes to the raw files.
"""

from __future__ import annotations

import asyncio
import threading
from collections import Counter, deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

from google.protobuf.message import Message

from autopilot.adapters.vehicle.heard import GimbalLimits
from autopilot.adapters.vehicle.presence import Address
from autopilot.adapters.vehicle.rawlog import RawLog
from autopilot.adapters.vehicle.session import Report, Session, Transmit
from autopilot.adapters.vehicle.signing import Signing, SigningKeyError, open_signing
from autopilot.adapters.vehicle.transport import Transport, open_transport
from autopilot.ports.config import VehicleSection
from autopilot.ports.edges import Clock, InputClass, Offer, Pose, VehicleFacts
from autopilot.trust.freshness import known_time
from events.schema.common_pb2 import Place

OFFER_AGAIN_NS = 50_000_000
NOT_KEPT = "signing time not kept"


class VehicleLink:
    """Performs effects of pointing and of the flight over MAVLink 2 and reports what the vehicle says.

    `place` makes a Place of latitude, longitude (degrees) and altitude (m AMSL), or returns None
    before the origin is set. `on_first_fix` is called once, on the loop, with the first 3D fix, so that
    the node can set the origin; `on_time` with each time that the vehicle tells, ms since 1970. While
    `healthy` is False no heartbeat leaves. Observations about effects, state and link are OUTCOME and
    offered until taken; position and gimbal are TELEMETRY. `perform` may be called from any thread, and what is asked
    of it too; everything else runs on the loop that `start` ran on.
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
        on_time: Callable[[int], None],
        arrival_tolerance_deg: float = 1.0,
        drift_deg: float = 2.0,
    ) -> None:
        self._settings = settings
        self._offer = offer
        self._clock = clock
        self._make: Callable[[Address | None], Session] = lambda peer: Session(
            settings,
            place,
            on_first_fix,
            healthy,
            arrival_tolerance_deg=arrival_tolerance_deg,
            drift_deg=drift_deg,
            peer=peer,
            on_time=on_time,
            admit=self._admit,
        )
        self._session = self._make(None)
        self._lock = threading.Lock()  # over the session and all that is worked off of it; nobody waits under it
        self._asyncio_loop: asyncio.AbstractEventLoop | None = None
        self._kept: deque[Message] = deque()  # outcomes that the inbox refused, oldest first
        self._counts: Counter[str] = Counter()
        self._raw = RawLog(settings, offer, clock, self._counts) if settings.raw else None
        self._signing: Signing | None = None
        self._keeping: asyncio.Task[None] | None = None
        self._transport: Transport | None = None
        self._timer: asyncio.TimerHandle | None = None

    @property
    def rejected(self) -> Mapping[str, int]:
        """How often something that arrived was not taken, or something was not done, by reason."""
        with self._lock:
            return self._session.rejected + self._counts

    @property
    def limits(self) -> GimbalLimits | None:
        """How far the gimbal turns, once it told."""
        with self._lock:
            return self._session.limits

    def facts(self) -> VehicleFacts:
        """Return what is known of the vehicle now, for the self-test."""
        with self._lock:
            return self._session.reports.facts(self._clock.mono_ns())

    @property
    def address(self) -> Address | None:
        """Own address, once started."""
        return None if self._transport is None else self._transport.own

    @property
    def raw_stopped(self) -> str:
        """Why the link is not recorded in files; "" while it is, or is not to be."""
        return "" if self._raw is None else self._raw.stopped

    def record_in(self, flight: Path) -> None:
        """Write raw files in the folder of this flight from now on. From any thread."""
        if self._raw is not None:
            self._raw.record_in(flight)

    async def start(self) -> None:
        """Open the way to the vehicle and speak up.

        Raises ValueError where `[vehicle]` names no usable address or key, OSError where it can't be opened.
        """
        if self._settings.signing == "required":
            self._signing = await asyncio.to_thread(self._ready_to_sign)
        transport = await open_transport(self._settings, self.hear, self._counts)
        with self._lock:
            self._asyncio_loop = asyncio.get_running_loop()
            self._transport, self._session = transport, self._make(transport.peer)
        if self._raw is not None:
            self._raw.start()
        self._turn()

    async def stop(self) -> None:
        """Close the way to the vehicle, and the files. Effects that still wait for an answer stay without one."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        with self._lock:
            transport, self._transport = self._transport, None
        if transport is not None:
            transport.close()
        if self._keeping is not None:
            await self._keeping
        if self._raw is not None:
            await asyncio.to_thread(self._raw.stop)

    def perform(self, seq: int, effect: Message, recorded_mono_ns: int) -> None:
        """Perform the effect of record `seq`; its life counts from `recorded_mono_ns`.

        What may leave now has left when this returns; when the next thing is due, the loop works out.
        """
        deadline_ns = recorded_mono_ns + int(getattr(effect, "life_ms", 0)) * 1_000_000
        with self._lock:
            self._session.perform(self._clock.mono_ns(), seq, effect, deadline_ns)
            self._work_off()
            asyncio_loop = self._asyncio_loop
        if asyncio_loop is not None:
            with suppress(RuntimeError):  # a loop that is closed has nothing left to do
                asyncio_loop.call_soon_threadsafe(self._turn)

    def pose_at(self, mono_ns: int) -> Pose | None:
        """Return the camera's pose at a moment, or None where it is not known."""
        with self._lock:
            return self._session.telemetry.poses.pose_at(mono_ns)

    def hear(self, peer: Address, data: bytes) -> None:
        """Take a datagram, or a frame of a stream."""
        with self._lock:
            self._session.hear(self._clock.mono_ns(), peer, data)
        self._turn()

    def _admit(self, frame: bytes) -> str:
        """Judge a whole frame; what is taken is also written down."""
        refusal = "" if self._signing is None else self._signing.admit(frame)
        if not refusal and self._raw is not None:
            self._raw.note(frame)
        return refusal

    def _turn(self) -> None:
        """Work off what is due and what the session wants, then sleep until the next thing."""
        with self._lock:
            now_ns = self._clock.mono_ns()
            self._session.tick(now_ns)
            self._work_off()
            self._keep_signing_time()
            self._sleep(now_ns)

    def _work_off(self) -> None:
        """Send and offer what the session wants. Under the lock."""
        while outputs := self._session.take():
            for output in outputs:
                if isinstance(output, Report):
                    self._report(output)
                elif self._send(output) and output.effect_seq is not None:
                    self._session.sent(output.effect_seq)
        self._offer_kept()

    def _send(self, output: Transmit) -> bool:
        """Return whether the bytes left."""
        if self._transport is None:
            return False
        data = output.data if self._signing is None else self._signing.sign(output.data)
        left = self._transport.write(data, output.peer)
        if left and self._raw is not None:
            self._raw.note(output.data)
        return left

    def _ready_to_sign(self) -> Signing:
        """Read the key and the times that were sent before. Raises ValueError, for without them nothing may start."""
        try:
            path = Path(self._settings.signing_key_file)
            return open_signing(path, lambda: known_time(self._clock).earliest_ms)
        except SigningKeyError as error:
            raise ValueError(f"[vehicle] signing_key_file: {error}") from error

    def _keep_signing_time(self) -> None:
        """Keep the time ahead of what is sent, beside the loop: the disk may stall."""
        if self._signing is None or self._transport is None or (self._keeping and not self._keeping.done()):
            return
        if (times := self._signing.to_keep()) is not None:
            self._keeping = asyncio.get_running_loop().create_task(self._keep(self._signing, times))

    async def _keep(self, signing: Signing, times: tuple[int, int]) -> None:
        try:
            await asyncio.to_thread(signing.kept.write, *times)
        except OSError:
            self._counts[NOT_KEPT] += 1

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
