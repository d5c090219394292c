"""Orders as people think of them, made into the seed's DeviceCommand.

Ranges are the node's to judge; here only units are turned into the wire's.
"""

from __future__ import annotations

from events.schema.waypoint_pb2 import (
    CameraPitchYaw,
    CameraRelease,
    CameraRoi,
    CameraZoom,
    DeviceCommand,
    FlyToWaypoint,
    MissionCommand,
    PoiConfirm,
    PoiDecline,
    PoiFollow,
    SafetyOverride,
    SelftestAcknowledge,
    SetFlightMode,
)


def point_at_place(latitude_deg: float, longitude_deg: float, altitude_m: float, camera: int = 1) -> DeviceCommand:
    """Point a camera at a place; WGS84 degrees, altitude above mean sea level."""
    roi = CameraRoi(lat_e7=round(latitude_deg * 1e7), lon_e7=round(longitude_deg * 1e7), camera=camera)
    roi.altitude_dm = round(altitude_m * 10)
    return DeviceCommand(camera_roi=roi)


def point_at_angles(pitch_deg: float, yaw_deg: float, *, north: bool = False, camera: int = 1) -> DeviceCommand:
    """Point a camera by angles: pitch up positive; yaw clockwise from the nose, or from north and held there."""
    yaw_cdeg = round(yaw_deg * 100) % 36_000
    angles = CameraPitchYaw(pitch_cdeg=round(pitch_deg * 100), yaw_cdeg=yaw_cdeg, yaw_locked=north, camera=camera)
    return DeviceCommand(camera_pitch_yaw=angles)


def zoom(zoom_percent: float, camera: int = 1) -> DeviceCommand:
    """Zoom a camera to a share of its whole range, in percent: 0 is widest."""
    return DeviceCommand(camera_zoom=CameraZoom(zoom_e4=round(zoom_percent * 100), camera=camera))


def release(camera: int = 1) -> DeviceCommand:
    """Give a camera back."""
    return DeviceCommand(camera_release=CameraRelease(camera=camera))


def judge(poi_id: str, *, confirmed: bool) -> DeviceCommand:
    """Confirm a finding, or decline it."""
    if confirmed:
        return DeviceCommand(poi_confirm=PoiConfirm(poi_id=poi_id))
    return DeviceCommand(poi_decline=PoiDecline(poi_id=poi_id))


def follow(poi_id: str, camera: int = 1) -> DeviceCommand:
    """Keep a confirmed finding in view."""
    return DeviceCommand(poi_follow=PoiFollow(poi_id=poi_id, camera=camera))


def fly(latitude_deg: float, longitude_deg: float, altitude_m: float) -> DeviceCommand:
    """Fly to a place and stay there; WGS84 degrees, altitude above mean sea level."""
    to = FlyToWaypoint(lat_e7=round(latitude_deg * 1e7), lon_e7=round(longitude_deg * 1e7))
    to.altitude_dm = round(altitude_m * 10)
    return DeviceCommand(fly_to_waypoint=to)


def flight_mode(mode: str) -> DeviceCommand:
    """Put the vehicle into "return", "loiter", "guided" or "land"."""
    return DeviceCommand(set_flight_mode=SetFlightMode(mode=mode))


def override(scope: str, held_for_s: float, reason: str) -> DeviceCommand:
    """Hold "battery_return", "link_return" or "fence_return" off for so long, and say why."""
    return DeviceCommand(
        safety_override=SafetyOverride(scope=scope, held_for_ms=round(held_for_s * 1000), reason=reason)
    )


def acknowledge(report_id: int) -> DeviceCommand:
    """Take on a self-test that came out degraded, by the number of its report."""
    return DeviceCommand(selftest_acknowledge=SelftestAcknowledge(report_id=report_id))


def mission(verb: str) -> DeviceCommand:
    """Let the mission "begin", "pause", "resume" or "abort"."""
    return DeviceCommand(mission_command=MissionCommand(verb=verb))
