"""What the chart `scan` says and how its part of the state changes. The rows are in `scan.py`."""

from __future__ import annotations

from google.protobuf.message import Message

from events.records import Record
from events.schema.common_pb2 import Moved
from events.schema.eyes_pb2 import FrameObserved
from events.schema.vehicle_pb2 import PointAtAngles, PointAtPlace
from statecharts.charts import gimbals
from statecharts.charts.scan import CHART, Facts
from statecharts.facts import Poi, Scan, Spot, fitting_key
from statecharts.part import Part
from statecharts.state import State
from statecharts.table import Answer, Row, moved

NS_PER_MS = 1_000_000
RATE_FRAMES = 10  # the frame rate is that of the last ten frames


def decide(state: State, record: Record) -> tuple[Message, ...]:
    """Return the moves of the scan and what the gimbal is asked for."""
    message = record.message
    match record.kind.name:
        case "frame_observed":
            assert isinstance(message, FrameObserved)
            return _fire(state, fitting_key(message.vehicle, message.camera), "frame_observed")
        case "time_passed":
            passed = state.passed(CHART.name, record.at.flight_ns)
            return tuple(said for key in passed for said in _fire(state, key, "time_passed"))
    assert isinstance(message, Moved)
    if message.chart == "command":
        return _follow(state, message)
    return _fire(state, message.instance, "camera_moved") if message.chart == "camera" else ()


def _follow(state: State, change: Moved) -> tuple[Message, ...]:
    order = state.orders[change.instance]
    if order.verb != "follow" or change.to_state != "accepted":
        return ()
    return _fire(state, order.camera, "follow", order.poi_id)


def _fire(state: State, key: str, trigger: str, poi_id: str = "") -> tuple[Message, ...]:
    camera = state.cameras.get(key)
    if camera is None:
        return ()
    limits, scan = state.flight.limits, state.scans.get(key) or Scan()
    vehicle = state.vehicles.get(camera.vehicle)
    able = camera.gimbal > 0 and vehicle is not None and vehicle.link
    if able and gimbals.is_refused(state):  # what is asked for is a place, which must not turn the vehicle
        able = not gimbals.may_turn_vehicle(state, fitting_key(camera.vehicle, camera.gimbal))
    enabled = limits.scan_enabled and able
    candidate = _candidate(state, key) if enabled and camera.state == "automatic" else None
    facts = Facts(
        enabled=enabled,
        candidate=candidate is not None,
        camera=camera.state,
        rate_mhz=_rate_mhz(scan, limits.frame_rate_floor_mhz),
        floor_mhz=limits.frame_rate_floor_mhz,
        moved_away=scan.state == "following"
        and able
        and not _spot(state, scan.poi_id).within(scan.spot, limits.same_object_mm // 2),
    )
    row = CHART.ask(scan.state, trigger, facts)
    if row.answer is not Answer.MOVE:
        return ()
    wanted = state.pois[poi_id or scan.poi_id] if row.target == "following" else candidate
    return (moved(CHART, key, row), *_asked(state, key, row, wanted))


def _asked(state: State, key: str, row: Row[Facts], wanted: Poi | None) -> tuple[Message, ...]:
    camera, limits = state.cameras[key], state.flight.limits
    asked: PointAtPlace | PointAtAngles
    if row.target in ("zoomed_in", "following") and wanted is not None:
        place = _spot(state, wanted.poi_id).place if row.target == "following" else wanted.spot.place
        asked = PointAtPlace(place=place, poi_id=wanted.poi_id)
    elif row.target == "zoomed_out" and row.source != "blocked" and limits.scan_enabled and camera.gimbal:
        asked = PointAtAngles(pitch_cdeg=_sweep_pitch_cdeg(state), yaw_cdeg=0, yaw_locked=False)
    else:
        return ()
    asked.vehicle, asked.camera, asked.gimbal = camera.vehicle, camera.camera, camera.gimbal
    asked.life_ms = limits.own_command_life_ms
    return (asked,)


def _sweep_pitch_cdeg(state: State) -> int:
    """Return how far down the camera looks by itself: as the mission was planned for while it is flown."""
    flies = any(mission.state == "flying" for mission in state.missions.values())
    return state.flight.limits.mission_pitch_cdeg if flies else state.flight.limits.sweep_pitch_cdeg


def _spot(state: State, poi_id: str) -> Spot:
    """Return where a point of interest was seen last."""
    poi = state.pois[poi_id]
    thing = state.objects.get(poi.object)
    return poi.spot if thing is None else thing.spot


def _candidate(state: State, key: str) -> Poi | None:
    """Return the oldest question about this camera's sightings that was not looked at yet."""
    waiting = [
        poi
        for poi in (state.pois[poi_id] for poi_id, _ in state.open_pois.items())
        if not poi.looked and fitting_key(poi.vehicle, poi.camera) == key
    ]
    return min(waiting, key=lambda poi: (poi.opened_ns, poi.poi_id), default=None)


def _rate_mhz(scan: Scan, floor_mhz: int) -> int:
    """Return the frame rate in millihertz; the floor itself (neither slow nor quick) before there are enough frames."""
    if len(scan.captures) < RATE_FRAMES:
        return floor_mhz
    span_ns = scan.captures[-1] - scan.captures[0]
    return (RATE_FRAMES - 1) * 10**12 // span_ns if span_ns > 0 else floor_mhz


def _frame(state: State, record: Record) -> None:
    frame = record.message
    assert isinstance(frame, FrameObserved)
    key = fitting_key(frame.vehicle, frame.camera)
    scan = state.scans.get(key) or Scan()
    captures = (*scan.captures, *_between(scan.captures, frame), frame.captured_ns)
    state.scans.put(key, scan._replace(captures=captures[-RATE_FRAMES:]))


def _between(captures: tuple[int, ...], frame: FrameObserved) -> tuple[int, ...]:
    """Return when the frames that have no record of their own were captured: evenly since the one before."""
    if not captures or not frame.empty_before:
        return ()
    before_ns, gaps = captures[-1], frame.empty_before + 1
    count = min(frame.empty_before, RATE_FRAMES)
    return tuple(frame.captured_ns - (frame.captured_ns - before_ns) * back // gaps for back in range(count, 0, -1))


def _look(state: State, record: Record) -> None:
    asked = record.message
    assert isinstance(asked, PointAtPlace)
    poi = state.pois.get(asked.poi_id)
    if poi is None:
        return
    key = fitting_key(asked.vehicle, asked.camera)
    state.pois.put(poi.poi_id, poi._replace(looked=True))
    scan = (state.scans.get(key) or Scan())._replace(poi_id=poi.poi_id, spot=Spot.of(asked.place))
    state.scans.put(key, scan)
    if scan.state == "following":
        return
    state.deadlines.put((CHART.name, key), record.at.flight_ns + state.flight.limits.look_ms * NS_PER_MS)


def _apply_move(state: State, record: Record) -> None:
    change = record.message
    assert isinstance(change, Moved)
    if change.chart != CHART.name:
        return
    scan = state.scans.get(change.instance) or Scan()
    state.scans.put(change.instance, scan._replace(state=change.to_state, poi_id=""))
    if change.to_state != "zoomed_in":
        state.deadlines.drop((CHART.name, change.instance))


PART = Part(
    chart=CHART,
    alphabet=frozenset({"frame_observed", "time_passed", "moved"}),
    decide=decide,
    evolve={"frame_observed": _frame, "point_at_place": _look, "moved": _apply_move},
    moves_of=frozenset({"command", "camera"}),
)
