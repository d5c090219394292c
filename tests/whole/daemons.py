"""The daemon as a process of its own, from a configuration that a test writes; nothing here checks anything."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from events import Record, read_record
from events.store import StoreFailed, StoreMissing, flights_in, read_flight

COMMAND = [sys.executable, "-m", "autopilot.cli.main", "run", "--config"]
WITHIN_S = 30.0


def write_config(folder: Path, keys: Path, **sections: dict[str, Any]) -> Path:
    """Write a configuration whose flights lie in `folder`, with these sections beside [node]; return its path."""
    node = {"keys": str(keys), "flights": "flights", "projections": "projections.db"}
    lines = ["schema_version = 1"]
    for name, section in {"node": node, **sections}.items():
        tables = {key: value for key, value in section.items() if isinstance(value, dict)}
        lines += [f"[{name}]", *_pairs({key: value for key, value in section.items() if key not in tables})]
        for table, values in tables.items():
            lines += [f"[{name}.{table}]", *_pairs(values)]
    path = folder / "config.toml"
    path.write_text("\n".join(lines) + "\n")
    return path


def _pairs(values: dict[str, Any]) -> list[str]:
    return [f"{json.dumps(key)} = {json.dumps(value)}" for key, value in values.items()]


def run(config: Path, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run the daemon until it ends by itself. Raises TimeoutExpired."""
    command = [*COMMAND, str(config)]
    return subprocess.run(command, capture_output=True, text=True, timeout=2 * WITHIN_S, check=False, **options)


def started(config: Path) -> subprocess.Popen[str]:
    """Start the daemon and wait until it records."""
    child = subprocess.Popen([*COMMAND, str(config)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    assert child.stderr is not None
    line = child.stderr.readline()
    if "recording in" not in line:
        raise RuntimeError(line + child.stderr.read())
    return child


def said(config: Path, words: str, **options: Any) -> subprocess.Popen[str]:
    """Start the daemon and wait until a line of its has these words."""
    child = subprocess.Popen(
        [*COMMAND, str(config)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, **options
    )
    assert child.stderr is not None
    heard = ""
    while words not in (line := child.stderr.readline()):
        heard += line
        if not line:
            raise RuntimeError(heard)
    return child


def ended(child: subprocess.Popen[str]) -> tuple[int, str]:
    """Ask it to end; return exit code and last words."""
    child.terminate()
    _, words = child.communicate(timeout=WITHIN_S)
    return child.returncode, words


def log(folder: Path) -> list[Record]:
    """Return what is durable in the newest flight below `folder`; nothing while there is none."""
    try:
        reader = read_flight(flights_in(folder / "flights")[-1].folder)
    except (IndexError, StoreFailed, StoreMissing):
        return []
    try:
        return [read_record(stored) for stored in reader.stored()]
    finally:
        reader.close()


def wait_for(condition: Callable[[], bool], what: str) -> None:
    """Wait until a condition holds. Raises TimeoutError."""
    give_up_at_s = time.monotonic() + WITHIN_S
    while not condition():
        if time.monotonic() > give_up_at_s:
            raise TimeoutError(f"waited {WITHIN_S:.0f} s for {what}")
        threading.Event().wait(0.05)
