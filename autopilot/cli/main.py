"""The command line: one file a command, put together here.

Data goes to stdout, words to stderr. Exit codes are those of sysexits, as `--help` says.
"""

from __future__ import annotations

import argparse
import difflib
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from importlib.metadata import version
from typing import NoReturn

COMMANDS = (
    *("demo", "run", "check", "status", "directory", "enrol", "order", "witness", "relay"),
    *("plan", "flights", "replay", "export", "verify"),
)

_DESCRIPTION = (
    "Node daemon and ground tools for a camera drone: an event log, statecharts, flights that replay bit for bit."
)
_EPILOG = """\
first steps:
  autopilot demo                                 a whole flight on this machine, in about a minute
  autopilot run --config examples/video.toml     any video and detector, on the ground
  autopilot replay verify FLIGHT                 run a flight again and compare every decision

exit codes:
  0 ok   1 failed or refused   2 usage   65 the data is wrong (diverges, tampered)   66 no input
  69 unavailable   74 I/O   77 not permitted   78 configuration
"""


class _Parser(argparse.ArgumentParser):
    """Says what was probably meant when a command is misspelt."""

    def error(self, message: str) -> NoReturn:
        """Print usage and the message with a suggestion, and exit with 2."""
        wrong = next((word for word in sys.argv[1:] if not word.startswith("-")), "")
        close = difflib.get_close_matches(wrong, COMMANDS, n=1) if wrong not in COMMANDS else []
        hint = f"; did you mean {close[0]!r}?" if close else ""
        self.print_usage(sys.stderr)
        self.exit(2, f"{self.prog}: {message}{hint}\n")


def parser(names: Sequence[str] = COMMANDS) -> argparse.ArgumentParser:
    """Return the parser of these commands. The daemon must be up within a second, so it loads its own only."""
    root = _Parser(
        prog="autopilot",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    root.add_argument("--version", action="version", version=f"autopilot {version('autopilot')}")
    commands = root.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for name in names:
        import_module(f"autopilot.cli.{name}").add(commands)
    return root


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    words = sys.argv[1:] if arguments is None else list(arguments)
    chosen = parser(words[:1] if words[:1] and words[0] in COMMANDS else COMMANDS).parse_args(words)
    try:
        code: int = chosen.run(chosen)
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        # Whoever read our output has seen enough (`autopilot replay show ... | head`).
        sys.stderr.close()
        return 0
    return code


def program() -> NoReturn:
    """Run one command and end the process with its exit code.

    Zenoh's threads outlive its sessions, and one that still calls back aborts an interpreter that takes itself apart;
    so once there are any, the process ends without that.
    """
    code = main()
    if "zenoh" in sys.modules:
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):  # whoever read it is gone
                stream.flush()
        os._exit(code)
    sys.exit(code)


if __name__ == "__main__":
    program()
