"""The stage of the demo's second act: as the first, with a mission office, and an aircraft that flies what it is told.

The mission lies around the simulated home: a waypoint, a region to search with a hole in it, and the way back.
"""

from __future__ import annotations

import http.client
import json
import socket
import sys
import uuid
from pathlib import Path
from typing import Any

from autopilot.cli.demonstration.stage import Process, Stage
from autopilot.geo.frame import offset
from autopilot.sim.aircraft import HOME

Polygon = tuple[tuple[float, float], ...]

SPEED_UP = 3.0
LATE_ANSWER_S = 3.0  # in the world's time: a copter that is armed and does nothing disarms itself after 10 s of it
HEIGHT_M = 30.0
MISSION = uuid.uuid5(uuid.NAMESPACE_URL, "autopilot demo mission")
REGION_M = ((20.0, 20.0), (110.0, 20.0), (110.0, 90.0), (20.0, 90.0))  # east, north of home
INCLUSION_M = ((-40.0, -40.0), (150.0, -40.0), (150.0, 130.0), (-40.0, 130.0))
EXCLUSION_M = ((58.0, 48.0), (70.0, 48.0), (70.0, 60.0), (58.0, 60.0))

_CONFIG = """
[flight]
enabled = true

[mission]
enabled = true
url = "http://127.0.0.1:{office}"
mission_id = "{mission}"
step_s = 10
retry_first_s = 0.5
"""


class MissionStage(Stage):
    """Folder, cast and processes of the second act."""

    def __init__(
        self,
        folder: Path,
        seed: int,
        *,
        personality: str = "ardupilot",
        frame: str = "copter",
        speed_up: float = SPEED_UP,
        flies: dict[str, Any] | None = None,
    ) -> None:
        """Make everything that lies in files; `flies` is another mission. Raises DirectoryError and OSError."""
        flown_by = ["--pilot", "node", "--personality", personality, "--frame", frame]
        super().__init__(folder, 60, seed, flown_by=[*flown_by, "--speed-up", f"{speed_up:g}"], door=True)
        self.mission = folder / "mission.json"
        self.mission.write_text(json.dumps(flies or mission(), indent=1))
        text = self.config.read_text()
        text = text.replace("[command]\n", '[command]\nflight_roles = ["supervisor"]\n')
        text = text.replace(
            "[scan]\nenabled = true", "[scan]\nenabled = false"
        )  # it searches, and looks at nothing else
        text = text.replace("[vehicle]\n", f"[vehicle]\nlate_answer_s = {LATE_ANSWER_S / speed_up:g}\n")
        self.config.write_text(text + _CONFIG.format(office=self.ports.office, mission=MISSION))
        office = [sys.executable, "-m", "autopilot.sim.office", "--port", str(self.ports.office), str(self.mission)]
        self.office = Process("mission office", office, folder / "logs" / "office.log", ready="ready")

    def ask_world(self, order: dict[str, Any]) -> dict[str, Any]:
        """Ask the simulated world at its door (`sim.door`), or change it; return its answer. Raises OSError."""
        with socket.create_connection(("127.0.0.1", self.ports.door), timeout=10) as door, door.makefile("rw") as lines:
            lines.write(json.dumps(order) + "\n")
            lines.flush()
            answer: dict[str, Any] = json.loads(lines.readline())
            return answer

    def seen_percent(self) -> float:
        """Return how much of the region the camera has truly seen, in percent. Raises OSError."""
        corners = [[corner["latitude"], corner["longitude"]] for corner in (_at(*one) for one in REGION_M)]
        return 100 * float(self.ask_world({"coverage": corners})["coverage"])

    def with_the_office(self) -> tuple[int, int]:
        """Return how many observations and ignored items the mission office has. Raises OSError."""
        office = http.client.HTTPConnection("127.0.0.1", self.ports.office, timeout=10)
        try:
            office.request("GET", f"/missions/{MISSION}/mapobjects")
            kept: dict[str, Any] = json.loads(office.getresponse().read())
        finally:
            office.close()
        return len(kept["observations"]), len(kept["ignored_items"])

    @property
    def processes(self) -> tuple[Process, ...]:
        """All processes in the order in which they start."""
        return self.router, self.world, self.office, self.node


def mission(
    first_m: tuple[float, float] = (10.0, 10.0),
    region_m: Polygon = REGION_M,
    inclusion_m: Polygon = INCLUSION_M,
    exclusion_m: Polygon = EXCLUSION_M,
) -> dict[str, Any]:
    """Return a mission as the office hands it out; east and north of home."""
    items: list[dict[str, Any]] = [
        {"kind": "waypoint", "at": _at(*first_m), "cruise_speed_mps": 8},
        {"kind": "region_search", "region": [_at(*corner) for corner in region_m]},
        {"kind": "return"},
    ]
    named = [{"id": str(uuid.uuid5(MISSION, str(number))), **item} for number, item in enumerate(items)]
    fences = [("INCLUSION", inclusion_m), ("EXCLUSION", exclusion_m)]
    return {
        "schema_version": "1.0.0",
        "mission_id": str(MISSION),
        "items": named,
        "geofences": [{"kind": kind, "vertices": [place(*one) for one in corners]} for kind, corners in fences],
        "return_point": _at(0, 0),
    }


def place(east_m: float, north_m: float) -> dict[str, float]:
    """Return a place of the simulated world by its metres from home."""
    latitude, longitude = offset(HOME[0], HOME[1], east_m, north_m)
    return {"latitude": round(latitude, 7), "longitude": round(longitude, 7)}


def _at(east_m: float, north_m: float) -> dict[str, float]:
    return place(east_m, north_m) | {"altitude_m": HEIGHT_M}
