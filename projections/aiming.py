"""The gimbals in projection `status`: what they were asked, whether they got there, and who controls them.

Every change makes a new picture; `projections.status` calls these by the kind of a record.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from events.records import Record
from events.schema.common_pb2 import Moved
from events.schema.vehicle_pb2 import (
    GimbalControlChanged,
    GimbalDescribed,
    GimbalReported,
    PointAtAngles,
    PointAtPlace,
    ReleasePointing,
)
from projections.describe import angles_words, control_words, place_words
from projections.picture import GimbalPicture, Picture, key_of, with_row


def _asked(picture: Picture, record: Record, asked: PointAtPlace | PointAtAngles) -> Picture:
    if isinstance(asked, PointAtPlace):
        words = f"{place_words(asked.place)}, WGS84"
    else:
        words = angles_words(asked.pitch_cdeg, asked.yaw_cdeg, asked.yaw_locked)
    key = key_of(asked.vehicle, asked.gimbal)
    gimbal = replace(
        picture.gimbals.get(key) or GimbalPicture(),
        asked=words,
        asked_ns=record.at.flight_ns,
        effect_seq=record.seq,
        error_cdeg=None,
        arrived_after_ns=None,
        order=asked.order,
        aim_because="",
    )
    return replace(picture, gimbals=with_row(picture.gimbals, key, gimbal))


def _let_go(picture: Picture, _record: Record, released: ReleasePointing) -> Picture:
    key = key_of(released.vehicle, released.gimbal)
    before = picture.gimbals.get(key) or GimbalPicture()
    gimbal = replace(
        before,
        asked="",
        asked_ns=0,
        effect_seq=-1,
        error_cdeg=None,
        arrived_after_ns=None,
        order="",
        aim_because="",
    )
    return replace(picture, gimbals=with_row(picture.gimbals, key, gimbal))


def aim_moved(picture: Picture, record: Record, moved: Moved) -> Picture:
    """Show where the aim of a gimbal is by now."""
    before = picture.gimbals.get(moved.instance) or GimbalPicture()
    after_ns = before.arrived_after_ns  # stays the first arrival's while it drifts and comes back
    if moved.from_state == "moving":
        after_ns = record.at.flight_ns - before.asked_ns if moved.to_state == "arrived" else None
    because = moved.because if moved.to_state in ("drifted", "missed") else ""
    gimbal = replace(before, aim=moved.to_state, arrived_after_ns=after_ns, aim_because=because)
    return replace(picture, gimbals=with_row(picture.gimbals, moved.instance, gimbal))


def _gimbal(picture: Picture, _record: Record, report: GimbalReported) -> Picture:
    key = key_of(report.vehicle, report.gimbal)
    before = picture.gimbals.get(key) or GimbalPicture()
    error_cdeg = before.error_cdeg
    if report.HasField("error_cdeg") and report.effect_seq == before.effect_seq:
        error_cdeg = report.error_cdeg
    gimbal = replace(
        before,
        pitch_cdeg=report.pitch_cdeg,
        yaw_cdeg=report.yaw_cdeg,
        error_cdeg=error_cdeg,
        demanded=report.demanded,
    )
    return replace(picture, gimbals=with_row(picture.gimbals, key, gimbal))


def _described(picture: Picture, _record: Record, told: GimbalDescribed) -> Picture:
    return _gimbal_with(picture, told, turns_vehicle=told.turns_vehicle)


def _controlled(picture: Picture, _record: Record, change: GimbalControlChanged) -> Picture:
    control = control_words(change.system_id, change.component_id, ours=change.ours)
    return _gimbal_with(picture, change, control=control)


def _gimbal_with(picture: Picture, told: GimbalDescribed | GimbalControlChanged, **values: Any) -> Picture:
    key = key_of(told.vehicle, told.gimbal)
    gimbal = replace(picture.gimbals.get(key) or GimbalPicture(), **values)
    return replace(picture, gimbals=with_row(picture.gimbals, key, gimbal))


CHANGES: dict[str, Callable[[Picture, Record, Any], Picture]] = {
    "point_at_place": _asked,
    "point_at_angles": _asked,
    "release_pointing": _let_go,
    "gimbal_reported": _gimbal,
    "gimbal_described": _described,
    "gimbal_control_changed": _controlled,
}
