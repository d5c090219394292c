"""What a flight runs on and can run out of: the battery and the satellites. Both are there to be edited.

Charge goes with time and thrust, and voltage sags with charge and load. A receiver says where the
aircraft is; moved by `jump_east_m` it says so wrongly, and the autopilot believes it.
"""

from __future__ import annotations

from dataclasses import dataclass

CELLS = 4
EMPTY_MV, FULL_MV = 3_400, 4_180  # of a cell without load
SAG_MV_A = 3.0  # of a cell, for each ampere


@dataclass(slots=True)
class Battery:
    """`battery.charge_percent = 12` is all that a low battery takes."""

    charge_percent: float = 96.0
    capacity_ah: float = 10.0
    idle_a: float = 0.5
    hover_a: float = 22.0
    climb_a: float = 4.0  # more for each metre a second up
    wind_a: float = 0.4  # more for each metre a second of wind
    current_a: float = 0.5
    drawn_mah: float = 0.0

    def step(self, dt_s: float, flying: bool, up_m_s: float, wind_m_s: float) -> None:
        """Draw for a time."""
        self.current_a = self.idle_a
        if flying:
            self.current_a += self.hover_a + self.climb_a * max(up_m_s, 0.0) + self.wind_a * wind_m_s
        drawn_ah = self.current_a * dt_s / 3600
        self.drawn_mah += drawn_ah * 1000
        self.charge_percent = max(self.charge_percent - drawn_ah / self.capacity_ah * 100, 0.0)

    @property
    def cell_mv(self) -> int:
        """Voltage of a cell under the present load."""
        resting_mv = EMPTY_MV + (FULL_MV - EMPTY_MV) * self.charge_percent / 100
        return round(resting_mv - SAG_MV_A * self.current_a)

    @property
    def remaining_percent(self) -> int:
        """Charge as it is told, whole percent."""
        return min(max(round(self.charge_percent), 0), 100)


@dataclass(slots=True)
class Gps:
    """A receiver of satellites' signals."""

    fix: int = 3  # GPS_FIX_TYPE
    satellites: int = 14
    jump_east_m: float = 0.0  # how far beside the truth
    jump_north_m: float = 0.0

    @property
    def good(self) -> bool:
        """Whether one can fly by it."""
        return self.fix >= 3
