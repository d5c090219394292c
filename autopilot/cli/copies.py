"""The report beside a recovered copy: where it lies, and what it says to whoever verifies the copy."""

from __future__ import annotations

import json
import sys
from pathlib import Path

REPORT = "recovered.json"


def tell_recovered(folder: Path) -> None:
    """Tell on stderr where a copy of a damaged log ends, and what is missing; nothing for any other flight."""
    try:
        said = json.loads((folder / REPORT).read_text(encoding="utf-8"))["recovered"]
        missing = [*said["left_out"], *said["lost"]]
        last, newest = int(said["last_seq"]), max((int(end) for _, end in missing), default=-1)
    except (OSError, ValueError, KeyError, TypeError):
        return
    how = f"INCOMPLETE: it ends early at record {last}, of {newest} that are known" if missing else "nothing is missing"
    print(f"this is a recovered copy; {how}", file=sys.stderr)
