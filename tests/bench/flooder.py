"""An attacker: `python -m tests.bench.flooder KEYS NODE CONNECT LISTEN SESSIONS PER_S SECONDS`.

It offers forged orders at a rate, over sessions of its own, or, with LISTEN, over the one link that it shares with
whoever connects to it: it is then the router on the operators' side. What it sends has a right shape, a right token and
a fresh time, which anybody can copy out of real orders, and a signature that does not match. It sends as urgently as an
operator does. Prints how many it offered.
"""

from __future__ import annotations

import sys
import threading
from time import perf_counter

import zenoh

from autopilot.adapters.mesh.link import session_config
from autopilot.trust.clock import HostClock
from autopilot.trust.envelope import MessageType, Packer
from autopilot.trust.identity import load_identity
from autopilot.wire.keys import order_key
from events.schema.waypoint_pb2 import AuthEnvelope

DIFFERENT = 200  # forged orders, each with another nonce; they are made anew before they are old
FRESH_S = 5.0
TICK_S = 0.001  # evenly: between bursts a real order would slip through


class Forger:
    """Makes orders that look right and are signed by nobody."""

    def __init__(self, keys: str, node: str) -> None:
        self._packer = Packer(load_identity(keys), HostClock())
        self._node = node
        self._made: list[tuple[str, bytes]] = []
        self._at_s = 0.0

    def forged(self) -> list[tuple[str, bytes]]:
        """Return keys and envelopes, fresh enough for every clock."""
        if not self._made or perf_counter() - self._at_s > FRESH_S:
            self._at_s = perf_counter()
            self._made = [self._one(f"00000000-0000-4000-8000-{number:012x}") for number in range(DIFFERENT)]
        return self._made

    def _one(self, command_id: str) -> tuple[str, bytes]:
        key = order_key(self._node, command_id)
        packed = self._packer.pack(MessageType.ORDER, key, b"\0" * 70, ttl_ms=10_000)
        envelope = AuthEnvelope.FromString(packed.envelope)
        spoilt = bytearray(envelope.device_signature)
        spoilt[40] ^= 1  # in the scalar: the verifier does all of its work before it knows
        envelope.device_signature = bytes(spoilt)
        return key, envelope.SerializeToString(deterministic=True)


def offer(sessions: list[zenoh.Session], forger: Forger, per_s: float, seconds: float) -> int:
    """Offer at this rate for so long; return how many."""
    pause, began, sent = threading.Event(), perf_counter(), 0
    while (elapsed_s := perf_counter() - began) < seconds:
        made = forger.forged()
        for _ in range(min(int(elapsed_s * per_s) - sent, int(per_s))):
            key, envelope = made[sent % len(made)]
            sessions[sent % len(sessions)].put(key, envelope, priority=zenoh.Priority.INTERACTIVE_HIGH)
            sent += 1
        pause.wait(TICK_S)
    return sent


def main(keys: str, node: str, connect: str, listen: str, count: str, per_s: str, seconds: str) -> None:
    """Connect, say ready, begin with a line on stdin, say how many, end with stdin."""
    configs = [
        session_config("router", connect=[connect], listen=[listen])
        if listen
        else session_config("client", connect=[connect])
        for _ in range(int(count))
    ]
    sessions = [zenoh.open(config) for config in configs]
    print("ready", flush=True)
    sys.stdin.readline()
    print(offer(sessions, Forger(keys, node), float(per_s), float(seconds)), flush=True)
    sys.stdin.read()  # the link that others share stays up until the end
    for session in sessions:
        session.close()  # type: ignore[no-untyped-call]


if __name__ == "__main__":
    main(*sys.argv[1:])
