"""The book of trust: what a device believes now, changed in flight by documents that prove themselves.

What is in force is one value, an `Identity`; whoever judges a message takes it once and goes by it to the end. A
document that is offered takes this way, and no other (tough CVE-2025-2888, go-tuf CVE-2022-29173):

1.  judged against what is held and against the highest ever taken (`judging`); an alarm is recorded
2.  kept on the disk, 0600, durable (`kept`)
3.  recorded; from here on nothing lower is taken
4.  in force, once the record is durable

A kill between 2 and 3 leaves a disk that is newer than the log: the next start records what it finds. A disk that is
older than the log has lost something: the start records that too, and the core refuses orders until it is fetched
again. So what decisions rest on is always what the log says.

A group key goes out of force when it is retired, two minutes after a newer one came into use, or when the list says so;
then its bundle is overwritten. The key itself was in this process's memory, which nothing here can overwrite.

The book asks for what others are known to have: at most once every 10 s for each kind of document, and only on the
word of somebody whose signature was verified and who is not revoked.
"""

from __future__ import annotations

import threading
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import replace
from typing import Final

from google.protobuf.message import Message

from autopilot.trust import kept, limits
from autopilot.trust.believing import Heard
from autopilot.trust.documents import DocumentError, DocumentUnsigned, Revocations, Trust, verify_time_beacon
from autopilot.trust.fetching import Fetch, NoFetch, Offered, What
from autopilot.trust.freshness import Time, TrustClock
from autopilot.trust.identity import Epoch, Identity
from autopilot.trust.judging import NONE, Floors, Known, Refused, judge_epoch, judge_revocations, judge_root
from autopilot.trust.keys import key_id
from events.schema.trust_pb2 import EpochTaken, RevocationsTaken, RootTaken, TimeLearned, TrustAlarm

Change = Callable[[Identity], Identity]
NEWS_HELD: Final = 64  # what was learned of the time and the log did not take yet; the oldest goes
EPOCHS_HELD: Final = 3  # the one before, the one in use, the next
_BEACON_FAULTS: Final = {"unasked": Offered.UNASKED, "late": Offered.UNASKED, "rollback": Offered.ROLLBACK}


