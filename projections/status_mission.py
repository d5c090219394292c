"""The mission and its self-test in projection `status`.

Every change makes a new picture; `projections.status` calls these by the kind of a record.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from events.records import Record
from events.schema.common_pb2 import Moved
from events.schema.flight_pb2 import Limits
from events.schema.mission_pb2 import (
    SELFTEST_PASS,
    MissionPlanned,
    MissionProgressReported,
    MissionUnavailable,
    PushReported,
    SelftestReported,
)
from events.schema.state_pb2 import CarriedState
from projections.describe_flight import VERDICTS, named, pushed
from projections.picture import MissionPicture, Picture


def opened(picture: Picture, limits: Limits) -> Picture:
    """Return the picture at the beginning of a flight."""
    return replace(picture, mission=MissionPicture()) if limits.mission_enabled else picture


def carried(picture: Picture, record: Record, state: CarriedState) -> Picture:
    """Take over the mission that was under way in the air as the flight began."""
    if not state.HasField("mission"):
        return picture
    mission, because = state.mission, "the flight before ended in the air: it goes on"
    known = _planned(picture, record, mission.plan)
    return _with(known, state=mission.chart_state, because=because, next_item=mission.next_item)


def _with(picture: Picture, **changes: Any) -> Picture:
    if picture.mission is None:
        return picture
    return replace(picture, mission=replace(picture.mission, **changes))


def mission_moved(picture: Picture, _record: Record, moved: Moved) -> Picture:
    """Take in a move of the chart `mission`."""
    return _with(picture, state=moved.to_state, because=moved.because)


def selftest_moved(picture: Picture, _record: Record, moved: Moved) -> Picture:
    """Take in a move of the chart `selftest`."""
    return _with(picture, selftest=moved.to_state)


def _planned(picture: Picture, _record: Record, plan: MissionPlanned) -> Picture:
    fences, items = len(plan.fences), len(plan.items)
    return _with(picture, mission_id=plan.mission_id, items=items, fences=fences, unavailable="")


def _unavailable(picture: Picture, _record: Record, report: MissionUnavailable) -> Picture:
    return _with(picture, unavailable=report.because)


def _pushed(picture: Picture, _record: Record, report: PushReported) -> Picture:
    return _with(picture, pushed=pushed(report))


def _progress(picture: Picture, _record: Record, report: MissionProgressReported) -> Picture:
    reached = report.reached_item + 1 if report.HasField("reached_item") else 0
    return _with(picture, next_item=max(reached, report.current_item))


def _tested(picture: Picture, _record: Record, report: SelftestReported) -> Picture:
    odd = (item for item in report.items if item.verdict != SELFTEST_PASS)
    findings = tuple(f"{item.name}: {named(VERDICTS, item.verdict)}, {item.words}" for item in odd)
    return _with(picture, report_id=report.effect_seq, findings=findings)


CHANGES: dict[str, Callable[[Picture, Record, Any], Picture]] = {
    "mission_planned": _planned,
    "mission_unavailable": _unavailable,
    "push_reported": _pushed,
    "mission_progress_reported": _progress,
    "selftest_reported": _tested,
}
