"""What goes over the link, in files of the open flight: when one begins and ends, and what is done on a full disk.

Files are written by a thread of their own, so that a disk that stalls never stalls the link; what comes faster than
the disk takes it is dropped and counted. A file is closed at its size, at its age, and where another flight begins;
then its digest is offered to the log until it is taken, and after a moment, in which that became durable, it gets its
name. What a process left open is closed so by the next start, in whichever flight it lies.

Raw data is the first to stop when the disk is short, and says so; it goes on when there is room again.
"""

from __future__ import annotations

import queue
import shutil
import threading
from collections import Counter, deque
from collections.abc import Callable
from functools import partial
from pathlib import Path

from google.protobuf.message import Message

from autopilot.adapters.vehicle import tlog
from autopilot.ports.config import VehicleSection
from autopilot.ports.edges import Clock, InputClass, Offer
from events.schema.link_pb2 import RawChanged

MIB = 1 << 20
WAITING_MAX = 4_096  # frames that the disk has not taken yet: half a minute of a busy link
DROPPED = "raw dropped"
TURN_S = 1.0
LOOK_NS = 5_000_000_000  # the disk is looked at this often
AGAIN_NS = 30_000_000_000  # after a failure it is tried again
SETTLE_NS = 2_000_000_000  # by then a record that was taken is durable: a group commits within 0.1 s, a stall is 0.5 s
LAST_NS = 2_000_000_000  # how long the end waits for the log to take the last digest
ROOM_AGAIN_PERCENT = 110  # of what is wanted free, so that it does not stop and go on at every file


def free_bytes(folder: Path) -> int:
    """Return how much of the disk below a folder is free. Raises OSError."""
    return shutil.disk_usage(folder).free


class Recorder:
    """Decides; on one thread, with time as an argument. Nothing of it raises."""

    def __init__(self, settings: VehicleSection, offer: Offer, free: Callable[[Path], int] = free_bytes) -> None:
        self._settings = settings
        self._offer = offer
        self._free = free
        self._folder: Path | None = None
        self._segment: tlog.Segment | None = None
        self._begun_ns = 0
        self._look_ns = 0
        self._owed: deque[tuple[Path | None, Message]] = deque()  # what the log is to be told, and of which file
        self._named: deque[tuple[int, Path]] = deque()  # when a file may get its name
        self.stopped = ""  # why nothing is recorded; "" while it is

    def record_in(self, now_ns: int, flight: Path) -> None:
        """Go on in the folder of a flight; the first time what was left open anywhere beside it is closed."""
        if self._folder is None:
            for path in tlog.left_open(flight.parent):
                self._try(now_ns, partial(self._close_found, path))
        self._close(now_ns)
        self._folder = flight / "raw"
        self._look_ns = now_ns
        self.turn(now_ns)

    def note(self, now_ns: int, record: bytes) -> None:
        """Write a record of `tlog.record_of`."""
        if self._folder is not None and not self.stopped:
            self._try(now_ns, lambda: self._write(now_ns, record))

    def turn(self, now_ns: int) -> None:
        """Do what is due."""
        if self._segment is not None:
            self._try(now_ns, self._segment.flush)
        if self._is_old(now_ns):
            self._close(now_ns)
        if self._folder is not None and now_ns >= self._look_ns:
            self._look_ns = now_ns + LOOK_NS
            self._look(now_ns)
        self._tell(now_ns)

    def end(self, now_ns: int) -> bool:
        """Close everything; return whether the log has taken all there is to say. May be called again."""
        self._close(now_ns)
        self._folder = None
        self._tell(now_ns)
        self._name_files(now_ns + SETTLE_NS)
        return not self._owed

    def _write(self, now_ns: int, record: bytes) -> None:
        assert self._folder is not None
        if self._segment is None:
            self._segment = tlog.Segment(self._folder, self._next(self._folder))
            self._begun_ns = now_ns
        self._segment.write(record)
        if self._segment.size_bytes >= self._settings.raw_segment_mib * MIB:
            self._close(now_ns)

    def _next(self, folder: Path) -> int:
        return tlog.next_number(folder) if folder.is_dir() else 1

    def _is_old(self, now_ns: int) -> bool:
        return self._segment is not None and now_ns - self._begun_ns >= self._settings.raw_segment_s * 1e9

    def _close(self, now_ns: int) -> None:
        segment, self._segment = self._segment, None
        if segment is not None:
            self._try(now_ns, lambda: self._owed.append((segment.path, segment.close())))

    def _close_found(self, path: Path) -> None:
        self._owed.append((path, tlog.close_found(path)))

    def _look(self, now_ns: int) -> None:
        """Stop where the disk is short, and go on where it is not any more."""
        assert self._folder is not None
        wanted = self._settings.raw_min_free_mib * MIB
        try:
            free = self._free(self._folder.parent)
        except OSError as error:
            self._stop(now_ns, _words(error))
            return
        if free < wanted:
            self._stop(now_ns, f"less than {self._settings.raw_min_free_mib} MiB free")
        elif self.stopped and free * 100 >= wanted * ROOM_AGAIN_PERCENT:
            self.stopped = ""
            self._owed.append((None, RawChanged(recording=True)))

    def _stop(self, now_ns: int, because: str) -> None:
        if not self.stopped:
            self.stopped = because
            self._owed.append((None, RawChanged(recording=False, because=because)))
        self._close(now_ns)

    def _try(self, now_ns: int, work: Callable[[], None]) -> None:
        try:
            work()
        except OSError as error:
            self._segment = None  # what it holds is found by the next start
            self._look_ns = now_ns + AGAIN_NS
            self._stop(now_ns, _words(error))

    def _tell(self, now_ns: int) -> None:
        while self._owed and self._offer(InputClass.OUTCOME, self._owed[0][1]):
            path, _ = self._owed.popleft()
            if path is not None:
                self._named.append((now_ns + SETTLE_NS, path))
        self._name_files(now_ns)

    def _name_files(self, now_ns: int) -> None:
        while self._named and self._named[0][0] <= now_ns:
            _, path = self._named.popleft()
            self._try(now_ns, partial(tlog.name_for_good, path))


