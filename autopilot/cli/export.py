"""`autopilot export`: a flight in a form that others read. The flight is only read."""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
import tempfile
from itertools import takewhile
from pathlib import Path
from typing import Any

from autopilot.cli import redacted
from autopilot.cli.flight import USAGE, folder_of, with_flight
from autopilot.ground.consistency import check_consistent
from autopilot.ground.verifier import ProofRefused, Proved, check
from autopilot.node.sealing import CERTIFICATE_FILE
from autopilot.trust.identity import ROOT_FILE, TOKEN_FILE
from events import read_record
from events.store import Reader
from projections.bundle import build, build_push, build_redacted
from projections.canonical import json_text
from replay.proof import Papers, prove, prove_consistency

_EXAMPLES = """\
examples:
  autopilot export bundle flights/000001-1a2b3c4d bundle.json
  autopilot export bundle flights/000001-1a2b3c4d - | python -m json.tool
  autopilot export observations flights/000001-1a2b3c4d push.json
  autopilot export proof flights/000001-1a2b3c4d --seq 142 proof.json
  autopilot export consistency flights/000001-1a2b3c4d --from 1000 --to 2000 grown.json
  autopilot export redacted flights/000001-1a2b3c4d copy --kind frame_observed --by NAME --because WHY

exit codes: 0 written, 65 the flight can't be understood or proves nothing, 66 there is no such flight, \
73 OUT can't be written, 74 the flight can't be read
"""
_BUNDLE = """\
Write the post-flight bundle as JSON: map objects, observations, ignored items, points of interest, audit rows and a
summary of the flight. The same flight gives the same bytes every time.
"""
_OBSERVATIONS = """\
Write what a flight saw and muted as JSON, as the node posts it to the mission office after a landing: what an office
took whole already is left out. For a flight whose push failed, to be posted by hand.
"""
_PROOF = """\
Write one record with everything that led to it as a proof: `autopilot verify OUT` checks it, offline and without a
key, against the newest checkpoint that a witness cosigned, or that the node signed where none did. What is written was
checked so before.
"""
_CONSISTENCY = """\
Write the proof that the log only grew between two signed checkpoints: `autopilot verify OUT` checks it, offline and
without a key. No record is shown.
"""


