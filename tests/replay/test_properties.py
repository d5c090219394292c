"""`replay verify` says which properties the recorded decisions broke, also where they replay identically."""

from __future__ import annotations

import pytest

from replay.verdict import Outcome
from replay.verify import verify
from statecharts.monitors import Breach, Watch
from tests.checks import check_equal
from tests.flights import resealed, story
from tests.replay.changes import at, forged

STORY = story()


def test_a_good_flight_breaks_none() -> None:
    """And its verdict says nothing of it."""
    verdict = verify(resealed(STORY.records))
    check_equal((verdict.outcome, verdict.broken), (Outcome.IDENTICAL, ()))
    check_equal("PROPERTY" in verdict.words(), False)


def test_what_was_recorded_is_watched() -> None:
    """Not what today's charts would have said: an answer that was taken back is a broken property."""
    repeated = next(
        record.seq
        for record in STORY.records
        if record.kind.name == "send_ack" and record.message.duplicate  # type: ignore[attr-defined]
    )
    verdict = verify(resealed(forged(STORY, repeated, detail="otherwise")))
    check_equal((verdict.outcome, [one.name for one in verdict.broken]), (Outcome.DIVERGES, ["answers_stand"]))
    check_equal("BROKEN PROPERTY answers_stand at record" in verdict.words(), True)
    check_equal(at(STORY, "order_received") < verdict.broken[0].seq < repeated, True)


def test_a_monitor_that_fails_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """The replay goes on."""

    def fails(*_: object) -> list[Breach]:
        raise KeyError

    monkeypatch.setattr(Watch, "see", fails)
    verdict = verify(resealed(STORY.records))
    check_equal((verdict.outcome, [one.name for one in verdict.broken]), (Outcome.IDENTICAL, ["monitors"]))
