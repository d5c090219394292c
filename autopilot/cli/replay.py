"""`autopilot replay`: a recorded flight, run again, shown, or asked why. It changes nothing."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from google.protobuf.message import DecodeError

from autopilot.cli.bar import Bar
from autopilot.cli.blaming import blamed, tell_blame
from autopilot.cli.copies import tell_recovered
from autopilot.cli.flight import USAGE, folder_of, with_flight
from autopilot.cli.givers import givers
from autopilot.cli.redactions import redactions_of, told
from autopilot.cli.seeking import show_at
from autopilot.trust.notes import NoteInvalid
from autopilot.trust.replayed import VERDICT_FILE, read_verdict
from events import UnknownKind, kind_named
from events.schema.flight_pb2 import FlightOpened
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
  autopilot replay show flights/000001-1a2b3c4d --at 160
  autopilot replay why flights/000001-1a2b3c4d 142
  autopilot replay check flights/000001-1a2b3c4d
  autopilot replay recover flights/000001-1a2b3c4d recovered
  autopilot replay check flights --witness alice

exit codes: 0 identical or sound, 65 the flight diverges, is damaged, or is a redacted copy, 66 there is no such \
flight, 74 it can't be read
"""
CAUSES_SHOWN = 12  # lines of a chain of causes: the report should fit on a screen
_VERIFY = """\
Check the chain of a flight's log, then run every observation through the same charts and compare every decision,
field by field and byte for byte. A flight that is still open is verified up to its newest record. Where a decision
comes out otherwise, tests say who is to blame: code, configuration, upcast, environment, missing or reordered input.
Of a redacted copy what is left is compared, and what was removed is named: INCOMPLETE(records).
"""
_CHECK = """\
Say what state a flight's log is in, and change nothing: the WAL is read before SQLite opens the database, every record
is held against the chain, and the end of the log against its head file. A torn tail, as a power cut leaves it, is
sound; a missing head file is not, for then nothing tells whether records are missing at the end. What was signed is
held against the log too. With the folder of all flights each one is held against the one after it as well, and with
--witness against the newest checkpoint that an operator has kept.
"""
_RECOVER = """\
Write a copy of what holds of a damaged or torn log to a new folder, and leave the log as it is. Every record whose
chain holds from the first on is copied with its leaf, as far as the last whole step; what else can be read, what is
lost, and what the head file knew is said here and in recovered.json beside the copy, which can be verified like any
flight. Exit code 0 only where nothing is wrong.
"""
_SHOW = """\
Print a flight's records, one a line: seconds of the flight, seq, kind, and what it says. With --at: the state after one
record instead, from the nearest snapshot before it: which tables have how many rows, and what was open.
"""
_WHY = """\
Print what led to a record, back to the observation that it came from, and everything that it led to. Where an order
led to it, its envelope is checked, without the group key: who signed it, with which key, that the Directory vouches for
that key, and that it was for this node.
"""


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
    one.add_argument("--at", type=_seq, default=None, metavar="SEQ", help="no records: the state after this one")
    one.add_argument("--json", action="store_true", help="with --at: print the state as one JSON object")
    one.set_defaults(run=run_show)
    one = _command(own, "why", "print causes and consequences of a record", _WHY)
    one.add_argument("seq", type=_seq, metavar="SEQ", help="number of the record")
    one.add_argument("--json", action="store_true", help="print both lists as one JSON object")
    one.set_defaults(run=run_why)
    one = _command(own, "check", "say what state the log is in, also where it can't be opened", _CHECK)
    one.add_argument("--json", action="store_true", help="print what was found as one JSON object")
    witness = "with the folder of all flights: an operator's folder, whose trust root and witness are believed"
    one.add_argument("--witness", type=Path, default=None, metavar="FOLDER", help=witness)
    one.set_defaults(run=run_check)
    one = _command(own, "recover", "copy what holds of a damaged log", _RECOVER)
    one.add_argument("out", metavar="OUT", help="folder to write the copy to; it must not be there")
    one.add_argument("--json", action="store_true", help="print what was found and done as one JSON object")
    one.set_defaults(run=run_recover)


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
    return with_flight(args.flight, lambda reader: _verify(reader, folder_of(args.flight), as_json=args.json))


