"""Chart `command`: the life of an operator's order on this node (seed 000, Node verification pipeline).

Theory of operation. The edge has verified, opened and decoded; from the target check on an order is judged here, in
the seed's order of gates: target, reception, role, what the node knows of revocations and time, repeat, sequence, then
what the order asks. An order that passes is
`intended`, and only then, in the same durable step, an effect asks the vehicle for it. What the vehicle answers moves
it on, and each rung of that ladder (received, sent, in progress) is told; a final answer never changes. Every order
gets exactly one final result of five, and every arrival gets an answer: a repeat is told the stored result, a repeat
with another body is refused and changes nothing. Two answers to repeats of an id within a second are enough: more would
let whoever repeats make the node publish.

It must never perform an order twice. So an order that is found without an outcome at a start of the daemon is not sent
again: what became of it is unknown, and that is the answer; so it is with an order that may have come before the log of
then was lost. An answer that is not known to have left is given again. A revocation list that is overdue still revokes,
and allows less the longer it is; one that is known to be older than what this node had allows nothing.

Numbers of an order count for its sender's device: an older order that arrives after a newer one must not undo it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from events.schema.orders_pb2 import OrderReceived
from statecharts.charts import command_flight as flight
from statecharts.charts import command_gimbal as gimbal
from statecharts.charts import command_override as override
from statecharts.charts import gimbals
from statecharts.charts.command_flight import named_place
from statecharts.facts import Arrival, Order
from statecharts.state import State
from statecharts.table import Chart, Row, ignore, move, refuse

FINAL = ("accepted", "rejected", "timeout", "unsupported", "unauthorised")
UNDERWAY = ("intended", "sent", "in_progress")
# What points, zooms, releases or judges harms nobody much. Anything else, also what is not known here, moves more.
CAMERA_VERBS = ("point", "zoom", "release", "judge", "follow")
FLIGHT_VERBS = ("fly", "mode", "mission", "acknowledge", "override")
# A person's word: it is recorded, other charts hear it, and nothing leaves for the vehicle by this chart.
RECORDED_VERBS = ("judge", "mission", "acknowledge")

# A repeat of an order is answered so often within so long; what comes beyond that hears nothing.
REPEATS_ANSWERED = 2
REPEATS_WITHIN_NS = 1_000_000_000

MAV_ACCEPTED = 0
MAV_UNSUPPORTED = 3
MAV_IN_PROGRESS = 5
# Answers that say "not in this form, or not at all" (MAVLink common.xml, MAV_RESULT): 3, 7, 8, 9.
MAV_UNSUPPORTED_ALL = (3, 7, 8, 9)


@dataclass(frozen=True, slots=True)
class Facts:
    """What the guards look at."""

    order: Order
    state: State
    now_ns: int
    arrival: Arrival | None = None
    received: OrderReceived | None = None
    mav_result: int = -1
    because: str = ""


def other_node(facts: Facts) -> bool:
    """The order is bound to another node's key."""
    asked = facts.received
    return asked is None or asked.target_public_key != facts.state.flight.node_public_key


def reception_off(facts: Facts) -> bool:
    """Orders are switched off on this node."""
    return not facts.state.flight.limits.command_enabled


def role_missing(facts: Facts) -> bool:
    """None of the issuer's roles may ask this; an empty list allows nobody.

    What a kind of order is about, camera or flight, decides which list counts. One that this node does not know may be
    about either.
    """
    asked, manifest = facts.received, facts.state.flight
    allowed = (*manifest.camera_roles, *manifest.flight_roles)
    if facts.order.verb in CAMERA_VERBS:
        allowed = manifest.camera_roles
    elif facts.order.verb in FLIGHT_VERBS:
        allowed = manifest.flight_roles
    return asked is None or not any(role in allowed for role in asked.issuer.roles)


def list_lost(facts: Facts) -> bool:
    """The list or root that the node goes by is older than one it had: who is revoked is not known."""
    return facts.state.trusted.value.list_behind or facts.state.trusted.value.root_behind


def list_overdue(facts: Facts) -> bool:
    """The revocation list has been overdue for longer than this kind of order allows."""
    limits = facts.state.flight.limits
    allowed_ms = limits.overdue_camera_ms if facts.order.verb in CAMERA_VERBS else limits.overdue_flight_ms
    return facts.arrival is not None and facts.arrival.overdue_ms > allowed_ms


def time_uncertain(facts: Facts) -> bool:
    """The node does not know what time it is, and the order is not for a camera."""
    return facts.arrival is not None and facts.arrival.time_uncertain and facts.order.verb not in CAMERA_VERBS


def before_memory(facts: Facts) -> bool:
    """The order may have been performed already: what was done before this start is lost."""
    return facts.arrival is not None and facts.arrival.before_memory


def replayed(facts: Facts) -> bool:
    """The envelope's nonce was seen before: the gate let through what it must not."""
    return facts.arrival is not None and facts.arrival.replayed


