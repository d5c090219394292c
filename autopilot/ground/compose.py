"""Orders as people think of them, made into the seed's DeviceCommand.

Ranges are the node's to judge; here only units are turned into the wire's.
"""

from __future__ import annotations

from events.schema.waypoint_pb2 import CameraPitchYaw, CameraRelease, CameraRoi, DeviceCommand, PoiConfirm, PoiDecline


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


def release(camera: int = 1) -> DeviceCommand:
    """Give a camera back."""
    return DeviceCommand(camera_release=CameraRelease(camera=camera))


def judge(poi_id: str, *, confirmed: bool) -> DeviceCommand:
    """Confirm a finding, or decline it."""
    if confirmed:
        return DeviceCommand(poi_confirm=PoiConfirm(poi_id=poi_id))
    return DeviceCommand(poi_decline=PoiDecline(poi_id=poi_id))
