"""`autopilot run`: the daemon."""

from __future__ import annotations

import argparse
import asyncio
import os
import sys

from autopilot.cli.configuration import ConfigurationError, load

_EPILOG = """\
examples:
  autopilot run --config /etc/autopilot/config.toml
  autopilot run --config examples/video.toml          a video and a detector instead of a drone

The daemon records one flight after another in the folder that [node] flights names. It ends with SIGTERM: on the
ground it closes its flight; in the air it leaves it open, and the next start goes on with it.
"""


def add(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "run",
        help="the daemon",
        description="Run the node daemon until it is told to stop.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--config", metavar="FILE", help="configuration (default: /etc/autopilot/config.toml)")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the daemon; see the module's epilog for how it ends."""
    try:
        config = load(arguments.config, os.environ)
    except ConfigurationError as error:
        print(error, file=sys.stderr)
        return os.EX_CONFIG
    # Adapters are heavy (MAVLink's dialect, OpenCV): only the daemon pays for them.
    from autopilot.node.daemon import Daemon

    return asyncio.run(Daemon(config).run())
