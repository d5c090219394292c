"""What a node says of a flight that it has run again: a signed note that lies beside the log as the file `verdict`.

It names the head up to which the log was followed, so it can't be laid beside another. Who replays is elsewhere.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from autopilot.trust.notes import NoteInvalid, open_note

VERDICT_FILE = "verdict"
_VERSION = "waypoint/verdict/v1"
_TEXT = re.compile(
    rf"{_VERSION}\n(\S+)\nflight ([0-9a-f]{{32}})\nhead (-1|\d{{1,19}}) ([0-9a-f]{{64}})\nsoftware (\S+)\n(\S+)\n"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class SignedVerdict:
    """What the node says of a flight that it has run again."""

    origin: str  # waypoint/<deployment>/<node>/<flight number>
    flight_id: str  # hex
    seq: int  # last record whose chain held
    leaf: str  # its leaf, hex
    software: str
    verdict: str

    def text(self) -> str:
        """Return the text to sign."""
        head = f"flight {self.flight_id}\nhead {self.seq} {self.leaf}"
        return f"{_VERSION}\n{self.origin}\n{head}\nsoftware {self.software}\n{self.verdict}\n"


def read_verdict(folder: Path, public_key: bytes, signer: str) -> SignedVerdict | None:
    """Return the verdict beside a log that `signer` signed with this key; None: there is none. Raises NoteInvalid."""
    try:
        text = open_note((folder / VERDICT_FILE).read_text("utf-8"), signer, public_key)
    except FileNotFoundError:
        return None
    except (OSError, UnicodeDecodeError) as error:
        raise NoteInvalid(f"the verdict can't be read: {error}") from error
    found = _TEXT.fullmatch(text)
    if found is None:
        raise NoteInvalid("the verdict is not written as it is to be")
    origin, flight_id, seq, leaf, software, verdict = found.groups()
    return SignedVerdict(
        origin=origin, flight_id=flight_id, seq=int(seq), leaf=leaf, software=software, verdict=verdict
    )
