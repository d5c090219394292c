"""`autopilot demo`: a whole flight on this machine, in words a person can follow."""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from autopilot.adapters.mesh import LinkDown
from autopilot.cli.demonstration.ending import end
from autopilot.cli.demonstration.mission_act import MissionAct
from autopilot.cli.demonstration.mission_stage import SPEED_UP, MissionStage
from autopilot.cli.demonstration.stage import ProcessFailed, Stage
from autopilot.cli.demonstration.story import WHOLE_STORY_S, Consoles, Story, Surprise
from autopilot.sim.route import Route
from events.store import StoreFailed

SHORTEST_S = 15.0

Say = Callable[[str], None]

_EPILOG = """\
examples:
  autopilot demo                                   a minute, in a new folder
  autopilot demo --dir flight --seconds 45 --seed 7
  autopilot demo --seconds 15 --json               the short story; the last line is one JSON object

Everything runs on loopback: a Zenoh router, a simulated aircraft that speaks MAVLink over UDP, the daemon, and
four people with keys of their own. From 45 s on the whole story is told, from 15 s a shorter one.
"""


def add(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "demo",
        help="a whole flight on this machine: aircraft, camera, operators",
        description="Fly a whole flight on this machine, without a drone and without a network.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--dir", type=Path, help="a folder to fly in, new or empty (default: a temporary one)")
    parser.add_argument("--seconds", type=float, default=60.0, help="length of the flight (default: 60)")
    parser.add_argument("--seed", type=int, default=1, help="what the world looks like (default: 1)")
    parser.add_argument("--act", choices=("both", "camera", "mission"), default="both", help="what is flown")
    parser.add_argument("--json", action="store_true", help="words to stderr, one JSON object to stdout")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Fly, land, export, replay."""
    if arguments.seconds < SHORTEST_S:
        print(f"autopilot demo: --seconds must be at least {SHORTEST_S:.0f}", file=sys.stderr)
        return os.EX_USAGE
    folder = Path(tempfile.mkdtemp(prefix="autopilot-demo-")) if arguments.dir is None else arguments.dir.resolve()
    if folder.exists() and any(folder.iterdir()):
        print(f"autopilot demo: {folder} is not empty; give another --dir", file=sys.stderr)
        return os.EX_CANTCREAT
    folder.mkdir(parents=True, exist_ok=True)
    words = sys.stderr if arguments.json else sys.stdout
    began = time.monotonic()

    def say(text: str) -> None:
        print(f"[{time.monotonic() - began:5.1f} s] {text}", file=words, flush=True)

    try:
        summary = _acts(folder, arguments, say)
    except (Surprise, ProcessFailed, LinkDown, StoreFailed) as error:
        say(f"The demo stopped: {error}. What the processes said lies in {folder / 'logs'}.")
        return 1
    if arguments.json:
        print(json.dumps(summary))
    return os.EX_OK if all(one["replay"] == "identical" for one in summary.values()) else os.EX_DATAERR


def _acts(folder: Path, arguments: argparse.Namespace, say: Say) -> dict[str, dict[str, object]]:
    """Play the acts that are asked for; return how each ended, by its name."""
    ended: dict[str, dict[str, object]] = {}
    if arguments.act in ("both", "camera"):
        ended["camera"] = _fly(folder, arguments.seconds, arguments.seed, say)
    if arguments.act in ("both", "mission"):
        within = folder / "mission" if arguments.act == "both" else folder
        within.mkdir(exist_ok=True)
        ended["mission"] = _fly_mission(within, arguments.seed, say)
    return ended


def _fly_mission(folder: Path, seed: int, say: Say) -> dict[str, object]:
    """Play the act of the mission and return the summary of how it ended."""
    say(f"A mission, seed {seed}, in {folder}. Its world runs {SPEED_UP:g} times as fast as ours.")
    with MissionStage(folder, seed) as stage:
        with Consoles.of(stage) as consoles:
            MissionAct(stage, consoles.supervisor, consoles.first, say).tell()
        flight = stage.flight
        if (code := stage.node.stop()) != os.EX_OK:
            raise ProcessFailed(f"the node ended with exit code {code}")
    return end(folder, flight, say)


def _fly(folder: Path, seconds: float, seed: int, say: Say) -> dict[str, object]:
    """Play the story on its stage and return the summary of how it ended."""
    say(f"A flight of {seconds:.0f} s, seed {seed}, in {folder}.")
    with Stage(folder, seconds, seed) as stage:
        with Consoles.of(stage) as consoles:
            Story(stage, consoles, Route(seed, seconds), say).tell(whole=seconds >= WHOLE_STORY_S)
        flight = stage.flight
        if (code := stage.node.stop()) != os.EX_OK:
            raise ProcessFailed(f"the node ended with exit code {code}")
    return end(folder, flight, say)
