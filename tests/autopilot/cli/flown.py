"""A flight on disk, and commands run in this process, for tests of the command line."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

from events.store import create_flight
from tests.flights import FLIGHT_ID, SECRET, story


def story_on_disk(root: Path) -> Path:
    """Write the whole story into a flight's folder and return the folder."""
    flight, store = create_flight(root, 1, FLIGHT_ID, SECRET)
    store.append(story().records)
    store.close()
    return flight.folder


def run(command: ModuleType, words: Sequence[str]) -> int:
    """Parse the words as `autopilot` would and run the command; return its exit code."""
    parser = argparse.ArgumentParser(prog="autopilot")
    command.add(parser.add_subparsers(required=True))
    args = parser.parse_args(words)
    code: int = args.run(args)
    return code
