"""An adapter of missions on a bench, and its outcomes in short."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

from google.protobuf.message import Message

from autopilot.adapters.missions import Home, MissionsAdapter
from autopilot.adapters.missions.client import Failed
from autopilot.adapters.missions.pushing import Bundle
from autopilot.geo import Origin
from autopilot.ports.config import MissionSection
from autopilot.ports.edges import InputClass
from autopilot.sim.office import Office
from events.schema.mission_pb2 import MissionPlanned, MissionUnavailable, PushReported, WaypointPosted
from tests.autopilot.planning.missions import AROUND, HOME, MISSION_ID, fence, region, tree, waypoint

HOME_M = 440.0
BREAK = {"kind": "target_follow_breakpoint"}


def example() -> dict[str, Any]:
    """Return a mission with a waypoint, a search and a return."""
    items = [waypoint((20, 20), cruise_speed_mps=7), region(), BREAK, {"kind": "return"}]
    return tree(*items, fences=[fence(AROUND, "INCLUSION")])


class Bench:
    """An adapter on a bench: what it offers, what it keeps, and how long it would have waited."""

    def __init__(self, settings: MissionSection, *, home_after: int = 0, room_after: int = 0) -> None:
        self.offered: list[Message] = []
        self.kept: dict[str, bytes] = {}
        self.waits_s: list[float] = []
        self.kept_badly: OSError | None = None
        self.folder: Path | None = Path("flights/000001-1a2b3c4d")  # of the open flight
        self.seen: Bundle | Failed = Failed("nothing", again=False)  # what it saw
        self._home_after, self._room_after = home_after, room_after
        origin = Origin()
        origin.set(*HOME, HOME_M)
        self.adapter = MissionsAdapter(
            settings,
            self._offer,
            origin.place_e7,
            self._home,
            self._keep,
            60.0,
            flight=lambda: self.folder,
            read=self._read,
            sleep=self._sleep,
        )

    def _offer(self, input_class: InputClass, observation: Message) -> bool:
        assert input_class is InputClass.OUTCOME
        if self._room_after > 0:
            self._room_after -= 1
            return False
        self.offered.append(observation)
        return True

    def _home(self) -> Home | None:
        self._home_after -= 1
        return Home(*HOME, HOME_M) if self._home_after < 0 else None

    def _keep(self, name: str, data: bytes) -> None:
        if self.kept_badly is not None:
            raise self.kept_badly
        self.kept[name] = data

    async def _read(self, _folder: Path, _seq: int) -> Bundle | Failed:
        return self.seen

    async def _sleep(self, seconds: float) -> None:
        self.waits_s.append(seconds)
        await asyncio.sleep(0)

    def run(self, *effects: Message, before: Callable[[int], None] = lambda _: None) -> list[Message]:
        """Perform effects one after the other, numbered from 1; return what was offered."""

        async def work() -> None:
            for seq, effect in enumerate(effects, start=1):
                before(seq)
                self.adapter.perform(seq, effect, 0)
                async with asyncio.timeout(30):
                    await asyncio.gather(*self.adapter._tasks)
            await self.adapter.stop()

        asyncio.run(work())
        return self.offered


def at(office: Office, **more: Any) -> MissionSection:
    """Return the settings for an office."""
    return MissionSection(url=office.url, mission_id=MISSION_ID, **({"timeout_s": 5, "attempts": 4} | more))


def said(offered: list[Message]) -> list[str]:
    """Return the outcomes in short."""
    short = []
    for message in offered:
        match message:
            case MissionPlanned():
                short.append(f"{message.effect_seq} planned {len(message.items)}")
            case MissionUnavailable():
                short.append(f"{message.effect_seq} none after {message.attempts}{', final' if message.final else ''}")
            case WaypointPosted():
                short.append(f"{message.effect_seq} posted{': ' + message.failure if message.failure else ''}")
            case PushReported():
                took = f"{message.observations}+{message.ignored_items} pushed, {message.left} left"
                end = "" if message.final else ", goes on"
                short.append(f"{message.effect_seq} {took} after {message.attempts}{end}")
    return short


def because(message: Message) -> str:
    """Return why there is no mission."""
    assert isinstance(message, MissionUnavailable)
    return message.because
