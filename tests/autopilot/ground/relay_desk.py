"""A Directory outside a relay and somebody inside who asks it, between two links that remember; nothing here tests."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from autopilot.adapters.mesh.link import Reply
from autopilot.ground.directory_papers import signed_beacon, signed_bundle
from autopilot.ground.relay import Relay
from autopilot.ground.relay_config import VerifySection
from autopilot.ground.relay_papers import Papers
from autopilot.trust.identity import REVOCATIONS_FILE, ROOT_FILE
from autopilot.trust.keys import SignKey
from autopilot.wire.directory_pb2 import Documents as Several
from autopilot.wire.keys import (
    BUNDLES,
    EPOCHS,
    REVOCATIONS,
    TIMES,
    TRUST_ROOTS,
    Channel,
    trust_key,
)
from tests.autopilot.ground import directories
from tests.autopilot.trust.world import NOW_MS, FakeClock, FakeWire

CHALLENGE = b"c" * 16
Make = Callable[["Desk"], bytes]


class Desk:
    """A Directory outside, a relay, and somebody inside who asks it."""

    def __init__(self, root: Path) -> None:
        self.world, self.clock = directories.world(root), FakeClock()
        self.world.issue("bob")
        self.public = root / "public"
        self.public.mkdir()
        self.lay_out()
        self.outer, self.inner = FakeWire(), FakeWire()
        self.papers = Papers(self.public, NOW_MS)
        config = VerifySection(documents=str(self.public), nodes=("wasp-01",))
        self.relay = Relay(config, self.papers, self.clock, self.outer, self.inner)
        self.device = self.world.identity("wasp-01").sign_key.key_id
        self.relay.start()

    def lay_out(self) -> None:
        """Copy the Directory's public documents as they are now into the relay's folder."""
        for name in (ROOT_FILE, REVOCATIONS_FILE):
            (self.public / name).write_bytes(self.newest(name))

    def newest(self, name: str) -> bytes:
        """Return the Directory's trust root or list as it is now."""
        return (self.world.folder / name).read_bytes()

    def key(self, purpose: str) -> SignKey:
        """Return one of the Directory's keys."""
        return self.world.open().purpose_keys[purpose]

    def beacon(self, challenge: bytes = CHALLENGE) -> bytes:
        """Return the time, signed."""
        return signed_beacon(self.world.open(), challenge, NOW_MS)

    def bundles(self, who: str = "wasp-01") -> list[bytes]:
        """Return the bundles of a device."""
        made, token = self.world.open(), self.world.identity(who).token
        return [signed_bundle(made, epoch, token) for epoch in made.state.epochs]

    def ask(self, channel: Channel, question: bytes, *answers: bytes) -> list[bytes]:
        """Ask inside while these are the answers outside; return what came of it."""
        self.outer.answers, replied = list(answers), list[bytes]()
        self.inner.answerers[trust_key(channel, "coast-watch")](question, replied.append)
        self.settle()
        return replied

    def publish(self, key_expr: str, payload: bytes) -> None:
        """Publish outside."""
        pattern = key_expr if key_expr in self.outer.subscriptions else trust_key(BUNDLES, "coast-watch")
        self.outer.subscriptions[pattern.replace("<device_key_id>", "*")](key_expr, payload)
        self.settle()

    def settle(self) -> None:
        """Wait until the relay has done what it has to do."""
        for lane in self.relay._documents._lanes.values():
            done = threading.Event()
            assert lane.put(done.set)
            assert done.wait(10)

    def counts(self, channel: Channel) -> dict[str, int]:
        """Return what became of documents of a kind."""
        return self.relay.counts()[channel.name]

    def inside(self) -> list[tuple[str, bytes]]:
        """Stop the relay; return what it put inside."""
        self.relay.stop()
        return [(key, payload) for key, payload, _ in self.inner.puts]


class Asked:
    """A question whose end is seen: `gone` is set when nobody holds its reply any more."""

    def __init__(self) -> None:
        self.gone, self._replied = threading.Event(), list[bytes]()

    def reply(self) -> Reply:
        """Return what answers it; it is not kept here."""
        replied = self._replied

        def give(answer: bytes) -> None:
            replied.append(answer)

        weakref.finalize(give, self.gone.set)
        return give


@contextmanager
def desk_in(root: Path) -> Iterator[Desk]:
    """Make one, and stop its relay at the end."""
    made = Desk(root)
    yield made
    made.relay.stop()


def several(*found: bytes) -> bytes:
    """Encode an answer of several documents."""
    return Several(documents=found).SerializeToString(deterministic=True)


# The true answer of each kind.
GOOD: dict[Channel, Make] = {
    TRUST_ROOTS: lambda desk: desk.newest(ROOT_FILE),
    REVOCATIONS: lambda desk: desk.newest(REVOCATIONS_FILE),
    EPOCHS: lambda desk: several(*desk.bundles()),
    TIMES: lambda desk: desk.beacon(),
}
