"""A bare Zenoh router in a process of its own, which a demo or test may kill and start again.

`python -m autopilot.sim.router --listen tcp/127.0.0.1:7447` prints one line, "ready", and stops on
SIGTERM or SIGINT. It holds no keys and judges nothing; a relay with rules is another thing.
"""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Sequence

import zenoh

from autopilot.adapters.mesh.link import session_config

UNAVAILABLE = 69  # EX_UNAVAILABLE of sysexits


def serve(endpoints: Sequence[str]) -> int:
    """Route between the sessions that connect to `endpoints` until a signal; return the exit code."""
    stops = {signal.SIGTERM, signal.SIGINT}
    signal.pthread_sigmask(signal.SIG_BLOCK, stops)
    try:
        session = zenoh.open(session_config("router", listen=endpoints))
    except zenoh.ZError as error:
        print(f"the router can't listen on {', '.join(endpoints)}: {error}", file=sys.stderr)
        return UNAVAILABLE
    print("ready", flush=True)
    signal.sigwait(stops)
    session.close()  # type: ignore[no-untyped-call]
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line and serve."""
    parser = argparse.ArgumentParser(prog="python -m autopilot.sim.router", description=__doc__)
    parser.add_argument(
        "--listen", action="append", required=True, metavar="tcp/HOST:PORT", help="endpoint; repeatable"
    )
    return serve(parser.parse_args(arguments).listen)


if __name__ == "__main__":
    sys.exit(main())
