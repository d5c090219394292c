"""What a flight hands over to the next: a pure function of the state (design: baseline).

Its inverse is `load_carried`; a test proves that the new flight's first state equals what was carried.
"""

from __future__ import annotations

from events.schema.state_pb2 import (
    CarriedAck,
    CarriedCorner,
    CarriedFence,
    CarriedIgnored,
    CarriedList,
    CarriedMission,
    CarriedNonce,
    CarriedObject,
    CarriedOrder,
    CarriedOrderSeq,
    CarriedOverride,
    CarriedState,
)
from statecharts.charts.command import FINAL
from statecharts.charts.mission import IN_THE_AIR
from statecharts.facts import Mission, Order
from statecharts.state import State

NS_PER_MS = 1_000_000


def carry_over(state: State, now_ns: int) -> CarriedState:
    """Return what outlives the flight at `now_ns`; lives are carried as what is left of them."""
    carried = CarriedState(
        orders=[_order(order, now_ns) for order in state.orders.values()],
        nonces=[
            CarriedNonce(device_key_id=key[0], nonce=key[1], keep_ms=_left_ms(until_ns, now_ns))
            for key, until_ns in state.nonces.items()
            if until_ns > now_ns
        ],
        order_seqs=[CarriedOrderSeq(device_key_id=key, order_seq=newest) for key, newest in state.order_seqs.items()],
        objects=[
            CarriedObject(
                number=thing.number,
                class_name=thing.class_name,
                class_group=thing.class_group,
                place=thing.spot.place,
                confidence_e4=thing.confidence_e4,
                sightings=thing.sightings,
            )
            for thing in state.objects.values()
        ],
        ignored=[
            CarriedIgnored(
                poi_id=item.poi_id,
                class_group=item.class_group,
                place=item.spot.place,
                principal_id=item.principal_id,
                muted=item.muted,
            )
            for item in state.ignored.values()
        ],
        unanswered=[_owed(order) for key, order in state.orders.items() if _is_owed(state, key, order)],
    )
    _carry_trust(state, carried)
    for number, mission in state.missions.items():
        if mission.flown_revision:
            carried.flown_revision = mission.flown_revision
        _carry_mission(state, carried, number, mission)
    _carry_safety(state, carried, now_ns)
    if state.origin.value is not None:
        carried.origin.CopyFrom(state.origin.value.place)
    return carried


def _carry_trust(state: State, carried: CarriedState) -> None:
    trusted = state.trusted.value
    for key, (version, digest) in state.lists.items():
        carried.lists.append(CarriedList(key_id=key, list_version=version, digest=digest))
    carried.epoch_id, carried.root_version = trusted.epoch_id, trusted.root_version
    carried.time_floor_ms = trusted.time_floor_ms
    carried.list_behind, carried.root_behind = trusted.list_behind, trusted.root_behind


def _carry_mission(state: State, carried: CarriedState, number: int, mission: Mission) -> None:
    """Carry a mission that is under way in the air; one on the ground begins anew, by an order where one is needed."""
    plan, vehicle = state.plans.get(number), state.vehicles.get(number)
    under_way = mission.flown and mission.state in IN_THE_AIR
    if plan is None or vehicle is None or not (under_way and vehicle.armed):
        return
    one = CarriedMission(
        vehicle=number,
        chart_state=mission.state,
        tries=mission.tries,
        begun=mission.begun,
        next_item=mission.next_item,
        plan=plan,
        held=mission.held_seq > mission.plan_seq,
        entered_mode=mission.entered_mode,  # type: ignore[arg-type]
        vehicle_mode=vehicle.flight_mode,  # type: ignore[arg-type]
    )
    one.plan.effect_seq = 0
    if mission.middle_item >= 0 and mission.middle_seq == plan.effect_seq:
        one.middle_item, one.middle_ahead = mission.middle_item, mission.middle_ahead
    carried.mission.CopyFrom(one)


def _carry_safety(state: State, carried: CarriedState, now_ns: int) -> None:
    """Carry what people laid down. Failsafes and the operators' link begin anew: they follow from what is so then."""
    for fence in state.fences.values():
        corners = [CarriedCorner(east_mm=east, north_mm=north) for east, north in fence.vertices]
        carried.fences.append(CarriedFence(inclusion=fence.inclusion, corners=corners))
    for held in state.overrides.values():
        if held.until_ns - now_ns >= NS_PER_MS:
            carried.overrides.append(
                CarriedOverride(
                    vehicle=held.vehicle,
                    scope=held.scope,  # type: ignore[arg-type]
                    principal_id=held.principal_id,
                    callsign=held.callsign,
                    command_id=held.command_id,
                    reason=held.reason,
                    left_ms=(held.until_ns - now_ns) // NS_PER_MS,
                )
            )


def _order(order: Order, now_ns: int) -> CarriedOrder:
    carried = CarriedOrder(
        principal_id=order.principal_id,
        command_id=order.command_id,
        body_digest=order.digest,
        chart_state=order.state,
        detail=order.detail,
        keep_ms=_left_ms(order.keep_until_ns, now_ns),
    )
    if order.mav_result is not None:
        carried.mav_result = order.mav_result
    return carried


def _is_owed(state: State, key: str, order: Order) -> bool:
    return order.state not in FINAL or any(owed == key for owed in state.owed_acks.values())


def _owed(order: Order) -> CarriedAck:
    return CarriedAck(command_id=order.command_id, principal_id=order.principal_id, in_reply_to=order.in_reply_to)


def _left_ms(until_ns: int, now_ns: int) -> int:
    """Return what is left, rounded up: rather kept a millisecond too long than too short."""
    return max(until_ns - now_ns + NS_PER_MS - 1, 0) // NS_PER_MS