class TrustBook:
    """What one device believes. Any thread; never raises."""

    def __init__(
        self,
        identity: Identity,
        clock: TrustClock,
        *,
        record: Callable[[Message], bool],
        fetch: Fetch | None = None,
    ) -> None:
        """Make a book of what an identity's folder holds.

        `record` offers an observation to the log and says whether it took it; once it is durable it must come back
        through `recorded`.
        """
        self._held = identity
        self._clock = clock
        self._record = record
        self._fetch = fetch or NoFetch()
        self._floors = _floors_of(identity)
        self._waiting: list[tuple[Message, Change]] = []
        self._asked_ns: dict[What, int] = {}
        self._alarmed: tuple[int, bytes] | None = None  # when, and of what
        self._counts: Counter[str] = Counter()
        self._owed: deque[TimeLearned] = deque(maxlen=NEWS_HELD)
        self._offering = threading.Lock()
        self._lock = threading.Lock()
        clock.raise_floor(identity.revocations.issued_at_ms, "document")
        clock.raise_floor(identity.token.not_before_ms, "token")

    def ask_through(self, fetch: Fetch) -> None:
        """Ask for documents here from now on."""
        self._fetch = fetch

    @property
    def held(self) -> Identity:
        """What is in force now: a value that does not change."""
        return self._held

    def time(self) -> Time:
        """What is known of the present."""
        return self._clock.time()

    def echoes(self, challenge: bytes) -> bool:
        """Say whether this is this device's challenge, or the one before."""
        return self._clock.echoes(challenge)

    def challenge(self) -> bytes:
        """Return the challenge that an order may echo now, 16 bytes."""
        return self._clock.challenge()

    def overdue_ms(self) -> int:
        """For how long the next list has been due, as far as is certain; 0 while it is not."""
        return max(0, self._clock.time().earliest_ms - self._held.revocations.next_update_ms)

    def offer(self, kind: What, data: bytes) -> Offered:
        """Judge a document and put it into force; see `fetching.Offer`."""
        takers = {
            "revocations": self._take_revocations,
            "epoch": self._take_epoch,
            "trust_root": self._take_root,
            "time": self._take_time,
        }
        with self._offering:
            try:
                result = takers[kind](data)
            except OSError:
                result = Offered.NOT_KEPT
            self._counts[f"{kind}: {result.value}"] += 1
            return result

    def counts(self) -> dict[str, int]:
        """Return how many documents were not taken since start, by kind and reason."""
        with self._offering:
            fine = (Offered.TAKEN.value, Offered.SAME.value, Offered.OLD.value)
            return {what: count for what, count in self._counts.items() if not what.endswith(fine)}

    def resume(self, floors: Floors, time_floor_ms: int) -> None:
        """Take in what the log remembers, before anything is judged, and record where the disk differs from it."""
        held = self._held
        found = _floors_of(held)
        self._clock.restore_floor(time_floor_ms)
        known = floors.lists.get(held.revocations.key_id)
        if known != found.lists[held.revocations.key_id]:
            self._put(_list_taken(held.revocations), _as_it_is)
        if found.root.version != floors.root.version:
            self._put(_root_taken(held.trust), _as_it_is)
        if found.epoch_id > floors.epoch_id:
            self._put(_epoch_taken(held.epochs[found.epoch_id]), _as_it_is)
        self._floors = _higher(found, floors)
        if floors.epoch_id > found.epoch_id:
            self._ask("epoch")
        if self._is_behind():
            self._ask("revocations")

    @property
    def settled(self) -> bool:
        """Whether everything that was offered to the log is durable and in force."""
        return not self._waiting

    def recorded(self, message: Message) -> None:
        """Put into force what is durable now."""
        with self._lock:
            for index, (waiting, change) in enumerate(self._waiting):
                if waiting == message:
                    del self._waiting[index]
                    self._held = change(self._held)
                    return

    def heard(self, heard: Heard) -> None:
        """Take in what an authenticated header says: whoever knows of something newer makes the book ask for it."""
        held = self._held
        self._clock.raise_floor(heard.token_not_before_ms, "token")
        if heard.revocation_version > held.revocations.version:
            self._ask("revocations")
        if heard.epoch_id not in held.epochs and heard.epoch_id >= self._floors.epoch_id:
            self._ask("epoch")

    def turn(self) -> None:
        """Do what is due by the clock: ask for time and lists, let go of keys, record what was learned."""
        challenge = self._clock.ask()
        if challenge is not None:
            self._fetch.request("time", challenge)
        if self.overdue_ms() or self._is_behind():
            self._ask("revocations")
        with self._offering:
            self._let_go_of_epochs()
        self._owed.extend(self._clock.news())
        while self._owed and self._record(self._owed[0]):
            self._owed.popleft()

    def _take_revocations(self, data: bytes) -> Offered:
        judged = judge_revocations(data, self._held, self._floors)
        if isinstance(judged, Refused):
            return self._refuse(judged)
        kept.keep_revocations(self._held.folder, data)
        taken = self._put(_list_taken(judged), lambda held: replace(held, revocations=judged))
        if taken is Offered.TAKEN:
            lists = {**self._floors.lists, judged.key_id: Known(judged.version, judged.digest)}
            self._floors = replace(self._floors, lists=lists)
            self._clock.raise_floor(judged.issued_at_ms, "document")
        return taken

    def _take_epoch(self, data: bytes) -> Offered:
        judged = judge_epoch(data, self._held, self._floors)
        if isinstance(judged, Refused):
            return self._refuse(judged)
        kept.keep_epoch(self._held.folder, judged.epoch_id, data)
        taken = self._put(_epoch_taken(judged), lambda held: _with_epoch(held, judged))
        if taken is Offered.TAKEN:
            self._floors = replace(self._floors, epoch_id=judged.epoch_id)
            if judged.min_revocation_version > self._held.revocations.version:
                self._ask("revocations")
        return taken

    def _take_root(self, data: bytes) -> Offered:
        judged = judge_root(data, self._held, self._floors)
        if isinstance(judged, Refused):
            return self._refuse(judged)
        kept.keep_root(self._held.folder, data)
        taken = self._put(_root_taken(judged), lambda held: replace(held, trust=judged))
        if taken is Offered.TAKEN:
            self._floors = replace(self._floors, root=Known(judged.version, judged.digest))
            self._ask("revocations")
        return taken

    def _take_time(self, data: bytes) -> Offered:
        try:
            beacon = verify_time_beacon(data, self._held.trust)
        except DocumentUnsigned:
            return Offered.UNSIGNED
        except DocumentError:
            return Offered.MALFORMED
        floor_ms = self._clock.floor_ms
        fault = self._clock.hear_beacon(beacon.challenge, beacon.time_ms)
        if fault == "rollback":
            alarm = TrustAlarm(what=fault, document="time", held_version=floor_ms, offered_version=beacon.time_ms)
            return self._refuse(Refused(Offered.ROLLBACK, alarm))
        return _BEACON_FAULTS.get(fault, Offered.TAKEN)

    def _refuse(self, refused: Refused) -> Offered:
        """Record an alarm once, and others not more often than every 10 s: anybody may send old documents around."""
        if refused.alarm is not None:
            said, now_ns = refused.alarm.SerializeToString(deterministic=True), self._clock.mono_ns()
            quiet = self._alarmed is None or now_ns - self._alarmed[0] >= limits.ASK_AGAIN_NS
            if quiet and (self._alarmed is None or self._alarmed[1] != said) and self._record(refused.alarm):
                self._alarmed = (now_ns, said)
        return refused.what

    def _put(self, message: Message, change: Change) -> Offered:
        with self._lock:
            self._waiting.append((message, change))
        if self._record(message):
            return Offered.TAKEN
        with self._lock:
            self._waiting = [each for each in self._waiting if each[1] is not change]
        return Offered.NOT_KEPT

    def _ask(self, what: What) -> None:
        with self._lock:
            now_ns = self._clock.mono_ns()
            asked_ns = self._asked_ns.get(what)
            if asked_ns is not None and now_ns - asked_ns < limits.ASK_AGAIN_NS:
                return
            self._asked_ns[what] = now_ns
        self._fetch.request(what)

    def _is_behind(self) -> bool:
        """Whether a newer list is known to have been held."""
        held = self._held.revocations
        return self._floors.lists.get(held.key_id, NONE).version > held.version

    def _let_go_of_epochs(self) -> None:
        held, time = self._held, self._clock.time()
        newest = max(held.epochs, default=0)
        gone = frozenset(
            epoch.epoch_id
            for epoch in held.epochs.values()
            if epoch.epoch_id != newest and held.is_over(epoch, time.earliest_ms)
        )
        if not gone:
            return
        left = {epoch_id: epoch for epoch_id, epoch in held.epochs.items() if epoch_id not in gone}
        with self._lock:
            self._held = replace(self._held, epochs=left)
        try:
            kept.erase_epochs(held.folder, frozenset(left))
        except OSError:
            self._counts["epoch: not_erased"] += 1


