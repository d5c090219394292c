"""The mission office's adapter: fetches the mission and has it planned, and asks for waypoints in its middle."""

from autopilot.adapters.missions.adapter import Home as Home
from autopilot.adapters.missions.adapter import MissionsAdapter as MissionsAdapter
