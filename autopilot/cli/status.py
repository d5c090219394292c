"""`autopilot status`: one screen on a node, from its projections database. It asks no running process."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from autopilot.cli.configuration import DEFAULT_PATH, VARIABLE, ConfigurationError, load
from autopilot.node import notice
from autopilot.node.board_safety import STATES
from projections.store import Unreadable, read_status
from projections.words import coordinates, degrees, metres, percent, seconds

_EXAMPLES = """\
examples:
  autopilot status --config node/config.toml
  autopilot status --projections node/projections.db --json

exit codes: 0 shown, 66 there is no status, 78 the configuration is wrong
"""


def add(commands: Any) -> None:
    """Add the command to the program's."""
    made = commands.add_parser(
        "status",
        help="one screen on a node",
        description="One screen on a node: flight, vehicle, cameras, findings, orders; and how old it all is.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    where = made.add_mutually_exclusive_group()
    where.add_argument("--config", metavar="FILE", help=f"the configuration (default: ${VARIABLE} or {DEFAULT_PATH})")
    where.add_argument("--projections", default="", metavar="PATH", help="the database itself")
    made.add_argument(
        "--json", action="store_true", help="print the status as one JSON object, with its age_s and not_recording"
    )
    made.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Show the status; return the exit code."""
    try:
        named = args.projections or load(args.config, os.environ, inputs=False).node.projections
    except ConfigurationError as error:
        return _told(str(error), error.exit_code)
    silent = notice.read(Path(named))
    try:
        status = read_status(Path(named))
    except Unreadable as error:
        if silent is not None:
            print(json.dumps({"not_recording": asdict(silent)}) if args.json else _silent(silent, time.time_ns()))
        return _told(str(error), os.EX_NOINPUT)
    now_ns = time.time_ns()
    age_ns = max(now_ns - status["wall_ns"], 0)
    if args.json:
        said = {"age_s": age_ns // 1_000_000_000, "not_recording": None if silent is None else asdict(silent)}
        print(json.dumps(status | said, sort_keys=True))
    else:
        if silent is not None:
            print(_silent(silent, now_ns))
        for line in screen(status, age_ns):
            print(line)
    return os.EX_OK


def _silent(silent: notice.Notice, now_ns: int) -> str:
    since_ns = max(now_ns - silent.since_ms * 1_000_000, 0)
    return f"SILENT    this node has not been recording for {age(since_ns)}: {silent.because}"


def _told(words: str, code: int) -> int:
    print(f"autopilot status: {words}", file=sys.stderr)
    return code


def screen(status: dict[str, Any], age_ns: int) -> Iterator[str]:
    """Yield the lines of the screen."""
    flight = "open" if status["open"] else f"closed: {status['closed_because']}"
    yield f"node      {status['node']}, software {status['software']}, {status['health']}"
    yield f"flight    {status['flight_number']} ({status['flight_id'][:8]}), {flight}, record {status['head_seq']}"
    yield f"age       {age(age_ns)} since the newest record, {seconds(status['flight_ns'])} s into the flight"
    yield from _vehicles(status)
    yield from _mission(status)
    yield from _safety(status)
    yield from _cameras(status)
    yield from _findings(status)
    orders = ", ".join(f"{count} {name}" for name, count in status["orders"].items() if count)
    switched = "taken" if status["command_enabled"] else "switched off"
    malformed = f", {status['orders_malformed']} unreadable" if status["orders_malformed"] else ""
    yield f"orders    {switched}: {orders or 'none'}{malformed}"
    for label, counts in (("rejected", status["samples_rejected"]), ("dropped", status["inputs_dropped"])):
        if counts:
            yield f"{label:<9} {', '.join(f'{count} {name}' for name, count in sorted(counts.items()))}"
    if status["steps_failed"]:
        yield f"failed    {status['steps_failed']} steps: look for step_failed in `autopilot replay show`"


def age(age_ns: int) -> str:
    """Return an age for people."""
    whole_s = age_ns // 1_000_000_000
    if whole_s < 120:
        return f"{whole_s} s"
    if whole_s < 7200:
        return f"{whole_s // 60} min"
    return f"{whole_s // 3600} h" if whole_s < 172_800 else f"{whole_s // 86_400} days"


def _vehicles(status: dict[str, Any]) -> Iterator[str]:
    for number, one in status["vehicles"].items():
        where = ""
        if one["latitude_e7"] is not None:
            place = coordinates(one["latitude_e7"], one["longitude_e7"])
            where = f", at {place}, {metres(one['height_mm'])} m above home"
        armed = "armed" if one["armed"] else "disarmed"
        charge = "" if one["battery_percent"] is None else f", battery {one['battery_percent']} %"
        yield f"vehicle   {number} {'heard' if one['link'] else 'silent'}, {armed}{charge}{where}"


def _safety(status: dict[str, Any]) -> Iterator[str]:
    if not status["failsafes_enabled"] and not status["properties_broken"]:
        return
    link = status["operator_link"] or "not watched"
    yield f"failsafes {'on' if status['failsafes_enabled'] else 'off'}, link to operators {link}"
    for key, one in status["failsafes"].items():
        if one["state"] != "ok":
            because = f": {one['because']}" if one["because"] else ""
            yield f"  {key} {STATES.get(one['state'], one['state'])}{because}"
    for one in status["overrides"].values():
        left_ns = max(one["until_ns"] - status["flight_ns"], 0)
        yield (
            f"  {one['callsign'] or one['principal_id']} holds {one['scope'].replace('_', ' ')} off: {one['reason']},"
            f" {seconds(left_ns)} s left"
        )
    for name, words in status["properties_broken"].items():
        yield f"BROKEN    {name}, which must never be: {words}"


def _mission(status: dict[str, Any]) -> Iterator[str]:
    one = status["mission"]
    if one is None:
        return
    plan = f", item {one['next_item'] + 1} of {one['items']}, {one['fences']} fences" if one["mission_id"] else ""
    yield f"mission   {one['state']}: {one['because']}{plan}" if one["because"] else f"mission   {one['state']}"
    if one["unavailable"]:
        yield f"          {one['unavailable']}"
    if one["pushed"]:
        yield f"          {one['pushed']}"
    report = "" if one["report_id"] is None else f", report {one['report_id']}"
    yield f"self-test {one['selftest']}{report}"
    for finding in one["findings"]:
        yield f"          {finding}"


def _cameras(status: dict[str, Any]) -> Iterator[str]:
    for key, one in status["cameras"].items():
        held = f" {one['callsign'] or one['principal_id']} by order {one['command_id']}" if one["command_id"] else ""
        left_ns = one["held_until_ns"] - status["flight_ns"]
        until = f", {seconds(left_ns)} s left" if one["held_until_ns"] and left_ns > 0 else ""
        eyes = f", eyes {status['eyes'][key]}" if key in status["eyes"] else ""
        zoom = f", zoom {percent(one['zoom_e4'])}" if one["zoom_e4"] is not None else ""
        yield f"camera    {key} {one['state']}{held}{until}{zoom}{eyes}"
        gimbal = status["gimbals"].get(one["gimbal"])
        if gimbal is not None:
            yield f"gimbal    {one['gimbal']} {_gimbal(gimbal)}"
            if gimbal["caution"]:
                yield f"caution   {gimbal['caution']}"


def _gimbal(one: dict[str, Any]) -> str:
    aim = "commanded" if one["aim"] == "arrived" and one["demanded"] else one["aim"]
    parts = [f"{aim}: {one['aim_because']}" if one["aim_because"] else aim]
    if one["asked"]:
        parts.append(f"asked {one['asked']}")
    if one["pitch_cdeg"] is not None:
        looks = "told" if one["demanded"] else "looks"
        parts.append(f"{looks} pitch {degrees(one['pitch_cdeg'])}, yaw {degrees(one['yaw_cdeg'])}")
    if one["error_cdeg"] is not None:
        parts.append(f"{degrees(one['error_cdeg'])} off")
    if one["arrived_after_ns"] is not None:
        parts.append(f"there after {seconds(one['arrived_after_ns'])} s")
    if one["control"]:
        parts.append(f"controlled by {one['control']}")
    return ", ".join(parts)


def _findings(status: dict[str, Any]) -> Iterator[str]:
    pois = ", ".join(f"{count} {name}" for name, count in status["pois"].items() if count)
    yield f"map       {status['map_objects']} objects, {status['ignored']} muted places"
    yield f"findings  {pois or 'none'}"
    for one in status["waiting"].values():
        left_ns = one["decide_by_ns"] - status["flight_ns"]
        asked = f"{seconds(left_ns)} s to decide" if one["decide_by_ns"] else "waits to be asked"
        sure = percent(one["confidence_e4"])
        yield f"  {one['poi_id']}  {one['class_name']} {sure} at {one['mgrs']}, seen {one['sightings']} times, {asked}"
