"""What a node's status says of an order: what the gimbal did, who holds a camera, and what an operator may do there.

Pure functions over a NodeStatus, so that a shell and a page say the same. Nothing here believes anything: a status
comes here when it was verified and opened.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from events.schema.waypoint_pb2 import CameraStatus, NodeStatus, PrincipalKind


@dataclass(frozen=True, slots=True, kw_only=True)
class Pointing:
    """What became of the view that an order asked for."""

    state: str = (
        "waiting"  # "waiting", "moving", "arrived", "drifted", "missed", "taken" (by another), "over" (nobody's)
    )
    error_deg: float | None = None  # between what was asked and what the gimbal says
    after_s: float | None = None  # from the order to the arrival
    by: str = ""  # who has the camera now, where it was taken
    because: str = ""  # why it drifted or missed: "255/190 took it"
    demanded: bool = False  # nothing measures it: this is what the gimbal's servos were told

    @property
    def is_done(self) -> bool:
        """Say whether it will not change by itself."""
        return self.state in ("arrived", "drifted", "missed", "taken", "over")

    def words(self) -> str:
        """Return it for people."""
        off = f", {self.error_deg:.1f} deg off" if self.error_deg is not None else ""
        match self.state:
            case "arrived":
                after = f", after {self.after_s:.1f} s" if self.after_s is not None else ""
                return f"commanded{off}{after}, not measured" if self.demanded else f"arrived{off}{after}"
            case "drifted":
                return f"drifted: {self.because}" if self.because else f"drifted{off}"
            case "missed":
                return f"missed{off}" + (f": {self.because}" if self.because else "")
            case "taken":
                return f"taken by {self.by}"
            case "over":
                return "nobody holds the camera any more"
        return f"{self.state}{off}"


def pointing(status: NodeStatus, command_id: str, camera: int = 1, since_seq: int = 0) -> Pointing:
    """Return what the gimbal did for an order; a status from before `since_seq`, its answer's record, says nothing."""
    one = _camera(status, camera)
    if one is None or status.head_seq < since_seq:
        return Pointing()
    if command_id not in (one.command_id, one.aim_command_id):
        return Pointing(state="taken", by=one.callsign) if one.command_id else Pointing(state="over")
    error_deg = one.error_cdeg / 100 if one.HasField("error_cdeg") else None
    if one.aim == "arrived":
        after_s = one.arrived_after_ms / 1000 if one.HasField("arrived_after_ms") else None
        return Pointing(state="arrived", error_deg=error_deg, after_s=after_s, demanded=one.aim_demanded)
    state = one.aim if one.aim in ("moving", "drifted", "missed") else "waiting"
    return Pointing(state=state, error_deg=error_deg, because=one.aim_because, demanded=one.aim_demanded)


@dataclass(frozen=True, slots=True)
class Commander:
    """Who commanded a camera last, as far as a status has said."""

    callsign: str
    command_id: str
    holds: bool  # the hold is not over


def commander(status: NodeStatus, camera: int, before: Commander | None) -> Commander | None:
    """Return who commanded a camera last: who holds it, else who was known before."""
    one = _camera(status, camera)
    if one is not None and one.command_id:
        return Commander(one.callsign, one.command_id, holds=True)
    return None if before is None else Commander(before.callsign, before.command_id, holds=False)


def attribute(commanders: dict[tuple[str, int], Commander], node: str, status: NodeStatus) -> None:
    """Note for each camera of a node who commanded it last."""
    for camera in {one.camera for one in status.cameras}:
        found = commander(status, camera, commanders.get((node, camera)))
        if found is not None:
            commanders[node, camera] = found


@dataclass(frozen=True, slots=True)
class Permission:
    """Whether an operator may do a class of things on a node now, and why not. The node judges; this foresees it."""

    what: str  # "camera", "flight"
    allowed: bool
    because: str  # "" where it is allowed


def permissions(
    status: NodeStatus, kind: PrincipalKind.ValueType, roles: Iterable[str], *, revoked: bool, expired: bool
) -> tuple[Permission, Permission]:
    """Return what somebody of this kind with these roles may do on a node: to its cameras, and to its flight."""
    held = frozenset(roles)
    general = [
        (kind != PrincipalKind.OPERATOR, "only operators give orders"),
        (revoked, "this identity is revoked"),
        (expired, "this identity has expired"),
        (bool(status.not_recording), f"the node takes no orders: {status.not_recording}"),
        (not status.command_enabled, "orders are switched off on this node"),
    ]
    late = [(status.health == "safe mode", "the node is in safe mode")]

    def judged(what: str, allowed: Iterable[str]) -> Permission:
        names = sorted(allowed)
        missing = f"needs one of the roles {', '.join(names)}" if names else "the node allows it to nobody"
        reasons = [*general, (not held & set(names), missing), *late]
        because = next((why for holds, why in reasons if holds), "")
        return Permission(what, not because, because)

    return judged("camera", status.camera_roles), judged("flight", status.flight_roles)


def _camera(status: NodeStatus, camera: int) -> CameraStatus | None:
    return next((one for one in status.cameras if one.camera == camera), None)
