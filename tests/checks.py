"""The doors that tests of the core go through. Each says what it found, so that a failure can be read by itself.

A chart is checked as a table (style 30): every line is an observation, the moves of the chart that it must lead to,
what the chart must say, and why. Between the lines the core's own deadline is checked too: time passes exactly when
the core asked for it, in a line `time`, and never unasked.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import product
from typing import Any

from events import Record
from events.schema.common_pb2 import Moved
from events.schema.orders_pb2 import SendAck
from statecharts import State
from statecharts.journal import Keyed
from statecharts.table import Answer, Chart, Row
from tests.flights import NS_PER_MS
from tests.flying import FLYING
from tests.stories import EFFECTS, Story, instance_words, words_of

SAYS = {
    "command": ("send_ack", *EFFECTS, "fly_to_place"),
    "camera": ("camera_taken",),
    "selftest": ("run_selftest",),
    "mission": tuple(kind for kind in FLYING if kind != "run_selftest"),
    "poi": ("poi_opened", "poi_joined", "poi_left", "sighting_muted", "item_ignored", "send_ack"),
    "scan": ("point_at_place", "point_at_angles", "release_pointing"),
    "map": ("sightings_classified",),
    "control": ("take_gimbal", "give_up_gimbal"),
    "aim": (),
    "health": ("send_ack",),
}
STATES: dict[str, Callable[[State, str], str]] = {
    "command": lambda state, key: state.orders[key].state,
    "camera": lambda state, key: state.cameras[key].state,
    "poi": lambda state, key: state.pois[key].state,
    "scan": lambda state, key: state.scans[key].state,
    "aim": lambda state, key: state.aims[key].state,
    "control": lambda state, key: state.controls[key].state,
    "health": lambda state, _: state.health.value,
    "selftest": lambda state, key: state.selftests[int(key)].state,
    "mission": lambda state, key: state.missions[int(key)].state,
}


def check_chart(chart: str, table: str, story: Story | None = None, **changes: Any) -> Story:
    """Tell a story line by line and compare what the chart does; return the story for more of it.

    Columns: at_s, observe, state (every move of the chart, "instance state"), say, and why where the table has it. How
    far an order got is told apart from the rest, in a column `rung` where the table has it.
    """
    story = story or Story(**changes)
    head, *lines = [[cell.strip() for cell in line.split("|")] for line in table.strip().splitlines()]
    for line in lines:
        cells = dict(zip(head, line, strict=True))
        at_ms = round(float(cells["at_s"]) * 1000)
        check_time(story, at_ms, cells["observe"])
        story.at(at_ms)
        records = story.tell(cells["observe"])
        found = cells | seen(story, chart, records)
        check_line([found[name] for name in head], [cells[name] for name in head])
        check_moves_are_the_state(story.flight.state, records)
    return story


def check_line(found: Sequence[str], expected: Sequence[str]) -> None:
    """Check one line of a table."""
    assert found == expected, "\nfound:    {}\nexpected: {}".format(" | ".join(found), " | ".join(expected))


def seen(story: Story, chart: str, records: Sequence[Record]) -> dict[str, str]:
    """Return what a step did, as the columns of a table say it."""
    messages = [record.message for record in records[1:] if not is_rung(record)]
    moves = [change for change in messages if isinstance(change, Moved) and change.chart == chart]
    acks = [message for message in messages if isinstance(message, SendAck) and "send_ack" in SAYS[chart]]
    heard = [record for record in records[1:] if record.kind.name in ("step_failed", *SAYS[chart])]
    said = [words_of(story, record) for record in heard if not is_rung(record)]
    rungs = [words_of(story, record) for record in heard if is_rung(record)]
    reasons = [change.because for change in moves] or [ack.detail for ack in acks]
    return {
        "state": ", ".join(f"{instance_words(story, change)} {change.to_state}" for change in moves) or "-",
        "say": "; ".join(said) or "-",
        "rung": "; ".join(rungs) or "-",
        "why": reasons[-1] if reasons else "-",
    }


def is_rung(record: Record) -> bool:
    """Whether a record tells how far an order got that nobody repeated."""
    ack = record.message
    return isinstance(ack, SendAck) and ack.stage != 0 and not ack.duplicate


def check_time(story: Story, at_ms: int, observe: str) -> None:
    """Check that the core asked for this moment where time passes, and for none before it elsewhere."""
    due_ms = None if story.flight.due is None else story.flight.due / NS_PER_MS
    if observe == "time":
        assert due_ms == at_ms, f"time passes at {at_ms} ms, but the core asked for {due_ms}"
    else:
        assert due_ms is None or due_ms >= at_ms, f"{observe} at {at_ms} ms: the core had asked for {due_ms}"


def check_moves_are_the_state(state: State, records: Iterable[Record]) -> None:
    """Check that the last move of each instance is where the state has it."""
    ends = {
        (record.message.chart, record.message.instance): record.message.to_state
        for record in records
        if isinstance(record.message, Moved)
    }
    assert {key: STATES[key[0]](state, key[1]) for key in ends} == ends


def dump(state: State) -> dict[str, Any]:
    """Return the whole state as plain values, for comparing two of them."""
    tables = {name: getattr(state, name) for name in state.__slots__ if name != "journal"}
    return {
        name: dict(table.items()) if isinstance(table, Keyed) else table.value for name, table in tables.items()
    } | {"places": _places(state)}


def _places(state: State) -> list[tuple[str, str]]:
    """Return the places that a spot keeps, which its comparison leaves out."""
    spots = [("origin", state.origin.value)]
    spots += [(f"object {number}", thing.spot) for number, thing in state.objects.items()]
    spots += [(key, poi.spot) for key, poi in state.pois.items()]
    spots += [(key, item.spot) for key, item in state.ignored.items()]
    return [(name, spot.place.mgrs) for name, spot in spots if spot is not None]


def check_same(one: State, other: State) -> None:
    """Check that two states are equal, table by table."""
    left, right = dump(one), dump(other)
    assert [name for name in left if left[name] != right[name]] == []


def check_exactly_one_row(chart: Chart[Any], excluded: Sequence[frozenset[tuple[str, bool]]] = ()) -> None:
    """Check that in every cell exactly one row is open, whatever the guards say.

    `excluded` holds the combinations of two guards that can't be, for one is the other's complement.
    """
    bare = with_plain_guards(chart)
    for state, trigger in product(chart.states, chart.triggers):
        if _is_ladder(chart.cell(state, trigger)):
            continue
        names = sorted({name_of(row) for row in chart.cell(state, trigger) if row.guard is not None})
        for values in product((False, True), repeat=len(names)):
            truth = dict(zip(names, values, strict=True))
            if any(impossible <= set(truth.items()) for impossible in excluded):
                continue
            row = bare.ask(state, trigger, truth)
            assert (row.source, row.trigger) == (state, trigger)
            assert (row.answer is Answer.MOVE) or row.target == state


def _is_ladder(rows: Sequence[Row[Any]]) -> bool:
    """Whether each row has a band of its own and the last is always open: then exactly one is, whatever guards say."""
    bands = [row.band for row in rows]
    return bool(rows) and len(set(bands)) == len(bands) and rows[-1].guard is None


def with_plain_guards(chart: Chart[Any]) -> Chart[dict[str, bool]]:
    """Return the chart with guards that read their answer from a table by their name."""
    rows = tuple(
        Row(row.source, row.trigger, row.answer, row.target, row.because, _reader(row), row.band) for row in chart.rows
    )
    return Chart(chart.name, chart.initial, chart.states, chart.terminal, chart.triggers, rows)


def name_of(row: Row[Any]) -> str:
    """Return the name of a row's guard."""
    return row.guard.__name__ if row.guard else ""


def _reader(row: Row[Any]) -> Callable[[dict[str, bool]], bool] | None:
    name = name_of(row)
    return (lambda truth: truth[name]) if name else None


def check_equal(found: object, expected: object) -> None:
    """Check that two values are equal."""
    assert found == expected, f"\nfound:    {found!r}\nexpected: {expected!r}"
