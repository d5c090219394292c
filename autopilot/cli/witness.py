"""`autopilot witness`: watch a node's log from the ground, and cosign it.

What is asked, believed and kept is `autopilot.ground`'s; here it is started, and put into words as it changes.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from autopilot.ground.issuer import Issuer
from autopilot.ground.watching import Watch
from autopilot.trust.clock import HostClock, wall_ms
from autopilot.trust.identity import IdentityError, load_identity
from autopilot.trust.notes import NoteInvalid
from events.schema.waypoint_pb2 import NodeStatus

_EXAMPLES = """\
examples:
  autopilot witness --identity keys/alice --connect tcp/127.0.0.1:7447 --node wasp-01
  autopilot witness --identity keys/alice --connect tcp/127.0.0.1:7447 --node wasp-01 --cosign --seconds 600

exit codes: 0 what was heard fits, 1 the node's log contradicts what it signed before, 69 nothing heard,
74 what is heard can't be kept, 78 identity unusable
"""
_DESCRIPTION = """\
Keep the checkpoints that a node signs of its log, have it prove that each goes on from the one before, and say what
does not fit. With --cosign each is signed as proven, which the node records. What is kept lies in the folder of the
identity, under witness/; contradictions lie there as evidence: both notes, and the path that shows them.
"""
_LOOK_EVERY_S = 1.0


def add(commands: Any) -> None:
    """Add the command to the program's."""
    made = commands.add_parser(
        "witness",
        help="watch a node's log, and cosign it",
        description=_DESCRIPTION,
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    made.add_argument("--identity", required=True, metavar="FOLDER", help="folder of the witness's identity")
    made.add_argument("--connect", required=True, action="append", metavar="tcp/HOST:PORT", help="Zenoh endpoint")
    made.add_argument("--node", required=True, metavar="NODE", help="principal id of the node")
    made.add_argument("--cosign", action="store_true", help="sign what is proven, as this identity")
    made.add_argument("--seconds", type=float, default=float("inf"), metavar="N", help="stop after N seconds")
    made.add_argument("--json", action="store_true", help="one JSON object a line")
    made.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Watch until the time is up; return the exit code."""
    clock = HostClock()
    try:
        identity = load_identity(args.identity, wall_ms(clock))
    except IdentityError as error:
        print(error, file=sys.stderr)
        return os.EX_CONFIG
    last: dict[str, Any] = {}
    with Issuer(identity, args.connect) as issuer:
        watch = Watch(issuer, identity, args.node, clock, cosigns=args.cosign)
        try:
            for now in _seen(issuer, watch, args.node, args.seconds):
                if now != last:
                    print(json.dumps(now) if args.json else words(now), flush=True)
                last = now
        except KeyboardInterrupt:
            pass
        except OSError as error:
            print(f"autopilot witness: what is heard can't be kept: {error}", file=sys.stderr)
            return os.EX_IOERR
        return _exit_code(last)


def _seen(issuer: Issuer, watch: Watch, node: str, seconds: float) -> Iterator[dict[str, Any]]:
    """Watch, and yield what is known each time that something may have changed. Raises OSError."""
    ends_s = time.monotonic() + seconds
    newest_ms = 0

    def newer(status: NodeStatus) -> bool:
        return status.at_ms > newest_ms

    while (left_s := ends_s - time.monotonic()) > 0:
        heard = issuer.wait_status(node, newer, min(left_s, _LOOK_EVERY_S))
        key = issuer.node_key(node)
        if heard is None or key is None:
            continue
        newest_ms = heard.status.at_ms
        try:
            watch.turn()
            standing = issuer.witness.standing(node, key)
        except NoteInvalid as error:
            issuer.complain(node, str(error))
            standing = None
        yield {
            "node": node,
            "standing": None if standing is None else asdict(standing),
            "unanswered": watch.unanswered,
            "cosigned_size": heard.status.cosigned_size,
            "cosigned_by": heard.status.cosigned_by,
            "wrong": issuer.complaints().get(node, ""),
        }


def words(now: dict[str, Any]) -> str:
    """Return what is known of a node, in one line."""
    standing, parts = now["standing"], []
    if now["wrong"]:
        parts.append(f"CONTRADICTS what it signed before: {now['wrong']}")
    if standing is None:
        parts.append("nothing signed was heard")
    else:
        parts.append(f"flight {standing['flight_number']}: log proven up to {standing['proven_size']} records")
        if standing["waiting_since_ms"] is not None:
            asked = f", asked {now['unanswered']} times in vain" if now["unanswered"] else ""
            parts.append(f"{standing['heard_size']} heard, not proven yet{asked}")
    if now["cosigned_by"]:
        parts.append(f"{now['cosigned_size']} cosigned by {now['cosigned_by']}")
    return f"{now['node']}: {'; '.join(parts)}"


def _exit_code(last: dict[str, Any]) -> int:
    if not last:
        return os.EX_UNAVAILABLE
    return 1 if last["wrong"] else os.EX_OK
