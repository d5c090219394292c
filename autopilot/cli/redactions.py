"""`redaction.json` beside a redacted copy: who made it, when and why. Nothing proves it, and no proof needs it."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from events.store import StoreFailed

FILE = "redaction.json"


def redactions_of(folder: Path) -> list[dict[str, Any]]:
    """Return who made a copy of what, oldest first; nothing for a flight. Raises StoreFailed where it can't be read."""
    try:
        said = json.loads((folder / FILE).read_text("utf-8"))
        found = [{name: str(one[name]) for name in sorted(one)} for one in said["redactions"]]
    except FileNotFoundError:
        return []
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise StoreFailed(f"{folder / FILE} can't be read: {error}") from error
    return found


def told(redactions: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Yield a line for each redaction."""
    for one in redactions:
        yield "redacted by {by} at {at}: records {removed}, because: {because}".format_map(_Named(one))


class _Named(dict[str, str]):
    """What a file does not say is a question mark, not an error."""

    def __missing__(self, _name: str) -> str:
        return "?"
