"""All charts in the order in which they are asked: safety first, then orders, then findings, then the gimbal."""

from __future__ import annotations

from typing import Any

from statecharts.charts import (
    aim,
    camera,
    command_part,
    control,
    gimbals,
    health,
    mapping,
    mission_part,
    opening,
    poi_part,
    scan_part,
    selftest,
    trust,
    vehicle,
)
from statecharts.part import Evolve, Part
from statecharts.table import Chart

PARTS: tuple[Part, ...] = (
    health.PART,
    command_part.PART,
    selftest.PART,
    camera.PART,
    mapping.PART,
    poi_part.PART,
    scan_part.PART,
    mission_part.PART,
    control.PART,
    aim.PART,
)
CHARTS: tuple[Chart[Any], ...] = tuple(part.chart for part in PARTS)

# Changes of state that no chart owns.
PLAIN: tuple[dict[str, Evolve], ...] = (opening.EVOLVE, vehicle.EVOLVE, gimbals.EVOLVE, trust.EVOLVE)
