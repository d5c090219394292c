"""Where the vehicle was and where the camera looked, at any recent moment: bounded, interpolated.

Messages carry the vehicle's time since boot. `VehicleTime` turns it into this machine's monotonic
time by the smallest delay seen lately, so that a late datagram does not move the aircraft. Between
two samples everything is interpolated, angles the short way round. Beyond the newest sample a
position goes on by its speed for 1 s, a heading by its turn rate for 0.5 s, and a gimbal by what it
did between its last two samples for 0.3 s; one that moves fast is not known there, for nobody
knows where it stops. Where there is no honest answer it is None.

Nothing here knows MAVLink or thins anything.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from autopilot.adapters.vehicle.heard import Attitude, GimbalAttitude, Position
from autopilot.adapters.vehicle.pointing import wrapped
from autopilot.ports.edges import Pose

_S = 1_000_000_000
SAMPLES = 128  # 25 s of positions at 5 Hz, 13 s of attitudes at 10 Hz
GAP_NS = 2 * _S  # between samples farther apart nobody knows
POSITION_BEYOND_NS = _S
ATTITUDE_BEYOND_NS = _S // 2
VIEW_BEYOND_NS = 3 * _S // 10
STEADY_DEG = 3.0  # a gimbal that moved more between its last two samples is on its way somewhere
REBOOT_NS = 2 * _S  # a sample later than this by the vehicle's own clock: that clock began again
DRIFT = 1e-4  # of two cheap clocks, generously
_METRES_A_DEGREE = 111_320.0


class VehicleTime:
    """Maps a vehicle's milliseconds since boot to this machine's monotonic nanoseconds."""

    def __init__(self) -> None:
        self._offset_ns: int | None = None
        self._arrival_ns = 0

    def stamp(self, arrival_ns: int, boot_ms: int) -> int:
        """Return when a message of `boot_ms` was made, never later than it arrived."""
        offset_ns = arrival_ns - boot_ms * 1_000_000
        if self._offset_ns is not None and offset_ns - self._offset_ns < REBOOT_NS:
            leak_ns = round((arrival_ns - self._arrival_ns) * DRIFT)
            offset_ns = min(offset_ns, self._offset_ns + leak_ns)
        self._offset_ns, self._arrival_ns = offset_ns, arrival_ns
        return boot_ms * 1_000_000 + offset_ns


class Sample(NamedTuple):
    """One reading: values, and how fast they change (0 where it is not known)."""

    at_ns: int
    values: tuple[float, ...]
    rates: tuple[float, ...]  # per second


class Track:
    """A bounded series of samples in the order of their time; all values that turn are degrees."""

    def __init__(self, turns: tuple[bool, ...], beyond_ns: int) -> None:
        self._turns = turns
        self._beyond_ns = beyond_ns
        self._samples: deque[Sample] = deque(maxlen=SAMPLES)

    def add(self, sample: Sample) -> None:
        """Take a sample; one that is a little older than the newest is left out, one much older begins afresh."""
        if self._samples and sample.at_ns <= self._samples[-1].at_ns:
            if sample.at_ns > self._samples[-1].at_ns - REBOOT_NS:
                return
            self._samples.clear()
        self._samples.append(sample)

    def at(self, at_ns: int) -> tuple[float, ...] | None:
        """Return the values at a moment, or None where they are not known."""
        later: Sample | None = None
        for sample in reversed(self._samples):
            if sample.at_ns <= at_ns:
                return self._beyond(sample, at_ns) if later is None else self._between(sample, later, at_ns)
            later = sample
        return None

    def rates_to(self, at_ns: int, values: tuple[float, ...]) -> tuple[float, ...]:
        """Return how fast values changed since the newest sample, per second; 0 where there is none."""
        if not self._samples or not 0 < at_ns - self._samples[-1].at_ns <= GAP_NS:
            return (0.0,) * len(values)
        last, seconds = self._samples[-1], (at_ns - self._samples[-1].at_ns) / _S
        return tuple(self._difference(i, last, Sample(at_ns, values, ())) / seconds for i in range(len(values)))

    def last_step(self) -> float:
        """Return the largest change of a value between the last two samples; 0 where there are not two."""
        if len(self._samples) < 2:
            return 0.0
        return max(abs(self._difference(i, self._samples[-2], self._samples[-1])) for i in range(len(self._turns)))

    def newest_ns(self) -> int | None:
        """Return the time of the newest sample."""
        return self._samples[-1].at_ns if self._samples else None

    def clear(self) -> None:
        """Forget all samples."""
        self._samples.clear()

    def _difference(self, i: int, one: Sample, other: Sample) -> float:
        difference = other.values[i] - one.values[i]
        return wrapped(difference) if self._turns[i] else difference

    def _between(self, one: Sample, other: Sample, at_ns: int) -> tuple[float, ...] | None:
        if other.at_ns - one.at_ns > GAP_NS:
            return None
        share = (at_ns - one.at_ns) / (other.at_ns - one.at_ns)
        return tuple(value + share * self._difference(i, one, other) for i, value in enumerate(one.values))

    def _beyond(self, last: Sample, at_ns: int) -> tuple[float, ...] | None:
        if at_ns - last.at_ns > self._beyond_ns:
            return None
        seconds = (at_ns - last.at_ns) / _S
        return tuple(value + rate * seconds for value, rate in zip(last.values, last.rates, strict=True))


class Whereabouts(NamedTuple):
    """The vehicle at a moment."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float  # above mean sea level
    height_m: float  # above home
    yaw_deg: float  # from north, clockwise


