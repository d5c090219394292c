"""The daemon: the loop, its adapters, and what the node says of itself, from start to stop.

What decides is elsewhere (`statecharts`), what talks to the world is elsewhere (`adapters`), and who needs whom is in
`edges`. Here is the order in which things start and stop, and what the process says when it ends.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import os
import signal
import sys
import traceback
from collections.abc import Awaitable, Callable
from importlib.metadata import version
from pathlib import Path

from autopilot.adapters.eyes import model_sha256
from autopilot.geo import Origin
from autopilot.node.attachments import Attachments
from autopilot.node.board import Board
from autopilot.node.clock import boot_id
from autopilot.node.deleting import Retention
from autopilot.node.edges import Edges, Remembered, make_edges, remembered, resume
from autopilot.node.flights import Flights, Session
from autopilot.node.flights import Identity as NodeIdentity
from autopilot.node.inbox import Inbox
from autopilot.node.limits import configuration_message
from autopilot.node.lock import FolderLock, FolderTaken
from autopilot.node.loop import NodeLoop, Stop
from autopilot.node.not_recording import CannotRecord, NotRecording
from autopilot.node.projecting import Projecting
from autopilot.node.proving import Prover
from autopilot.node.restoring import Keeper
from autopilot.node.sealing import Sealer
from autopilot.node.trusting import keep_up, put_into_force, remembers_all, settle
from autopilot.node.upkeep import Rejections, publish_status, record_rejections, report_rejections
from autopilot.node.verdicts import Verdicts
from autopilot.ports.config import Config
from autopilot.ports.edges import InputClass
from autopilot.trust.book import TrustBook
from autopilot.trust.clock import HostClock
from autopilot.trust.freshness import TrustClock
from autopilot.trust.identity import Identity, IdentityError, load_identity
from autopilot.trust.keys import SecretFileError
from events.kinds import UnknownKind
from events.records import BodyBroken, Record
from events.schema.flight_pb2 import CLOSE_INPUT_ENDED, CLOSE_STOPPED, Model
from events.store import StoreFailed

# Without a turn of the loop for this long the node is not well, and its heartbeat stops.
UNWELL_AFTER_NS = 3_000_000_000
UPKEEP_AGAIN_S = 1.0
# How long a thread may keep the interpreter while another waits for it: an order passes three threads, and upkeep and
# projections work beside them (Python's own 5 ms is five orders' time).
SWITCH_S = 0.0005
# How long the end waits for orders that came before it.
LAST_ORDERS_S = 1.0


class BadAddress(Exception):
    """The configuration names an address that can't be used; the text names the key."""


