"""Telemetry into observations: thinned, and measured against what was asked of the gimbal.

What is reported: the autopilot's state when it changed; a position each `position_period_s`, once
places can be made; the gimbal when it moved by more than `gimbal_threshold_deg`, when its error
crossed the tolerance of arrival, when another pointing is measured against, and once after each
accepted pointing (so that one which was there already is seen to have arrived).

What GIMBAL_DEVICE_ATTITUDE_STATUS says is a measurement only where the gimbal measures. A servo
mount under ArduPilot reports what its servos were told, and mixes the vehicle's tilt into it;
"arrived" then means "commanded there".

State and link reports are made by `session`; nothing here sends anything.
"""

from __future__ import annotations

from collections.abc import Callable

from google.protobuf.message import Message

from autopilot.adapters.vehicle.heard import Attitude, GimbalAttitude, Position, Sender
from autopilot.adapters.vehicle.pointing import Direction, angle_between, direction_to
from autopilot.adapters.vehicle.poses import Poses, VehicleTime, Whereabouts
from autopilot.ports.config import VehicleSection
from events.schema.common_pb2 import Place
from events.schema.vehicle_pb2 import GimbalReported, PointAtAngles, PointAtPlace, PositionReported

MakePlace = Callable[[float, float, float], Place | None]
SENDERS_MAX = 8  # components of one vehicle with clocks of their own


class Pointing:
    """What is asked of the gimbal now, and the view that would fulfil it."""

    def __init__(self) -> None:
        self.effect_seq = 0
        self.effect: Message | None = None

    def ask(self, effect_seq: int, effect: Message) -> None:
        """Measure against this effect from now on; a release asks for nothing."""
        self.effect_seq, self.effect = effect_seq, effect

    def drop(self, effect_seq: int) -> None:
        """The vehicle refused it: nothing is asked."""
        if self.effect_seq == effect_seq:
            self.effect = None

    def expected(self, vehicle: Whereabouts) -> Direction | None:
        """Return the view that is asked for, or None."""
        if isinstance(self.effect, PointAtPlace):
            place = self.effect.place
            to = (place.latitude_e7 / 1e7, place.longitude_e7 / 1e7, place.altitude_mm / 1000)
            return direction_to((vehicle.latitude_deg, vehicle.longitude_deg, vehicle.altitude_m), to)
        if isinstance(self.effect, PointAtAngles):
            nose_deg = 0.0 if self.effect.yaw_locked else vehicle.yaw_deg
            return Direction(self.effect.pitch_cdeg / 100, self.effect.yaw_cdeg / 100 + nose_deg)
        return None


class Telemetry:
    """Buffers for `pose_at`, and the thinned observations; one vehicle, one gimbal."""

    def __init__(self, settings: VehicleSection, place: MakePlace, arrival_tolerance_deg: float) -> None:
        self._period_ns = round(settings.position_period_s * 1e9)
        self._threshold_deg = settings.gimbal_threshold_deg
        self._tolerance_deg = arrival_tolerance_deg
        self._place = place
        self._times: dict[Sender, VehicleTime] = {}
        self._position_ns: int | None = None
        self._reported: tuple[Direction, int, bool] | None = None  # view, effect measured against, arrived
        self.poses = Poses()
        self.pointing = Pointing()

    def say_again(self) -> None:
        """Report the gimbal with its next message, moved or not."""
        self._reported = None

    def position(self, now_ns: int, heard: Position) -> PositionReported | None:
        """Buffer a position; return it when it is time to report one."""
        at_ns = self._stamp(now_ns, heard.sender, heard.boot_ms)
        self.poses.add_position(at_ns, heard)
        if self._position_ns is not None and at_ns < self._position_ns + self._period_ns:
            return None
        place = self._place(heard.latitude_e7 / 1e7, heard.longitude_e7 / 1e7, heard.altitude_mm / 1000)
        if place is None:
            return None
        self._position_ns = at_ns
        return PositionReported(vehicle=1, place=place, height_mm=heard.height_mm, heading_cdeg=heard.heading_cdeg)

    def attitude(self, now_ns: int, heard: Attitude) -> None:
        """Buffer an attitude."""
        self.poses.add_attitude(self._stamp(now_ns, heard.sender, heard.boot_ms), heard)

    def view(self, now_ns: int, heard: GimbalAttitude) -> GimbalReported | None:
        """Buffer a view; return it when it is news."""
        at_ns = self._stamp(now_ns, heard.sender, heard.boot_ms)
        self.poses.add_view(at_ns, heard)
        angles, vehicle = self.poses.view_at(at_ns), self.poses.vehicle_at(at_ns)
        if angles is None:
            return None
        view = Direction(*angles)
        expected = None if vehicle is None else self.pointing.expected(vehicle)
        error_deg = None if expected is None else angle_between(view, expected)
        return self._news(view, error_deg)

    def _news(self, view: Direction, error_deg: float | None) -> GimbalReported | None:
        effect_seq = -1 if error_deg is None else self.pointing.effect_seq
        arrived = error_deg is not None and error_deg <= self._tolerance_deg
        if self._reported is not None:
            before, *rest = self._reported
            if rest == [effect_seq, arrived] and angle_between(view, before) <= self._threshold_deg:
                return None
        self._reported = (view, effect_seq, arrived)
        return GimbalReported(
            vehicle=1,
            gimbal=1,
            pitch_cdeg=round(view.pitch_deg * 100),
            yaw_cdeg=round(view.yaw_deg * 100) % 36_000,
            effect_seq=None if error_deg is None else effect_seq,
            error_cdeg=None if error_deg is None else round(error_deg * 100),
        )

    def _stamp(self, now_ns: int, sender: Sender, boot_ms: int) -> int:
        """Each component counts from its own boot."""
        if sender not in self._times and len(self._times) >= SENDERS_MAX:
            self._times.clear()
        return self._times.setdefault(sender, VehicleTime()).stamp(now_ns, boot_ms)
