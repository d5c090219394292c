"""What the vehicle says of its flight, as observations, and as plain facts for the self-test.

Reported is what changed, and everything in full when the vehicle came (back): the state of its heartbeat with what its
mode means, the battery by 1 % of its charge (or of its voltage where it knows no charge), home when it moved by more
than `position_threshold_m`, and the progress in the plan's own numbers. ArduPilot has home at 0, so its item 1 is the
plan's 0. MISSION_ITEM_REACHED skips a waypoint that is followed by a DO item; so what is reached is a lower bound, and
the core takes the item before the current one too.

Nothing here sends or decides.
"""

from __future__ import annotations

import math

from google.protobuf.message import Message

from autopilot.adapters.vehicle.heard import Battery, Current, Fix, Flown, Heartbeat, Home, Landed, Reached, Reception
from autopilot.adapters.vehicle.modes import Kind, flight_mode
from autopilot.adapters.vehicle.telemetry import M_PER_E7, MakePlace
from autopilot.ports.config import VehicleSection
from autopilot.ports.edges import VehicleFacts
from events.schema.mission_pb2 import MissionProgressReported
from events.schema.safety_pb2 import BatteryReported, HomeReported
from events.schema.vehicle_pb2 import VehicleStateReported


class Reports:
    """One vehicle's; each method returns what is news, or None."""

    def __init__(self, settings: VehicleSection, place: MakePlace) -> None:
        self._settings = settings
        self._place = place
        self.begin()

    def begin(self) -> None:
        """Report everything with its next message: the vehicle is there, or gone, or there again."""
        self.kind: Kind | None = None
        self.armed = False
        self.home_is_told = False
        self._heartbeat: Heartbeat | None = None
        self._landed: int | None = None
        self._state: VehicleStateReported | None = None
        self._charge_percent: int | None = None
        self._voltage_mv: int | None = None
        self._spoken = False  # SYS_STATUS knows the charge, so BATTERY_STATUS is not asked
        self._battery: BatteryReported | None = None
        self._home: Home | None = None
        self._reception: Reception | None = None
        self._heard_ns: dict[str, int] = {}
        self._current: int | None = None
        self._reached: int | None = None
        self._progress: MissionProgressReported | None = None

    @property
    def state(self) -> VehicleStateReported | None:
        """What was reported of the vehicle's state."""
        return self._state

    def note(self, now_ns: int, what: str) -> None:
        """Note that something was heard which others report."""
        self._heard_ns[what] = now_ns

    def facts(self, now_ns: int) -> VehicleFacts:
        """Return what is known of the vehicle now."""
        reception, home = self._reception, self._home
        return VehicleFacts(
            linked=self._heartbeat is not None,
            commandable=self.kind is not None and self.kind.family.has_modes,
            armed=self.armed,
            fix_type=None if reception is None else reception.fix_type,
            satellites=None if reception is None else reception.satellites,
            hdop_e2=None if reception is None else reception.hdop_e2,
            charge_percent=self._charge_percent,
            voltage_mv=self._voltage_mv,
            home=None if home is None else (home.latitude_e7 / 1e7, home.longitude_e7 / 1e7, home.altitude_mm / 1000),
            heard_ms_ago={name: (now_ns - at_ns) // 1_000_000 for name, at_ns in self._heard_ns.items()},
        )

    def heartbeat(self, now_ns: int, heard: Heartbeat) -> VehicleStateReported | None:
        """Take a heartbeat of the vehicle."""
        self._heard_ns["heartbeat"] = now_ns
        self._heartbeat, self.armed = heard, heard.armed
        self.kind = Kind(autopilot=heard.autopilot, vehicle_type=heard.vehicle_type)
        return self._state_is()

    def flown(self, now_ns: int, heard: Flown | Fix) -> Message | None:
        """Take anything else that it says of its flight."""
        self._heard_ns[type(heard).__name__.lower()] = now_ns
        match heard:
            case Reception():
                self._reception = heard
            case Fix():
                self._reception = heard.reception
            case Landed():
                self._landed = heard.landed_state
                return self._state_is()
            case Battery():
                return self._battery_is(heard)
            case Home():
                return self._home_is(heard)
            case Current():
                self._current = self._of_plan(heard.seq) if heard.begun else None
                return self._progress_is()
            case Reached():
                reached = self._of_plan(heard.seq)
                if reached is not None:
                    self._reached = max(reached, self._reached or 0)
                return self._progress_is()
        return None

    def mission_begins(self) -> None:
        """What was reached before is of another mission, or another flight of it."""
        self._reached = None

    def _state_is(self) -> VehicleStateReported | None:
        heard, kind = self._heartbeat, self.kind
        if heard is None or kind is None:
            return None
        state = VehicleStateReported(
            vehicle=1,
            system_id=heard.sender.system,
            autopilot=heard.autopilot,
            vehicle_type=heard.vehicle_type,
            armed=heard.armed,
            custom_mode=heard.custom_mode,
            landed_state=self._landed,
            flight_mode=flight_mode(kind, heard.custom_mode),
        )
        if state == self._state:
            return None
        self._state = state
        return state

    def _battery_is(self, heard: Battery) -> BatteryReported | None:
        if heard.whole:
            self._spoken = heard.charge_percent is not None
        elif self._spoken:
            return None
        self._charge_percent = heard.charge_percent
        self._voltage_mv = heard.voltage_mv if heard.voltage_mv is not None else self._voltage_mv
        told = BatteryReported(vehicle=1, charge_percent=self._charge_percent, voltage_mv=self._voltage_mv)
        if self._battery is not None and not _drained(self._battery, told):
            return None
        self._battery = told
        return told

    def _home_is(self, heard: Home) -> HomeReported | None:
        if self._home is not None and _apart_m(self._home, heard) <= self._settings.position_threshold_m:
            return None
        place = self._place(heard.latitude_e7 / 1e7, heard.longitude_e7 / 1e7, heard.altitude_mm / 1000)
        if place is None:
            return None
        self._home, self.home_is_told = heard, True
        return HomeReported(vehicle=1, place=place)

    def _of_plan(self, seq: int) -> int | None:
        """Return the plan's index of a vehicle's number; None for ArduPilot's home."""
        index = seq - (1 if self.kind is not None and self.kind.family.is_ardupilot else 0)
        return index if index >= 0 else None

    def _progress_is(self) -> MissionProgressReported | None:
        progress = MissionProgressReported(vehicle=1, current_item=self._current, reached_item=self._reached)
        if progress == self._progress:
            return None
        self._progress = progress
        return progress


def _drained(before: BatteryReported, now: BatteryReported) -> bool:
    """Whether a battery is another one by 1 %."""
    if before.HasField("charge_percent") or now.HasField("charge_percent"):
        both = before.HasField("charge_percent") and now.HasField("charge_percent")
        return not both or before.charge_percent != now.charge_percent
    if not before.HasField("voltage_mv"):
        return now.HasField("voltage_mv")
    return abs(now.voltage_mv - before.voltage_mv) * 100 >= before.voltage_mv


def _apart_m(one: Home, other: Home) -> float:
    across = math.cos(math.radians(one.latitude_e7 / 1e7))
    north_m = (other.latitude_e7 - one.latitude_e7) * M_PER_E7
    east_m = (other.longitude_e7 - one.longitude_e7) * M_PER_E7 * across
    return math.hypot(north_m, east_m, (other.altitude_mm - one.altitude_mm) / 1000)
