"""The part of projection `status` that is about failsafes: what they watch, what they did, and who holds them off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from events.records import Record
from events.schema import safety_pb2
from events.schema.common_pb2 import Moved
from events.schema.flight_pb2 import Limits
from events.schema.safety_pb2 import OverrideBegun, OverrideEnded, PropertyBroken, SetVehicleMode
from events.schema.state_pb2 import CarriedState
from projections.picture import FailsafePicture, OverridePicture, Picture
from projections.words import NS_PER_MS

SCOPES: dict[int, str] = {
    safety_pb2.OVERRIDE_BATTERY_RETURN: "battery_return",
    safety_pb2.OVERRIDE_LINK_RETURN: "link_return",
    safety_pb2.OVERRIDE_FENCE_RETURN: "fence_return",
}
_COMMANDS = ("returning", "landing")


def opened(picture: Picture, limits: Limits) -> Picture:
    """Return what a manifest says of failsafes."""
    enabled = limits.flight_enabled or limits.mission_enabled
    watched = "unheard" if enabled and limits.operator_lost_ms else ""
    return replace(picture, failsafes_enabled=enabled, operator_link=watched)


def carried(picture: Picture, record: Record, state: CarriedState) -> Picture:
    """Return what the flight before handed over."""
    now_ns, overrides = record.at.flight_ns, dict(picture.overrides)
    for one in state.overrides:
        scope = SCOPES.get(one.scope, str(one.scope))
        until_ns = now_ns + one.left_ms * NS_PER_MS
        held = OverridePicture(scope, one.callsign, one.principal_id, one.reason, until_ns)
        overrides[f"{one.vehicle}/{one.scope}"] = held
    return replace(picture, overrides=overrides)


def link_moved(picture: Picture, _record: Record, moved: Moved) -> Picture:
    """Return how the link to the operators is."""
    return replace(picture, operator_link=moved.to_state.replace("_", " while "))


def safety_moved(picture: Picture, record: Record, moved: Moved) -> Picture:
    """Return how far a failsafe is; why it commands is said by the record behind its move."""
    before = picture.failsafes.get(moved.instance) or FailsafePicture("ok")
    now = replace(before, state=moved.to_state)
    if moved.to_state in _COMMANDS:
        now = replace(now, because="", commanded_ns=record.at.flight_ns)
    return replace(picture, failsafes={**picture.failsafes, moved.instance: now})


def _commanded(picture: Picture, record: Record, command: SetVehicleMode) -> Picture:
    if command.order:
        return picture
    now_ns = record.at.flight_ns
    failsafes = {
        key: replace(one, because=command.because)
        if one.state in _COMMANDS and one.commanded_ns == now_ns and not one.because
        else one
        for key, one in picture.failsafes.items()
    }
    return replace(picture, failsafes=failsafes)


def _begun(picture: Picture, record: Record, begun: OverrideBegun) -> Picture:
    until_ns = record.at.flight_ns + begun.held_for_ms * NS_PER_MS
    scope = SCOPES.get(begun.scope, str(begun.scope))
    held = OverridePicture(scope, begun.callsign, begun.principal_id, begun.reason, until_ns)
    return replace(picture, overrides={**picture.overrides, f"{begun.vehicle}/{begun.scope}": held})


def _ended(picture: Picture, _record: Record, ended: OverrideEnded) -> Picture:
    gone = f"{ended.vehicle}/{ended.scope}"
    return replace(picture, overrides={key: one for key, one in picture.overrides.items() if key != gone})


def _broken(picture: Picture, _record: Record, broken: PropertyBroken) -> Picture:
    words = f"record {broken.at_seq}: {broken.words}"
    return replace(picture, properties_broken={broken.property: words} | dict(picture.properties_broken))


CHANGES: dict[str, Callable[[Picture, Record, Any], Picture]] = {
    "set_vehicle_mode": _commanded,
    "override_begun": _begun,
    "override_ended": _ended,
    "property_broken": _broken,
}
