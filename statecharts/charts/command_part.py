"""What the chart `command` says. The rows are in `command.py`, the changes of state in `command_state.py`."""

from __future__ import annotations

from google.protobuf.message import Message

from events.records import Record
from events.schema import orders_pb2
from events.schema.flight_pb2 import StepFailed
from events.schema.orders_pb2 import OrderMalformed, OrderReceived, SendAck
from events.schema.safety_pb2 import FlyToPlace, SetVehicleMode
from events.schema.vehicle_pb2 import (
    CommandAnswered,
    CommandSent,
    CommandUnanswered,
    PointAtAngles,
    PointAtPlace,
    ReleasePointing,
    SetZoom,
)
from statecharts.charts import command_gimbal, control, gimbals
from statecharts.charts.command import (
    CHART,
    FINAL,
    MAV_UNSUPPORTED_ALL,
    UNDERWAY,
    Facts,
    answered_enough,
    to_follow,
)
from statecharts.charts.command_state import EVOLVE
from statecharts.facts import Order, order_key
from statecharts.part import Part
from statecharts.state import State
from statecharts.table import Answer, Row, moved
from statecharts.words import MAV_RESULTS

VEHICLE = 1
RESULTS: dict[str, orders_pb2.AckResult.ValueType] = {
    "accepted": orders_pb2.ACK_ACCEPTED,
    "rejected": orders_pb2.ACK_REJECTED,
    "timeout": orders_pb2.ACK_TIMEOUT,
    "unsupported": orders_pb2.ACK_UNSUPPORTED,
    "unauthorised": orders_pb2.ACK_UNAUTHORISED,
}
STAGES: dict[str, orders_pb2.AckStage.ValueType] = {
    "intended": orders_pb2.ACK_STAGE_RECEIVED,
    "sent": orders_pb2.ACK_STAGE_SENT,
    "in_progress": orders_pb2.ACK_STAGE_IN_PROGRESS,
}
assert all(result in MAV_RESULTS for result in MAV_UNSUPPORTED_ALL)


def decide(state: State, record: Record) -> tuple[Message, ...]:
    """Return moves, the vehicle effect and the answer that follow from a record."""
    match record.kind.name:
        case "order_received":
            return _arrived(state, record)
        case "order_malformed":
            return (_refuse_malformed(record),)
        case "step_failed":
            return _undecided(record)
        case "command_sent" | "command_answered" | "command_unanswered":
            return _outcome(state, record)
        case "time_passed":
            return _fire_all(state, record, state.passed(CHART.name, record.at.flight_ns))
    return _restarted(state, record)


def _arrived(state: State, record: Record) -> tuple[Message, ...]:
    arrival = state.arrival.value
    assert arrival is not None
    order = state.orders[arrival.key]
    received = record.message
    assert isinstance(received, OrderReceived)
    facts = Facts(order, state, record.at.flight_ns, arrival, received)
    row = CHART.ask(order.state, "order_received", facts)
    if row.guard is answered_enough:
        return ()
    if row.answer is Answer.REFUSE:
        return (_ack(order, arrival.in_reply_to, orders_pb2.ACK_REJECTED, row.because, final=True),)
    if row.answer is Answer.IGNORE:
        return (_repeat(order, arrival.in_reply_to, row.because),)
    move = moved(CHART, arrival.key, row)
    points = row.guard is to_follow or (row.target == "intended" and order.verb == "point")
    first = control.taking(state, order.gimbal) if points else None
    before = () if first is None else (first,)
    if row.target in FINAL:
        move.because = _final_words(state, facts, row)
        return move, *before, _ack(order, order.in_reply_to, RESULTS[row.target], move.because, final=True)
    rung = _rung(order, order.in_reply_to, row.target, row.because + _notes(state, order))
    return move, *before, _effect(state, received, order), rung


def _final_words(state: State, facts: Facts, row: Row[Facts]) -> str:
    """Return why an order ends where it arrives; whoever has something followed is told what one who points is."""
    if row.guard is command_gimbal.beyond_limits:
        return command_gimbal.limit_words(facts)
    return row.because + _notes(state, facts.order) if row.guard is to_follow else row.because


def _repeat(order: Order, in_reply_to: bytes, because: str) -> SendAck:
    if order.state in FINAL:
        return _stored(order, in_reply_to, duplicate=True)
    return _rung(order, in_reply_to, order.state, because, duplicate=True)


def _rung(order: Order, in_reply_to: bytes, state: str, because: str, *, duplicate: bool = False) -> SendAck:
    """Return how far an order got that is not decided yet; no result of it means anything."""
    ack = _ack(order, in_reply_to, orders_pb2.ACK_ACCEPTED, because, final=False, duplicate=duplicate)
    ack.stage = STAGES[state]
    return ack


def _refuse_malformed(record: Record) -> SendAck:
    malformed = record.message
    assert isinstance(malformed, OrderMalformed)
    return SendAck(
        command_id=malformed.command_id,
        principal_id=malformed.issuer.principal_id,
        result=orders_pb2.ACK_REJECTED,
        detail=malformed.because,
        final=True,
        duplicate=False,
        in_reply_to=malformed.in_reply_to,
    )


def _undecided(record: Record) -> tuple[Message, ...]:
    """Tell the issuer of an order whose step failed. Not final: nothing of it stays, and a repeat is judged anew."""
    failed = record.message
    assert isinstance(failed, StepFailed)
    if not failed.command_id:
        return ()
    return (
        SendAck(
            command_id=failed.command_id,
            principal_id=failed.principal_id,
            result=orders_pb2.ACK_REJECTED,
            detail="deciding on it failed",
            final=False,
            duplicate=False,
            in_reply_to=failed.in_reply_to,
        ),
    )


