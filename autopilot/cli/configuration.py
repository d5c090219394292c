"""Reads the configuration: finds the files, merges them, judges the whole once.

The file is the one that was asked for, else `AUTOPILOT_CONFIG`, else /etc/autopilot/config.toml;
over it lie the files of `config.d` beside it, in the order of their names (tables are merged,
anything else is replaced). A relative path in a file starts at the folder of that file.

Everything that is wrong is found at once and told with file, line, key and what to do. What the
keys mean is `autopilot.ports.config`'s business.
"""

from __future__ import annotations

import difflib
import json
import os
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from autopilot.cli.toml_lines import Key, lines_of
from autopilot.ports.config import Config, Section

DEFAULT_PATH = "/etc/autopilot/config.toml"
VARIABLE = "AUTOPILOT_CONFIG"
EX_CONFIG = 78

OWN_PATHS: tuple[Key, ...] = (
    ("node", "keys"),
    ("node", "flights"),
    ("node", "projections"),
    ("vehicle", "signing_key_file"),
)
INPUT_PATHS: tuple[Key, ...] = (("eyes", "path"), ("eyes", "model"), ("mission", "file"), ("mission", "token_file"))

S = TypeVar("S", bound=Section)
Tables = dict[str, Any]
Places = dict[Key, tuple[str, int]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """One thing that is wrong, and where."""

    file: str
    line: int  # from 1; 0 where no line is to blame
    key: str  # dotted; empty where no key is to blame
    reason: str

    def __str__(self) -> str:
        where = f"{self.file}:{self.line}" if self.line else self.file
        return f"{where}: {self.key}: {self.reason}" if self.key else f"{where}: {self.reason}"


class ConfigurationError(Exception):
    """The configuration cannot be used (exit code 78); `problems` has everything that is wrong."""

    exit_code = EX_CONFIG

    def __init__(self, problems: tuple[Problem, ...]) -> None:
        super().__init__("\n".join(map(str, problems)))
        self.problems = problems


def load(path: str | None, environ: Mapping[str, str], *, inputs: bool = True) -> Config:
    """Return the configuration. Raises `ConfigurationError` with every problem there is.

    `inputs`: also see that the files it reads from (video, model) exist; switch it off to judge a
    configuration that is meant for another machine.
    """
    tables: Tables = {}
    places: Places = {}
    problems: list[Problem] = []
    for file in _files(path, environ):
        try:
            here, lines = _read(file)
        except ConfigurationError as error:
            problems += error.problems
            continue
        tables = _merged(tables, here)
        places |= {key: (str(file), line) for key, line in lines.items()}
    if problems:
        raise ConfigurationError(tuple(problems))
    main = str(_main_file(path, environ))
    config = _judged(Config, tables, places, main)
    problems = list(_absent(config, places, main)) if inputs else []
    if problems:
        raise ConfigurationError(tuple(problems))
    return config


def load_as(model: type[S], path: str, *, paths: Sequence[Key], inputs: Sequence[Key] = ()) -> S:
    """Return the configuration of another part of the house, from one file. Raises `ConfigurationError`.

    `paths`: keys whose relative values start at the file's folder; `inputs`: those that must exist.
    """
    tables, lines = _read(Path(path), paths)
    places = {key: (path, line) for key, line in lines.items()}
    config = _judged(model, tables, places, path)
    wanted = [(key, value) for key in inputs if isinstance(value := _at(tables, key), str)]
    absent = [(key, value) for key, value in wanted if not os.path.exists(value)]
    if absent:
        where = [(*places.get(key, (path, 0)), key, value) for key, value in absent]
        raise ConfigurationError(
            tuple(
                Problem(file=file, line=line, key=".".join(key), reason=f"there is no {value}")
                for file, line, key, value in where
            )
        )
    return config


def _judged(model: type[S], tables: Tables, places: Places, main: str) -> S:
    """Return the tables as `model`. Raises `ConfigurationError` with every problem there is."""
    try:
        # Judged as JSON, strictly: a list may be a tuple and 1 may be 1.0, but "1" is no number.
        return model.model_validate_json(json.dumps(tables, default=str), strict=True)
    except ValidationError as error:
        found = [_problem(detail, places, main, model) for detail in error.errors()]
        raise ConfigurationError(tuple(sorted(found, key=lambda problem: (problem.file, problem.line)))) from None


def _at(tables: Tables, key: Key) -> Any:
    """Return the value of a dotted key; None where there is none."""
    value: Any = tables
    for part in key:
        value = value.get(part) if isinstance(value, dict) else None
    return value


def _main_file(path: str | None, environ: Mapping[str, str]) -> Path:
    """Return the file that is meant: flag, then environment, then the usual place."""
    return Path(path or environ.get(VARIABLE) or DEFAULT_PATH)


def _files(path: str | None, environ: Mapping[str, str]) -> list[Path]:
    """Return the main file and what lies over it."""
    main = _main_file(path, environ)
    return [main, *sorted(main.parent.glob("config.d/*.toml"))]


def _read(file: Path, paths: Sequence[Key] = OWN_PATHS + INPUT_PATHS) -> tuple[Tables, dict[Key, int]]:
    """Return a file's tables, its paths made absolute, and the line of each key."""
    try:
        text = file.read_bytes().decode()
        tables = tomllib.loads(text)
    except FileNotFoundError:
        raise _failed(file, 0, f"there is no such file; name one with --config FILE or {VARIABLE}") from None
    except OSError as error:
        raise _failed(file, 0, f"cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise _failed(file, error.object.count(b"\n", 0, error.start) + 1, "is not UTF-8 here") from None
    except tomllib.TOMLDecodeError as error:
        raise _syntax(file, str(error), text) from None
    for key in paths:
        table, value = _at(tables, key[:-1]), _at(tables, key)
        if isinstance(table, dict) and isinstance(value, str) and value:
            table[key[-1]] = os.path.normpath(file.absolute().parent / value)
    return tables, lines_of(text)


def _failed(file: Path, line: int, reason: str) -> ConfigurationError:
    """Return the error of one problem that no key is to blame for."""
    return ConfigurationError((Problem(file=str(file), line=line, key="", reason=reason),))


def _syntax(file: Path, words: str, text: str) -> ConfigurationError:
    """Return what tomllib says, with the line where it belongs."""
    found = re.search(r" \((?:at line (\d+), column \d+|at end of document)\)$", words)
    if found is None:
        return _failed(file, 0, f"is no TOML: {words}")
    line = int(found[1]) if found[1] else text.rstrip("\n").count("\n") + 1
    return _failed(file, line, f"is no TOML: {words[: found.start()]}")


def _merged(under: Tables, over: Tables) -> Tables:
    """Return both tables in one; where both have a value, `over`'s."""
    merged = dict(under)
    for key, value in over.items():
        below = merged.get(key)
        both = isinstance(below, dict) and isinstance(value, dict)
        merged[key] = _merged(below, value) if both else value  # type: ignore[arg-type]
    return merged


def _absent(config: Config, places: Places, main: str) -> Iterator[Problem]:
    """Yield the inputs that are configured and not there."""
    for key in _wanted(config):
        path = getattr(getattr(config, key[0]), key[1])
        if not os.path.isfile(path):
            file, line = places.get(key, (main, 0))
            yield Problem(file=file, line=line, key=".".join(key), reason=f"no file {path}")


def _wanted(config: Config) -> list[Key]:
    """Return the keys whose files this configuration reads."""
    eyes: dict[str, list[Key]] = {
        "file": [("eyes", "path"), ("eyes", "model")],
        "device": [("eyes", "model")],
    }
    others: list[Key] = [("mission", "file"), ("mission", "token_file"), ("vehicle", "signing_key_file")]
    return eyes.get(config.eyes.source, []) + [key for key in others if getattr(getattr(config, key[0]), key[1])]


def _problem(detail: ErrorDetails, places: Places, main: str, model: type[BaseModel]) -> Problem:
    """Return what pydantic found in words, at the line of the key or of the nearest table around it."""
    key = tuple(str(part) for part in detail["loc"])
    if detail["type"] == "value_error":  # a table judged as a whole; its words begin with the key
        key = (*key, *detail["msg"].removeprefix("Value error, ").split()[0].split("."))
    file, line = next((places[key[:n]] for n in range(len(key), 0, -1) if key[:n] in places), (main, 0))
    named = ".".join(part for part in key if not part.isdigit())
    return Problem(file=file, line=line, key=named, reason=_reason(detail, key, model))


def _reason(detail: ErrorDetails, key: Key, model: type[BaseModel]) -> str:
    """Return what is wrong with a key, in words."""
    match detail["type"]:
        case "extra_forbidden":
            return f"is not a key of the configuration{_suggestion(key, model)}"
        case "missing":
            return "has too few values" if key[-1].isdigit() else "is missing"
        case "value_error":
            return detail["msg"].removeprefix("Value error, ")
    told = detail["msg"].removeprefix("Input ").replace("should", "must", 1)
    given = detail["input"]
    return f"{told}, not {json.dumps(given)}" if isinstance(given, bool | int | float | str) else told


def _suggestion(key: Key, model: type[BaseModel]) -> str:
    """Return what was probably meant: a like name in this table, or the same name in another."""
    siblings = _fields(model, key[:-1])
    near = difflib.get_close_matches(key[-1], siblings, n=1, cutoff=0.6)
    if near:
        return f'; did you mean "{near[0]}"?'
    tables = [name for name, field in model.model_fields.items() if _is_table(field.annotation)]
    homes = [name for name in tables if key[-1] in _fields(model, (name,))]
    if homes:
        return "; it belongs to " + " or ".join(f"[{name}]" for name in homes)
    return f"; known here: {', '.join(siblings)}"


def _fields(model: type[BaseModel], key: Key) -> list[str]:
    """Return the keys that a table may have; none where it is no table."""
    named = False  # a table of tables: the next part is a name that the file gives
    for part in key:
        if named:
            named = False
            continue
        field = model.model_fields.get(part)
        inner = _table_of(field.annotation) if field is not None else None
        if field is None or inner is None:
            return []
        model, named = inner, get_origin(field.annotation) is dict
    return list(model.model_fields)


def _is_table(annotation: object) -> bool:
    """Say whether a field is a table of known keys."""
    return _table_of(annotation) is not None


def _table_of(annotation: object) -> type[BaseModel] | None:
    """Return the table that a field is, also where it may be absent."""
    choices = (annotation, *getattr(annotation, "__args__", ()))
    return next((one for one in choices if isinstance(one, type) and issubclass(one, BaseModel)), None)
