"""How the search for who is to blame is made: other processes, its limits, its window, and its score."""

from __future__ import annotations

import sys
from dataclasses import replace

import pytest

from events import NO_CAUSE, encode, make_record, read_record
from events.records import Stored
from events.schema.common_pb2 import Moved
from replay.blame import blame
from replay.blame import case as cases
from replay.blame.again import Again, ChildFailed, said
from replay.blame.case import Case, Lifting, copied
from replay.blame.findings import Cause, Finding, Weight, chosen
from replay.verify import verify
from statecharts import steps_of
from tests.checks import check_same
from tests.flights import (
    Flight,
    closed,
    detection,
    frame,
    limits,
    opened,
    resealed,
    story,
)
from tests.replay.blaming import Alike, check_blamed, look, pointed, put
from tests.replay.changes import at, changed, forged, renumbered, small
from tests.torture import blame as torture
from tests.torture.recorder import under


def test_a_lifted_record_is_one_of_an_older_version() -> None:
    """Its body is what was stored."""
    record = small().records[5]
    assert Lifting().unlifted(record) is None
    older = replace(record, version=record.version + 1)
    assert Lifting().unlifted(older) == record.message
    stored = Stored(record.seq, record.cause, record.at, record.kind.number, record.version, record.body, b"")
    assert Lifting().read(stored) == read_record(stored)


def test_another_process_decides_otherwise() -> None:
    """Then it is the environment, and nothing else is looked into."""
    records = forged(story(), 22, because="forged")
    found = check_blamed(records, Cause.ENVIRONMENT, Weight.PROVED, "hash seed 3", again=Alike(3))
    assert [one.words for one in found.findings[1:]] == ["not looked into: there is proof of another cause"] * 5


