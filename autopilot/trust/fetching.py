"""The seam between what a node believes and whoever brings it newer documents.

The book of trust (`autopilot.trust.book`) asks through `Fetch`; whoever fetches (Zenoh, a watched folder) gives
what came to `Offer`. Nothing here judges a document, and nothing there stores one.
"""

from __future__ import annotations

from enum import Enum
from typing import Literal, Protocol

What = Literal["trust_root", "revocations", "epoch", "time"]
"""TrustRoot, RevocationList, EpochBundle for this device, TimeBeacon."""


class Offered(Enum):
    """What became of a document that was offered; the value is the counter's name."""

    TAKEN = "taken"  # newer: durable, recorded, and in force
    SAME = "same"  # the one that is held; nothing changed
    OLD = "old"  # an epoch that is over or was replaced: no alarm, for bundles are fetched again and again
    MALFORMED = "malformed"  # too large, can't be parsed, or a field is out of its bounds
    UNSIGNED = "unsigned"  # not signed by the key of its purpose
    FOREIGN = "foreign"  # another deployment's, or wrapped for another device
    ROLLBACK = "rollback"  # an older version than the one that is held: alarm
    EQUIVOCATION = "equivocation"  # the same version with another content: alarm
    UNASKED = "unasked"  # a beacon that answers no challenge of ours, or came too late
    NOT_KEPT = "not_kept"  # the disk or the log refused it: what was held before stays in force


class Fetch(Protocol):
    """Brings newer documents. May be called from any thread; never blocks, never raises, may come to nothing."""

    def request(self, what: What, challenge: bytes | None = None) -> None:
        """Begin to fetch `what`; whatever comes is offered. `challenge` (16 bytes) goes with "time" and only there.

        The caller limits the rate. A time beacon must be asked for at once or not at all: the time of its
        journey is its uncertainty.
        """


class Offer(Protocol):
    """Takes a document from whoever brought it (`TrustBook.offer`). Any thread; never raises; may write to the disk."""

    def __call__(self, kind: What, data: bytes) -> Offered:
        """Judge the encoded SignedDoc and, where it is newer, put it into force."""


class NoFetch:
    """Fetches nothing: for a node that is given its documents by hand."""

    def request(self, what: What, challenge: bytes | None = None) -> None:
        """Do nothing."""
