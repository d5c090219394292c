"""A relay that delays, reorders, doubles and drops by seed, between real issuers and a real node; no socket, no thread.

    held(1) -> Seen                         one schedule; raises Broken with its seed

The issuers are `autopilot.ground.issuer` with their stores in memory. The node is the mesh adapter (gate, packer,
outbox) over the charts and the log in memory; its vehicle is a stub that answers as the seed has it. Time is a number
that goes from one event to the next. What must hold in each schedule:

1.  no order is performed twice
2.  orders of one device are performed in the order of their numbers: an older one never undoes a newer one
3.  an order is performed as it was given, and not after its life
4.  what the node says finally of an order never changes
5.  an issuer shows "accepted" for nothing but what the node accepted, and no last word but the node's
6.  a last word never changes, and nobody who was told more is told less
7.  where nothing comes back the issuer shows no answer: its audit row says "unanswered", and no row says "final"
8.  the node counts: received = opened + malformed + every reject, and that is what was delivered
"""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import NamedTuple

import apsw

from autopilot.ground import issued
from autopilot.ground.compose import point_at_angles
from autopilot.ground.issuer import Issuer
from autopilot.ground.ledger import Answer, Order
from autopilot.trust.identity import Identity, load_identity
from autopilot.trust.limits import SKEW_MS
from statecharts.facts import order_key
from tests.autopilot.trust.world import NOW_MS, FakeClock, people, seeded
from tests.flights import NS_PER_MS
from tests.torture.relayed import Events, Node, RelayedWire, Skewed

NODE = "wasp-01"
STATES, STAGES = ("waiting", "pending", "final"), ("", "received", "sent", "in progress")
_FOLDER = TemporaryDirectory(prefix="schedules-")  # removed when the interpreter ends


class Broken(AssertionError):
    """A schedule in which something did not hold."""


class Seen(NamedTuple):
    """What happened in one schedule."""

    orders: int
    delivered: int
    performed: int
    results: Counter[str]  # what the issuers show at the end: a result, or "no answer"
    rejected: Counter[str]  # by the node's gate


@dataclass(frozen=True, slots=True)
class Way:
    """How a relay treats what goes one way."""

    drops: float
    doubles: float
    delay_ms: int  # at most

    @classmethod
    def by(cls, random: Random) -> Way:
        """Choose: from a relay that does nothing to one that lets nothing through, up to a minute late."""
        return cls(
            random.choice((0, 0, 0, 0.2, 0.5, 0.9, 1)),
            random.choice((0, 0.3, 0.8)),
            random.choice((0, 50, 900, 4_000, 15_000, 60_000)),
        )


class InMemory(issued.IssuedStore):
    """The issuer's store with its own statements, and without a disk."""

    def _open(self) -> apsw.Connection:
        connection = apsw.Connection(":memory:")
        connection.execute(issued._SCHEMA)
        return connection


@dataclass(eq=False, slots=True)
class Given:
    """An order that somebody gave."""

    who: str
    order: Order
    yaw_cdeg: int
    ends_ms: int
    row: int
    shown: list[Answer] = field(default_factory=list)


