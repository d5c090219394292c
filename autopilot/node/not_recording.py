"""What a node does whose store can't be opened: it says so, refuses every order, and touches nothing.

It is on the mesh with gate and status, so that operators learn why nothing happens; an authentic order is answered
"not recording" with the reason, and not for good: nothing is written down, so a repeat may be taken once the node
records. There are no effects, the link to the vehicle stays closed, and no heartbeat leaves. Meanwhile whoever made it
opens the store again and again, which is the only test that tells; it goes on in this process, for a new one would see
the same disk, and a node without a supervisor would be gone.
"""

from __future__ import annotations

import asyncio
import sys
from contextlib import suppress
from pathlib import Path

from google.protobuf.message import Message

from autopilot.adapters.mesh import MeshAdapter
from autopilot.node import notice
from autopilot.node.upkeep import drop_counts
from autopilot.ports.config import Config
from autopilot.ports.edges import Clock, InputClass
from autopilot.trust.clock import wall_ms
from autopilot.trust.identity import Identity
from events.schema.waypoint_pb2 import NodeStatus

HEALTH = "not recording"


class CannotRecord(Exception):
    """The store can't be opened; the text says why."""


class NotRecording:
    """The face of a node that does not record. Lives on the asyncio loop."""

    def __init__(self, config: Config, identity: Identity, clock: Clock) -> None:
        self._config = config
        self._identity = identity
        self._clock = clock
        self._projections = Path(config.node.projections)
        self._because = ""
        self._mesh: MeshAdapter | None = None
        self._publishing: asyncio.Task[None] | None = None

    def say(self, because: str) -> None:
        """Say why nothing is recorded; the first time, come up on the mesh."""
        if because != self._because:
            again = f"tried again every {self._config.limits.store_retry_s:g} s"
            print(f"autopilot: not recording: {because}; {again}", file=sys.stderr, flush=True)
            notice.leave(self._projections, notice.Notice(because, wall_ms(self._clock)))
        self._because = because
        mesh = self._config.mesh
        if self._mesh is None and (mesh.connect or mesh.listen):
            self._mesh = self._made()
            self._mesh.start()
            self._publishing = asyncio.create_task(self._publish(self._mesh))

    async def stop(self) -> None:
        """Leave the mesh, for the node records or ends."""
        if self._publishing is not None:
            self._publishing.cancel()
            with suppress(asyncio.CancelledError):
                await self._publishing
        if self._mesh is not None:
            await asyncio.to_thread(self._mesh.stop)
        self._mesh = self._publishing = None

    def over(self) -> None:
        """Take the note away: the node records."""
        notice.take_away(self._projections)

    def _made(self) -> MeshAdapter:
        return MeshAdapter(
            self._config.mesh,
            self._identity,
            self._clock,
            lambda _latitude, _longitude, _altitude: None,
            refuse_orders,
            refusal=lambda: f"{HEALTH}: {self._because}",
        )

    async def _publish(self, mesh: MeshAdapter) -> None:
        while True:
            mesh.publish_status(self.status(mesh))
            await asyncio.sleep(self._config.mesh.status_period_s)

    def status(self, mesh: MeshAdapter) -> NodeStatus:
        """Return what the node says of itself."""
        return NodeStatus(
            at_ms=wall_ms(self._clock),
            health=HEALTH,
            not_recording=self._because,
            dropped=drop_counts(mesh),
        )


def refuse_orders(input_class: InputClass, observation: Message) -> bool:
    """Take no order; whatever else an adapter says is let go of, for there is nowhere to put it."""
    del observation
    return input_class is not InputClass.ORDER
