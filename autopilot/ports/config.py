"""The one frozen configuration: every limit with its unit and reason (style 27).

This file only says what may be configured. Reading TOML and judging it is
`autopilot.cli.configuration`'s business; decisions never see these objects, they see the
`Limits` message that the manifest carries.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from autopilot.ports.config_mission import MissionSection as MissionSection
from autopilot.ports.config_vehicle import VehicleSection as VehicleSection
from autopilot.ports.section import Section as Section

Degrees = Annotated[float, Field(ge=-360, le=360)]
Port = Annotated[int, Field(ge=1, le=65535)]


class NodeSection(Section):
    """Who this node is and where it keeps its things."""

    keys: str = Field(description="Folder with the device's keys and signed documents; files 0600.")
    flights: str = Field(description="Folder that holds one folder for each flight.")
    projections: str = Field(description="Disposable database of the projections.")
    documents: str = Field(
        "", description="Folder that is watched for newer documents of the Directory (an air gap). Empty: none."
    )


class CommandSection(Section):
    """Whether and from whom orders are taken (seed 000: off by default)."""

    enabled: bool = Field(False, description="False: every order is answered ACK_UNSUPPORTED.")
    camera_roles: tuple[str, ...] = Field((), description="Roles that may point the camera. Empty: nobody.")
    flight_roles: tuple[str, ...] = Field((), description="Roles that may command the flight. Empty: nobody.")
    operator_hold_s: float = Field(60, gt=0, le=3600, description="An operator keeps the camera this long.")
    overdue_camera_h: float = Field(
        72, ge=0, le=8760, description="The camera may be ordered while the revocation list is overdue by this."
    )
    overdue_flight_h: float = Field(
        1, ge=0, le=8760, description="Anything else may be ordered while the list is overdue by this: it moves more."
    )
    release_pause_s: float = Field(3, ge=0, le=600, description="A released camera rests this long.")
    roi_turns_vehicle: Literal["warn", "refuse"] = Field(
        "refuse",
        description="A place to look at where no gimbal pans, so that the vehicle itself turns: a role for the camera "
        "is none for the flight.",
    )
    take_from_others: bool = Field(False, description="Take control of a gimbal also from another who has it.")


class ClockSection(Section):
    """What tells the time. Signed beacons of the Directory always do."""

    trusted: bool = Field(
        True,
        description="The host's clock is kept (RTC, NTP): believed until it contradicts a signed document or jumps.",
    )


class MeshSection(Section):
    """The Zenoh session. Without endpoints the node has no mesh."""

    mode: Literal["client", "peer"] = Field("client", description="Zenoh session mode.")
    connect: tuple[str, ...] = Field((), description="Endpoints to connect to, e.g. tcp/127.0.0.1:7447.")
    listen: tuple[str, ...] = Field((), description="Endpoints to listen on (peer mode).")
    reconnect_ms: int = Field(500, ge=50, le=60_000, description="Wait between tries to reconnect.")
    samples_per_s: int = Field(200, ge=1, le=100_000, description="Token bucket of the gate.")
    samples_burst: int = Field(50, ge=1, le=100_000, description="Depth of the token bucket.")
    status_period_s: float = Field(1.0, ge=0.1, le=60, description="How often NodeStatus is published.")
    presence_period_s: float = Field(
        2.0,
        ge=0.1,
        le=60,
        description="That an operator is heard is recorded at most this often: twice within operator_degraded_s (5 s).",
    )


class FixedPose(Section):
    """Where a camera stands that nothing reports about."""

    latitude_deg: float = Field(ge=-90, le=90)
    longitude_deg: float = Field(ge=-180, le=180)
    altitude_m: float = Field(0, ge=-500, le=20_000, description="Above mean sea level.")
    height_m: float = Field(gt=0, le=20_000, description="Above the flat ground in view.")
    yaw_deg: Degrees = Field(0, description="From north, clockwise.")
    pitch_deg: float = Field(ge=-90, le=90, description="Up positive; -90 looks straight down.")


class EyesSection(Section):
    """The camera and its detector."""

    source: Literal["none", "file", "device", "external"] = Field("none", description="Where detections come from.")
    path: str = Field("", description="Video file, for source = file.")
    device: int = Field(0, ge=0, description="Camera number, for source = device.")
    endpoint: str = Field("", description="host:port of a detector that sends DetectionBatch, for source = external.")
    model: str = Field("", description="ONNX file of the detector, for file and device.")
    output: Literal["nanodet"] = Field("nanodet", description="How the model's output is to be read.")
    classes: tuple[str, ...] = Field((), description="Class names of the model in order; empty: COCO's 80.")
    confidence: float = Field(0.4, ge=0.05, le=1, description="Detections below it are not reported.")
    overlap: float = Field(0.5, gt=0, le=1, description="IoU from which two boxes are one.")
    field_of_view_deg: float = Field(60, gt=1, le=170, description="Horizontal field of view.")
    pace: Literal["real", "fast"] = Field("real", description="A file at its own speed, or as fast as it goes.")
    at_end: Literal["stop", "go_on", "loop"] = Field("go_on", description="What the node does when a file ends.")
    frames: int = Field(0, ge=0, description="Stop after this many frames; 0: all.")
    threads: int = Field(1, ge=1, le=64, description="Threads of the detector.")
    range_max_m: float = Field(2000, gt=0, le=50_000, description="Farther ground points get no place.")
    silence_s: float = Field(15, gt=0, le=600, description="No word from camera or detector: it is started afresh.")
    retry_first_s: float = Field(0.5, gt=0, le=600, description="Wait before the first new try; doubles each time.")
    retry_longest_s: float = Field(10, gt=0, le=600, description="Longest wait between tries.")
    message_bytes: int = Field(262_144, ge=1024, description="Longest message of a detector; 1,000 boxes fit twice.")
    detections: int = Field(300, ge=1, le=10_000, description="Boxes in one frame; more are a broken detector.")
    empty_frame_period_s: float = Field(
        1.0, ge=0, le=60, description="A frame with nothing in it is recorded at most this often; 0: every one."
    )
    pose: FixedPose | None = Field(None, description="Fixed pose; absent: the vehicle's telemetry tells it.")

    @model_validator(mode="after")
    def _complete(self) -> EyesSection:
        """Say which key a source lacks."""
        needed = {"file": ("path", "model"), "device": ("model",), "external": ("endpoint",), "none": ()}
        missing = [key for key in needed[self.source] if not getattr(self, key)]
        if missing:
            raise ValueError(f'source = "{self.source}" needs {" and ".join(missing)}')
        host, _, port = self.endpoint.rpartition(":")
        if self.endpoint and not (host and port.isascii() and port.isdigit() and 1 <= int(port) <= 65_535):
            raise ValueError(f'endpoint is host:port, such as 127.0.0.1:7600, not "{self.endpoint}"')
        return self


class FlightSection(Section):
    """Where a flight begins and ends, and whether this node has a say in how it is flown."""

    enabled: bool = Field(
        False, description="True: orders of the flight are taken, and failsafes command the vehicle ([safety])."
    )
    close_after_s: float = Field(180, ge=0, le=86_400, description="Disarmed this long: the flight is closed.")
    outage_longest_h: float = Field(
        24, gt=0, le=8760, description="A longer outage is not believed: a wall clock that jumped is no outage."
    )
    origin: tuple[float, float, float] | None = Field(
        None, description="Origin as latitude, longitude (degrees), altitude (m AMSL). Absent: the first 3D fix."
    )

    @model_validator(mode="after")
    def _on_earth(self) -> FlightSection:
        """Say so when latitude and longitude are swapped or not degrees."""
        if self.origin is not None and not (abs(self.origin[0]) <= 90 and abs(self.origin[1]) <= 180):
            raise ValueError("origin is latitude (+-90), longitude (+-180), altitude in metres, in this order")
        return self


# GLOBAL_POSITION_INT is asked for this often; a place is at most so much older than it is thinned to.
POSITION_STREAM_S = 0.2


class SafetySection(Section):
    """When the vehicle is sent home or down, where [flight] or [mission] is enabled (seed 004, section 4)."""

    battery_return_percent: int = Field(25, ge=0, le=100, description="From this charge down it returns; 0: never.")
    battery_land_percent: int = Field(
        15, ge=0, le=100, description="From this charge down it lands where it is, and nobody holds that off; 0: never."
    )
    operator_degraded_s: float = Field(
        5, gt=0, le=3600, description="No word of any operator for so long: the link is called degraded."
    )
    operator_lost_s: float = Field(
        30, ge=0, le=86_400, description="No word for so long: the link is lost, and the vehicle returns; 0: never."
    )
    operator_lost_following_s: float = Field(
        30, ge=0, le=86_400, description="So much longer while a camera follows something: it is not lost for a moment."
    )
    failsafe_again_s: float = Field(
        5, ge=1, le=60, description="A vehicle that does not comply is commanded again after this: it takes time to."
    )
    fence_ahead_s: float = Field(
        2.0,
        gt=0,
        le=60,
        description="So far ahead the way may not break a fence: what a place is late by, and what turning takes.",
    )
    override_longest_s: float = Field(
        600, gt=0, le=86_400, description="A person holds a failsafe off for this at most; then it is asked for anew."
    )

    @model_validator(mode="after")
    def _in_order(self) -> SafetySection:
        """The landing comes below the return, and a link is degraded before it is lost."""
        if self.battery_land_percent and not self.battery_land_percent < self.battery_return_percent:
            raise ValueError("battery_land_percent is not below battery_return_percent")
        if self.operator_lost_s and not self.operator_degraded_s < self.operator_lost_s:
            raise ValueError("operator_degraded_s is not below operator_lost_s")
        return self


class RetentionSection(Section):
    """What of the past is deleted. Only what was pushed ever is (`autopilot flights pushed`)."""

    keep_days: float = Field(30, gt=0, le=3650, description="A pushed flight is deleted when it ended so long ago.")
    keep_newest: int = Field(
        5, ge=1, le=10_000, description="So many of the newest closed flights stay; the open one names the last's head."
    )
    min_free_mib: int = Field(
        1024, ge=0, le=1 << 30, description="Under this much free space pushed flights go earlier, the oldest first."
    )


class FindSection(Section):
    """When a sighting is worth a person's look (seed 004; facts of its source system)."""

    groups: dict[str, tuple[str, ...]] = Field(
        default_factory=lambda: {
            "person": ("person",),
            "vehicle": ("car", "truck", "bus", "motorcycle", "bicycle", "vehicle"),
            "boat": ("boat",),
            "animal": ("dog", "horse", "sheep", "cow", "animal"),
            "fire": ("fire", "smoke"),
        },
        description="Class groups; a class in no group is not observed.",
    )
    same_object_m: float = Field(8, ge=0.1, le=1000, description="Sightings nearer than this are one object.")
    same_poi_m: float = Field(15, ge=0.1, le=1000, description="Sightings nearer than this are one question.")
    ask_confidence: float = Field(0.4, ge=0, le=1, description="Below it nobody is asked.")
    asks_per_minute: int = Field(5, ge=1, le=60, description="Questions to the operator in a rolling minute.")
    decide_shortest_s: float = Field(30, gt=0, le=86_400, description="Time to decide at 40 % confidence.")
    decide_longest_s: float = Field(120, gt=0, le=86_400, description="Time to decide at 100 % confidence.")
    queue_longest_s: float = Field(300, gt=0, le=86_400, description="A question waits at most this long to be asked.")
    ask_again_s: float = Field(300, ge=0, le=86_400, description="After an expired question the place is left alone.")
    sightings_to_ask: int = Field(3, ge=1, le=1000, description="Sightings of one thing before a person is asked.")

    @model_validator(mode="after")
    def _in_order(self) -> FindSection:
        """A surer finding never gets less time than a doubtful one, and a class has one group."""
        if self.decide_shortest_s > self.decide_longest_s:
            raise ValueError("decide_shortest_s is above decide_longest_s")
        classes = [name for names in self.groups.values() for name in names]
        twice = sorted({name for name in classes if classes.count(name) > 1})
        if twice:
            raise ValueError(f"groups has {', '.join(twice)} more than once")
        return self