def _as_it_is(held: Identity) -> Identity:
    return held


def _with_epoch(held: Identity, epoch: Epoch) -> Identity:
    newest = sorted({**held.epochs, epoch.epoch_id: epoch}.items())[-EPOCHS_HELD:]
    return replace(held, epochs=dict(newest))


def _floors_of(identity: Identity) -> Floors:
    held = identity.revocations
    return Floors(
        lists={held.key_id: Known(held.version, held.digest)},
        epoch_id=max(identity.epochs, default=0),
        root=Known(identity.trust.version, identity.trust.digest),
    )


def _higher(found: Floors, logged: Floors) -> Floors:
    lists = dict(found.lists)
    for key, known in logged.lists.items():
        if known.version >= lists.get(key, NONE).version:
            lists[key] = known
    root = max(found.root, logged.root, key=lambda known: known.version)
    return Floors(lists, max(found.epoch_id, logged.epoch_id), root)


def _list_taken(held: Revocations) -> RevocationsTaken:
    return RevocationsTaken(
        key_id=held.key_id,
        list_version=held.version,
        digest=held.digest,
        issued_at_ms=held.issued_at_ms,
        next_update_ms=held.next_update_ms,
    )


def _epoch_taken(epoch: Epoch) -> EpochTaken:
    return EpochTaken(epoch_id=epoch.epoch_id, not_before_ms=epoch.not_before_ms, retire_at_ms=epoch.retire_at_ms)


def _root_taken(trust: Trust) -> RootTaken:
    return RootTaken(root_version=trust.version, revoke_key_id=key_id(trust.keys["revoke"]))
