"""The mission in the words of the wire: what `NodeStatus.mission` says."""

from __future__ import annotations

from events.schema.waypoint_pb2 import MissionStatus, NodeStatus
from projections.picture import Picture


def say_mission(said: NodeStatus, picture: Picture) -> None:
    """Say how far the mission is; nothing where this node flies none."""
    mission = picture.mission
    if mission is None:
        return
    said.mission.CopyFrom(
        MissionStatus(
            state=mission.state,
            because=mission.because,
            items=mission.items,
            next_item=mission.next_item,
            fences=mission.fences,
            selftest=mission.selftest,
            findings=mission.findings,
        )
    )
    if mission.mission_id:
        said.mission.mission_id = mission.mission_id
    if mission.report_id is not None:
        said.mission.report_id = mission.report_id
    if mission.unavailable:
        said.mission.unavailable = mission.unavailable
    if mission.pushed:
        said.mission.pushed = mission.pushed
