"""From the configuration to the message that the manifest carries: what decisions may know of it.

Decisions see these integers and nothing else of the configuration, so a flight replays without
the file it was flown with.
"""

from __future__ import annotations

import hashlib
import json

from autopilot.ports.config import Config
from events.schema.flight_pb2 import (
    ROI_TURNING_REFUSE,
    ROI_TURNING_WARN,
    CameraFitting,
    ClassGroup,
    Configuration,
    Limits,
)

_ROI_TURNING = {"warn": ROI_TURNING_WARN, "refuse": ROI_TURNING_REFUSE}


def configuration_message(config: Config) -> Configuration:
    """Return the effective configuration as the manifest holds it; equal configurations give equal bytes."""
    groups = sorted(config.find.groups.items())
    return Configuration(
        limits=_limits(config),
        class_groups=[ClassGroup(name=name, classes=sorted(classes)) for name, classes in groups],
        cameras=[CameraFitting(vehicle=1, camera=1, gimbal=int(config.eyes.pose is None))],
        digest=digest(config),
    )


def digest(config: Config) -> bytes:
    """Return the SHA-256 of the configuration as canonical JSON, without [node]: where its keys lie is private."""
    plain = config.model_dump(mode="json", exclude={"node"})
    return hashlib.sha256(json.dumps(plain, sort_keys=True, separators=(",", ":")).encode()).digest()


def _limits(config: Config) -> Limits:
    """Return every number that a guard reads, in the units of flight.proto."""
    command, find, scan, limits = config.command, config.find, config.scan, config.limits
    mission = config.mission
    safety = config.safety
    return Limits(
        command_enabled=command.enabled,
        camera_roles=sorted(command.camera_roles),
        flight_roles=sorted(command.flight_roles),
        operator_hold_ms=_thousandths(command.operator_hold_s),
        release_pause_ms=_thousandths(command.release_pause_s),
        arrival_tolerance_cdeg=_hundredths(limits.arrival_tolerance_deg),
        arrival_patience_ms=_thousandths(limits.arrival_patience_s),
        dedup_keep_ms=_thousandths(limits.dedup_keep_h * 3600),
        same_object_mm=_thousandths(find.same_object_m),
        same_poi_mm=_thousandths(find.same_poi_m),
        ask_confidence_e4=round(find.ask_confidence * 10_000),
        asks_per_minute=find.asks_per_minute,
        decide_shortest_ms=_thousandths(find.decide_shortest_s),
        decide_longest_ms=_thousandths(find.decide_longest_s),
        queue_longest_ms=_thousandths(find.queue_longest_s),
        ask_again_ms=_thousandths(find.ask_again_s),
        look_ms=_thousandths(scan.look_s),
        frame_rate_floor_mhz=_thousandths(scan.frame_rate_floor),
        sweep_pitch_cdeg=_hundredths(scan.sweep_pitch_deg),
        scan_enabled=scan.enabled,
        failures_to_safe_mode=limits.failures_to_safe_mode,
        failure_window_ms=_thousandths(limits.failure_window_s),
        sightings_to_ask=find.sightings_to_ask,
        overdue_camera_ms=_thousandths(command.overdue_camera_h * 3600),
        overdue_flight_ms=_thousandths(command.overdue_flight_h * 3600),
        own_command_life_ms=_thousandths(limits.own_command_life_s),
        mission_enabled=mission.enabled,
        mission_begun_by_order=mission.begin == "order",
        pilot_starts=mission.start == "pilot",
        mission_tries=mission.tries,
        mission_step_ms=_thousandths(mission.step_s),
        selftest_acknowledge_ms=_thousandths(mission.acknowledge_s),
        upload_ms=_thousandths(mission.upload_s),
        follow_by_waypoint=mission.follow_by_waypoint,
        push_ms=_thousandths(mission.push_s) if mission.enabled and mission.url else 0,
        mission_pitch_cdeg=_hundredths(mission.camera_pitch_deg),
        roi_turning=_ROI_TURNING[command.roi_turns_vehicle],
        take_from_others=command.take_from_others,
        drift_cdeg=_hundredths(limits.drift_deg),
        drift_settle_ms=_thousandths(limits.drift_settle_s),
        flight_enabled=config.flight.enabled,
        battery_return_percent=safety.battery_return_percent,
        battery_land_percent=safety.battery_land_percent,
        operator_degraded_ms=_thousandths(safety.operator_degraded_s),
        operator_lost_ms=_thousandths(safety.operator_lost_s),
        operator_lost_following_ms=_thousandths(safety.operator_lost_following_s),
        failsafe_again_ms=_thousandths(safety.failsafe_again_s),
        fence_ahead_ms=_thousandths(safety.fence_ahead_s),
        override_longest_ms=_thousandths(safety.override_longest_s),
    )


def _thousandths(value: float) -> int:
    """Return a value in 1e-3 of its unit."""
    return round(value * 1000)


def _hundredths(value: float) -> int:
    """Return a value in 1e-2 of its unit."""
    return round(value * 100)
