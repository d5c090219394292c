"""The section [vehicle] of the configuration (`autopilot.ports.config`)."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from autopilot.ports.addresses import parse, parse_listening
from autopilot.ports.section import Section


class VehicleSection(Section):
    """The MAVLink link. Without `listen` or `connect` the node has no vehicle."""

    connect: str = Field(
        "",
        description="Peer: host:port, udp://host:port, tcp://host:port, serial:///device:baud; the node speaks first.",
    )
    listen: str = Field("", description="Own address as udp://host:port (or host:port); the peer speaks first.")
    reconnect_s: float = Field(1.0, gt=0, le=60, description="Wait before TCP or a serial device is opened again.")
    signing: Literal["off", "required"] = Field(
        "off", description='"required": MAVLink 2 signatures on everything sent, and nothing taken without one.'
    )
    signing_key_file: str = Field("", description="File with the link's 32 secret bytes, 0600; for signing = required.")
    system_id: int = Field(1, ge=1, le=255, description="Vehicle's system id, adopted from the only autopilot heard.")
    component_id: int = Field(191, ge=1, le=255, description="Own component id (onboard computer).")
    answer_timeout_s: float = Field(0.7, gt=0, le=10, description="Wait for COMMAND_ACK before sending again.")
    attempts: int = Field(3, ge=1, le=10, description="How often a harmless command is sent.")
    in_progress_timeout_s: float = Field(3.0, gt=0, le=60, description="Wait after IN_PROGRESS.")
    in_progress_longest_s: float = Field(
        60, gt=0, le=3600, description="A command that is in progress for longer than this is given up."
    )
    late_answer_s: float = Field(
        3.0,
        ge=0,
        le=60,
        description="An answer may come this late (a link of 2 s, and some): none of its kind is believed till then.",
    )
    mission_timeout_s: float = Field(1.5, gt=0, le=60, description="Mission protocol: wait before it is said again.")
    mission_item_timeout_s: float = Field(
        0.25, gt=0, le=60, description="Mission protocol: the same for an item; it doubles with each retry."
    )
    mission_retries: int = Field(5, ge=0, le=8, description="Mission protocol: how often it is said again.")
    mission_rest_s: float = Field(
        5.0, ge=0, le=60, description="Rest before an upload is begun again: twice a link of 2 s, and some."
    )
    mission_items_max: int = Field(700, ge=1, le=65_000, description="Items of a mission; ArduPilot keeps some 700.")
    link_timeout_s: float = Field(5.0, gt=0, le=60, description="Silence after which the vehicle is gone.")
    position_period_s: float = Field(0.5, gt=0, le=60, description="A position is recorded at most this often.")
    position_threshold_m: float = Field(
        2.0, ge=0, le=1000, description="A move is recorded from here on: what GPS wanders while it stands."
    )
    heading_threshold_deg: float = Field(5.0, ge=0, le=180, description="A turn is recorded from here on.")
    gimbal_threshold_deg: float = Field(0.5, gt=0, le=90, description="A gimbal's move is recorded from here on.")
    gimbal_measures: bool | None = Field(
        None,
        description="Whether what is reported of the gimbal is measured. Absent: yes, unless an ArduPilot reports it "
        "by itself, which may be a servo mount.",
    )
    say_again_s: float = Field(
        60, gt=0, le=3600, description="What stands still is recorded this often, so that silence means a gap."
    )
    time_threshold_ms: float = Field(
        20, gt=0, le=10_000, description="A move of the vehicle's clock against ours is recorded from here on."
    )
    raw: bool = Field(True, description="Both directions are written to .tlog files in the flight's folder.")
    raw_segment_mib: int = Field(16, ge=1, le=4096, description="A .tlog file is closed at this size.")
    raw_segment_s: float = Field(300, gt=0, le=86_400, description="A .tlog file is closed at this age.")
    raw_min_free_mib: int = Field(
        2048, ge=0, le=1 << 30, description="Under this much free space raw stops, before anything else has to."
    )

    @model_validator(mode="after")
    def _reachable(self) -> VehicleSection:
        """Say which key names no address, and that a key without signing (and the other way round) is a mistake."""
        if self.connect and self.listen:
            raise ValueError("listen is given, and connect too: the node speaks first, or the vehicle does")
        for key, text, read in (("connect", self.connect, parse), ("listen", self.listen, parse_listening)):
            if text:
                try:
                    read(text)
                except ValueError as error:
                    raise ValueError(f"{key} = {error}") from error
        if self.signing == "required" and not self.signing_key_file:
            raise ValueError('signing_key_file is missing: signing = "required" needs it')
        if self.signing == "off" and self.signing_key_file:
            raise ValueError('signing_key_file is given, but signing = "off": write signing = "required"')
        return self