def older(facts: Facts) -> bool:
    """A newer order of the same device came first."""
    return facts.arrival is not None and facts.arrival.order_seq <= facts.arrival.newest_seq


def safe_mode(facts: Facts) -> bool:
    """The node is in safe mode."""
    return facts.state.health.value != "normal"


def too_late(facts: Facts) -> bool:
    """The order's life is over."""
    return facts.order.expires_ns <= facts.now_ns


def unknown_verb(facts: Facts) -> bool:
    """The order is of a variant that this node does not know."""
    return not facts.order.verb


def no_such_camera(facts: Facts) -> bool:
    """The order names a camera that is not on board, or one that nothing turns."""
    if facts.order.verb == "zoom":
        return facts.order.camera not in facts.state.flight.gimbal_of
    if facts.order.verb not in ("point", "release", "follow"):
        return False
    return not facts.state.flight.gimbal_of.get(facts.order.camera)


def null_place(facts: Facts) -> bool:
    """The place is 0, 0, 0: an autopilot would take it for "cancel"."""
    place = named_place(facts)
    return place is not None and not (place.latitude_e7 or place.longitude_e7 or place.altitude_mm)


def nowhere(facts: Facts) -> bool:
    """A place is asked before the local frame has an origin."""
    return named_place(facts) is not None and facts.state.origin.value is None


def unknown_poi(facts: Facts) -> bool:
    """The point of interest was never put to an operator."""
    poi = facts.state.pois.get(facts.order.poi_id)
    return facts.order.verb == "judge" and (poi is None or poi.state in ("enqueued", "suppressed"))


def poi_over(facts: Facts) -> bool:
    """The point of interest no longer waits for a decision."""
    poi = facts.state.pois.get(facts.order.poi_id)
    return facts.order.verb == "judge" and poi is not None and poi.state != "surfaced"


def not_confirmed(facts: Facts) -> bool:
    """Something is to be followed that no person has confirmed."""
    poi = facts.state.pois.get(facts.order.poi_id)
    return facts.order.verb == "follow" and (poi is None or poi.state != "confirmed")


def to_follow(facts: Facts) -> bool:
    """A finding is to be kept in view: the chart of the scan does it."""
    return facts.order.verb == "follow"


def judgement(facts: Facts) -> bool:
    """The order is a person's word, on a finding or on the mission: nothing leaves for the vehicle by it."""
    return facts.order.verb in RECORDED_VERBS


def vehicle_silent(facts: Facts) -> bool:
    """No heartbeat of the vehicle is heard."""
    vehicle = facts.state.vehicles.get(1)
    return vehicle is None or not vehicle.link


def other_body(facts: Facts) -> bool:
    """The same id came before with another body."""
    return facts.arrival is not None and facts.arrival.digest != facts.order.digest


def answered_enough(facts: Facts) -> bool:
    """Repeats of the order were answered as often as they may be within a second."""
    answered_ns = facts.order.repeats_answered_ns
    return len(answered_ns) == REPEATS_ANSWERED and facts.now_ns < answered_ns[0] + REPEATS_WITHIN_NS


def vehicle_accepted(facts: Facts) -> bool:
    """COMMAND_ACK says accepted."""
    return facts.mav_result == MAV_ACCEPTED


def vehicle_busy(facts: Facts) -> bool:
    """COMMAND_ACK says in progress."""
    return facts.mav_result == MAV_IN_PROGRESS


def vehicle_lacks_it(facts: Facts) -> bool:
    """COMMAND_ACK says that the vehicle does not have this command, or not in this form."""
    return facts.mav_result in MAV_UNSUPPORTED_ALL


def never_left(facts: Facts) -> bool:
    """The command could not be sent at all, or a newer one took its place."""
    return facts.because in ("no vehicle", "not encodable", "superseded")


