"""What the vehicle reports, kept for guards that ask. No chart, nothing is decided."""

from __future__ import annotations

from events.records import Record
from events.schema.vehicle_pb2 import VehicleLinkChanged, VehicleStateReported
from statecharts.facts import Vehicle
from statecharts.part import Evolve
from statecharts.state import State


def _reported(state: State, record: Record) -> None:
    report = record.message
    assert isinstance(report, VehicleStateReported)
    before = state.vehicles.get(report.vehicle) or Vehicle()
    landed = report.landed_state if report.HasField("landed_state") else None
    state.vehicles.put(
        report.vehicle,
        before._replace(
            armed=report.armed,
            custom_mode=report.custom_mode,
            flight_mode=report.flight_mode,
            landed_state=landed,
        ),
    )


def _link(state: State, record: Record) -> None:
    change = record.message
    assert isinstance(change, VehicleLinkChanged)
    before = state.vehicles.get(change.vehicle) or Vehicle()
    state.vehicles.put(change.vehicle, before._replace(link=change.up))


def _started(state: State, _record: Record) -> None:
    """Believe in no link from before a start: who is there reports again."""
    for number, before in state.vehicles.items():
        state.vehicles.put(number, before._replace(link=False))


EVOLVE: dict[str, Evolve] = {
    "vehicle_state_reported": _reported,
    "vehicle_link_changed": _link,
    "node_started": _started,
}
