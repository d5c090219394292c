"""`autopilot directory`: make a Directory, issue and enrol identities, revoke, rotate, and serve.

It reads arguments; what they do is in `directory_actions`, and the work is `autopilot.ground`'s.
"""

from __future__ import annotations

import argparse

from autopilot.cli import directory_actions as actions
from autopilot.ground import directory
from autopilot.trust.documents import PURPOSES

_EXAMPLES = """\
examples:
  autopilot directory init keys/directory --deployment coast-watch
  autopilot directory issue keys/directory alice --kind operator --role operator --callsign ALICE --out keys/alice
  autopilot directory enrol keys/directory wasp-01 --kind node --callsign WASP-01     a code for the device itself
  autopilot directory revoke keys/directory wasp-01                          lost: out, and a new group key
  autopilot directory rotate keys/directory --purpose revoke --root stick/root.key
  autopilot directory serve keys/directory --connect tcp/127.0.0.1:7447 --rotate-hours 24

Enrol nodes first: an operator's folder gets the tokens of the nodes that exist then, and learns of
later ones from their status or a refresh. The Directory's folder holds every secret; keep it off the node,
and root.key off this machine: only `rotate --purpose` needs it.
"""


def add(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to `commands`."""
    parser = commands.add_parser(
        "directory",
        help="identities: init, issue, enrol, revoke, rotate, list, serve",
        description="Make a Directory (root, purpose keys, group key), and decide who takes part in a deployment.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    verbs = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    _add_making(verbs)
    _add_changing(verbs)
    _add_giving(verbs)


def _add_making(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    init = _verb(verbs, "init", "make a Directory in an empty folder", actions.init)
    init.add_argument("--deployment", metavar="ID", help="name of the deployment, a-z 0-9 - (default: a random one)")
    init.add_argument("--roots", type=int, default=1, metavar="N", help="keys of the root (default: 1)")
    init.add_argument("--threshold", type=int, default=1, metavar="T", help="how many of them sign (default: 1)")
    issue = _verb(verbs, "issue", "make keys and a token for one device, as a folder", actions.issue)
    _add_described(issue)
    issue.add_argument("--out", required=True, metavar="FOLDER", help="folder to write the identity to")
    enrol = _verb(verbs, "enrol", "print a code with which a device gets its identity, once", actions.enrol)
    _add_described(enrol)
    enrol.add_argument("--valid", type=_hours, default=24.0, metavar="H", help="hours that the code is valid (24)")
    admit = _verb(verbs, "admit", "answer a device's request that was brought as a file", actions.admit)
    admit.add_argument("request", metavar="REQUEST", help="file that `autopilot enrol --request` wrote")
    admit.add_argument("out", metavar="ANSWER", help="file to write the answer to")


def _add_changing(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    revoke = _verb(
        verbs, "revoke", "shut somebody out, and begin a new epoch; nobody: sign the list anew", actions.revoke
    )
    revoke.add_argument("principal", nargs="*", metavar="PRINCIPAL", help="every device of this principal")
    revoke.add_argument("--device", action="append", default=[], type=_id, metavar="KEYID", help="one device")
    revoke.add_argument("--token", action="append", default=[], type=_id, metavar="ID", help="one token")
    revoke.add_argument("--min-policy", type=int, default=0, metavar="N", help="tokens of an older policy are void")
    revoke.add_argument("--min-epoch", type=int, default=0, metavar="N", help="older epochs are void at once")
    revoke.add_argument("--even-unknown", action="store_true", help="also what this Directory does not know")
    revoke.add_argument("--keep-epoch", action="store_true", help="no new group key: who is out goes on reading")
    rotate = _verb(verbs, "rotate", "begin a new epoch, or replace a purpose key", actions.rotate)
    rotate.add_argument("--purpose", choices=PURPOSES, help="the key to replace (default: the group key)")
    rotate.add_argument("--root", action="append", default=[], metavar="FILE", help="root key, where it is not in DIR")
    rotate.add_argument("--lead", type=float, default=0.0, metavar="S", help="seconds until the epoch is used")


def _add_giving(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    refresh = _verb(verbs, "refresh", "write the newest documents into an identity folder", actions.refresh)
    refresh.add_argument("folder", metavar="FOLDER", help="identity folder, or a copy without its keys")
    export = _verb(verbs, "export", "write the newest documents for a device into a new folder", actions.export)
    export.add_argument("device", metavar="DEVICE", help="principal, or key id of a device")
    export.add_argument("out", metavar="FOLDER", help="folder to write to; holds no secret")
    _verb(verbs, "list", "show who takes part, who is out, and what is in force", actions.show)
    serve = _verb(verbs, "serve", "answer over the mesh until told to stop", actions.serve)
    serve.add_argument("--connect", action="append", default=[], metavar="tcp/HOST:PORT", help="router; repeatable")
    serve.add_argument("--listen", action="append", default=[], metavar="tcp/HOST:PORT", help="without a router")
    serve.add_argument("--rotate-hours", type=_hours, metavar="H", help="begin a new epoch that often")


def _verb(
    verbs: argparse._SubParsersAction[argparse.ArgumentParser], name: str, words: str, action: actions.Action
) -> argparse.ArgumentParser:
    parser = verbs.add_parser(name, help=words, description=f"{words[0].upper()}{words[1:]}.")
    parser.add_argument("directory", metavar="DIR", help="folder of the Directory")
    parser.add_argument("--json", action="store_true", help="say what was done as JSON")
    parser.set_defaults(run=lambda args: actions.run(action, args))
    return parser


def _add_described(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("principal", metavar="PRINCIPAL", help="name of the principal, a-z 0-9 -")
    parser.add_argument("--kind", choices=sorted(directory.KINDS), required=True, help="what the principal is")
    parser.add_argument("--role", action="append", default=[], metavar="R", help="a role; repeatable")
    parser.add_argument("--callsign", default="", metavar="C", help="name that people use (default: PRINCIPAL)")
    parser.add_argument("--hours", type=_hours, metavar="N", help="how long the token is valid (default: by kind)")


def _hours(text: str) -> float:
    hours = float(text)
    if not 0 < hours <= 8760:
        raise argparse.ArgumentTypeError("must be more than 0 and at most 8760")
    return hours


def _id(text: str) -> bytes:
    found = bytes.fromhex(text)
    if len(found) != 16:
        raise argparse.ArgumentTypeError("must be 16 bytes as 32 hexadecimal digits")
    return found
