"""What a flight saw, on its way to the mission office after the landing (seed 004, section 3: the post-flight push).

The log of the open flight is read by a child process (`autopilot export observations`), never by this one. What it
prints is sent in posts of at most `push_bytes`, observations and ignored items apart. A post that the office took is
not sent again; one that it may take later is repeated under the same Idempotency-Key, made of flight, effect and body,
after 1, 2, 4 ... 30 s; one that it refuses is passed over, and the others are sent all the same. An office that can't
be reached as often as may be tried gets no more.

Nothing is deleted here, and nothing is kept: what is not pushed stays where it is, in the flight's log.
"""

from __future__ import annotations

import asyncio
import hashlib
import json
import os
import sys
import uuid
from collections.abc import Awaitable, Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from autopilot.adapters.missions.client import Client, Failed, waits_s
from autopilot.ports.config import MissionSection
from events.schema.mission_pb2 import PushObservations, PushReported

Bundle = dict[str, Any]  # what `export observations` prints
Read = Callable[[Path, int], Awaitable[Bundle | Failed]]  # what a flight saw up to a record
Tell = Callable[[PushReported], Awaitable[None]]

LISTS: Final = ("observations", "ignored_items")
WORDS_MAX: Final = 300  # characters of what a child says on standard error
_NICE: Final = 5  # below the node and its eyes; but a push has an end
_NAMESPACE: Final = uuid.UUID("6f0c1f9e-83a4-4a0e-9a55-0c3b6c7d2e14")


@dataclass(frozen=True, slots=True)
class Part:
    """One post."""

    key: str
    body: bytes
    observations: int
    ignored_items: int


class Pusher:
    """Pushes what one flight saw; made anew for each effect."""

    def __init__(
        self,
        settings: MissionSection,
        client: Client,
        read: Read,
        sleep: Callable[[float], Awaitable[None]],
        tell: Tell,
        is_open: Callable[[], bool],
    ) -> None:
        """Take what it needs; `is_open` says whether the flight of the effect still is the open one."""
        self._settings, self._client, self._read, self._sleep = settings, client, read, sleep
        self._tell, self._is_open = tell, is_open
        self._said = PushReported()

    async def push(self, seq: int, effect: PushObservations, folder: Path) -> None:
        """Push, and tell what became of it: once as final, before that once for each reason to try again."""
        self._said.effect_seq = seq
        life_s = effect.life_ms / 1000
        try:
            async with asyncio.timeout(life_s):
                because = await self._push(effect, folder)
        except TimeoutError:
            because = f"it was not done within {life_s:g} s"
        await self._tell_now(because, final=True)

    async def _push(self, effect: PushObservations, folder: Path) -> str:
        """Return what stands in the way of the first part that was not taken; empty where all were."""
        bundle = await self._read(folder, self._said.effect_seq)
        if isinstance(bundle, Failed):
            return bundle.because
        self._said.left = sum(len(bundle[name]) for name in LISTS)
        because, path = "", f"/missions/{effect.mission_id}/mapobjects"
        for part in parts_of(bundle, self._settings.push_bytes, f"{folder.name} {self._said.effect_seq}"):
            failed = await self._post(path, part)
            if failed is None:
                self._said.observations += part.observations
                self._said.ignored_items += part.ignored_items
                self._said.left -= part.observations + part.ignored_items
                continue
            because = because or failed.because
            if failed.again:
                break
        return because

    async def _post(self, path: str, part: Part) -> Failed | None:
        """Send a part until it is taken; return why it was not."""
        told = ""
        for attempt, wait_s in enumerate(waits_s(self._settings), 1):
            if not self._is_open():
                return Failed("the flight is over", again=True)
            self._said.attempts += 1
            answer = await self._client.post(path, part.key, part.body)
            if not isinstance(answer, Failed):
                if answer.status < 300:
                    return None
                return Failed(f"the office answers {answer.status} to a push", again=False)
            if not answer.again or attempt == self._settings.attempts:
                return answer
            if answer.because != told:
                told = answer.because
                await self._tell_now(told, final=False)
            await self._sleep(wait_s)
        raise AssertionError("there is at least one attempt")

    async def _tell_now(self, because: str, *, final: bool) -> None:
        said = PushReported()
        said.CopyFrom(self._said)
        said.because, said.final = because, final
        await self._tell(said)


def parts_of(bundle: Bundle, longest_bytes: int, effect: str) -> Iterator[Part]:
    """Yield the posts that a bundle is sent in, as few as there can be of at most so many bytes.

    A single row that is longer than that is a post of its own. `effect` names flight and effect; the same effect with
    the same rows gives the same keys.
    """
    empty = bundle | {name: [] for name in LISTS}
    room = longest_bytes - len(_encoded(empty))
    for name in LISTS:
        for rows in _packed(bundle[name], room):
            body = _encoded(empty | {name: rows})
            key = str(uuid.uuid5(_NAMESPACE, f"{effect} {hashlib.sha256(body).hexdigest()}"))
            yield Part(key, body, *(len(rows) if name == one else 0 for one in LISTS))


def _packed(rows: list[Any], room: int) -> Iterator[list[Any]]:
    taken: list[Any] = []
    size = 0
    for row in rows:
        more = len(_encoded(row)) + 1  # and its comma
        if taken and size + more > room:
            yield taken
            taken, size = [], 0
        taken.append(row)
        size += more
    if taken:
        yield taken


def _encoded(value: Any) -> bytes:
    return json.dumps(value, separators=(",", ":")).encode()


async def read_in_child(folder: Path, seq: int) -> Bundle | Failed:
    """Have a child process read what a flight saw up to a record. Ends the child where it is cancelled."""
    try:
        child = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "autopilot.cli.main", "export", "observations"),
            *(str(folder), "-", "--until", str(seq)),
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
        )
    except OSError as error:
        return Failed(f"what was seen can't be read: {error.strerror or error}", again=False)
    try:
        with suppress(ProcessLookupError):
            os.setpriority(os.PRIO_PROCESS, child.pid, _NICE)
        printed, said = await child.communicate()
    finally:
        if child.returncode is None:
            child.kill()
            await child.wait()
    return await asyncio.to_thread(_bundle, printed, said)


def _bundle(printed: bytes, said: bytes) -> Bundle | Failed:
    try:
        bundle = json.loads(printed)
    except ValueError:
        words = " ".join(said.decode(errors="replace").split())[-WORDS_MAX:]
        return Failed(f"what was seen can't be read: {words or 'the child said nothing'}", again=False)
    assert isinstance(bundle, dict)
    return bundle
