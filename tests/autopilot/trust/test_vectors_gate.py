"""The gate against the published vectors: each negative ends in the counter that it names, the positives open."""

from __future__ import annotations

from typing import Any

import pytest

from autopilot.trust.tally import REASONS
from autopilot.trust.verdict import Opened, Rejected
from events.schema.waypoint_pb2 import AuthEnvelope, EnvelopeHeader
from tests.house import REPO
from tests.vectors import independent, make, negatives, page
from tests.vectors.independent import NotCanonical
from tests.vectors.receiving import FOLDER, gate, published

CASES: list[dict[str, Any]] = published("negative")["cases"]
POSITIVE = published("positive")
UNREACHED = {"internal"}  # what nobody foresaw: whoever finds a vector for it has found a defect


def check_counted(case: dict[str, Any]) -> None:
    """One envelope, one counter, and it alone moves."""
    judging = gate(case)
    before = judging.tally()
    assert judging.judge(case["key_expr"], bytes.fromhex(case["envelope"])) == Rejected(case["counter"])
    after = judging.tally()
    before.received, before.rejected[case["counter"]] = before.received + 1, before.rejected[case["counter"]] + 1
    assert after == before
    assert after.balances()
    assert after.opened == len(case.get("before", ()))


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case['counter']}: {case['name']}")
def test_each_negative_ends_in_its_counter(case: dict[str, Any]) -> None:
    check_counted(case)


def test_each_counter_has_a_vector() -> None:
    assert {case["counter"] for case in CASES} == set(REASONS) - UNREACHED


def test_each_vector_is_there_once() -> None:
    assert len({(case["counter"], case["name"]) for case in CASES}) == len(CASES) == 99


@pytest.mark.parametrize(("name", "receiver"), [("order", "wasp-01"), ("ack", "alice"), ("presence", "wasp-01")])
def test_the_positives_open(name: str, receiver: str) -> None:
    message = POSITIVE["messages"][name]
    verdict = gate({"gate": name, "receiver": receiver}).judge(message["key_expr"], bytes.fromhex(message["envelope"]))
    assert isinstance(verdict, Opened)
    assert (verdict.content.hex(), verdict.message.sender.principal_id) == (message["content"], message["sender"])
    assert verdict.message.digest.hex() == message["digest"]
    assert verdict.message.in_reply_to.hex() == message["in_reply_to"]


def test_a_receiver_without_anything_unusual_opens_what_the_negatives_replay() -> None:
    """So it is the receiver's knowledge that rejects it, and nothing else about the envelope."""
    unusual = (
        "uncertain",
        "forgotten",
        "epoch_needs_list",
        "revocations",
        "epoch_ms",
        "nonces_held",
        "before",
        "burst",
    )
    plain = [case for case in CASES if set(case) & set(unusual)]
    assert len(plain) == 15
    for case in plain:
        judging = gate({})
        assert isinstance(judging.judge(case["key_expr"], bytes.fromhex(case["envelope"])), Opened)


def test_the_seven_encodings_are_one_header_to_a_lenient_reader() -> None:
    """Only strictness tells them apart: the parser of protobuf takes all of them, our second reading none."""
    cases = {case["name"]: case for case in CASES if case["counter"] == "noncanonical_hdr"}
    assert set(cases) == set(negatives.REENCODINGS)
    assert len(cases) == 7
    for case in cases.values():
        encoded = AuthEnvelope.FromString(bytes.fromhex(case["envelope"])).header
        parsed = EnvelopeHeader.FromString(encoded)
        parsed.DiscardUnknownFields()
        assert (parsed.type, parsed.key_expr, parsed.issued_at_ms) == (1, case["key_expr"], POSITIVE["now_ms"])
        with pytest.raises(NotCanonical):
            independent.header_fields(encoded)


@pytest.mark.parametrize("name", ["positive", "negative"])
def test_the_published_files_are_what_the_script_makes(name: str) -> None:
    """If this fails: `python -m tests.vectors.make`, and say why the bytes changed."""
    made = {"positive": make.positive_file, "negative": make.negative_file}[name]()
    assert (FOLDER / f"{name}.json").read_text("utf-8") == make.text_of(made)


def test_the_worked_example_of_the_page_is_the_published_order() -> None:
    """If this fails: `python -m tests.vectors.make`."""
    text = (REPO / "docs/envelope.md").read_text("utf-8")
    assert page.with_example(text, POSITIVE) == text
    shown = "".join(
        line.split()[1] for line in text.partition("(`AuthEnvelope`)")[2].split("```")[1].splitlines() if line
    )
    assert shown == POSITIVE["messages"]["order"]["envelope"]
