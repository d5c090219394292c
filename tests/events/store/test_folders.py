"""The folders of flights: names, order, and what is no flight."""

from __future__ import annotations

from pathlib import Path

import pytest

from events.store import StoreFailed, StoreMissing, create_flight, flights_in, open_flight, read_flight
from tests.checks import check_equal
from tests.events.store.test_contract import SECRET, batch, check_holds


def test_flights_are_numbered_and_found_in_order(tmp_path: Path) -> None:
    """Oldest first, by number and not by name or time."""
    root = tmp_path / "node" / "flights"
    check_equal(flights_in(root), [])
    for number in (10, 2, 1, 100_000):
        flight, store = create_flight(root, number, bytes([number % 256]) * 16, SECRET)
        store.append(batch(0, number % 7))
        store.close()
        check_equal(flight.database.stat().st_mode & 0o077 & flight.folder.stat().st_mode, 0)
    names = [flight.folder.name for flight in flights_in(root)]
    check_equal(names, ["000001-01010101", "000002-02020202", "000010-0a0a0a0a", "100000-a0a0a0a0"])
    check_equal([flight.number for flight in flights_in(root)], [1, 2, 10, 100_000])


def test_what_is_no_flight_is_passed_over(tmp_path: Path) -> None:
    """Folders without a log, logs in folders of another name, and files."""
    flight, store = create_flight(tmp_path, 1, bytes(16), SECRET)
    store.close()
    for name in ("000002-00000000", "x000003-00000000", "000004-0000000g", "000005-000000000", "trash"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "other.db").write_bytes(b"")
    (tmp_path / "x000003-00000000" / "flight.db").write_bytes(b"")
    (tmp_path / "000006-00000000").write_bytes(b"")
    check_equal(flights_in(tmp_path), [flight])


def test_a_flight_is_opened_and_read(tmp_path: Path) -> None:
    """By its folder; what is not there is said."""
    flight, store = create_flight(tmp_path, 1, bytes(16), SECRET)
    store.append(batch(0, 2))
    reader = read_flight(flight.folder)
    check_holds(reader, batch(0, 2))
    reader.close()
    store.close()
    again = open_flight(flight)
    again.append(batch(2, 3))
    check_holds(again, batch(0, 3))
    again.close()
    with pytest.raises(StoreMissing, match="no flight at"):
        read_flight(tmp_path / "000009-00000000")


def test_a_flight_is_never_made_twice(tmp_path: Path) -> None:
    """Nor where no folder can be."""
    _flight, store = create_flight(tmp_path, 1, bytes(16), SECRET)
    store.close()
    with pytest.raises(StoreFailed, match="folder can't be made"):
        create_flight(tmp_path, 1, bytes(16), SECRET)
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(StoreFailed, match="folder can't be made"):
        create_flight(tmp_path / "file", 1, bytes(16), SECRET)