class ScanSection(Section):
    """Whether the node moves the camera by itself."""

    enabled: bool = Field(False, description="True: the node looks closer at what it found.")
    look_s: float = Field(4, gt=0, le=600, description="The camera rests on a finding this long.")
    sweep_pitch_deg: float = Field(-35, ge=-90, le=30, description="Pitch of the sweep, up positive.")
    frame_rate_floor: float = Field(
        10, ge=0, le=240, description="Frames a second under which it does not look closer."
    )


class LimitsSection(Section):
    """Bounds of queues and times that no user of the air needs to know."""

    inbox_orders: int = Field(256, ge=1, description="Orders waiting; the newest is refused.")
    inbox_outcomes: int = Field(1024, ge=1, description="Outcomes waiting; the adapter offers again.")
    inbox_telemetry: int = Field(512, ge=1, description="Telemetry waiting; the oldest is dropped.")
    inbox_frames: int = Field(32, ge=1, description="Frames waiting; the oldest is dropped.")
    commit_within_ms: int = Field(100, ge=1, le=1000, description="A group of records is durable within this.")
    store_retry_s: float = Field(
        30, ge=1, le=3600, description="A store that can't be opened is tried again after this."
    )
    commit_stall_s: float = Field(2.0, gt=0, description="A slower commit refuses orders until one is quick again.")
    arrival_tolerance_deg: float = Field(1.0, gt=0, le=45, description="The gimbal has arrived within this.")
    drift_deg: float = Field(2.0, gt=0, le=90, description="A gimbal that had arrived has drifted from here on.")
    drift_settle_s: float = Field(
        2.0, gt=0, le=120, description="After being off for this long: gusts and turns of the vehicle pass."
    )
    arrival_patience_s: float = Field(10, gt=0, le=120, description="It is said not to have arrived after this.")
    dedup_keep_h: float = Field(24, gt=0, le=240, description="Stored results are kept this long.")
    failures_to_safe_mode: int = Field(3, ge=1, le=1000, description="Failed steps within failure_window_s.")
    failure_window_s: float = Field(60, gt=0, le=86_400, description="Window of the failed steps.")
    own_command_life_s: float = Field(5, gt=0, le=60, description="A command of the node's own is dropped after this.")


