"""The door for questions about the log: what is passed on, what is dropped and counted, and how answers look."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import pytest

from autopilot.adapters.mesh import MeshAdapter
from autopilot.adapters.mesh.link import ANSWER_BYTES_MAX
from autopilot.adapters.mesh.witnesses import PROOFS_BURST
from autopilot.ports.config import MeshSection
from autopilot.ports.edges import Consistency
from autopilot.wire.keys import proof_key
from events.schema.waypoint_pb2 import ConsistencyAnswer, ConsistencyRequest
from tests.autopilot.trust.world import FakeClock, FakeWire, people

PROOF = Consistency(b"r" * 32, (b"a" * 32, b"b" * 32))


def question(**values: int) -> bytes:
    """Return a question about flight 3, from 5 to 9 records, with changes."""
    asked = {"flight_number": 3, "old_size": 5, "new_size": 9} | values
    return ConsistencyRequest(**asked).SerializeToString()


@dataclass
class Node:
    """A node whose prover answers as it is told, at once."""

    has_room: bool = True
    finds: Consistency | None = PROOF
    asked: list[tuple[int, int, int]] = field(default_factory=list)
    answers: list[bytes] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.clock, self.wire = FakeClock(), FakeWire()
        self.adapter = MeshAdapter(
            MeshSection(), people().wasp, self.clock, lambda *_: None, lambda *_: True, wire=self.wire, proving=self
        )
        self.adapter.start()

    def ask(
        self, flight_number: int, old_size: int, new_size: int, reply: Callable[[Consistency | None], None]
    ) -> bool:
        """Answer at once, or have no room."""
        if self.has_room:
            self.asked.append((flight_number, old_size, new_size))
            reply(self.finds)
        return self.has_room

    def receive(self, payload: bytes) -> None:
        """Let a question come in."""
        self.wire.answerers[proof_key("wasp-01")](payload, self.answers.append)


def check_dropped(node: Node, payload: bytes, because: str) -> None:
    """Check that a question is not answered, and counted by this name, once."""
    node.receive(payload)
    assert node.adapter.take_rejections() == {f"proof: {because}": 1}
    assert (node.answers, node.adapter.take_rejections()) == ([], {})


def test_a_question_is_answered() -> None:
    """With what the prover found, and with what was asked."""
    node = Node()
    node.receive(question())
    (answer,) = node.answers
    said = ConsistencyAnswer.FromString(answer)
    assert node.asked == [(3, 5, 9)]
    assert (said.flight_number, said.old_size, said.new_size) == (3, 5, 9)
    assert (said.old_root, tuple(said.path)) == PROOF
    assert node.adapter.take_rejections() == {}


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"\xff\xff",
        question() + b"\x00",
        question(old_size=0),
        ConsistencyRequest(flight_number=3, new_size=9).SerializeToString(),
        question(old_size=9),
        question(old_size=10),
        question(new_size=0),
        question() + question(),
    ],
)
def test_a_question_that_is_none_is_dropped(payload: bytes) -> None:
    """Before anybody works on it."""
    node = Node()
    check_dropped(node, payload, "unreadable")
    assert node.asked == []


def test_what_can_not_be_answered_is_named() -> None:
    """A log that is not there, a prover that has enough to do, a question too long."""
    check_dropped(Node(finds=None), question(), "no such log")
    check_dropped(Node(has_room=False), question(), "busy")
    check_dropped(Node(), b"\x08\x01" * 40, "size")


def test_a_flood_is_cut_and_passes() -> None:
    """A burst, then two a second."""
    node = Node()
    for _ in range(1000):
        node.receive(question())
    assert len(node.answers) == PROOFS_BURST
    assert node.adapter.take_rejections() == {"proof: rate": 1000 - PROOFS_BURST}
    node.clock.now_ms += 1000
    for _ in range(5):
        node.receive(question())
    assert len(node.answers) == PROOFS_BURST + 2


def test_the_longest_answer_is_short_enough() -> None:
    """64 hashes: one for each bit of a size of 63 bits, and one."""
    node = Node(finds=Consistency(b"r" * 32, (b"a" * 32,) * 64))
    node.receive(question(flight_number=1 << 31, old_size=(1 << 62) - 1, new_size=1 << 62))
    assert len(node.answers[0]) < ANSWER_BYTES_MAX


def test_without_a_prover_there_is_no_door() -> None:
    """Nothing is declared that nobody answers."""
    wire = FakeWire()
    MeshAdapter(MeshSection(), people().wasp, FakeClock(), lambda *_: None, lambda *_: True, wire=wire).start()
    assert (wire.answerers, list(wire.subscriptions)) == ({}, ["waypoint/global/cmd/wasp-01/**"])
