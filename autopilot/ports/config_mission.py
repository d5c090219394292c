"""The section [mission] of the configuration (`autopilot.ports.config`)."""

from __future__ import annotations

import re
from typing import Literal

from pydantic import Field, model_validator

from autopilot.ports.section import Section

_UUID = re.compile(r"[0-9a-fA-F]{8}(-[0-9a-fA-F]{4}){3}-[0-9a-fA-F]{12}")


class MissionSection(Section):
    """Whether a mission is flown, where it comes from, how large it may be. Without `url` and `file` there is none."""

    enabled: bool = Field(False, description="True: the node flies the mission. It arms and changes modes for it.")
    begin: Literal["order", "alone"] = Field(
        "order", description="order: a person lets it begin. alone: it begins when the self-test has passed."
    )
    start: Literal["node", "pilot"] = Field(
        "node", description="Who arms a copter and starts AUTO; a plane is always a pilot's."
    )
    tries: int = Field(3, ge=1, le=20, description="A step is tried so often; then the mission is paused.")
    step_s: float = Field(
        15,
        ge=1,
        le=300,
        description="A step that is refused, or shows no effect, is tried again after this: arming takes up to 10 s.",
    )
    acknowledge_s: float = Field(
        300, ge=1, le=86_400, description="A degraded self-test fails when nobody takes it on within this."
    )
    upload_s: float = Field(
        120, ge=5, le=3600, description="Longest upload with read-back: 700 items on a link that loses a third."
    )
    camera_pitch_deg: float = Field(
        -90, ge=-90, le=30, description="Pitch on the way, up positive. A region's search is planned for straight down."
    )
    follow_by_waypoint: bool = Field(
        False, description="True: what a camera follows gets a waypoint, and the vehicle waits there."
    )
    url: str = Field("", description="The mission office, e.g. http://10.13.0.1:8088; /missions/ID is asked under it.")
    mission_id: str = Field("", description="UUID of the mission that the office is asked for.")
    file: str = Field("", description="A mission on this disk, instead of an office.")
    token_file: str = Field("", description="File 0600 with the bearer token for the office. Empty: none is sent.")
    timeout_s: float = Field(10, gt=0, le=120, description="One answer of the office takes at most this long.")
    attempts: int = Field(
        8, ge=1, le=100, description="Tries before the office counts as out of reach: some 2 minutes."
    )
    retry_first_s: float = Field(1, gt=0, le=600, description="Wait before the second try; doubles each time.")
    retry_longest_s: float = Field(30, gt=0, le=600, description="Longest wait between tries.")
    push_s: float = Field(
        120,
        ge=1,
        le=3600,
        description="After a landing what was seen is pushed for at most this long. 5,000 observations and 500 ignored "
        "items take as long on a poor link; under [flight] close_after_s, so the flight is still open.",
    )
    push_bytes: int = Field(
        131_072,
        ge=4096,
        le=1 << 26,
        description="Longest post of what was seen, some 200 rows; more is sent in several. 131,072 bytes pass within "
        "10 s at 105 kbit/s.",
    )
    max_bytes: int = Field(
        1_048_576, ge=1024, le=1 << 26, description="Longest mission in bytes: 500 items and 64 fences fit three times."
    )
    max_items: int = Field(500, ge=1, le=10_000, description="Items of a mission: what people can look through.")
    max_fences: int = Field(64, ge=0, le=1000, description="Geofences of a mission.")
    max_vertices: int = Field(500, ge=3, le=10_000, description="Corners of one polygon; a surveyed field has fewer.")
    max_planned: int = Field(
        700, ge=1, le=65_535, description="Items of the upload: ArduPilot keeps some 700 on its smallest boards."
    )
    reach_m: float = Field(
        20_000,
        gt=0,
        le=50_000,
        description="Farthest from home; beyond 50 km the local frame is off by more than 1e-5.",
    )
    airframe: Literal["copter", "plane"] = Field(
        "copter", description="copter: takeoff and landing belong to the plan. plane: a pilot does both."
    )
    cruise_speed_mps: float = Field(
        8,
        ge=0.5,
        le=100,
        description="Speed where the mission says none; over ground (copter), through the air (plane).",
    )
    takeoff_height_m: float = Field(
        20, ge=1, le=500, description="A copter climbs at least so high over home before it sets off."
    )
    search_height_m: float = Field(60, gt=0, le=10_000, description="A region without heights is searched from here.")
    search_hold_s: float = Field(30, ge=0, le=3600, description="A copter looks around a point to search this long.")
    search_radius_m: float = Field(
        80, gt=0, le=5000, description="A plane goes round a point to search at this radius."
    )
    field_of_view_deg: float | None = Field(
        None, gt=1, le=170, description="Horizontal field of view of the search. Absent: that of [eyes]."
    )
    aspect: float = Field(16 / 9, ge=0.2, le=5, description="Width of the picture to its height.")
    side_overlap: float = Field(0.2, ge=0, le=0.95, description="Part of a lane's width that its neighbour sees too.")
    forward_overlap: float = Field(
        0.3, ge=0, le=0.95, description="Part of a frame that the next one sees too; says how often to look."
    )
    fence_margin_m: float = Field(
        10, ge=0, le=1000, description="Lanes keep this far from fences: GPS, gusts, and the width of a turn."
    )
    turn_s: float = Field(4, ge=0, le=300, description="Time to turn from one lane to the next, for the estimate.")
    run_in_m: float = Field(
        0,
        ge=0,
        le=1000,
        description="Straight flight before and behind a lane, where fences leave room: a plane needs it.",
    )
    wind_from_deg: float = Field(0, ge=0, le=360, description="Where the wind comes from, from north clockwise.")
    wind_mps: float = Field(0, ge=0, le=60, description="How strong it is. A plane's lanes and times depend on it.")

    @model_validator(mode="after")
    def _one_source(self) -> MissionSection:
        """Say so where there are two sources, or half of one."""
        if self.enabled and not (self.url or self.file):
            raise ValueError("enabled = true needs url or file: which mission?")
        if self.url and self.file:
            raise ValueError("url and file are two sources of the mission; keep one")
        if self.url and not self.url.startswith(("http://", "https://")):
            raise ValueError(f'url is like http://10.13.0.1:8088, not "{self.url}"')
        if self.url and not _UUID.fullmatch(self.mission_id):
            raise ValueError("mission_id is missing or no UUID: the office is asked for one mission")
        if self.retry_first_s > self.retry_longest_s:
            raise ValueError("retry_first_s is above retry_longest_s")
        return self
