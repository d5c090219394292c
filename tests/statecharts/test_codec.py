"""The state as bytes: every table, both ways, and what is no row of a table."""

from __future__ import annotations

from typing import Any

import pytest
from google.protobuf.message import Message
from hypothesis import given, settings

from events.kinds import FAMILIES
from events.schema.orders_pb2 import OrderReceived
from statecharts import CHARTS, LOGIC, State, codec
from statecharts.codec import COLUMNS, DERIVED, LAYOUT, RowBroken, encode, layout_text, read_rows, software_digest
from statecharts.journal import Keyed
from tests.checks import check_equal
from tests.flights import Flight, received, story
from tests.random_flights import Draw, draws, fly


def scalar(value: Any) -> Any:
    """Return a value with its messages as bytes, for a comparison that leaves out nothing."""
    if isinstance(value, Message):
        return value.SerializeToString(deterministic=True)
    return tuple(map(scalar, value)) if isinstance(value, tuple) else value


def check_there_and_back(state: State) -> None:
    """Check that the bytes of every row are read as that row, of the same types, and written as the same bytes."""
    for column in COLUMNS:
        table = codec.table_of(state, column.name).whole()
        written = {encode(key): encode(row) for key, row in table.items()}
        found = dict(read_rows(column.name, written))
        check_equal(found, table)
        check_equal([scalar(row) for row in found.values()], [scalar(row) for row in table.values()])
        check_equal([type(row) for row in found.values()], [type(row) for row in table.values()])
        check_equal({encode(key): encode(row) for key, row in found.items()}, written)


def test_every_table_is_covered() -> None:
    """A table that somebody adds is in the layout, or is said to follow from others."""
    names = [column.name for column in COLUMNS]
    check_equal(names, sorted(names))
    check_equal(sorted([*names, *DERIVED, "journal"]), sorted(State.__slots__))
    for column in COLUMNS:
        keyed = isinstance(codec.table_of(State(), column.name), Keyed)
        check_equal((column.name, column.key is not None), (column.name, keyed))


def test_a_whole_flight_there_and_back() -> None:
    """Nearly every table has rows in it."""
    flight = story()
    check_there_and_back(flight.state)
    check_there_and_back(State())
    empty = [name for name in ("aims", "nonces", "objects", "orders", "pois") if not len(getattr(flight.state, name))]
    check_equal(empty, [])


@settings(max_examples=40, deadline=None)
@given(draws)
def test_any_flight_there_and_back(drawn: list[Draw]) -> None:
    """At its end, and before questions are closed."""
    check_there_and_back(fly(drawn, end=False).state)


def test_equal_rows_are_equal_bytes() -> None:
    """Whatever way they came: another flight, and a table in another order."""
    one, other = story().state, story().state
    for column in COLUMNS:
        rows = codec.table_of(one, column.name).whole(), codec.table_of(other, column.name).whole()
        check_equal([encode(row) for row in rows[0].values()], [encode(row) for row in rows[1].values()])
    check_equal(encode({"b": 1, "a": 2}), encode({"a": 2, "b": 1}))


def test_numbers_that_nobody_means_have_bytes_too() -> None:
    """A forged order may live longer than 64 bits say; a digest of it there must be, a snapshot need not."""
    flight = Flight()
    forever: OrderReceived = received("a1", life_ms=(1 << 64) - 1)
    flight.tell(forever)
    order = flight.state.orders["alpha/a1"]
    check_equal(order.expires_ns > 1 << 64, True)
    written = encode(order)
    check_equal(encode(order._replace(expires_ns=order.expires_ns + 1)) == written, False)
    check_equal(encode((1 << 64, 5)) == encode((1 << 64, "5")), False)
    check_equal(encode((1 << 64, -(1 << 63) - 1)) == encode(((1 << 64) - 1, -(1 << 63))), False)
    with pytest.raises(RowBroken, match="orders"):
        dict(read_rows("orders", {encode("alpha/a1"): written}))
    with pytest.raises(NotImplementedError, match="complex"):
        encode((1j,))


@pytest.mark.parametrize(
    ("name", "key", "row"),
    [
        ("aims", b"\xa1a", b""),
        ("aims", b"\xa1a", b"\xc0"),
        ("aims", b"\x01", encode(("idle", -1, "", 0, None))),
        ("aims", b"\xa1a", encode(("idle", -1, "", 0, None)) + b"\xc0"),
        ("order_seqs", b"\xc4\x01a", b"\xa1a"),
        ("next_seq", b"\x01", b"\x01"),
        ("origin", b"\xc0", encode((1, 2, b"\xff"))),
        ("origin", b"\xc0", encode((1, 2, 3))),
        ("frame", b"\xc0", encode((1, -1, (0, 0, 1, 0, 2), 9999, 1, b""))),
        ("frame", b"\xc0", encode((1, -1, (0, 0, 1, 0, 2), 1, 1, b"\xff"))),
    ],
)
def test_bytes_that_are_no_row(name: str, key: bytes, row: bytes) -> None:
    """Each is refused by its table's name."""
    with pytest.raises(RowBroken, match=name):
        dict(read_rows(name, {key: row}))


def test_the_layout_has_a_name_that_changes_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a digest means, and what a snapshot needs."""
    lines = layout_text().splitlines()
    check_equal((len(lines), len(LAYOUT)), (len(COLUMNS), 4))
    check_equal("selftests: int to Selftest(state str, effect_seq int)" in lines, True)
    check_equal("plans: int to MissionPlanned" in lines, True)
    check_equal("fences: int to Fence(inclusion bool, vertices tuple[tuple[int, int], ...])" in lines, True)
    check_equal("nonces: tuple[bytes, bytes] to int" in lines, True)
    check_equal("origin: none to Spot(east_mm int, north_mm int, place Place) or none" in lines, True)
    before = software_digest(LOGIC)
    check_equal(software_digest(LOGIC + 1) == before, False)
    monkeypatch.setattr(codec, "COLUMNS", COLUMNS[1:])
    check_equal(software_digest(LOGIC) == before, False)
    monkeypatch.setattr(codec, "COLUMNS", COLUMNS)
    monkeypatch.setattr(codec, "FAMILIES", FAMILIES[1:])
    check_equal(software_digest(LOGIC) == before, False)
    monkeypatch.undo()
    monkeypatch.setattr(codec, "CHARTS", CHARTS[1:])
    check_equal(software_digest(LOGIC) == before, False)
