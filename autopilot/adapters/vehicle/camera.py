"""What the link's camera can do and how far it is zoomed in (MAVLink guide, Camera Protocol v2).

CAMERA_INFORMATION is asked for until it comes, of every component: an autopilot that drives a camera answers for it,
a camera with an id of its own for itself. ArduPilot without a camera accepts the request and sends nothing.
CAMERA_SETTINGS is asked for once it is known that there is a zoom, and after each zoom that was accepted.

Plain values in, observations out where something changed; no socket, no clock, no encoding.
"""

from __future__ import annotations

from autopilot.adapters.vehicle.heard import CameraInformation, CameraSettings, Sender
from autopilot.adapters.vehicle.upkeep import Stream
from events.schema.vehicle_pb2 import CameraDescribed, CameraZoomed


class CameraWatch:
    """One camera of one vehicle."""

    def __init__(self) -> None:
        self._information = Stream(once=True)
        self._settings = Stream(once=True)
        self._described: CameraDescribed | None = None
        self._zoomed: CameraZoomed | None = None
        self.sender: Sender | None = None  # who answers for the camera, and takes its commands

    def reset(self, now_ns: int) -> None:
        """Begin again: the vehicle is new, or came back. Everything is said again."""
        self._information.reset(now_ns)
        self._settings.reset(now_ns)
        self._described = self._zoomed = self.sender = None

    def described(self, now_ns: int, heard: CameraInformation) -> CameraDescribed | None:
        """Take what a camera tells of itself; return it where it is news. The first that tells is the camera."""
        if self.sender not in (None, heard.sender):
            return None
        self.sender = heard.sender
        self._information.heard(now_ns)
        said = CameraDescribed(vehicle=1, camera=1, zooms=heard.zooms)
        if said == self._described:
            return None
        self._described = said
        self._settings.reset(now_ns)
        return said

    def zoomed(self, now_ns: int, heard: CameraSettings) -> CameraZoomed | None:
        """Take how a camera is set; return how far it is zoomed in, where that is news."""
        if heard.sender != self.sender or heard.zoom_percent is None:
            return None
        self._settings.heard(now_ns)
        said = CameraZoomed(vehicle=1, camera=1, zoom_e4=round(heard.zoom_percent * 100))
        if said == self._zoomed:
            return None
        self._zoomed = said
        return said

    def ask_settings(self, now_ns: int) -> None:
        """Ask how the camera is set with the next turn: it was told to zoom."""
        self._settings.reset(now_ns)

    def asks_information(self, now_ns: int) -> bool:
        """Return whether to ask for CAMERA_INFORMATION now."""
        return self._information.tick(now_ns)

    def asks_settings(self, now_ns: int) -> bool:
        """Return whether to ask for CAMERA_SETTINGS now."""
        return self._has_zoom() and self._settings.tick(now_ns)

    def due_ns(self) -> int | None:
        """Return when one of them may have to be asked for, or None."""
        streams = (self._information, self._settings) if self._has_zoom() else (self._information,)
        return min((due for stream in streams if (due := stream.due_ns()) is not None), default=None)

    def _has_zoom(self) -> bool:
        return self._described is not None and self._described.zooms
