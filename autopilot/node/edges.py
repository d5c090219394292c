"""The adapters of one daemon: made from the configuration, started and stopped together.

It knows which adapter needs what of which other (the eyes need the vehicle's pose, all need the origin), so that no
adapter has to know another.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from autopilot.adapters.eyes import Eyes
from autopilot.adapters.mesh import MeshAdapter, TrustFolder
from autopilot.adapters.vehicle import VehicleLink
from autopilot.geo import LocalFrame, Origin
from autopilot.node.attachments import Attachments
from autopilot.node.flights import Session
from autopilot.node.inbox import Inbox
from autopilot.node.selftest import Selftest
from autopilot.node.trusting import Believed, believed, ear_for_gps
from autopilot.ports.config import Config
from autopilot.ports.edges import Clock, CosignatureJudge, InputClass, Performer, Proving
from autopilot.trust.book import TrustBook
from autopilot.trust.identity import Identity
from events.records import Record
from events.schema.common_pb2 import Place
from events.schema.flight_pb2 import OriginSet

if TYPE_CHECKING:  # planning is heavy, and only a node with a mission pays for it
    from autopilot.adapters.missions import MissionsAdapter

NS_PER_MS = 1_000_000
OFFER_AGAIN_S = 0.05


@dataclass(frozen=True, slots=True)
class Edges:
    """The adapters that the configuration asks for; None for those that it does not."""

    mesh: MeshAdapter | None
    vehicle: VehicleLink | None
    eyes: Eyes
    documents: TrustFolder | None = None
    missions: MissionsAdapter | None = None
    selftest: Selftest | None = None

    async def start(self) -> None:
        """Start them; none waits for its peer. Raises ValueError and OSError for an address that can't be used."""
        if self.vehicle is not None:
            await self.vehicle.start()
        if self.mesh is not None:
            self.mesh.start()
        if self.documents is not None:
            self.documents.start()
        await self.eyes.start()

    def record_in(self, flight: Path) -> None:
        """Tell them whose folder raw data belongs into from now on. From any thread."""
        if self.vehicle is not None:
            self.vehicle.record_in(flight)

    async def stop(self) -> None:
        """Stop them: first what brings work, last what answers."""
        await self.eyes.stop()
        if self.missions is not None:
            await self.missions.stop()
        if self.vehicle is not None:
            await self.vehicle.stop()
        if self.mesh is not None:
            await asyncio.to_thread(self.mesh.stop)
        if self.documents is not None:
            await asyncio.to_thread(self.documents.stop)

    def perform(self, record: Record) -> None:
        """Give an effect to the performer of its port. Effects of a port that is not there come to nothing."""
        performers: dict[str, Performer | None] = {
            "mesh": self.mesh,
            "vehicle": self.vehicle,
            "missions": self.missions,
            "selftest": self.selftest,
        }
        performer = performers.get(record.kind.port)
        if performer is not None:
            performer.perform(record.seq, record.message, record.at.mono_ns)


def make_edges(
    config: Config,
    identity: Identity,
    clock: Clock,
    inbox: Inbox,
    origin: Origin,
    healthy: Callable[[], bool],
    proving: Proving | None = None,
    judge: CosignatureJudge | None = None,
    book: TrustBook | None = None,
    attachments: Attachments | None = None,
) -> Edges:
    """Make the adapters; nothing starts yet."""
    mesh = vehicle = None
    if config.mesh.connect or config.mesh.listen:
        mesh = MeshAdapter(
            config.mesh,
            identity,
            clock,
            origin.place_e7,
            inbox.offer,
            proving=proving,
            judge=judge,
            book=book,
            attending=(*config.command.camera_roles, *config.command.flight_roles),
        )
    if config.vehicle.connect or config.vehicle.listen:
        vehicle = VehicleLink(
            config.vehicle,
            inbox.offer,
            clock,
            origin.place,
            lambda latitude, longitude, altitude: set_origin(
                origin, inbox, (latitude, longitude, altitude), "first fix"
            ),
            healthy,
            on_time=ear_for_gps(clock),
            arrival_tolerance_deg=config.limits.arrival_tolerance_deg,
            drift_deg=config.limits.drift_deg,
        )
    eyes = Eyes(
        config.eyes,
        inbox.offer,
        clock,
        origin,
        vehicle,
        groups=config.find.groups,
        room=lambda: inbox.has_room(InputClass.FRAME),
    )
    watched = config.node.documents
    documents = TrustFolder(Path(watched), book.offer) if watched and book is not None else None
    missions = _missions(config, inbox, origin, attachments or Attachments(), vehicle)
    return Edges(mesh, vehicle, eyes, documents, missions, _selftest(config, inbox, clock, book, vehicle, eyes))


