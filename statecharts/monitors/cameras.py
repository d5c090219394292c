"""Who moves a camera."""

from __future__ import annotations

from events.schema.findings_pb2 import CameraTaken
from events.schema.flight_pb2 import Limits
from events.schema.orders_pb2 import OrderReceived
from events.schema.vehicle_pb2 import (
    GimbalControlChanged,
    PointAtAngles,
    PointAtPlace,
    ReleasePointing,
    TakeGimbal,
)
from statecharts.monitors.monitor import Monitor, Said, Step, key_of, moves_of, order_of
from statecharts.state import State

_POINTING = ("point_at_place", "point_at_angles", "release_pointing")


class OneMaster(Monitor):
    """A camera that an operator has bears one name, of the order that was intended in that step.

    Or of whoever had it before, in a step that refused the order that had taken it.
    """

    kinds = ("camera_taken", "moved")

    def __init__(self, limits: Limits, whole: bool) -> None:
        super().__init__(limits, whole)
        self._had: dict[str, None] = {}

    def look(self, step: Step) -> Said:
        """Hold the names against the moves."""
        holders = [message for record in step if isinstance(message := record.message, CameraTaken)]
        cameras = sorted(move.instance for move in moves_of(step, "camera") if move.to_state == "operator")
        if not holders and not cameras:
            return
        taken = sorted(f"{one.vehicle}/{one.camera}" for one in holders)
        if taken != cameras or len(dict.fromkeys(cameras)) < len(cameras):
            yield "one_master", f"cameras {cameras} taken by {[one.callsign for one in holders]}"
        orders = moves_of(step, "command")
        allowed = {move.instance: None for move in orders if move.to_state == "intended"}
        refused = any(move.to_state in ("rejected", "unsupported") for move in orders)
        names = [key_of(one.principal_id, one.command_id) for one in holders]
        known = self.whole or not refused
        if known and [name for name in names if name not in allowed and not (refused and name in self._had)]:
            yield "one_master", "a camera was taken by an order that did not pass its gates"
        self._had.update(dict.fromkeys(names))


class HandsOff(Monitor):
    """The node itself moves no camera that somebody has, or that rests; and none where it may not, but to follow.

    Following is ordered, and over as soon as somebody takes the camera. A mission turns its own as it begins to fly.
    """

    kinds = ("moved", *_POINTING)

    def __init__(self, limits: Limits, whole: bool) -> None:
        super().__init__(limits, whole)
        self._cameras: dict[str, str] = {}
        self._following: dict[str, None] = {}

    def resume(self, state: State) -> None:
        """Take over what was ordered to follow before the start."""
        self._following = {key: None for key, scan in state.scans.items() if scan.state == "following"}

    def look(self, step: Step) -> Said:
        """See who moves."""
        self._cameras.update((move.instance, move.to_state) for move in moves_of(step, "camera"))
        for move in moves_of(step, "camera"):
            if move.to_state != "automatic":
                self._following.pop(move.instance, None)
        order, accepted = step[0].message, any(move.to_state == "accepted" for move in moves_of(step, "command"))
        if isinstance(order, OrderReceived) and order.WhichOneof("order") == "follow_poi" and accepted:
            self._following[f"1/{order.follow_poi.camera}"] = None
        for record in step:
            effect = record.message
            if not isinstance(effect, PointAtPlace | PointAtAngles | ReleasePointing) or order_of(record):
                continue
            camera = f"{effect.vehicle}/{effect.camera}"
            if self._cameras.get(camera, "automatic") != "automatic":
                yield "hands_off", f"record {record.seq} moves a camera that the node does not have"
            if not (self.limits.scan_enabled or camera in self._following or _begins_to_fly(step)):
                yield "hands_off", f"record {record.seq} moves a camera where that is switched off"


def _begins_to_fly(step: Step) -> bool:
    """Whether a mission begins to fly, which wants its cameras down."""
    return any(move.to_state == "flying" for move in moves_of(step, "mission"))


class NobodyIsFought(Monitor):
    """Control of a gimbal is asked for only before an operator's pointing, and never while another has it."""

    kinds = ("gimbal_control_changed", "take_gimbal")

    def __init__(self, limits: Limits, whole: bool) -> None:
        super().__init__(limits, whole)
        self._others: dict[tuple[int, int], None] = {}

    def look(self, step: Step) -> Said:
        """Follow who has control."""
        told = step[0].message
        if isinstance(told, GimbalControlChanged):
            self._others.pop((told.vehicle, told.gimbal), None)
            if told.system_id and not told.ours:
                self._others[told.vehicle, told.gimbal] = None
        for record in step:
            if not isinstance(taken := record.message, TakeGimbal):
                continue
            if (taken.vehicle, taken.gimbal) in self._others and not self.limits.take_from_others:
                yield "nobody_is_fought", f"record {record.seq} takes a gimbal from another"
            if not isinstance(told, OrderReceived):
                yield "nobody_is_fought", f"record {record.seq} takes a gimbal that no operator asked for"


CAMERAS: tuple[type[Monitor], ...] = (OneMaster, HandsOff, NobodyIsFought)
