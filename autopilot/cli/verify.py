"""`autopilot verify`: whether a proof holds, and what it proves. Offline, without keys; it reads the one file.

A proof is one of a decision, or one that a log only grew; the file says which.

The judging is done by `autopilot.ground.verifier`, which knows nothing of the rest; here its answer is put into words.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from autopilot.ground.consistency import Consistent, check_consistent, is_consistency
from autopilot.ground.ordered import ProvedOrder
from autopilot.ground.verifier import BYTES_MAX, ProofRefused, Proved, check
from events.records import Moment, Stored
from replay.causes import line
from replay.show import line_text

_EXAMPLES = """\
examples:
  autopilot verify proof.json
  autopilot verify proof.json --root node/keys/trust_root
  autopilot verify proof.json --root node/keys/trust_root --revocations node/keys/revocations

exit codes: 0 it holds, 65 it does not, 66 there is no such file
"""
_DESCRIPTION = """\
Check a proof that `autopilot export proof` or `autopilot export consistency` wrote, and say what it proves and what
not: where an order led to it, also who signed that order, and that it was for this node. Nothing but the file is
needed; with --root the proof must rest on the trust root that you have yourself, with --revocations nobody who gave an
order of it may be on that list.
"""


def add(commands: Any) -> None:
    """Add the command to the program's."""
    made = commands.add_parser(
        "verify",
        help="check a proof, offline",
        description=_DESCRIPTION,
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    made.add_argument("file", metavar="FILE", help="the proof")
    made.add_argument("--root", default="", metavar="FILE", help="trust root that you know to be the right one")
    made.add_argument("--revocations", default="", metavar="FILE", help="revocation list of the Directory")
    made.add_argument("--json", action="store_true", help="print what is proved as one JSON object")
    made.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Check a proof; return the exit code."""
    try:
        data = _read(args.file)
        root = _read(args.root) if args.root else None
        revocations = _read(args.revocations) if args.revocations else None
    except OSError as error:
        print(f"autopilot verify: {error.filename}: {error.strerror}", file=sys.stderr)
        return os.EX_NOINPUT
    try:
        if is_consistency(data):
            return _told(check_consistent(data, root), as_json=args.json)
        proved = check(data, root, revocations)
    except ProofRefused as error:
        print(f"autopilot verify: refused: {error}", file=sys.stderr)
        return os.EX_DATAERR
    if args.json:
        print(json.dumps(_plain(proved), sort_keys=True))
        return os.EX_OK
    print(proved.words())
    for text in proved.order_words():
        print(text)
    for text in _lines(proved):
        print(text)
    return os.EX_OK


def _told(proved: Consistent, *, as_json: bool) -> int:
    """Say what a consistency proof proves; return the exit code."""
    print(json.dumps(_plain_consistent(proved), sort_keys=True) if as_json else proved.words())
    return os.EX_OK


def _plain_consistent(proved: Consistent) -> dict[str, Any]:
    return {
        "deployment": proved.log.deployment,
        "node": proved.log.node,
        "flight": proved.log.flight,
        "flight_id": proved.log.flight_id.hex(),
        "old_records": proved.old.size,
        "new_records": proved.new.size,
        "old_cosigners": [asdict(one) for one in proved.old.cosigners],
        "new_cosigners": [asdict(one) for one in proved.new.cosigners],
        "trust_root_sha256": proved.log.trust_root,
        "words": proved.words(),
    }


def _plain_order(order: ProvedOrder) -> dict[str, Any]:
    keys = {"device_key": order.device_key.hex(), "token_key": order.token_key.hex()}
    return asdict(order) | keys | {"words": order.words()}


def _read(path: str) -> bytes:
    with Path(path).open("rb") as file:
        return file.read(BYTES_MAX + 1)


def _lines(proved: Proved) -> Iterator[str]:
    """Yield what the records say, as far as this version knows their kinds."""
    for one in proved.records:
        at = Moment(0, 0, 0, one.wall_ns, 0)
        yield line_text(line(Stored(one.seq, one.cause, at, one.kind, one.version, one.body, b"", removed=one.removed)))


def _plain(proved: Proved) -> dict[str, Any]:
    return {
        "deployment": proved.deployment,
        "node": proved.node,
        "flight": proved.flight,
        "flight_id": proved.flight_id.hex(),
        "signed_records": proved.size,
        "signed_flight_ns": proved.signed_flight_ns,
        "trust_root_sha256": proved.trust_root,
        "cosigners": [asdict(one) for one in proved.cosigners],
        "records": [one.seq for one in proved.records],
        "orders": [_plain_order(one) for one in proved.orders],
        "words": proved.words(),
    }
