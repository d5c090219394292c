"""The published negatives through a whole mesh adapter: what the gate drops before it opens is answered by nothing."""

from __future__ import annotations

from typing import Any

import pytest
from google.protobuf.message import Message

from autopilot.adapters.mesh import MeshAdapter
from autopilot.adapters.mesh.orders import read_order
from autopilot.ports.config import MeshSection
from autopilot.ports.edges import InputClass
from autopilot.wire.keys import orders_of, presences_of
from events.schema.common_pb2 import Place
from tests.autopilot.trust.world import FakeClock, FakeWire, people
from tests.vectors.receiving import gate, published

CASES: list[dict[str, Any]] = [case for case in published("negative")["cases"] if case.get("gate") != "ack"]


class Node:
    """A mesh adapter with the gate that a vector speaks of, over a wire that remembers what is put on it."""

    def __init__(self, case: dict[str, Any]) -> None:
        self.offered: list[Message] = []
        self.wire = FakeWire()
        self.adapter = MeshAdapter(
            MeshSection(),
            people().wasp,
            FakeClock(published("negative")["now_ms"]),
            lambda *_: None,
            self.offer,
            wire=self.wire,
            attending=("operator",),
        )
        self.adapter.start()
        self.judging = gate(case)
        judged: Any = self.adapter._presence if case.get("gate") == "presence" else self.adapter
        judged._gate = self.judging

    def offer(self, input_class: InputClass, observation: Message) -> bool:
        """Take it."""
        del input_class
        self.offered.append(observation)
        return True

    def receive(self, case: dict[str, Any]) -> None:
        """Let the sample come in, as whoever listens on this kind of key hears it."""
        subscription = presences_of("wasp-01") if case.get("gate") == "presence" else orders_of("wasp-01")
        self.wire.subscriptions[subscription](case["key_expr"], bytes.fromhex(case["envelope"]))


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case['counter']}: {case['name']}")
def test_no_negative_is_answered_or_offered(case: dict[str, Any]) -> None:
    """Not a byte leaves, nothing reaches the node, nobody is heard; it is counted, also for the log."""
    node = Node(case)
    before = node.judging.tally()
    node.receive(case)
    while node.adapter._outbox.turn():
        pass
    node.adapter.stop()
    assert (node.offered, node.wire.puts) == ([], [])
    after = node.judging.tally()
    assert after.received == before.received + 1
    assert after.rejected[case["counter"]] == before.rejected[case["counter"]] + 1
    prefix = "presence: " if case.get("gate") == "presence" else ""
    assert node.adapter.take_rejections()[prefix + case["counter"]] >= 1


def test_all_but_the_acks_are_here() -> None:
    """An ack is the ground's to judge."""
    assert len(published("negative")["cases"]) - len(CASES) == 1
    assert {case.get("gate", "order") for case in CASES} == {"order", "presence"}


def test_a_whole_one_is_offered_and_answered_when_it_is_refused() -> None:
    """So a negative that was answered would be seen here."""
    made = published("positive")["messages"]["order"]
    case = {"key_expr": made["key_expr"], "envelope": made["envelope"]}
    node = Node(case)
    node.adapter._offer = lambda *_: False
    reading: Any = node.judging
    reading._reader = lambda message, content: read_order(message, content, lambda *_: Place())
    node.receive(case)
    node.adapter.stop()
    assert [key for key, _, _ in node.wire.puts] == [made["key_expr"].replace("/cmd/", "/ack/")]
