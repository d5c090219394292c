"""Watching a node: when it is asked and asked again, what is cosigned and when, and what is told."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from autopilot.cli.witness import words
from autopilot.ground.issuer import Issuer
from autopilot.ground.watching import Watch
from autopilot.trust.cosignatures import check_cosignature, parted
from autopilot.trust.envelope import MessageType
from autopilot.trust.gate import Gate
from autopilot.trust.verdict import Opened
from autopilot.wire.keys import cosign_key, proof_key, status_key
from events.schema.waypoint_pb2 import CheckpointCosignature, NodeStatus
from tests.autopilot.ground.logs import NODE, Log
from tests.autopilot.trust.world import ISSUERS, FakeClock, FakeWire, Forge, people, seeded

LOG = Log()


class World:
    """Alice, who watches wasp-01 over a fake wire."""

    def __init__(self, folder: Path, *, cosigns: bool = True) -> None:
        self.clock, self.wire, self.seq = FakeClock(), FakeWire(), 0
        self.alice = replace(people().alice, folder=folder, known_nodes={})
        self.issuer = Issuer(self.alice, wire=self.wire, clock=self.clock, random=seeded(9))
        self.watch = Watch(self.issuer, self.alice, NODE, self.clock, cosigns=cosigns)
        self.issuer.watch(NODE)
        self.answer: Callable[[bytes], bytes] | None = LOG.answer
        self.wire.ask = self._ask  # type: ignore[method-assign]

    def _ask(self, key_expr: str, question: bytes, timeout_s: float) -> list[bytes]:
        self.wire.asked.append((key_expr, question))
        return [b"somebody else's", *([] if self.answer is None else [self.answer(question)])]

    def hear(self, log: Log, size: int, cosigned_size: int = 0, after_ms: int = 1000) -> None:
        """Let the node publish, and watch."""
        self.clock.now_ms += after_ms
        self.seq += 1
        status = log.status(size, self.clock.now_ms)
        if cosigned_size:
            status.cosigned_size, status.cosigned_by = cosigned_size, "bob"
        self.wire.subscriptions[status_key(NODE)](status_key(NODE), self._envelope(status))
        self.watch.turn()

    def _envelope(self, status: NodeStatus) -> bytes:
        return Forge(
            people().wasp,
            MessageType.STATUS,
            status_key(NODE),
            status.SerializeToString(),
            seq=self.seq,
            issued_at_ms=self.clock.now_ms,
        ).envelope()

    def cosigned(self) -> list[int]:
        """Return the sizes that Alice cosigned, each of which a node's gate lets in."""
        gate: Gate[bytes] = Gate(
            people().wasp,
            MessageType.COSIGNATURE,
            kinds=ISSUERS,
            is_ours=lambda _: True,
            reader=lambda _, content: content,
            clock=FakeClock(self.clock.now_ms),
        )
        sizes = []
        for key, payload, urgent in self.wire.puts:
            verdict = gate.judge(key, payload)
            assert (key, urgent, isinstance(verdict, Opened)) == (cosign_key(NODE), False, True)
            assert isinstance(verdict, Opened)
            text, _, (line,) = parted(CheckpointCosignature.FromString(verdict.content).checkpoint)
            check_cosignature(text, line, "waypoint/coast-watch/alice", self.alice.public_key)
            sizes.append(int(text.split("\n")[1]))
        self.wire.puts.clear()
        return sizes


@pytest.fixture
def world(tmp_path: Path) -> World:
    return World(tmp_path)


def check_standing(world: World, proven: int, heard: int) -> None:
    """Check what is shown."""
    found = world.issuer.witness.standing(NODE, people().wasp.public_key)
    assert found is not None
    assert (found.proven_size, found.heard_size) == (proven, heard)


def test_what_is_proven_is_cosigned(world: World) -> None:
    """The first as it is heard, the next once proven; somebody else's answer beside the node's does no harm."""
    world.watch.turn()
    world.hear(LOG, 5)
    assert (world.wire.asked, world.cosigned()) == ([], [5])
    world.hear(LOG, 9, cosigned_size=5)
    check_standing(world, 9, 9)
    assert [key for key, _ in world.wire.asked] == [proof_key(NODE)]
    assert world.cosigned() == []  # not more often than once a minute
    world.hear(LOG, 12, cosigned_size=5, after_ms=60_000)
    assert world.cosigned() == [12]


