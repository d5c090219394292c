"""`autopilot export redacted`: the words of the command. What is done is in `redacting`."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path
from typing import Any

from autopilot.cli.flight import USAGE, folder_of, with_flight
from autopilot.cli.redacting import Choice, NotToRedact, Statement, check_sound, left_behind, write_copy
from events import ChainBroken, Kind, UnknownKind, kind_named
from events.store import Reader
from projections.words import ranges, timestamp
from replay.causes import line
from replay.descent import Descent, computed_again, descent
from replay.show import line_text

_DESCRIPTION = """\
Write a copy of a flight in which some records say nothing any more. Of a removed one the header stays (number,
cause, time, kind) and the salted hash of what it said; salt and secret are not in the copy, so it can't be guessed.
Chain, checkpoints, proofs and the node's own verdict stand; a replay says INCOMPLETE and compares what is left.

Records are named by --seq, by --kind, or both; --after and --before keep to a stretch of the flight, and alone choose
all of it. What descends from a removed record may say the same once more: it is named, and removed too with
--with-descendants. The flight itself is only read.
"""
_EXAMPLES = """\
examples:
  autopilot export redacted flights/000001-1a2b3c4d copy --kind frame_observed --with-descendants --dry-run
  autopilot export redacted flights/000001-1a2b3c4d copy --seq 142,160-171 --by "A. Roth" --because "a face"
  autopilot export redacted flights/000001-1a2b3c4d copy --after 12.5 --before 40 --by "A. Roth" --because "home"
  autopilot replay verify copy

exit codes: 0 written (or listed), 2 usage, 65 the flight is damaged or nothing of it is chosen, 66 there is no such \
flight, 73 OUT can't be written, 74 the flight can't be read
"""
_LINES_MOST = 20  # of the records that descend; --dry-run shows all


def add(kinds: Any) -> None:
    """Add the command to those of `autopilot export`."""
    one = kinds.add_parser(
        "redacted",
        help="a copy in which some records say nothing any more",
        description=_DESCRIPTION,
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    one.add_argument("flight", metavar="FLIGHT", help="folder of the flight, or of a copy that is to lose more")
    one.add_argument("out", metavar="OUT", help="folder to write; it must not be there yet")
    one.add_argument("--seq", type=_seqs, default=frozenset(), metavar="N,M-K", help="records by number")
    one.add_argument("--kind", type=_kinds, default=(), metavar="KIND,...", help="records by kind, e.g. frame_observed")
    one.add_argument("--after", type=float, default=0.0, metavar="S", help="from this second of the flight on")
    one.add_argument("--before", type=float, default=float("inf"), metavar="S", help="up to this second of the flight")
    one.add_argument("--with-descendants", action="store_true", help="remove too what they led to or is at their place")
    one.add_argument("--by", default="", metavar="NAME", help="who removes it; stands in redaction.json")
    one.add_argument("--because", default="", metavar="TEXT", help="why; stands in redaction.json")
    one.add_argument("--dry-run", action="store_true", help="list what would go, and what would still say it")
    one.add_argument("--json", action="store_true", help="print what was chosen and written as one JSON object")
    one.set_defaults(run=run)


def _seqs(text: str) -> frozenset[int]:
    found: set[int] = set()
    for part in text.split(","):
        first, dash, last = part.partition("-")
        if not all(number.isascii() and number.isdigit() for number in (first, last if dash else first)):
            raise argparse.ArgumentTypeError(f"{text!r} names no records: 7 or 7,40-44")
        found.update(range(int(first), int(last or first) + 1))
    return frozenset(found)


def _kinds(text: str) -> tuple[Kind, ...]:
    try:
        return tuple(kind_named(name) for name in text.split(","))
    except UnknownKind as error:
        raise argparse.ArgumentTypeError(str(error.args[0])) from error


def run(args: argparse.Namespace) -> int:
    """Write a redacted copy; return the exit code."""
    if not (args.seq or args.kind or args.after > 0 or args.before < float("inf")):
        return _wrong("say which records: --seq, --kind, --after, --before", USAGE)
    if not args.dry_run and not (args.by and args.because):
        return _wrong("say --by whom and --because of what: both stand in the copy", USAGE)
    try:
        return with_flight(args.flight, lambda reader: _redact(reader, args))
    except (NotToRedact, ChainBroken) as error:
        return _wrong(str(error), os.EX_DATAERR)


def _redact(reader: Reader, args: argparse.Namespace) -> int:
    finding = check_sound(folder_of(args.flight))
    chosen = Choice(args.seq, args.kind, args.after, args.before).chosen(reader.stored())
    found = descent(reader, chosen)
    remove = chosen | found.all if args.with_descendants else chosen
    if not args.dry_run:
        at = timestamp(time.time_ns())
        said = Statement(by=args.by, at=at, because=args.because, software=version("autopilot"))
        try:
            write_copy(reader, finding, Path(args.out), remove, said)
        except OSError as error:
            if error.filename is None:
                raise
            return _wrong(f"{args.out} can't be written: {error.strerror}", os.EX_CANTCREAT)
    if args.json:
        print(json.dumps(_plain(reader, chosen, found, remove, args), sort_keys=True))
    else:
        _report(reader, found, remove, args)
    return os.EX_OK


def _plain(
    reader: Reader, chosen: set[int], found: Descent, remove: set[int], args: argparse.Namespace
) -> dict[str, Any]:
    again = computed_again(reader, remove)
    return {
        "computed_again": ranges(again),
        "out": "" if args.dry_run else args.out,
        "chosen": ranges(chosen),
        "led_to": ranges(found.led_to),
        "same_place": ranges(found.same_place),
        "removed": ranges(remove),
        "left_behind": left_behind(folder_of(args.flight)),
    }


def _report(reader: Reader, found: Descent, remove: set[int], args: argparse.Namespace) -> None:
    """Say what goes, what descends from it and stays, and what else lies in the folder."""
    if args.dry_run:
        print(f"would be removed: {len(remove)} records")
        _list(reader, remove, len(remove))
    else:
        print(f"{args.out}: without {len(remove)} records: {ranges(remove)}", file=sys.stderr)
    for what, seqs in (("what they led to", found.led_to), ("what says one of their places again", found.same_place)):
        staying = seqs - remove
        if staying:
            print(f"{what} stays, {len(staying)} records; --with-descendants removes it:", file=sys.stderr)
            _list(reader, staying, len(staying) if args.dry_run else _LINES_MOST, file=sys.stderr)
    if again := computed_again(reader, remove):
        print(f"a replay decides again what {ranges(again)} said: their observations stay", file=sys.stderr)
    if behind := left_behind(folder_of(args.flight)):
        print(f"not carried over: {', '.join(behind)}", file=sys.stderr)


def _list(reader: Reader, seqs: Iterable[int], most: int, file: Any = None) -> None:
    listed = sorted(seqs)
    shown = set(listed[:most])
    for stored in reader.stored(listed[0], listed[min(most, len(listed)) - 1] + 1):
        if stored.seq in shown:
            print(line_text(line(stored)), file=file)
    if len(listed) > most:
        print(f"        and {len(listed) - most} more", file=file)


def _wrong(words: str, code: int) -> int:
    print(f"autopilot export: {words}", file=sys.stderr)
    return code