class Daemon:
    """One node. `run` is its life."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._clock = TrustClock(HostClock(), host_trusted=config.clock.trusted)
        self._origin = Origin()
        self._inbox = Inbox(config.limits, self._clock)
        self._board = Board(lambda: self._clock.wall_ns() // 1_000_000)
        self._attachments = Attachments()
        self._asked_to_stop = asyncio.Event()

    async def run(self) -> int:
        """Run until SIGTERM, SIGINT, the end of the input, or a failure; return the exit code (sysexits)."""
        for number in (signal.SIGTERM, signal.SIGINT):
            asyncio.get_running_loop().add_signal_handler(number, self._asked_to_stop.set)
        sys.setswitchinterval(SWITCH_S)
        try:
            identity = load_identity(self._config.node.keys, self._clock.time().earliest_ms)
            return await self._live(identity)
        except IdentityError as error:
            loose = isinstance(error.__cause__, SecretFileError)
            return _say(f"[node] keys: {error}", os.EX_NOPERM if loose else os.EX_CONFIG)
        except FolderTaken as error:
            return _say(f"[node] flights: {error}", os.EX_UNAVAILABLE)
        except BadAddress as error:
            return _say(str(error), os.EX_CONFIG)
        except OSError as error:
            return _say(str(error), os.EX_IOERR)

    async def _live(self, identity: Identity) -> int:
        """Record as soon as the store can be opened; until then say that nothing is recorded, and refuse."""
        refusing = NotRecording(self._config, identity, self._clock)
        try:
            while True:
                try:
                    return await self._locked(identity, refusing)
                except CannotRecord as error:
                    refusing.say(str(error))
                await _first(self._asked_to_stop.wait(), asyncio.sleep(self._config.limits.store_retry_s))
                if self._asked_to_stop.is_set():
                    return _say("nothing was recorded", os.EX_IOERR)
        finally:
            await refusing.stop()

    async def _locked(self, identity: Identity, refusing: NotRecording) -> int:
        with contextlib.ExitStack() as held:
            try:
                held.enter_context(FolderLock(Path(self._config.node.flights)))
            except OSError as error:
                raise CannotRecord(str(error)) from error
            return await self._record(identity, refusing)

    async def _record(self, identity: Identity, refusing: NotRecording) -> int:
        """Open the log and live. Raises CannotRecord where the store can't be opened."""
        asyncio_loop, over = asyncio.get_running_loop(), asyncio.Event()
        ready: asyncio.Future[Remembered] = asyncio_loop.create_future()
        self._board.attend(asyncio_loop)
        edges: Edges
        book = TrustBook(identity, self._clock, record=lambda learned: self._inbox.offer(InputClass.OUTCOME, learned))
        loop = NodeLoop(
            self._flights(identity),
            self._inbox,
            self._clock,
            self._config.limits,
            close_after_s=self._config.flight.close_after_s,
            on_session=lambda session: self._opened(session, asyncio_loop, ready, lambda: edges),
            on_records=lambda records: self._heard(book, edges, records),
            perform=lambda record: _perform(asyncio_loop, edges, record),
            on_end=lambda: _call(asyncio_loop, over.set),
        )
        prover = Prover(Path(self._config.node.flights))
        edges = make_edges(
            *(self._config, identity, self._clock, self._inbox, self._origin, lambda: self._is_well(loop)),
            proving=prover,
            judge=self._board.judge_cosignature,
            book=book,
            attachments=self._attachments,
        )
        prover.start()
        loop.start()
        try:
            await _first(asyncio.shield(ready), over.wait())
            if not ready.done() and isinstance(loop.failure, StoreFailed):
                raise CannotRecord(str(loop.failure))
            if ready.done():
                await refusing.stop()
                refusing.over()
                await self._serve(loop, edges, over, ready.result(), book)
        finally:
            prover.stop()
        return _exit_code(loop, edges.eyes.refusal)

    def _heard(self, book: TrustBook, edges: Edges, records: tuple[Record, ...]) -> None:
        """Take in what is durable. On the node's thread."""
        put_into_force(book, records)
        if edges.selftest is not None:
            edges.selftest.noted.hear(records)
        self._board.hear(records)

    def _opened(
        self,
        session: Session,
        asyncio_loop: asyncio.AbstractEventLoop,
        ready: asyncio.Future[Remembered],
        edges: Callable[[], Edges],
    ) -> None:
        """Follow a session that was opened. On the node's thread, which owns its state."""
        self._board.follow(session)
        self._attachments.attend(session.flight.folder)
        if session.sealing is not None and session.sealing.refusal:
            print(f"autopilot: the log is not signed any more: {session.sealing.refusal}", file=sys.stderr, flush=True)
        memory = remembered(session)
        made = edges()
        made.record_in(session.flight.folder)
        if made.selftest is not None:
            made.selftest.noted.resume(session.state)
        _call(asyncio_loop, lambda: _settle(ready, memory))

    async def _serve(
        self, loop: NodeLoop, edges: Edges, over: asyncio.Event, memory: Remembered, book: TrustBook
    ) -> None:
        """Run the adapters around a loop that records, and end both."""
        book.resume(memory.believed.floors, memory.believed.time_floor_ms)
        whole = remembers_all(memory.believed, Path(self._config.node.keys))
        resume(self._config, memory, edges, self._inbox, self._origin, whole=whole)
        projecting = Projecting(Path(self._config.node.projections), self._board)
        rejections = Rejections(edges)
        verdicts = Verdicts(Path(self._config.node.flights), book.held, version("autopilot"), self._board)
        tasks = [
            asyncio.create_task(_kept_up(lambda: publish_status(self._config.mesh, edges, self._board))),
            asyncio.create_task(_kept_up(lambda: record_rejections(rejections, self._inbox))),
            asyncio.create_task(_kept_up(projecting.run)),
            asyncio.create_task(_kept_up(lambda: keep_up(book))),
            asyncio.create_task(_kept_up(verdicts.run)),
            asyncio.create_task(_kept_up(self._retention().run)),
        ]
        try:
            await settle(book, over)
            gc.freeze()  # what lives as long as the process is not looked through again: that would stop an order
            await _start(edges)
            print(f"autopilot: recording in {self._board.session.flight.folder}", file=sys.stderr, flush=True)
            await _first(self._asked_to_stop.wait(), self._input_ended(edges), over.wait())
        finally:
            try:
                await self._take_what_waits(loop)
                await edges.stop()
            finally:  # whatever an adapter does, the log gets its end
                report_rejections(rejections, self._inbox)
                loop.stop(Stop(CLOSE_INPUT_ENDED if self._ends_with_input(edges) else CLOSE_STOPPED))
                await over.wait()
                for task in tasks:
                    task.cancel()
                await asyncio.gather(*tasks, return_exceptions=True)
                await projecting.finish()

    async def _take_what_waits(self, loop: NodeLoop) -> None:
        """Let the loop take the orders that wait while somebody can still perform them."""
        self._inbox.close_to_orders()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(LAST_ORDERS_S):
                while loop.is_alive() and not self._inbox.empty:
                    await asyncio.sleep(LAST_ORDERS_S / 100)

    async def _input_ended(self, edges: Edges) -> None:
        """Wait for the end of the input where that is the end: as configured, or because it can never begin."""
        await edges.eyes.ended.wait()
        if not self._ends_with_input(edges) and edges.eyes.refusal is None:
            await asyncio.Event().wait()

    def _ends_with_input(self, edges: Edges) -> bool:
        ended = edges.eyes.ended.is_set() and edges.eyes.refusal is None
        return ended and self._config.eyes.at_end == "stop"

    def _is_well(self, loop: NodeLoop) -> bool:
        return loop.is_alive() and self._clock.mono_ns() - loop.turned_ns < UNWELL_AFTER_NS

    def _retention(self) -> Retention:
        return Retention(
            Path(self._config.node.flights),
            self._config.retention,
            self._clock,
            self._inbox.offer,
            lambda: self._board.session.flight.number,
            self._board.say_short,
        )

    def _flights(self, identity: Identity) -> Flights:
        config, sealer = self._config, Sealer(identity, self._clock)
        models = [config.eyes.model] if config.eyes.source in ("file", "device") else []
        return Flights(
            Path(config.node.flights),
            NodeIdentity(
                node=identity.principal_id,
                public_key=identity.public_key,
                deployment_id=identity.deployment_id,
                software=version("autopilot"),
                boot_id=boot_id(),
                configuration=configuration_message(config),
                models=tuple(
                    Model(purpose="detector", name=Path(path).name, sha256=model_sha256(path)) for path in models
                ),
            ),
            self._clock,
            sealer=sealer,
            outage_longest_h=config.flight.outage_longest_h,
            keeper=Keeper(sealer, version("autopilot"), lambda: self._board.folded, self._board.recall),
        )