# What becomes of an order that arrives, in the order in which the gates are asked.
_GATES: tuple[tuple[str, str, Callable[[Facts], bool] | None], ...] = (
    ("unauthorised", "not for this node", other_node),
    ("unsupported", "orders are switched off on this node", reception_off),
    ("unauthorised", "role not permitted", role_missing),
    ("unauthorised", "revocation list lost: it must be fetched", list_lost),
    ("unauthorised", "revocation stale", list_overdue),
    ("unauthorised", "this node's time is uncertain", time_uncertain),
    ("timeout", "unknown after restart", before_memory),
    ("rejected", "replayed", replayed),
    ("rejected", "stale: a newer order came first", older),
    ("rejected", "the node is in safe mode", safe_mode),
    ("rejected", "expired", too_late),
    ("unsupported", "unknown kind of order", unknown_verb),
    ("unsupported", "orders of the flight are switched off on this node", flight.flight_off),
    ("unsupported", "this node flies no missions", flight.mission_off),
    ("unsupported", "no such mode", flight.unknown_mode),
    ("rejected", "no such camera, or nothing turns it", no_such_camera),
    ("rejected", "0, 0, 0 is no place to look at", null_place),
    ("rejected", "this node has no position yet", nowhere),
    ("rejected", "outside the fence", flight.outside_inclusion),
    ("rejected", "inside an exclusion fence", flight.inside_exclusion),
    ("rejected", "through a fence", flight.through_fence),
    ("rejected", gimbals.UNKNOWN, gimbal.gimbal_unknown),
    ("rejected", gimbals.NOTHING_PANS, gimbal.turns_vehicle),
    ("rejected", "beyond the gimbal's limits", gimbal.beyond_limits),
    ("unsupported", "this camera has no zoom", gimbal.no_zoom),
    ("rejected", "unknown_poi_id", unknown_poi),
    ("rejected", "expired: the question is closed", poi_over),
    ("rejected", "the mission is not at that", flight.not_at_that),
    ("rejected", "the vehicle is armed: somebody has it", flight.begins_armed),
    ("rejected", "no vehicle is heard", flight.mission_unheard),
    ("rejected", "a failsafe has the vehicle: it must be held off first", flight.against_failsafe),
    ("rejected", "no self-test with this report waits for a word", flight.no_such_report),
    ("rejected", "only what a person has confirmed is followed", not_confirmed),
    ("accepted", "recorded", judgement),
    ("unsupported", "this node commands no failsafes", override.no_failsafes),
    ("unsupported", "nothing that can be held off", override.unknown_scope),
    ("rejected", "a reason is needed", override.no_reason),
    ("rejected", "held for no time, or for longer than allowed", override.too_long),
    ("accepted", "held off", override.held_off),
    ("rejected", "no vehicle is heard", vehicle_silent),
    ("accepted", "the camera follows it", to_follow),
    ("rejected", "the vehicle is not armed", flight.on_the_ground),
    ("intended", "all gates passed", None),
)
_JUDGE: tuple[Row[Facts], ...] = tuple(
    move("received", "order_received", target, because, guard, band)
    for band, (target, because, guard) in enumerate(_GATES, start=1)
)


def _repeated(source: str, because: str) -> tuple[Row[Facts], ...]:
    return (
        ignore(source, "order_received", "not answered: twice within a second is enough", answered_enough, band=1),
        refuse(source, "order_received", "command_id reuse: another body under the same id", other_body, band=2),
        ignore(source, "order_received", because, band=3),
    )


def _underway(source: str) -> tuple[Row[Facts], ...]:
    return (
        *_repeated(source, "answered: not decided yet"),
        move(source, "command_answered", "accepted", "the vehicle accepted", vehicle_accepted, band=1),
        move(source, "command_answered", "in_progress", "the vehicle is at it", vehicle_busy, band=2)
        if source != "in_progress"
        else ignore(source, "command_answered", "the vehicle is still at it", vehicle_busy, band=2),
        move(source, "command_answered", "unsupported", "the vehicle does not have it", vehicle_lacks_it, band=3),
        move(source, "command_answered", "rejected", "the vehicle refused", band=4),
        move(source, "command_unanswered", "rejected", "could not be sent", never_left, band=1),
        move(source, "command_unanswered", "timeout", "no answer from the vehicle", band=2),
        move(source, "time_passed", "timeout", "no outcome within the order's life"),
        move(source, "node_started", "timeout", "unknown after restart"),
        move(source, "command_sent", "sent", "the bytes left")
        if source == "intended"
        else ignore(source, "command_sent", "known already"),
    )


def _final(source: str) -> tuple[Row[Facts], ...]:
    return (
        *_repeated(source, "answered with the stored result"),
        ignore(source, "command_sent", "too late to matter"),
        ignore(source, "command_answered", "a final answer never changes"),
        ignore(source, "command_unanswered", "a final answer never changes"),
        ignore(source, "time_passed", "over"),
        ignore(source, "node_started", "an answer that is owed is given again"),
    )


def _before_judgement(*triggers: str) -> tuple[Row[Facts], ...]:
    # `received` lasts for the length of one step, so nothing else can reach it; the rows say so.
    return tuple(ignore("received", trigger, "judged in the step that it came in") for trigger in triggers)


CHART: Chart[Facts] = Chart(
    name="command",
    initial="received",
    states=("received", *UNDERWAY, *FINAL),
    terminal=FINAL,
    triggers=(
        "order_received",
        "command_sent",
        "command_answered",
        "command_unanswered",
        "time_passed",
        "node_started",
    ),
    rows=(
        *_JUDGE,
        *_before_judgement("command_sent", "command_answered", "command_unanswered", "time_passed", "node_started"),
        *(row for state in UNDERWAY for row in _underway(state)),
        *(row for state in FINAL for row in _final(state)),
    ),
)
