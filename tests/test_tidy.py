"""The house keeps itself tidy: folders, sizes, words, fields with units, files that somebody uses.

What ruff, mypy and import-linter can see is left to them; the core's allow-list is in test_floors.py.
Every rule is a function from text to findings, and is shown a breach as well as the repository.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

import events
from docs.schema import Block, blocks_of
from events.kinds import KINDS, Role
from tests.house import CODE, PACKAGES, REPO, Source, is_generated, is_ignored, source_of, sources, text_files

TOP_LEVEL = {
    *(*PACKAGES, "tests", "docs", "examples", ".ci", ".git", ".gitignore", ".gitattributes", "pyproject.toml"),
    *("Makefile", "LICENSE", "README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md"),
}
MODULE_LINES = 400
FUNCTION_LINES = 60
LINE_CHARACTERS = 120

UNITS = (
    "_e7",
    "_e4",
    "_e3",
    "_mm",
    "_cdeg",
    "_ns",
    "_us",
    "_ms",
    "_s",
    "_mhz",
    "_mps",
    "_mv",
    "_percent",
    "_px",
    "_bytes",
)
UNITS_INSIDE = ("_mm_s", "_cdeg_s")
WHOLE_NUMBERS = {  # ids, numbers that others assign, and counts: they have no unit
    *("vehicle", "camera", "gimbal", "object", "number", "detection", "start", "logic", "version", "flight_number"),
    *("list_version", "root_version", "held_version", "offered_version", "epoch_id"),
    *("system_id", "component_id", "autopilot", "vehicle_type", "custom_mode", "landed_state", "mav_result", "h3_cell"),
    *("command", "mav_mission_result", "opaque_id", "report_id", "mission_tries"),
    *("item", "items", "before_item", "current_item", "reached_item", "breakpoints"),
    *("next_item", "middle_item", "tries"),
    *(
        "count",
        "size",
        "attempts",
        "muted",
        "sightings",
        "asks_per_minute",
        "failures_to_safe_mode",
        "sightings_to_ask",
        "empty_before",
        "samples",
        "observations",
        "ignored_items",
        "left",
        "frames",
        "capabilities",
        "software_version",
        "board_version",
    ),
    "progress",  # MAVLink's own percent, where 255 is unknown
}
NUMERIC = re.compile(r"u?int(32|64)|sint(32|64)|s?fixed(32|64)")
INEXACT = re.compile(r"float|double|map<.*|.*\bAny")
PORTS = {"mesh", "vehicle", "missions", "selftest"}

# Written with a gap, so that this file is not found by its own rule.
_UNFINISHED = "an unfinished thought: finish it, or say in CHANGELOG.md what is missing"
_REGISTRY = "a registry belongs in the client's own settings"
_CITE = "cite a document of this repository or a public standard"
WORDS = {
    word.replace("~", ""): because
    for word, because in {
        "TO~DO": _UNFINISHED,
        "FIX~ME": _UNFINISHED,
        "/wo~rk/": "the path of one machine",
        "/ro~ot/": "the path of one machine",
        "pypi~.org": _REGISTRY,
        "python~hosted.org": _REGISTRY,
        "npm~js.org": _REGISTRY,
        "crates~.io": _REGISTRY,
        "trust~.md": _CITE,
        "trust ~notes": _CITE,
        "fac~ts/": _CITE,
    }.items()
}
ENTRY_POINTS = ("__main__", "docs.generate")


def size_findings(source: Source) -> Iterator[str]:
    """Yield what is too long in a file."""
    lines = source.text.splitlines()
    if len(lines) > MODULE_LINES:
        yield f"{source.path}: {len(lines)} lines, more than {MODULE_LINES}: it has more than one purpose"
    for number, line in enumerate(lines, start=1):
        if len(line) > LINE_CHARACTERS:
            yield f"{source.path}:{number}: {len(line)} characters, more than {LINE_CHARACTERS}"
    for node in ast.walk(source.tree):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            length = (node.end_lineno or node.lineno) - node.lineno + 1
            if length > FUNCTION_LINES:
                yield f"{source.path}:{node.lineno}: {node.name} has {length} lines, more than {FUNCTION_LINES}"


def docstring_findings(source: Source) -> Iterator[str]:
    """Yield a file that does not open with its purpose."""
    if not ast.get_docstring(source.tree):
        yield f"{source.path}: no docstring: say what it is for and what it does not do"


def honesty_findings(source: Source) -> Iterator[str]:
    """Yield what makes a test lie or wait."""
    for node in ast.walk(source.tree):
        if isinstance(node, ast.Assert) and any(isinstance(part, ast.IfExp) for part in ast.walk(node.test)):
            yield f"{source.path}:{node.lineno}: a conditional expression in an assert may test nothing"
        if isinstance(node, ast.ImportFrom) and node.module == "time" and "sleep" in {a.name for a in node.names}:
            yield f"{source.path}:{node.lineno}: a sleep in a test: wait for a condition, with a timeout"
        if isinstance(node, ast.Attribute) and ast.unparse(node) == "time.sleep":
            yield f"{source.path}:{node.lineno}: a sleep in a test: wait for a condition, with a timeout"


def word_findings(path: str, text: str) -> Iterator[str]:
    """Yield the words that have no place in this repository."""
    for number, line in enumerate(text.splitlines(), start=1):
        for word, because in WORDS.items():
            if word in line:
                yield f"{path}:{number}: {word!r}: {because}"


def has_unit(name: str) -> bool:
    """Say whether a numeric field tells its unit, or is a count or an id that has none."""
    return name.endswith((*UNITS, *UNITS_INSIDE, "_seq")) or name in WHOLE_NUMBERS


def comment_findings(path: str, block: Block) -> Iterator[str]:
    """Yield the messages, enumerations and fields without a sentence above them."""
    named = [(block.line, block.name, block.comment)]
    if block.keyword != "enum":  # a oneof has one sentence, and each of its messages has its own
        named += [(member.line, member.name, member.comment) for member in block.members if not member.oneof]
    for line, name, comment in named:
        if not comment.endswith("."):
            yield f"{path}:{line}: {name} has no sentence above it"


def field_findings(path: str, block: Block) -> Iterator[str]:
    """Yield the event fields that are inexact, or numbers without a unit."""
    for member in block.members:
        if INEXACT.fullmatch(member.type):
            yield f"{path}:{member.line}: {member.name} is {member.type}: events hold integers in fixed point"
        if NUMERIC.fullmatch(member.type) and not has_unit(member.name):
            yield f"{path}:{member.line}: {member.name} does not end with its unit ({', '.join(UNITS)})"


def event_findings(path: str, block: Block) -> Iterator[str]:
    """Yield what is wrong with an entry of the catalogue."""
    event = block.event
    if event and (event["role"] == "EFFECT") != (event.get("port") in PORTS):
        yield f"{path}:{block.line}: {block.name}: an effect names its port ({', '.join(sorted(PORTS))}), others none"
    if event and event["kind"] != re.sub(r"(?<!^)(?=[A-Z])", "_", block.name).lower():
        yield f"{path}:{block.line}: {block.name} is kept as {event['kind']!r}: name the message like its kind"


def schema_findings(path: str, text: str) -> Iterator[str]:
    """Yield everything that is wrong with a .proto file."""
    for block in (block for block in blocks_of(text) if block.keyword != "extend"):
        yield from comment_findings(path, block)
        if path.startswith("events/") and not path.endswith("waypoint.proto"):
            yield from field_findings(path, block)
            yield from event_findings(path, block)


def mentioned(source: Source) -> Iterator[str]:
    """Yield the dotted names that a file imports or spells out for a later import."""
    words = [node.value for node in ast.walk(source.tree) if isinstance(node, ast.Constant)]
    names = [word.partition(":")[0] for word in words if isinstance(word, str)]
    yield from names
    for node in ast.walk(source.tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or ""
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.JoinedStr) and isinstance(node.values[0], ast.Constant):
            prefix = str(node.values[0].value)  # f"package.{name}", where a table of names stands in the same file
            yield from (prefix + name for name in names)


def dead_modules(files: list[Source]) -> list[str]:
    """Return the modules that no other file names and that are no way in."""
    used = {name for source in files for name in mentioned(source) if name != source.module}
    scripts = tomllib.loads((REPO / "pyproject.toml").read_text(encoding="utf-8"))["project"]["scripts"]
    used |= {target.partition(":")[0] for target in scripts.values()}
    modules = {source.module for source in files if not source.path.endswith("__init__.py")}
    return sorted(module for module in modules - used if not module.endswith(ENTRY_POINTS))


def readme_commands(text: str) -> set[str]:
    """Return the commands that a README shows in its code blocks (`autopilot NAME ...`)."""
    code = "\n".join(re.findall(r"^```.*?\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL))
    return set(re.findall(r"^\s*(?:\$ )?(?:\S*/)?autopilot ([a-z][a-z-]*)\b", code, flags=re.MULTILINE))


def help_commands(text: str) -> set[str]:
    """Return the commands that `autopilot --help` lists: an indented name, a gap, and words on it."""
    return set(re.findall(r"^ {2,8}([a-z][a-z-]*)(?: {2,}\S.*)?$", text, flags=re.MULTILINE))


def command_findings(root: Path) -> list[str]:
    """Return the commands that README.md and the program do not both know; nothing before there is a program."""
    if not (root / "autopilot" / "cli" / "main.py").exists():
        return []
    program = Path(sys.executable).with_name("autopilot")
    run = subprocess.run([program, "--help"], capture_output=True, text=True, check=True, stdin=subprocess.DEVNULL)
    shown, known = readme_commands((root / "README.md").read_text(encoding="utf-8")), help_commands(run.stdout)
    missing = [f"README.md does not show `autopilot {name}`" for name in sorted(known - shown)]
    return missing + [f"README.md shows `autopilot {name}`, which --help does not" for name in sorted(shown - known)]


def check_clean(findings: Iterator[str] | list[str]) -> None:
    """Check that a rule has nothing to say, and print what it says."""
    found = list(findings)
    assert not found, "\n" + "\n".join(found)


def check_found(findings: Iterator[str] | list[str], *expected: str) -> None:
    """Check that a rule says these things and no more."""
    found = list(findings)
    assert [part in line for part, line in zip(expected, found, strict=True)] == [True] * len(found), found


def protos() -> list[tuple[str, str]]:
    """Return path and text of every .proto file."""
    return [(path, text) for path, text in text_files() if path.endswith(".proto")]


def test_the_top_level_is_the_house() -> None:
    """Six folders, docs, examples, and the files that everybody looks for."""
    check_clean([f"{file.name} at the top level" for file in REPO.iterdir() if _stranger(file.name)])
    assert [name for name in ("scripts", "events", "build") if _stranger(name)] == ["scripts"]


def _stranger(name: str) -> bool:
    return name not in TOP_LEVEL and not is_ignored(name)


def test_events_is_ours() -> None:
    """`events` is a common name: another package of that name must not stand before it."""
    assert Path(events.__file__).resolve().is_relative_to(REPO)


def test_files_functions_and_lines_are_short() -> None:
    """A module has one purpose, a function one thought."""
    check_clean(finding for source in sources(*CODE) for finding in size_findings(source))


def test_what_is_too_long_is_found() -> None:
    """One line, one character, one statement too many."""
    long = "def f():\n" + "    x = 1\n" * 60 + "#" * 121 + "\n" * 340
    check_found(size_findings(source_of("a.py", long)), "401 lines", "a.py:62: 121 characters", "f has 61 lines")
    check_clean(size_findings(source_of("a.py", "def f():\n" + "    x = 1\n" * 59 + "#" * 120 + "\n" * 340)))


def test_every_file_says_what_it_is_for() -> None:
    """Also the empty ones."""
    check_clean(finding for source in sources(*CODE) for finding in docstring_findings(source))


def test_a_file_without_a_purpose_is_found() -> None:
    """A comment is no docstring."""
    check_found(docstring_findings(source_of("a.py", "# It does things.\nx = 1")), "no docstring")


def test_tests_are_honest_and_do_not_sleep() -> None:
    """No assert that may be about nothing, no waiting for the clock."""
    check_clean(finding for source in sources("tests") for finding in honesty_findings(source))


def test_a_dishonest_test_is_found() -> None:
    """Each way of testing nothing, and each way of waiting for nothing."""
    check_found(honesty_findings(source_of("a.py", "assert (a if b else c)")), "conditional")
    check_found(honesty_findings(source_of("a.py", "assert x == (a if b else c)")), "conditional")
    check_found(honesty_findings(source_of("a.py", "import time\ntime.sleep(1)")), "a.py:2: a sleep")
    check_found(honesty_findings(source_of("a.py", "from time import sleep")), "a sleep")


def test_words_that_have_no_place_here() -> None:
    """No unfinished thoughts, no paths of somebody's machine."""
    check_clean(finding for path, text in text_files() for finding in word_findings(path, text))