async def _start(edges: Edges) -> None:
    """Start the adapters. Raises BadAddress and OSError."""
    try:
        await edges.start()
    except ValueError as error:
        raise BadAddress(str(error)) from error


async def _kept_up(work: Callable[[], Awaitable[None]]) -> None:
    """Do the work until it is done; a defect in it is said and must not end the flight."""
    while True:
        try:
            return await work()
        except Exception:  # noqa: BLE001 - upkeep: nothing that is decided or performed depends on it
            print(f"autopilot: upkeep failed and begins again:\n{traceback.format_exc()}", file=sys.stderr, flush=True)
            await asyncio.sleep(UPKEEP_AGAIN_S)


async def _first(*waits: Awaitable[object]) -> None:
    """Wait for the first of several; the others are given up."""
    tasks = [asyncio.ensure_future(wait) for wait in waits]
    await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    for task in tasks:
        task.cancel()


def _call(asyncio_loop: asyncio.AbstractEventLoop, call: Callable[[], object]) -> None:
    """Call on the asyncio loop; one that is closing has nothing left to do."""
    with contextlib.suppress(RuntimeError):
        asyncio_loop.call_soon_threadsafe(call)


def _perform(asyncio_loop: asyncio.AbstractEventLoop, edges: Edges, record: Record) -> None:
    """Have a durable effect performed: what is for the vehicle here and now, anything else on the asyncio loop.

    A change of threads costs an order a tenth of its time. A defect in performing must not end the node's thread.
    """
    if record.kind.port != "vehicle":
        _call(asyncio_loop, lambda: edges.perform(record))
        return
    try:
        edges.perform(record)
    except Exception:  # noqa: BLE001 - the boundary: that nothing came of it is for timeouts and failsafes
        print(f"autopilot: an effect failed:\n{traceback.format_exc()}", file=sys.stderr, flush=True)


def _settle(ready: asyncio.Future[Remembered], memory: Remembered) -> None:
    """Say that the log is open; only the first session of a process is waited for."""
    if not ready.done():
        ready.set_result(memory)


def _exit_code(loop: NodeLoop, refusal: str | None) -> int:
    if isinstance(loop.failure, UnknownKind | BodyBroken):
        return _say(f"the newest flight can't be read: {loop.failure}", os.EX_DATAERR)
    if loop.failure is not None:
        return _say(f"the log failed, nothing more is recorded: {loop.failure}", os.EX_IOERR)
    if loop.defect:
        return _say(f"the loop ended by a defect:\n{loop.defect}", os.EX_SOFTWARE)
    if refusal is not None:
        return _say(refusal, os.EX_CONFIG)
    return os.EX_OK


def _say(text: str, code: int) -> int:
    print(f"autopilot: {text}", file=sys.stderr)
    return code
