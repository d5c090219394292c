"""Telemetry into observations: thinned, and measured against what was asked of the gimbal.

What is reported: the autopilot's state when it changed; a position, once places can be made, when it
moved by more than `position_threshold_m` or turned by more than `heading_threshold_deg`, while armed
also when it did neither (a fence may be crept over), at most each `position_period_s`; the gimbal when
it moved by more than `gimbal_threshold_deg`, when its error crossed the tolerance of arrival, when
another pointing is measured against, and once after each accepted pointing (so that one which was there
already is seen to have arrived). What stands still is said again each `say_again_s`, and everything is
said in full at the start and when the vehicle came back.

What GIMBAL_DEVICE_ATTITUDE_STATUS says is a measurement only where the gimbal measures. A servo
mount under ArduPilot reports what its servos were told, and mixes the vehicle's tilt into it; such
a report says so (`demanded`), and "arrived" then means "commanded there". That an error crossed the
angle from which a gimbal that had arrived has drifted is news as well.

State and link reports are made by `session`; nothing here sends anything.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from google.protobuf.message import Message

from autopilot.adapters.vehicle.heard import Attitude, GimbalAttitude, Position, Sender
from autopilot.adapters.vehicle.pointing import Direction, angle_between, direction_to, wrapped
from autopilot.adapters.vehicle.poses import Poses, VehicleTime, Whereabouts
from autopilot.ports.config import VehicleSection
from events.schema.common_pb2 import Place
from events.schema.vehicle_pb2 import GimbalReported, PointAtAngles, PointAtPlace, PositionReported, ReleasePointing

MakePlace = Callable[[float, float, float], Place | None]
M_PER_E7 = 0.011132  # metres of a meridian in 1e-7 degrees: near enough for a deadband
SENDERS_MAX = 8  # components of one vehicle with clocks of their own


class Pointing:
    """What is asked of the gimbal now, and the view that would fulfil it."""

    def __init__(self) -> None:
        self.effect_seq = 0
        self.effect: Message | None = None

    def ask(self, effect_seq: int, effect: Message) -> None:
        """Measure against this effect from now on; a release asks for nothing, what does not point changes nothing."""
        if isinstance(effect, PointAtPlace | PointAtAngles | ReleasePointing):
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

    def __init__(
        self, settings: VehicleSection, place: MakePlace, arrival_tolerance_deg: float, drift_deg: float
    ) -> None:
        self._period_ns = round(settings.position_period_s * 1e9)
        self._again_ns = round(settings.say_again_s * 1e9)
        self._settings = settings
        # As the core has them: both see the same arrival, and the same drift.
        self._bounds_cdeg = round(arrival_tolerance_deg * 100), round(drift_deg * 100)
        self._place = place
        self._times: dict[Sender, VehicleTime] = {}
        self._position: tuple[int, Position] | None = None  # when and what was reported
        # View, effect measured against, how many bounds the error is over, whether it is a demand.
        self._reported: tuple[Direction, int, int, bool] | None = None
        self._reported_ns = 0
        self.poses = Poses()
        self.pointing = Pointing()

    def say_again(self) -> None:
        """Report the gimbal with its next message, moved or not."""
        self._reported = None

    def begin(self) -> None:
        """Report everything with its next message: the vehicle is there, or there again."""
        self._position = self._reported = None

    def position(self, now_ns: int, heard: Position, *, armed: bool) -> PositionReported | None:
        """Buffer a position; return it when it is time to report one."""
        at_ns = self._stamp(now_ns, heard.sender, heard.boot_ms)
        self.poses.add_position(at_ns, heard)
        if not self._moved(at_ns, heard, armed=armed):
            return None
        place = self._place(heard.latitude_e7 / 1e7, heard.longitude_e7 / 1e7, heard.altitude_mm / 1000)
        if place is None:
            return None
        self._position = at_ns, heard
        return PositionReported(
            vehicle=1,
            place=place,
            height_mm=heard.height_mm,
            heading_cdeg=heard.heading_cdeg,
            east_mm_s=heard.east_cm_s * 10,
            north_mm_s=heard.north_cm_s * 10,
            up_mm_s=-heard.down_cm_s * 10,
        )

    def _moved(self, at_ns: int, heard: Position, *, armed: bool) -> bool:
        """Whether a position is to be reported: it is another than the last one, or that was long ago."""
        if self._position is None:
            return True
        before_ns, before = self._position
        since_ns = at_ns - before_ns
        if not self._period_ns <= since_ns < self._again_ns:
            return since_ns >= self._again_ns
        if armed:
            return True
        north_m = (heard.latitude_e7 - before.latitude_e7) * M_PER_E7
        across = math.cos(math.radians(heard.latitude_e7 / 1e7))
        east_m = wrapped((heard.longitude_e7 - before.longitude_e7) / 1e7) * 1e7 * M_PER_E7 * across
        up_m = (heard.altitude_mm - before.altitude_mm) / 1000
        if math.hypot(north_m, east_m, up_m) > self._settings.position_threshold_m:
            return True
        if heard.heading_cdeg is None or before.heading_cdeg is None:
            return heard.heading_cdeg != before.heading_cdeg
        turned_deg = abs(wrapped((heard.heading_cdeg - before.heading_cdeg) / 100))
        return turned_deg > self._settings.heading_threshold_deg

    def attitude(self, now_ns: int, heard: Attitude) -> None:
        """Buffer an attitude."""
        self.poses.add_attitude(self._stamp(now_ns, heard.sender, heard.boot_ms), heard)

    def view(self, now_ns: int, heard: GimbalAttitude, *, demanded: bool = False) -> GimbalReported | None:
        """Buffer a view, which may be what was demanded of servos; return it when it is news."""
        at_ns = self._stamp(now_ns, heard.sender, heard.boot_ms)
        self.poses.add_view(at_ns, heard)
        angles, vehicle = self.poses.view_at(at_ns), self.poses.vehicle_at(at_ns)
        if angles is None:
            return None
        view = Direction(*angles)
        expected = None if vehicle is None else self.pointing.expected(vehicle)
        error_deg = None if expected is None else angle_between(view, expected)
        return self._news(at_ns, view, None if error_deg is None else round(error_deg * 100), demanded)

    def _news(self, at_ns: int, view: Direction, error_cdeg: int | None, demanded: bool) -> GimbalReported | None:
        effect_seq = -1 if error_cdeg is None else self.pointing.effect_seq
        over = sum(error_cdeg is None or error_cdeg > bound_cdeg for bound_cdeg in self._bounds_cdeg)
        if self._reported is not None and at_ns < self._reported_ns + self._again_ns:
            before, *rest = self._reported
            still = angle_between(view, before) <= self._settings.gimbal_threshold_deg
            if still and rest == [effect_seq, over, demanded]:
                return None
        self._reported, self._reported_ns = (view, effect_seq, over, demanded), at_ns
        return GimbalReported(
            vehicle=1,
            gimbal=1,
            pitch_cdeg=round(view.pitch_deg * 100),
            yaw_cdeg=round(view.yaw_deg * 100) % 36_000,
            effect_seq=None if error_cdeg is None else effect_seq,
            error_cdeg=error_cdeg,
            demanded=True if demanded else None,
        )

    def _stamp(self, now_ns: int, sender: Sender, boot_ms: int) -> int:
        """Each component counts from its own boot."""
        if sender not in self._times and len(self._times) >= SENDERS_MAX:
            self._times.clear()
        return self._times.setdefault(sender, VehicleTime()).stamp(now_ns, boot_ms)
