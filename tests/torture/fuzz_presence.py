"""Fuzz of the door for presence: nobody without a key keeps an operators' link up, and no member stops the node.

The same changes as of orders (`fuzzing`), made to presence. Of what was changed nothing is heard, every sample is
counted once, none as `internal`, and nothing escapes.
"""

from __future__ import annotations

from collections import Counter
from functools import cache
from random import Random

from google.protobuf.message import Message

from autopilot.adapters.mesh.hearing import Hearing, PresenceDoor
from autopilot.ports.edges import InputClass
from autopilot.trust.envelope import MessageType
from autopilot.wire.keys import presence_key
from events.schema.waypoint_pb2 import OperatorPresence
from tests.autopilot.trust.papers import HostClocks
from tests.autopilot.trust.world import Forge, people
from tests.torture.fuzzing import OUTSIDERS

HERE = presence_key("wasp-01", "alice")
STEP_MS = 10  # as often as the door's bucket lets one through
PERIOD_S = 0.001  # everything that is believed is told


@cache
def originals() -> tuple[bytes, ...]:
    """Return good presences, of two senders."""
    alice = Forge(people().alice, MessageType.PRESENCE, HERE, content(5), ttl_ms=3000)
    bob = Forge(people().bob, MessageType.PRESENCE, presence_key("wasp-01", "bob"), content(6), ttl_ms=3000)
    return (alice.envelope(), bob.envelope())


def content(head_seq: int) -> bytes:
    """Return what a presence says."""
    return OperatorPresence(heard_head_seq=head_seq).SerializeToString()


class Listening:
    """A node's door, and what came of what was thrown at it."""

    def __init__(self, seed: int) -> None:
        self.random, self.clock = Random(seed), HostClocks()
        self.told = 0
        self.received = 0
        self.door = PresenceDoor(
            people().wasp, self.clock, Hearing(self.clock, frozenset({"operator"}), PERIOD_S, self._tell)
        )

    def throw(self, payload: bytes, key_expr: str = HERE) -> None:
        """Let one sample come in."""
        self.clock.mono_ms += STEP_MS
        self.received += 1
        self.door.receive(key_expr, payload)

    def outsider(self) -> None:
        """Throw what somebody without a key has changed."""
        _, change = self.random.choice(OUTSIDERS)
        changed = change(self.random, self.random.choice(originals()))
        if changed not in originals():
            self.throw(changed)

    def insider(self, seq: int) -> None:
        """Throw what an operator has signed around anything."""
        plaintext = self.random.choice((b"", self.random.randbytes(self.random.randrange(1, 200)), b"\x12\x02\xff\xff"))
        self.throw(Forge(people().alice, MessageType.PRESENCE, HERE, seq=seq, body=plaintext, ttl_ms=3000).envelope())

    def counts(self) -> Counter[str]:
        """Return what the door counted; every sample once, with what was told. Raises AssertionError."""
        found = self.door.rejected()
        assert found["presence: internal"] == 0
        assert found.total() + self.told == self.received, (found, self.told, self.received)
        return found

    def _tell(self, input_class: InputClass, observation: Message) -> bool:
        self.told += input_class is InputClass.OUTCOME and observation.IsInitialized()
        return True


def share(seed: int, outsiders: int, insiders: int) -> Counter[str]:
    """Throw so many; return what was counted. Raises AssertionError where an outsider is heard."""
    listening = Listening(seed)
    for _ in range(outsiders):
        listening.outsider()
    assert listening.told == 0, f"seed {seed}: an outsider is heard"
    assert len(listening.door._gate._window) == 0
    listening.counts()
    for number in range(insiders):
        listening.insider(number + 10)
    return listening.counts()
