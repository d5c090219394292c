"""Golden flights, recorded once and replayed by every version, byte for byte; and one that must diverge.

`table.py` says of each why it is there. What all of them come to stands in `digests.json`; a change that decides
otherwise raises LOGIC and records them anew (`python -m tests.golden.make`), knowingly.
"""

from __future__ import annotations

import json
import shutil
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

import pytest

from events import KINDS, Record, read_record
from events.records import Moment, Stored, encode
from events.schema.orders_pb2 import OrderReceived, SendAck
from events.store import SqliteReader
from replay.verdict import Outcome
from replay.verify import verify
from statecharts import State
from statecharts.charts import CHARTS
from statecharts.table import Chart
from tests.flights import resealed
from tests.golden.comparing import differences, undecided
from tests.golden.digest import replayed, rows_of, text_of, text_of_state
from tests.golden.make import everything, write
from tests.golden.table import DIGESTS, GOLDEN, UNREACHED, Golden

LARGEST_BYTES = 150_000
HONEST = [one for one in GOLDEN if not one.diverges]


def by_name(golden: Golden) -> str:
    """Name a flight in the names of tests."""
    return golden.name


def named(name: str) -> Golden:
    """Return one golden flight."""
    return next(one for one in GOLDEN if one.name == name)


def check_nothing(found: Iterator[str]) -> None:
    """Check that a comparison found nothing."""
    assert list(found) == []


@pytest.mark.parametrize("golden", HONEST, ids=by_name)
def test_a_golden_flight_replays_field_by_field(golden: Golden) -> None:
    """Record A = replay A, held by a comparer that is not the verifier; and the verifier says so too."""
    rows, words = rows_of(golden.path)
    steps = [records for records, _ in replayed(rows, State())]
    check_nothing(undecided(rows, list(chain.from_iterable(steps))))
    decisions = len(rows) - len(steps)
    assert words == f"identical: {len(rows)} records, {decisions} decisions compared"


@pytest.mark.parametrize("golden", GOLDEN, ids=by_name)
def test_the_same_inputs_are_the_same_log(golden: Golden, tmp_path: Path) -> None:
    """Record A = record B: told twice, against each other and the one that lies here; then the files, byte for byte."""
    first, second = golden.records(), golden.records()
    lying, _ = rows_of(golden.path)
    check_nothing(differences(list(resealed(first).stored()), list(resealed(second).stored())))
    check_nothing(differences(list(resealed(first).stored()), lying))
    write(tmp_path / "a", first)
    write(tmp_path / "b", second)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_they_come_to_what_is_written_beside_them() -> None:
    """Decisions, deadlines, state, bundle and verdict of each, and the heads of flights by chance."""
    assert everything() == json.loads(DIGESTS.read_text(encoding="utf-8"))


def test_they_are_small_and_each_says_why() -> None:
    """No file without a line in the table."""
    files = sorted(path for path in DIGESTS.parent.iterdir() if path.suffix == ".db")
    assert files == sorted(one.path for one in GOLDEN)
    assert max(path.stat().st_size for path in files) <= LARGEST_BYTES
    assert all(one.why.endswith(".") for one in GOLDEN)
    assert [one.name for one in GOLDEN if one.diverges] == ["forged"]


def test_the_forged_flight_diverges_where_it_was_forged(tmp_path: Path) -> None:
    """The chain holds; the decision does not."""
    reader = SqliteReader(Path(shutil.copy(named("forged").path, tmp_path / "flight.db")))
    verdict = verify(reader)
    reader.close()
    assert verdict.outcome is Outcome.DIVERGES, verdict.words()
    assert verdict.first is not None
    assert (verdict.first.kind, verdict.first.field, verdict.first.recorded) == (
        "send_ack",
        "detail",
        "'something else'",
    )
    assert verdict.first.causes[-1].kind == "order_received"
    assert verdict.further == 0
    rows, _ = rows_of(named("forged").path)
    again = chain.from_iterable(records for records, _ in replayed(rows, State()))
    found = list(undecided(rows, list(again)))
    seq = f"{verdict.first.seq}"
    assert [words.split()[:2] for words in found] == [[seq, "detail:"], [seq, "body:"]]


