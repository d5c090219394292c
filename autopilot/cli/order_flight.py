"""What `autopilot order` has about the flight: the verbs fly, mode, mission, override, acknowledge and follow, and what
a status says of it.

Each needs a role that the node names in `flight_roles`, but for `follow`, which is the camera's.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator

from autopilot.ground import compose
from events.schema.waypoint_pb2 import DeviceCommand, MissionStatus, NodeStatus

Compose = Callable[[argparse.Namespace], DeviceCommand]
AddVerb = Callable[[str, str, Compose], argparse.ArgumentParser]

EXAMPLES = """\
  autopilot order mission begin --identity keys/sue --connect tcp/127.0.0.1:7447 --to wasp-01
  autopilot order mode return --identity keys/sue --connect tcp/127.0.0.1:7447 --to wasp-01
  autopilot order override battery_return 120 "landing site in view" --identity keys/sue --connect ... --to wasp-01
  autopilot order follow 0190b5a2-... --identity keys/alice --connect tcp/127.0.0.1:7447 --to wasp-01
"""


def add_flight_verbs(verb: AddVerb, number: Callable[[float], Callable[[str], float]]) -> None:
    """Add them with `verb`; `number(limit)` reads a number within +-limit."""
    fly = verb("fly", "fly to a place and stay there", lambda a: compose.fly(a.lat, a.lon, a.alt))
    fly.add_argument("lat", type=number(90), help="latitude, degrees north")
    fly.add_argument("lon", type=number(180), help="longitude, degrees east")
    fly.add_argument("alt", type=number(20_000), help="altitude above mean sea level, metres")
    mode = verb("mode", "put the vehicle into a mode", lambda a: compose.flight_mode(a.mode))
    mode.add_argument("mode", choices=["return", "loiter", "guided", "land"], help="the mode")
    mission = verb("mission", "begin, pause, resume or abort the mission", lambda a: compose.mission(a.what))
    mission.add_argument("what", choices=["begin", "pause", "resume", "abort"], help="what to do with it")
    override = verb("override", "hold a failsafe off", lambda a: compose.override(a.scope, a.seconds, a.reason))
    override.add_argument("scope", choices=["battery_return", "link_return", "fence_return"], help="what is held off")
    override.add_argument("seconds", type=number(86_400), help="for how long")
    override.add_argument("reason", help="why, in a sentence; it stands in the log with your name")
    acknowledge = verb(
        "acknowledge", "take on a self-test that came out degraded", lambda a: compose.acknowledge(a.report)
    )
    acknowledge.add_argument("report", type=int, metavar="REPORT", help="number of the report, as the status shows it")
    follow = verb("follow", "keep a confirmed finding in view", lambda a: compose.follow(a.poi, a.camera))
    follow.add_argument("poi", metavar="POI", help="id of the finding, as the status shows it")


def flight_words(status: NodeStatus) -> Iterator[str]:
    """Yield what a status says of the flight: what these verbs are about, and what a person has to know before one."""
    if status.HasField("battery_percent"):
        yield f"battery {status.battery_percent} %"
    if status.operator_link not in ("", "ok"):
        yield f"link to operators {status.operator_link}"
    if status.HasField("mission"):
        yield from _mission_words(status.mission)
    for failsafe in status.failsafes:
        yield f"failsafe {failsafe.name} {failsafe.state}{_because(failsafe.because)}"
    for held in status.overrides:
        yield f"{held.callsign} holds {held.scope} off for {held.left_ms // 1000} s{_because(held.reason)}"
    yield from (f"BROKEN {words}" for words in status.properties_broken)


def _mission_words(mission: MissionStatus) -> Iterator[str]:
    plan = f", item {mission.next_item + 1} of {mission.items}" if mission.mission_id else ""
    yield f"mission {mission.state}{_because(mission.because)}{plan}"
    if mission.unavailable:
        yield mission.unavailable
    if mission.HasField("report_id"):
        yield f"self-test {mission.selftest}, report {mission.report_id}"
    yield from mission.findings


def _because(words: str) -> str:
    return f": {words}" if words else ""
