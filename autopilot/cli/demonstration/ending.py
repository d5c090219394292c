"""How the demo ends: the bundle is written, the flight is run again, and the reader is told where everything is."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from autopilot.cli.bar import Bar
from autopilot.cli.export import write_whole
from events import Record, read_record
from events.schema.vehicle_pb2 import PointAtAngles, PointAtPlace, ReleasePointing
from events.store import Reader, read_flight
from projections.bundle import build
from projections.canonical import json_text
from replay.verify import verify

Say = Callable[[str], None]


def end(folder: Path, flight: Path, say: Say) -> dict[str, Any]:
    """Export, replay, tell; return the summary that `--json` prints. Raises StoreFailed."""
    reader = read_flight(flight)
    try:
        records = list(map(read_record, reader.stored()))
        bundle = build(records)
        out = folder / "bundle.json"
        write_whole(out, json_text(bundle).encode() + b"\n")
        replay = _replayed(reader, say)
    finally:
        reader.close()
    summary = _summary(flight, bundle, replay, out)
    _tell(summary, records, sum(item["muted"] for item in bundle["ignored_items"]), say)
    _next(folder, flight, records, say)
    return summary


def _replayed(reader: Reader, say: Say) -> str:
    bar = Bar("replay")
    verdict = verify(reader, bar)
    bar.end()
    say(f"The flight is run again from its log: {verdict.words()}.")
    return verdict.outcome.value


def _summary(flight: Path, bundle: dict[str, Any], replay: str, out: Path) -> dict[str, Any]:
    told = bundle["flight"]
    return {
        "flight": str(flight),
        "events": told["records"],
        "orders": told["orders"],
        "pois": told["pois"],
        "map_objects": told["map_objects"],
        "samples_dropped": told["samples_rejected"],
        "replay": replay,
        "bundle": str(out),
    }


def _tell(summary: dict[str, Any], records: list[Record], muted: int, say: Say) -> None:
    say(
        f"Orders: {_counts(summary['orders'])}. The vehicle was asked at most {_most_effects(records)} time(s) for one."
    )
    say(f"Findings: {_counts(summary['pois'])}; {summary['map_objects']} objects on the map.")
    say(f"Sightings that stayed quiet because something like them was declined there: {muted}.")
    say(f"Dropped at the edges: {_counts(summary['samples_dropped'])}.")
    say(f"{summary['events']} records lie in {summary['flight']}, the bundle in {summary['bundle']}.")


def _next(folder: Path, flight: Path, records: list[Record], say: Say) -> None:
    program = Path(sys.executable).with_name("autopilot")
    program = program.relative_to(Path.cwd()) if program.is_relative_to(Path.cwd()) else program
    say("Try next:")
    for words in (
        f"replay show {flight} --kind moved",
        f"replay why {flight} {_first_pointing(records)}",
        f"status --projections {folder / 'node' / 'projections.db'}",
        f"replay verify {flight}",
        f"export proof {flight} --seq {_first_pointing(records)} {folder / 'proof.json'}",
        f"verify {folder / 'proof.json'}",
    ):
        say(f"  {program} {words}")


def _counts(counts: dict[str, int]) -> str:
    some = [f"{count} {name}" for name, count in counts.items() if count]
    return ", ".join(some) or "none"


def _most_effects(records: list[Record]) -> int:
    """Return how many vehicle effects the log holds for the order that has most: 1, or something is wrong."""
    asked: Counter[str] = Counter()
    for record in records:
        effect = record.message
        if isinstance(effect, PointAtPlace | PointAtAngles | ReleasePointing) and effect.order:
            asked[effect.order] += 1
    return max(asked.values(), default=0)


def _first_pointing(records: list[Record]) -> int:
    effects = (record.seq for record in records if isinstance(record.message, PointAtPlace | PointAtAngles))
    return next(effects, 0)
