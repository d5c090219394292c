"""What of the state a record may write: for replaying a copy of a flight in which some records can't be read.

The names are those of the tables of `statecharts.state.State`; deadlines count by chart. A test holds what is written
in every flight that the tests know against this table.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from events.kinds import kind_numbered
from events.records import Stored
from statecharts.charts import PARTS
from statecharts.part import Part

# Kinds that are not named here change nothing. The manifest is never removed.
MAY_WRITE: dict[str, tuple[str, ...]] = {
    "baseline_carried": (
        "orders",
        "owed_acks",
        "nonces",
        "order_seqs",
        "objects",
        "grid",
        "ignored",
        "origin",
        "lists",
        "trusted",
        "missions",
        "plans",
        "vehicles",
        "fences",
        "overrides",
        "deadlines/override",
    ),
    "node_started": ("vehicles", "whereabouts", "missions", "deadlines/aim", "deadlines/mission"),
    "origin_set": ("origin",),
    "step_failed": ("failures",),
    "order_received": ("arrival", "nonces", "orders", "owed_acks", "forgot_ns", "links", "deadlines/link"),
    "order_malformed": ("nonces", "orders", "owed_acks", "forgot_ns", "links", "deadlines/link"),
    "operator_heard": ("links", "deadlines/link"),
    "send_ack": ("orders", "owed_acks"),
    "ack_published": ("owed_acks",),
    "point_at_place": ("effects", "pois", "scans", "deadlines/scan", "aims", "deadlines/aim"),
    "point_at_angles": ("effects", "aims", "deadlines/aim"),
    "release_pointing": ("effects", "aims"),
    "set_zoom": ("effects",),
    "command_answered": ("effects", "orders", "missions"),
    "command_unanswered": ("effects", "missions"),
    "vehicle_state_reported": ("vehicles", "links", "missions", "deadlines/link", "deadlines/mission"),
    "position_reported": ("whereabouts",),
    "battery_reported": ("batteries",),
    "home_reported": ("vehicles",),
    "override_begun": ("overrides", "deadlines/override", "deadlines/safety"),
    "override_ended": ("overrides", "deadlines/override"),
    "vehicle_link_changed": ("vehicles", "whereabouts", "deadlines/mission"),
    "gimbal_reported": ("aims", "deadlines/aim"),
    "gimbal_described": ("gimbals",),
    "gimbal_control_changed": ("controls",),
    "camera_described": ("lenses",),
    "frame_observed": ("frame", "scans"),
    "sightings_classified": ("objects", "grid", "pois", "ignored"),
    "poi_opened": ("pois", "open_pois", "objects", "deadlines/poi"),
    "poi_joined": ("objects",),
    "poi_left": ("objects",),
    "sighting_muted": ("objects", "ignored"),
    "item_ignored": ("ignored",),
    "camera_taken": ("cameras",),
    "revocations_taken": ("lists", "trusted"),
    "root_taken": ("trusted",),
    "epoch_taken": ("trusted",),
    "time_learned": ("trusted",),
    "mission_planned": ("plans", "fences", "missions"),
    "mission_uploaded": ("missions",),
    "mission_upload_failed": ("missions", "deadlines/mission"),
    "mission_progress_reported": ("missions",),
    "waypoint_posted": ("missions",),
    "fetch_mission": ("missions",),
    "post_waypoint": ("missions",),
    "upload_mission": ("missions",),
    "arm_vehicle": ("missions",),
    "start_mission": ("missions",),
    "push_observations": ("missions",),
    "set_vehicle_mode": ("missions", "effects"),
    "fly_to_place": ("effects",),
    "run_selftest": ("selftests",),
}
# A move writes what its chart keeps.
MOVE_WRITES: dict[str, tuple[str, ...]] = {
    "health": ("health", "failures"),
    "link": ("links", "deadlines/link"),
    "safety": ("failsafes", "deadlines/safety"),
    "override": (),
    "command": ("orders", "order_seqs", "deadlines/command", "missions"),
    "camera": ("cameras", "deadlines/camera"),
    "map": (),
    "poi": ("pois", "open_pois", "surfacings", "deadlines/poi"),
    "scan": ("scans", "deadlines/scan", "missions"),
    "selftest": ("selftests", "deadlines/selftest"),
    "mission": ("missions", "deadlines/mission"),
    "control": ("controls",),
    "aim": ("aims", "deadlines/aim"),
}


def may_write(stored: Stored, chart: str, recorded: Sequence[Stored]) -> tuple[str, ...]:
    """Return the tables that a record of a step may write.

    A move writes those of its chart; where that is not known (""), of every chart that may have moved in this step.
    """
    name = kind_numbered(stored.kind_number).name
    if name != "moved":
        return MAY_WRITE.get(name, ())
    charts = (chart,) if chart else tuple(part.chart.name for part in _asked(recorded))
    return tuple(table for one in charts for table in MOVE_WRITES[one])


def _asked(recorded: Sequence[Stored]) -> list[Part]:
    """Return the charts that heard of a step: of its observation, or of a decision of a chart before them."""
    first, *decisions = (kind_numbered(stored.kind_number).name for stored in recorded)
    heard: set[Any] = {first, "step_failed"} if "step_failed" in decisions else {first}
    asked: list[Part] = []
    for part in PARTS:
        if part.alphabet & heard:
            asked.append(part)
            heard.update(decisions)
    return asked