class RawLog:
    """A `Recorder` on a thread of its own. `note` and `record_in` may be called from any thread; neither waits."""

    def __init__(self, settings: VehicleSection, offer: Offer, clock: Clock, counts: Counter[str]) -> None:
        self._recorder = Recorder(settings, offer)
        self._clock = clock
        self._counts = counts
        self._waiting: queue.SimpleQueue[bytes | Path | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="raw", daemon=True)

    @property
    def stopped(self) -> str:
        """Why nothing is recorded; "" while it is."""
        return self._recorder.stopped

    def start(self) -> None:
        """Begin to write."""
        self._thread.start()

    def record_in(self, flight: Path) -> None:
        """Go on in the folder of a flight."""
        self._waiting.put(flight)

    def note(self, frame: bytes) -> None:
        """Take a whole frame that came or went."""
        record = tlog.record_of(self._clock.wall_ns() // 1_000, frame)
        if record is None:
            return
        if self._waiting.qsize() >= WAITING_MAX:
            self._counts[DROPPED] += 1
        else:
            self._waiting.put(record)

    def stop(self) -> None:
        """Write what waits, close the file and have it recorded; waits for the disk."""
        if self._thread.is_alive():
            self._waiting.put(None)
            self._thread.join()

    def _run(self) -> None:
        while True:
            try:
                item = self._waiting.get(timeout=TURN_S)
            except queue.Empty:
                self._recorder.turn(self._clock.mono_ns())
                continue
            now_ns = self._clock.mono_ns()
            if item is None:
                break
            if isinstance(item, Path):
                self._recorder.record_in(now_ns, item)
            else:
                self._recorder.note(now_ns, item)
                self._turn_at_times(now_ns)
        self._end()

    _turned_ns = 0

    def _turn_at_times(self, now_ns: int) -> None:
        if now_ns - self._turned_ns >= TURN_S * 1e9:
            self._turned_ns = now_ns
            self._recorder.turn(now_ns)

    def _end(self) -> None:
        give_up_ns = self._clock.mono_ns() + LAST_NS
        while not self._recorder.end(self._clock.mono_ns()) and self._clock.mono_ns() < give_up_ns:
            threading.Event().wait(0.05)


def _words(error: OSError) -> str:
    return error.strerror or type(error).__name__
