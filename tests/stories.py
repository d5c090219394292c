"""Flights in words: what is observed and what is said about it, as short lines that a table or Hypothesis can hold.

    story = Story(scan_enabled=True)
    story.tell("order a point by=bravo seq=4")      # -> the records of the step
    words_of(story, records[1])                     # -> "a accepted"

Orders have one name for ever, points of interest are p1, p2 in the order in which they were opened. Positions are
metres from the origin. Nothing here checks anything.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from google.protobuf.message import Message

from events import NO_CAUSE, Record, uuid_of
from events.schema.common_pb2 import Moved, Place
from events.schema.eyes_pb2 import Detection
from events.schema.findings_pb2 import (
    NEW,
    CameraTaken,
    ItemIgnored,
    PoiJoined,
    PoiLeft,
    PoiOpened,
    SightingMuted,
    SightingsClassified,
)
from events.schema.flight_pb2 import NodeStarted, StepFailed, TimePassed
from events.schema.orders_pb2 import (
    ACK_STAGE_IN_PROGRESS,
    ACK_STAGE_RECEIVED,
    ACK_STAGE_SENT,
    AckResult,
    FollowPoiOrder,
    OrderReceived,
    SendAck,
    ZoomCameraOrder,
)
from events.schema.trust_pb2 import EpochTaken, RevocationsTaken, RootTaken, TimeLearned
from events.schema.vehicle_pb2 import (
    CameraDescribed,
    CameraZoomed,
    GimbalControlChanged,
    GimbalDescribed,
    GiveUpGimbal,
    PointAtAngles,
    PointAtPlace,
    ReleasePointing,
    SetZoom,
    TakeGimbal,
    VehicleLinkChanged,
)
from tests import flights, flying
from tests.flights import FLIGHT_ID, NS_PER_MS, Flight

MS_PER_S = 1000
STAGES: dict[int, str] = {ACK_STAGE_RECEIVED: "received", ACK_STAGE_SENT: "sent", ACK_STAGE_IN_PROGRESS: "in progress"}
EFFECTS = ("point_at_place", "point_at_angles", "release_pointing", "take_gimbal", "give_up_gimbal", "set_zoom")
ORDERED = ("point_at_place", "point_at_angles", "release_pointing", "set_zoom")


class Story:
    """A flight that is told in words."""

    def __init__(self, *opening: Message, **changes: Any) -> None:
        """Open a flight with `flights.limits(**changes)`."""
        self.flight = Flight(*(opening or flights.opened_well(flights.limits(**changes))))
        self.pois: list[str] = []
        self._orders: dict[str, OrderReceived] = {}
        self._seqs: dict[str, int] = {}
        self._sends = 1
        self._frames = 0
        self._starts = 1

    def at(self, at_ms: int) -> None:
        """Set the clock."""
        self.flight.now_ns = at_ms * NS_PER_MS

    def tell(self, words: str) -> tuple[Record, ...]:
        """Observe what the words say; return the records of the step."""
        verb, *rest = words.split()
        plain = [word for word in rest if "=" not in word]
        named = dict(word.split("=", 1) for word in rest if "=" in word)
        readers: dict[str, Callable[[list[str], dict[str, str]], Message]] = {
            "order": self._order,
            "again": self._again,
            "malformed": lambda plain, _: flights.malformed(plain[0]),
            "sent": lambda plain, _: flights.sent(self._effect(plain)),
            "answered": lambda plain, _: flights.answered(self._effect(plain), int(plain[1])),
            "unanswered": lambda plain, _: flights.unanswered(self._effect(plain), because=" ".join(plain[1:])),
            "published": self._published,
            "list": _list,
            "root": lambda plain, _: RootTaken(root_version=int(plain[0])),
            "epoch": lambda plain, _: EpochTaken(epoch_id=int(plain[0])),
            "floor": lambda plain, _: TimeLearned(floor_ms=int(plain[0])),
            "gimbal": self._gimbal,
            "described": _described,
            "control": _control,
            "lens": lambda plain, _: CameraDescribed(vehicle=1, camera=1, zooms="zooms" in plain),
            "zoomed": lambda plain, _: CameraZoomed(vehicle=1, camera=1, zoom_e4=int(plain[0])),
            "frame": self._frame,
            "vehicle": lambda plain, _: VehicleLinkChanged(vehicle=1, up=plain[0] == "up"),
            "start": self._start,
            "close": lambda *_: flights.closed(),
            "time": lambda *_: TimePassed(),
        }
        if verb in flying.READERS:
            return self.flight.tell(flying.READERS[verb](self.flight.records, plain, named))
        records = self.flight.tell(readers[verb](plain, named))
        opened = (record.seq for record in records if record.kind.name == "poi_opened")
        self.pois.extend(uuid_of(FLIGHT_ID, seq) for seq in opened)
        return records

    def poi_name(self, poi_id: str) -> str:
        """Return p1, p2 and so on."""
        return f"p{self.pois.index(poi_id) + 1}" if poi_id in self.pois else poi_id

    def _poi_id(self, name: str) -> str:
        number = int(name[1:]) - 1
        return self.pois[number] if number < len(self.pois) else name

    def _order(self, plain: list[str], named: dict[str, str]) -> OrderReceived:
        name, verb, *about = plain
        who = named.get("by", "alpha")
        seq = int(named.get("seq", self._seqs.get(who, 0) + 1))
        self._seqs[who] = max(seq, self._seqs.get(who, 0))
        values: dict[str, Any] = {"order_seq": seq, "who": who, "send": self._sends}
        self._sends += 1
        if "roles" in named:
            values["roles"] = tuple(filter(None, named["roles"].split(",")))
        if "target" in named:
            values["target_public_key"] = named["target"].encode() * 8
        if "life" in named:
            values["life_ms"] = int(named["life"])
        if "overdue" in named:
            values["revocation_overdue_ms"] = int(named["overdue"])
        values |= {flag: True for flag in ("time_uncertain", "before_memory") if flag in about}
        if "nonce" in named:
            values["nonce"] = named["nonce"].encode() * 3
        order = self._asked(name, verb, about, named, values)
        self._orders.setdefault(name, order)
        return order

    def _asked(
        self, name: str, verb: str, about: list[str], named: dict[str, str], values: dict[str, Any]
    ) -> OrderReceived:
        camera = int(named.get("camera", 1))
        if verb in flying.ORDERS:
            return flying.asked(name, verb, about, named, values)
        match verb:
            case "point":
                order = flights.point_at_place(name, camera=camera, **values)
                if named.get("at") == "null":
                    order.point_at_place.place.CopyFrom(Place())
                return order
            case "turn":
                values |= {f"{axis}_cdeg": int(named[axis]) for axis in ("pitch", "yaw") if axis in named}
                values |= {"yaw_locked": False} if "nose" in about else {}
                return flights.point_at_angles(name, camera=camera, **values)
            case "zoom":
                return flights.received(name, zoom_camera=ZoomCameraOrder(camera=camera, zoom_e4=4_000), **values)
            case "release":
                return flights.release(name, camera=camera, **values)
            case "confirm" | "decline":
                return flights.judge(name, self._poi_id(about[0]), confirmed=verb == "confirm", **values)
            case "follow":
                following = FollowPoiOrder(poi_id=self._poi_id(about[0]), camera=camera)
                return flights.received(name, follow_poi=following, **values)
        return flights.received(name, **values)

    def _again(self, plain: list[str], named: dict[str, str]) -> OrderReceived:
        """Publish an order again: a fresh envelope, the same body unless told otherwise."""
        order = OrderReceived()
        order.CopyFrom(self._orders[plain[0]])
        order.nonce = f"again {self._sends}".ljust(24).encode()
        order.in_reply_to = f"reply {self._sends}".ljust(32).encode()
        order.body_digest = named["body"].encode() * 8 if "body" in named else order.body_digest
        self._sends += 1
        return order

    def _effect(self, plain: list[str]) -> int:
        """Return the seq of the effect that serves an order, of the newest, of the newest own one, or of none."""
        if plain[0].isdigit():
            return int(plain[0])
        wanted = {"own": ""}.get(plain[0], plain[0])
        for record in reversed(self.flight.records):
            if record.kind.name in ORDERED and wanted in ("newest", short(_effect_order(record))):
                return record.seq
        return 1_000_000

    def _published(self, plain: list[str], named: dict[str, str]) -> Message:
        acks = (record for record in reversed(self.flight.records) if record.kind.name == "send_ack")
        seqs = [record.seq for record in acks if _ack(record).command_id == plain[0]]
        return flights.published([*seqs, 1_000_000][0], named.get("failure", ""))

    def _gimbal(self, plain: list[str], named: dict[str, str]) -> Message:
        if "error" not in named:
            return flights.gimbal(-1000, 0)
        report = flights.gimbal(-1000, 0, self._effect(plain), int(named["error"]))
        if "demanded" in plain:
            report.demanded = True
        return report

    def _frame(self, plain: list[str], named: dict[str, str]) -> Message:
        self._frames += 1
        found = [_detection(word) for word in plain]
        frame = flights.frame(self._frames, *found, camera=int(named.get("camera", 1)))
        frame.captured_ns = self.flight.now_ns
        return frame

    def _start(self, plain: list[str], _named: dict[str, str]) -> Message:
        self._starts += 1
        started = NodeStarted(boot_id="boot", start=self._starts, outage_ns=1)
        if plain:
            started.outage_unbounded = " ".join(plain)
        return started


def _described(plain: list[str], named: dict[str, str]) -> GimbalDescribed:
    """Read "pans pitch=-9000,2000 yaw=-3000,3000", or "turns": what a gimbal's manager tells."""
    told = GimbalDescribed(
        vehicle=1, gimbal=1, managed=bool(named), pans="pans" in plain, turns_vehicle="turns" in plain
    )
    if "pitch" in named:
        told.pitch_min_cdeg, told.pitch_max_cdeg = map(int, named["pitch"].split(","))
    if "yaw" in named:
        told.yaw_min_cdeg, told.yaw_max_cdeg = map(int, named["yaw"].split(","))
    return told


