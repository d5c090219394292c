"""An old flight under a later logic: the same, an intended difference since logic N, or a divergence."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from google.protobuf.message import Message

from autopilot.cli.main import main
from autopilot.node.verdicts import verdict_of
from events import Record
from events.records import Stored
from events.schema.common_pb2 import Moved
from events.schema.findings_pb2 import ItemIgnored, PoiOpened, SightingsClassified
from events.schema.flight_pb2 import FlightOpened, NodeStarted
from events.schema.orders_pb2 import SendAck
from events.store import Appender, SqliteStore
from replay.same import meant
from replay.verdict import Outcome, Verdict
from replay.verify import verify
from statecharts import logic
from statecharts.logic import CHANGES, LOGIC, Change
from tests.breaking import alter_chart
from tests.checks import check_equal
from tests.flights import FLIGHT_ID, SECRET, Flight, resealed, story
from tests.replay.changes import at, changed

SURER = Change(2, "a point of interest is opened with another confidence", kinds=frozenset({"poi_opened"}))
AIMED = Change(3, "an aim says otherwise why it arrived", charts=frozenset({"aim"}))


def know(monkeypatch: pytest.MonkeyPatch, *changes: Change) -> None:
    """Let this software know these changes of logic."""
    monkeypatch.setattr(logic, "CHANGES", changes)
    monkeypatch.setattr(logic, "LOGIC", 1 + len(changes))


def surer(decision: Message) -> Message | None:
    """Decide as logic 2 does."""
    if not isinstance(decision, PoiOpened):
        return decision
    return PoiOpened.FromString(decision.SerializeToString() + PoiOpened(confidence_e4=9_999).SerializeToString())


def aimed(decision: Message) -> Message | None:
    """Decide as logic 3 does."""
    if not isinstance(decision, Moved):
        return decision
    return Moved.FromString(decision.SerializeToString() + Moved(because="as logic 3 says").SerializeToString())


def told(flight: Flight, logic_number: int) -> list[Record]:
    """Return the flight as one that says by which logic it was decided."""
    manifest = FlightOpened.FromString(flight.records[0].body)
    manifest.logic = logic_number
    return changed(flight.records, 0, manifest)


def check_intended(records: Sequence[Record], since: int, seq: int, further: int) -> Verdict:
    """Check that everything that differs is meant, since which logic, and where it begins."""
    verdict = verify(resealed(records))
    assert (verdict.outcome, verdict.holds) == (Outcome.INTENDED, True), verdict.words()
    assert verdict.first is not None
    assert verdict.since is not None
    assert (verdict.since.logic, verdict.first.seq, verdict.further) == (since, seq, further), verdict.words()
    return verdict


def check_divergence(records: Sequence[Record], seq: int, further: int) -> None:
    """Check that something differs that no change of logic explains."""
    verdict = verify(resealed(records))
    assert (verdict.outcome, verdict.holds, verdict.since) == (Outcome.DIVERGES, False, verdict.since), verdict.words()
    assert verdict.first is not None
    assert (verdict.first.seq, verdict.further) == (seq, further), verdict.words()


def test_the_table_has_every_logic_once() -> None:
    """In order, without a gap, each with a sentence and with what it touches."""
    check_equal([change.logic for change in CHANGES], list(range(2, LOGIC + 1)))
    check_equal([change for change in CHANGES if not change.says or not (change.kinds or change.charts)], [])


def test_what_a_later_logic_does_not_change_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """A later number alone is no difference."""
    know(monkeypatch, SURER, AIMED)
    assert verify(resealed(told(story(), 1))).outcome is Outcome.IDENTICAL


def test_what_a_later_logic_decides_otherwise_is_intended(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is named by number and sentence, and counted step by step."""
    flight = story()
    opened = at(flight, "poi_opened")
    know(monkeypatch, SURER)
    alter_chart(monkeypatch, "poi", surer)
    verdict = check_intended(told(flight, 1), since=2, seq=opened, further=0)
    assert verdict.words().startswith(
        "intended difference since logic 2 (a point of interest is opened with another confidence): record "
    )
    assert verdict_of(verdict.plain()) == f"INTENDED@{opened}"
    assert verdict.plain()["since"] == {"logic": 2, "says": SURER.says}


def test_only_changes_after_the_flights_logic_count(monkeypatch: pytest.MonkeyPatch) -> None:
    """A flight of logic 2 was decided as logic 2 says, so what differs there is a divergence."""
    flight = story()
    opened = at(flight, "poi_opened")
    know(monkeypatch, SURER, AIMED)
    alter_chart(monkeypatch, "poi", surer)
    check_intended(told(flight, 1), since=2, seq=opened, further=0)
    check_divergence(told(flight, 2), opened, further=0)
    check_divergence(told(flight, 3), opened, further=0)


def test_a_move_is_told_by_its_chart(monkeypatch: pytest.MonkeyPatch) -> None:
    """Moves of another chart are not explained, though their kind is the same; the first change is the one named."""
    flight = story()
    first = next(one.seq for one in flight.records if isinstance(one.message, Moved) and one.message.chart == "aim")
    alter_chart(monkeypatch, "aim", aimed)
    know(monkeypatch, SURER, AIMED)
    steps = {one.cause for one in flight.records if isinstance(one.message, Moved) and one.message.chart == "aim"}
    check_intended(told(flight, 1), since=3, seq=first, further=len(steps) - 1)
    alter_chart(monkeypatch, "poi", surer)
    check_intended(told(flight, 1), since=2, seq=first, further=len(steps | {_step_of(flight, "poi_opened")}) - 1)
    know(monkeypatch, SURER, Change(3, "another chart", charts=frozenset({"camera"})))
    check_divergence(told(flight, 1), first, further=len(steps) - 1)


