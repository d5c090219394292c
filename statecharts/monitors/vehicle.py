"""Who tells the vehicle how to fly, and when nobody does."""

from __future__ import annotations

from events.schema.common_pb2 import Moved
from events.schema.flight_pb2 import Limits
from events.schema.vehicle_pb2 import VehicleLinkChanged
from statecharts.monitors.monitor import Monitor, Said, Step, moves_of, order_of

# Whatever changes how the vehicle flies.
FLYING = ("set_vehicle_mode", "fly_to_place", "arm_vehicle", "start_mission", "set_mission_item", "upload_mission")
_MAY_WISH = ("safety", "mission")  # charts that command without an order


class SafeModeIsQuiet(Monitor):
    """In safe mode nothing is asked of the vehicle but what failsafes and the mission demand, and nothing of people."""

    kinds = ("moved", "poi_opened", "point_at_place", "point_at_angles", "release_pointing", *FLYING)

    def __init__(self, limits: Limits, whole: bool) -> None:
        super().__init__(limits, whole)
        self._safe = False

    def look(self, step: Step) -> Said:
        """See what is asked."""
        for move in moves_of(step, "health"):
            self._safe = move.to_state == "safe_mode"
        if not self._safe:
            return
        for record in step:
            wished = record.kind.name in FLYING and not order_of(record)
            if (record.kind.port == "vehicle" and not wished) or record.kind.name == "poi_opened":
                yield "safe_mode_is_quiet", f"record {record.seq}: {record.kind.name} in safe mode"


class FlightIsOff(Monitor):
    """Nothing is asked of the flight where neither orders of it nor missions are switched on."""

    kinds = FLYING

    def look(self, step: Step) -> Said:
        """See whether it may."""
        if self.limits.flight_enabled or self.limits.mission_enabled:
            return
        for record in step:
            if record.kind.name in FLYING:
                yield "flight_is_off", f"record {record.seq}: {record.kind.name} on a node that has no say"


class SilentVehicleIsLeftAlone(Monitor):
    """Nothing is asked of the flight of a vehicle that is not heard."""

    kinds = ("vehicle_link_changed", "node_started", *FLYING)

    def __init__(self, limits: Limits, whole: bool) -> None:
        super().__init__(limits, whole)
        self._up: dict[int, bool] = {}

    def look(self, step: Step) -> Said:
        """Follow the link."""
        change = step[0].message
        if isinstance(change, VehicleLinkChanged):
            self._up[change.vehicle] = change.up
        elif step[0].kind.name == "node_started":
            self._up.clear()
        for record in step:
            if record.kind.name in FLYING and not self._up.get(record.message.vehicle):  # type: ignore[attr-defined]
                yield "silent_vehicle_is_left_alone", f"record {record.seq}: {record.kind.name} to a silent vehicle"


class NobodyElseFlies(Monitor):
    """The flight is changed by a failsafe or the mission, whose move comes before, or by an order."""

    kinds = FLYING

    def look(self, step: Step) -> Said:
        """Look for who wishes."""
        wishing = False
        for record in step:
            if isinstance(change := record.message, Moved):
                wishing = wishing or change.chart in _MAY_WISH
            if record.kind.name in FLYING and not order_of(record) and not wishing:
                yield "nobody_else_flies", f"record {record.seq}: {record.kind.name}, and nobody wished it"


VEHICLE: tuple[type[Monitor], ...] = (SafeModeIsQuiet, FlightIsOff, SilentVehicleIsLeftAlone, NobodyElseFlies)
