"""How a flight begins for the core: manifest, baseline and origin become state. No chart, nothing is decided."""

from __future__ import annotations

from events.records import Record
from events.schema.flight_pb2 import BaselineCarried, FlightOpened, OriginSet
from events.schema.state_pb2 import CarriedMission, CarriedObject, CarriedOrder, CarriedState
from statecharts.charts.command import FINAL
from statecharts.charts.mapping import place_object
from statecharts.charts.override import hold
from statecharts.facts import (
    Camera,
    Ignored,
    Manifest,
    MapObject,
    Mission,
    Order,
    Override,
    Spot,
    Trusted,
    Vehicle,
    fitting_key,
    order_key,
)
from statecharts.geometry import Fence
from statecharts.part import Evolve
from statecharts.state import State

NS_PER_MS = 1_000_000
VEHICLE = 1


def _open(state: State, record: Record) -> None:
    opened = record.message
    assert isinstance(opened, FlightOpened)
    configuration = opened.configuration
    fittings = [(fitting_key(one.vehicle, one.camera), one) for one in configuration.cameras]
    state.manifest.set(
        Manifest(
            flight_id=opened.flight_id,
            node=opened.node,
            node_public_key=opened.node_public_key,
            limits=configuration.limits,
            camera_roles=tuple(configuration.limits.camera_roles),
            flight_roles=tuple(configuration.limits.flight_roles),
            group_of={name: group.name for group in configuration.class_groups for name in group.classes},
            gimbal_of={key: one.gimbal for key, one in fittings},
        )
    )
    for key, one in fittings:
        state.cameras.put(key, Camera(one.vehicle, one.camera, one.gimbal))


def _set_origin(state: State, record: Record) -> None:
    origin = record.message
    assert isinstance(origin, OriginSet)
    state.origin.set(Spot.of(origin.place))


def _carry(state: State, record: Record) -> None:
    baseline = record.message
    assert isinstance(baseline, BaselineCarried)
    load_carried(state, baseline.state, record.at.flight_ns)


def load_carried(state: State, carried: CarriedState, now_ns: int) -> None:
    """Put into the state what the flight before handed over (the inverse of `carry_over`)."""
    owed = {order_key(one.principal_id, one.command_id): one.in_reply_to for one in carried.unanswered}
    for order in carried.orders:
        key = order_key(order.principal_id, order.command_id)
        state.orders.put(key, _order(order, owed.get(key, b""), now_ns))
    finished = [key for key in sorted(owed) if key in state.orders and state.orders[key].state in FINAL]
    for index, key in enumerate(finished):
        state.owed_acks.put(-1 - index, key)  # below every seq of this flight: their answers were the flight before's
    for nonce in carried.nonces:
        state.nonces.put((nonce.device_key_id, nonce.nonce), now_ns + nonce.keep_ms * NS_PER_MS)
    for newest in carried.order_seqs:
        state.order_seqs.put(newest.device_key_id, newest.order_seq)
    for thing in carried.objects:
        place_object(state, _object(thing))
    for item in carried.ignored:
        spot = Spot.of(item.place)
        state.ignored.put(item.poi_id, Ignored(item.poi_id, item.class_group, spot, item.principal_id, item.muted))
    _load_safety(state, carried, now_ns)
    for newest_list in carried.lists:
        state.lists.put(newest_list.key_id, (newest_list.list_version, newest_list.digest))
    state.trusted.set(
        Trusted(
            list_behind=carried.list_behind,
            root_behind=carried.root_behind,
            root_version=carried.root_version,
            epoch_id=carried.epoch_id,
            time_floor_ms=carried.time_floor_ms,
        )
    )
    if carried.flown_revision:
        state.missions.put(VEHICLE, Mission(flown_revision=carried.flown_revision))
    if carried.HasField("mission"):
        _load_mission(state, carried.mission)
    if carried.HasField("origin"):
        state.origin.set(Spot.of(carried.origin))


def _load_mission(state: State, carried: CarriedMission) -> None:
    """Let a mission go on where it was, in the air. No effect has seq 0: it stands for those of the flight before."""
    number, middle = carried.vehicle, carried.HasField("middle_item")
    state.vehicles.put(number, Vehicle(armed=True, flight_mode=carried.vehicle_mode))
    state.plans.put(number, carried.plan)
    before = state.missions.get(number) or Mission()
    state.missions.put(
        number,
        before._replace(
            state=carried.chart_state,
            tries=carried.tries,
            begun=carried.begun,
            flown=True,
            held_seq=0 if carried.held else -1,
            entered_mode=carried.entered_mode,
            next_item=carried.next_item,
            middle_item=carried.middle_item if middle else -1,
            middle_seq=0 if middle else -1,
            middle_ahead=carried.middle_ahead,
        ),
    )


def _load_safety(state: State, carried: CarriedState, now_ns: int) -> None:
    for index, fence in enumerate(carried.fences):
        corners = tuple((corner.east_mm, corner.north_mm) for corner in fence.corners)
        state.fences.put(index, Fence(fence.inclusion, corners))
    for held in carried.overrides:
        names = held.principal_id, held.callsign, held.command_id, held.reason
        hold(state, Override(held.vehicle, held.scope, *names, now_ns + held.left_ms * NS_PER_MS))


def _order(carried: CarriedOrder, in_reply_to: bytes, now_ns: int) -> Order:
    return Order(
        principal_id=carried.principal_id,
        callsign="",
        command_id=carried.command_id,
        digest=carried.body_digest,
        state=carried.chart_state,
        verb="",
        camera="",
        gimbal="",
        poi_id="",
        confirmed=False,
        device_key_id=b"",
        order_seq=0,
        in_reply_to=in_reply_to,
        expires_ns=now_ns,
        keep_until_ns=now_ns + carried.keep_ms * NS_PER_MS,
        detail=carried.detail,
        mav_result=carried.mav_result if carried.HasField("mav_result") else None,
    )


def _object(carried: CarriedObject) -> MapObject:
    spot = Spot.of(carried.place)
    return MapObject(
        carried.number, carried.class_name, carried.class_group, spot, carried.confidence_e4, carried.sightings
    )


EVOLVE: dict[str, Evolve] = {"flight_opened": _open, "origin_set": _set_origin, "baseline_carried": _carry}
