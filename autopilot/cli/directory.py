"""`autopilot directory`: make a Directory and issue identities from it.

It reads arguments and says what happened; the work is `autopilot.ground.directory`'s.
"""

from __future__ import annotations

import argparse
import json
import os
import sys

from autopilot.ground import directory
from autopilot.ground.directory import DirectoryError
from autopilot.trust.clock import HostClock, wall_ms

_EXAMPLES = """\
examples:
  autopilot directory init keys/directory --deployment coast-watch
  autopilot directory issue keys/directory wasp-01 --kind node --callsign WASP-01 --out node/keys
  autopilot directory issue keys/directory alice --kind operator --role operator --callsign ALICE --out keys/alice

Issue nodes first: an operator's folder gets the tokens of the nodes that exist then, and learns of
later ones from their status. The Directory's folder holds every secret; keep it off the node.
"""


def add(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to `commands`."""
    parser = commands.add_parser(
        "directory",
        help="identities: init, issue",
        description="Make a Directory (root, purpose keys, group key) and issue identities as folders of files.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    init = actions.add_parser("init", help="make a Directory", description="Make a Directory in an empty folder.")
    init.add_argument("directory", metavar="DIR", help="folder of the Directory")
    init.add_argument("--deployment", metavar="ID", help="name of the deployment, a-z 0-9 - (default: a random one)")
    init.add_argument("--json", action="store_true", help="say what was made as JSON")
    init.set_defaults(run=_run_init)
    issue = actions.add_parser("issue", help="issue an identity", description="Make keys and a token for one device.")
    issue.add_argument("directory", metavar="DIR", help="folder of the Directory")
    issue.add_argument("principal", metavar="PRINCIPAL", help="name of the principal, a-z 0-9 -")
    issue.add_argument("--kind", choices=sorted(directory.KINDS), required=True, help="what the principal is")
    issue.add_argument("--role", action="append", default=[], metavar="R", help="a role; repeatable")
    issue.add_argument("--callsign", default="", metavar="C", help="name that people use (default: PRINCIPAL)")
    issue.add_argument("--out", required=True, metavar="FOLDER", help="folder to write the identity to")
    issue.add_argument("--hours", type=_hours, metavar="N", help="how long the token is valid (default: by kind)")
    issue.add_argument("--json", action="store_true", help="say what was issued as JSON")
    issue.set_defaults(run=_run_issue)


def _run_init(args: argparse.Namespace) -> int:
    deployment_id = args.deployment or f"local-{os.urandom(4).hex()}"
    try:
        made = directory.init(
            args.directory, deployment_id=deployment_id, now_ms=wall_ms(HostClock()), random=os.urandom
        )
    except DirectoryError as error:
        print(error, file=sys.stderr)
        return os.EX_CANTCREAT
    except OSError as error:
        print(f"{args.directory}: {error.strerror}", file=sys.stderr)
        return os.EX_IOERR
    facts = {
        "directory": str(made.folder),
        "deployment_id": made.trust.deployment_id,
        "root": made.root_key.public.hex(),
    }
    print(json.dumps(facts) if args.json else f"{made.folder}: deployment {deployment_id}, root 1 of 1")
    return os.EX_OK


def _run_issue(args: argparse.Namespace) -> int:
    try:
        token = directory.issue(
            directory.open_directory(args.directory),
            args.principal,
            args.out,
            kind=args.kind,
            roles=args.role,
            callsign=args.callsign,
            now_ms=wall_ms(HostClock()),
            random=os.urandom,
            hours=args.hours,
        )
    except DirectoryError as error:
        print(error, file=sys.stderr)
        return os.EX_DATAERR
    except OSError as error:
        print(f"{args.out}: {error.strerror}", file=sys.stderr)
        return os.EX_IOERR
    summary = {"folder": args.out, **directory.summary(token)}
    words = f"{args.out}: {args.kind} {token.principal_id} ({token.callsign}), roles {', '.join(token.roles) or 'none'}"
    print(json.dumps(summary) if args.json else words)
    return os.EX_OK


def _hours(text: str) -> float:
    hours = float(text)
    if not 0 < hours <= 8760:
        raise argparse.ArgumentTypeError("must be more than 0 and at most 8760")
    return hours
