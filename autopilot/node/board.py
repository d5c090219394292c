"""The board: what the node says of itself, folded on the node's thread and read on the asyncio loop.

The fold is `projections.status`; here it is only kept up, handed across threads as one frozen value, and put into
the words of the wire. What the status says beyond the log (the replay window's challenge, drops since the start) is
added by whoever publishes it.
"""

from __future__ import annotations

import asyncio
import sys
import traceback
from collections.abc import Callable

from autopilot.node.board_mission import say_mission
from autopilot.node.flights import Session
from autopilot.trust.verdict import Sealed
from events.records import Record
from events.schema.flight_pb2 import CheckpointCosigned
from events.schema.waypoint_pb2 import CameraStatus, NodeStatus, PoiStatus
from projections import status
from projections.picture import CameraPicture, GimbalPicture, Picture, Question

NS_PER_MS = 1_000_000


class Board:
    """The newest status and the open session."""

    def __init__(self, wall_ms: Callable[[], int]) -> None:
        self._wall_ms = wall_ms
        self._status = status.Status()
        self._session: Session | None = None
        self.disk_short = ""  # what stands in the way of more free space; "" while there is enough
        self._changed = asyncio.Event()
        self._asyncio_loop: asyncio.AbstractEventLoop | None = None

    @property
    def session(self) -> Session:
        """The open session. Raises LookupError before the loop has opened one: our fault."""
        if self._session is None:
            raise LookupError("no flight is open yet")
        return self._session

    def attend(self, asyncio_loop: asyncio.AbstractEventLoop) -> None:
        """Wake waiters on this loop when something changes."""
        self._asyncio_loop = asyncio_loop

    def follow(self, session: Session) -> None:
        """Take the session that is recorded in from now on. On the node's thread."""
        self._session = session

    def say_short(self, words: str) -> None:
        """Take in what stands in the way of more free space."""
        self.disk_short = words

    @property
    def folded(self) -> status.Status:
        """What is shown, after every record that was heard."""
        return self._status

    def recall(self, shown: status.Status) -> None:
        """Show again what was shown once, instead of hearing everything before. On the node's thread."""
        self._status = shown

    def hear(self, records: tuple[Record, ...]) -> None:
        """Fold durable records. On the node's thread, which must not end because something can't be shown."""
        before, now = self._status, self._status
        try:
            for record in records:
                now = status.apply(now, record)
        except Exception:  # noqa: BLE001 - the record is in the log and was decided on; only the picture lags
            print(f"autopilot: the status can't show a record:\n{traceback.format_exc()}", file=sys.stderr, flush=True)
        self._status = now
        if now.picture is not before.picture and self._asyncio_loop is not None:
            self._asyncio_loop.call_soon_threadsafe(self._changed.set)

    async def changed(self, timeout_s: float) -> None:
        """Wait until something that is shown has changed, at most so long."""
        try:
            # Not wait_for: before Python 3.12 it swallows a cancellation that meets the event, and nobody ends.
            async with asyncio.timeout(timeout_s):
                await self._changed.wait()
        except TimeoutError:
            return
        finally:
            self._changed.clear()

    def judge_cosignature(self, message: Sealed, note: str) -> CheckpointCosigned | str:
        """Judge a cosignature of the open flight's log; see `ports.edges.CosignatureJudge`."""
        sealing = self.session.sealing
        return "no log" if sealing is None else sealing.cosigned.judge(message, note)

    def node_status(self) -> NodeStatus:
        """Return the status in the words of the wire; deadlines as what is left of them."""
        now_ns, picture = self.session.clock.peek_ns(), self._status.picture
        said = NodeStatus(
            at_ms=self._wall_ms(),
            flight_id=picture.flight_id,
            head_seq=max(self._status.head_seq, 0),
            health=picture.health,
            command_enabled=picture.command_enabled,
            camera_roles=picture.camera_roles,
            flight_roles=picture.flight_roles,
            vehicle_link=any(vehicle.link for vehicle in picture.vehicles.values()),
            armed=any(vehicle.armed for vehicle in picture.vehicles.values()),
            cameras=[_camera(camera, picture, now_ns) for camera in picture.cameras.values()],
            pois=[_poi(one, now_ns) for one in picture.waiting.values() if one.state == "surfaced"],
            map_objects=picture.map_objects,
        )
        say_mission(said, picture)
        if self.disk_short:
            said.disk_short = self.disk_short
        if (sealing := self.session.sealing) is not None and sealing.newest:
            said.log_checkpoint, said.log_key = sealing.newest, sealing.certificate
            if (cosigned := sealing.cosigned.newest) is not None:
                said.cosigned_size, said.cosigned_by = cosigned
        for vehicle in picture.vehicles.values():
            if vehicle.latitude_e7 is not None and vehicle.longitude_e7 is not None:
                said.latitude_e7, said.longitude_e7 = vehicle.latitude_e7, vehicle.longitude_e7
                said.height_mm = vehicle.height_mm or 0
        return said


def _camera(camera: CameraPicture, picture: Picture, now_ns: int) -> CameraStatus:
    gimbal = picture.gimbals.get(camera.gimbal) or GimbalPicture()
    said = CameraStatus(
        vehicle=camera.vehicle,
        camera=camera.camera,
        gimbal=int(camera.gimbal.partition("/")[2] or 0),
        state=camera.state,
        callsign=camera.callsign,
        command_id=camera.command_id,
        held_for_ms=_left_ms(camera.held_until_ns, now_ns),
        aim=gimbal.aim,
        asked=gimbal.asked,
    )
    if gimbal.pitch_cdeg is not None and gimbal.yaw_cdeg is not None:
        said.pitch_cdeg, said.yaw_cdeg = gimbal.pitch_cdeg, gimbal.yaw_cdeg
    if gimbal.error_cdeg is not None:
        said.error_cdeg = gimbal.error_cdeg
    if gimbal.arrived_after_ns is not None:
        said.arrived_after_ms = gimbal.arrived_after_ns // NS_PER_MS
    if camera.zoom_e4 is not None:
        said.zoom_e4 = camera.zoom_e4
    _say_of_gimbal(said, gimbal)
    return said


def _say_of_gimbal(said: CameraStatus, gimbal: GimbalPicture) -> None:
    """Say what there is to say; what is absent is no news."""
    if gimbal.aim_because:
        said.aim_because = gimbal.aim_because
    if gimbal.order:
        said.aim_command_id = gimbal.order.rpartition("/")[2]
    if gimbal.demanded:
        said.aim_demanded = True
    if gimbal.control:
        said.gimbal_control = gimbal.control
    if gimbal.caution:
        said.caution = gimbal.caution


def _poi(question: Question, now_ns: int) -> PoiStatus:
    return PoiStatus(
        poi_id=question.poi_id,
        class_name=question.class_name,
        confidence_e4=question.confidence_e4,
        mgrs=question.mgrs,
        latitude_e7=question.latitude_e7,
        longitude_e7=question.longitude_e7,
        decide_within_ms=_left_ms(question.decide_by_ns, now_ns),
        sightings=question.sightings,
    )


def _left_ms(until_ns: int, now_ns: int) -> int:
    return max(until_ns - now_ns, 0) // NS_PER_MS