def test_this_process_decides_otherwise(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same step from the same state must come out the same."""
    records = forged(story(), 22, because="forged")
    reader = resealed(records)
    first = verify(reader).first
    assert first is not None
    calls = iter(range(1_000))
    monkeypatch.setattr(sys.modules["replay.blame.environment"], "said", lambda _records: ((next(calls), b""),))
    found = blame(reader, first, again=Alike())
    assert found.findings[0].words.startswith("decided 3 times from the same state in this process")


def test_a_long_log_is_not_handed_to_another_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """It says so, and nobody is asked."""
    monkeypatch.setattr(sys.modules["replay.blame.environment"], "RECORDS_MAX", 5)
    found = look(forged(story(), 22, because="forged"), again=Alike(1, 2, 3, 4))
    words = next(one.words for one in found.findings if one.cause is Cause.ENVIRONMENT)
    assert "too long a log for another process" in words


def test_another_interpreter_is_suspected() -> None:
    """Where nothing else explains it; a manifest that does not say is no evidence."""
    records = changed(forged(story(), 22, because="forged"), 0, opened(python="2.7.18", platform="Plan9 mips"))
    words = "recorded with Python 2.7.18, here 3."
    check_blamed(records, Cause.ENVIRONMENT, Weight.SUSPECTED, words, software="0.1.0")


def test_real_processes_agree_and_fail_aloud() -> None:
    """The same decisions under another hash seed; a child that gives no answer is no evidence."""
    flight = small()
    steps = [tuple(records) for records in steps_of(flight.records)]
    again = Again(seeds=(1,))
    last = steps[-1]
    assert again.decide(1, [*steps[:-1], last[:1]]) == said(last[1:])
    assert again.decide(1, [*steps[:-2], steps[-2][:1]]) == said(steps[-2][1:])
    again.close()
    broken = Again(seeds=(1,), child=("-c", "import sys; sys.exit(3)"))
    with pytest.raises(ChildFailed, match="hash seed 1"):
        broken.decide(1, steps)
    broken.close()
    records = forged(story(), 22, because="forged")
    found = look(records, again=Again(child=("-c", "import sys; sys.exit(3)")))
    assert found.cause is Cause.CODE
    assert "gave no answer" in next(one.words for one in found.findings if one.cause is Cause.ENVIRONMENT)


def test_what_is_chosen() -> None:
    """The weightiest; between equals, the one that could have been right in fewer ways."""
    findings = [
        Finding(Cause.CODE, Weight.LEFT, ""),
        Finding(Cause.MISSING, Weight.WHOLE, ""),
        Finding(Cause.REORDERED, Weight.WHOLE, ""),
        Finding(Cause.CONFIGURATION, Weight.STEP, ""),
        Finding(Cause.UPCAST, Weight.NOT_APPLICABLE, ""),
    ]
    order = [one.cause.value for one in chosen(findings).findings]
    assert order == ["reordered input", "missing input", "configuration", "code", "upcast"]
    results = [one.result for one in chosen(findings).findings]
    assert results == ["explains it", "explains it", "explains it", "may explain it", "not applicable"]


def test_work_is_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    """And it is said where nobody looked any further."""
    records = under(pointed(operator_hold_ms=45_000).records, limits())
    monkeypatch.setattr(cases, "RECORDS_MAX", 300)
    monkeypatch.setattr(cases, "RUNS_AT_LEAST", 0)
    found = look(records)
    stopped = {one.cause for one in found.findings if one.stopped}
    assert {Cause.CONFIGURATION, Cause.MISSING} <= stopped
    assert look(records, tell=lambda _: None).plain()["findings"][0]["tried"] >= 0


def test_what_is_looked_into_is_told() -> None:
    """One word a hypothesis."""
    told: list[str] = []
    look(forged(story(), 22, because="forged"), tell=told.append)
    assert sorted(told) == sorted(one.value for one in Cause)


def test_a_divergence_at_the_very_beginning_and_the_very_end() -> None:
    """The window is cut where the flight is."""
    flight = Flight()
    moved = Moved(chart="scan", instance="1/1", from_state="zoomed_out", to_state="blocked", because="forged")
    record = make_record(1, 0, flight.records[0].at, moved)
    records = [flight.records[0], record, *renumbered(flight.records[1:], 1, 1)]
    check_blamed(records, Cause.CODE, Weight.LEFT, "")
    flight = story()
    last = make_record(len(flight.records), flight.records[-1].cause, flight.records[-1].at, record.message)
    last = replace(last, cause=at(flight, "flight_closed"))
    check_blamed([*flight.records, last], Cause.CODE, Weight.LEFT, "")


def test_a_window_that_ends_before_the_flight(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps that the window cuts are not compared; an explanation says how far it was seen to hold."""
    monkeypatch.setattr(cases, "WINDOW_BEFORE", 4)
    monkeypatch.setattr(cases, "WINDOW_AFTER", 3)
    flight = pointed(arrival_tolerance_cdeg=50)
    for number in range(1, 6):
        flight.tell(frame(number, detection(1_000 * number, 0)), 80)
    flight.tell(closed(), 10)
    records = under(flight.records, limits())
    found = check_blamed(records, Cause.CONFIGURATION, Weight.WHOLE, "steps around it")
    assert found.findings[0].tried > 1


def test_a_body_that_can_not_be_read_does_not_end_the_search() -> None:
    """The window ends before it."""
    flight = small()
    seq = at(flight, "moved")
    records = put(flight.records, seq, body=b"\xff\xff")
    check_blamed(records, Cause.CODE, Weight.LEFT, "")


def test_a_copy_of_the_state_is_its_own() -> None:
    """Equal, and changed by itself."""
    flight = story()
    copy = copied(flight.state)
    check_same(copy, flight.state)
    copy.objects.drop(1)
    assert 1 in flight.state.objects


def test_the_case_goes_on_from_what_was_recorded() -> None:
    """The baseline counts every step that differs in the window."""
    records = forged(small(), 7, life_ms=1)
    flight = small()
    flight.records = records
    records = forged(flight, at(flight, "send_ack", -1), detail="forged")
    reader = resealed(records)
    first = verify(reader).first
    assert first is not None
    case = Case(reader, first, Lifting())
    assert (case.seq, case.baseline.differing) == (5, (5, at(flight, "command_answered")))
    assert case.manifest.node == "node-1"
    assert encode(case.manifest) == records[0].body
    assert records[0].cause == NO_CAUSE


def test_mutations_are_found_out() -> None:
    """A sample of the long run: the first record in all, the cause in nine of ten."""
    counts = torture.run(20, seed=2, report=lambda _line: None)
    assert counts["first_seq_right"] == counts["mutations"] >= 18
    assert counts["blame_right_percent"] >= 90
