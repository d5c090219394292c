"""What whoever judges a message goes by: what is believed now, and the time. A Protocol, and one that never changes.

The one that changes is `autopilot.trust.book`.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

from autopilot.trust.clock import Clock
from autopilot.trust.freshness import Time, TrustClock, known_time
from autopilot.trust.identity import Identity


class Heard(NamedTuple):
    """What an authenticated header says of the world outside."""

    revocation_version: int
    epoch_id: int
    token_not_before_ms: int


class Believing(Protocol):
    """What a receiver believes, and its time. Any thread; never raises."""

    @property
    def held(self) -> Identity:
        """What is in force now; the value itself does not change."""

    def time(self) -> Time:
        """What is known of the present."""

    def echoes(self, challenge: bytes) -> bool:
        """Say whether this is the receiver's challenge, or the one before."""

    def heard(self, heard: Heard) -> None:
        """Take in what a header says whose signature holds and whose sender is not revoked."""


class Fixed:
    """Believes one identity for good, and a clock."""

    def __init__(self, identity: Identity, clock: Clock) -> None:
        self.held = identity
        self._clock = clock

    def time(self) -> Time:
        """As far as the clock knows it."""
        return known_time(self._clock)

    def echoes(self, challenge: bytes) -> bool:
        """Only a clock that can be uncertain has one."""
        return isinstance(self._clock, TrustClock) and self._clock.echoes(challenge)

    def heard(self, heard: Heard) -> None:
        """Nothing is learned."""
