"""What a mission may look like, and what is said of one that does not: the path, the reason, the fix."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft7Validator

import autopilot.wire.mission_reading as reading
from autopilot.planning import mission_limits
from autopilot.ports.config import MissionSection
from autopilot.wire.mission import Coordinate, Geofence, Mission, MissionItem, MissionLimits, MissionRefused, Vertex
from autopilot.wire.mission_reading import read_mission
from tests.autopilot.planning.missions import AROUND, MISSION_ID, SQUARE, fence, region, tree, uid, waypoint
from tests.house import REPO

LIMITS = mission_limits(MissionSection())
SMALL = MissionLimits(bytes_max=100_000, items_max=3, fences_max=1, vertices_max=4)
SCHEMA = json.loads((REPO / "autopilot/wire/mission-schema.json").read_text(encoding="utf-8"))

Change = Callable[[dict[str, Any]], object]


def example() -> dict[str, Any]:
    """Return a mission with one of everything."""
    return tree(
        waypoint((20, 20), cruise_speed_mps=8),
        region(SQUARE, 50, target_classes=["animal"]),
        {"kind": "target_follow_breakpoint"},
        {"kind": "search", "at": waypoint((10, 10))["at"]},
        {"kind": "return"},
        fences=[fence(AROUND, "INCLUSION")],
    )


def check_refused(data: bytes, expected: str, limits: MissionLimits = LIMITS) -> None:
    """Check everything that is said, a line a problem: "path: reason; fix"."""
    found = read_mission(data, limits)
    assert isinstance(found, MissionRefused)
    assert str(found).splitlines() == [line.strip() for line in expected.strip().splitlines()]


def check_changed(change: Change, expected: str, limits: MissionLimits = LIMITS) -> None:
    """Check what is said of the example with one thing changed."""
    made = example()
    change(made)
    check_refused(json.dumps(made).encode(), expected, limits)


def test_the_schema_is_one() -> None:
    """It is a schema of draft 7, and forbids what it does not know everywhere."""
    Draft7Validator.check_schema(SCHEMA)
    objects = [SCHEMA, *(part for part in SCHEMA["definitions"].values() if part.get("type") == "object")]
    assert [part.get("additionalProperties") for part in objects] == [False] * len(objects)
    assert len(objects) == 5


def test_a_mission_is_read() -> None:
    """Into plain values, ids in lower case, numbers as floats."""
    made = tree(waypoint((0, 0), 40, cruise_speed_mps=8, target_classes=["boat"]))
    made["mission_id"] = MISSION_ID.upper()
    made["items"][0] |= {"id": uid(10).upper(), "at": {"latitude": 1, "longitude": -2, "altitude_m": 3}}
    made["geofences"] = [{"kind": "EXCLUSION", "vertices": [{"latitude": n, "longitude": n} for n in range(3)]}]
    made["return_point"] = {"latitude": 4, "longitude": 5, "altitude_m": 6}
    item = MissionItem(
        id=uid(10),
        kind="waypoint",
        at=Coordinate(latitude=1.0, longitude=-2.0, altitude_m=3.0),
        cruise_speed_mps=8.0,
        target_classes=("boat",),
    )
    corners = tuple(Vertex(latitude=float(n), longitude=float(n)) for n in range(3))
    assert read_mission(json.dumps(made).encode(), LIMITS) == Mission(
        mission_id=MISSION_ID,
        schema_version="1.0.0",
        items=(item,),
        geofences=(Geofence(kind="EXCLUSION", vertices=corners),),
        return_point=Coordinate(latitude=4.0, longitude=5.0, altitude_m=6.0),
    )


def test_a_region_keeps_its_heights() -> None:
    """Corners with a height have it, those without have none."""
    for height_m in (None, 50):
        mission = read_mission(json.dumps(tree(region(SQUARE, height_m))).encode(), LIMITS)
        assert isinstance(mission, Mission)
        assert {corner.altitude_m for corner in mission.items[0].region} == {height_m}


@pytest.mark.parametrize("version", ["1.0.0", "1.7.23"])
def test_minor_versions_are_read(version: str) -> None:
    """As long as nothing unknown is in them."""
    assert isinstance(read_mission(json.dumps(example() | {"schema_version": version}).encode(), LIMITS), Mission)


UUID = "give a UUID like 8f14e45f-ceea-467f-a9f2-3c1d2b7a5e10"
OTHER_MAJOR = (
    '$.schema_version: is "{}", and this program reads version 1.x.y; '
    "have the mission written in version 1, or update this program"
)
PLACE = 'give {"latitude": ..., "longitude": ..., "altitude_m": ...}'


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda it: it.pop("items"), "$.items: is missing; give a list with at least one item"),
        (lambda it: it.pop("geofences"), "$.geofences: is missing; give a list of geofences; an empty one for none"),
        (lambda it: it.pop("return_point"), f"$.return_point: is missing; {PLACE}"),
        (lambda it: it.pop("schema_version"), "$.schema_version: is missing; give x.y.z, such as 1.0.0"),
        (lambda it: it.update(items=[]), "$.items: has 0 entries, fewer than 1; give a list with at least one item"),
        (lambda it: it.update(mission_id="x"), f'$.mission_id: is "x", which has not the right form; {UUID}'),
        (
            lambda it: it.update(mission_id=MISSION_ID + "\n"),
            f'$.mission_id: is "{MISSION_ID}\\n", which has not the right form; {UUID}',
        ),
        (
            lambda it: it.update(schema_version="1.0"),
            '$.schema_version: is "1.0", which has not the right form; give x.y.z, such as 1.0.0',
        ),
        (
            lambda it: it.update(schema_version="1.0.0\n"),
            '$.schema_version: is "1.0.0\\n", which has not the right form; give x.y.z, such as 1.0.0',
        ),
        (lambda it: it.update(schema_version=1), "$.schema_version: is 1, not a string; give x.y.z, such as 1.0.0"),
        (
            lambda it: it.update(schema_version="2.0.0", items=3),
            OTHER_MAJOR.format("2.0.0"),
        ),
        (
            lambda it: it.update(schema_version="10.0.0"),
            OTHER_MAJOR.format("10.0.0"),
        ),
        (lambda it: it.update(itmes=[]), "$.itmes: is not known here; did you mean 'items'?"),
        (
            lambda it: it.update(zzz=1),
            "$.zzz: is not known here; known here: schema_version, mission_id, items, geofences, return_point",
        ),
        (lambda it: it["items"][0].pop("at"), f"$.items[0].at: is missing in a waypoint; {PLACE}"),
        (lambda it: it["items"][3].pop("at"), f"$.items[3].at: is missing in a search; {PLACE}"),
        (
            lambda it: it["items"][1].pop("region"),
            "$.items[1].region: is missing in a region_search; give at least 3 corners in order",
        ),
        (lambda it: it["items"][0].pop("id"), f"$.items[0].id: is missing; {UUID}"),
        (
            lambda it: it["items"][0].update(kind="waypiont"),
            '$.items[0].kind: is "waypiont", not one of waypoint, search, region_search, return, '
            "target_follow_breakpoint; did you mean 'waypoint'?",
        ),
        (
            lambda it: it["items"][0].update(region=it["items"][1]["region"]),
            "$.items[0].region: does not belong to an item of this kind; remove it",
        ),
        (
            lambda it: it["items"][1].update(at=it["items"][0]["at"]),
            "$.items[1].at: does not belong to an item of this kind; remove it",
        ),
        (
            lambda it: it["items"][2].update(at=it["items"][0]["at"]),
            "$.items[2].at: does not belong to an item of this kind; remove it",
        ),
        (
            lambda it: it["items"][2].update(cruise_speed_mps=3),
            "$.items[2].cruise_speed_mps: does not belong to an item of this kind; remove it",
        ),
        (
            lambda it: it["items"][4].update(target_classes=[]),
            "$.items[4].target_classes: does not belong to an item of this kind; remove it",
        ),
        (
            lambda it: it["items"][0]["at"].update(latitude=90.1),
            "$.items[0].at.latitude: is 90.1, more than 90; give degrees from -90 to 90, north positive",
        ),
        (
            lambda it: it["items"][0]["at"].update(longitude=-181),
            "$.items[0].at.longitude: is -181, less than -180; give degrees from -180 to 180, east positive",
        ),
        (
            lambda it: it["items"][0]["at"].update(altitude_m=True),
            "$.items[0].at.altitude_m: is true, not a number; give metres above home, from -500 to 10000",
        ),
        (
            lambda it: it["items"][0].update(cruise_speed_mps=0),
            "$.items[0].cruise_speed_mps: is 0, less than 0.5; give metres a second, from 0.5 to 100",
        ),
        (
            lambda it: it["items"][1]["region"].__delitem__(slice(2)),
            "$.items[1].region: has 2 entries, fewer than 3; give at least 3 corners in order",
        ),
        (
            lambda it: it["geofences"][0]["vertices"].__delitem__(slice(2)),
            "$.geofences[0].vertices: has 2 entries, fewer than 3; give at least 3 corners in order",
        ),
        (
            lambda it: it["geofences"][0].update(kind="exclusion"),
            '$.geofences[0].kind: is "exclusion", not one of INCLUSION, EXCLUSION; take one of these',
        ),
        (
            lambda it: it["items"][3].update(id=uid(0)),
            "$.items[3].id: is the id of items[0] too; give each item its own",
        ),
    ],
)
def test_what_is_wrong_has_its_path(change: Change, expected: str) -> None:
    """Each rule of the schema, in words."""
    check_changed(change, expected)


def test_everything_is_said_at_once() -> None:
    """But not more than anybody reads."""

    def change(made: dict[str, Any]) -> None:
        made["items"][0]["at"].update(latitude=91, longitude=181)

    check_changed(
        change,
        """$.items[0].at.latitude: is 91, more than 90; give degrees from -90 to 90, north positive
        $.items[0].at.longitude: is 181, more than 180; give degrees from -180 to 180, east positive""",
    )
    found = read_mission(json.dumps(example() | {"items": [{}] * 50}).encode(), LIMITS)
    assert isinstance(found, MissionRefused)
    assert len(found.problems) == reading.PROBLEMS_MAX


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda it: None, "$.items: has 5 entries, more than 3; split or simplify it"),
        (
            lambda it: it.update(items=it["items"][:3], geofences=it["geofences"] * 2),
            "$.geofences: has 2 entries, more than 1; split or simplify it",
        ),
        (
            lambda it: (
                it.update(items=it["items"][:3]),
                it["items"][1]["region"].append({"latitude": 1, "longitude": 1}),
            ),
            "$.items[1].region: has 5 entries, more than 4; split or simplify it",
        ),
        (
            lambda it: (
                it.update(items=it["items"][:3]),
                it["geofences"][0]["vertices"].append({"latitude": 1, "longitude": 1}),
            ),
            "$.geofences[0].vertices: has 5 entries, more than 4; split or simplify it",
        ),
    ],
)
def test_limits(change: Change, expected: str) -> None:
    """Lists are as long as the configuration lets them be; at the limit they are taken."""
    check_changed(change, expected, SMALL)
    made = example()
    made["items"] = made["items"][:3]
    assert isinstance(read_mission(json.dumps(made).encode(), SMALL), Mission)


def test_size() -> None:
    """One byte too many is too many, and nothing of it is parsed."""
    data = json.dumps(example()).encode()
    exact = MissionLimits(bytes_max=len(data), items_max=9, fences_max=9, vertices_max=9)
    assert isinstance(read_mission(data, exact), Mission)
    check_refused(
        data + b"{",
        f"$: has {len(data) + 1} bytes, more than {len(data)}; split the mission, or raise max_bytes",
        exact,
    )


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b'{"a": 1, "b": {"c": 1, "c": 2}}', '$: has the key "c" twice in one object; remove it'),
        (b'{"a": NaN}', "$: has NaN, which is no number; remove it"),
        (b'{"a": -Infinity}', "$: has -Infinity, which is no number; remove it"),
        (b'{"a": "\xff"}', "$: is not UTF-8 at byte 7; save it as UTF-8"),
        (b"[" * 100_000, "$: is nested too deeply; a mission has four levels at most"),
        (b"[]", "$: is [], not an object; give what the schema says"),
        (
            b'{"a": ',
            "$: is no JSON: Expecting value: line 1 column 7 (char 6); "
            "correct it there; an end that is missing was probably cut off",
        ),
    ],
)
def test_text_that_readers_would_read_differently(data: bytes, expected: str) -> None:
    """Refused before the schema sees it."""
    check_refused(data, expected)


def test_a_number_that_becomes_infinite_is_out_of_range() -> None:
    """JSON has no word for infinity, but Python reads 1e999 as one."""
    data = json.dumps(example()).encode().replace(b'"cruise_speed_mps": 8', b'"cruise_speed_mps": 1e999')
    found = read_mission(data, LIMITS)
    assert isinstance(found, MissionRefused)
    assert found.problems[0].path == "$.items[0].cruise_speed_mps"


def test_what_is_theirs_is_shown_short_and_printable() -> None:
    """A name of theirs can neither flood nor steer a terminal."""
    found = read_mission(json.dumps(example() | {"\x1b[2J" + "x" * 500: 1}).encode(), LIMITS)
    assert isinstance(found, MissionRefused)
    assert found.problems[0].path == "$.?[2J" + "x" * 56 + "..."


@given(st.binary(max_size=200) | st.text(max_size=100).map(str.encode))
def test_any_bytes_are_a_mission_or_refused(data: bytes) -> None:
    """Nothing raises."""
    assert isinstance(read_mission(data, LIMITS), MissionRefused)


JUNK = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


@given(st.data())
def test_any_part_replaced_is_read_or_refused(data: st.DataObject) -> None:
    """Whatever stands in the place of any part, nothing raises."""
    made: Any = example()
    here = made
    for _ in range(data.draw(st.integers(0, 4))):
        keys = list(here) if isinstance(here, dict) else list(range(len(here)))
        deeper = [key for key in keys if isinstance(here[key], dict | list) and here[key]]
        if not deeper:
            break
        here = here[data.draw(st.sampled_from(deeper))]
    key = data.draw(st.sampled_from(list(here) if isinstance(here, dict) else list(range(len(here)))))
    here[key] = data.draw(JUNK)
    assert isinstance(read_mission(json.dumps(made).encode(), LIMITS), Mission | MissionRefused)


@pytest.mark.parametrize("file", sorted((REPO / "examples" / "missions").glob("*.json")), ids=lambda file: file.stem)
def test_examples_are_missions(file: Path) -> None:
    """What is shown can be used."""
    assert isinstance(read_mission(file.read_bytes(), LIMITS), Mission)
