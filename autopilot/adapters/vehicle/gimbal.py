"""What the link's gimbal is and who controls it, as its manager says (MAVLink guide, Gimbal Protocol v2).

Every vehicle is asked for GIMBAL_MANAGER_INFORMATION, also where the capability bit of a gimbal manager is missing:
PX4 before 1.16 and ArduPilot before 4.5 lack it. It is asked for until it comes; after `SILENCE_NS` without it it is
said that no manager has answered. GIMBAL_MANAGER_STATUS is a stream and is said when the hands change.

Plain values in, observations out where something changed; no socket, no clock, no encoding.
"""

from __future__ import annotations

from autopilot.adapters.vehicle.heard import GimbalAttitude, GimbalLimits, GimbalStatus, Sender
from autopilot.adapters.vehicle.upkeep import Stream
from events.schema.vehicle_pb2 import GimbalControlChanged, GimbalDescribed

SILENCE_NS = 8_000_000_000  # the fourth question has gone unanswered by then
ARDUPILOT = 3  # MAV_AUTOPILOT
# MAV_TYPE of what can hover: copters, helicopters, and what takes off vertically. These turn on the spot.
HOVERING = frozenset({2, 3, 4, 13, 14, 15, 29, 35, *range(19, 26)})
PAN_SPAN_DEG = 10.0  # less than this from left to right is play in a mount with two axes


class GimbalWatch:
    """One gimbal of one vehicle."""

    def __init__(self, measures: bool | None) -> None:
        self._measures = measures  # as configured; None: by who reports
        self._information = Stream(once=True)
        self._since_ns = 0
        self._device_reports = False  # a gimbal with a component id of its own tells where it looks
        self._described: GimbalDescribed | None = None
        self._manager: Sender | None = None  # who tells who controls it; the first that does
        self._control: Sender | None = None
        self.limits: GimbalLimits | None = None

    def reset(self, now_ns: int) -> None:
        """Begin again: the vehicle is new, or came back. Everything is said again."""
        self._information.reset(now_ns)
        self._since_ns = now_ns
        self._device_reports = False
        self._described = self._manager = self._control = self.limits = None

    def hear(self, now_ns: int, limits: GimbalLimits) -> None:
        """Take what the manager tells of itself."""
        self.limits = limits
        self._information.heard(now_ns)

    def asks(self, now_ns: int) -> bool:
        """Return whether to ask the manager of itself now."""
        return self._information.tick(now_ns)

    def due_ns(self) -> int:
        """Return when `asks` or `described` have something to do by the passing of time."""
        ask_ns = self._information.due_ns()
        silent_ns = self._since_ns + SILENCE_NS
        if ask_ns is None:
            return silent_ns if self._described is None else 1 << 62
        return ask_ns if self._described is not None else min(ask_ns, silent_ns)

    def described(self, now_ns: int, vehicle_type: int) -> GimbalDescribed | None:
        """Return what the gimbal is, where that is news; None while nobody has told and it is too early to say so."""
        if self.limits is None and now_ns < self._since_ns + SILENCE_NS:
            return None
        said = _description(self.limits, vehicle_type)
        if said == self._described:
            return None
        self._described = said
        return said

    def control(self, status: GimbalStatus, us: Sender) -> GimbalControlChanged | None:
        """Return who controls the gimbal, where that is news."""
        if self._manager not in (None, status.sender) or status.primary == self._control:
            return None
        self._manager, self._control = status.sender, status.primary
        system, component = status.primary.system, status.primary.component
        return GimbalControlChanged(
            vehicle=1, gimbal=1, system_id=system, component_id=component, ours=status.primary == us
        )

    def is_demand(self, autopilot: int, vehicle: Sender, heard: GimbalAttitude) -> bool:
        """Return whether a report is of what was demanded of servos, for all that can be told from outside.

        ArduPilot itself reports for a servo mount what its servos were told; a gimbal that it reads over a serial line
        looks the same here, which is what the configuration is for.
        """
        self._device_reports = self._device_reports or heard.sender.component != vehicle.component
        if self._measures is not None:
            return not self._measures
        return autopilot == ARDUPILOT and heard.sender == vehicle and not self._device_reports


def _description(limits: GimbalLimits | None, vehicle_type: int) -> GimbalDescribed:
    pans = limits is not None and _pans(limits)
    said = GimbalDescribed(
        vehicle=1,
        gimbal=1,
        managed=limits is not None,
        pans=pans,
        turns_vehicle=not pans and vehicle_type in HOVERING,
    )
    if limits is None:
        return said
    if limits.pitch_deg is not None:
        said.pitch_min_cdeg, said.pitch_max_cdeg = (round(100 * limit) for limit in limits.pitch_deg)
    if limits.yaw_deg is not None:
        said.yaw_min_cdeg, said.yaw_max_cdeg = (round(100 * limit) for limit in limits.yaw_deg)
    return said


def _pans(limits: GimbalLimits) -> bool:
    """By its limits where it tells them, else by the axes that it claims; either may deny it."""
    if limits.turns_endlessly:
        return True
    if limits.yaw_deg is None:
        return limits.has_yaw is True
    return limits.has_yaw is not False and limits.yaw_deg[1] - limits.yaw_deg[0] >= PAN_SPAN_DEG
