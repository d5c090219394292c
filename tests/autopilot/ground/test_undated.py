"""An issuer and a node that does not know the time: its status and acks are believed, and tell what to echo."""

from __future__ import annotations

from pathlib import Path

from autopilot.ground.issuer import Issuer
from autopilot.trust.believing import Believing, Fixed
from autopilot.trust.envelope import MessageType, Packer
from events.schema.waypoint_pb2 import NodeStatus
from tests.autopilot.trust.papers import HOUR_MS, HostClocks, device
from tests.autopilot.trust.world import NOW_MS, FakeClock, FakeWire, people, seeded

KEY = "waypoint/global/status/wasp-01"


def status(believing: Believing, at_ms: int, seed: int) -> bytes:
    """Return a status as the node seals it."""
    content = NodeStatus(at_ms=at_ms, node_challenge=bytes([seed]) * 16).SerializeToString(deterministic=True)
    packer = Packer(people().wasp, FakeClock(), seeded(seed), believing)
    return packer.pack(MessageType.STATUS, KEY, content, ttl_ms=10_000).envelope


def check_seen(issuer: Issuer, seed: int) -> None:
    """The newest status is the one of this seed."""
    seen = issuer.status("wasp-01")
    assert seen is not None
    assert seen.status.node_challenge == bytes([seed]) * 16


def test_the_newest_status_of_a_node_without_time_is_the_one_that_came_last(tmp_path: Path) -> None:
    """Its clock may have gone back by hours, and comes forth again; an older dated one is still ignored."""
    lost = device(tmp_path / "wasp", HostClocks(wall_ms=0)).book
    sure = Fixed(people().wasp, FakeClock())
    issuer = Issuer(people().alice, clock=FakeClock(), wire=FakeWire(), random=seeded(6))
    issuer.watch("wasp-01")
    steps: list[tuple[Believing, int]] = [
        (sure, NOW_MS),
        (lost, NOW_MS - HOUR_MS),
        (lost, NOW_MS - 2 * HOUR_MS),
        (sure, NOW_MS - 3 * HOUR_MS),
    ]
    for seed, (believing, at_ms) in enumerate(steps, start=1):
        issuer.receive_status(KEY, status(believing, at_ms, seed))
        check_seen(issuer, seed)
    issuer.receive_status(KEY, status(sure, NOW_MS - 4 * HOUR_MS, 9))
    check_seen(issuer, len(steps))
