"""What the vehicle reports, kept for guards that ask. No chart, nothing is decided.

A place is believed only while the vehicle is heard: after a silence it says anew where it is. Its battery and its home
stay as they were last told.
"""

from __future__ import annotations

from events.records import Record
from events.schema.safety_pb2 import BatteryReported, HomeReported
from events.schema.vehicle_pb2 import PositionReported, VehicleLinkChanged, VehicleStateReported
from statecharts.facts import Spot, Vehicle, Whereabouts
from statecharts.part import Evolve
from statecharts.state import State


def _of(state: State, number: int) -> Vehicle:
    return state.vehicles.get(number) or Vehicle()


def _reported(state: State, record: Record) -> None:
    report = record.message
    assert isinstance(report, VehicleStateReported)
    vehicle = _of(state, report.vehicle)._replace(
        armed=report.armed,
        custom_mode=report.custom_mode,
        flight_mode=report.flight_mode,
        landed_state=report.landed_state if report.HasField("landed_state") else None,
    )
    state.vehicles.put(report.vehicle, vehicle)


def _link(state: State, record: Record) -> None:
    change = record.message
    assert isinstance(change, VehicleLinkChanged)
    state.vehicles.put(change.vehicle, _of(state, change.vehicle)._replace(link=change.up))
    if not change.up:
        state.whereabouts.drop(change.vehicle)


def _position(state: State, record: Record) -> None:
    report = record.message
    assert isinstance(report, PositionReported)
    here = Whereabouts(Spot.of(report.place), report.east_mm_s, report.north_mm_s)
    state.whereabouts.put(report.vehicle, here)


def _battery(state: State, record: Record) -> None:
    report = record.message
    assert isinstance(report, BatteryReported)
    if report.HasField("charge_percent"):  # a charge does not come back by not being known
        state.batteries.put(report.vehicle, report.charge_percent)


def _home(state: State, record: Record) -> None:
    report = record.message
    assert isinstance(report, HomeReported)
    state.vehicles.put(report.vehicle, _of(state, report.vehicle)._replace(home=Spot.of(report.place)))


def _started(state: State, _record: Record) -> None:
    """Believe in no link from before a start: who is there reports again."""
    for number, before in state.vehicles.items():
        state.vehicles.put(number, before._replace(link=False))
        state.whereabouts.drop(number)


EVOLVE: dict[str, Evolve] = {
    "vehicle_state_reported": _reported,
    "vehicle_link_changed": _link,
    "position_reported": _position,
    "battery_reported": _battery,
    "home_reported": _home,
    "node_started": _started,
}
