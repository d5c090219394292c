"""Safety properties written a second time (style 22): they only watch records, and say what must never be seen.

Each monitor is a function from the steps of a flight to complaints. They share nothing with the charts but the
vocabulary, so a guard that is wrong and its monitor do not fail together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from events import NO_CAUSE, Record
from events.kinds import Role
from events.schema.common_pb2 import Moved
from events.schema.findings_pb2 import CameraTaken, PoiOpened
from events.schema.flight_pb2 import FlightOpened, Limits
from events.schema.orders_pb2 import OrderMalformed, OrderReceived, SendAck
from events.schema.vehicle_pb2 import (
    GimbalControlChanged,
    PointAtAngles,
    PointAtPlace,
    ReleasePointing,
    SetZoom,
    TakeGimbal,
)

Steps = Sequence[Sequence[Record]]
Monitor = Callable[[Steps], Iterator[str]]
SECOND_NS = 1_000_000_000
MINUTE_NS = 60_000_000_000
FINAL = ("accepted", "rejected", "timeout", "unsupported", "unauthorised")


def moves_of(step: Sequence[Record], chart: str) -> list[Moved]:
    """Return the moves of a chart in a step."""
    messages = (record.message for record in step)
    return [change for change in messages if isinstance(change, Moved) and change.chart == chart]


def limits_of(steps: Steps) -> Limits:
    """Return the limits of the flight, from its manifest."""
    manifest = steps[0][0].message
    assert isinstance(manifest, FlightOpened)
    return manifest.configuration.limits


def key_of(principal_id: str, command_id: str) -> str:
    """Return how moves name an order."""
    return f"{principal_id}/{command_id}"


def order_of(record: Record) -> str | None:
    """Return the order that a vehicle effect serves, "" for the node's own wish, None for another record."""
    effect = record.message
    return effect.order if isinstance(effect, PointAtPlace | PointAtAngles | ReleasePointing | SetZoom) else None


def in_order(steps: Steps) -> Iterator[str]:
    """Records follow each other without a gap; a decision has its step's moment and an earlier cause in it."""
    for number, record in enumerate(record for step in steps for record in step):
        if record.seq != number:
            yield f"record {record.seq} is the {number}th"
    for step in steps:
        if step[0].cause != NO_CAUSE or step[0].kind.role is not Role.OBSERVATION:
            yield f"step {step[0].seq} does not begin with an observation"
        for record in step[1:]:
            if record.at != step[0].at or not step[0].seq <= record.cause < record.seq:
                yield f"record {record.seq} does not follow from its step"


def moves_join(steps: Steps) -> Iterator[str]:
    """A move begins where the last one ended; a final order, and an ended question, never move."""
    where: dict[tuple[str, str], str] = {}
    first = {"camera": "automatic", "poi": "enqueued", "scan": "zoomed_out", "aim": "idle", "health": "normal"}
    first |= {"control": "unknown"}
    ends = {"command": FINAL, "poi": ("suppressed", "confirmed", "declined", "expired", "withdrawn")}
    for record in (record for step in steps for record in step):
        if isinstance(change := record.message, Moved):
            key = change.chart, change.instance
            before = where.get(key, first.get(change.chart, change.from_state))  # orders may be an earlier flight's
            if change.from_state != before:
                yield f"{key} moves from {change.from_state}, but it was {before}"
            if change.from_state in ends.get(change.chart, ()):
                yield f"{key} moves out of {change.from_state}"
            where[key] = change.to_state


