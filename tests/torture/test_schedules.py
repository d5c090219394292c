"""A seeded sample of the schedules, and that they break where a check of the node or of the issuer is missing.

The 10,000 are an area of `python -m tests.torture`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from autopilot.adapters.mesh import orders
from autopilot.ground.ledger import Answer, Ledger, Order, _answer
from autopilot.trust.gate import Gate
from autopilot.trust.tally import Tally
from autopilot.trust.verdict import Opened
from events.records import Record
from events.schema.orders_pb2 import OrderReceived
from events.schema.waypoint_pb2 import CommandAck
from statecharts.charts import command_part
from statecharts.facts import order_key
from statecharts.state import State
from tests.house import REPO
from tests.torture.schedules import SCHEDULES, run
from tests.torture.scheduling import Broken, held

SAMPLE = 200
MUTANTS_WITHIN = 300  # schedules in which a missing check shows


def test_ten_thousand_schedules_of_a_relay_were_run() -> None:
    """If this fails: `python -m tests.torture schedules` (some minutes), and commit its result."""
    result = json.loads((REPO / "tests/torture/results/schedules.json").read_text("utf-8"))
    assert result["schedules"] == SCHEDULES == 10_000
    assert (result["performed_twice"], result["older_after_newer"], result["false_accepted"]) == (0, 0, 0)


def test_what_a_relay_delays_reorders_and_doubles_is_performed_once_and_never_falsely_accepted() -> None:
    """Two hundred schedules; in them everything that a relay can do has happened."""
    found = run(SAMPLE, 1, lambda _: None)
    assert found["schedules"] == SAMPLE
    assert found["orders"] > found["performed"] > SAMPLE / 2
    assert set(found["shown_by_the_issuers"]) == {"accepted", "rejected", "timeout", "no answer"}
    assert {"replay", "clock_stale"} <= set(found["dropped_by_the_node"])


def check_breaks(what: str) -> None:
    """With a check missing some schedule does not hold, and says what."""
    assert any(re.search(what, broken(seed)) for seed in range(1, MUTANTS_WITHIN + 1))


def broken(seed: int) -> str:
    """Return what does not hold in a schedule, nothing where all does."""
    try:
        held(seed)
    except Broken as error:
        return str(error)
    return ""


def forgetful(*, dedup: bool, sequence: bool) -> Callable[[State, Record], Any]:
    """Return how orders arrive at a node that forgets what it did, or which number it had."""
    arrived = command_part._arrived

    def arrive(state: State, record: Record) -> Any:
        received, arrival = record.message, state.arrival.value
        assert isinstance(received, OrderReceived)
        assert arrival is not None
        key = order_key(received.issuer.principal_id, received.command_id)
        if dedup:
            state.orders.put(key, state.orders[key]._replace(state="received"))
        if sequence:
            state.arrival.set(replace(arrival, newest_seq=0))
        return arrived(state, record)

    return arrive


@pytest.mark.parametrize(
    ("dedup", "sequence", "what"),
    [(True, False, "4: .* was said to be"), (False, True, "2: in the order"), (True, True, "1: no order is performed")],
)
def test_a_node_without_dedup_or_sequence_breaks_them(
    monkeypatch: pytest.MonkeyPatch, dedup: bool, sequence: bool, what: str
) -> None:
    """The number alone keeps an order from being performed twice, and not from being told to be refused."""
    monkeypatch.setattr(command_part, "_arrived", forgetful(dedup=dedup, sequence=sequence))
    check_breaks(what)


def test_a_node_that_lets_anything_be_fresh_breaks_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the gate's clock, and with a life that begins when it arrives."""

    def lively(opened: Opened[orders.Order]) -> OrderReceived:
        return orders.order_received(
            replace(opened, message=replace(opened.message, life_ms=10_000, nonce_life_ms=45_000))
        )

    monkeypatch.setattr(Gate, "_check_clock", lambda *_: None)
    monkeypatch.setattr("autopilot.adapters.mesh.adapter.order_received", lively)
    check_breaks("3: not after its life")


def test_a_node_that_miscounts_breaks_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Tally, "balances", lambda tally: tally.received == tally.opened + tally.malformed)
    check_breaks("8: every sample")


def test_an_issuer_that_does_not_ask_what_an_answer_answers_breaks_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the order's id alone, the answer to another operator's order of that id is taken for its own."""

    def believe(self: Ledger, _message: object, ack: CommandAck) -> str:
        for order in {id(one): one for one in self._by_envelope.values()}.values():
            if order.command_id == ack.command_id:
                self._settle(order, _answer(ack))
        return ""

    monkeypatch.setattr(Ledger, "believe", believe)
    check_breaks("5: accepted is shown, .* was said")


def test_an_issuer_that_takes_every_answer_for_the_last_breaks_them(monkeypatch: pytest.MonkeyPatch) -> None:
    def settle(self: Ledger, order: Order, answer: Answer) -> None:
        if answer.state == "final":
            self._settled(order, answer)
        order.answer = answer

    monkeypatch.setattr(Ledger, "_settle", settle)
    check_breaks("6: ")


def test_an_issuer_that_takes_silence_for_consent_breaks_them(monkeypatch: pytest.MonkeyPatch) -> None:
    overdue = Ledger.overdue

    def consent(self: Ledger, now_mono_ns: int) -> list[Order]:
        found = overdue(self, now_mono_ns)
        for order in found:
            self._settle(order, Answer(state="final", result="accepted"))
        return found

    monkeypatch.setattr(Ledger, "overdue", consent)
    check_breaks("5: accepted is shown")
