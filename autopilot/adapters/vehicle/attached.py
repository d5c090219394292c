"""What a vehicle carries, gimbal and camera, as the link's session asks it: one question each.

It adds nothing to `gimbal` and `camera` but the choice between them.
"""

from __future__ import annotations

from google.protobuf.message import Message

from autopilot.adapters.vehicle.camera import CameraWatch
from autopilot.adapters.vehicle.egress import CAMERA_INFORMATION, CAMERA_SETTINGS, GIMBAL_INFORMATION
from autopilot.adapters.vehicle.gimbal import GimbalWatch
from autopilot.adapters.vehicle.heard import (
    CameraInformation,
    CameraSettings,
    GimbalAttitude,
    GimbalLimits,
    GimbalStatus,
    Sender,
)
from events.schema.vehicle_pb2 import (
    SetZoom,
    VehicleStateReported,
)

Told = GimbalLimits | GimbalStatus | CameraInformation | CameraSettings


class Attached:
    """One gimbal and one camera."""

    def __init__(self, gimbal_measures: bool | None) -> None:
        self._gimbal = GimbalWatch(gimbal_measures)
        self._camera = CameraWatch()

    @property
    def limits(self) -> GimbalLimits | None:
        """How far the gimbal turns, once it told."""
        return self._gimbal.limits

    def reset(self, now_ns: int) -> None:
        """Begin again: the vehicle is new, or came back."""
        self._gimbal.reset(now_ns)
        self._camera.reset(now_ns)

    def hear(self, now_ns: int, told: Told, us: Sender) -> Message | None:
        """Take what one of them tells; return an observation where it is news."""
        match told:
            case GimbalLimits():
                self._gimbal.hear(now_ns, told)  # `described` says it, with what is known of the vehicle
                return None
            case GimbalStatus():
                return self._gimbal.control(told, us)
            case CameraInformation():
                return self._camera.described(now_ns, told)
        return self._camera.zoomed(now_ns, told)

    def described(self, now_ns: int, state: VehicleStateReported | None) -> Message | None:
        """Return what the gimbal is, where that is news."""
        return None if state is None else self._gimbal.described(now_ns, state.vehicle_type)

    def is_demand(self, state: VehicleStateReported | None, vehicle: Sender, heard: GimbalAttitude) -> bool:
        """Return whether a report of the gimbal is of what was demanded of it."""
        return self._gimbal.is_demand(0 if state is None else state.autopilot, vehicle, heard)

    def wanted(self, now_ns: int) -> list[int]:
        """Return the messages to ask for now."""
        asks = (
            (GIMBAL_INFORMATION, self._gimbal.asks(now_ns)),
            (CAMERA_INFORMATION, self._camera.asks_information(now_ns)),
            (CAMERA_SETTINGS, self._camera.asks_settings(now_ns)),
        )
        return [message_id for message_id, wanted in asks if wanted]

    def due_ns(self) -> int | None:
        """Return when there may be something to ask or to say by the passing of time."""
        dues = self._gimbal.due_ns(), self._camera.due_ns()
        return min((due for due in dues if due is not None), default=None)

    def target_of(self, effect: Message) -> Sender | None:
        """Return who is to take an effect; None: the autopilot."""
        return self._camera.sender if isinstance(effect, SetZoom) else None

    def accepted(self, now_ns: int, effect: Message) -> None:
        """Learn that an effect was accepted; what came of a zoom is asked for."""
        if isinstance(effect, SetZoom):
            self._camera.ask_settings(now_ns)
