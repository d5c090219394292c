"""The verifying relay between two links that remember: what goes which way, unchanged, and what is counted."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import pytest

from autopilot.adapters.mesh.link import LinkDown
from autopilot.ground import relay as relay_module
from autopilot.ground.relay import Proofs, Pump, Relay, Sample, node_in
from autopilot.ground.relay_config import VerifySection
from autopilot.ground.relay_papers import Papers
from autopilot.trust.envelope import MessageType
from autopilot.trust.identity import Identity
from autopilot.wire.keys import (
    ACKS,
    COSIGNATURES,
    ORDERS,
    PRESENCE,
    STATUS,
    Channel,
    ack_key,
    cosign_key,
    presence_key,
    proof_key,
    status_key,
)
from events.schema.waypoint_pb2 import EnvelopeHeader, PrincipalKind
from tests.autopilot.ground.relay_desk import Asked
from tests.autopilot.trust.world import COMMAND_ID, KEY, NOW_MS, FakeClock, FakeWire, Forge, people, retokened

WITHIN_S = 10.0
ACK = ack_key("wasp-01", COMMAND_ID)


class Wires:
    """A relay for wasp-01 between two links."""

    def __init__(self, **verify: Any) -> None:
        folder = people().directory.folder
        self.outer, self.inner, self.clock = FakeWire(), FakeWire(), FakeClock()
        config = VerifySection(documents=str(folder), nodes=("wasp-01",), **verify)
        self.relay = Relay(config, Papers(folder, NOW_MS), self.clock, self.outer, self.inner)

    def after(self, *samples: tuple[Channel, str, bytes]) -> dict[str, dict[str, int]]:
        """Start, receive these, stop; return the counts."""
        self.relay.start()
        for channel, key_expr, payload in samples:
            self.relay.receive(channel, key_expr, payload)
        self.relay.stop()
        return self.relay.counts()


def sealed(identity: Identity, message_type: MessageType, key_expr: str, seq: int = 1) -> bytes:
    """Return an envelope."""
    return Forge(identity, message_type, key_expr, seq=seq).envelope()


HERE = presence_key("wasp-01", "alice")
INWARD = [
    (ORDERS, KEY, MessageType.ORDER),
    (COSIGNATURES, cosign_key("wasp-01"), MessageType.COSIGNATURE),
    (PRESENCE, HERE, MessageType.PRESENCE),
]
OUTWARD = [
    (ACKS, ACK, MessageType.ACK),
    (STATUS, status_key("wasp-01"), MessageType.STATUS),
]


@pytest.mark.parametrize(("channel", "key", "message_type"), INWARD)
def test_what_an_operator_signed_goes_inward_as_it_came(channel: Channel, key: str, message_type: MessageType) -> None:
    wires = Wires()
    payload = sealed(people().alice, message_type, key)
    counts = wires.after((channel, key, payload))
    assert wires.inner.puts == [(key, payload, channel is ORDERS)]
    assert wires.outer.puts == []
    assert counts[channel.name] == {"received": 1, "passed": 1}
    assert counts["inward"] == {"relayed": 1, "queue_full": 0, "link_down": 0}


@pytest.mark.parametrize(("channel", "key", "message_type"), OUTWARD)
def test_what_a_node_signed_goes_outward_as_it_came(channel: Channel, key: str, message_type: MessageType) -> None:
    wires = Wires()
    payload = sealed(people().wasp, message_type, key)
    counts = wires.after((channel, key, payload))
    assert wires.outer.puts == [(key, payload, channel is ACKS)]
    assert wires.inner.puts == []
    assert counts["outward"]["relayed"] == 1


@pytest.mark.parametrize(
    ("channel", "key", "message_type", "who", "because"),
    [
        (ORDERS, KEY, MessageType.ORDER, "wasp", "token_kind"),
        (ACKS, ACK, MessageType.ACK, "alice", "token_kind"),
        (ACKS, ACK, MessageType.ACK, "hornet", "owner"),
        (STATUS, status_key("wasp-01"), MessageType.STATUS, "hornet", "owner"),
        (ACKS, ack_key("hornet-02", COMMAND_ID), MessageType.ACK, "hornet", "route"),
        (ORDERS, KEY, MessageType.ACK, "alice", "type"),
        (PRESENCE, HERE, MessageType.PRESENCE, "bob", "owner"),
        (PRESENCE, presence_key("wasp-01", "wasp-01"), MessageType.PRESENCE, "wasp", "token_kind"),
        (PRESENCE, presence_key("hornet-02", "alice"), MessageType.PRESENCE, "alice", "route"),
        (PRESENCE, HERE, MessageType.ORDER, "alice", "type"),
    ],
)
def test_what_is_not_its_senders_to_say_stays(
    channel: Channel, key: str, message_type: MessageType, who: str, because: str
) -> None:
    """A node orders nothing and answers for itself only; an operator answers nothing."""
    wires = Wires()
    counts = wires.after((channel, key, sealed(getattr(people(), who), message_type, key)))
    assert counts[channel.name] == {"received": 1, "passed": 0, because: 1}
    assert (wires.inner.puts, wires.outer.puts) == ([], [])


@pytest.mark.parametrize(
    ("verify", "expected"),
    [
        ({}, {"passed": 1}),
        ({"owners": ("alice",)}, {"passed": 1}),
        ({"owners": ("bob",)}, {"passed": 0, "owner": 1}),
        ({"owners": ()}, {"passed": 0, "owner": 1}),
    ],
)
def test_owners_are_those_that_are_named(verify: dict[str, Any], expected: dict[str, int]) -> None:
    """An empty list is nobody."""
    counts = Wires(**verify).after((ORDERS, KEY, sealed(people().alice, MessageType.ORDER, KEY)))
    assert counts["orders"] == {"received": 1, **expected}


def test_a_service_keeps_no_operators_link_up() -> None:
    """It may cosign; it is nobody who looks."""
    serving = retokened(people().alice, lambda token: setattr(token, "kind", PrincipalKind.SERVICE))
    counts = Wires().after(
        (PRESENCE, HERE, sealed(serving, MessageType.PRESENCE, HERE)),
        (COSIGNATURES, cosign_key("wasp-01"), sealed(serving, MessageType.COSIGNATURE, cosign_key("wasp-01"), 2)),
    )
    assert counts["presence"] == {"received": 1, "passed": 0, "token_kind": 1}
    assert counts["cosignatures"] == {"received": 1, "passed": 1}


def test_owners_are_asked_of_what_goes_inward_only() -> None:
    """A node answers, whoever may order it."""
    counts = Wires(owners=()).after((ACKS, ACK, sealed(people().wasp, MessageType.ACK, ACK)))
    assert counts["acks"] == {"received": 1, "passed": 1}


@pytest.mark.parametrize(("header", "most", "because"), [(0, 0, ""), (1, 1, ""), (2, 1, "classification")])
def test_what_is_classified_too_high_stays(header: int, most: int, because: str) -> None:
    """The relay's bound, beside that of the sender's token."""
    admitted = relay_module._admitted(most, None, ORDERS, EnvelopeHeader(classification=header), people().alice.token)
    assert admitted == because


def test_it_listens_to_what_it_relays_and_to_nothing_else() -> None:
    """Orders and presence outside, answers inside; only of the nodes that are named."""
    wires = Wires()
    wires.after()
    assert sorted(wires.outer.subscriptions) == [
        "waypoint/global/cmd/wasp-01/*",
        "waypoint/global/cosign/wasp-01",
        "waypoint/global/heartbeat/wasp-01/*",
        "waypoint/global/trust/coast-watch/epoch/*",
        "waypoint/global/trust/coast-watch/revocations",
        "waypoint/global/trust/coast-watch/trust_root",
    ]
    assert sorted(wires.inner.subscriptions) == ["waypoint/global/ack/wasp-01/*", "waypoint/global/status/wasp-01"]
    assert list(wires.outer.answerers) == ["waypoint/global/proof/wasp-01"]
    assert sorted(wires.inner.answerers) == [
        "waypoint/global/trust/coast-watch/epoch",
        "waypoint/global/trust/coast-watch/revocations",
        "waypoint/global/trust/coast-watch/time",
        "waypoint/global/trust/coast-watch/trust_root",
    ]


def test_each_device_and_all_together_have_the_rates_that_are_configured() -> None:
    wires = Wires(device_per_s=1, device_burst=2, samples_per_s=3, samples_burst=4)
    samples = [(ORDERS, KEY, sealed(people().alice, MessageType.ORDER, KEY, seq)) for seq in range(1, 6)]
    assert wires.after(*samples)["orders"] == {"received": 5, "passed": 2, "device_rate": 2, "rate": 1}
    wires.clock.now_ms += 1000
    for seq in range(6, 10):
        wires.relay.receive(ORDERS, KEY, sealed(people().alice, MessageType.ORDER, KEY, seq))
    assert wires.relay.counts()["orders"] == {"received": 9, "passed": 3, "device_rate": 4, "rate": 2}


def test_a_dead_link_is_counted() -> None:
    wires = Wires()
    wires.inner.refuses = True
    counts = wires.after((ORDERS, KEY, sealed(people().alice, MessageType.ORDER, KEY)))
    assert counts["inward"] == {"relayed": 0, "queue_full": 0, "link_down": 1}


class StuckWire(FakeWire):
    """A link whose put blocks until it is let go."""

    def __init__(self) -> None:
        super().__init__()
        self.entered, self.go = threading.Event(), threading.Event()

    def put(self, key_expr: str, payload: bytes, *, urgent: bool) -> None:
        """Block, then remember."""
        self.entered.set()
        if not self.go.wait(WITHIN_S):
            raise LinkDown("stuck")
        super().put(key_expr, payload, urgent=urgent)


def test_what_waits_is_bounded() -> None:
    """Behind a link that is stuck no more wait than configured; the rest is counted, and nobody waits for it."""
    wire = StuckWire()
    pump = Pump(wire, waiting=2)
    pump.start()
    for number in range(5):
        pump.offer(Sample(str(number), b"", urgent=False))
        assert wire.entered.wait(WITHIN_S)
    wire.go.set()
    pump.stop()
    assert pump.counts() == {"relayed": 3, "queue_full": 2, "link_down": 0}
    assert [key for key, _, _ in wire.puts] == ["0", "1", "2"]


@pytest.mark.parametrize(
    ("channel", "key", "node"),
    [
        (ORDERS, KEY, "wasp-01"),
        (ORDERS, "waypoint/global/cmd/wasp-01", None),
        (ORDERS, "waypoint/global/cmd/wasp-01/", None),
        (ORDERS, "waypoint/global/cmd//x", None),
        (ORDERS, "waypoint/global/cmd/wasp-01/x/y", None),
        (ORDERS, ACK, None),
        (ORDERS, "waypoint/cell/cmd/wasp-01/x", None),
        (STATUS, "waypoint/global/status/wasp-01", "wasp-01"),
    ],
)
def test_a_key_names_its_node(channel: Channel, key: str, node: str | None) -> None:
    assert node_in(channel, key) == node


def asked(inner: FakeWire, questions: list[bytes]) -> tuple[list[bytes], dict[str, int]]:
    """Ask these of a node through the relay; return what was replied, and the counts."""
    replied: list[bytes] = []
    proofs, reply = Proofs(inner, FakeClock()), replied.append
    proofs.start()
    for question in questions:
        proofs.receive(proof_key("wasp-01"), question, reply)
    proofs.stop()
    return replied, proofs.counts()


def test_a_question_goes_inward_and_the_first_answer_back() -> None:
    inner = FakeWire(answers=[b"first", b"second"])
    replied, counts = asked(inner, [b"question"])
    assert (replied, inner.asked) == ([b"first"], [("waypoint/global/proof/wasp-01", b"question")])
    assert counts == {"asked": 1, "answered": 1, "rate": 0, "size": 0, "queue_full": 0}


def test_a_question_that_nobody_answers_is_not_answered() -> None:
    """Nor does it keep the next one from its answer."""

    class Once(FakeWire):
        def ask(self, key_expr: str, question: bytes, timeout_s: float) -> list[bytes]:
            return [b"answer"] if question == b"second" else []

    replied, counts = asked(Once(), [b"first", b"second"])
    assert (replied, counts["asked"], counts["answered"]) == ([b"answer"], 2, 1)


def test_a_question_for_a_proof_that_nobody_answers_is_let_go_of() -> None:
    """Else its asker waits for as long as it can."""
    proofs, question = Proofs(FakeWire(), FakeClock()), Asked()
    proofs.start()
    proofs.receive(proof_key("wasp-01"), b"?", question.reply())
    assert question.gone.wait(WITHIN_S)
    proofs.stop()


def test_questions_are_bounded_in_size_and_number() -> None:
    """64 bytes; ten at once, then two a second."""
    _, counts = asked(FakeWire(), [b"x" * 65, b"x" * 64] + [b"x"] * 9)
    assert (counts["size"], counts["asked"], counts["rate"]) == (1, 9, 1)


def test_questions_that_wait_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(relay_module, "PROOFS_WAITING", 2)
    proofs = Proofs(FakeWire(), FakeClock())
    for _ in range(3):
        proofs.receive(proof_key("wasp-01"), b"?", lambda _: None)
    assert (proofs.counts()["asked"], proofs.counts()["queue_full"]) == (2, 1)


def test_the_relay_has_no_more_than_public_documents(tmp_path: Path) -> None:
    """Its gates hold the trust root and the list, and no identity."""
    wires = Wires()
    held = [vars(gate) for gate in wires.relay._gates.values()]
    assert [name for one in held for name, value in one.items() if isinstance(value, Identity)] == []
