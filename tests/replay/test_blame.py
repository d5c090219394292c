"""Who is to blame for a divergence: each cause by the test that shows it, and by no guess."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest

from events import NO_CAUSE, Record, encode, make_record, read_record
from events.records import Stored
from events.schema.common_pb2 import Moved
from replay.blame import blame
from replay.blame import case as cases
from replay.blame.again import Again, ChildFailed, said
from replay.blame.case import Case, Lifting, copied
from replay.blame.findings import Blame, Cause, Finding, Weight, chosen
from replay.verify import verify
from statecharts import State, engine, step, steps_of
from tests.checks import check_same
from tests.flights import (
    Flight,
    answered,
    closed,
    detection,
    frame,
    gimbal,
    judge,
    limits,
    opened,
    point_at_place,
    release,
    resealed,
    story,
)
from tests.replay.changes import at, changed, forged, renumbered, small
from tests.torture import blame as torture
from tests.torture.liftings import Lifted
from tests.torture.patches import BODIES, ROWS
from tests.torture.recorder import under


class Alike(Again):
    """Other processes that decide as this one does, without the time that it takes to start them."""

    def __init__(self, *odd: int) -> None:
        """`odd`: hash seeds under which something else comes out."""
        super().__init__()
        self.odd = odd

    def decide(self, seed: int, steps: Sequence[Sequence[Record]]) -> tuple[tuple[int, bytes], ...]:
        """Decide here."""
        if seed in self.odd:
            return ()
        state = State()
        for records in steps[:-1]:
            engine.restore(state, records)
        return said(step(state, steps[-1][0]).records[1:])


def look(records: Sequence[Record], **given: Any) -> Blame:
    """Return what replay finds of a log that diverges."""
    reader = resealed(records)
    first = verify(reader).first
    assert first is not None
    return blame(reader, first, **({"again": Alike()} | given))


def check_blamed(records: Sequence[Record], cause: Cause, weight: Weight, words: str, **given: Any) -> Blame:
    """Check which finding is believed, how much it weighs, and a part of what it says."""
    found = look(records, **given)
    first = found.findings[0]
    assert (first.cause, first.weight) == (cause, weight), found.plain()
    assert words in first.words
    assert sorted(one.cause.value for one in found.findings) == sorted(one.value for one in Cause)
    return found


def pointed(**bounds: Any) -> Flight:
    """Return a flight with an order, two reports of the gimbal, and the end of the hold."""
    flight = Flight(limits=limits(**bounds))
    flight.tell(point_at_place("a", 20_000, 30_000), 100)
    effect = flight.effect()
    flight.tell(answered(effect), 20)
    flight.tell(gimbal(-100, 100, effect, 80), 300)
    flight.tell(gimbal(-100, 100, effect, 30), 300)
    flight.wait(100_000)
    return flight


def ordered(**bounds: Any) -> Flight:
    """Return a flight with two orders."""
    flight = Flight(limits=limits(**bounds))
    flight.tell(point_at_place("a"), 100)
    flight.tell(release("b", order_seq=2), 100)
    return flight


def sighted(**bounds: Any) -> Flight:
    """Return a flight in which something is seen five times, asked about, and declined."""
    flight = Flight(limits=limits(**bounds))
    for number in range(1, 6):
        flight.tell(frame(number, detection(1_000 * number, 0)), 80)
    for poi_id in flight.surfaced():
        flight.tell(judge("j", poi_id, confirmed=False), 500)
    for number in range(6, 9):
        flight.tell(frame(number, detection(1_000 * number, 500)), 80)
    return flight


def put(records: Sequence[Record], seq: int, **changes: Any) -> list[Record]:
    """Return the records with other columns in one of them."""
    return [replace(one, **changes) if one.seq == seq else one for one in records]


def without(records: Sequence[Record], seq: int) -> list[Record]:
    """Return the records without the step that begins at `seq`."""
    gone = [one.seq for one in records if one.seq == seq or one.cause == seq]
    return renumbered([one for one in records if one.seq not in gone], seq, -len(gone))


@pytest.mark.parametrize(
    ("name", "recorded", "words"),
    [
        ("pointed", {"arrival_tolerance_cdeg": 50}, "arrival_tolerance_cdeg"),
        ("pointed", {"operator_hold_ms": 45_000}, "operator_hold_ms 45000 instead of 60000"),
        ("ordered", {"command_enabled": False}, "command_enabled False instead of True"),
        ("ordered", {"camera_roles": []}, "camera_roles none instead of camera"),
        ("sighted", {"sightings_to_ask": 5}, "sightings_to_ask"),
        ("sighted", {"same_object_mm": 900}, "same_object_mm"),
        ("sighted", {"ask_confidence_e4": 9_000}, "ask_confidence_e4"),
    ],
)
def test_a_limit_that_was_another(name: str, recorded: dict[str, Any], words: str) -> None:
    """It is named, with a value under which the whole flight comes out."""
    flight = {"pointed": pointed, "ordered": ordered, "sighted": sighted}[name](**recorded)
    check_blamed(under(flight.records, limits()), Cause.CONFIGURATION, Weight.WHOLE, words)


def test_a_limit_that_nobody_would_write_is_fitted() -> None:
    """It explains as much, and weighs less."""
    records = under(sighted(same_object_mm=1_003).records, limits(same_object_mm=999))
    check_blamed(records, Cause.CONFIGURATION, Weight.WHOLE, "same_object_mm 1000 instead of 999")
    records = under(pointed(operator_hold_ms=44_987).records, limits())
    found = look(records)
    weights = [one.weight for one in found.findings if one.cause is Cause.CONFIGURATION]
    assert weights == [Weight.FITTED], found.plain()


def test_time_that_runs_backwards() -> None:
    """Two observations were exchanged with their moments."""
    flight = small()
    seq = at(flight, "command_sent")
    one, other = flight.records[seq], flight.records[seq + 1]
    assert other.kind.name == "moved"
    later = at(flight, "command_answered")
    there = flight.records[later]
    records = put(flight.records, seq, at=there.at, kind=there.kind, body=there.body, message=there.message)
    records = put(records, later, at=one.at, kind=one.kind, body=one.body, message=one.message)
    check_blamed(records, Cause.REORDERED, Weight.PROVED, f"time runs backwards from record {seq} to {later}")


def test_a_clock_that_is_off() -> None:
    """Flight time was changed, and the monotonic clock tells."""
    flight = pointed()
    seq = at(flight, "time_passed")
    step_of = [one.seq for one in flight.records if one.seq == seq or one.cause == seq]
    moment = flight.records[seq].at
    moved = moment._replace(flight_ns=moment.flight_ns - 7_000_000)
    records = [replace(one, at=moved) if one.seq in step_of else one for one in flight.records]
    check_blamed(records, Cause.REORDERED, Weight.PROVED, f"record {seq} is -7000000 ns off the monotonic clock")


def test_a_moment_that_is_another() -> None:
    """All clocks agree, so only the deadline tells that it came too early."""
    flight = pointed()
    seq = at(flight, "time_passed")
    moment = flight.records[seq].at
    by_ns = 7_345_000
    moved = moment._replace(flight_ns=moment.flight_ns - by_ns, mono_ns=moment.mono_ns - by_ns)
    records = [replace(one, at=moved) if seq in (one.seq, one.cause) else one for one in flight.records]
    check_blamed(records, Cause.REORDERED, Weight.FITTED, f"record {seq} moved in time by 7 ms")


def test_a_decision_at_the_moment_of_another() -> None:
    """It was made on the neighbour."""
    flight = small()
    seq, other = at(flight, "camera_taken"), at(flight, "command_sent")
    records = put(flight.records, seq, at=flight.records[other].at)
    check_blamed(records, Cause.REORDERED, Weight.PROVED, f"record {seq} was decided at the moment of record {other}")


def test_neighbours_that_were_exchanged() -> None:
    """Without a trace in the clocks: they come out when they are exchanged back."""
    flight = small()
    seq, other = at(flight, "command_sent"), at(flight, "command_answered")
    one, there = flight.records[seq], flight.records[other]
    records = put(flight.records, seq, kind=there.kind, body=there.body, message=there.message)
    records = put(records, other, kind=one.kind, body=one.body, message=one.message)
    words = f"records {seq} and {other} exchanged: comes out as recorded, the rest of the flight too"
    check_blamed(records, Cause.REORDERED, Weight.WHOLE, words)


def test_a_decision_on_nothing() -> None:
    """Its observation was taken out of the log; its moment, or its cause, is nowhere."""
    flight = small()
    seq = at(flight, "command_answered")
    records = renumbered([one for one in flight.records if one.seq != seq], seq + 1, -1)
    check_blamed(records, Cause.MISSING, Weight.PROVED, "at a moment at which nothing was observed")
    there = flight.records[at(flight, "command_sent")].at
    records = [replace(one, at=there) if one.cause == seq else one for one in records]
    check_blamed(records, Cause.MISSING, Weight.PROVED, f"follows from record {seq}, which is no observation before")


def test_a_move_from_where_nothing_was() -> None:
    """A step was taken out, whole: the moves behind it begin where those before it do not end."""
    flight = pointed()
    flight.tell(release("b", order_seq=2), 100)
    flight.wait(2_000)
    flight.tell(point_at_place("c", order_seq=3), 100)
    records = without(flight.records, at(flight, "order_received", 1))
    check_blamed(records, Cause.MISSING, Weight.PROVED, "moves camera 1/1 from released; by the log it was automatic")


def test_an_answer_to_a_repeat_that_came_once() -> None:
    """The first time is missing."""
    flight = Flight()
    flight.tell(point_at_place("a", roles=()), 100)
    flight.tell(point_at_place("a", roles=(), send=2), 100)
    records = without(flight.records, at(flight, "order_received"))
    check_blamed(records, Cause.MISSING, Weight.WHOLE, "answers order alpha/a as one that came before")


def test_an_object_that_was_never_seen() -> None:
    """Numbers of objects have no gaps; distances are those to where the log has them."""
    flight = Flight()
    flight.tell(frame(1, detection(0, 0)), 80)
    flight.tell(frame(2, detection(900_000, 0)), 80)
    flight.tell(frame(3, detection(-900_000, 0)), 80)
    records = without(flight.records, at(flight, "frame_observed", 1))
    check_blamed(records, Cause.MISSING, Weight.WHOLE, "names object 3; the log put 1 on the map before")
    flight = sighted()
    records = without(flight.records, at(flight, "frame_observed", 3))
    check_blamed(records, Cause.MISSING, Weight.WHOLE, "meets object 1 1000 mm from where it was; by the log")


def test_an_input_that_left_no_decision() -> None:
    """Nothing speaks of it, but with it put in the decisions come out."""
    flight = ordered()
    records = without(flight.records, at(flight, "vehicle_link_changed"))
    check_blamed(records, Cause.MISSING, Weight.WHOLE, "link up of vehicle 1, put in before record")


@pytest.mark.parametrize("name", sorted(ROWS))
def test_other_rows(name: str) -> None:
    """The manifest tells; what else could explain it does not count."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        ROWS[name](monkeypatch)
        records = _much().records
    if verify(resealed(records)).first is not None:
        check_blamed(records, Cause.CODE, Weight.DIFFERS, "other rows of charts")


