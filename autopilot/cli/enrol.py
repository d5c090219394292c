"""`autopilot enrol`: this device gets its identity from a Directory, by a code; or renews what it has.

Keys are made here and stay here. What is believed and written is `autopilot.ground.enrolment_device`'s and
`renewal`'s.
"""

from __future__ import annotations

import argparse
import getpass
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from autopilot.ground import enrolment_device as device
from autopilot.ground.directory_folders import summary
from autopilot.ground.directory_store import durable
from autopilot.ground.enrolment import ANSWER_BYTES_MAX, EnrolmentError, Secret, secret_of
from autopilot.ground.renewal import finish
from autopilot.trust.clock import HostClock, wall_ms
from autopilot.trust.identity import IdentityError, load_identity
from events.schema.waypoint_pb2 import IdentityToken

_EXAMPLES = """\
examples:
  autopilot enrol --out /etc/autopilot/keys --connect tcp/10.0.0.1:7447        asks for the code, then the Directory
  autopilot enrol --out /etc/autopilot/keys --request stick/request            without a link: out with the request,
  autopilot enrol --out /etc/autopilot/keys --response stick/answer            in with the answer
  autopilot enrol --out keys/alice --connect tcp/10.0.0.1:7447 --renew         token, list and group key anew

The code comes from `autopilot directory enrol`. Type it when asked, or pipe it in: an argument is seen by every user of
the machine. When something fails on the way, run it again with the same code.
"""


def add(commands: Any) -> None:
    """Add the command to the program's."""
    parser = commands.add_parser(
        "enrol",
        help="get this device's identity by a code",
        description="Make keys on this device, and get them an identity from the Directory that gave out a code.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--out", required=True, metavar="FOLDER", help="folder of the identity")
    parser.add_argument("--code", metavar="CODE", help="the code (default: ask, or read it from a pipe)")
    ways = parser.add_mutually_exclusive_group(required=True)
    ways.add_argument("--connect", action="append", metavar="tcp/HOST:PORT", help="Zenoh endpoint to ask through")
    ways.add_argument("--request", metavar="FILE", help="write the request for `autopilot directory admit`")
    ways.add_argument("--response", metavar="FILE", help="read the answer that it wrote")
    parser.add_argument("--renew", action="store_true", help="bring the identity in FOLDER up to date; no code")
    parser.add_argument("--wait", type=float, default=10.0, metavar="S", help="how long to try to connect (10)")
    parser.add_argument("--json", action="store_true", help="say what was done as JSON")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Enrol or renew; return the exit code."""
    try:
        return _renew(args) if args.renew else _enrol(args)
    except (EnrolmentError, IdentityError) as error:
        print(error, file=sys.stderr)
        return os.EX_NOPERM
    except OSError as error:
        print(f"{error.filename or args.out}: {error.strerror}", file=sys.stderr)
        return os.EX_IOERR


def _enrol(args: argparse.Namespace) -> int:
    secret, out = secret_of(_code(args.code)), Path(args.out)
    if args.request:
        durable(Path(args.request), device.ask(out, secret, os.urandom))
        words = f"{args.request}: bring it to the Directory: autopilot directory admit DIR REQUEST ANSWER"
        _say(args, {"request": args.request}, words)
        return os.EX_OK
    if args.response:
        token = device.settle(out, secret, _answer_in(Path(args.response)), _now_ms())
    else:
        token = _asked(args, out, secret)
    _say(args, {"folder": args.out, **summary(token)}, f"{args.out}: {token.principal_id} ({token.callsign})")
    return os.EX_OK


def _asked(args: argparse.Namespace, out: Path, secret: Secret) -> IdentityToken:
    from autopilot.ground.directory_asking import enrolment_answers  # Zenoh: only who asks pays for it

    request = device.ask(out, secret, os.urandom)
    return _first_believed(out, secret, enrolment_answers(args.connect, request, args.wait))


def _first_believed(out: Path, secret: Secret, answers: Sequence[bytes]) -> IdentityToken:
    """Take the first answer that proves to know the code; anybody on the mesh may give others."""
    because = EnrolmentError("nobody answered; check the endpoint, and that `autopilot directory serve` runs")
    for answer in answers:
        try:
            return device.settle(out, secret, answer, _now_ms())
        except EnrolmentError as error:
            because = (
                error if answer else EnrolmentError("the code was refused: used, run out, or of another Directory")
            )
    raise because


def _renew(args: argparse.Namespace) -> int:
    from autopilot.ground.directory_asking import renew

    if not args.connect:
        raise EnrolmentError(
            "--renew asks over the mesh: name it with --connect; without a link use a refreshed folder"
        )
    finish(Path(args.out))
    changed = renew(load_identity(args.out), args.connect, args.wait)
    _say(args, {"folder": args.out, "changed": changed}, f"{args.out}: {', '.join(changed) or 'nothing'} changed")
    return os.EX_OK


def _code(given: str | None) -> str:
    if given is not None:
        return given
    return getpass.getpass("code: ") if sys.stdin.isatty() else sys.stdin.readline()


def _answer_in(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(ANSWER_BYTES_MAX + 1)


def _say(args: argparse.Namespace, facts: dict[str, Any], words: str) -> None:
    print(json.dumps(facts) if args.json else words)


def _now_ms() -> int:
    return wall_ms(HostClock())
