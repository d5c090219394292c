"""The frame of the benchmarks itself: who runs when, what counts, and what the table says."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from events.store import MemoryStore
from replay.verdict import Outcome
from replay.verify import verify
from tests.bench import frame
from tests.bench.__main__ import BENCHES, main
from tests.bench.flight import FLIGHT_ID, SECRET, records
from tests.bench.flown import TICKS_A_SECOND, flown
from tests.bench.frame import Contestant, Row, at_least, at_most, figure, interleaved, ratio, save, table


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep the contestants' folder out of the repository."""
    monkeypatch.setattr(frame, "WORK", tmp_path / "work")


def test_contestants_take_turns_and_the_first_round_is_thrown_away() -> None:
    """Each begins a round in turn, in an empty folder of its own."""
    ran: list[str] = []

    def contestant(name: str) -> Contestant:
        def run(folder: Path) -> float:
            assert list(folder.iterdir()) == []
            (folder / "left behind").touch()
            ran.append(name)
            return len(ran)

        return run

    measures = interleaved({"a": contestant("a"), "b": contestant("b")}, rounds=3)
    assert "".join(ran) == "abbaabba"
    assert measures == {"a": [4, 5, 8], "b": [3, 6, 7]}
    assert not frame.WORK.exists()


def test_a_ratio_is_the_median_of_the_rounds() -> None:
    """One bad round does not count, and neither does the order of the speeds."""
    assert ratio({"ours": [2, 30, 4, 1, 9], "theirs": [1, 1, 2, 1, 3]}, "ours", "theirs") == 2


def test_a_budget_is_a_floor_or_a_ceiling() -> None:
    """The budget itself is met either way."""
    met = [at_least("n", value, "x", 1.5, "a").met for value in (1.4, 1.5, 1.6)]
    assert met == [False, True, True]
    assert [at_most("n", value, "x", 1.5, "a").met for value in (1.4, 1.5, 1.6)] == [True, True, False]


def test_the_table_and_the_file_say_the_same(tmp_path: Path) -> None:
    """A row has a name, a value, a unit, a budget, whether it is met, and what it is against."""
    row = Row("append", 123456.7, "records/s", 0.5, True, "raw")
    assert table([row]).splitlines()[1].split() == ["append", "123,457", "records/s", "0.5", "yes", "raw"]
    assert [figure(value) for value in (0.9407, 12.345, 999.4, 1000)] == ["0.941", "12.3", "999", "1,000"]
    save([row], tmp_path / "new" / "bench.json")
    assert json.loads((tmp_path / "new" / "bench.json").read_text("utf-8")) == [
        {"name": "append", "value": 123456.7, "unit": "records/s", "budget": 0.5, "met": True, "against": "raw"}
    ]


def test_names_choose_and_a_wrong_name_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    """Names are unique; one that fits nothing is a usage error that lists them."""
    assert len({bench.name for bench in BENCHES}) == len(BENCHES)
    assert main(["no such"]) == 2
    said = capsys.readouterr().err
    assert [bench.name for bench in BENCHES if bench.name not in said] == []


def test_the_bench_flight_is_gapless_and_always_the_same() -> None:
    """Contestants must write the same rows."""
    flight = records(60)
    assert [record.seq for record in flight] == list(range(60))
    assert [record.body for record in flight] == [record.body for record in records(60)]
    assert len({record.kind.name for record in flight}) == 4


def test_the_flown_flight_replays() -> None:
    """What is measured is a flight that the charts of today decided: they decide it again alike."""
    log = flown(20 * TICKS_A_SECOND)
    store = MemoryStore(FLIGHT_ID, SECRET)
    store.append(log)
    verdict = verify(store)
    assert (verdict.outcome, verdict.records, verdict.first) == (Outcome.IDENTICAL, len(log), None)
    assert {"sightings_classified", "poi_opened", "moved"} <= {record.kind.name for record in log}
