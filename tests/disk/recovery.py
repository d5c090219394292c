"""The next start on what a power cut left: the node's own recovery, then every order once more, then all logs read.

What comes of it depends on the image alone, so equal images are started once.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any
from unittest.mock import patch

from autopilot.node import flights as flights_module
from events.chain import Chain, ChainBroken
from events.store import flights_in, read_flight
from events.store.recovery import Finding, examine
from tests.autopilot.node.nodes import FakeClock, heard_vehicle
from tests.disk.lives import ORDERS, Life, order, small
from tests.disk.promises import Outcome, Performed, Promise, Sealed, print_of


def start_on(root: Path) -> Outcome:
    """Start a node on a folder, as after a reboot, and return what came of it."""
    findings: list[Finding] = []
    promises: list[Promise] = []
    life = Life(root, FakeClock(), Random("the next start"), promises.append, "the next boot")
    with small(), patch.object(flights_module, "examine", _examining(findings)):
        try:
            life.start()
            life.tell(*heard_vehicle(), *(order(number, send=3) for number in range(1, ORDERS + 1)), after_ms=100)
            orders = {key: one.state for key, one in life.session.state.orders.items()}
            life.let_go()
            logs, sealed = _logs(root)
        except Exception:  # noqa: BLE001 - whatever it is, a start that fails is what is looked for
            life.let_go()
            return Outcome(tuple(one.action.value for one in findings), failure=traceback.format_exc())
    performed = tuple(one for one in promises if isinstance(one, Performed))
    return Outcome(tuple(one.action.value for one in findings), logs, sealed, performed, orders)


def _examining(findings: list[Finding]) -> Callable[..., Finding]:
    def examined(folder: Path, *given: Any) -> Finding:
        findings.append(examine(folder, *given))
        return findings[-1]

    return examined


def _logs(root: Path) -> tuple[dict[bytes, bytes], frozenset[Sealed]]:
    """Return what every log holds. Raises StoreFailed and ChainBroken."""
    logs: dict[bytes, bytes] = {}
    sealed: set[Sealed] = set()
    for flight in flights_in(root):
        reader = read_flight(flight.folder)
        try:
            chain, prints = Chain(reader.flight_id, reader.secret), bytearray()
            for expected, stored in enumerate(reader.stored()):
                if stored.seq != expected:
                    raise ChainBroken(f"record {expected} of flight {flight.number} is missing")
                chain.check(stored)
                prints += print_of(stored)
            logs[reader.flight_id] = bytes(prints)
            sealed.update(Sealed(reader.flight_id, size) for size, _ in reader.checkpoints())
        finally:
            reader.close()
    return logs, frozenset(sealed)
