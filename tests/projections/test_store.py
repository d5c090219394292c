"""projections.db: disposable, in step, and honest about whose rows it holds."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings

from events.store import MemoryStore
from projections import objects, store
from projections.rows import Projection
from projections.store import Projector, Unreadable, read_status
from tests.flights import FLIGHT_ID, SECRET, Flight, detection, frame, resealed, story
from tests.random_flights import Draw, draws, fly

TABLES = ("audit", "ignored", "objects", "observations", "pois", "position", "status")


def rows_in(path: Path) -> dict[str, list[tuple[Any, ...]]]:
    """Return every row of every table."""
    connection = sqlite3.connect(path)
    try:
        return {name: sorted(connection.execute(f"SELECT * FROM {name}"), key=repr) for name in TABLES}
    finally:
        connection.close()


def kept(path: Path, *stores: MemoryStore) -> dict[str, list[tuple[Any, ...]]]:
    """Return the rows after one projector has caught up with each store."""
    projector = Projector(path)
    for one in stores:
        projector.catch_up(one)
    projector.close()
    return rows_in(path)


def check_same(found: dict[str, list[tuple[Any, ...]]], expected: dict[str, list[tuple[Any, ...]]]) -> None:
    """Check that two databases hold the same rows."""
    assert sorted(found) == sorted(expected)
    for name, rows in expected.items():
        assert (name, found[name]) == (name, rows)


def memory(flight: Flight) -> MemoryStore:
    """Return the store of a flight in memory."""
    return resealed(flight.records)


def test_deleted_it_comes_back_the_same(tmp_path: Path) -> None:
    """And nothing is read twice."""
    flight = story()
    projector = Projector(tmp_path / "one.db")
    assert [projector.catch_up(memory(flight)), projector.catch_up(memory(flight))] == [121, 0]
    projector.close()
    check_same(kept(tmp_path / "two.db", memory(flight)), rows_in(tmp_path / "one.db"))
    assert {name: len(rows) for name, rows in rows_in(tmp_path / "one.db").items()} == {
        "audit": 17,
        "ignored": 1,
        "objects": 2,
        "observations": 3,
        "pois": 2,
        "position": 4,
        "status": 1,
    }


@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(draws)
def test_incremental_is_the_same_as_rebuilt(tmp_path: Path, drawn: list[Draw]) -> None:
    """Whatever the portions, also over a restart of the projector in the middle."""
    for old in tmp_path.iterdir():
        old.unlink()
    flight = fly(drawn)
    portions = [resealed(flight.records[:end]) for end in (3, len(flight.records) // 2, len(flight.records))]
    expected = kept(tmp_path / "rebuilt.db", portions[-1])
    check_same(kept(tmp_path / "incremental.db", *portions), expected)
    kept(tmp_path / "restarted.db", portions[1])
    check_same(kept(tmp_path / "restarted.db", portions[-1]), expected)


def test_small_transactions_change_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where a restart falls into the middle of one."""
    flight = story()
    expected = kept(tmp_path / "large.db", memory(flight))
    monkeypatch.setattr(store, "RECORDS_A_TRANSACTION", 7)
    check_same(kept(tmp_path / "small.db", memory(flight)), expected)
    kept(tmp_path / "cut.db", resealed(flight.records[:60]))
    check_same(kept(tmp_path / "cut.db", memory(flight)), expected)


def test_what_was_kept_is_not_written_again(tmp_path: Path) -> None:
    """Nor held: observations leave the memory once they are in the database."""
    projector = Projector(tmp_path / "p.db")
    projector.catch_up(memory(story()))
    held = projector._states["objects"]
    projector.close()
    assert (held.objects.changed(), held.observations.changed()) == ([], [])
    assert (len(held.objects), len(held.observations)) == (2, 0)


def test_a_place_where_nothing_can_be_made_is_an_error(tmp_path: Path) -> None:
    """Only what is no database is thrown away."""
    with pytest.raises(sqlite3.OperationalError, match="unable to open"):
        Projector(tmp_path)
    assert tmp_path.is_dir()


def test_another_flight_begins_again(tmp_path: Path) -> None:
    """Rows of two flights are never mixed."""
    flight, other = story(), MemoryStore(b"another flight!!", SECRET)
    other.append(Flight().records)
    path = tmp_path / "p.db"
    check_same(kept(path, memory(flight), other), kept(tmp_path / "only.db", other))
    check_same(kept(path, memory(flight)), kept(tmp_path / "fresh.db", memory(flight)))