class Schedule:
    """One run of the world by a seed."""

    def __init__(self, seed: int) -> None:
        self.random = Random(seed)
        self.clock = FakeClock()
        self.events = Events(self.clock)
        self.to_node, self.from_node = Way.by(self.random), Way.by(self.random)
        skewed = Skewed(world=self.clock, off_ms=self.random.choice((0, 0, -4_000, 4_000)))
        self.node = Node(self.events, skewed, self._outward, self.random)
        # In some schedules two operators draw the same numbers, and so give the same id to different orders.
        alike = self.random.random() < 0.3
        self.issuers = {who: self._issuer(who, 7 if alike else number) for number, who in enumerate(("alice", "bob"))}
        self.given: list[Given] = []
        self.heard = Counter[str]()  # acks that reached an issuer
        self.rows: dict[str, tuple[issued.AuditRow, ...]] = {}

    def run(self) -> Seen:
        """Let it happen; raise Broken where something does not hold."""
        for number in range(self.random.randint(1, 4)):
            self.events.after(self.random.choice((0, 100, 2_000, 9_000)) * number, self._give)
        self.events.run(self._watch)
        self.rows = {who: each.history() for who, each in self.issuers.items()}
        for each in self.issuers.values():
            each._store.close()
        return self._held()

    def _issuer(self, who: str, seed: int) -> Issuer:
        made = Issuer(_identity(who), clock=self.clock, wire=RelayedWire(self._inward), random=seeded(seed))
        made._store = InMemory(made._identity.folder)
        made.watch(NODE)
        return made

    def _give(self) -> None:
        who, life_s = self.random.choice(("alice", "bob")), self.random.choice((1, 3, 10, 20))
        yaw_cdeg = 100 * (len(self.given) + 1)
        order = self.issuers[who].send(NODE, point_at_angles(-10, yaw_cdeg / 100), life_s)
        self._note(who, order, yaw_cdeg, life_s)
        if self.random.random() < 0.3:
            after_ms = self.random.choice((500, 5_000, 25_000))
            self.events.after(after_ms, lambda: self._repeat(who, order, yaw_cdeg, life_s))

    def _repeat(self, who: str, order: Order, yaw_cdeg: int, life_s: int) -> None:
        self._note(who, self.issuers[who].repeat(order, life_s), yaw_cdeg, life_s)

    def _note(self, who: str, order: Order, yaw_cdeg: int, life_s: int) -> None:
        self.given.append(Given(who, order, yaw_cdeg, self.clock.now_ms + life_s * 1000, order.row))
        self._turn(who)

    def _turn(self, who: str) -> None:
        """Let an issuer do what is due, and again when it says."""
        issuer = self.issuers[who]
        issuer.turn()
        due_ns = issuer._ledger.next_due()
        if due_ns is not None:
            self.events.after(-(-(due_ns - self.clock.mono_ns()) // NS_PER_MS), lambda: self._turn(who))

    def _inward(self, key_expr: str, payload: bytes) -> None:
        self._carry(self.to_node, lambda: self.node.receive(key_expr, payload))

    def _outward(self, key_expr: str, payload: bytes) -> None:
        for who in self.issuers:
            self._carry(self.from_node, lambda who=who: self._answer(who, key_expr, payload))  # type: ignore[misc]

    def _answer(self, who: str, key_expr: str, payload: bytes) -> None:
        self.heard[who] += 1
        self.issuers[who].receive_ack(key_expr, payload)

    def _carry(self, way: Way, deliver: Callable[[], None]) -> None:
        """Be the relay: drop it, or deliver it once or more, each copy in its own time."""
        if self.random.random() < way.drops:
            return
        copies = 1 + (self.random.randrange(1, 4) if self.random.random() < way.doubles else 0)
        for _ in range(copies):
            self.events.after(self.random.randint(0, way.delay_ms), deliver)

    def _watch(self) -> None:
        """See what the issuers show now."""
        for each in self.given:
            if not each.shown or each.order.answer is not each.shown[-1]:
                each.shown.append(each.order.answer)

    def _held(self) -> Seen:
        self._check_node()
        for each in self.given:
            self._check_shown(each)
        tally = self.node.adapter.tally()
        _hold(tally.balances() and tally.received == self.node.delivered, "8: every sample is counted once")
        return Seen(
            len({order_key(each.who, each.order.command_id) for each in self.given}),
            self.node.delivered,
            len(self.node.performed),
            Counter(each.order.answer.result if each.order.is_done else "no answer" for each in self.given),
            Counter({reason: count for reason, count in tally.rejected.items() if count}),
        )

    def _check_node(self) -> None:
        asked: dict[str, list[Given]] = {}
        for each in self.given:
            asked.setdefault(order_key(each.who, each.order.command_id), []).append(each)
        done = [effect.order for _, effect in self.node.performed]
        _hold(max(Counter(done).values(), default=1) == 1, "1: no order is performed twice")
        for who in self.issuers:
            numbers = [asked[key][0].order.order_seq for key in done if asked[key][0].who == who]
            _hold(numbers == sorted(set(numbers)), "2: in the order of their numbers")
        for at_ms, effect in self.node.performed:
            given = asked[effect.order]
            _hold(effect.yaw_cdeg == given[0].yaw_cdeg, "3: as it was given")
            _hold(at_ms <= max(each.ends_ms for each in given) + SKEW_MS, "3: not after its life")
        for key, finals in self.node.said().items():
            _hold(len(finals) == 1, f"4: {key} was said to be {finals}")

    def _check_shown(self, each: Given) -> None:
        answer = each.order.answer
        key = order_key(each.who, each.order.command_id)
        said = self.node.said().get(key, [])
        if each.order.is_done:
            _hold([answer.result] == said, f"5: {answer.result} is shown, {said} was said")
        if answer.result == "accepted" and each.order.is_done:
            performed = [effect.order for _, effect in self.node.performed]
            _hold(key in performed, "5: what is accepted was performed")
        ranks = [(STATES.index(one.state), STAGES.index(one.stage)) for one in each.shown]
        finals = sum(one.state == "final" for one in each.shown)
        _hold(ranks == sorted(ranks) and finals <= 1, f"6: {each.shown}")
        rows = [row.state for row in self.rows[each.who] if row.of == each.row]
        _hold(rows.count("final") == each.order.is_done, f"6: {rows}")
        if not self.heard[each.who]:
            _hold(rows == ["pending", "unanswered"] and not answer.result, f"7: {rows}, {answer}")
        _hold(each.order.is_done or "unanswered" in rows, f"7: {rows}")


def held(seed: int) -> Seen:
    """Run the schedule of a seed. Raises Broken."""
    try:
        return Schedule(seed).run()
    except AssertionError as error:
        raise Broken(f"schedule {seed}: {error}") from error


def _hold(holds: bool, what: str) -> None:
    if not holds:
        raise Broken(what)


def _identity(who: str) -> Identity:
    """Return somebody's identity in a folder of this process."""
    folder = Path(_FOLDER.name) / who
    if not folder.exists():
        shutil.copytree(getattr(people(), who).folder, folder)
    return load_identity(folder, NOW_MS)
