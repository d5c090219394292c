"""A whole mission in each personality: fetched over HTTP, planned, uploaded, flown, returned, landed, and replayed."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import pytest
import shapely

from events import Record
from events.schema.common_pb2 import Moved
from events.schema.mission_pb2 import PushReported
from projections.bundle import build_push
from tests.whole.flights import REGION_M, WIDE, Mission, Track, corners

pytestmark = pytest.mark.whole

OVER = ["landed", "syncing", "done"]
BY_NODE = ["uploading", "readying", "arming", "engaging", "starting", "flying", "returning", *OVER]
BY_PILOT = ["uploading", "waiting_for_pilot", "flying", "returning", *OVER]
# At 30 m with 60 degrees; lanes may be 20 % nearer than what the camera shows: [mission] side_overlap.
STRIP_M = 34.64
SIDE_OVERLAP = 0.2
AUTO, RTL = 10, 11  # ArduPlane


@pytest.mark.parametrize("personality", ["ardupilot", "px4"])
def test_a_copter(tmp_path: Path, personality: Literal["ardupilot", "px4"]) -> None:
    """All by itself; the camera has seen at least 98 % of the region, and of each lane its neighbour's part."""
    with Mission(tmp_path, personality=personality, speed_up=9) as flight:
        flight.begin()
        track = Track(flight.door)
        flight.truth(track.note, "the landing")
        flight.landed()
        seen = flight.door.ask(coverage=corners(REGION_M))["coverage"]
        pushed = flight.pushed()
        records = flight.ended()
        check_course(records, BY_NODE)
        check_pushed(records, pushed)
    assert seen >= 0.98
    assert overlapped(track) >= 0.98


def test_a_plane_with_a_pilot(tmp_path: Path) -> None:
    """The pilot launches it and switches to AUTO; the node never arms it and never touches its mode.

    The office is shut as it lands, and the node killed while it tries to push: the next start pushes.
    """
    flight = Mission(tmp_path, frame="plane", speed_up=10, flies=WIDE)
    flight.configure("mission", airframe="plane", cruise_speed_mps=18, search_height_m=60)
    with flight:
        flight.begin()
        flight.status(lambda one: one.mission.state == "waiting_for_pilot", "the plan to be aboard")
        flight.door.ask(launch=40)
        flight.truth(lambda one: one["up_m"] > 35, "the climb")
        flight.door.ask(mode=AUTO)
        flight.status(lambda one: one.mission.state == "flying", "the mission")
        flight.truth(lambda one: one["doing"] in ("mission", "return") and one["current"] > 3, "the lanes")
        flight.status(lambda one: one.mission.state == "returning", "the return")
        flight.stage.office.stop()
        flight.door.ask(disarm=True)  # the pilot has landed it
        flight.landed()
        flight.wait_record(lambda one: one.kind.name == "push_reported", "a push that goes on")
        flight.stage.node.kill()
        flight.stage.office.start()
        flight.stage.node.start()
        pushed = flight.pushed()
        records = flight.ended()
        check_course(records, BY_PILOT)
        check_pushed(records, pushed)
    kinds = [record.kind.name for record in records]
    assert kinds.count("push_observations") == 2
    assert set(kinds).isdisjoint({"arm_vehicle", "start_mission", "set_vehicle_mode"})


def check_course(records: list[Record], states: list[str]) -> None:
    """Check the mission's way through its states from the upload on, and that nothing broke."""
    moves = [one.message for one in records if isinstance(one.message, Moved)]
    visited = [one.to_state for one in moves if one.chart == "mission" and one.to_state != one.from_state]
    assert visited[visited.index("uploading") :][: len(states)] == states
    assert [one for one in records if one.kind.name in ("property_broken", "step_failed")] == []
    kinds = [one.kind.name for one in records]
    assert kinds.count("mission_uploaded") == kinds.count("upload_mission") == 1
    assert kinds.index("fetch_mission") < kinds.index("mission_planned") < kinds.index("upload_mission")


def check_pushed(records: list[Record], pushed: tuple[int, int]) -> None:
    """Check that the office has every sighting that the log would give away, and that the log says so."""
    (report,) = [one.message for one in records if isinstance(one.message, PushReported) and one.message.final]
    landed = [one for one in records if one.seq <= report.effect_seq]
    wanted = build_push(landed)
    assert (len(wanted["observations"]), len(wanted["ignored_items"])) == pushed
    assert (report.observations, report.ignored_items, report.left, report.because, report.final) == (
        *pushed,
        0,
        "",
        True,
    )
    assert pushed[0] > 0


def overlapped(track: Track) -> float:
    """Return which part of the region lies within the strips that lanes may have to themselves at most."""
    own_m = STRIP_M * (1 - SIDE_OVERLAP)
    region = shapely.Polygon(REGION_M)
    searched = shapely.LineString(track.points).buffer(own_m / 2, cap_style="square")
    return float(searched.intersection(region).area / region.area)
