"""Projection `audit`: who ordered what, when, and what came of it (seed 004, OperatorCommand: audit logs).

One row an order, however often it arrived; and rows for what could not be read, for judgements on findings, and
for each time that a camera or a gimbal changed hands. Every row names the records that it rests on. Signatures stay in
the log.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from events.ids import uuid_of
from events.records import Record
from events.schema.common_pb2 import Issuer, Moved
from events.schema.findings_pb2 import CameraTaken, PoiOpened
from events.schema.flight_pb2 import FlightOpened, StepFailed
from events.schema.orders_pb2 import AckPublished, OrderMalformed, OrderReceived, SendAck
from events.schema.safety_pb2 import FlyToPlace, SetVehicleMode
from events.schema.vehicle_pb2 import (
    CommandAnswered,
    CommandSent,
    CommandUnanswered,
    GimbalControlChanged,
    PointAtAngles,
    PointAtPlace,
    ReleasePointing,
    SetZoom,
)
from projections.describe import control_words, order_verb, order_words, result_word
from projections.picture import RESULTS
from projections.rows import Projection, Table

Effect = PointAtPlace | PointAtAngles | ReleasePointing | SetZoom | FlyToPlace | SetVehicleMode  # of an order

JUDGEMENTS = ("confirmed", "declined")


@dataclass(frozen=True, slots=True)
class AuditRow:
    """One line of the audit."""

    seq: int  # record that it began with
    what: str  # "order", "reused id", "malformed", "judgement", "camera", "gimbal"
    flight_ns: int
    wall_ns: int  # wall clock of the record, nanoseconds since 1970
    clock_quality: int
    principal_id: str
    callsign: str
    device_key_id: str  # hex
    command_id: str
    verb: str
    asked: str  # in words
    result: str  # one of the five answers, a judgement, the camera's new state; "" while it is open
    detail: str
    mav_result: int | None
    attempts: int  # how often it was sent to the vehicle
    duplicates: int  # how often it came again and was told the stored result
    seqs: tuple[int, ...]  # all records that the row rests on


class Audit:
    """The rows, and what is needed to know which row a record belongs to."""

    def __init__(self) -> None:
        self.rows: Table[int, AuditRow] = Table(AuditRow, "seq")
        self.flight_id = b""
        self.arrival: Record | None = None  # an order whose judgement comes next
        self.orders: dict[str, int] = {}  # principal/command_id: seq of its row
        self.effects: dict[int, int] = {}  # seq of an effect or an answer: seq of its row
        self.holders: dict[str, str] = {}  # camera key: callsign of its holder
        self.controllers: dict[str, str] = {}  # gimbal key: who controls it
        self.found: dict[str, str] = {}  # point of interest: what it is


def start() -> Audit:
    """Return an audit of nothing."""
    return Audit()


def apply(audit: Audit, record: Record) -> Audit:
    """Return the audit after one more record."""
    _passed_over(audit, record)
    change = _CHANGES.get(record.kind.name)
    if change is not None:
        change(audit, record, record.message)
    return audit


def tables(audit: Audit) -> Mapping[str, Table[Any, Any]]:
    """Return the rows."""
    return {"audit": audit.rows}


def _add(audit: Audit, record: Record, what: str, issuer: Issuer, command_id: str, **values: Any) -> AuditRow:
    settled: dict[str, Any] = {
        "verb": "",
        "asked": "",
        "result": "",
        "detail": "",
        "mav_result": None,
        "attempts": 0,
        "duplicates": 0,
        "seqs": (record.seq,),
    }
    row = AuditRow(
        seq=record.seq,
        what=what,
        flight_ns=record.at.flight_ns,
        wall_ns=record.at.wall_ns,
        clock_quality=record.at.clock_quality,
        principal_id=issuer.principal_id,
        callsign=issuer.callsign,
        device_key_id=issuer.device_key_id.hex(),
        command_id=command_id,
        **(settled | values),
    )
    audit.rows.put(row.seq, row)
    return row


def _rest_on(audit: Audit, seq: int | None, record: Record, **changes: Any) -> None:
    """Note that a row rests on this record too; the row may belong to a flight before, then there is none."""
    row = None if seq is None else audit.rows.get(seq)
    if row is not None:
        audit.rows.put(row.seq, replace(row, seqs=(*row.seqs, record.seq), **changes))


def _opened(audit: Audit, _record: Record, opened: FlightOpened) -> None:
    audit.flight_id = opened.flight_id


def _arrived(audit: Audit, record: Record, _order: OrderReceived) -> None:
    audit.arrival = record  # the decision that follows says whether it is new


def _judged_now(audit: Audit, record: Record) -> Record | None:
    """Return the order that this decision judges: the one that it was caused by."""
    arrival = audit.arrival
    return arrival if arrival is not None and arrival.seq == record.cause else None


def _passed_over(audit: Audit, record: Record) -> None:
    """Count a repeat that was not answered: nothing was decided on it."""
    arrival = audit.arrival
    if arrival is None or record.cause == arrival.seq:
        return
    audit.arrival = None
    order = arrival.message
    assert isinstance(order, OrderReceived)
    before = audit.rows.get(audit.orders.get(_key(order.issuer.principal_id, order.command_id), -1))
    if before is not None:
        _rest_on(audit, before.seq, arrival, duplicates=before.duplicates + 1)


def _order(audit: Audit, arrival: Record, what: str) -> AuditRow:
    order = arrival.message
    assert isinstance(order, OrderReceived)
    audit.arrival = None
    verb, asked = order_verb(order), order_words(order)
    row = _add(audit, arrival, what, order.issuer, order.command_id, verb=verb, asked=asked)
    if what == "order":
        audit.orders[_key(order.issuer.principal_id, order.command_id)] = row.seq
    return row


def _moved(audit: Audit, record: Record, moved: Moved) -> None:
    match moved.chart:
        case "command":
            _order_moved(audit, record, moved)
        case "camera" if moved.to_state != "operator":
            _freed(audit, record, moved)
        case "poi" if moved.to_state in JUDGEMENTS:
            _judgement(audit, record, moved)


def _order_moved(audit: Audit, record: Record, moved: Moved) -> None:
    arrival = _judged_now(audit, record)
    if arrival is not None:
        _order(audit, arrival, "order")
    final = {"result": moved.to_state, "detail": moved.because} if moved.to_state in RESULTS else {}
    _rest_on(audit, audit.orders.get(moved.instance), record, **final)


def _answer(audit: Audit, record: Record, ack: SendAck) -> None:
    key = _key(ack.principal_id, ack.command_id)
    arrival = _judged_now(audit, record)
    if arrival is not None and ack.duplicate:
        _repeated(audit, arrival, ack, key)
    elif arrival is not None:
        _order(audit, arrival, "reused id")
        audit.rows.put(arrival.seq, replace(audit.rows[arrival.seq], result=_result(ack), detail=ack.detail))
    elif record.cause in audit.rows and audit.rows[record.cause].what == "malformed":
        audit.rows.put(record.cause, replace(audit.rows[record.cause], result=_result(ack)))
    row_seq = record.cause if record.cause in audit.rows else audit.orders.get(key)
    _rest_on(audit, row_seq, record)
    if row_seq is not None:
        audit.effects[record.seq] = row_seq


def _repeated(audit: Audit, arrival: Record, ack: SendAck, key: str) -> None:
    """Count an order that came again; one that the flight before had answered gets its row here."""
    audit.arrival = None
    if key in audit.orders:
        before = audit.rows[audit.orders[key]]
        _rest_on(audit, before.seq, arrival, duplicates=before.duplicates + 1)
    else:
        row = _order(audit, arrival, "order")
        audit.rows.put(row.seq, replace(row, result=_result(ack), detail=ack.detail, duplicates=1))


def _result(ack: SendAck) -> str:
    return result_word(ack.result) if ack.final else ""


def _effect(audit: Audit, record: Record, effect: Effect) -> None:
    row_seq = audit.orders.get(effect.order)
    if row_seq is not None:
        audit.effects[record.seq] = row_seq
    _rest_on(audit, row_seq, record)


def _outcome(audit: Audit, record: Record, outcome: CommandAnswered | CommandUnanswered) -> None:
    row_seq = audit.effects.get(outcome.effect_seq)
    if row_seq is None:
        return
    changes: dict[str, int] = {"attempts": outcome.attempts}
    if isinstance(outcome, CommandAnswered) and not audit.rows[row_seq].result:
        changes["mav_result"] = outcome.mav_result  # a late answer is in `seqs`, but it is not what decided
    _rest_on(audit, row_seq, record, **changes)


def _left(audit: Audit, record: Record, about: CommandSent | AckPublished) -> None:
    _rest_on(audit, audit.effects.get(about.effect_seq), record)


def _malformed(audit: Audit, record: Record, malformed: OrderMalformed) -> None:
    _add(audit, record, "malformed", malformed.issuer, malformed.command_id, detail=malformed.because)


def _failed(audit: Audit, record: Record, _failure: StepFailed) -> None:
    arrival = _judged_now(audit, record)
    if arrival is not None:
        row = _order(audit, arrival, "order")
        _rest_on(audit, row.seq, record, detail="deciding on it failed; nothing was done")


def _taken(audit: Audit, record: Record, taken: CameraTaken) -> None:
    camera = f"{taken.vehicle}/{taken.camera}"
    name = taken.callsign or taken.principal_id
    before = audit.holders.get(camera, "")
    if name == before:
        return
    audit.holders[camera] = name
    issuer = Issuer(principal_id=taken.principal_id, callsign=taken.callsign)
    whose = f"from {before}" if before else "from nobody"
    detail = f"camera {camera} {whose}"
    _add(audit, record, "camera", issuer, taken.command_id, asked=f"camera {camera}", result="operator", detail=detail)


def _freed(audit: Audit, record: Record, moved: Moved) -> None:
    before = audit.holders.pop(moved.instance, "")
    if moved.from_state == "released" and moved.to_state == "released":
        return
    detail = f"{moved.because} (was {before})" if before else moved.because
    asked, to_state = f"camera {moved.instance}", moved.to_state
    _add(audit, record, "camera", Issuer(), "", asked=asked, result=to_state, detail=detail)


def _controlled(audit: Audit, record: Record, change: GimbalControlChanged) -> None:
    gimbal = f"{change.vehicle}/{change.gimbal}"
    now, before = control_words(change.system_id, change.component_id, ours=change.ours), audit.controllers.get(gimbal)
    if now == before:
        return
    audit.controllers[gimbal] = now
    detail = f"was {before}" if before else "as its manager says first"
    _add(audit, record, "gimbal", Issuer(), "", asked=f"control of gimbal {gimbal}", result=now, detail=detail)


def _found(audit: Audit, record: Record, found: PoiOpened) -> None:
    audit.found[uuid_of(audit.flight_id, record.seq)] = f"{found.class_name} at {found.place.mgrs}"


def _judgement(audit: Audit, record: Record, moved: Moved) -> None:
    order = audit.rows.get(record.cause)
    issuer = Issuer() if order is None else Issuer(principal_id=order.principal_id, callsign=order.callsign)
    asked = f"finding {moved.instance}: {audit.found.get(moved.instance, 'of a flight before')}"
    command_id = "" if order is None else order.command_id
    _add(audit, record, "judgement", issuer, command_id, asked=asked, result=moved.to_state, detail=moved.because)


def _key(principal_id: str, command_id: str) -> str:
    return f"{principal_id}/{command_id}"


_CHANGES: dict[str, Callable[[Audit, Record, Any], None]] = {
    "flight_opened": _opened,
    "order_received": _arrived,
    "order_malformed": _malformed,
    "moved": _moved,
    "send_ack": _answer,
    "point_at_place": _effect,
    "point_at_angles": _effect,
    "release_pointing": _effect,
    "set_zoom": _effect,
    "fly_to_place": _effect,
    "set_vehicle_mode": _effect,
    "gimbal_control_changed": _controlled,
    "command_sent": _left,
    "command_answered": _outcome,
    "command_unanswered": _outcome,
    "ack_published": _left,
    "camera_taken": _taken,
    "poi_opened": _found,
    "step_failed": _failed,
}

PROJECTION = Projection("audit", 3, start, apply, tables)
