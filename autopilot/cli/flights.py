"""`autopilot flights`: what lies on this disk, what of it was pushed elsewhere, and what of that may go."""

from __future__ import annotations

import argparse
import json
import os
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from autopilot.cli.configuration import DEFAULT_PATH, VARIABLE, ConfigurationError, load
from autopilot.cli.flight import folder_of
from autopilot.node import deleting
from autopilot.node.lock import FolderLock, FolderTaken
from autopilot.node.receipts import Receipt, write_receipt
from autopilot.node.stock import Stocked, stock_of, stocked
from autopilot.ports.config import Config
from autopilot.trust.clock import HostClock, wall_ms
from events.store import Flight, StoreMissing
from projections.describe import close_words

_EXAMPLES = """\
examples:
  autopilot flights list --config node/config.toml
  autopilot flights list --config node/config.toml --json | jq '.[] | select(.pushed == null)'
  autopilot flights pushed node/flights/000001-1a2b3c4d --to archive:/flights --head 5be0...
  autopilot flights prune --config node/config.toml --dry-run

exit codes: 0 done, 65 the flight is damaged, still open, or not what was pushed, 66 there is no such flight,
  69 the daemon runs and deletes by itself, 74 I/O, 78 the configuration is wrong
"""
_PUSHED = """\
Say that a flight lies elsewhere, whole, so that it may be deleted here some day. The log is checked first: it must be
closed and sound. Copy the folder, run `autopilot replay check --json` on the copy, and give its last_leaf as --head:
then the receipt says that what arrived is what is here.
"""
_PRUNE = """\
Delete now what the daemon would delete by itself ([retention] in the configuration): flights that are closed, pushed,
none of the newest, and old; or younger ones while the disk is short. The daemon must not run; its next start tells of
each in its log.
"""


def add(commands: Any) -> None:
    """Add the command and its own commands to the program's."""
    made = _parser(commands, "flights", "flights on this disk: list, pushed, prune", "What lies on this disk.")
    own = made.add_subparsers(dest="flights_command", required=True, metavar="COMMAND")
    one = _parser(own, "list", "show the flights, oldest first", "Show the flights of a node, oldest first.")
    _from_config(one)
    one.add_argument("--json", action="store_true", help="print them as one JSON list")
    one.set_defaults(run=run_list)
    one = _parser(own, "pushed", "say that a flight lies elsewhere", _PUSHED)
    one.add_argument("flight", metavar="FLIGHT", help="folder of the flight")
    one.add_argument("--to", required=True, metavar="WHERE", help="where it lies now, in your words")
    one.add_argument("--head", default="", metavar="LEAF", help="last leaf of what arrived there, in hex")
    one.set_defaults(run=run_pushed)
    one = _parser(own, "prune", "delete what may go", _PRUNE)
    _from_config(one)
    one.add_argument("--dry-run", action="store_true", help="say what would go, and delete nothing")
    one.add_argument("--json", action="store_true", help="print what goes as one JSON object")
    one.set_defaults(run=run_prune)


