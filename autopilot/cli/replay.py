"""`autopilot replay`: a recorded flight, run again, shown, or asked why. It changes nothing."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from autopilot.cli.bar import Bar
from autopilot.cli.flight import USAGE, with_flight
from events import UnknownKind, kind_named
from events.store import Reader
from replay.causes import Line, chain, consequences
from replay.show import line_text, show
from replay.verdict import Verdict
from replay.verify import verify

_EXAMPLES = """\
examples:
  autopilot replay verify flights/000001-1a2b3c4d
  autopilot replay verify flights/000001-1a2b3c4d --json
  autopilot replay show flights/000001-1a2b3c4d --from 100 --to 160
  autopilot replay show flights/000001-1a2b3c4d --kind order_received
  autopilot replay why flights/000001-1a2b3c4d 142

exit codes: 0 identical, 65 the flight diverges or is damaged, 66 there is no such flight, 74 it can't be read
"""
_VERIFY = """\
Check the chain of a flight's log, then run every observation through the same charts and compare every decision,
field by field and byte for byte. A flight that is still open is verified up to its newest record.
"""
_SHOW = "Print a flight's records, one a line: seconds of the flight, seq, kind, and what it says."
_WHY = "Print what led to a record, back to the observation that it came from, and everything that it led to."


def add(commands: Any) -> None:
    """Add the command and its own commands to the program's."""
    made = commands.add_parser(
        "replay",
        help="run a recorded flight again, show it, or ask it why",
        description="Run a recorded flight again, show it, or ask it why.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    own = made.add_subparsers(dest="replay_command", required=True, metavar="COMMAND")
    one = _command(own, "verify", "compare every decision with what the charts decide now", _VERIFY)
    one.add_argument("--json", action="store_true", help="print the verdict as one JSON object")
    one.set_defaults(run=run_verify)
    one = _command(own, "show", "print records in words", _SHOW)
    one.add_argument("--from", dest="start", type=_seq, default=0, metavar="SEQ", help="first record (default 0)")
    one.add_argument("--to", dest="stop", type=_seq, default=None, metavar="SEQ", help="last record (default: the end)")
    one.add_argument("--kind", default="", help="only records of this kind, e.g. order_received")
    one.set_defaults(run=run_show)
    one = _command(own, "why", "print causes and consequences of a record", _WHY)
    one.add_argument("seq", type=_seq, metavar="SEQ", help="number of the record")
    one.add_argument("--json", action="store_true", help="print both lists as one JSON object")
    one.set_defaults(run=run_why)


def _command(own: Any, name: str, brief: str, description: str) -> argparse.ArgumentParser:
    made: argparse.ArgumentParser = own.add_parser(
        name,
        help=brief,
        description=description,
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    made.add_argument("flight", metavar="FLIGHT", help="folder of the flight")
    return made


def _seq(text: str) -> int:
    if not text.isascii() or not text.isdigit():
        raise argparse.ArgumentTypeError(f"{text!r} is no number of a record: 0, 1, 2, ...")
    return int(text)


def run_verify(args: argparse.Namespace) -> int:
    """Verify a flight; return the exit code."""
    return with_flight(args.flight, lambda reader: _verify(reader, as_json=args.json))


def _verify(reader: Reader, *, as_json: bool) -> int:
    bar = Bar("replaying")
    try:
        verdict = verify(reader, bar)
    finally:
        bar.end()
    if as_json:
        print(json.dumps(verdict.plain(), sort_keys=True))
    else:
        _report(verdict)
        print(verdict.words())
    return os.EX_OK if verdict.holds else os.EX_DATAERR


def _report(verdict: Verdict) -> None:
    """Tell on stderr what a divergence rests on."""
    if verdict.first is None:
        return
    print("the first decision that comes out otherwise, and what led to it:", file=sys.stderr)
    for shown in verdict.first.causes:
        print(line_text(shown), file=sys.stderr)
    print(f"  recorded  {verdict.first.recorded}\n  replayed  {verdict.first.replayed}", file=sys.stderr)


def run_show(args: argparse.Namespace) -> int:
    """Print records; return the exit code."""
    stop = None if args.stop is None else args.stop + 1
    try:
        kind = kind_named(args.kind) if args.kind else None
    except UnknownKind as error:
        return _wrong(str(error))
    return with_flight(args.flight, lambda reader: _print(show(reader, args.start, stop, kind)))


def run_why(args: argparse.Namespace) -> int:
    """Print causes and consequences of a record; return the exit code."""
    try:
        return with_flight(args.flight, lambda reader: _why(reader, args.seq, as_json=args.json))
    except LookupError as error:
        return _wrong(str(error))


def _why(reader: Reader, seq: int, *, as_json: bool) -> int:
    causes, led_to = chain(reader, seq), tuple(consequences(reader, seq))
    if as_json:
        print(json.dumps({"causes": _plain(causes), "led_to": _plain(led_to)}, sort_keys=True))
        return os.EX_OK
    print("because of (newest first):")
    _print(map(line_text, causes))
    print("led to:" if led_to else "led to nothing")
    return _print(map(line_text, led_to))


def _plain(lines: Iterable[Line]) -> list[dict[str, Any]]:
    return [asdict(shown) for shown in lines]


def _print(lines: Iterable[str]) -> int:
    for text in lines:
        print(text)
    return os.EX_OK


def _wrong(words: str) -> int:
    print(f"autopilot replay: {words}", file=sys.stderr)
    return USAGE
