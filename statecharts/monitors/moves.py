"""That charts move from where they are."""

from __future__ import annotations

from events.schema.common_pb2 import Moved
from events.schema.flight_pb2 import Limits
from statecharts.monitors.monitor import FINAL, Monitor, Said, Step, is_forgotten

FIRST = {
    "camera": "automatic",
    "poi": "enqueued",
    "scan": "zoomed_out",
    "aim": "idle",
    "health": "normal",
    "link": "unheard",
    "safety": "ok",
    "override": "idle",
    "control": "unknown",
}
ENDS = {"command": FINAL, "poi": ("suppressed", "confirmed", "declined", "expired", "withdrawn")}


class MovesJoin(Monitor):
    """A move begins where the last one ended; a final order, and an ended question, never move.

    An order whose time is over is forgotten, and its id may be received anew.
    """

    kinds = ("moved",)

    def __init__(self, limits: Limits, whole: bool) -> None:
        super().__init__(limits, whole)
        self._where: dict[tuple[str, str], str] = {}
        self._judged_ns: dict[str, int] = {}

    def look(self, step: Step) -> Said:
        """See each move."""
        for record in step:
            if isinstance(change := record.message, Moved):
                key = change.chart, change.instance
                before = self._before(change, record.at.flight_ns)
                if change.from_state != before:
                    yield "moves_join", f"{key} moves from {change.from_state}, but it was {before}"
                if change.from_state in ENDS.get(change.chart, ()):
                    yield "moves_join", f"{key} moves out of {change.from_state}"
                self._where[key] = change.to_state

    def _before(self, change: Moved, now_ns: int) -> str:
        """Return where a chart was before a move, as far as it is known."""
        if change.chart == "command" and change.from_state == "received":
            anew = is_forgotten(self.limits, self._judged_ns.get(change.instance), now_ns)
            self._judged_ns[change.instance] = now_ns
            if anew:
                return "received"
        # Orders may be an earlier flight's, and all may be where an earlier start left them, or held over.
        known = self.whole and change.chart != "override"
        first = FIRST.get(change.chart, change.from_state) if known else change.from_state
        return self._where.get((change.chart, change.instance), first)
