"""Which logic decides, and what each one decides otherwise than the one before.

A flight says in its manifest, and at every start of the daemon, by which logic it was decided. Replaying it under a
later one, a decision may differ where a change in this table says so, and nowhere else (docs/evolution.md).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from google.protobuf.message import Message

from events.kinds import kind_of
from events.schema.common_pb2 import Moved


@dataclass(frozen=True, slots=True)
class Change:
    """One logic: what it decides otherwise."""

    logic: int
    says: str  # one sentence, for whoever reads that an old flight would be decided otherwise today
    kinds: frozenset[str] = frozenset()  # kinds of decisions that may come, go or change
    charts: frozenset[str] = frozenset()  # charts whose moves may come, go or change

    def touches(self, decision: Message) -> bool:
        """Whether this decision may differ by the change."""
        if isinstance(decision, Moved):
            return decision.chart in self.charts
        return kind_of(decision).name in self.kinds


# Logic 1 is the first; every later one is an entry here, in order and without a gap.
CHANGES: tuple[Change, ...] = (
    Change(
        logic=2,
        says="missions are flown, failsafes command, and control of gimbals is asked for and followed",
        kinds=frozenset(
            {
                *("send_ack", "take_gimbal", "give_up_gimbal", "set_zoom", "set_vehicle_mode", "fly_to_place"),
                *("fetch_mission", "post_waypoint", "upload_mission", "arm_vehicle", "start_mission"),
                *("set_mission_item", "run_selftest", "push_observations", "override_begun", "override_ended"),
            }
        ),
        charts=frozenset(
            {"link", "safety", "command", "override", "selftest", "camera", "scan", "mission", "control", "aim"}
        ),
    ),
)
LOGIC = 1 + len(CHANGES)


def since(recorded: int, decisions: Collection[Message], changes: Sequence[Change] | None = None) -> Change | None:
    """Return the first change after logic `recorded` that explains why decisions differ; None: some can't be explained.

    Raises ValueError where nothing differs.
    """
    if not decisions:
        raise ValueError("no decision differs")
    later = [change for change in (CHANGES if changes is None else changes) if change.logic > recorded]
    explaining = [next((change for change in later if change.touches(decision)), None) for decision in decisions]
    found = [change for change in explaining if change is not None]
    return min(found, key=_number) if len(found) == len(explaining) else None


def _number(change: Change) -> int:
    return change.logic
