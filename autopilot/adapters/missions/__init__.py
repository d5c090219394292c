"""The mission office's adapter: fetches the mission and has it planned, and asks for waypoints in its middle."""

from autopilot.adapters.missions.adapter import MissionsAdapter as MissionsAdapter
from autopilot.adapters.missions.messages import Home as Home