def test_another_history_of_the_same_flight_begins_again(tmp_path: Path) -> None:
    """A log that was cut and went on otherwise is not the one the rows are of."""
    one, other = Flight(), Flight()
    for number in range(4):
        one.tell(frame(number, detection(1_000, 1_000)), 100)
        other.tell(frame(number, detection(80_000, 0, "car")), 100)
    kept(tmp_path / "p.db", memory(one))
    check_same(kept(tmp_path / "p.db", memory(other)), kept(tmp_path / "fresh.db", memory(other)))
    shorter = Flight()
    check_same(kept(tmp_path / "q.db", memory(one), memory(shorter)), kept(tmp_path / "r.db", memory(shorter)))


def test_another_version_of_a_fold_begins_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Old rows of that fold go; a row that only the old version made does not stay."""
    flight, path = story(), tmp_path / "p.db"
    kept(path, memory(flight))
    connection = sqlite3.connect(path)
    connection.execute("INSERT INTO objects (number, class_name) VALUES (99, 'of an older version')")
    connection.commit()
    connection.close()
    assert len(kept(path, memory(flight))["objects"]) == 3
    newer = Projection("objects", objects.PROJECTION.version + 1, objects.start, objects.apply, objects.tables)
    changed = tuple(newer if one.name == "objects" else one for one in store.PROJECTIONS)
    monkeypatch.setattr(store, "PROJECTIONS", changed)
    assert len(kept(path, memory(flight))["objects"]) == 2


def test_what_is_no_database_is_made_anew(tmp_path: Path) -> None:
    """It is disposable, so damage costs nothing."""
    path = tmp_path / "p.db"
    path.write_bytes(b"this is no database, but long enough to be read as one" * 40)
    check_same(kept(path, memory(story())), kept(tmp_path / "fresh.db", memory(story())))


def test_a_database_of_another_form_is_made_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables of an older form go."""
    path = tmp_path / "p.db"
    kept(path, memory(story()))
    monkeypatch.setattr(store, "FORMAT", 2)
    projector = Projector(path)
    assert projector.catch_up(memory(story())) == 121
    projector.close()


def test_rows_and_position_move_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A write that fails takes back everything of its transaction; the next one makes it good."""
    flight, path = story(), tmp_path / "p.db"
    projector = Projector(path)
    projector.catch_up(resealed(flight.records[:60]))
    before = rows_in(path)
    with monkeypatch.context() as patch:
        patch.setattr(projector, "_keep", _failing(projector))
        with pytest.raises(sqlite3.OperationalError):
            projector.catch_up(memory(flight))
    check_same(rows_in(path), before)
    flight.tell(frame(99, detection(1, 1)))
    projector.catch_up(memory(flight))
    projector.close()
    check_same(rows_in(path), kept(tmp_path / "fresh.db", memory(flight)))


def _failing(projector: Projector) -> Any:
    keep = projector._keep

    def fail(one: Projection, last: Any) -> None:
        keep(one, last)
        if one.name == "pois":
            raise sqlite3.OperationalError("disk I/O error")

    return fail


def test_status_is_read_back(tmp_path: Path) -> None:
    """As the fold made it."""
    kept(tmp_path / "p.db", memory(story()))
    status = read_status(tmp_path / "p.db")
    assert (status["head_seq"], status["node"], status["flight_id"]) == (120, "node-1", FLIGHT_ID.hex())


def test_no_status_is_said_so(tmp_path: Path) -> None:
    """No file, no database, no rows: three different sentences, and no file is made."""
    with pytest.raises(Unreadable, match="has the node run"):
        read_status(tmp_path / "none.db")
    assert not (tmp_path / "none.db").exists()
    (tmp_path / "bad.db").write_bytes(b"no database at all, however long it may be" * 40)
    with pytest.raises(Unreadable, match="can't be read"):
        read_status(tmp_path / "bad.db")
    kept(tmp_path / "empty.db", MemoryStore(FLIGHT_ID, SECRET))
    with pytest.raises(Unreadable, match="no status yet"):
        read_status(tmp_path / "empty.db")
