"""The node's side of the eyes: keeps a source of batches going and offers what it sees.

One task reads batches, judges them, gives the detections their places and offers one
`FrameObserved` a frame; of frames with nothing in them only some (`thinning`). A source that is
lost, or that sends what cannot be used, is dropped and opened again after a growing wait; each
change of state is an `EyesChanged`. Nothing that a detector sends raises out of here: it is counted
in `rejected` by name.

What a detection means is not decided here; which class is worth recording is configuration.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
from collections import Counter
from collections.abc import Awaitable, Callable, Mapping, Sequence

from google.protobuf.message import Message

from autopilot.adapters.eyes.framing import Broken, read_framed
from autopilot.adapters.eyes.judging import Rejection, judged
from autopilot.adapters.eyes.places import Places
from autopilot.adapters.eyes.sources import Lost, Refused, Source, source_of
from autopilot.adapters.eyes.thinning import Empties
from autopilot.geo import Origin
from autopilot.ports.config import EyesSection
from autopilot.ports.edges import Clock, EyesFacts, InputClass, Offer, PoseSource
from autopilot.wire.detections_pb2 import DetectionBatch
from events.schema.eyes_pb2 import EyesChanged

ROOM_POLL_S = 0.005  # a file that is read fast looks this often whether the inbox has room again


def model_sha256(path: str) -> bytes:
    """Return the SHA-256 of a model file, for the manifest. Raises `OSError` where it cannot be read."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").digest()


class Eyes:
    """One camera and its detector, from the source to the inbox.

    `ended` is set when the source has ended by itself, or can never begin: then `refusal` says
    why, naming the key of the configuration. `rejected` counts unusable batches by reason.
    """

    def __init__(
        self,
        settings: EyesSection,
        offer: Offer,
        clock: Clock,
        origin: Origin,
        pose_source: PoseSource | None,
        *,
        groups: Mapping[str, Sequence[str]],
        camera: int = 1,
        vehicle: int = 1,
        room: Callable[[], bool] = lambda: True,
        source: Source | None = None,
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
    ) -> None:
        """Take what it needs; nothing starts yet.

        `room` says whether the inbox takes a frame without dropping one; a file read with
        `pace = "fast"` waits for it. `source` and `sleep` are the configured ones unless a test brings its own.
        """
        self.ended = asyncio.Event()
        self.refusal: str | None = None
        self.rejected: Counter[str] = Counter()
        self._settings = settings
        self._offer, self._clock, self._room, self._sleep = offer, clock, room, sleep
        self._camera, self._vehicle = camera, vehicle
        self._places = Places(settings, origin, pose_source, groups)
        self._empties = Empties(settings.empty_frame_period_s)
        self._waits = settings.source == "file" and settings.pace == "fast"
        self._source = source or source_of(settings, camera)
        self._task: asyncio.Task[None] | None = None
        self._told: tuple[str, str] = ("", "")
        self._running_since_ns: int | None = None
        self._detector_us: int | None = None
        self._frame_ns: int | None = None  # when the newest frame came, also one that is not recorded; monotonic

    def facts(self) -> EyesFacts:
        """Return what the self-test asks. On the loop that the eyes run on."""
        frame_ns = self._frame_ns
        frame_ms_ago = None if frame_ns is None else max(self._clock.mono_ns() - frame_ns, 0) // 1_000_000
        return EyesFacts(frame_ms_ago, self._detector_us)

    async def start(self) -> None:
        """Begin to look; returns at once. Does nothing where `source = "none"`."""
        if self._settings.source != "none" and self._task is None:
            self._task = asyncio.create_task(self._keep_looking(), name="eyes")

    async def stop(self) -> None:
        """Stop looking and end the child; safe to call at any time. Raises what ended the task by mistake."""
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task

    async def _keep_looking(self) -> None:
        """Open the source again and again, until it ended or was refused."""
        first_s, longest_s = self._settings.retry_first_s, self._settings.retry_longest_s
        wait_s = first_s
        while True:
            try:
                because = await self._look()
            except Lost as lost:
                await self._tell("lost", str(lost))
                if isinstance(lost, Refused):
                    self.refusal = str(lost)
                    self.ended.set()
                    return
            else:
                await self._tell("ended", because)
                self.ended.set()
                if self._settings.source != "external":
                    return
            wait_s = first_s if self._ran_for_s() > longest_s else wait_s
            await self._sleep(wait_s)
            wait_s = min(2 * wait_s, longest_s)

    def _ran_for_s(self) -> float:
        """Return how long the last source ran: one that always fails soon after its start waits ever longer."""
        since_ns = self._running_since_ns
        return 0.0 if since_ns is None else (self._clock.mono_ns() - since_ns) / 1e9

    async def _look(self) -> str:
        """Read one source to its end and return why it ended; raises `Lost` where it did not say."""
        self._running_since_ns = None
        self._empties.begin()
        try:
            reader = await self._source.open()
            return await self._read(reader)
        finally:
            await self._source.close()

    async def _read(self, reader: asyncio.StreamReader) -> str:
        """Observe batch after batch; return why the source ended."""
        while True:
            payload = await self._payload(reader)
            if payload is None:
                raise await self._source.why()
            batch = judged(payload, self._camera, self._settings.detections)
            if isinstance(batch, Rejection):
                raise self._unusable(batch.because)
            if batch.ended_because:
                return batch.ended_because
            await self._observe(batch)

    async def _payload(self, reader: asyncio.StreamReader) -> bytes | None:
        """Return the next message; raises `Lost` for silence and for a stream that cannot be read on."""
        try:
            async with asyncio.timeout(self._settings.silence_s):
                return await read_framed(reader, self._settings.message_bytes)
        except TimeoutError:
            raise Lost(f"nothing heard from the detector for {self._settings.silence_s:g} s") from None
        except Broken as broken:
            lost = self._unusable(broken.because)
            raise (await self._source.why() if broken.because == "cut_short" else lost) from broken
        except OSError as error:
            raise Lost(f"the detector's connection broke: {error.strerror or error}") from error

    def _unusable(self, because: str) -> Lost:
        """Count a message that cannot be used and return what to say about it."""
        self.rejected[because] += 1
        return Lost(f"the detector sent what cannot be used: {because.replace('_', ' ')}")

    async def _observe(self, batch: DetectionBatch) -> None:
        """Offer one frame, and before the first one that the eyes are running."""
        self._frame_ns = self._clock.mono_ns()
        if self._running_since_ns is None:
            self._running_since_ns = self._frame_ns
        self._detector_us = batch.latency_us if batch.HasField("latency_us") else self._detector_us
        await self._tell("running", "", batch.model)
        captured_ns = batch.captured_ns or self._clock.mono_ns()
        observed = self._places.observed(batch, self._vehicle, captured_ns)
        if not self._empties.news(observed):
            return
        while self._waits and not self._room():
            await self._sleep(ROOM_POLL_S)
        self._offer(InputClass.FRAME, observed)

    async def _tell(self, state: str, because: str, model: str = "") -> None:
        """Offer a change of state until it is taken; what was said last is not said again."""
        if self._told == (state, because):
            return
        changed = EyesChanged(vehicle=self._vehicle, camera=self._camera, state=state, because=because)
        if model:
            changed.model = model
        await self._surely(changed)
        self._told = (state, because)

    async def _surely(self, observation: Message) -> None:
        """Offer an outcome until the inbox takes it."""
        while not self._offer(InputClass.OUTCOME, observation):
            await self._sleep(ROOM_POLL_S)