def test_a_word_that_has_no_place_here_is_found() -> None:
    """With its line."""
    check_found(word_findings("a.md", f"x\n# {next(iter(WORDS))}: later"), "a.md:2")


def test_the_schema_is_a_manual() -> None:
    """Sentences above everything, integers with units, effects with ports."""
    check_clean(finding for path, text in protos() for finding in schema_findings(path, text))


@pytest.mark.parametrize(
    ("field", "expected"),
    [
        ("  // How high.\n  sint32 altitude = 1;", "altitude does not end with its unit"),
        ("  // How high.\n  float altitude_mm = 1;", "altitude_mm is float"),
        ("  // How high.\n  map<string, uint32> altitudes_mm = 1;", "altitudes_mm is map"),
        ("  // What.\n  google.protobuf.Any what = 1;", "what is google.protobuf.Any"),
        ("  sint32 altitude_mm = 1;", "altitude_mm has no sentence"),
        ("  // How high\n  sint32 altitude_mm = 1;", "altitude_mm has no sentence"),
        ('  option (event) = { kind: "bad" number: 1 role: EFFECT version: 1 };', "an effect names its port"),
        ('  option (event) = { kind: "bad" number: 1 role: DECISION port: "mesh" };', "an effect names its port"),
        ('  option (event) = { kind: "worse" number: 1 role: DECISION };', "kept as 'worse'"),
    ],
)
def test_a_breach_of_the_schema_rules_is_found(field: str, expected: str) -> None:
    """Each rule of the schema can fail."""
    text = f"// A thing.\nmessage Bad {{\n{field}\n}}\n"
    check_found(schema_findings("events/schema/bad.proto", text), expected)