def _much() -> Flight:
    flight = pointed(scan_enabled=True)
    flight.tell(point_at_place("v", roles=("viewer",), who="viewer"), 50)
    flight.tell(point_at_place("a0", order_seq=0), 50)
    for number in range(1, 6):
        flight.tell(frame(number, detection(1_000 * number, 0)), 80)
    flight.wait(20_000)
    return flight


def test_other_software_and_another_logic() -> None:
    """By the manifest; software only where somebody says which this is."""
    records = forged(story(), 20, because="forged")
    check_blamed(records, Cause.CODE, Weight.OLDER, "software 0.1.0, here 0.2.0", software="0.2.0")
    check_blamed(records, Cause.CODE, Weight.LEFT, "or the log was written by somebody else", software="0.1.0")
    check_blamed(records, Cause.CODE, Weight.LEFT, "(no row of ours gives this reason)")
    older = changed(records, 0, opened(logic=77))
    check_blamed(older, Cause.CODE, Weight.DIFFERS, "logic 77, here 1")


def test_another_body_of_a_guard() -> None:
    """By elimination: chart, row and guard are named."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        BODIES["details are cut"](monkeypatch)
        records = story().records
    found = check_blamed(records, Cause.CODE, Weight.LEFT, "command", software="0.1.0")
    assert "does not explain it" in [one.result for one in found.findings]


def test_a_lifting_that_was_forgotten() -> None:
    """Tenths of a degree, read as hundredths: read ten times larger, everything comes out."""
    flight = pointed(arrival_tolerance_cdeg=50)
    seqs = [one.seq for one in flight.records if one.kind.name == "gimbal_reported"]
    stored = {
        seq: gimbal(-100, 100, at(flight, "point_at_place"), error) for seq, error in zip(seqs, (8, 3), strict=True)
    }
    words = "gimbal_reported.error_cdeg"
    far = [make_record(one.seq, one.cause, one.at, _far(one)) if one.seq in seqs else one for one in flight.records]
    check_blamed(far, Cause.UPCAST, Weight.WHOLE, words, lifting=Lifted(dict(stored)))


def _far(record: Record) -> Any:
    message = type(record.message)()
    message.CopyFrom(record.message)
    message.error_cdeg *= 100  # type: ignore[attr-defined]
    return message


def test_a_lifting_that_has_no_part_is_not_blamed() -> None:
    """And one that has a part, but that no other reading explains, is suspected and no more."""
    flight = pointed(operator_hold_ms=45_000)
    seq = at(flight, "command_answered")
    right = Lifted({seq: flight.records[seq].message})
    found = check_blamed(
        under(flight.records, limits()), Cause.CONFIGURATION, Weight.WHOLE, "operator_hold_ms", lifting=right
    )
    upcast = next(one for one in found.findings if one.cause is Cause.UPCAST)
    assert (upcast.weight, upcast.result) == (Weight.NOTHING, "does not explain it")


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
    records = forged(story(), 20, because="forged")
    found = check_blamed(records, Cause.ENVIRONMENT, Weight.PROVED, "hash seed 3", again=Alike(3))
    assert [one.words for one in found.findings[1:]] == ["not looked into: there is proof of another cause"] * 5


def test_this_process_decides_otherwise(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same step from the same state must come out the same."""
    records = forged(story(), 20, because="forged")
    reader = resealed(records)
    first = verify(reader).first
    assert first is not None
    calls = iter(range(1_000))
    monkeypatch.setattr(sys.modules["replay.blame.environment"], "said", lambda _records: ((next(calls), b""),))
    found = blame(reader, first, again=Alike())
    assert found.findings[0].words.startswith("decided 3 times from the same state in this process")


def test_another_interpreter_is_suspected() -> None:
    """Where nothing else explains it; a manifest that does not say is no evidence."""
    records = changed(forged(story(), 20, because="forged"), 0, opened(python="2.7.18", platform="Plan9 mips"))
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
    records = forged(story(), 20, because="forged")
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
    look(forged(story(), 20, because="forged"), tell=told.append)
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
    records = forged(flight, at(flight, "send_ack"), detail="forged")
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
