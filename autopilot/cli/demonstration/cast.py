"""The cast of the demo: a Directory and the identities that it issues, and a forger with a Directory of his own.

All keys are made afresh for each demo; nothing here outlives its folder.
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path

from autopilot.ground import directory
from autopilot.trust.identity import Identity, load_identity

DEPLOYMENT = "demo"
NODE = "wasp-01"


@dataclass(frozen=True, slots=True)
class Cast:
    """Who plays."""

    first: Identity  # an operator
    second: Identity  # another operator
    viewer: Identity  # may look, may not point
    supervisor: Identity  # may begin a mission, and more
    forger: Identity  # calls himself what the first operator is called, with keys of another Directory


def make_cast(folder: Path) -> Cast:
    """Make the Directory, the node's identity in node/keys, and those of the people. Raises DirectoryError."""
    now_ms = time.time_ns() // 1_000_000
    ours = directory.init(folder / "directory", deployment_id=DEPLOYMENT, now_ms=now_ms, random=os.urandom)
    _issue(ours, NODE, folder / "node" / "keys", "node", (), "WASP-01", now_ms)
    people = folder / "operators"
    theirs = directory.init(people / "forger-directory", deployment_id=DEPLOYMENT, now_ms=now_ms, random=os.urandom)
    return Cast(
        first=_issue(ours, "k-1", people / "k-1", "operator", ("operator",), "K-1", now_ms),
        second=_issue(ours, "k-2", people / "k-2", "operator", ("operator",), "K-2", now_ms),
        supervisor=_issue(ours, "s-1", people / "s-1", "operator", ("supervisor",), "S-1", now_ms),
        viewer=_issue(ours, "v-1", people / "v-1", "operator", ("viewer",), "V-1", now_ms),
        forger=_issue(theirs, "k-1", people / "forger", "operator", ("operator",), "K-1", now_ms),
    )


def _issue(
    by: directory.Directory, principal: str, out: Path, kind: str, roles: tuple[str, ...], callsign: str, now_ms: int
) -> Identity:
    directory.issue(by, principal, out, kind=kind, roles=roles, callsign=callsign, now_ms=now_ms, random=os.urandom)
    return load_identity(out)
