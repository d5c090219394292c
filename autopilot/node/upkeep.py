"""What the daemon does by the clock and nobody ordered: status on the mesh, and what the gate dropped into the log."""

from __future__ import annotations

import asyncio

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
        tally = edges.mesh.tally()
        status = board.node_status()
        status.dropped.extend(
            DropCount(reason=reason, count=count) for reason, count in sorted(tally.rejected.items()) if count
        )
        edges.mesh.publish_status(status)
        await asyncio.sleep(CHANGES_APART_S)
        await board.changed(settings.status_period_s - CHANGES_APART_S)


async def record_rejections(edges: Edges, inbox: Inbox) -> None:
    """Record what the gate dropped, in aggregate."""
    while True:
        await asyncio.sleep(REJECTIONS_EVERY_S)
        report_rejections(edges, inbox)


def report_rejections(edges: Edges, inbox: Inbox) -> None:
    """Offer one record of what was dropped since the last one; none when nothing was."""
    rejected = edges.mesh.take_rejections() if edges.mesh is not None else {}
    if rejected:
        counts = [RejectedCount(reason=reason, count=count) for reason, count in sorted(rejected.items())]
        inbox.offer(InputClass.OUTCOME, SamplesRejected(rejected=counts))
