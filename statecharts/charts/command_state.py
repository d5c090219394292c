"""How the chart `command` changes its part of the state. The rows are in `command.py`."""

from __future__ import annotations

from events.records import Record
from events.schema.common_pb2 import Moved
from events.schema.orders_pb2 import (
    MISSION_ABORT,
    MISSION_BEGIN,
    MISSION_PAUSE,
    MISSION_RESUME,
    AckPublished,
    OrderMalformed,
    OrderReceived,
    SendAck,
)
from events.schema.safety_pb2 import FlyToPlace, SetVehicleMode
from events.schema.vehicle_pb2 import (
    CommandAnswered,
    CommandUnanswered,
    PointAtAngles,
    PointAtPlace,
    ReleasePointing,
    SetZoom,
)
from statecharts.charts.command import CHART, FINAL, MAV_IN_PROGRESS, REPEATS_ANSWERED, UNDERWAY
from statecharts.facts import Arrival, Effect, Order, fitting_key, order_key
from statecharts.part import Evolve
from statecharts.state import State

NS_PER_MS = 1_000_000
# The adapter answers within the order's life; this long after it the core stops waiting for the adapter.
OUTCOME_GRACE_NS = 5_000_000_000
# What need not be remembered any more is looked for this often: an order should not pay for all others.
FORGET_EVERY_NS = 10_000_000_000


def _receive(state: State, record: Record) -> None:
    received = record.message
    assert isinstance(received, OrderReceived)
    now_ns = record.at.flight_ns
    _forget_old(state, now_ns)
    key = order_key(received.issuer.principal_id, received.command_id)
    device = received.issuer.device_key_id
    state.arrival.set(
        Arrival(
            key=key,
            digest=received.body_digest,
            in_reply_to=received.in_reply_to,
            known=key in state.orders,
            replayed=(device, received.nonce) in state.nonces,
            overdue_ms=received.revocation_overdue_ms,
            time_uncertain=received.time_uncertain,
            before_memory=received.before_memory,
            order_seq=received.order_seq,
            newest_seq=state.order_seqs.get(device) or 0,
        )
    )
    state.nonces.put((device, received.nonce), now_ns + received.nonce_life_ms * NS_PER_MS)
    if key not in state.orders:
        state.orders.put(key, _order(state, received, now_ns))


def _order(state: State, received: OrderReceived, now_ns: int) -> Order:
    verb, camera, poi_id, confirmed = _asked(received)
    gimbal = state.flight.gimbal_of.get(camera)
    return Order(
        principal_id=received.issuer.principal_id,
        callsign=received.issuer.callsign,
        command_id=received.command_id,
        digest=received.body_digest,
        state=CHART.initial,
        verb=verb,
        camera=camera,
        gimbal=fitting_key(1, gimbal) if gimbal else "",
        poi_id=poi_id,
        confirmed=confirmed,
        device_key_id=received.issuer.device_key_id,
        order_seq=received.order_seq,
        in_reply_to=received.in_reply_to,
        expires_ns=now_ns + received.life_ms * NS_PER_MS,
        keep_until_ns=now_ns + state.flight.limits.dedup_keep_ms * NS_PER_MS,
        asked=_VERBS.get(received.mission.verb, ""),
        at_place=received.WhichOneof("order") == "point_at_place",
    )


def _asked(received: OrderReceived) -> tuple[str, str, str, bool]:
    """Return verb, camera key, point of interest and judgement of an order."""
    match received.WhichOneof("order"):
        case "point_at_place":
            return "point", fitting_key(1, received.point_at_place.camera), "", False
        case "point_at_angles":
            return "point", fitting_key(1, received.point_at_angles.camera), "", False
        case "release_camera":
            return "release", fitting_key(1, received.release_camera.camera), "", False
        case "zoom_camera":
            return "zoom", fitting_key(1, received.zoom_camera.camera), "", False
        case "judge_poi":
            return "judge", "", received.judge_poi.poi_id, received.judge_poi.confirmed
        case "follow_poi":
            return "follow", fitting_key(1, received.follow_poi.camera), received.follow_poi.poi_id, False
        case "fly_to_place":
            return "fly", "", "", False
        case "set_flight_mode":
            return "mode", "", "", False
        case "mission":
            return "mission", "", "", False
        case "acknowledge_selftest":
            return "acknowledge", "", "", False
    return "", "", "", False


_VERBS: dict[int, str] = {
    MISSION_BEGIN: "begin",
    MISSION_PAUSE: "pause",
    MISSION_RESUME: "resume",
    MISSION_ABORT: "abort",
}


