"""The golden flights: what each is called, why it is there, and how it is told. `make.py` writes them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from events import Record
from tests.flights import Flight, story
from tests.golden import findings, gimbals, misfortunes, orders
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
        "extremes", "The least and the greatest of every field, and names nobody expects.", _told(misfortunes.extremes)
    ),
    Golden("chance", "What nobody thought of: 300 lines by chance.", lambda: by_chance(0, 300).records),
)

# Rows that no flight can ask for, by reason: "chart state triggers". A row that is asked after all must leave.
UNREACHED = {
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
