"""What the daemon does by the clock and nobody ordered: status on the mesh, and what was not taken into the log."""

from __future__ import annotations

import asyncio
from collections import Counter

from autopilot.adapters.mesh import MeshAdapter
from autopilot.node.board import Board
from autopilot.node.edges import Edges
from autopilot.node.inbox import Inbox
from autopilot.ports.config import MeshSection
from autopilot.ports.edges import InputClass
from events.schema.flight_pb2 import RejectedCount, SamplesRejected
from events.schema.waypoint_pb2 import DropCount

# Forgeries reach the disk as one record of counts this often, never one by one.
REJECTIONS_EVERY_S = 10.0
# A change of what people see is told at once, but not more often than this.
CHANGES_APART_S = 0.1


async def publish_status(settings: MeshSection, edges: Edges, board: Board) -> None:
    """Publish NodeStatus once a period and on change. It is upkeep: nothing of it is recorded."""
    while edges.mesh is not None:
        status = board.node_status()
        status.dropped.extend(drop_counts(edges.mesh))
        if edges.vehicle is not None and edges.vehicle.raw_stopped:
            status.raw_stopped = edges.vehicle.raw_stopped
        edges.mesh.publish_status(status)
        await asyncio.sleep(CHANGES_APART_S)
        await board.changed(settings.status_period_s - CHANGES_APART_S)


def drop_counts(mesh: MeshAdapter) -> list[DropCount]:
    """Return what the gate has dropped since the start, by reason."""
    rejected = sorted(mesh.tally().rejected.items())
    return [DropCount(reason=reason, count=count) for reason, count in rejected if count]


class Rejections:
    """What the adapters rejected, told once: the gate's reasons as they are, others behind their adapter's name."""

    def __init__(self, edges: Edges) -> None:
        self._edges = edges
        self._told: Counter[str] = Counter()
        self._owed: Counter[str] = Counter()  # what the inbox had no room for

    def keep(self, rejected: dict[str, int]) -> None:
        """Take back what could not be recorded: it comes with the next."""
        self._owed.update(rejected)

    def fresh(self) -> dict[str, int]:
        """Return what was rejected since the last call by reason, sorted, none of them 0."""
        edges = self._edges
        vehicle = edges.vehicle.rejected if edges.vehicle is not None else {}
        totals = Counter({f"vehicle: {reason}": count for reason, count in vehicle.items()})
        totals.update({f"eyes: {reason}": count for reason, count in edges.eyes.rejected.items()})
        fresh, self._told = totals - self._told, totals
        if edges.mesh is not None:
            fresh.update(edges.mesh.take_rejections())
        fresh.update(self._owed)
        self._owed.clear()
        return dict(sorted(fresh.items()))


async def record_rejections(rejections: Rejections, inbox: Inbox) -> None:
    """Record what was rejected, in aggregate."""
    while True:
        await asyncio.sleep(REJECTIONS_EVERY_S)
        report_rejections(rejections, inbox)


def report_rejections(rejections: Rejections, inbox: Inbox) -> None:
    """Offer one record of what was rejected since the last one; none when nothing was."""
    rejected = rejections.fresh()
    if rejected:
        counts = [RejectedCount(reason=reason, count=count) for reason, count in rejected.items()]
        if not inbox.offer(InputClass.OUTCOME, SamplesRejected(rejected=counts)):
            rejections.keep(rejected)