def test_kinds_are_unique() -> None:
    """A kind and a number mean one thing for ever; effects have a port and nothing else has."""
    assert len({kind.name for kind in KINDS}) == len({kind.number for kind in KINDS}) == len(KINDS)
    assert [kind.name for kind in KINDS if (kind.role is Role.EFFECT) != bool(kind.port)] == []
    assert [kind.name for kind in KINDS if not 0 < kind.number < 1 << 16 or not 0 < kind.version < 1 << 8] == []


def test_no_module_is_dead() -> None:
    """What nothing imports and nobody starts is taken out."""
    files = [source for source in sources(*PACKAGES, "docs") if not is_generated(source.path)]
    check_clean([f"{module} is imported by nothing" for module in dead_modules(files)])


def test_a_dead_module_is_found() -> None:
    """Naming oneself is no use; a name in a string is."""
    files = [
        source_of("events/one.py", "import events.two\nNAME = 'events.one'"),
        source_of("events/two.py", "'events.three:main'"),
        source_of("events/three.py", "x = [f'events.{n}' for n in ('four',)]"),
        source_of("events/four.py", ""),
    ]
    assert dead_modules(files) == ["events.one"]
    assert dead_modules(files[:2] + files[3:]) == ["events.four", "events.one"]


def test_readme_and_help_know_the_same_commands() -> None:
    """The README's list of commands is the program's."""
    check_clean(command_findings(REPO))


def test_commands_are_read_from_code_and_from_help() -> None:
    """Words in a sentence, options and examples are no commands."""
    readme = "Say `autopilot no`.\n```\nautopilot demo   # fly\n.venv/bin/autopilot run --config F\n```\n"
    assert readme_commands(readme) == {"demo", "run"}
    listing = "usage: autopilot\n\ncommands:\n  demo        a whole flight\n  run         the daemon\n  -h  this\n"
    assert help_commands(f"{listing}\nexamples:\n  autopilot demo --seed 7\n") == {"demo", "run"}
