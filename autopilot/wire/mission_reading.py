"""From bytes to a `Mission`, or to words that say what is wrong, where, and what to do about it.

Judged in this order, each only where the one before found nothing: size, text, JSON, major version, form. A key that
comes twice and a number that is not one (NaN, Infinity) are refused, because readers differ in what they make of them.
What is wrong on the ground (a polygon that crosses itself, a waypoint outside the fence) is not seen here.
"""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterable, Iterator
from functools import cache
from importlib import resources
from typing import Any, Never

from jsonschema import Draft7Validator
from jsonschema.exceptions import ValidationError

from autopilot.wire.mission import (
    SCHEMA_MAJOR,
    SCHEMA_VERSION,
    Coordinate,
    Geofence,
    Mission,
    MissionItem,
    MissionLimits,
    MissionProblem,
    MissionRefused,
    Vertex,
)

PROBLEMS_MAX = 20  # more of them help nobody
_QUOTED_MAX = 60  # characters of a value that is shown

# What to do about a thing of this name, by the last key of its path.
_FIXES = {
    "mission_id": "give a UUID like 8f14e45f-ceea-467f-a9f2-3c1d2b7a5e10",
    "id": "give a UUID like 8f14e45f-ceea-467f-a9f2-3c1d2b7a5e10",
    "schema_version": f"give x.y.z, such as {SCHEMA_VERSION}",
    "latitude": "give degrees from -90 to 90, north positive",
    "longitude": "give degrees from -180 to 180, east positive",
    "altitude_m": "give metres above home, from -500 to 10000",
    "cruise_speed_mps": "give metres a second, from 0.5 to 100",
    "at": 'give {"latitude": ..., "longitude": ..., "altitude_m": ...}',
    "return_point": 'give {"latitude": ..., "longitude": ..., "altitude_m": ...}',
    "region": "give at least 3 corners in order",
    "vertices": "give at least 3 corners in order",
    "items": "give a list with at least one item",
    "geofences": "give a list of geofences; an empty one for none",
    "target_classes": "give up to 64 names of classes",
}


class _Unreadable(ValueError):
    """The text is no JSON that every reader would read alike."""


def read_mission(data: bytes, limits: MissionLimits) -> Mission | MissionRefused:
    """Return the mission that these bytes are, or everything that is wrong with them. Never raises."""
    if len(data) > limits.bytes_max:
        return _refused(
            "$", f"has {len(data)} bytes, more than {limits.bytes_max}", "split the mission, or raise max_bytes"
        )
    try:
        tree = json.loads(data.decode(), object_pairs_hook=_once, parse_constant=_no_number)
    except UnicodeDecodeError as error:
        return _refused("$", f"is not UTF-8 at byte {error.start}", "save it as UTF-8")
    except RecursionError:
        return _refused("$", "is nested too deeply", "a mission has four levels at most")
    except _Unreadable as error:
        return _refused("$", str(error), "remove it")
    except ValueError as error:
        return _refused("$", f"is no JSON: {error}", "correct it there; an end that is missing was probably cut off")
    if (other := _other_major(tree)) is not None:
        return other
    problems = tuple(dict.fromkeys(_problems(tree, limits)))[:PROBLEMS_MAX]
    return MissionRefused(problems) if problems else _mission(tree)


@cache
def _validator() -> Draft7Validator:
    text = resources.files("autopilot.wire").joinpath("mission-schema.json").read_text(encoding="utf-8")
    return Draft7Validator(json.loads(text))