def unreached() -> set[str]:
    """Return the rows that the table says no flight can ask for."""
    lines = (line.split() for lines in UNREACHED.values() for line in lines)
    return {f"{chart} {state} {trigger}" for chart, state, *triggers in lines for trigger in triggers}


def test_every_row_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every row of every chart is what some golden flight needed; the others are listed, with the reason."""
    asked, ask = Counter[int](), Chart.ask

    def counting(chart: Chart[Any], *question: Any) -> Any:
        row = ask(chart, *question)
        asked[id(row)] += 1
        return row

    monkeypatch.setattr(Chart, "ask", counting)
    for golden in GOLDEN:
        golden.records()
    never = [f"{chart.name} {row.source} {row.trigger}" for chart in CHARTS for row in chart.rows if not asked[id(row)]]
    assert sorted(set(never)) == sorted(unreached())


def test_every_kind_occurs() -> None:
    """What a node can write is in some golden flight."""
    kinds = {record.kind.name for golden in HONEST for record in golden.records()}
    assert [kind.name for kind in KINDS if kind.name not in kinds] == []


def gates_rows() -> list[Stored]:
    """Return the rows of a small log."""
    return rows_of(named("gates").path)[0]


@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("seq", 7),
        ("cause", 3),
        ("at", Moment(0, 0, 0, 0, 0)),
        ("version", 2),
        ("kind_number", 3),
        ("leaf", bytes(32)),
        ("body", b""),
    ],
)
def test_the_comparer_finds_each_column(column: str, value: Any) -> None:
    """A changed column is found; a changed body in its fields as well."""
    rows = gates_rows()
    other = [*rows[:10], rows[10]._replace(**{column: value}), *rows[11:]]
    found = list(differences(rows, other))
    assert found[-1].split()[:2] == ["10", f"{column}:"]
    assert [words.split()[0] for words in found] == ["10"] * len(found)
    assert (len(found) > 1) == (column == "body")


def record_of(message: Any) -> Record:
    """Return the row of an ack as a record with another message."""
    row = next(row for row in gates_rows() if row.kind_number == 22)
    return replace(read_record(row), message=message, body=encode(message))


def test_the_comparer_finds_a_field_inside_and_its_presence() -> None:
    """An empty text is not an absent one, and what is deep in a message is named by its path."""
    row = next(row for row in gates_rows() if row.kind_number == 22)
    ack = SendAck.FromString(row.body)
    ack.mav_result = 0
    found = list(undecided([row], [record_of(ack)]))
    assert [words.split(": ")[0] for words in found] == [f"{row.seq} mav_result (presence)", f"{row.seq} body"]
    row = next(row for row in gates_rows() if row.kind_number == 20)
    order = OrderReceived.FromString(row.body)
    order.issuer.roles.append("x")
    changed = replace(read_record(row), message=order, body=encode(order))
    found = list(undecided([row], [changed]))
    assert found[0].startswith(f"{row.seq} issuer.roles (length): ")
    assert list(undecided([row], [])) == ["1 records, not 0"]


def test_the_text_of_a_state_is_all_of_it() -> None:
    """Another value in any table is another text; what has no place in a state is refused."""
    state = State()
    texts = {text_of_state(state)}
    for number, name in enumerate(name for name in State.__slots__ if name != "journal"):
        table = getattr(state, name)
        put = getattr(table, "put", None)
        table.set(number) if put is None else put(number, f"row {number}")
        texts.add(text_of_state(state))
    assert len(texts) == len(State.__slots__)
    assert text_of(("é", b"\x01", None, {1: True})) == "tuple('\\xe9', 0x01, None, {1: True})"
    for stranger in (0.5, {1}, [1], object()):
        with pytest.raises(TypeError, match="has no place in the state"):
            text_of(stranger)
    state.frame = stranger  # type: ignore[assignment]
    with pytest.raises(TypeError, match="frame is no table"):
        text_of_state(state)