def test_a_cosignature_that_was_lost_is_sent_again(world: World) -> None:
    """Until the node shows one over as many records."""
    world.hear(LOG, 5)
    assert world.cosigned() == [5]
    world.hear(LOG, 5, after_ms=60_000)
    assert world.cosigned() == [5]
    world.hear(LOG, 5, cosigned_size=5, after_ms=60_000)
    assert world.cosigned() == []


def test_another_witness_does_not_silence_this_one(world: World) -> None:
    """Two eyes see more."""
    world.hear(LOG, 5, cosigned_size=5)
    assert world.cosigned() == [5]


def test_what_is_not_proven_is_asked_for_again_and_never_cosigned(world: World) -> None:
    """Not more often than every two seconds; and all at once when the answers come."""
    world.answer = None
    world.hear(LOG, 5)
    world.cosigned()
    for size in (7, 9, 12):
        world.hear(LOG, size, cosigned_size=5, after_ms=1000)
    assert (len(world.wire.asked), world.watch.unanswered, world.cosigned()) == (2, 2, [])
    world.hear(LOG, 13, cosigned_size=5, after_ms=60_000)
    assert (world.watch.unanswered, world.cosigned()) == (3, [])
    check_standing(world, 5, 13)
    world.answer = LOG.answer
    world.hear(LOG, 13, cosigned_size=5, after_ms=2000)
    check_standing(world, 13, 13)
    assert (world.watch.unanswered, world.cosigned()) == (0, [13])


def test_a_fork_is_told_and_not_cosigned(world: World) -> None:
    """The complaint stays."""
    fork = Log(salt="fork", forked_at=2)
    world.hear(LOG, 5)
    world.cosigned()
    world.answer = fork.answer
    world.hear(fork, 9, cosigned_size=5, after_ms=60_000)
    assert "do not begin with the 5" in world.issuer.complaints()[NODE]
    assert (world.watch.unanswered, world.cosigned()) == (0, [])


def test_a_flight_that_is_over_is_not_cosigned(world: World, tmp_path: Path) -> None:
    """The node's newest status is about another one than what is kept."""
    world.hear(LOG, 5)
    world.cosigned()
    following = Log(flight=4, flight_id=2).status(3, world.clock.now_ms + 1)
    following.ClearField("log_checkpoint")
    world.seq += 1
    world.clock.now_ms += 60_000
    following.at_ms = world.clock.now_ms
    world.wire.subscriptions[status_key(NODE)](status_key(NODE), world._envelope(following))
    world.watch.turn()
    assert world.cosigned() == []


def test_who_only_watches_signs_nothing(tmp_path: Path) -> None:
    world = World(tmp_path, cosigns=False)
    world.hear(LOG, 5)
    world.hear(LOG, 9)
    check_standing(world, 9, 9)
    assert world.cosigned() == []


def test_a_link_that_is_down_loses_a_cosignature(world: World) -> None:
    """It is sent again."""
    world.wire.refuses = True
    world.hear(LOG, 5)
    world.wire.refuses = False
    world.hear(LOG, 5, after_ms=60_000)
    assert world.cosigned() == [5]


def test_the_words() -> None:
    """What is shown of a node in a line."""
    standing = {"flight_number": 3, "proven_size": 5, "heard_size": 9, "waiting_since_ms": None}
    now = {"node": NODE, "standing": standing, "unanswered": 0, "cosigned_size": 5, "cosigned_by": "alice", "wrong": ""}
    assert words(now) == "wasp-01: flight 3: log proven up to 5 records; 5 cosigned by alice"
    waits = now | {"standing": standing | {"waiting_since_ms": 1}, "unanswered": 2, "cosigned_by": ""}
    assert words(waits).endswith("proven up to 5 records; 9 heard, not proven yet, asked 2 times in vain")
    assert words(now | {"standing": None, "cosigned_by": "", "wrong": "odd"}) == (
        "wasp-01: CONTRADICTS what it signed before: odd; nothing signed was heard"
    )