def _effect(state: State, received: OrderReceived, order: Order) -> Message:
    key = order_key(order.principal_id, order.command_id)
    match received.WhichOneof("order"):
        case "fly_to_place":
            to = received.fly_to_place.place
            return FlyToPlace(vehicle=VEHICLE, place=to, life_ms=received.life_ms, order=key)
        case "set_flight_mode":
            mode = received.set_flight_mode.mode
            return SetVehicleMode(vehicle=VEHICLE, mode=mode, life_ms=received.life_ms, order=key)
    effect = _pointing(received)
    camera = state.cameras[order.camera]
    if not isinstance(effect, SetZoom):
        effect.gimbal = camera.gimbal
    effect.vehicle, effect.camera = camera.vehicle, camera.camera
    effect.life_ms, effect.order = received.life_ms, key
    return effect


def _pointing(received: OrderReceived) -> PointAtPlace | PointAtAngles | ReleasePointing | SetZoom:
    effect: PointAtPlace | PointAtAngles | ReleasePointing | SetZoom
    match received.WhichOneof("order"):
        case "point_at_place":
            effect = PointAtPlace(place=received.point_at_place.place)
        case "point_at_angles":
            angles = received.point_at_angles
            effect = PointAtAngles(pitch_cdeg=angles.pitch_cdeg, yaw_cdeg=angles.yaw_cdeg, yaw_locked=angles.yaw_locked)
        case "zoom_camera":
            effect = SetZoom(zoom_e4=received.zoom_camera.zoom_e4)
        case _:
            effect = ReleasePointing()
    return effect


def _outcome(state: State, record: Record) -> tuple[Message, ...]:
    outcome = record.message
    assert isinstance(outcome, CommandSent | CommandAnswered | CommandUnanswered)
    effect = state.effects.get(outcome.effect_seq)
    if effect is None or effect.order not in state.orders:
        return ()  # nothing that waits: the node's own wish, or an order that is forgotten by now
    return _fire(state, record, effect.order)


def _fire_all(state: State, record: Record, keys: tuple[str, ...]) -> tuple[Message, ...]:
    return tuple(message for key in keys for message in _fire(state, record, key))


def _fire(state: State, record: Record, key: str) -> tuple[Message, ...]:
    order, message = state.orders[key], record.message
    mav_result = message.mav_result if isinstance(message, CommandAnswered) else -1
    because = message.because if isinstance(message, CommandUnanswered) else ""
    facts = Facts(order, state, record.at.flight_ns, mav_result=mav_result, because=because)
    row = CHART.ask(order.state, record.kind.name, facts)
    if row.answer is not Answer.MOVE:
        return ()
    move = moved(CHART, key, row)
    if row.target not in FINAL:
        return move, _rung(order, order.in_reply_to, row.target, row.because)
    detail = _detail(record, row.because) + _notes(state, order)
    move.because = detail
    ack = _ack(order, order.in_reply_to, RESULTS[row.target], detail, final=True)
    if order.mav_result is not None:
        ack.mav_result = order.mav_result
    return move, ack


def _notes(state: State, order: Order) -> str:
    """Return what else an operator who points should know: who has the gimbal, and what may turn."""
    if order.verb not in ("point", "follow"):
        return ""
    other = control.other_controller(state, order.gimbal)
    notes = [f"{other} controls the gimbal"] if other else []
    looks = command_gimbal.looks_at_place(order) and gimbals.is_judged(state)
    if looks and gimbals.may_turn_vehicle(state, order.gimbal):
        notes.append(gimbals.MAY_TURN)
    return "".join(f"; {note}" for note in notes)


def _detail(record: Record, because: str) -> str:
    match record.message:
        case CommandAnswered(mav_result=raw):
            return f"COMMAND_ACK: {MAV_RESULTS.get(raw, f'MAV_RESULT {raw}')}"
        case CommandUnanswered(because=why):
            return f"{because}: {why}"
    return because


def _restarted(state: State, record: Record) -> tuple[Message, ...]:
    pending = tuple(key for key, order in state.orders.items() if order.state in UNDERWAY)
    owed = [state.orders[key] for _, key in state.owed_acks.items() if key in state.orders]
    again = tuple(_stored(order, order.in_reply_to) for order in owed if order.state in FINAL)
    return (*_fire_all(state, record, pending), *again)


def _stored(order: Order, in_reply_to: bytes, *, duplicate: bool = False) -> SendAck:
    """Return the stored result of an order, whole, for a repeat of it or because it is still owed."""
    ack = _ack(order, in_reply_to, RESULTS[order.state], order.detail, final=True, duplicate=duplicate)
    if order.mav_result is not None:
        ack.mav_result = order.mav_result
    return ack


def _ack(
    order: Order,
    in_reply_to: bytes,
    result: orders_pb2.AckResult.ValueType,
    detail: str,
    *,
    final: bool,
    duplicate: bool = False,
) -> SendAck:
    return SendAck(
        command_id=order.command_id,
        principal_id=order.principal_id,
        result=result,
        detail=detail,
        final=final,
        duplicate=duplicate,
        in_reply_to=in_reply_to,
    )


PART = Part(
    chart=CHART,
    alphabet=frozenset(
        {
            "order_received",
            "order_malformed",
            "step_failed",
            "command_sent",
            "command_answered",
            "command_unanswered",
            "time_passed",
            "node_started",
        }
    ),
    decide=decide,
    evolve=EVOLVE,
    safety=True,
    moves_of=frozenset(),
)
