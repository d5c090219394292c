"""`autopilot plan`: a mission as it would be flown, listed and drawn. It touches no vehicle and no network."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from autopilot.cli.configuration import ConfigurationError, load

if TYPE_CHECKING:  # shapely and the schema's reader are loaded when there is something to plan
    from autopilot.planning import Plan, PlannedItem
    from autopilot.ports.config import MissionSection

FIELD_OF_VIEW_DEG = 60.0  # where neither a flag nor a configuration says it
PICTURES = (".svg", ".png")

_EXAMPLES = """\
examples:
  autopilot plan examples/missions/field.json --out field.svg
  autopilot plan examples/missions/corridor.json --airframe plane --speed 16 --wind-from 250 --wind 6 --out c.png
  autopilot plan mission.json --config /etc/autopilot/config.toml --autopilot ardupilot
  autopilot plan mission.json --json | jq '.searched[].coverage'

exit codes: 0 it can be flown, 2 usage, 65 the mission is refused (every problem is on stderr), 66 there is no such
file, 73 the picture can't be written, 78 the configuration is wrong
"""
# Flag, key of [mission], what it is.
_SETTINGS = (
    ("--height", "search_height_m", "M", "height of a search without one, above home"),
    ("--fov", "field_of_view_deg", "DEG", "horizontal field of view"),
    ("--overlap", "side_overlap", "PART", "part of a lane that its neighbour sees too"),
    ("--margin", "fence_margin_m", "M", "how far lanes keep from fences"),
    ("--speed", "cruise_speed_mps", "M/S", "speed where the mission says none"),
    ("--wind-from", "wind_from_deg", "DEG", "where the wind comes from"),
    ("--wind", "wind_mps", "M/S", "how strong it is"),
)


def add(commands: Any) -> None:
    """Add the command to the program's."""
    made = commands.add_parser(
        "plan",
        help="list and draw a mission without a vehicle",
        description="Plan a mission: judge it, search its regions in lanes, list what a vehicle would get, draw it.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    made.add_argument("mission", metavar="MISSION", help="the mission, a JSON file; - for standard input")
    made.add_argument("--out", metavar="FILE", help="draw it here; .svg or .png")
    made.add_argument("--json", action="store_true", help="print the plan as one JSON object")
    made.add_argument("--config", metavar="FILE", help="take [mission] of this configuration")
    made.add_argument("--airframe", choices=("copter", "plane"), help="what flies it")
    made.add_argument("--home", type=float, nargs=2, metavar=("LAT", "LON"), help="home (default: the return point)")
    made.add_argument("--autopilot", choices=("ardupilot", "px4"), help="list what this one is sent, home included")
    for flag, key, unit, words in _SETTINGS:
        made.add_argument(flag, dest=key, type=float, metavar=unit, help=words)
    made.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Plan, list and draw; return the exit code."""
    if args.out and Path(args.out).suffix.lower() not in PICTURES:
        return _told(f"--out {args.out}: name a file that ends with {' or '.join(PICTURES)}", 2)
    try:
        settings, field_of_view_deg = _settings(args)
    except ConfigurationError as error:
        return _told(str(error), error.exit_code)
    except ValueError as error:
        return _told(str(error), 2)
    try:
        data = _read(args.mission, settings.max_bytes)
    except OSError as error:
        return _told(f"{args.mission}: {error.strerror}", os.EX_NOINPUT)
    return _planned(args, settings, field_of_view_deg, data)


def _planned(args: argparse.Namespace, settings: MissionSection, field_of_view_deg: float, data: bytes) -> int:
    from autopilot.planning import for_vehicle, make_plan, mission_limits
    from autopilot.wire.mission import MissionRefused
    from autopilot.wire.mission_reading import read_mission

    mission = read_mission(data, mission_limits(settings))
    if isinstance(mission, MissionRefused):
        return _told(f"{args.mission} is refused\n{mission}", os.EX_DATAERR)
    plan = make_plan(mission, settings, field_of_view_deg, tuple(args.home) if args.home else None)
    if isinstance(plan, MissionRefused):
        return _told(f"{args.mission} is refused\n{plan}", os.EX_DATAERR)
    items = for_vehicle(plan, args.autopilot) if args.autopilot else plan.items
    if args.out and (failure := _draw(plan, args)):
        return _told(failure, os.EX_CANTCREAT)
    print(json.dumps(as_json(plan, items)) if args.json else "\n".join(lines(plan, items)))
    return os.EX_OK


def _settings(args: argparse.Namespace) -> tuple[MissionSection, float]:
    """Return what to plan with: flags over the configuration, where one is named. Raises ValueError for a flag."""
    from pydantic import ValidationError

    from autopilot.ports.config import MissionSection

    config = load(args.config, os.environ, inputs=False) if args.config else None
    base = {} if config is None else config.mission.model_dump(exclude_unset=True)
    flags = {key: getattr(args, key) for _, key, _, _ in _SETTINGS if getattr(args, key) is not None}
    flags |= {"airframe": args.airframe} if args.airframe else {}
    if args.home and not (abs(args.home[0]) <= 90 and abs(args.home[1]) <= 180):
        raise ValueError("--home is latitude (+-90) and longitude (+-180) in degrees")
    try:
        settings = MissionSection.model_validate(base | flags)
    except ValidationError as error:
        names = {key: flag for flag, key, _, _ in _SETTINGS}
        first = error.errors()[0]
        where = names.get(str(first["loc"][0]) if first["loc"] else "", "the configuration")
        raise ValueError(f"{where}: {first['msg'].replace('Input should', 'must')}") from None
    seen_deg = config.eyes.field_of_view_deg if config else FIELD_OF_VIEW_DEG
    return settings, settings.field_of_view_deg or seen_deg


def _read(name: str, most: int) -> bytes:
    """Return the file's bytes, at most one more than it may have. Raises OSError."""
    if name == "-":
        return sys.stdin.buffer.read(most + 1)
    with Path(name).open("rb") as file:
        return file.read(most + 1)


def _draw(plan: Plan, args: argparse.Namespace) -> str:
    """Write the picture whole or not at all; return what went wrong."""
    from autopilot.cli.export import write_whole
    from autopilot.ground.plan_picture import picture

    out = Path(args.out)
    name = "mission" if args.mission == "-" else Path(args.mission).stem
    try:
        write_whole(out, picture(plan, f"Mission {name}", as_png=out.suffix.lower() == ".png"))
    except OSError as error:
        return f"{args.out}: {error.strerror}"
    print(f"drawn in {args.out}", file=sys.stderr)
    return ""


def as_json(plan: Plan, items: tuple[PlannedItem, ...]) -> dict[str, Any]:
    """Return the plan as plain values; a parameter that is NaN on the wire is null."""
    return {
        "mission_id": plan.mission.mission_id,
        "airframe": plan.airframe,
        "home": asdict(plan.home),
        "items": [asdict(item) for item in items],
        "breakpoints": [asdict(marker) for marker in plan.breakpoints],
        "searched": [asdict(region) for region in plan.searched],
        "length_m": round(plan.length_m, 1),
        "time_s": round(plan.time_s, 1),
        "notes": list(plan.notes),
    }


def lines(plan: Plan, items: tuple[PlannedItem, ...]) -> Iterator[str]:
    """Yield the plan for people: a table of items, the searches, what to know."""
    from autopilot.planning.items import COMMAND_NAMES

    index_of = {item.id: str(index) for index, item in enumerate(plan.mission.items)}
    yield f"{'seq':>3}  {'command':<20}  {'latitude':>11}  {'longitude':>12}  {'height':>7}  {'parameters':<18}  item"
    for item in items:
        placed = item.lat_e7 or item.lon_e7
        where = f"{item.lat_e7 / 1e7:>11.7f}  {item.lon_e7 / 1e7:>12.7f}  {item.height_mm / 1000:>5.0f} m"
        given = " ".join("-" if value is None else f"{value:g}" for value in item.params)
        name = COMMAND_NAMES[item.command]
        place = where if placed else f"{'-':>11}  {'-':>12}  {'-':>7}"
        yield f"{item.seq:>3}  {name:<20}  {place}  {given:<18}  {index_of.get(item.source, '-')}"
    yield ""
    for region in plan.searched:
        yield (
            f"item {index_of[region.item]}: {region.area_m2 / 10_000:.2f} ha in {region.lanes} lanes on "
            f"{region.heading_deg:.0f} deg, {region.spacing_m:.0f} m apart, {region.length_m / 1000:.2f} km, "
            f"{_minutes(region.time_s)}; {100 * region.coverage:.1f} % seen; "
            f"a picture every {region.frame_period_s:.1f} s"
        )
        if region.crab_deg >= 1:
            yield f"  the nose is up to {region.crab_deg:.0f} deg off the track, so a lane shows {region.swath_m:.0f} m"
    for marker in plan.breakpoints:
        yield f"item {index_of[marker.item]}: breakpoint before seq {marker.seq}"
    yield f"in all {plan.length_m / 1000:.2f} km, about {_minutes(plan.time_s)}"
    yield from (f"note: {note}" for note in plan.notes)


def _minutes(time_s: float) -> str:
    minutes, seconds = divmod(round(time_s), 60)
    return f"{minutes} min {seconds:02} s"


def _told(words: str, code: int) -> int:
    print(f"autopilot plan: {words}", file=sys.stderr)
    return code
