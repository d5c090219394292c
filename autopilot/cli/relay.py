"""`autopilot relay`: a router with rules, or a relay that verifies, between the ground and the nodes.

What is allowed and verified is `autopilot.ground`'s; here it is started, reported and ended.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from autopilot.adapters.mesh.link import Link
from autopilot.cli.configuration import ConfigurationError
from autopilot.cli.relay_file import load_relay
from autopilot.ground.relay import Relay
from autopilot.ground.relay_config import RelayConfig
from autopilot.ground.relay_papers import Papers, PapersError
from autopilot.ground.relay_rules import inner_settings, outer_settings
from autopilot.trust.clock import HostClock, wall_ms
from autopilot.trust.limits import DOCUMENT_BYTES_MAX

READY_WITHIN_S = 10.0
LOOK_EVERY_S = 1.0  # how soon a newer revocation list is taken

_EXAMPLES = """\
examples:
  autopilot relay --config examples/relay.toml
  autopilot relay --config examples/relay.toml --show | jq .outer.access_control.rules    what Zenoh is told
  autopilot check --config examples/relay.toml --elsewhere

In mode verifying it prints its counts as one JSON object a line, every [relay] report_s and when it ends (SIGTERM).
docs/relay.md says what each limit is for, and what a relay can still do.

exit codes: 0 ended, 69 it can't listen, 78 configuration or documents unusable
"""


class _Service(NamedTuple):
    """What is started, asked and stopped, whichever relay it is."""

    start: Callable[[], None]
    stop: Callable[[], None]
    opened: Callable[[], bool]
    look: Callable[[], str]
    counts: Callable[[], object] | None  # None: Zenoh tells no counts


def add(commands: Any) -> None:
    """Add the command to the program's."""
    made = commands.add_parser(
        "relay",
        help="a relay without keys: a router with rules, or one that verifies",
        description="Relay between the ground and the nodes, without any key that opens or signs a message.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    made.add_argument("--config", required=True, metavar="FILE", help="configuration of the relay")
    made.add_argument("--show", action="store_true", help="print what Zenoh is told, as JSON, and end")
    made.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the relay until it is told to stop; return the exit code."""
    try:
        config = load_relay(args.config, inputs=not args.show)
        if args.show:
            inner = {"inner": inner_settings(config)} if config.inner else {}
            print(json.dumps({"outer": outer_settings(config), **inner}, indent=2))
            return os.EX_OK
        service = _router(config) if config.verify is None else _verifying(config)
    except (ConfigurationError, PapersError) as error:
        print(error, file=sys.stderr)
        return os.EX_CONFIG
    return _served(service, config)


def _router(config: RelayConfig) -> _Service:
    link = Link(mode="router", listen=config.outer.listen, over=outer_settings(config))
    return _Service(link.start, link.stop, link.opened, lambda: "", None)


def _verifying(config: RelayConfig) -> _Service:
    """Raises PapersError."""
    verify, side, clock = config.verify, config.inner, HostClock()
    assert verify is not None
    assert side is not None
    papers = Papers(Path(verify.documents), wall_ms(clock))
    outer = Link(
        mode="router",
        listen=config.outer.listen,
        answer_bytes_max=DOCUMENT_BYTES_MAX,
        over=outer_settings(config),
    )
    inner = Link(
        mode="router" if side.listen else "client",
        connect=side.connect,
        listen=side.listen,
        over=inner_settings(config),
    )

    def opened() -> bool:
        # A router on the nodes' side may come later; a port that can't be had won't.
        return outer.opened() and (inner.opened() or not side.listen)

    relay = Relay(verify, papers, clock, outer, inner)
    return _Service(relay.start, relay.stop, opened, relay.look, relay.counts)


def _served(service: _Service, config: RelayConfig) -> int:
    """Start, say ready, report until a signal, and stop."""
    stopped = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stopped.set())
    service.start()
    try:
        if not _ready(service, stopped):
            inner = config.inner.listen if config.inner else ()
            print(f"autopilot relay: can't listen at {', '.join((*config.outer.listen, *inner))}", file=sys.stderr)
            return os.EX_UNAVAILABLE
        print("autopilot relay: ready", file=sys.stderr, flush=True)
        _report(service, stopped, config.relay.report_s)
    finally:
        service.stop()
    _print(service)
    return os.EX_OK


def _ready(service: _Service, stopped: threading.Event) -> bool:
    give_up_at_s = time.monotonic() + READY_WITHIN_S
    while not service.opened() and time.monotonic() < give_up_at_s and not stopped.is_set():
        stopped.wait(0.02)
    return service.opened() or stopped.is_set()


def _report(service: _Service, stopped: threading.Event, report_s: float) -> None:
    told, reported_at_s = "", time.monotonic()
    while not stopped.wait(min(LOOK_EVERY_S, report_s)):
        wrong = service.look()
        if wrong and wrong != told:
            print(f"autopilot relay: {wrong}", file=sys.stderr, flush=True)
        told = wrong
        if time.monotonic() - reported_at_s >= report_s:
            reported_at_s = time.monotonic()
            _print(service)


def _print(service: _Service) -> None:
    if service.counts is not None:
        print(json.dumps(service.counts()), flush=True)