def _forget_old(state: State, now_ns: int) -> None:
    if now_ns < state.forgot_ns.value + FORGET_EVERY_NS:
        return
    state.forgot_ns.set(now_ns)
    state.nonces.drop_where(lambda until_ns: until_ns <= now_ns)
    state.orders.drop_where(lambda order: order.keep_until_ns <= now_ns and order.state in FINAL)
    state.owed_acks.drop_where(lambda key: key not in state.orders)


def _receive_malformed(state: State, record: Record) -> None:
    malformed = record.message
    assert isinstance(malformed, OrderMalformed)
    _forget_old(state, record.at.flight_ns)
    until_ns = record.at.flight_ns + malformed.nonce_life_ms * NS_PER_MS
    state.nonces.put((malformed.issuer.device_key_id, malformed.nonce), until_ns)


def _apply_move(state: State, record: Record) -> None:
    change = record.message
    assert isinstance(change, Moved)
    if change.chart != CHART.name:
        return
    order = state.orders[change.instance]
    if change.from_state == CHART.initial:
        newest = state.order_seqs.get(order.device_key_id) or 0
        state.order_seqs.put(order.device_key_id, max(newest, order.order_seq))
    state.orders.put(change.instance, order._replace(state=change.to_state, detail=change.because))
    if change.to_state in FINAL:
        state.deadlines.drop((CHART.name, change.instance))
    elif change.to_state == "intended":
        state.deadlines.put((CHART.name, change.instance), order.expires_ns + OUTCOME_GRACE_NS)


def _remember_effect(state: State, record: Record) -> None:
    effect = record.message
    assert isinstance(effect, PointAtPlace | PointAtAngles | ReleasePointing | SetZoom)
    gimbal = "" if isinstance(effect, SetZoom) else fitting_key(effect.vehicle, effect.gimbal)
    state.effects.drop_where(lambda earlier: earlier.done)
    state.effects.put(record.seq, Effect(effect.order, gimbal))


def _remember_flight_effect(state: State, record: Record) -> None:
    """Remember what an order asked of the flight; the node's own wishes are their charts' business."""
    effect = record.message
    assert isinstance(effect, FlyToPlace | SetVehicleMode)
    if effect.order:
        state.effects.drop_where(lambda earlier: earlier.done)
        state.effects.put(record.seq, Effect(effect.order, ""))


def _answered(state: State, record: Record) -> None:
    answer = record.message
    assert isinstance(answer, CommandAnswered)
    effect = state.effects.get(answer.effect_seq)
    if effect is None:
        return
    if answer.mav_result != MAV_IN_PROGRESS:
        state.effects.put(answer.effect_seq, effect._replace(done=True))
    order = state.orders.get(effect.order)
    if order is not None and order.state in UNDERWAY:
        state.orders.put(effect.order, order._replace(mav_result=answer.mav_result))


def _unanswered(state: State, record: Record) -> None:
    answer = record.message
    assert isinstance(answer, CommandUnanswered)
    effect = state.effects.get(answer.effect_seq)
    if effect is not None:
        state.effects.put(answer.effect_seq, effect._replace(done=True))


def _acked(state: State, record: Record) -> None:
    ack = record.message
    assert isinstance(ack, SendAck)
    key = order_key(ack.principal_id, ack.command_id)
    order = state.orders.get(key)
    arrival = state.arrival.value
    # An answer to the arrival of an order that was known: to a repeat of it, or to another body under its id.
    if order is not None and arrival is not None and arrival.known and arrival.in_reply_to == ack.in_reply_to:
        times = (*order.repeats_answered_ns, record.at.flight_ns)[-REPEATS_ANSWERED:]
        state.orders.put(key, order._replace(repeats_answered_ns=times))
    # A refusal of another body under the same id is no answer to the order: it must not take its place.
    if order is not None and ack.final and order.state in FINAL and ack.detail == order.detail:
        state.owed_acks.drop_where(lambda owed: owed == key)
        state.owed_acks.put(record.seq, key)


def _ack_left(state: State, record: Record) -> None:
    published = record.message
    assert isinstance(published, AckPublished)
    if not published.failure:
        state.owed_acks.drop(published.effect_seq)


EVOLVE: dict[str, Evolve] = {
    "order_received": _receive,
    "order_malformed": _receive_malformed,
    "moved": _apply_move,
    "point_at_place": _remember_effect,
    "point_at_angles": _remember_effect,
    "release_pointing": _remember_effect,
    "fly_to_place": _remember_flight_effect,
    "set_vehicle_mode": _remember_flight_effect,
    "set_zoom": _remember_effect,
    "command_answered": _answered,
    "command_unanswered": _unanswered,
    "send_ack": _acked,
    "ack_published": _ack_left,
}
