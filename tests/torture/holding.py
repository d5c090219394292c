"""What was seen of a flight whose node was killed, held against its log: nothing lost, nothing done twice."""

from __future__ import annotations

from collections import Counter

from pymavlink.dialects.v20 import common as dialect

from autopilot.ground.ledger import Answer, Order
from autopilot.ports.config import VehicleSection
from events import Record, read_record
from events.schema.orders_pb2 import OrderMalformed
from events.schema.vehicle_pb2 import CommandAnswered, CommandUnanswered, PointAtPlace
from events.schema.waypoint_pb2 import DeviceCommand
from events.store import flights_in, read_flight
from replay.verify import verify
from statecharts import State, restore, steps_of
from statecharts.charts.command import FINAL
from tests.torture.killing import Flown

ATTEMPTS_MAX = VehicleSection().attempts
ROI = dialect.MAV_CMD_DO_SET_ROI_LOCATION


def check(flown: Flown, *, starts: int | None = None, ends: int = 1) -> Counter[str]:
    """Hold what was seen against the log; return the orders by their final state. Raises AssertionError.

    `starts`: how many starts the flight must have recorded; None: at most one for each start of the process.
    """
    assert flown.lost == []
    (flight,) = flights_in(flown.folder)
    reader = read_flight(flight.folder)
    try:
        assert verify(reader).words().startswith("identical")
        records = [read_record(stored) for stored in reader.stored()]
    finally:
        reader.close()
    recorded = sum(record.kind.name == "node_started" for record in records)
    assert recorded <= flown.kills + 1
    assert starts in (None, recorded)
    assert sum(record.kind.name == "flight_closed" for record in records) == ends
    state = State()
    for step in steps_of(records):
        restore(state, step)
    _check_answers(flown, records, state)
    _check_performed_once(flown, records)
    _check_unknown_after_restart(records, state)
    return Counter(order.state for order in state.orders.values())


def _check_answers(flown: Flown, records: list[Record], state: State) -> None:
    """Check that what people were told is in the log, word for word, and that the log leaves nothing open."""
    told = {order.command_id: (answer.result, answer.detail) for order, answer in flown.answers if _final(answer)}
    kept = {order.command_id: {(order.state, order.detail)} for order in state.orders.values()}
    for record in records:  # before the first fix nothing has a place: such an order can't be read, and is told so
        if isinstance(record.message, OrderMalformed):
            kept.setdefault(record.message.command_id, set()).add(("rejected", record.message.because))
    assert {command_id: said for command_id, said in told.items() if said not in kept.get(command_id, set())} == {}
    assert [order for order in state.orders.values() if order.state not in FINAL] == []


def _final(answer: Answer) -> bool:
    return answer.state == "final"


def _check_performed_once(flown: Flown, records: list[Record]) -> None:
    """Check that each order has at most one effect, and that no more copies of it left than one effect may send."""
    effects = {record.seq: record.message for record in records if isinstance(record.message, PointAtPlace)}
    of_orders = {seq: effect for seq, effect in effects.items() if effect.order}
    assert max(Counter(effect.order for effect in of_orders.values()).values(), default=0) <= 1
    sent = dict.fromkeys(of_orders, ATTEMPTS_MAX)  # where nobody lived to tell the outcome
    for record in records:
        if isinstance(record.message, CommandAnswered | CommandUnanswered) and record.message.effect_seq in sent:
            sent[record.message.effect_seq] = record.message.attempts
    allowed = {(effect.place.latitude_e7, effect.place.longitude_e7): sent[seq] for seq, effect in of_orders.items()}
    arrived = {order_place(order): flown.at_aircraft[ROI, *order_place(order)] for order, _ in flown.answers}
    too_often = {place: copies for place, copies in arrived.items() if copies > allowed.get(place, 0)}
    assert too_often == {}  # nor did anything leave for the aircraft that the log does not hold


def _check_unknown_after_restart(records: list[Record], state: State) -> None:
    """Check that exactly the orders that a start found underway are answered so."""
    underway: set[str] = set()
    found: set[str] = set()
    for record in records:
        if record.kind.name == "node_started":
            found |= underway
        elif record.kind.name == "moved" and record.message.chart == "command":  # type: ignore[attr-defined]
            key, to_state = record.message.instance, record.message.to_state  # type: ignore[attr-defined]
            underway = underway - {key} if to_state in FINAL else underway | {key}
    unknown = {key for key, order in state.orders.items() if order.detail == "unknown after restart"}
    assert unknown == found
    assert {state.orders[key].state for key in unknown} <= {"timeout"}


def order_place(order: Order) -> tuple[int, int]:
    """Return where an order points, in 1e-7 degrees."""
    roi = DeviceCommand.FromString(order.content).camera_roi
    return roi.lat_e7, roi.lon_e7
