"""The golden flights: what each is called, why it is there, and how it is told. `make.py` writes them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from events import Record
from statecharts.charts.mission import MAY_BEGIN, MAY_PAUSE, MAY_RESUME, OVER, STATES
from statecharts.charts.mission_state import ASKING
from tests.flights import Flight, story
from tests.golden import failsafes, findings, gimbals, misfortunes, missions, orders
from tests.golden.chance import by_chance
from tests.replay.changes import at, forged

HERE = Path(__file__).parent
DIGESTS = HERE / "digests.json"
SEEDS = range(1, 41)  # of the flights by chance that are flown anew and compared with their digests only


@dataclass(frozen=True, slots=True)
class Golden:
    """One golden flight."""

    name: str
    why: str
    records: Callable[[], Sequence[Record]]
    diverges: bool = False

    @property
    def path(self) -> Path:
        """Where its log lies."""
        return HERE / f"{self.name}.db"


def _told(flight: Callable[[], Flight]) -> Callable[[], Sequence[Record]]:
    return lambda: flight().records


def _forged() -> Sequence[Record]:
    flight = story()
    return forged(flight, at(flight, "send_ack"), detail="something else")


GOLDEN = (
    Golden("story", "Most of what can happen happens once, as in the demo.", _told(story)),
    Golden("forged", "One answer that its charts did not give, in a chain that holds.", _forged, diverges=True),
    Golden("gates", "Every gate says no once: the order of the gates is a decision.", _told(orders.gates)),
    Golden("believing", "What the node knows of lists, time and its past decides too.", _told(orders.believing)),
    Golden("outcomes", "What the vehicle says, in each state of an order, also too late.", _told(orders.outcomes)),
    Golden(
        "repeats", "Whoever repeats an order too often is not answered, in each state of it.", _told(orders.repeats)
    ),
    Golden("refusals", "What the vehicle refuses gives the camera back to who had it.", _told(orders.refusals)),
    Golden("restarts", "A start decides what becomes of orders that nobody heard of again.", _told(orders.restarts)),
    Golden("handed_over", "The first state is not empty: it comes from a baseline.", _told(orders.handed_over)),
    Golden(
        "switched_off", "The configuration in the manifest decides, not the one of today.", _told(orders.switched_off)
    ),
    Golden("nowhere", "Decisions before there is an origin or a vehicle.", _told(orders.nowhere)),
    Golden("gimbals", "Who controls a gimbal, and what it does after it arrived.", _told(gimbals.gimbals)),
    Golden("questions", "Deadlines and a rolling minute: the order in which time passes.", _told(findings.questions)),
    Golden("mutes", "Nearest, first and same place: ties between objects.", _told(findings.mutes)),
    Golden("scans", "What the node does by itself, from frame rates and holds.", _told(findings.scans)),
    Golden(
        "failing",
        "Steps that raise change nothing, three are safe mode, a start leaves it.",
        _told(misfortunes.failing),
    ),
    Golden("outages", "Time that nobody can measure ends holds and questions.", _told(misfortunes.outages)),
    Golden("poisoned", "Failed orders are answered, in safe mode too.", _told(misfortunes.poisoned)),
    Golden("losses", "Dropped inputs, rejected samples, lost eyes, a full disk.", _told(misfortunes.losses)),
    Golden(
        "failsafes",
        "Fences and charges demand, command and wait, and are held off, by the millisecond.",
        _told(failsafes.failsafes),
    ),
    Golden("silence", "Operators who are silent, come back, or never were.", _told(failsafes.silence)),
    Golden("no_say", "The same on a node that has no say in the flight decides nothing.", _told(failsafes.no_say)),
    Golden(
        "on_the_ground", "A mission up to the arming: what moves it and what does not.", _told(missions.on_the_ground)
    ),
    Golden("begun", "The last steps before a mission flies, stopped in every way.", _told(missions.begun)),
    Golden("stopped", "Refused, aborted and overruled in each step before it flies.", _told(missions.stopped)),
    Golden("in_the_air", "A mission in the air: followed, held, taken, sent home.", _told(missions.in_the_air)),
    Golden("landed", "A pilot starts it; how it is seen to end, and is begun again.", _told(missions.landed)),
    Golden("waited", "What lingers is not believed, and a start goes on waiting.", _told(missions.waited)),
    Golden("in_its_place", "A flight begins in the air: its mission goes on.", _told(missions.in_its_place)),
    Golden("replanned", "The same, by a plan that is not on board yet.", _told(missions.in_its_place_replanned)),
    Golden("by_itself", "A mission that begins by itself does so once.", _told(missions.by_itself)),
    Golden("no_missions", "A node that flies no missions decides nothing about them.", _told(missions.switched_off)),
    Golden("tested", "Who is fit to fly, who says so, and until when.", _told(missions.tested)),
    Golden("followed", "Following from each state of the scan, also while nobody is heard.", _told(missions.followed)),
    Golden("flight_orders", "To which places a vehicle is sent, and why not.", _told(missions.ordered)),
    Golden("flight_refused", "Orders of the flight where they are switched off.", _told(missions.refused)),
    Golden("unheard", "A mission before its vehicle is heard.", _told(missions.unheard)),
    Golden(
        "extremes", "The least and the greatest of every field, and names nobody expects.", _told(misfortunes.extremes)
    ),
    Golden("chance", "What nobody thought of: 300 lines by chance.", lambda: by_chance(0, 300).records),
)

UNTESTED = ("linking", "checking", "selftest", "paused", "aborted", "done")  # where a mission may wait for its test

# Rows that no flight can ask for, by reason: "chart state triggers". A row that is asked after all must leave.
UNREACHED = {
    "a failsafe at rest of which nothing is demanded is not asked, and it remembers no command": ("safety ok looked",),
    "only the battery demands the landing, and nothing is stronger": (
        "safety overruled looked",
        "safety landing looked",
    ),
    "an override that is not there waits for nothing": ("override idle time_passed time_lost",),
    "what is followed was ordered, so somebody was heard": (
        "link unheard looked",
        "link lost_following looked",
    ),
    "the command chart refuses the order in these states": (
        *(f"mission {state} begin" for state in STATES if state not in MAY_BEGIN),
        *(f"mission {state} pause" for state in STATES if state not in MAY_PAUSE),
        *(f"mission {state} resume" for state in STATES if state not in MAY_RESUME),
        *(f"mission {state} abort" for state in OVER),
        *(f"selftest {state} acknowledged" for state in ("idle", "running", "passed", "failed")),
    ),
    "nothing was asked of a vehicle yet": (
        "mission idle uploaded upload_failed accepted refused pushed not_pushed",
        "mission linking uploaded upload_failed accepted refused pushed not_pushed",
    ),
    "a vehicle that is not heard is not commanded, and nothing is followed with it": (
        "mission linking failsafe follow_began follow_ended",
    ),
    "these states are entered with the motors on, and left when they are off": (
        "mission engaging abort",
        "mission starting abort",
    ),
    "a self-test passes once in a flight, after its start and before the mission goes on": (
        *(f"mission {state} tested" for state in STATES if state not in UNTESTED),
    ),
    "the only camera with a gimbal follows already": ("mission following follow_began",),
    "the state waits for nothing": (
        *(f"mission {state} time_passed" for state in STATES if state not in (*ASKING, "landed", "syncing")),
        *(f"selftest {state} time_passed" for state in ("idle", "passed", "failed")),
        "scan following time_passed",
    ),
    "an order is `received` for the length of one step only": (
        "command received command_sent command_answered command_unanswered time_passed node_started",
    ),
    "an order that is over has no deadline, and a start asks only those under way": (
        "command accepted time_passed node_started",
        "command rejected time_passed node_started",
        "command timeout time_passed node_started",
        "command unsupported time_passed node_started",
        "command unauthorised time_passed node_started",
    ),
    "an unauthorised order never had an effect that could be answered": (
        "command unauthorised command_sent command_answered command_unanswered",
    ),
    "the deadline is dropped on the way into the state": (
        "camera automatic time_passed",
        "scan zoomed_out time_passed",
        "scan operator_held time_passed",
        "scan blocked time_passed",
        "aim idle time_passed",
        "aim drifted time_passed",
        "aim missed time_passed",
    ),
    "the gate of the orders asks whether the question is open before anybody is judged": (
        "poi enqueued judged",
        "poi suppressed judged",
        "poi confirmed judged",
        "poi declined judged",
        "poi expired judged",
        "poi withdrawn judged",
    ),
    "only what is enqueued is put to an operator": (
        "poi surfaced may_ask",
        "poi suppressed may_ask",
        "poi confirmed may_ask",
        "poi declined may_ask",
        "poi expired may_ask",
        "poi withdrawn may_ask",
    ),
    "what is near a question joins it, so no two that live are near each other": (
        "poi enqueued muted",
        "poi surfaced muted",
        "poi suppressed muted time_passed flight_closed",
        "poi confirmed muted",
        "poi declined muted",
    ),
    "the deadline is dropped with the end of the question": (
        "poi confirmed time_passed",
        "poi declined time_passed",
        "poi expired time_passed",
        "poi withdrawn time_passed",
    ),
    "control is asked for only where nobody has it, or another does": (
        "control unknown asked_for",
        "control asked asked_for",
        "control ours asked_for",
    ),
    "a camera that is freed is heard of in the same step, but for safe mode": (
        "control asked seen_ours",
        "control ours seen_ours",
    ),
    "a flight is closed once": (
        "poi withdrawn muted flight_closed",
    ),
    "whoever takes a camera is seen by the scan in the same step, so a camera is freed only in `operator_held`": (
        "scan zoomed_out camera_moved",
        "scan zoomed_in camera_moved",
        "scan blocked camera_moved",
    ),
    "a start asks only those who wait for something": (
        "aim idle node_started",
        "aim arrived node_started",
        "aim drifted node_started",
        "aim missed node_started",
        "camera automatic time_lost",
        "poi suppressed time_lost",
        "poi confirmed time_lost",
        "poi declined time_lost",
        "poi expired time_lost",
        "poi withdrawn time_lost",
    ),
}  # fmt: skip