def _selftest(
    config: Config, inbox: Inbox, clock: Clock, book: TrustBook | None, vehicle: VehicleLink | None, eyes: Eyes
) -> Selftest | None:
    """Return what looks at everything before a mission; None where none is flown."""
    if book is None or not config.mission.enabled:
        return None
    facts = None if vehicle is None else vehicle.facts
    return Selftest(config, clock, book, inbox.offer, facts, eyes.facts)


def _missions(
    config: Config, inbox: Inbox, origin: Origin, attachments: Attachments, vehicle: VehicleLink | None
) -> MissionsAdapter | None:
    """Return the adapter of the mission office; None where no mission is configured."""
    if not (config.mission.url or config.mission.file):
        return None
    from autopilot.adapters.missions import Home, MissionsAdapter

    def home() -> Home | None:
        found = home_of(vehicle, origin)
        return None if found is None else Home(*found)

    return MissionsAdapter(
        config.mission,
        inbox.offer,
        origin.place_e7,
        home,
        attachments.keep,
        config.eyes.field_of_view_deg,
        flight=lambda: attachments.folder,
    )


def home_of(vehicle: VehicleLink | None, origin: Origin) -> tuple[float, float, float] | None:
    """Return where the vehicle says that its home is: degrees, metres above mean sea level; None until it says so.

    The origin of the frame is no home: it may be configured, or of a flight from elsewhere. It is one where
    nothing flies.
    """
    if vehicle is not None:
        return vehicle.facts().home
    frame = origin.frame
    return None if frame is None else (frame.latitude_deg, frame.longitude_deg, frame.altitude_m)


@dataclass(frozen=True, slots=True)
class Remembered:
    """What adapters need to know of a log when they start; read on the thread that owns the state."""

    origin: Place | None
    window: tuple[tuple[bytes, bytes, int], ...]  # device key id, nonce, milliseconds to remember it
    believed: Believed


def remembered(session: Session) -> Remembered:
    """Read it. On the node's thread."""
    state, now_ns = session.state, session.clock.peek_ns()
    known = state.origin.value
    window = tuple(
        (device, nonce, (until_ns - now_ns) // NS_PER_MS + 1) for (device, nonce), until_ns in state.nonces.items()
    )
    return Remembered(None if known is None else known.place, window, believed(session))


def resume(
    config: Config, memory: Remembered, edges: Edges, inbox: Inbox, origin: Origin, *, whole: bool = True
) -> None:
    """Give the adapters what the log remembers: the origin, and the replay window of the gate.

    `whole` says whether it remembers all, or a part of the log is lost.
    """
    place = memory.origin
    if place is not None:
        origin.set(place.latitude_e7 / 1e7, place.longitude_e7 / 1e7, place.altitude_mm / 1000)
    elif (configured := _configured_origin(config)) is not None:
        set_origin(origin, inbox, configured, "configured")
    if edges.mesh is not None:
        edges.mesh.restore_window(memory.window, whole=whole)


def set_origin(origin: Origin, inbox: Inbox, position: tuple[float, float, float], source: str) -> None:
    """Record the origin of the local frame and then use it; only the first time counts. On the asyncio loop.

    While the inbox has no room nothing has a place: a place whose origin the log does not know means nothing.
    """
    if origin.frame is not None:
        return
    place = LocalFrame(*position).place(*position)
    if inbox.offer(InputClass.OUTCOME, OriginSet(place=place, source=source)):
        origin.set(*position)
    else:
        again = asyncio.get_running_loop()
        again.call_later(OFFER_AGAIN_S, lambda: set_origin(origin, inbox, position, source))


def _configured_origin(config: Config) -> tuple[float, float, float] | None:
    pose = config.eyes.pose
    if config.flight.origin is None and pose is not None:
        return pose.latitude_deg, pose.longitude_deg, pose.altitude_m
    return config.flight.origin