def _control(plain: list[str], _named: dict[str, str]) -> GimbalControlChanged:
    """Read "255/190", "1/191 ours" or "0/0": who controls the gimbal."""
    system, component = map(int, plain[0].split("/"))
    return GimbalControlChanged(vehicle=1, gimbal=1, system_id=system, component_id=component, ours="ours" in plain)


def _list(plain: list[str], named: dict[str, str]) -> RevocationsTaken:
    """Read "12 key=k body=b": a revocation list of this version is in force."""
    key, body = (named.get(what, "-").encode() for what in ("key", "body"))
    return RevocationsTaken(list_version=int(plain[0]), key_id=key * 16, digest=body * 32)


def _detection(word: str) -> Detection:
    """Read "person@3,-4:90": a person 3 m east and 4 m south, 90 %; "person@-" has no place."""
    class_name, where = word.split("@")
    where, _, percent = where.partition(":")
    confidence_e4 = round(100 * float(percent or 80))
    if where == "-":
        return Detection(class_name=class_name, confidence_e4=confidence_e4, no_place_because="too far")
    east, north = (round(1000 * float(one)) for one in where.split(","))
    return flights.detection(east, north, class_name, confidence_e4)


def short(instance: str) -> str:
    """Return the name of an order from its key."""
    return instance.rpartition("/")[2]