def _refused(path: str, reason: str, fix: str) -> MissionRefused:
    return MissionRefused((MissionProblem(path=path, reason=reason, fix=fix),))


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return the object; raise where a key comes twice, for readers differ in which one counts."""
    made = dict(pairs)
    if len(made) != len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise _Unreadable(f"has the key {_quoted(twice)} twice in one object")
    return made


def _no_number(word: str) -> Never:
    raise _Unreadable(f"has {word}, which is no number")


def _other_major(tree: Any) -> MissionRefused | None:
    """Say so where a mission is of another major version: nothing else about it can be judged."""
    version = tree.get("schema_version") if isinstance(tree, dict) else None
    major = version.partition(".")[0] if isinstance(version, str) else ""
    if not (major.isascii() and major.isdigit()) or major == str(SCHEMA_MAJOR):
        return None
    return _refused(
        "$.schema_version",
        f"is {_quoted(version)}, and this program reads version {SCHEMA_MAJOR}.x.y",
        f"have the mission written in version {SCHEMA_MAJOR}, or update this program",
    )


def _problems(tree: Any, limits: MissionLimits) -> Iterator[MissionProblem]:
    found = sorted(_validator().iter_errors(tree), key=lambda error: [str(part) for part in error.absolute_path])
    yield from (problem for error in found for problem in _in_words(error))
    if not found:
        yield from _too_many(tree, limits)
        yield from _same_ids(tree["items"])


def _too_many(tree: dict[str, Any], limits: MissionLimits) -> Iterator[MissionProblem]:
    """Yield the lists that are longer than this reader takes."""
    lists = [("$.items", tree["items"], limits.items_max), ("$.geofences", tree["geofences"], limits.fences_max)]
    lists += [
        (f"$.geofences[{index}].vertices", fence["vertices"], limits.vertices_max)
        for index, fence in enumerate(tree["geofences"])
    ]
    lists += [
        (f"$.items[{index}].region", item["region"], limits.vertices_max)
        for index, item in enumerate(tree["items"])
        if "region" in item
    ]
    for path, entries, most in lists:
        if len(entries) > most:
            yield MissionProblem(
                path=path, reason=f"has {len(entries)} entries, more than {most}", fix="split or simplify it"
            )


def _same_ids(items: list[dict[str, Any]]) -> Iterator[MissionProblem]:
    seen: dict[str, int] = {}
    for index, item in enumerate(items):
        first = seen.setdefault(item["id"].lower(), index)
        if first != index:
            yield MissionProblem(
                path=f"$.items[{index}].id", reason=f"is the id of items[{first}] too", fix="give each item its own"
            )


def _in_words(error: ValidationError) -> Iterator[MissionProblem]:
    """Yield what a breach of the schema means to whoever wrote the mission."""
    path = _path(error.absolute_path)
    match error.validator:
        case "additionalProperties":
            known = list(error.schema["properties"])
            for name in sorted(set(error.instance) - set(known)):
                near = difflib.get_close_matches(name, known, n=1)
                fix = f"did you mean {near[0]!r}?" if near else f"known here: {', '.join(known)}"
                yield MissionProblem(path=f"{path}.{_shown(name)}", reason="is not known here", fix=fix)
        case "required":
            # One error a missing name; the schema lists them all.
            name = next(name for name in error.validator_value if error.message.startswith(repr(name)))
            kind = error.instance.get("kind")
            needed = f" in a {kind}" if "kind" in error.instance and name in ("at", "region") else ""
            yield MissionProblem(path=f"{path}.{name}", reason=f"is missing{needed}", fix=_FIXES.get(name, "add it"))
        case "not":  # the schema's word for "never"
            yield MissionProblem(path=path, reason="does not belong to an item of this kind", fix="remove it")
        case _:
            yield MissionProblem(path=path, reason=_reason(error), fix=_fix(error))


def _reason(error: ValidationError) -> str:
    limit, given = error.validator_value, _quoted(error.instance)
    match error.validator:
        case "type":
            return f"is {given}, not {'an' if limit[0] in 'aeiou' else 'a'} {limit}"
        case "enum":
            return f"is {given}, not one of {', '.join(map(str, limit))}"
        case "minimum":
            return f"is {given}, less than {limit}"
        case "maximum":
            return f"is {given}, more than {limit}"
        case "minItems":
            return f"has {len(error.instance)} entries, fewer than {limit}"
        case "maxItems":
            return f"has {len(error.instance)} entries, more than {limit}"
    return f"is {given}, which has not the right form"


def _fix(error: ValidationError) -> str:
    names = [part for part in error.absolute_path if isinstance(part, str)]
    if error.validator == "enum":
        near = difflib.get_close_matches(str(error.instance), list(map(str, error.validator_value)), n=1)
        return f"did you mean {near[0]!r}?" if near else "take one of these"
    return _FIXES.get(names[-1] if names else "", "give what the schema says")


def _path(parts: Iterable[str | int]) -> str:
    return "$" + "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts)


def _quoted(value: Any) -> str:
    return _shown(json.dumps(value, default=str))


def _shown(text: str) -> str:
    """Return a text of theirs short enough to be shown, and without control characters."""
    plain = "".join(character if character.isprintable() else "?" for character in text)
    return plain if len(plain) <= _QUOTED_MAX else plain[:_QUOTED_MAX] + "..."


def _mission(tree: dict[str, Any]) -> Mission:
    return Mission(
        mission_id=tree["mission_id"].lower(),
        schema_version=tree["schema_version"],
        items=tuple(map(_item, tree["items"])),
        geofences=tuple(
            Geofence(kind=fence["kind"], vertices=_polygon(fence["vertices"])) for fence in tree["geofences"]
        ),
        return_point=_coordinate(tree["return_point"]),
    )


def _item(tree: dict[str, Any]) -> MissionItem:
    at, speed = tree.get("at"), tree.get("cruise_speed_mps")
    return MissionItem(
        id=tree["id"].lower(),
        kind=tree["kind"],
        at=None if at is None else _coordinate(at),
        region=_polygon(tree.get("region", ())),
        cruise_speed_mps=None if speed is None else float(speed),
        target_classes=tuple(tree.get("target_classes", ())),
    )


def _coordinate(tree: dict[str, Any]) -> Coordinate:
    return Coordinate(
        latitude=float(tree["latitude"]), longitude=float(tree["longitude"]), altitude_m=float(tree["altitude_m"])
    )


def _polygon(corners: Iterable[dict[str, Any]]) -> tuple[Vertex, ...]:
    return tuple(
        Vertex(
            latitude=float(corner["latitude"]),
            longitude=float(corner["longitude"]),
            altitude_m=None if corner.get("altitude_m") is None else float(corner["altitude_m"]),
        )
        for corner in corners
    )
