"""The self-test as the shell runs it: looks at everything, has it judged, and reports it in one observation.

It performs `run_selftest`. What was heard last of gimbal, mission and operators is noted from the records as they
become durable; the rest is looked at when the test runs. Whatever a look comes to, there is a report with every item,
for the mission waits for it. It decides nothing: the chart `selftest` does.
"""

from __future__ import annotations

import asyncio
import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from google.protobuf.message import Message

from autopilot.node.fitness import Found, judged, unlooked
from autopilot.ports.config import Config
from autopilot.ports.edges import EyesFacts, InputClass, Offer, VehicleFacts
from autopilot.trust.book import TrustBook
from autopilot.trust.clock import Clock
from events.records import Record
from events.schema.mission_pb2 import MissionPlanned, RunSelftest, SelftestItem, SelftestReported
from statecharts import State

OFFER_AGAIN_S = 0.05
PROBE = ".selftest"
VEHICLE = 1
_HEARD = ("gimbal_reported", "operator_heard")


@dataclass(slots=True)
class Noted:
    """What the records told last. Written on the node's thread, read on another: whole values only."""

    heard_ns: dict[str, int]  # kind to monotonic nanoseconds
    plan: MissionPlanned | None = None
    head: int = -1  # the newest record that was noted
    boot: int = 0  # of the newest record

    def resume(self, state: State) -> None:
        """Take over the plan of a log that is gone on with: a start from a snapshot tells no records."""
        self.plan = state.plans.get(VEHICLE) or self.plan

    def hear(self, records: tuple[Record, ...]) -> None:
        """Note what is durable."""
        for record in records:
            if record.at.boot != self.boot:  # its monotonic time began anew: what came before has no age
                self.boot, self.heard_ns = record.at.boot, {}
            if record.kind.name in _HEARD:
                self.heard_ns[record.kind.name] = record.at.mono_ns
            elif isinstance(record.message, MissionPlanned):
                self.plan = record.message
        self.head = records[-1].seq if records else self.head


class Selftest:
    """Performs `run_selftest`."""

    def __init__(
        self,
        config: Config,
        clock: Clock,
        book: TrustBook,
        offer: Offer,
        vehicle: Callable[[], VehicleFacts] | None,
        eyes: Callable[[], EyesFacts],
    ) -> None:
        self._config, self._clock, self._book, self._offer = config, clock, book, offer
        self._vehicle, self._eyes = vehicle, eyes
        self._tasks: set[asyncio.Task[None]] = set()
        self.noted = Noted({})

    def perform(self, seq: int, effect: Message, recorded_mono_ns: int) -> None:
        """Run the test and report it; returns at once."""
        del recorded_mono_ns
        if isinstance(effect, RunSelftest):
            task = asyncio.create_task(self._run(seq, effect.vehicle), name="selftest")
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    async def _run(self, seq: int, vehicle: int) -> None:
        while self.noted.head < seq:  # the node performs first and notes then; the plan is in the same batch
            await asyncio.sleep(OFFER_AGAIN_S)
        report = SelftestReported(effect_seq=seq, vehicle=vehicle, items=await self._items())
        while not self._offer(InputClass.OUTCOME, report):
            await asyncio.sleep(OFFER_AGAIN_S)

    async def _items(self) -> list[SelftestItem]:
        """Look and judge; where that raises, every item says so."""
        try:
            vehicle = None if self._vehicle is None else self._vehicle()
            return judged(await asyncio.to_thread(self._look, vehicle, self._eyes()))
        except Exception as error:  # noqa: BLE001 - whatever a look raises, the mission waits for a report
            return unlooked(f"{type(error).__name__}: {error}")

    def _look(self, vehicle: VehicleFacts | None, eyes: EyesFacts) -> Found:
        """Look at everything; called on a thread of its own, for it touches the disk."""
        config, noted, time = self._config, self.noted, self._book.time()
        flights = Path(config.node.flights)
        held = self._book.held
        free_bytes, space_failure = free(flights)
        return Found(
            log_failure=written(flights),
            free_bytes=free_bytes,
            space_failure=space_failure,
            needed_bytes=config.retention.min_free_mib << 20,
            clock_trusted=time.trusted,
            token_left_ms=held.token.not_after_ms - time.now_ms,
            has_epoch=any(epoch.not_before_ms <= time.now_ms for epoch in held.epochs.values()),
            list_overdue_ms=self._book.overdue_ms(),
            has_camera=config.eyes.source != "none",
            frame_ms_ago=eyes.frame_ms_ago,
            detector_us=eyes.detector_us,
            has_gimbal=config.eyes.pose is None and vehicle is not None,
            gimbal_ms_ago=self._ago_ms("gimbal_reported") if vehicle is None else vehicle.heard_ms_ago.get("gimbal"),
            vehicle=vehicle,
            return_percent=config.safety.battery_return_percent,
            fences=0 if noted.plan is None else len(noted.plan.fences),
            mission_items=None if noted.plan is None else len(noted.plan.items),
            has_mesh=bool(config.mesh.connect or config.mesh.listen),
            operator_ms_ago=self._ago_ms("operator_heard"),
        )

    def _ago_ms(self, kind: str) -> int | None:
        heard_ns = self.noted.heard_ns.get(kind)
        return None if heard_ns is None else max(self._clock.mono_ns() - heard_ns, 0) // 1_000_000


def free(folder: Path) -> tuple[int | None, str]:
    """Return how many bytes are free on the disk of a folder and "", or None and why that can't be told."""
    try:
        return shutil.disk_usage(folder).free, ""
    except OSError as error:
        return None, error.strerror or str(error)


def written(folder: Path) -> str:
    """Write a small file beside the flights, make it durable and remove it; return why that failed, or ""."""
    probe = folder / PROBE
    try:
        descriptor = os.open(probe, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        try:
            os.write(descriptor, b"selftest")
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
        probe.unlink()
    except OSError as error:
        return error.strerror or str(error)
    return ""
