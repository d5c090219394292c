"""A sealed flight that witnesses have cosigned, as a node leaves it. Nothing here tests anything."""

from __future__ import annotations

from pathlib import Path

from autopilot.trust.cosignatures import cosign, cosigned, parted
from autopilot.trust.identity import Identity
from events.records import NO_CAUSE, make_record
from events.schema.common_pb2 import Issuer
from events.schema.flight_pb2 import CheckpointCosigned, InputsDropped
from tests.autopilot.trust.world import NOW_MS, people
from tests.flights import story
from tests.replay.sealed import Sealed, sealed_story

AT_S = NOW_MS // 1000
COSIGNED_SIZE = len(story().records)
_MORE = InputsDropped(input_class="frame", count=1)


def cosigned_story(root: Path, *who: str) -> Sealed:
    """Write the story, signed and cosigned by these; the flight goes on by a record, is signed whole and closed."""
    flown = sealed_story(root, close=False)
    flown.sealing.seal(1)
    for name in who:
        _take(flown, getattr(people(), name))
    flown.append(make_record(flown.store.head.seq + 1, NO_CAUSE, story().moment(), _MORE))
    flown.sealing.close(9)
    flown.store.close()
    return flown


def _take(flown: Sealed, who: Identity) -> None:
    text, bare, _ = parted(flown.sealing.newest)
    line = cosign(text, f"waypoint/coast-watch/{who.principal_id}", who.sign_key, AT_S)
    said = CheckpointCosigned(
        witness=_issuer(who),
        origin="waypoint/coast-watch/wasp-01/1",
        size=COSIGNED_SIZE,
        cosigned_at_s=AT_S,
        checkpoint=cosigned(bare, [line]),
        token=who.token_bytes,
    )
    record = make_record(flown.store.head.seq + 1, NO_CAUSE, story().moment(), said)
    flown.append(record)
    flown.sealing.cosigned.hear([record])


def _issuer(who: Identity) -> Issuer:
    return Issuer(principal_id=who.principal_id, callsign=who.callsign)
