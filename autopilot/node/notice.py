"""The note that a node leaves where it can't record: for `autopilot status`, which asks no running process.

It lies beside the projections' database. Where even that can't be written, standard error and NodeStatus say it alone.
"""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

NAME = "not_recording"


@dataclass(frozen=True, slots=True)
class Notice:
    """Why a node does not record, and since when."""

    because: str
    since_ms: int  # wall clock, milliseconds since 1970


def leave(projections: Path, notice: Notice) -> None:
    """Leave the note, as far as that is possible."""
    with suppress(OSError):
        projections.with_name(NAME).write_text(json.dumps(asdict(notice)), encoding="utf-8")


def take_away(projections: Path) -> None:
    """Take the note away: the node records."""
    with suppress(OSError):
        projections.with_name(NAME).unlink(missing_ok=True)


def read(projections: Path) -> Notice | None:
    """Return the note that lies there; None where there is none, or none that can be read."""
    try:
        said = json.loads(projections.with_name(NAME).read_text(encoding="utf-8"))
        return Notice(str(said["because"]), int(said["since_ms"]))
    except (OSError, ValueError, KeyError, TypeError):
        return None
