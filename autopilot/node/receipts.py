"""The receipt of a flight that was pushed: what lies elsewhere, where, and since when.

It lies as `pushed` in the flight's folder. It is worth something only while it names the very head of the log beside
it; whoever writes it has looked. Without it a flight is never deleted.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from autopilot.trust.keys import write_file
from events.store.protocol import Head

NAME = "pushed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Receipt:
    """What was pushed."""

    flight_number: int
    flight_id: str  # hex
    last_seq: int
    last_leaf: str  # hex
    to: str  # in the words of whoever pushed it
    at_ms: int  # wall clock, milliseconds since 1970

    def names(self, flight_id: bytes, head: Head) -> bool:
        """Say whether it is the receipt of this flight, whole."""
        return (self.flight_id, self.last_seq, self.last_leaf) == (flight_id.hex(), head.seq, head.leaf.hex())


def read_receipt(folder: Path) -> Receipt | None:
    """Return the receipt in a flight's folder; None where there is none, or none that can be read."""
    try:
        said = json.loads((folder / NAME).read_text(encoding="utf-8"))
        receipt = Receipt(**said)
        bytes.fromhex(receipt.flight_id + receipt.last_leaf)
    except (OSError, ValueError, TypeError):
        return None
    numbers = (receipt.flight_number, receipt.last_seq, receipt.at_ms)
    whole = all(isinstance(number, int) and number >= 0 for number in numbers) and isinstance(receipt.to, str)
    return receipt if whole else None


def write_receipt(folder: Path, receipt: Receipt) -> None:
    """Lay a receipt into a flight's folder, durably. Raises OSError."""
    write_file(folder / NAME, json.dumps(asdict(receipt), sort_keys=True).encode())
