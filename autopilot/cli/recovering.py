"""What `autopilot replay recover` does: a copy of what holds of a damaged log, and what is to be said of it."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from autopilot.cli import checking
from autopilot.cli.copies import REPORT
from autopilot.node.sealing import CERTIFICATE_FILE
from autopilot.trust.identity import ROOT_FILE, TOKEN_FILE
from autopilot.trust.keys import write_file
from autopilot.trust.replayed import VERDICT_FILE
from events.store import StoreFailed, StoreMissing
from events.store import recovering as store
from events.store.recovering import Range, Recovered

# What a stranger needs to judge the copy. The log's key is a secret, and stays.
_COMPANIONS = (CERTIFICATE_FILE, TOKEN_FILE, ROOT_FILE, VERDICT_FILE)


def recover(folder: Path, out: Path, *, as_json: bool) -> int:
    """Recover, print what came of it; return the exit code (sysexits: 65, 66, 73 and 74)."""
    try:
        found = store.recover(folder, out, _COMPANIONS)
        report = json.dumps(plain(found), sort_keys=True)
        if out.is_dir():
            write_file(out / REPORT, report.encode())
    except StoreMissing as error:
        return _told(f"{error}; name the folder of a flight, like flights/000001-1a2b3c4d", os.EX_NOINPUT)
    except FileExistsError as error:
        return _told(str(error), os.EX_CANTCREAT)
    except (StoreFailed, OSError) as error:
        return _told(str(error), os.EX_IOERR)
    print(report if as_json else words(found, out))
    return os.EX_OK if found.whole else os.EX_DATAERR


def words(found: Recovered, out: Path) -> str:
    """Say what was found and done, in lines."""
    said = [checking.words(found.finding)]
    if found.copied.seq >= 0:
        said.append(f"copied: records 0 to {found.copied.seq} to {out}, last leaf {found.copied.leaf.hex()}")
    else:
        said.append("copied: nothing, for no step can be read whole")
    if found.left_out:
        said.append(f"left out: records {_ranges(found.left_out)} can be read, but can't follow the copy")
    said.append(f"lost: records {_ranges(found.lost)}" if found.lost else "lost: nothing that is known of")
    return "\n".join(said)


def plain(found: Recovered) -> dict[str, Any]:
    """Return what was found and done as a JSON-able structure."""
    recovered = {
        "whole": found.whole,
        "records": found.copied.seq + 1,
        "last_seq": found.copied.seq,
        "last_leaf": found.copied.leaf.hex(),
        "left_out": [list(one) for one in found.left_out],
        "lost": [list(one) for one in found.lost],
    }
    return checking.plain(found.finding) | {"recovered": recovered}


def _ranges(ranges: Sequence[Range]) -> str:
    return ", ".join(f"{first} to {last}" if first < last else str(first) for first, last in ranges)


def _told(text: str, code: int) -> int:
    print(f"autopilot: {text}", file=sys.stderr)
    return code