class Config(Section):
    """The whole configuration."""

    schema_version: Literal[1] = Field(1, description="Version of this file's form.")
    node: NodeSection
    command: CommandSection = CommandSection()
    clock: ClockSection = ClockSection()
    mesh: MeshSection = MeshSection()
    vehicle: VehicleSection = VehicleSection()
    eyes: EyesSection = EyesSection()
    flight: FlightSection = FlightSection()
    safety: SafetySection = SafetySection()
    retention: RetentionSection = RetentionSection()
    find: FindSection = FindSection()
    scan: ScanSection = ScanSection()
    mission: MissionSection = MissionSection()
    limits: LimitsSection = LimitsSection()

    @property
    def commands_flight(self) -> bool:
        """Whether this node has a say in how its vehicle flies."""
        return self.flight.enabled or self.mission.enabled

    @model_validator(mode="after")
    def _has_something_to_fly(self) -> Config:
        """A mission without a vehicle would wait for ever."""
        if self.mission.enabled and not (self.vehicle.connect or self.vehicle.listen):
            raise ValueError("mission.enabled = true needs a [vehicle] with listen or connect: who flies it?")
        return self

    @model_validator(mode="after")
    def _hears_before_it_misses(self) -> Config:
        """That somebody is heard is recorded seldom: seldomer than silence is judged, it would be silence."""
        told_s, degraded_s = self.mesh.presence_period_s, self.safety.operator_degraded_s
        if self.commands_flight and self.safety.operator_lost_s and 2 * told_s > degraded_s:
            raise ValueError(
                f"mesh.presence_period_s is above {degraded_s / 2:g}: operators who are there would be taken for gone;"
                " it goes twice into safety.operator_degraded_s"
            )
        return self

    @model_validator(mode="after")
    def _looks_ahead_of_its_places(self) -> Config:
        """A fence is looked at only when a place is told: the look ahead must reach to the next one."""
        late_s = self.vehicle.position_period_s + POSITION_STREAM_S
        if self.commands_flight and self.safety.fence_ahead_s < late_s:
            raise ValueError(
                f"safety.fence_ahead_s is below {late_s:g}: places are told vehicle.position_period_s apart,"
                f" and the vehicle says them every {POSITION_STREAM_S:g} s"
            )
        return self
