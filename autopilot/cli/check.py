"""`autopilot check`: judges a configuration and says every problem with its line; starts nothing.

What can be used and should be thought about is a warning: words on stderr, which change no exit code.
"""

from __future__ import annotations

import argparse
import dataclasses
import ipaddress
import json
import os
import sys
from typing import Any
from urllib.parse import urlsplit

from autopilot.cli.configuration import DEFAULT_PATH, VARIABLE, ConfigurationError, load
from autopilot.cli.relay_file import is_relay, load_relay
from autopilot.cli.relay_file import summary as relay_summary
from autopilot.ports.config import Config

EPILOG = """\
examples:
  autopilot check --config examples/drone.toml --elsewhere
  autopilot check --config config.toml --json | jq '.problems[].line'
  autopilot check --config examples/relay.toml --elsewhere    a relay's is known by its [relay]
  autopilot check --schema > autopilot.schema.json     for the editor

exit codes: 0 the configuration is good (warnings are on stderr), 78 it is not (every problem is on stderr)
"""


def add(commands: Any) -> None:
    """Add the command to argparse's sub-parsers."""
    parser = commands.add_parser(
        "check",
        help="judge a configuration",
        description="Judge a configuration: every key, value and input file, without starting anything.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--config", metavar="FILE", help=f"the configuration (default: ${VARIABLE} or {DEFAULT_PATH})")
    parser.add_argument("--elsewhere", action="store_true", help="it is for another machine: input files may be absent")
    parser.add_argument("--json", action="store_true", help="say it as one JSON object on stdout")
    parser.add_argument("--schema", action="store_true", help="print the JSON Schema of the configuration and end")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the command; return 0 or 78."""
    if args.schema:
        print(json.dumps(Config.model_json_schema(), indent=2))
        return 0
    warned: list[str] = []
    try:
        if is_relay(args.config):
            lines = relay_summary(load_relay(args.config, inputs=not args.elsewhere))
        else:
            config = load(args.config, os.environ, inputs=not args.elsewhere)
            lines, warned = summary(config), warnings(config)
    except ConfigurationError as error:
        if args.json:
            problems = [dataclasses.asdict(problem) for problem in error.problems]
            print(json.dumps({"good": False, "problems": problems, "warnings": [], "summary": []}))
        print(error, file=sys.stderr)
        return error.exit_code
    for warning in warned:
        print(f"autopilot: warning: {warning}", file=sys.stderr)
    if args.json:
        print(json.dumps({"good": True, "problems": [], "warnings": warned, "summary": lines}))
    else:
        print("\n".join(["the configuration is good", *(f"  {line}" for line in lines)]))
    return 0


def warnings(config: Config) -> list[str]:
    """Return what works and should be thought about."""
    mission = config.mission
    host = _host(mission.url)
    if not (mission.token_file and mission.url.startswith("http://")) or _is_loopback(host):
        return []
    return [f"mission.url: whoever is on the way to {host or 'the office'} reads the token of token_file; use https://"]


def _host(url: str) -> str:
    try:
        return urlsplit(url).hostname or ""
    except ValueError:  # brackets without an address between them
        return ""


def _is_loopback(host: str) -> bool:
    """Whether a host is this machine; a name but "localhost" may be anybody's."""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def summary(config: Config) -> list[str]:
    """Return in a few lines what this node will do, so that a forgotten switch is seen before the flight."""
    mesh, vehicle, eyes = config.mesh, config.vehicle, config.eyes
    orders = "not taken ([command] enabled = false)"
    if config.command.enabled:
        orders = f"taken; the camera from roles {', '.join(config.command.camera_roles) or 'none: nobody may point it'}"
        orders += f"; the flight from roles {', '.join(config.command.flight_roles) or 'none'}"
    looks = {"file": f"file {eyes.path}", "device": f"camera {eyes.device}", "external": f"detector at {eyes.endpoint}"}
    pose = "fixed pose" if eyes.pose else "pose from the vehicle"
    return [
        f"orders: {orders}",
        f"mesh: {', '.join((*mesh.connect, *mesh.listen)) or 'none'}",
        f"vehicle: {vehicle.connect or vehicle.listen or 'none'}",
        f"eyes: {looks[eyes.source] + ', ' + pose if eyes.source in looks else 'none'}",
        f"the flight commanded by this node: {_flight(config)}",
        f"camera moved by the node itself: {'yes' if config.scan.enabled else 'no'}",
        f"flights: {config.node.flights}",
    ]


def _flight(config: Config) -> str:
    """Return what this node has to say in how its vehicle flies."""
    mission, orders = config.mission, config.command
    if not config.commands_flight:
        return "no"
    if not mission.enabled:
        return "failsafes and orders"
    roles = ", ".join(orders.flight_roles if orders.enabled else ())
    begins = f"when a person of {roles or 'no role: nobody may'} lets it" if mission.begin == "order" else "by itself"
    orders_too = " and orders" if config.flight.enabled else ""
    return f"failsafes{orders_too}; a mission of {mission.url or mission.file}, begun {begins}"
