"""Performs the effects of port "missions": fetch and plan the mission, ask for a waypoint, push what was seen.

Each effect ends in one outcome that names its seq. What may be better in a while (no connection, 5xx, half an answer)
is tried again after 1, 2, 4 ... 30 s, and said once for each reason; what will not be (a mission that is refused, 404)
is said at once. A mission is planned around home, so there is none before the vehicle's position is known.

A POST may be done at the office though its answer was lost, so it is repeated under the same Idempotency-Key, made of
the effect, until there is an answer: at least once on the wire, once in the mission.

Planning and files run on threads; nothing here blocks the loop, and nothing raises.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import json
import uuid
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Final

from google.protobuf.message import Message

from autopilot.adapters.missions.client import Client, Failed, waits_s
from autopilot.adapters.missions.messages import Home, PlaceOf, planned
from autopilot.adapters.missions.pushing import Pusher, Read, read_in_child
from autopilot.planning import Plan, make_plan, mission_limits, with_middle
from autopilot.ports.config import MissionSection
from autopilot.ports.edges import InputClass, Offer
from autopilot.wire.mission import MissionRefused
from autopilot.wire.mission_reading import read_mission
from events.schema.mission_pb2 import (
    FetchMission,
    MissionPlanned,
    MissionUnavailable,
    PostWaypoint,
    PushObservations,
    PushReported,
    WaypointPosted,
)

AT_ONCE_MAX: Final = 8  # effects that are performed at the same time; the chart asks for one
LOOK_AGAIN_S: Final = 1.0  # how often home is looked for
ROOM_POLL_S: Final = 0.05  # how often whether the inbox has room again
REFUSED_MAX: Final = 1000  # characters of what is wrong with a mission
_NAMESPACE: Final = uuid.UUID("1f0f4c2e-2b0d-4d53-8f43-6b6f0f2a9c11")

Keep = Callable[[str, bytes], None]  # a file of the open flight: its SHA-256 in hexadecimal, its bytes


class MissionsAdapter:
    """One mission of one vehicle, from an office or a file."""

    def __init__(
        self,
        settings: MissionSection,
        offer: Offer,
        place_of: PlaceOf,
        home: Callable[[], Home | None],
        keep: Keep,
        field_of_view_deg: float,
        *,
        vehicle: int = 1,
        flight: Callable[[], Path | None] = lambda: None,
        read: Read = read_in_child,
        client: Client | None = None,
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
    ) -> None:
        """Take what it needs; nothing starts before an effect. `flight` is the folder of the open one.

        `read`, `client` and `sleep` are real ones unless a test's.
        """
        self._flight, self._read = flight, read
        self._settings, self._offer, self._place_of = settings, offer, place_of
        self._home, self._keep, self._vehicle = home, keep, vehicle
        self._field_of_view_deg = settings.field_of_view_deg or field_of_view_deg
        self._client = client or Client(settings)
        self._sleep = sleep
        self._tasks: set[asyncio.Task[None]] = set()
        self._etag, self._data = "", b""  # what the office sent last
        self._plan: Plan | None = None
        self._middle: tuple[str, int] | None = None  # the waypoint that was asked for last: its id, and before what

    async def stop(self) -> None:
        """Give up what is under way and close the connections."""
        for task in self._tasks:
            task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await asyncio.gather(*self._tasks, return_exceptions=True)
        await self._client.close()

    def perform(self, seq: int, effect: Message, recorded_mono_ns: int) -> None:
        """Begin to perform an effect."""
        del recorded_mono_ns  # a mission does not get too old to be fetched
        full = len(self._tasks) >= AT_ONCE_MAX
        match effect:
            case FetchMission():
                work = self._fetch(seq) if not full else self._no_mission(seq, "too much is asked for at once", 0)
            case PostWaypoint():
                work = self._post(seq, effect) if not full else self._posted(seq, "too much is asked for at once")
            case PushObservations():
                work = self._push(seq, effect, "too much is asked for at once" if full else "")
            case _:
                return
        task = asyncio.get_running_loop().create_task(work, name=f"missions {seq}")
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _fetch(self, seq: int) -> None:
        """Fetch, plan and record the mission; go on trying as long as it may help."""
        home = await self._wait_for_home(seq)
        told = ""
        for attempt, wait_s in enumerate(waits_s(self._settings), 1):
            found = await self._planned(seq, home)
            if isinstance(found, MissionPlanned):
                await self._surely(found)
                return
            if not found.again or attempt == self._settings.attempts:
                await self._no_mission(seq, found.because, attempt)
                return
            if found.because != told:
                told = found.because
                await self._no_mission(seq, told, attempt, final=False)
            await self._sleep(wait_s)

    async def _wait_for_home(self, seq: int) -> Home:
        """Return where the vehicle starts from, once somebody knows."""
        home = self._home()
        if home is None:
            await self._no_mission(seq, "where home is is not known yet", 0, final=False)
        while home is None:
            await self._sleep(LOOK_AGAIN_S)
            home = self._home()
        return home

    async def _planned(self, seq: int, home: Home) -> MissionPlanned | Failed:
        """Fetch and plan once."""
        found = await (asyncio.to_thread(self._from_file) if self._settings.file else self._from_office())
        if isinstance(found, Failed):
            return found
        data, revision = found
        plan = await asyncio.to_thread(self._plan_of, data, home)
        if isinstance(plan, MissionRefused):
            return Failed(f"the mission is refused: {plan}"[:REFUSED_MAX].replace("\n", " | "), again=False)
        if not self._settings.file and plan.mission.mission_id != self._settings.mission_id.lower():
            return Failed(f"the office sent mission {plan.mission.mission_id}, which was not asked for", again=False)
        made = planned(plan, data, revision, home, self._place_of, self._vehicle, seq)
        if made is None:
            return Failed("nothing has a place yet", again=True)
        try:
            await asyncio.to_thread(self._keep, made.json_sha256.hex(), data)
        except OSError as error:
            return Failed(f"the mission can't be kept: {error.strerror or error}", again=True)
        self._plan = plan
        return made

    def _plan_of(self, data: bytes, home: Home) -> Plan | MissionRefused:
        mission = read_mission(data, mission_limits(self._settings))
        if isinstance(mission, MissionRefused):
            return mission
        plan = make_plan(mission, self._settings, self._field_of_view_deg, (home.latitude_deg, home.longitude_deg))
        if isinstance(plan, MissionRefused) or self._middle is None:
            return plan
        return with_middle(plan, *self._middle)

    def _from_file(self) -> tuple[bytes, str] | Failed:
        """Return the mission that lies on this disk, and its digest."""
        try:
            with Path(self._settings.file).open("rb") as file:
                data = file.read(self._settings.max_bytes + 1)
        except OSError as error:
            return Failed(f"[mission] file: {self._settings.file}: {error.strerror}", again=False)
        return data, hashlib.sha256(data).hexdigest()

    async def _from_office(self) -> tuple[bytes, str] | Failed:
        """Return the office's mission and its revision; what has not changed is not sent again."""
        answer = await self._client.get(f"/missions/{self._settings.mission_id}", self._etag)
        if isinstance(answer, Failed):
            return answer
        if answer.status == 304:
            if not self._etag:
                return Failed("the office says nothing has changed, but nothing was here", again=True)
        elif answer.status != 200:
            return Failed(f"the office answers {answer.status} to a question for a mission", again=False)
        else:
            self._etag, self._data = answer.etag, answer.data
        return self._data, self._etag or hashlib.sha256(self._data).hexdigest()

    async def _post(self, seq: int, effect: PostWaypoint) -> None:
        """Ask for the waypoint until there is an answer; then the mission is fetched as it is now."""
        if not self._settings.url:
            await self._posted(seq, "the mission comes from a file: there is no office to ask")
            return
        home = self._home()
        if self._plan is None and home is not None:  # it was fetched before a restart
            await self._planned(seq, home)
        plan = self._plan
        if plan is None or plan.mission.mission_id != effect.mission_id.lower():
            await self._posted(seq, "this mission can't be had from the office")
            return
        key, body = waypoint_request(seq, effect, plan)
        for attempt, wait_s in enumerate(waits_s(self._settings), 1):
            answer = await self._client.post(f"/missions/{self._settings.mission_id}/waypoints", key, body)
            if not isinstance(answer, Failed):
                self._middle = key, effect.before_item
                await self._posted(seq, "")
                await self._fetch(seq)
                return
            if not answer.again or attempt == self._settings.attempts:
                await self._posted(seq, answer.because)
                return
            await self._sleep(wait_s)

    async def _push(self, seq: int, effect: PushObservations, refusal: str) -> None:
        """Push what the open flight saw. The outcome is that flight's: another one's log is told nothing of it."""
        folder = self._flight()

        async def tell(report: PushReported) -> None:
            if self._flight() == folder:
                await self._surely(report)

        if not self._settings.url:
            refusal = "the mission comes from a file: there is no office to push to"
        if refusal or folder is None:
            await tell(PushReported(effect_seq=seq, because=refusal or "no flight is open", final=True))
            return
        pusher = Pusher(self._settings, self._client, self._read, self._sleep, tell, lambda: self._flight() == folder)
        await pusher.push(seq, effect, folder)

    async def _posted(self, seq: int, failure: str) -> None:
        await self._surely(WaypointPosted(effect_seq=seq, failure=failure))

    async def _no_mission(self, seq: int, because: str, attempts: int, *, final: bool = True) -> None:
        await self._surely(MissionUnavailable(effect_seq=seq, because=because, attempts=attempts, final=final))

    async def _surely(self, observation: Message) -> None:
        """Offer an outcome until the inbox takes it."""
        while not self._offer(InputClass.OUTCOME, observation):
            await self._sleep(ROOM_POLL_S)


