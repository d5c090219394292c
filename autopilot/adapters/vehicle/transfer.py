"""One mission into one vehicle, and read back: executes the chart `transfer`, which has the theory of operation.

Time is an argument, messages are plain values; no socket, no encoding, no decision that is not a row of the chart. What
is to be said comes out of `take` as `Say`, how it ended as one MissionUploaded or MissionUploadFailed. Where nothing is
under way whatever is heard is nobody's.

Waits: the protocol's own numbers (MAVLink guide, Mission Protocol: 1500 ms, items 250 ms, 5 retries). The wait for an
item doubles with each retry, else a link of 2 s would never carry a mission.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from google.protobuf.message import Message

from autopilot.adapters.vehicle.heard import (
    Item,
    ItemCount,
    ItemGiven,
    ItemRequest,
    MissionAnswer,
    Sender,
    Transferred,
)
from autopilot.adapters.vehicle.mission_form import difference
from autopilot.adapters.vehicle.modes import Family
from autopilot.ports.config import VehicleSection
from events.schema.mission_pb2 import MissionUploaded, MissionUploadFailed, VehicleHolds
from statecharts.charts.transfer import ACCEPTED, CANCELLED, CHART, OF_AN_ITEM, Facts
from statecharts.table import Answer, Row

ATTEMPTS_MAX = 2  # "re-upload once": what fails twice fails for a reason
_S = 1_000_000_000


class Word(Enum):
    """What is said to the vehicle."""

    COUNT = "MISSION_COUNT"
    ITEM = "MISSION_ITEM_INT"
    LIST = "MISSION_REQUEST_LIST"
    REQUEST = "MISSION_REQUEST_INT"
    ANSWER = "MISSION_ACK"
    CLEAR = "MISSION_CLEAR_ALL"


@dataclass(frozen=True, slots=True)
class Say:
    """Wish of the transfer: encode and send this."""

    target: Sender
    word: Word
    number: int = 0  # count, sequence number or MAV_MISSION_RESULT
    item: Item | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Upload:
    """What is to be in the vehicle, as it counts."""

    effect_seq: int
    items: tuple[Item, ...]
    family: Family
    target: Sender
    deadline_ns: int  # monotonic; from here on nothing is said but that it is cancelled

    @property
    def first(self) -> int:
        """The vehicle's number of the plan's first item: ArduPilot has home before it."""
        return 1 if self.family.is_ardupilot else 0


@dataclass(slots=True)
class _Run:
    """How far an upload is."""

    upload: Upload
    due_ns: int
    state: str = CHART.initial
    attempts: int = 0
    tries: int = 0  # how often the last thing was said
    furthest: int = -1
    reading: int = 0
    swapped: bool = False  # it may have taken a mission already, whole or not
    spoilt: bool = False  # what it has is known to be neither the old nor the new mission
    opaque_id: int = 0
    result: int | None = None  # of the refusal that ended it
    item: int | None = None
    wrong: str = ""  # what came back otherwise
    why: str = ""  # why it was given up, where it is cleared after that


class Transfer:
    """The mission protocol of one link; one upload at a time."""

    def __init__(self, settings: VehicleSection) -> None:
        self._wait_ns = round(settings.mission_timeout_s * _S)
        self._item_wait_ns = round(settings.mission_item_timeout_s * _S)
        self._rest_ns = round(settings.mission_rest_s * _S)
        self._retries = settings.mission_retries
        self._run: _Run | None = None
        self._quiet_ns = 0  # what was said in an upload before this may be answered until then
        self._out: list[Say | Message] = []

    @property
    def busy(self) -> bool:
        """Whether an upload is under way."""
        return self._run is not None

    def begin(self, now_ns: int, upload: Upload) -> None:
        """Take an upload; the caller has asked `busy`."""
        self._run = _Run(upload, due_ns=max(now_ns, self._quiet_ns))
        self.tick(now_ns)

    def refuse(self, effect_seq: int, because: str) -> None:
        """Report that an upload was never begun; the vehicle has what it had."""
        self._out.append(
            MissionUploadFailed(effect_seq=effect_seq, because=because, holds=VehicleHolds.VEHICLE_HOLDS_OLD)
        )

    def hear(self, now_ns: int, heard: Transferred) -> bool:
        """Take what the vehicle says; False where it answers nothing that is under way."""
        run = self._run
        if run is None or heard.sender != run.upload.target:
            return False
        match heard:
            case ItemRequest():
                return self._fire(now_ns, run, "requested", self._facts(run, seq=heard.seq))
            case MissionAnswer():
                run.swapped = run.swapped or heard.result == ACCEPTED
                taken = self._fire(now_ns, run, "acknowledged", self._facts(run, result=heard.result))
                if taken and run.state == "listing":
                    run.opaque_id = heard.opaque_id
                return taken
            case ItemCount():
                return self._fire(now_ns, run, "counted", self._facts(run, equal=self._fits(run, heard)))
            case ItemGiven():
                return self._given_back(now_ns, run, heard.item)

    def tick(self, now_ns: int) -> None:
        """Do what is due."""
        run = self._run
        if run is None:
            return
        if now_ns >= run.upload.deadline_ns:
            self._fire(now_ns, run, "expired", self._facts(run))
        elif now_ns >= run.due_ns:
            self._fire(now_ns, run, "silent", self._facts(run))

    def due_ns(self) -> int | None:
        """Return when `tick` must be called next, or None."""
        return None if self._run is None else min(self._run.due_ns, self._run.upload.deadline_ns)

    def take(self) -> list[Say | Message]:
        """Return what is to be said and reported, in order, and forget it."""
        out, self._out = self._out, []
        return out

    def _facts(self, run: _Run, *, seq: int = 0, result: int = 0, equal: bool = False) -> Facts:
        family, last = run.upload.family, len(run.upload.items) - 1
        return Facts(
            seq=seq,
            furthest=run.furthest,
            count=len(run.upload.items),
            reading=run.reading,
            result=result,
            equal=equal,
            tries_left=run.tries <= self._retries,
            attempts_left=run.attempts < ATTEMPTS_MAX,
            keeps_old=family is Family.PX4 and not run.swapped and (run.furthest < last or result in OF_AN_ITEM),
            goes_on=family.is_ardupilot,
        )

    def _fits(self, run: _Run, heard: ItemCount) -> bool:
        """The same number of items, and no other plan where the vehicle numbers its plans."""
        other = run.opaque_id and heard.opaque_id and run.opaque_id != heard.opaque_id
        fits = heard.count == len(run.upload.items) and not other
        if run.state == "listing":
            run.wrong = "" if fits else f"{heard.count} items for {len(run.upload.items)}, plan {heard.opaque_id}"
            run.opaque_id = run.opaque_id or heard.opaque_id
        return fits

    def _given_back(self, now_ns: int, run: _Run, item: Item) -> bool:
        wrong = ""
        if run.state == "reading" and item.seq == run.reading:
            wrong = difference(run.upload.items[item.seq], item, run.upload.family)
            run.wrong = f"item {item.seq}: {wrong}" if wrong else ""
            run.item = item.seq if wrong else None
        return self._fire(now_ns, run, "given_back", self._facts(run, seq=item.seq, equal=not wrong))

    def _fire(self, now_ns: int, run: _Run, trigger: str, facts: Facts) -> bool:
        """Ask the chart, and do what the move means. True where it was a move."""
        row = CHART.ask(run.state, trigger, facts)
        if row.answer is not Answer.MOVE:
            return False
        before, run.state = run.state, row.target
        if trigger == "acknowledged" and before in ("offering", "sending") and facts.result != ACCEPTED:
            run.result, run.item = facts.result, run.furthest
        if trigger == "requested":
            self._give(now_ns, run, facts.seq)
        elif row.target in ("uploaded", "failed"):
            self._end(now_ns, run, before, row, _holds(run, before, trigger, facts))
        else:
            run.spoilt = run.spoilt or (row.target != "reading" and trigger in ("counted", "given_back"))
            run.why = row.because if row.target == "settling" else run.why
            self._go_on(now_ns, run, before, trigger)
        return True

    def _give(self, now_ns: int, run: _Run, seq: int) -> None:
        """Give the item that it asks for. An upload that is read back meanwhile changes no wait."""
        run.furthest = max(run.furthest, seq)
        run.spoilt = run.spoilt or run.upload.family is not Family.PX4
        if run.state == "sending":
            run.tries = 0
            self._say(now_ns, run, Word.ITEM, seq, wait_ns=self._item_wait_ns)
        else:
            self._out.append(Say(run.upload.target, Word.ITEM, seq, run.upload.items[seq]))

    def _go_on(self, now_ns: int, run: _Run, before: str, trigger: str) -> None:
        """Say what the state calls for; a first time, or again after silence."""
        if run.state != before or trigger != "silent":
            run.tries = 0
        match run.state:
            case "resting" | "settling":
                run.due_ns = now_ns + self._rest_ns
            case "offering":
                if before == "resting":
                    run.attempts += 1
                    run.swapped = run.swapped or run.furthest == len(run.upload.items) - 1
                    run.furthest, run.opaque_id, run.result, run.item, run.wrong = -1, 0, None, None, ""
                self._say(now_ns, run, Word.COUNT, len(run.upload.items), wait_ns=self._wait_ns)
            case "sending":
                self._say(now_ns, run, Word.ITEM, run.furthest, wait_ns=self._item_wait_ns << run.tries)
            case "listing":
                run.swapped, run.spoilt, run.reading = True, False, 0
                self._say(now_ns, run, Word.LIST, 0, wait_ns=self._wait_ns)
            case "reading":
                if trigger == "given_back":
                    run.reading += 1
                self._say(now_ns, run, Word.REQUEST, run.reading, wait_ns=self._item_wait_ns << run.tries)
            case "clearing":
                self._say(now_ns, run, Word.CLEAR, 0, wait_ns=self._wait_ns)

    def _say(self, now_ns: int, run: _Run, word: Word, number: int, wait_ns: int) -> None:
        """Say it and wait for what it calls for."""
        item = run.upload.items[number] if word is Word.ITEM else None
        self._out.append(Say(run.upload.target, word, number, item))
        run.tries += 1
        run.due_ns = now_ns + wait_ns

    def _end(self, now_ns: int, run: _Run, before: str, row: Row[Facts], holds: VehicleHolds.ValueType) -> None:
        self._run = None
        self._quiet_ns = now_ns + self._rest_ns
        if row.target == "uploaded":
            self._out.append(Say(run.upload.target, Word.ANSWER, ACCEPTED))
            self._out.append(
                MissionUploaded(
                    effect_seq=run.upload.effect_seq,
                    items=len(run.upload.items) - run.upload.first,
                    opaque_id=run.opaque_id or None,
                    attempts=run.attempts,
                )
            )
            return
        if before in ("sending", "listing", "reading"):
            self._out.append(Say(run.upload.target, Word.ANSWER, CANCELLED))
        self._out.append(
            MissionUploadFailed(
                effect_seq=run.upload.effect_seq,
                because=_because(run, row),
                mav_mission_result=run.result,
                item=_of_plan(run),
                holds=holds,
                attempts=run.attempts,
            )
        )


def _because(run: _Run, row: Row[Facts]) -> str:
    words = f"{run.why}; {row.because}" if run.why else row.because
    return f"{words} ({run.wrong})" if run.wrong else words


def _of_plan(run: _Run) -> int | None:
    """Return the plan's own index of the item at which it failed; home is none of the plan's."""
    if run.item is None or run.item < run.upload.first:
        return None
    return run.item - run.upload.first


def _holds(run: _Run, before: str, trigger: str, facts: Facts) -> VehicleHolds.ValueType:
    """Return what the vehicle has where an upload failed: said only where it is known."""
    if before == "clearing" and trigger == "acknowledged" and facts.result == ACCEPTED:
        return VehicleHolds.VEHICLE_HOLDS_NOTHING
    if run.attempts == 0 or (trigger == "acknowledged" and facts.keeps_old):
        return VehicleHolds.VEHICLE_HOLDS_OLD
    return VehicleHolds.VEHICLE_HOLDS_MIXED if run.spoilt else VehicleHolds.VEHICLE_HOLDS_UNSPECIFIED