def _verify(reader: Reader, folder: Path, *, as_json: bool) -> int:
    bar = Bar("replaying")
    try:
        verdict = verify(reader, bar)
    finally:
        bar.end()
    blame = blamed(reader, verdict)
    if as_json:
        print(json.dumps(verdict.plain() | ({"blame": blame.plain()} if blame else {}), sort_keys=True))
    else:
        _report(verdict)
        if blame is not None:
            tell_blame(blame)
        print(verdict.words())
        for text in told(redactions_of(folder)):
            print(text, file=sys.stderr)
        _tell_signed(reader, folder)
    return os.EX_OK if verdict.holds else os.EX_DATAERR


def _tell_signed(reader: Reader, folder: Path) -> None:
    """Tell on stderr what the node itself has signed of this flight, where it has, and whether it is a copy."""
    tell_recovered(folder)
    first = next(iter(reader.stored(0, 1)), None)
    if first is None or not (folder / VERDICT_FILE).exists():
        return
    try:
        opened = FlightOpened.FromString(first.body)
        signed = read_verdict(folder, opened.node_public_key, f"waypoint/{opened.deployment_id}/{opened.node}")
    except (DecodeError, NoteInvalid) as error:
        print(f"the verdict beside the log is not to be believed: {error}", file=sys.stderr)
        return
    if signed is not None:
        last = next(iter(reader.stored(signed.seq, signed.seq + 1)), None)
        other = "" if last is not None and last.leaf.hex() == signed.leaf else ", of another log than this"
        whole = "" if reader.secret else " over the whole log"
        verdict = f"{signed.verdict}{whole} up to record {signed.seq}, software {signed.software}{other}"
        print(f"signed by {opened.node}: {verdict}", file=sys.stderr)


def _report(verdict: Verdict) -> None:
    """Tell on stderr what a divergence rests on."""
    if verdict.first is None:
        return
    print("the first decision that comes out otherwise, and what led to it:", file=sys.stderr)
    causes = verdict.first.causes
    shown = causes if len(causes) <= CAUSES_SHOWN else (*causes[: CAUSES_SHOWN - 1], causes[-1])
    for one in shown:
        if one is causes[-1] and len(shown) < len(causes):
            print(f"    ...  {len(causes) - len(shown)} more, which `replay why` shows", file=sys.stderr)
        print(line_text(one), file=sys.stderr)
    print(f"  recorded  {verdict.first.recorded}\n  replayed  {verdict.first.replayed}", file=sys.stderr)


def run_check(args: argparse.Namespace) -> int:
    """Say what state a flight's log is in; return the exit code."""
    # It needs numpy, which the other commands do not wait for.
    from autopilot.cli import checking

    return checking.check(folder_of(args.flight), as_json=args.json, witness=args.witness)


def run_recover(args: argparse.Namespace) -> int:
    """Write a copy of what holds of a log; return the exit code."""
    from autopilot.cli import recovering

    return recovering.recover(folder_of(args.flight), Path(args.out), as_json=args.json)


def run_show(args: argparse.Namespace) -> int:
    """Print records; return the exit code."""
    stop = None if args.stop is None else args.stop + 1
    if args.at is not None:
        return _show_at(args.flight, args.at, as_json=args.json)
    try:
        kind = kind_named(args.kind) if args.kind else None
    except UnknownKind as error:
        return _wrong(str(error))
    return with_flight(args.flight, lambda reader: _print(show(reader, args.start, stop, kind)))


def _show_at(flight: str, seq: int, *, as_json: bool) -> int:
    try:
        return with_flight(flight, lambda reader: show_at(reader, folder_of(flight), seq, as_json=as_json))
    except LookupError as error:
        return _wrong(str(error))


def run_why(args: argparse.Namespace) -> int:
    """Print causes and consequences of a record; return the exit code."""
    try:
        return with_flight(
            args.flight, lambda reader: _why(reader, folder_of(args.flight), args.seq, as_json=args.json)
        )
    except LookupError as error:
        return _wrong(str(error))


def _why(reader: Reader, folder: Path, seq: int, *, as_json: bool) -> int:
    causes, led_to = chain(reader, seq), tuple(consequences(reader, seq))
    signed = givers(reader, folder, [shown.seq for shown in causes])
    if as_json:
        print(json.dumps({"causes": _plain(causes), "led_to": _plain(led_to), "signed": signed}, sort_keys=True))
        return os.EX_OK
    print("because of (newest first):")
    _print(map(line_text, causes))
    _print(f"record {order}: {words}" for order, words in signed.items())
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
