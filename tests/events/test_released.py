"""Every version of every event that was ever released can still be read, and says what it said."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from events import KINDS, Kind, encode, kind_named, read_record
from events.records import Stored
from tests.checks import check_equal
from tests.events import releasing
from tests.events.releasing import AT, RELEASED, SCHEMA, breaks, families, leaf_of, said, schema

FIXTURES = sorted(RELEASED.glob("*.v*.json"))
Schema = dict[str, dict[str, Any]]


def versions_without_fixture(kinds: tuple[Kind, ...]) -> list[str]:
    """Return the versions of the registry that have no fixture, and the fixtures that the registry does not know."""
    wanted = {f"{kind.name}.v{version}.json" for kind in kinds for version in range(1, kind.version + 1)}
    return sorted(wanted ^ {path.name for path in FIXTURES})


def check_fixture(fixture: dict[str, Any]) -> None:
    """Check that every sample is read, says what it said, has its leaf, and is what it would be encoded as."""
    kind = kind_named(fixture["kind"])
    check_equal((kind.number, bool(fixture["samples"])), (fixture["number"], True))
    for sample in fixture["samples"]:
        body = bytes.fromhex(sample["body"])
        record = read_record(Stored(0, -1, AT, fixture["number"], fixture["version"], body, b""))
        check_equal(said(record.message), sample["says"])
        check_equal(leaf_of(fixture["number"], fixture["version"], record.body).hex(), sample["leaf"])
        current = fixture["version"] == kind.version
        check_equal(encode(record.message) == body, current)


def test_every_version_has_its_fixture() -> None:
    """Counted against the registry, both ways: run `python -m tests.events.releasing` for a new one."""
    check_equal(versions_without_fixture(KINDS), [])
    later = tuple(replace(kind, version=kind.version + (kind.name == "moved")) for kind in KINDS)
    check_equal(versions_without_fixture(later), ["moved.v2.json"])
    check_equal(versions_without_fixture(KINDS[1:]), [f"{KINDS[0].name}.v1.json"])


@pytest.mark.parametrize("path", FIXTURES, ids=lambda path: path.stem)
def test_what_was_released_is_still_read(path: Path) -> None:
    """Original bytes, original leaf, and the meaning that it had."""
    check_fixture(json.loads(path.read_text("utf-8")))


@pytest.mark.parametrize(
    "spoil",
    [
        lambda fixture: fixture["samples"][0].update(body=fixture["samples"][0]["body"][:-2]),
        lambda fixture: fixture["samples"][0].update(leaf="00" * 32),
        lambda fixture: fixture["samples"][0]["says"].update(because="another"),
        lambda fixture: fixture.update(samples=[]),
        lambda fixture: fixture.update(number=fixture["number"] + 1),
    ],
)
def test_a_fixture_that_does_not_hold_is_found(spoil: Callable[[dict[str, Any]], object]) -> None:
    """The check itself can fail, in each of its parts."""
    fixture = json.loads((RELEASED / "moved.v1.json").read_text("utf-8"))
    spoil(fixture)
    with pytest.raises(Exception, match=r".+"):
        check_fixture(fixture)


def test_nothing_that_was_released_is_gone_or_means_something_else() -> None:
    """Fields and values of enumerations may only be added."""
    check_equal(breaks(json.loads(SCHEMA.read_text("utf-8")), schema()), [])


def test_a_breaking_change_is_found() -> None:
    """Removed, renumbered, renamed, of another type: each breaks logs that exist; added does not."""
    name = "autopilot.events.v1.Moved"
    was = schema()
    changes: tuple[Callable[[dict[str, Any]], object], ...] = (
        lambda fields: fields.pop("5"),
        lambda fields: fields.update({"6": fields.pop("5")}),
        lambda fields: fields.update({"5": fields["5"].replace("because", "reason")}),
        lambda fields: fields.update({"5": fields["5"].replace("type", "repeated type")}),
    )
    for change in changes:
        fields = dict(was[name])
        change(fields)
        assert [line.split(":")[0] for line in breaks(was, was | {name: fields})] == [f"{name} 5"]
    check_equal(breaks(was, was | {name: was[name] | {"9": "type 9 more"}}), [])
    check_equal(len(breaks(was, {key: fields for key, fields in was.items() if key != name})), len(was[name]))


def test_the_schema_that_is_written_down_is_whole() -> None:
    """It holds every kind and the parts and enumerations that they are made of."""
    written = json.loads(SCHEMA.read_text("utf-8"))
    assert {kind.message.DESCRIPTOR.full_name for kind in KINDS} <= written.keys()
    assert {
        "autopilot.events.v1.Place",
        "autopilot.events.v1.DiffKind",
        "autopilot.events.v1.CloseReason",
    } <= written.keys()
    check_equal({kind.message.DESCRIPTOR.file.name for kind in KINDS}, families())


def test_what_is_there_is_never_written_again(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The script only adds, and refuses where the schema breaks what was released."""
    monkeypatch.setattr(releasing, "RELEASED", tmp_path)
    monkeypatch.setattr(releasing, "SCHEMA", tmp_path / "schema.json")
    assert releasing.main() == 0
    made = {path.name: path.read_bytes() for path in tmp_path.glob("*.v1.json")}
    check_equal(len(made), len(KINDS))
    for path in made:
        (tmp_path / path).unlink()
    assert releasing.main() == 0
    check_equal({path.name: path.read_bytes() for path in tmp_path.glob("*.v1.json")}, made)
    moved = tmp_path / "moved.v1.json"
    moved.write_text("kept", "utf-8")
    assert releasing.main() == 0
    assert moved.read_text("utf-8") == "kept"
    broken: Schema = json.loads((tmp_path / "schema.json").read_text("utf-8"))
    broken["autopilot.events.v1.Moved"]["99"] = "type 9 gone"
    (tmp_path / "schema.json").write_text(json.dumps(broken), "utf-8")
    assert releasing.main() == 1
    assert "99" in (tmp_path / "schema.json").read_text("utf-8")
