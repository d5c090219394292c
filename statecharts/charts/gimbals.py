"""What gimbals and cameras say of themselves, kept for guards that ask. No chart, nothing is decided here.

Until a gimbal has been described nobody knows how far it turns, nor whether the vehicle would turn in its place. Where
the flight's limits say nothing about that, nothing is judged by it.
"""

from __future__ import annotations

from events.records import Record
from events.schema.flight_pb2 import ROI_TURNING_REFUSE, ROI_TURNING_UNSPECIFIED
from events.schema.orders_pb2 import PointAtAnglesOrder
from events.schema.vehicle_pb2 import CameraDescribed, GimbalDescribed
from statecharts.facts import Gimbal, Lens, fitting_key
from statecharts.part import Evolve
from statecharts.state import State
from statecharts.words import degrees

UNKNOWN = "the gimbal is not known yet: the vehicle itself might turn"
NOTHING_PANS = "no gimbal that pans: the vehicle itself would turn"
MAY_TURN = "no gimbal that pans: the vehicle itself may turn"
_LIMITS = ("pitch_min_cdeg", "pitch_max_cdeg", "yaw_min_cdeg", "yaw_max_cdeg")
HALF_TURN_CDEG, TURN_CDEG = 18_000, 36_000


def is_judged(state: State) -> bool:
    """Whether this flight judges places by what would turn to them."""
    return state.flight.limits.roi_turning != ROI_TURNING_UNSPECIFIED


def is_refused(state: State) -> bool:
    """Whether this flight refuses places that would turn the vehicle."""
    return state.flight.limits.roi_turning == ROI_TURNING_REFUSE


def may_turn_vehicle(state: State, gimbal: str) -> bool:
    """Whether a place to look at turns the vehicle, or may, for all that is known of the gimbal."""
    known = state.gimbals.get(gimbal)
    return known is None or known.turns_vehicle


def beyond(gimbal: Gimbal | None, asked: PointAtAnglesOrder) -> str:
    """Return in words which limit of the gimbal the angles lie beyond; "" where none is known that they do.

    Yaw from north is not judged: where that is from the nose changes as the vehicle turns.
    """
    if gimbal is None:
        return ""
    found = _outside("pitch", asked.pitch_cdeg, gimbal.pitch_min_cdeg, gimbal.pitch_max_cdeg)
    if found or asked.yaw_locked or gimbal.yaw_min_cdeg is None or gimbal.yaw_max_cdeg is None:
        return found
    if gimbal.yaw_max_cdeg - gimbal.yaw_min_cdeg >= TURN_CDEG:
        return ""
    yaw_cdeg = (asked.yaw_cdeg + HALF_TURN_CDEG) % TURN_CDEG - HALF_TURN_CDEG
    return _outside("yaw", yaw_cdeg, gimbal.yaw_min_cdeg, gimbal.yaw_max_cdeg)


def _outside(what: str, asked_cdeg: int, min_cdeg: int | None, max_cdeg: int | None) -> str:
    if min_cdeg is not None and asked_cdeg < min_cdeg:
        return f"{what} {degrees(asked_cdeg)} is below the limit of {degrees(min_cdeg)}"
    if max_cdeg is not None and asked_cdeg > max_cdeg:
        return f"{what} {degrees(asked_cdeg)} is above the limit of {degrees(max_cdeg)}"
    return ""


def _gimbal(state: State, record: Record) -> None:
    told = record.message
    assert isinstance(told, GimbalDescribed)
    limits = {field.name: value for field, value in told.ListFields() if field.name in _LIMITS}
    key = fitting_key(told.vehicle, told.gimbal)
    state.gimbals.put(key, Gimbal(managed=told.managed, pans=told.pans, turns_vehicle=told.turns_vehicle, **limits))


def _camera(state: State, record: Record) -> None:
    told = record.message
    assert isinstance(told, CameraDescribed)
    state.lenses.put(fitting_key(told.vehicle, told.camera), Lens(told.zooms))


EVOLVE: dict[str, Evolve] = {"gimbal_described": _gimbal, "camera_described": _camera}