def _step_of(flight: Flight, kind: str) -> int:
    return flight.records[at(flight, kind)].cause


def test_a_difference_that_is_not_meant_is_not_hidden_by_one_that_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """The divergence is what is reported first, also where it comes later; also within one step."""
    flight = story()
    know(monkeypatch, SURER)
    alter_chart(monkeypatch, "poi", surer)
    seen, last = at(flight, "poi_opened") - 1, at(flight, "flight_closed") - 1
    classified = SightingsClassified.FromString(flight.records[seen].body)
    classified.sightings[0].distance_mm += 1
    moved = Moved.FromString(flight.records[last].body)
    moved.because = "another reason"
    for seq, message in ((seen, classified), (last, moved)):
        check_divergence(changed(told(flight, 1), seq, message), seq, further=0)


GONE, MORE = frozenset({"item_ignored"}), frozenset({"send_ack"})


@pytest.mark.parametrize(
    ("replayed", "explaining", "unexplaining"),
    [(None, [GONE], [MORE]), (SendAck(), [GONE | MORE], [GONE, MORE])],
    ids=["gone", "another"],
)
def test_decisions_may_come_and_go(
    monkeypatch: pytest.MonkeyPatch,
    replayed: Message | None,
    explaining: Sequence[frozenset[str]],
    unexplaining: Sequence[frozenset[str]],
) -> None:
    """Both what was recorded and what is replayed is to be explained."""
    flight = story()
    first = at(flight, "item_ignored")
    alter_chart(monkeypatch, "poi", lambda said: replayed if isinstance(said, ItemIgnored) else said)
    for kinds in explaining:
        know(monkeypatch, Change(2, "nothing is muted", kinds=kinds))
        check_intended(told(flight, 1), since=2, seq=first, further=0)
    for kinds in unexplaining:
        know(monkeypatch, Change(2, "nothing is muted", kinds=kinds))
        check_divergence(told(flight, 1), first, further=0)


def test_a_body_that_is_no_message_is_never_meant(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is a forgery, and is reported as one."""
    know(monkeypatch, SURER)
    flight = story()
    records, seq = told(flight, 1), at(flight, "poi_opened")
    records[seq] = replace(records[seq], body=b"\xff")
    assert verify(resealed(records)).outcome is Outcome.UNREADABLE
    broken = [Stored(one.seq, one.cause, one.at, one.kind.number, one.version, one.body, b"") for one in records]
    assert meant(1, broken[seq - 2 : seq + 1], flight.records[seq - 2 : seq + 1]) is None


def test_the_first_change_of_several_is_named() -> None:
    """Whatever order the decisions come in."""
    pair = [PoiOpened(), Moved(chart="aim")]
    for decisions in (pair, pair[::-1]):
        assert logic.since(1, decisions, (SURER, AIMED)) == SURER
        assert logic.since(2, decisions, (SURER, AIMED)) is None


def test_another_order_of_the_same_decisions_is_never_meant(monkeypatch: pytest.MonkeyPatch) -> None:
    """A change says which decisions differ; where none does, nothing explains it."""
    with pytest.raises(ValueError, match="no decision differs"):
        logic.since(1, [], (SURER,))
    know(monkeypatch, SURER)
    flight = story()
    seq = at(flight, "poi_opened")
    first, second = flight.records[seq], flight.records[seq + 1]
    records = changed(changed(told(flight, 1), seq, second.message), seq + 1, first.message)
    assert verify(resealed(records)).outcome is Outcome.DIVERGES


def test_a_start_in_the_air_says_which_logic_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """What was decided before it is held to the old logic, what was decided after it to the new one."""
    flight = story()
    know(monkeypatch, SURER)
    alter_chart(monkeypatch, "poi", surer)
    opened, start = at(flight, "poi_opened"), at(flight, "node_started")
    check_intended(told(flight, 1), since=2, seq=opened, further=0)
    check_divergence(changed(told(flight, 1), start, NodeStarted(boot_id="boot", start=1, logic=2)), opened, further=0)


def test_a_newer_logic_is_not_guessed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The flight is named unreadable, and which software it takes."""
    verdict = verify(resealed(told(story(), LOGIC + 6)))
    assert (verdict.outcome, verdict.seq) == (Outcome.UNREADABLE, 0)
    assert verdict.detail == (
        f"it was decided by logic {LOGIC + 6}, and this software knows none above {LOGIC}: "
        "replay it with software 0.1.0 or later"
    )


def test_the_command_says_it_and_succeeds(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An intended difference is no failure; a divergence is."""
    store: Appender = SqliteStore.create(tmp_path / "flight.db", FLIGHT_ID, SECRET)
    store.append(told(story(), 1))
    store.close()
    know(monkeypatch, SURER)
    alter_chart(monkeypatch, "poi", surer)
    assert main(["replay", "verify", str(tmp_path), "--json"]) == os.EX_OK
    found = json.loads(capsys.readouterr().out)
    assert (found["outcome"], found["since"]["logic"]) == ("intended difference", 2)
    know(monkeypatch)
    assert main(["replay", "verify", str(tmp_path)]) == os.EX_DATAERR