def add(commands: Any) -> None:
    """Add the command and its own commands to the program's."""
    made = commands.add_parser(
        "export",
        help="write a flight in a form that others read",
        description="Write a flight in a form that others read.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    own = made.add_subparsers(dest="export_kind", required=True, metavar="KIND")
    one = own.add_parser(
        "bundle",
        help="the post-flight bundle as JSON",
        description=_BUNDLE,
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    one.add_argument("flight", metavar="FLIGHT", help="folder of the flight")
    one.add_argument("out", metavar="OUT", help="file to write; - for standard output")
    one.add_argument("--json", action="store_true", help="print what was written as one JSON object")
    one.set_defaults(run=run)
    one = own.add_parser(
        "observations",
        help="what the mission office has not taken yet, as JSON",
        description=_OBSERVATIONS,
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    one.add_argument("flight", metavar="FLIGHT", help="folder of the flight")
    one.add_argument("out", metavar="OUT", help="file to write; - for standard output")
    one.add_argument("--until", type=int, metavar="N", help="number of the last record that counts (default: the last)")
    one.set_defaults(run=run_observations)
    one = own.add_parser(
        "proof",
        help="one record and what led to it, for anybody to verify",
        description=_PROOF,
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    one.add_argument("flight", metavar="FLIGHT", help="folder of the flight")
    one.add_argument("--seq", type=int, required=True, metavar="N", help="number of the record")
    one.add_argument("out", metavar="OUT", help="file to write; - for standard output")
    one.set_defaults(run=run_proof)
    one = own.add_parser(
        "consistency",
        help="that the log only grew between two checkpoints",
        description=_CONSISTENCY,
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    one.add_argument("flight", metavar="FLIGHT", help="folder of the flight")
    one.add_argument("--from", dest="old", type=int, required=True, metavar="N", help="records under the older one")
    one.add_argument(
        "--to", dest="new", type=int, metavar="M", help="records under the newer one (default: the newest)"
    )
    one.add_argument("out", metavar="OUT", help="file to write; - for standard output")
    one.set_defaults(run=run_consistency)
    redacted.add(own)


def run(args: argparse.Namespace) -> int:
    """Write a bundle; return the exit code."""
    if args.json and args.out == "-":
        print("autopilot export: --json and OUT - would both use standard output; name a file", file=sys.stderr)
        return USAGE
    return with_flight(args.flight, lambda reader: _bundle(reader, args.out, as_json=args.json))


def run_observations(args: argparse.Namespace) -> int:
    """Write what is to be pushed; return the exit code."""
    return with_flight(args.flight, lambda reader: _observations(reader, args.out, args.until))


def run_proof(args: argparse.Namespace) -> int:
    """Write a proof; return the exit code."""
    return with_flight(args.flight, lambda reader: _proof(reader, folder_of(args.flight), args.seq, args.out))


def run_consistency(args: argparse.Namespace) -> int:
    """Write a consistency proof; return the exit code."""
    folder = folder_of(args.flight)
    return with_flight(args.flight, lambda reader: _consistency(reader, folder, (args.old, args.new), args.out))


def _consistency(reader: Reader, folder: Path, sizes: tuple[int, int | None], out: str) -> int:
    try:
        data = prove_consistency(reader, *sizes, _papers(folder))
        proved = check_consistent(data)
    except (LookupError, ProofRefused) as error:
        print(f"autopilot export: {error}", file=sys.stderr)
        return os.EX_DATAERR
    code = _put(out, data)
    if code == os.EX_OK and out != "-":
        said = f"from {proved.old.size} to {proved.new.size} records, {len(data)} bytes"
        print(f"{out}: {said}; autopilot verify {out}", file=sys.stderr)
    return code


def _checked_proof(reader: Reader, seq: int, papers: Papers) -> tuple[bytes, Proved]:
    """Return a proof that holds: where the flight had another key when it was cosigned, one without cosignatures."""
    data = prove(reader, seq, papers)
    try:
        return data, check(data)
    except ProofRefused:
        data = prove(reader, seq, papers, cosigned=False)
        return data, check(data)


def _proof(reader: Reader, folder: Path, seq: int, out: str) -> int:
    try:
        data, proved = _checked_proof(reader, seq, _papers(folder))
    except (LookupError, ProofRefused) as error:
        print(f"autopilot export: {error}", file=sys.stderr)
        return os.EX_DATAERR
    code = _put(out, data)
    if code == os.EX_OK and out != "-":
        led = len(proved.records) - 1
        print(
            f"{out}: record {seq} and {led} that led to it, {len(data)} bytes; autopilot verify {out}", file=sys.stderr
        )
    return code


def _papers(folder: Path) -> Papers:
    """Read what the node laid beside the log. Raises LookupError."""
    try:
        return Papers(
            log_key=(folder / CERTIFICATE_FILE).read_text("utf-8"),
            token=(folder / TOKEN_FILE).read_bytes(),
            trust_root=(folder / ROOT_FILE).read_bytes(),
        )
    except (OSError, UnicodeDecodeError) as error:
        raise LookupError(f"nobody signed this flight, so nothing of it can be proved: {error}") from error


def _bundle(reader: Reader, out: str, *, as_json: bool) -> int:
    try:
        bundle = build(map(read_record, reader.stored())) if reader.secret else build_redacted(reader.stored())
    except LookupError as error:
        print(f"autopilot export: {error}", file=sys.stderr)
        return os.EX_DATAERR
    data = json_text(bundle).encode() + b"\n"
    code = _put(out, data)
    if code != os.EX_OK or out == "-":
        return code
    _tell(out, data, bundle, as_json=as_json)
    return os.EX_OK


def _observations(reader: Reader, out: str, until: int | None) -> int:
    log = reader.stored() if until is None else takewhile(lambda stored: stored.seq <= until, reader.stored())
    try:
        push = build_push(map(read_record, log))
    except LookupError as error:
        print(f"autopilot export: {error}", file=sys.stderr)
        return os.EX_DATAERR
    code = _put(out, json_text(push).encode() + b"\n")
    if code == os.EX_OK and out != "-":
        told = f"{len(push['observations'])} observations, {len(push['ignored_items'])} ignored items"
        print(f"{out}: {told} of mission {push['mission_id'] or 'none'}", file=sys.stderr)
    return code


def _put(out: str, data: bytes) -> int:
    """Write to a file or to standard output; return the exit code."""
    if out == "-":
        sys.stdout.write(data.decode())
        return os.EX_OK
    try:
        write_whole(Path(out), data)
    except OSError as error:
        print(f"autopilot export: {out} can't be written: {error.strerror}", file=sys.stderr)
        return os.EX_CANTCREAT
    return os.EX_OK


def write_whole(path: Path, data: bytes) -> None:
    """Write a file as a whole or not at all. Raises OSError."""
    descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        Path(name).chmod(0o644)
        Path(name).replace(path)
    except OSError:
        Path(name).unlink(missing_ok=True)
        raise


def _tell(out: str, data: bytes, bundle: dict[str, Any], *, as_json: bool) -> None:
    counts = {name: len(bundle[name]) for name in ("map_objects", "observations", "ignored_items", "pois", "audit")}
    if as_json:
        written = {"bundle": out, "bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
        print(json.dumps(written | counts, sort_keys=True))
    else:
        listed = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in counts.items())
        print(f"{out}: {listed}", file=sys.stderr)