def one_master(steps: Steps) -> Iterator[str]:
    """A camera that an operator has bears one name, of the order that was intended in that step.

    Or of whoever had it before, in a step that refused the order that had taken it.
    """
    had: set[str] = set()
    for step in steps:
        holders = [message for record in step if isinstance(message := record.message, CameraTaken)]
        cameras = [move.instance for move in moves_of(step, "camera") if move.to_state == "operator"]
        if sorted(f"{one.vehicle}/{one.camera}" for one in holders) != sorted(cameras) or len(set(cameras)) < len(
            cameras
        ):
            yield f"step {step[0].seq}: cameras {cameras} taken by {[one.callsign for one in holders]}"
        intended = {move.instance for move in moves_of(step, "command") if move.to_state == "intended"}
        refused = [move for move in moves_of(step, "command") if move.to_state in ("rejected", "unsupported")]
        names = {key_of(one.principal_id, one.command_id) for one in holders}
        if names - intended - (had if refused else set()):
            yield f"step {step[0].seq}: a camera was taken by an order that did not pass its gates"
        had |= names


def effects_are_intended(steps: Steps) -> Iterator[str]:
    """No effect without its order being intended in the same step and before it; never two for one order."""
    served: set[str] = set()
    for step in steps:
        intended: set[str] = set()
        for record in step:
            if isinstance(change := record.message, Moved) and change.chart == "command":
                intended |= {change.instance} if change.to_state == "intended" else set()
            if order := order_of(record):
                if order not in intended:
                    yield f"record {record.seq} serves {order}, which is not intended in this step"
                if order in served:
                    yield f"record {record.seq} serves {order} a second time"
                served.add(order)


def every_order_is_answered(steps: Steps) -> Iterator[str]:
    """An arrival is answered once in its step; each final move is answered once, finally.

    Only a repeat may go unanswered, after two answers to others within a second.
    """
    repeats: dict[str, list[int]] = {}
    for step in steps:
        acks = [message for record in step if isinstance(message := record.message, SendAck)]
        moves = {move.instance: move.to_state for move in moves_of(step, "command")}
        if isinstance(order := step[0].message, OrderReceived):
            key = key_of(order.issuer.principal_id, order.command_id)
            mine = [ack for ack in acks if key_of(ack.principal_id, ack.command_id) == key]
            failed = len(step) > 1 and step[1].kind.name == "step_failed"
            recent = [at_ns for at_ns in repeats.get(key, []) if step[0].at.flight_ns < at_ns + SECOND_NS]
            if len(mine) != (0 if failed or len(recent) > 1 else 1):
                yield f"step {step[0].seq}: {key} is answered {len(mine)} times"
            if key not in moves:
                repeats.setdefault(key, []).extend(step[0].at.flight_ns for _ in mine)
        for key in (key for key, state in moves.items() if state in FINAL):
            final = [ack for ack in acks if key_of(ack.principal_id, ack.command_id) == key and ack.final]
            if len(final) != 1:
                yield f"step {step[0].seq}: {key} ended and is answered {len(final)} times"


def answers_stand(steps: Steps) -> Iterator[str]:
    """The first final answer to an order is the only one: repeats hear the same, and nothing undecided follows."""
    final: dict[str, tuple[object, ...]] = {}
    bodies: dict[str, bytes] = {}
    for step in steps:
        order, key = step[0].message, ""
        if isinstance(order, OrderReceived):
            key = key_of(order.issuer.principal_id, order.command_id)
            if bodies.setdefault(key, order.body_digest) != order.body_digest:
                continue  # another body under the id: refused, which is no answer to the order
        for record in step:
            ack = record.message
            if not isinstance(ack, SendAck) or isinstance(order, OrderMalformed):
                continue
            told = ack.result, ack.detail, ack.mav_result
            one = key_of(ack.principal_id, ack.command_id)
            if one in final and (not ack.final or told != final[one]):
                yield f"record {record.seq} takes back what {one} was told"
            if ack.final:
                final[one] = told


