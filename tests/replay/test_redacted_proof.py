"""Proofs out of redacted copies: every one stands, says what is not there, and can be changed no more than others."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings

from autopilot.ground.verifier import check
from events.chain import salt_of
from events.records import NO_CAUSE
from replay.causes import REMOVED, chain, consequences, line
from replay.proof import prove
from tests.flights import SECRET
from tests.replay.copies import Copy, removals
from tests.replay.test_proof import STORY, changed, check_refused, papers, sealed

SEALED = sealed()


def check_stands(copy: Copy, seq: int, remove: frozenset[int]) -> None:
    """Check the proof of one record, removed or not, with the causes that are still known."""
    proved = check(prove(copy, seq, papers()))
    assert [one.seq for one in proved.records] == [shown.seq for shown in chain(copy, seq)]
    for one in proved.records:
        record, gone = STORY.records[one.seq], one.seq in remove
        body = b"" if gone else record.body
        assert (one.body, one.kind, one.cause) == (body, record.kind.number, record.cause)
        assert bool(one.removed) is gone
        assert (f"{one.seq}" in proved.words().partition("header and hash")[0].partition("(of ")[2]) or not gone


@settings(max_examples=6, deadline=None)
@given(removals)
def test_every_proof_stands(remove: frozenset[int]) -> None:
    """Of records that stay and of those that were removed, through chains with holes."""
    copy = Copy(SEALED, remove)
    for record in STORY.records:
        check_stands(copy, record.seq, remove)


def test_all_but_the_manifest_removed() -> None:
    """Headers alone still lead from one to the next."""
    remove = frozenset(range(1, 200))
    for seq in (10, 22, 114):
        check_stands(Copy(SEALED, remove), seq, remove)


def test_an_answer_without_its_body_names_no_effect() -> None:
    """The link through the world was in what is gone, and the proof says so."""
    copy = Copy(SEALED, {21})
    assert [shown.seq for shown in chain(copy, 22)] == [22, 21]
    assert (chain(copy, 22)[1].kind, chain(copy, 22)[1].text) == ("gimbal_reported", REMOVED)
    words = check(prove(copy, 22, papers())).words()
    assert "(of 21 header and hash: what was said was removed, and with it what it answered)" in words
    assert "answered" not in check(prove(Copy(SEALED, {8}), 22, papers())).words()
    assert "answered" not in check(prove(Copy(SEALED, {6}), 22, papers())).words()
    assert "removed" not in check(prove(copy, 10, papers())).words()


def test_what_it_led_to_is_still_known_by_cause() -> None:
    """A removed observation still has its decisions, a removed effect its outcomes."""
    copy = Copy(SEALED, {6, 8})
    assert [one.seq for one in consequences(copy, 6)] == [one.seq for one in consequences(SEALED, 6)]
    assert line(next(copy.stored(8))).text == REMOVED


@pytest.mark.parametrize(
    ("change", "because"),
    [
        (lambda one: one.update(removed="AB"[one["removed"][0] == "A"] + one["removed"][1:]), "not what the log holds"),
        (lambda one: one.update(removed=one["removed"][:-2] + "B="), "another way"),
        (lambda one: one.update(removed=one["leaf_before"]), "not what the log holds"),
        (lambda one: one.update(removed="AAAA"), "3 bytes, not 32"),
        (lambda one: one.update(salt="", body=""), "not written as it is to be"),
        (lambda one: one.update(removed=None), "not written as it is to be"),
        (lambda one: one.pop("removed"), "not written as it is to be"),
        (lambda one: one.update(cause=NO_CAUSE), "not what the log holds"),
    ],
)
def test_a_changed_proof_is_refused(change: Callable[[dict[str, Any]], object], because: str) -> None:
    """The hash is bound as the body was."""
    data = prove(Copy(SEALED, {114}), 114, papers())
    check_refused(changed(data, lambda proof: change(proof["records"][0])), because)


def test_a_proof_gives_no_salt_away_but_its_own() -> None:
    """Neither of a removed record nor of any other."""
    data = json.loads(prove(Copy(SEALED, {8}), 22, papers()))
    shown = {one["seq"]: one.get("salt") for one in data["records"]}
    assert shown[8] is None
    whole = json.loads(prove(SEALED, 22, papers()))
    assert shown[6] == next(one["salt"] for one in whole["records"] if one["seq"] == 6)
    assert salt_of(SECRET, 8).hex() not in json.dumps(data)
