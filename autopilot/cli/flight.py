"""Opening a flight that a person named, and saying in one line why it can't be opened. Reads only."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

from events import BodyBroken, UnknownKind
from events.store import Reader, StoreFailed, StoreMissing, read_flight
from events.store.flights import DATABASE

USAGE = 2  # as argparse has it


def folder_of(flight: str) -> Path:
    """Return the folder of a flight that was named by its folder or by the log in it."""
    path = Path(flight)
    return path.parent if path.name == DATABASE and path.is_file() else path


def with_flight(flight: str, work: Callable[[Reader], int]) -> int:
    """Open a flight, do the work and close it; return its exit code (sysexits: 65, 66 and 74 for what goes wrong)."""
    try:
        reader = read_flight(folder_of(flight))
        try:
            return work(reader)
        finally:
            reader.close()
    except StoreMissing as error:
        return _told(f"{error}; name the folder of a flight, like flights/000001-1a2b3c4d", os.EX_NOINPUT)
    except StoreFailed as error:
        return _told(str(error), os.EX_IOERR)
    except (UnknownKind, BodyBroken) as error:
        return _told(str(error), os.EX_DATAERR)


def _told(words: str, code: int) -> int:
    print(f"autopilot: {words}", file=sys.stderr)
    return code
