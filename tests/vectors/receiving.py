"""The receiver that a vector speaks of: a gate made from the published papers."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from typing import Any

from autopilot.trust import documents
from autopilot.trust.believing import Fixed
from autopilot.trust.envelope import MessageType
from autopilot.trust.freshness import Time
from autopilot.trust.gate import Gate
from autopilot.trust.identity import Epoch
from autopilot.trust.keys import BoxKey, SignKey
from autopilot.trust.verdict import Sealed
from events.schema.flight_pb2 import ClockQuality
from events.schema.waypoint_pb2 import PrincipalKind
from tests.autopilot.trust.world import FakeClock, people
from tests.house import REPO

FOLDER = REPO / "tests/vectors"
ISSUERS = frozenset({PrincipalKind.OPERATOR, PrincipalKind.SERVICE})
PREFIXES = {
    "order": "waypoint/global/cmd/wasp-01/",
    "ack": "waypoint/global/ack/wasp-01/",
    "presence": "waypoint/global/heartbeat/wasp-01/",
}


@cache
def published(name: str) -> dict[str, Any]:
    """Read one of the published files."""
    read: dict[str, Any] = json.loads((FOLDER / f"{name}.json").read_text("utf-8"))
    return read


class Uncertain(Fixed):
    """A receiver that does not know the time; nothing echoes its challenge."""

    def time(self) -> Time:
        """The same time, and nobody to vouch for it."""
        return super().time()._replace(quality=ClockQuality.CLOCK_UNSET)


def gate(case: dict[str, Any]) -> Gate[bytes]:
    """Return the gate of a case's receiver, after what came before."""
    made = published("positive")
    papers, now_ms = made["papers"], made["now_ms"]
    trust = documents.verify_trust_root(bytes.fromhex(papers["trust_root"]["document"]))
    held = papers["revocations"][case.get("revocations", "v12")]["document"]
    begins_ms, ends_ms = case.get("epoch_ms", (-3_600_000, 23 * 3_600_000))
    secret = bytes.fromhex(made["keys"]["epoch"]["1"])
    name = case.get("receiver", "wasp-01")
    receiver = replace(
        people().wasp,
        sign_key=SignKey.from_seed(bytes.fromhex(made["keys"]["sign"][name]["seed"])),
        box_key=BoxKey.from_secret(bytes.fromhex(made["keys"]["box"][name]["secret"])),
        trust=trust,
        token=documents.verify_token(bytes.fromhex(papers["tokens"][name]["document"]), trust),
        revocations=documents.verify_revocations(bytes.fromhex(held), trust),
        epochs={1: Epoch(1, secret, now_ms + begins_ms, now_ms + ends_ms, case.get("epoch_needs_list", 12))},
    )
    kind, clock = case.get("gate", "order"), FakeClock(now_ms)
    nodes, operators = frozenset({PrincipalKind.NODE}), frozenset({PrincipalKind.OPERATOR})
    opens: Gate[bytes] = Gate(
        receiver,
        {"order": MessageType.ORDER, "ack": MessageType.ACK, "presence": MessageType.PRESENCE}[kind],
        kinds={"order": ISSUERS, "ack": nodes, "presence": operators}[kind],
        is_ours=lambda key: key.startswith(PREFIXES[kind]),
        reader=_as_it_is,
        clock=clock,
        samples_per_s=1,
        samples_burst=case.get("burst", 100),
        believing=Uncertain(receiver, clock) if case.get("uncertain") else None,
    )
    alice = bytes.fromhex(made["keys"]["sign"]["alice"]["key_id"])
    held_nonces = (number.to_bytes(24, "big") for number in range(case.get("nonces_held", 0)))
    opens.restore(((alice, nonce, 20_000) for nonce in held_nonces), whole=not case.get("forgotten"))
    for envelope in case.get("before", ()):
        opens.judge(case["key_expr"], bytes.fromhex(envelope))
    return opens


def _as_it_is(_message: Sealed, content: bytes) -> bytes:
    return content