def waypoint_request(seq: int, effect: PostWaypoint, plan: Plan) -> tuple[str, bytes]:
    """Return the Idempotency-Key and the body that ask for a waypoint; the same effect always gives the same.

    The waypoint's own id is the key, so that an office that forgot the key still finds it there. It goes before the
    mission item that the planned item comes from; where that is the middle of a search, before the one after it, for
    the office knows a search as one (`with_middle` puts it where it was asked for, in the plan).
    """
    body = effect.SerializeToString(deterministic=True)
    key = str(uuid.uuid5(_NAMESPACE, f"{seq} {body.hex()}"))
    asked = {
        "id": key,
        "at": {
            "latitude": effect.place.latitude_e7 / 1e7,
            "longitude": effect.place.longitude_e7 / 1e7,
            "altitude_m": effect.height_mm / 1000,
        },
        "before": _before(plan, effect.before_item),
    }
    return key, json.dumps({name: value for name, value in asked.items() if value is not None}).encode()


def _before(plan: Plan, index: int) -> str | None:
    """Return the id of the mission item before which a waypoint goes; None: the last."""
    under_way = plan.items[index - 1].source if 0 < index <= len(plan.items) else ""
    later = (item.source for item in plan.items[index:] if item.source and item.source != under_way)
    return next(later, None)
