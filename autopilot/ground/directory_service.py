"""A Directory on the mesh: questions go to the desk, and what becomes new is published to whoever is connected.

Publishing is a courtesy: whoever was away asks. The time is answered where the question arrives, for its journey is
its uncertainty; everything else by one thread, because it may write to the disk.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

from autopilot.adapters.mesh.link import LinkDown, Reply, Wire
from autopilot.ground import directory_changes as changes
from autopilot.ground.directory_desk import ASKED, Desk
from autopilot.ground.directory_papers import HOUR_MS, Directory
from autopilot.ground.directory_store import DirectoryError
from autopilot.trust.clock import Clock, wall_ms
from autopilot.trust.keys import Random, key_id
from autopilot.wire import keys
from autopilot.wire.keys import Channel, bundle_key, trust_key

WAITING_MAX: Final = 256  # questions; more come only faster than anybody's hands or clocks
LOOK_EVERY_S: Final = 0.5  # how soon a command's change is noticed
LEAD_MS: Final = 60_000  # a new group key is given out this long before it is used
Say = Callable[[str], None]


class Service:
    """Serves one Directory's folder over one link."""

    def __init__(
        self,
        folder: Path,
        wire: Wire,
        clock: Clock,
        random: Random,
        *,
        rotate_hours: float | None = None,
        say: Say = lambda _: None,
    ) -> None:
        """Serve `folder`; with `rotate_hours` a new epoch begins that often. Raises DirectoryError, OSError."""
        self.desk = Desk(folder, clock, random)
        self._folder, self._wire, self._clock, self._random = folder, wire, clock, random
        self._rotate_ms = None if rotate_hours is None else int(rotate_hours * HOUR_MS)
        self._say = say
        self._told: dict[str, bytes] = {}
        self._waiting: queue.Queue[tuple[Channel, bytes, Reply]] = queue.Queue(WAITING_MAX)
        self._stopped = threading.Event()
        self._worker = threading.Thread(target=self._work, name="directory", daemon=True)

    def start(self) -> None:
        """Begin to answer and to publish; returns at once."""
        deployment = self.desk.directory().trust.deployment_id
        for channel in ASKED:
            self._wire.answer(trust_key(channel, deployment), self._taker(channel))
        self._wire.start()
        self._worker.start()

    def stop(self) -> None:
        """Stop answering."""
        self._stopped.set()
        self._worker.join(timeout=5)
        self._wire.stop()

    def look(self) -> None:
        """Begin a new epoch where it is due, forget old ones, publish what is new.

        Raises DirectoryError, OSError, LinkDown.
        """
        now_ms = wall_ms(self._clock)
        directory = self.desk.directory()
        newest = max(directory.state.epochs, key=lambda epoch: epoch.epoch_id)
        if self._rotate_ms is not None and newest.not_before_ms + self._rotate_ms <= now_ms:
            self._say(f"epoch {changes.rotate_epoch(self._folder, now_ms, self._random, LEAD_MS).epoch_id} begins soon")
        elif directory.state.epochs[0].epoch_id < directory.epoch_at(now_ms).epoch_id:
            changes.tidy(self._folder, now_ms)
        self._publish(self.desk.directory(), now_ms)

    def _publish(self, directory: Directory, now_ms: int) -> None:
        deployment = directory.trust.deployment_id
        news = {
            trust_key(keys.TRUST_ROOTS, deployment): [directory.state.trust_root],
            trust_key(keys.REVOCATIONS, deployment): [directory.state.revocations],
        }
        for token in directory.live(now_ms):
            place = bundle_key(deployment, key_id(token.device_sign_pk))
            news[place] = self.desk.bundles(directory, token, now_ms)[-1:]
        told = {place: data for place, (data,) in news.items()}
        for place, data in told.items():
            if self._told.get(place) != data:
                self._wire.put(place, data, urgent=False)
        self._told = told

    def _taker(self, channel: Channel) -> Callable[[bytes, Reply], None]:
        def take(question: bytes, reply: Reply) -> None:
            if channel is keys.TIMES:
                self._give(channel, question, reply)
                return
            try:
                self._waiting.put_nowait((channel, question, reply))
            except queue.Full:
                self.desk.count(channel, "busy")

        return take

    def _give(self, channel: Channel, question: bytes, reply: Reply) -> None:
        answer = self.desk.answer(channel, question)
        if answer is not None:
            reply(answer)

    def _work(self) -> None:
        looked_ns, linked = 0, False
        while not self._stopped.is_set():
            if linked != self._wire.linked():
                linked = not linked
                self._say("serving" if linked else "nobody is connected")
            with suppress(queue.Empty):
                self._give(*self._waiting.get(timeout=LOOK_EVERY_S / 5))
            if self._clock.mono_ns() - looked_ns >= LOOK_EVERY_S * 1e9 and linked:
                looked_ns = self._clock.mono_ns()
                self._look_again()

    def _look_again(self) -> None:
        try:
            with suppress(LinkDown):  # put again at the next look
                self.look()
        except (DirectoryError, OSError) as error:
            self._say(str(error))