def _parser(commands: Any, name: str, brief: str, description: str) -> argparse.ArgumentParser:
    made: argparse.ArgumentParser = commands.add_parser(
        name,
        help=brief,
        description=description,
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    return made


def _from_config(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--config", metavar="FILE", help=f"the configuration (default: ${VARIABLE} or {DEFAULT_PATH})")


def _config(args: argparse.Namespace) -> Config:
    return load(args.config, os.environ, inputs=False)


def run_list(args: argparse.Namespace) -> int:
    """Show the flights; return the exit code."""
    try:
        found = list(stock_of(Path(_config(args).node.flights)))
    except ConfigurationError as error:
        return _told(str(error), error.exit_code)
    except OSError as error:
        return _told(str(error), os.EX_IOERR)
    if args.json:
        print(json.dumps([plain(one) for one in found], sort_keys=True))
    else:
        for one in found:
            print(line(one))
    return os.EX_OK


def plain(one: Stocked) -> dict[str, Any]:
    """Return a flight as a JSON-able structure."""
    return {
        "number": one.flight.number,
        "folder": str(one.flight.folder),
        "flight_id": one.flight_id.hex(),
        "began_ms": one.began_ms,
        "ended_ms": one.ended_ms if one.closed is not None else None,
        "closed_because": None if one.closed is None else close_words(one.closed),
        "records": one.head.seq + 1,
        "last_leaf": one.head.leaf.hex(),
        "size_bytes": one.size_bytes,
        "verdict": one.verdict or None,
        "pushed": None if one.receipt is None else {"to": one.receipt.to, "at_ms": one.receipt.at_ms},
        "unreadable": one.unreadable or None,
    }


def line(one: Stocked) -> str:
    """Return a flight in one line."""
    size = f"{one.size_bytes / (1 << 20):8.1f} MiB"
    if one.unreadable:
        return f"{one.flight.number:6}  {one.flight.folder.name[7:]}  {size}  can't be read: {one.unreadable}"
    ended = f"until {_time(one.ended_ms)}, {close_words(one.closed)}" if one.closed is not None else "not closed"
    pushed = f"pushed to {one.receipt.to}" if one.receipt is not None else "not pushed"
    said = [f"{_time(one.began_ms)} {ended}", f"{one.head.seq + 1} records", one.verdict or "no verdict", pushed]
    return f"{one.flight.number:6}  {one.flight_id.hex()[:8]}  {size}  {'; '.join(said)}"


def _time(at_ms: int) -> str:
    return datetime.fromtimestamp(at_ms / 1000, tz=UTC).strftime("%Y-%m-%d %H:%M:%SZ")


def run_pushed(args: argparse.Namespace) -> int:
    """Write the receipt of a flight; return the exit code."""
    # Looking at a log needs numpy, which the other commands do not wait for.
    from events.store.recovery import examine

    folder = folder_of(args.flight)
    try:
        finding = examine(folder)
    except StoreMissing as error:
        return _told(f"{error}; name the folder of a flight, like flights/000001-1a2b3c4d", os.EX_NOINPUT)
    if not finding.sound:
        return _told(f"not taken: {finding.words()}", os.EX_DATAERR)
    number = int(folder.resolve().name.partition("-")[0])
    one = stocked(Flight(number, folder))
    if one.closed is None:
        return _told("not taken: the flight is not closed, so it is not whole yet", os.EX_DATAERR)
    if args.head and args.head.lower() != one.head.leaf.hex():
        return _told(f"not taken: what was pushed ends otherwise; here {one.head.leaf.hex()}", os.EX_DATAERR)
    receipt = Receipt(
        flight_number=number,
        flight_id=one.flight_id.hex(),
        last_seq=one.head.seq,
        last_leaf=one.head.leaf.hex(),
        to=args.to,
        at_ms=wall_ms(HostClock()),
    )
    try:
        write_receipt(folder, receipt)
    except OSError as error:
        return _told(str(error), os.EX_IOERR)
    print(f"flight {number}, records 0 to {one.head.seq}, counts as pushed to {args.to}")
    return os.EX_OK


def run_prune(args: argparse.Namespace) -> int:
    """Delete what may go, or say what would; return the exit code."""
    try:
        config = _config(args)
        root = Path(config.node.flights)
        if args.dry_run:
            found = deleting.planned(root, config.retention, wall_ms(HostClock()))
        else:
            with FolderLock(root):
                found = deleting.planned(root, config.retention, wall_ms(HostClock()))
                deleting.prune(root, found.delete)
    except ConfigurationError as error:
        return _told(str(error), error.exit_code)
    except FolderTaken:
        return _told("the daemon runs, and deletes what may go by itself", os.EX_UNAVAILABLE)
    except OSError as error:
        return _told(str(error), os.EX_IOERR)
    if args.json:
        print(json.dumps({"deleted": list(found.delete), "short": found.short or None, "dry_run": args.dry_run}))
    else:
        verb = "would be deleted" if args.dry_run else "deleted"
        print("\n".join(f"flight {number} {verb}" for number in found.delete) or "no flight may go")
        if found.short:
            print(found.short, file=sys.stderr)
    return os.EX_OK


def _told(words: str, code: int) -> int:
    print(f"autopilot flights: {words}", file=sys.stderr)
    return code
