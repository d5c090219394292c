"""Words about flying, for the stories: plans, self-tests, uploads, modes, progress, and orders of the flight.

    planned rev=a items=takeoff,go,go,home      uploaded / not-uploaded / mode mission / disarmed / at 2 reached=1
    report pass,degraded / order a begin / order b acknowledge 17 / order c fly to=20,-3 / order d go-into loiter

An order of the flight is given with the role "flight" unless told otherwise. Nothing here checks anything.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from google.protobuf.message import Message

from events import Record
from events.schema import safety_pb2
from events.schema.flight_pb2 import NodeStarted, OriginSet
from events.schema.mission_pb2 import (
    SELFTEST_DEGRADED,
    SELFTEST_FAIL,
    SELFTEST_PASS,
    SELFTEST_SKIPPED,
    ArmVehicle,
    FetchMission,
    MissionPlanned,
    MissionProgressReported,
    MissionUnavailable,
    MissionUploaded,
    MissionUploadFailed,
    PlannedItem,
    PostWaypoint,
    PushObservations,
    PushReported,
    RunSelftest,
    SelftestItem,
    SelftestReported,
    SetMissionItem,
    StartMission,
    UploadMission,
    WaypointPosted,
)
from events.schema.orders_pb2 import (
    MISSION_ABORT,
    MISSION_BEGIN,
    MISSION_PAUSE,
    MISSION_RESUME,
    AcknowledgeSelftestOrder,
    FlyToPlaceOrder,
    MissionOrder,
    OrderReceived,
    SetFlightModeOrder,
)
from events.schema.safety_pb2 import FlightMode, FlyToPlace, SetVehicleMode
from events.schema.vehicle_pb2 import VehicleLinkChanged, VehicleStateReported
from tests import flights

MODES: dict[str, FlightMode.ValueType] = {
    "none": safety_pb2.FLIGHT_MODE_UNSPECIFIED,
    "mission": safety_pb2.FLIGHT_MODE_MISSION,
    "loiter": safety_pb2.FLIGHT_MODE_LOITER,
    "guided": safety_pb2.FLIGHT_MODE_GUIDED,
    "return": safety_pb2.FLIGHT_MODE_RETURN,
    "land": safety_pb2.FLIGHT_MODE_LAND,
}
VERBS = {"begin": MISSION_BEGIN, "pause": MISSION_PAUSE, "resume": MISSION_RESUME, "abort": MISSION_ABORT}
VERDICTS = {
    "pass": SELFTEST_PASS,
    "degraded": SELFTEST_DEGRADED,
    "fail": SELFTEST_FAIL,
    "skipped": SELFTEST_SKIPPED,
}
COMMANDS = {"takeoff": 22, "go": 16, "home": 20, "land": 21, "speed": 178}
FLYING = (
    *("fetch_mission", "post_waypoint", "upload_mission", "run_selftest", "arm_vehicle", "start_mission"),
    *("set_mission_item", "set_vehicle_mode", "fly_to_place", "push_observations"),
)
LIMITS: dict[str, Any] = {
    "mission_enabled": True,
    "flight_enabled": True,
    "mission_begun_by_order": True,
    "flight_roles": ["flight"],
    "mission_tries": 3,
    "mission_step_ms": 10_000,
    "selftest_acknowledge_ms": 120_000,
    "upload_ms": 60_000,
    "push_ms": 60_000,
    "follow_by_waypoint": True,
}


def opening(**changes: Any) -> tuple[Message, ...]:
    """Return how a flight begins on a node that flies missions, its vehicle heard and disarmed."""
    return (
        flights.opened(flights.limits(**(LIMITS | changes))),
        OriginSet(place=flights.place(0, 0), source="configured"),
        NodeStarted(boot_id="boot", start=1),
        VehicleLinkChanged(vehicle=1, up=True),
        state(armed=False),
    )


def state(mode: str = "none", armed: bool = True, landed: int | None = None) -> VehicleStateReported:
    """Return what the autopilot says of itself."""
    told = VehicleStateReported(vehicle=1, system_id=1, autopilot=3, vehicle_type=2, armed=armed, custom_mode=0)
    told.flight_mode = MODES[mode]
    if landed is not None:
        told.landed_state = landed
    return told


def planned(revision: str = "a", items: str = "takeoff,go,go,home", **values: Any) -> MissionPlanned:
    """Return a plan with these items, each 10 m north of the one before."""
    made = [
        PlannedItem(
            command=COMMANDS[name], place=flights.place(0, 10_000 * at), height_mm=30_000, source_id=f"item {at}"
        )
        for at, name in enumerate(items.split(","))
    ]
    return MissionPlanned(vehicle=1, mission_id="m", revision=revision, items=made, **values)


def reported(records: Sequence[Record], words: str) -> SelftestReported:
    """Return the report of the newest self-test with these verdicts."""
    items = [
        SelftestItem(name=f"item {at}", verdict=VERDICTS[word]) for at, word in enumerate(words.split(",")) if word
    ]
    return SelftestReported(effect_seq=newest(records, "run_selftest"), vehicle=1, items=items)


def newest(records: Sequence[Record], *kinds: str) -> int:
    """Return the seq of the newest record of these kinds; one that never was, where there is none."""
    return next((record.seq for record in reversed(records) if record.kind.name in kinds), 1_000_000)


def _answered(records: Sequence[Record], plain: list[str]) -> Message:
    return flights.answered(newest(records, *FLYING), int(plain[0]))


def _at(plain: list[str], named: Mapping[str, str]) -> Message:
    report = MissionProgressReported(vehicle=1)
    if plain:
        report.current_item = int(plain[0])
    if "reached" in named:
        report.reached_item = int(named["reached"])
    return report


def _pushed(records: Sequence[Record], plain: list[str], named: Mapping[str, str]) -> Message:
    seq = int(plain[0]) if plain else newest(records, "push_observations")
    took = PushReported(effect_seq=seq, observations=3, ignored_items=1, attempts=1, final="again" not in named)
    if "left" in named or not took.final:
        took.left, took.because = int(named.get("left", 4)), "the office is shut"
    return took


def _plan(records: Sequence[Record], named: Mapping[str, str]) -> Message:
    """Return a plan of the newest effect that asked for one, unless `of` says otherwise."""
    given = {key: named[key] for key in ("items",) if key in named}
    asked = int(named["of"]) if "of" in named else newest(records, "fetch_mission", "post_waypoint")
    return planned(named.get("rev", "a"), fixed_wing="wing" in named, effect_seq=asked, **given)


Reader = Callable[[Sequence[Record], list[str], dict[str, str]], Message]
READERS: dict[str, Reader] = {
    "planned": lambda records, _, named: _plan(records, named),
    "no-mission": lambda _, __, named: MissionUnavailable(because="gone", attempts=1, final="final" in named),
    "report": lambda records, plain, _: reported(records, plain[0] if plain else ""),
    "report-of": lambda _, plain, __: SelftestReported(
        effect_seq=int(plain[0]), vehicle=1, items=[SelftestItem(name="a", verdict=SELFTEST_PASS)]
    ),
    "uploaded": lambda records, plain, _: MissionUploaded(
        effect_seq=int(plain[0]) if plain else newest(records, "upload_mission"), items=4, attempts=1
    ),
    "not-uploaded": lambda records, _, __: MissionUploadFailed(
        effect_seq=newest(records, "upload_mission"), because="refused", attempts=2
    ),
    "pushed": _pushed,
    "mode": lambda _, plain, named: state(plain[0], armed="disarmed" not in named),
    "armed": lambda *_: state("guided"),
    "disarmed": lambda *_: state(armed=False),
    "did": lambda records, plain, _: _answered(records, plain),
    "did-not": lambda records, plain, _: flights.unanswered(newest(records, *FLYING)),
    "at": lambda _, plain, named: _at(plain, named),
    "posted": lambda records, plain, _: WaypointPosted(
        effect_seq=newest(records, "post_waypoint"), failure=" ".join(plain)
    ),
}


def asked(name: str, verb: str, about: list[str], named: Mapping[str, str], values: dict[str, Any]) -> OrderReceived:
    """Return an order of the flight; the role is "flight" unless `roles` is given."""
    values = {"roles": ("flight",)} | values
    if verb in VERBS:
        return flights.received(name, mission=MissionOrder(verb=VERBS[verb]), **values)
    if verb == "acknowledge":
        return flights.received(name, acknowledge_selftest=AcknowledgeSelftestOrder(report_id=int(about[0])), **values)
    if verb == "fly":
        east, north = (round(1000 * float(one)) for one in named.get("to", "20,20").split(","))
        to = flights.place(east, north) if "nowhere" not in named else None
        return flights.received(name, fly_to_place=FlyToPlaceOrder(place=to), **values)
    mode = SetFlightModeOrder(mode=MODES[about[0]])
    return flights.received(name, set_flight_mode=mode, **values)


ORDERS = (*VERBS, "acknowledge", "fly", "go-into")


def words_of(message: Message) -> str:
    """Return an effect of the flight in words; "" for anything else."""
    names = {number: name for name, number in MODES.items()}
    match message:
        case FetchMission():
            return "fetch"
        case RunSelftest():
            return "test"
        case UploadMission(items=items):
            return f"upload {len(items)}"
        case ArmVehicle():
            return "arm"
        case StartMission():
            return "start"
        case SetMissionItem(item=item):
            return f"item {item}"
        case SetVehicleMode(mode=mode):
            return f"go {names[mode]}"
        case FlyToPlace(place=place):
            return f"fly {place.east_mm / 1000:g},{place.north_mm / 1000:g}"
        case PushObservations(mission_id=mission_id, life_ms=life_ms):
            return f"push {mission_id} in {life_ms // 1000} s"
        case PostWaypoint(before_item=before, height_mm=height_mm):
            return f"post before {before} at {height_mm / 1000:g} m"
    return ""
