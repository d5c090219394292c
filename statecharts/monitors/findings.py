"""What is asked of people, and who answers."""

from __future__ import annotations

from events.schema.findings_pb2 import PoiOpened
from events.schema.flight_pb2 import Limits
from events.schema.orders_pb2 import OrderReceived
from statecharts.monitors.monitor import Monitor, Said, Step, key_of, moves_of

MINUTE_NS = 60_000_000_000


class PeopleAreNotFlooded(Monitor):
    """Never more questions in any rolling minute than the limit, and none below the confidence."""

    kinds = ("moved", "poi_opened")

    def __init__(self, limits: Limits, whole: bool) -> None:
        super().__init__(limits, whole)
        self._asked_ns: list[int] = []

    def look(self, step: Step) -> Said:
        """Count the questions."""
        now_ns = step[0].at.flight_ns
        asked = [now_ns for move in moves_of(step, "poi") if move.to_state == "surfaced"]
        if asked:
            self._asked_ns = [at_ns for at_ns in self._asked_ns if now_ns < at_ns + MINUTE_NS] + asked
            if len(self._asked_ns) > self.limits.asks_per_minute:
                yield "people_are_not_flooded", f"too many questions in the minute from {self._asked_ns[0]}"
        for record in step:
            message = record.message
            if isinstance(message, PoiOpened) and message.confidence_e4 < self.limits.ask_confidence_e4:
                yield "people_are_not_flooded", f"record {record.seq} asks at {message.confidence_e4}"


class OnlyPeopleJudge(Monitor):
    """Nothing is confirmed or declined but by an order, accepted in that step, that says so about that finding."""

    kinds = ("moved",)

    def look(self, step: Step) -> Said:
        """See who judges."""
        for move in moves_of(step, "poi"):
            if move.to_state not in ("confirmed", "declined"):
                continue
            order = step[0].message
            if not isinstance(order, OrderReceived):
                yield "only_people_judge", f"{move.instance} is {move.to_state} by nobody"
                continue
            if (order.judge_poi.poi_id, order.judge_poi.confirmed) != (move.instance, move.to_state == "confirmed"):
                yield "only_people_judge", f"{move.instance} is {move.to_state}, which nobody said"
            key = key_of(order.issuer.principal_id, order.command_id)
            if key not in [one.instance for one in moves_of(step, "command") if one.to_state == "accepted"]:
                yield "only_people_judge", f"{move.instance} is {move.to_state} by an order that was not accepted"


FINDINGS: tuple[type[Monitor], ...] = (PeopleAreNotFlooded, OnlyPeopleJudge)