def people_are_not_flooded(steps: Steps) -> Iterator[str]:
    """Never more questions in any rolling minute than the limit, and none below the confidence."""
    limits = limits_of(steps)
    times = [step[0].at.flight_ns for step in steps for move in moves_of(step, "poi") if move.to_state == "surfaced"]
    for index, at_ns in enumerate(times):
        if len([one for one in times[index:] if one < at_ns + MINUTE_NS]) > limits.asks_per_minute:
            yield f"too many questions in the minute from {at_ns}"
    for record in (record for step in steps for record in step):
        if isinstance(message := record.message, PoiOpened) and message.confidence_e4 < limits.ask_confidence_e4:
            yield f"record {record.seq} asks at {message.confidence_e4}"


def only_people_judge(steps: Steps) -> Iterator[str]:
    """Nothing is confirmed or declined but by an order, accepted in that step, that says so about that finding."""
    for step in steps:
        accepted = {move.instance for move in moves_of(step, "command") if move.to_state == "accepted"}
        for move in moves_of(step, "poi"):
            if move.to_state not in ("confirmed", "declined"):
                continue
            order = step[0].message
            if not isinstance(order, OrderReceived):
                yield f"step {step[0].seq}: {move.instance} is {move.to_state} by nobody"
                continue
            word = order.judge_poi.poi_id, order.judge_poi.confirmed
            if word != (move.instance, move.to_state == "confirmed"):
                yield f"step {step[0].seq}: {move.instance} is {move.to_state}, which nobody said"
            if key_of(order.issuer.principal_id, order.command_id) not in accepted:
                yield f"step {step[0].seq}: {move.instance} is {move.to_state} by an order that was not accepted"


def hands_off(steps: Steps) -> Iterator[str]:
    """The node itself moves no camera that somebody has, or that rests, and none where it may not at all."""
    cameras: dict[str, str] = {}
    for step in steps:
        cameras |= {move.instance: move.to_state for move in moves_of(step, "camera")}
        for record in (record for record in step if order_of(record) == ""):
            effect = record.message
            assert isinstance(effect, PointAtPlace | PointAtAngles | ReleasePointing)
            if cameras.get(f"{effect.vehicle}/{effect.camera}", "automatic") != "automatic":
                yield f"record {record.seq} moves a camera that the node does not have"
            if not limits_of(steps).scan_enabled:
                yield f"record {record.seq} moves a camera where that is switched off"


def nobody_is_fought(steps: Steps) -> Iterator[str]:
    """Control of a gimbal is asked for only before an operator's pointing, and never while another has it."""
    others: set[tuple[int, int]] = set()
    for step in steps:
        told = step[0].message
        if isinstance(told, GimbalControlChanged):
            others.discard((told.vehicle, told.gimbal))
            if told.system_id and not told.ours:
                others.add((told.vehicle, told.gimbal))
        for record in step:
            if not isinstance(taken := record.message, TakeGimbal):
                continue
            if (taken.vehicle, taken.gimbal) in others and not limits_of(steps).take_from_others:
                yield f"record {record.seq} takes a gimbal from another"
            if not isinstance(told, OrderReceived):
                yield f"record {record.seq} takes a gimbal that no operator asked for"


def safe_mode_is_quiet(steps: Steps) -> Iterator[str]:
    """In safe mode nothing is asked of the vehicle and nothing of people."""
    safe = False
    for step in steps:
        for move in moves_of(step, "health"):
            safe = move.to_state == "safe_mode"
        asked = [record for record in step if record.kind.port == "vehicle" or record.kind.name == "poi_opened"]
        if safe and asked:
            yield f"step {step[0].seq}: {asked[0].kind.name} in safe mode"


MONITORS: tuple[Monitor, ...] = (
    in_order,
    moves_join,
    one_master,
    effects_are_intended,
    every_order_is_answered,
    answers_stand,
    people_are_not_flooded,
    only_people_judge,
    hands_off,
    nobody_is_fought,
    safe_mode_is_quiet,
)


def complaints(steps: Steps) -> list[str]:
    """Return what all monitors say about a flight."""
    return [f"{monitor.__name__}: {complaint}" for monitor in MONITORS for complaint in monitor(steps)]