class Poses:
    """The buffered telemetry of one vehicle with one gimbal."""

    def __init__(self) -> None:
        self._positions = Track((True, True, False, False), POSITION_BEYOND_NS)
        self._yaws = Track((True,), ATTITUDE_BEYOND_NS)
        self._views = Track((True, True), VIEW_BEYOND_NS)
        self._view_from_north = False

    def add_position(self, at_ns: int, position: Position) -> None:
        """Buffer a position with its speed."""
        latitude_deg = position.latitude_e7 / 1e7
        values = (
            latitude_deg,
            position.longitude_e7 / 1e7,
            position.altitude_mm / 1000,
            position.height_mm / 1000,
        )
        narrowing = max(0.01, math.cos(math.radians(latitude_deg)))
        climb_m_s = -position.down_cm_s / 100
        rates = (
            position.north_cm_s / 100 / _METRES_A_DEGREE,
            position.east_cm_s / 100 / (_METRES_A_DEGREE * narrowing),
            climb_m_s,
            climb_m_s,
        )
        self._positions.add(Sample(at_ns, values, rates))

    def add_attitude(self, at_ns: int, attitude: Attitude) -> None:
        """Buffer a heading with its turn rate."""
        self._yaws.add(Sample(at_ns, (attitude.yaw_deg,), (attitude.yaw_rate_deg_s,)))

    def add_view(self, at_ns: int, view: GimbalAttitude) -> None:
        """Buffer a direction of view; another frame of its yaw begins afresh."""
        if view.from_north != self._view_from_north:
            self._views.clear()
            self._view_from_north = view.from_north
        values = (view.pitch_deg, view.yaw_deg)
        self._views.add(Sample(at_ns, values, self._views.rates_to(at_ns, values)))

    def vehicle_at(self, at_ns: int) -> Whereabouts | None:
        """Return position and heading at a moment, or None where one is not known."""
        position, yaw = self._positions.at(at_ns), self._yaws.at(at_ns)
        return None if position is None or yaw is None else Whereabouts(*position, *yaw)

    def view_at(self, at_ns: int) -> tuple[float, float] | None:
        """Return pitch to the horizon and yaw from north of the view in degrees, or None where it is not known."""
        newest_ns = self._views.newest_ns()
        if newest_ns is None or (at_ns > newest_ns and self._views.last_step() > STEADY_DEG):
            return None
        view = self._views.at(at_ns)
        if view is None or self._view_from_north:
            return None if view is None else (view[0], view[1])
        yaw = self._yaws.at(at_ns)
        return None if yaw is None else (view[0], wrapped(view[1] + yaw[0]))

    def pose_at(self, at_ns: int) -> Pose | None:
        """Return the camera's pose at a moment of the monotonic clock; roll is 0, for mounts keep it level."""
        vehicle, view = self.vehicle_at(at_ns), self.view_at(at_ns)
        if vehicle is None or view is None:
            return None
        return Pose(
            mono_ns=at_ns,
            latitude_deg=vehicle.latitude_deg,
            longitude_deg=wrapped(vehicle.longitude_deg),
            altitude_m=vehicle.altitude_m,
            height_m=vehicle.height_m,
            camera_yaw_deg=view[1],
            camera_pitch_deg=view[0],
        )