def instance_words(story: Story, change: Moved) -> str:
    """Return how a table names what moved."""
    if change.chart == "command":
        return short(change.instance)
    return story.poi_name(change.instance) if change.chart == "poi" else change.instance


def _effect_order(record: Record) -> str:
    effect = record.message
    assert isinstance(effect, PointAtPlace | PointAtAngles | ReleasePointing | SetZoom)
    return effect.order


def _ack(record: Record) -> SendAck:
    assert isinstance(record.message, SendAck)
    return record.message


def words_of(story: Story, record: Record) -> str:
    """Return a decision in words."""
    match record.message:
        case SendAck(command_id=name, final=False, stage=stage, duplicate=duplicate):
            return f"{name} {STAGES.get(stage, 'undecided')}{' again' * duplicate}"
        case SendAck(command_id=name, result=result, duplicate=duplicate):
            again = " again" * duplicate
            return f"{name} {AckResult.Name(result).removeprefix('ACK_').lower()}{again}"
        case PointAtPlace(place=place):
            return f"look {place.east_mm / 1000:g},{place.north_mm / 1000:g}"
        case PointAtAngles(pitch_cdeg=pitch, yaw_cdeg=yaw):
            return f"turn {pitch / 100:g},{yaw / 100:g}"
        case ReleasePointing():
            return "let go"
        case TakeGimbal():
            return "take"
        case GiveUpGimbal():
            return "give up"
        case SetZoom(zoom_e4=zoom):
            return f"zoom {zoom / 100:g}"
        case CameraTaken(callsign=callsign):
            return f"{callsign} has it"
        case PoiOpened(object=number):
            return f"open {story.poi_name(uuid_of(FLIGHT_ID, record.seq))} for {number}"
        case PoiJoined(poi_id=poi_id, object=number):
            return f"{number} joins {story.poi_name(poi_id)}"
        case PoiLeft(poi_id=poi_id, object=number):
            return f"{number} leaves {story.poi_name(poi_id)}"
        case SightingMuted(poi_id=poi_id, object=number):
            return f"{number} muted by {story.poi_name(poi_id)}"
        case ItemIgnored(poi_id=poi_id, principal_id=who):
            return f"{who} mutes {story.poi_name(poi_id)}"
        case SightingsClassified(sightings=sightings):
            words = {True: "new {0.object}", False: "same {0.object} {0.distance_mm}mm"}
            return ", ".join(words[one.diff == NEW].format(one) for one in sightings)
        case StepFailed(chart=chart, error=error):
            return f"failed {chart} {error}"
    return flying.words_of(record.message) or record.kind.name


def is_observation(record: Record) -> bool:
    """Say whether a record came from outside."""
    return record.cause == NO_CAUSE
