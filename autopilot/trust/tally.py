"""Counts of what arrived and what became of it: every sample ends in exactly one of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

REASONS: Final = (
    "rate",
    "size",
    "parse_env",
    "noncanonical_env",
    "shape",
    "parse_hdr",
    "noncanonical_hdr",
    "version",
    "type",
    "route",
    "deployment",
    "ttl",
    "clock_future",
    "clock_stale",
    "challenge",
    "replay",
    "horizon",
    "token_digest",
    "parse_token",
    "token_sig",
    "token_binding",
    "token_kind",
    "token_expired",
    "policy_old",
    "classification",
    "device_sig",
    "revoked",
    "unknown_epoch",
    "epoch_retired",
    "list_old",
    "open",
    "commitment",
    "window_full",
    "internal",
)


@dataclass(slots=True)
class Tally:
    """Received = opened + malformed + the sum of `rejected`, after every message."""

    received: int = 0
    opened: int = 0
    malformed: int = 0
    rejected: dict[str, int] = field(default_factory=lambda: dict.fromkeys(REASONS, 0))

    def balances(self) -> bool:
        """Say whether every message received ended in exactly one count."""
        return self.received == self.opened + self.malformed + sum(self.rejected.values())

    def copy(self) -> Tally:
        """Return a copy that no longer changes."""
        return Tally(self.received, self.opened, self.malformed, dict(self.rejected))
