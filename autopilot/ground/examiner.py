"""All flights of a node, as they lie in a folder, judged: each by itself, by the next one, and by what a witness kept.

Each flight's manifest names the end of the flight before, so whoever changes an old flight has to change every one
after it, up to the one whose checkpoint somebody else has kept. What can't be seen is said in docs/proof.md. It reads
only; whether the decisions replay is asked elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path

from autopilot.ground.kept import Kept
from autopilot.ground.sealed import Anchor, Found, Judged, judge_flight
from autopilot.trust.documents import DocumentError, DocumentMalformed, Trust, verify_token
from autopilot.trust.identity import TOKEN_FILE
from autopilot.trust.replayed import VERDICT_FILE
from events.schema.waypoint_pb2 import PrincipalKind
from events.store import Flight, flights_in


def judge(root: Path, anchor: Anchor | None = None, kept: Kept | None = None) -> list[Found]:
    """Return what is wrong with the flights below `root`, oldest first, and what else is to be told of them.

    Raises StoreMissing, where a folder is taken away meanwhile.
    """
    flights = flights_in(root)
    judged = [judge_flight(flight, anchor) for flight in flights]
    found = [one for each in judged for one in each.found]
    for flight, each in zip(flights, judged, strict=True):
        found += _named(flight, each)
    begun = [each for each in judged if each.leaves]  # a start that was cut short recorded nothing
    found += _first(begun)
    for before, after in pairwise(begun):
        found += _link(before, after)
        if not (before.folder / VERDICT_FILE).exists():
            found.append(Found(before.number, 0, 0, "it is over, and there is no verdict beside it", wrong=False))
    if kept is not None:
        found += _witnessed(begun, kept)
    return sorted(found, key=lambda one: one.flight)


def anchor_of(root: Path, trust: Trust) -> Anchor:
    """Return whose flights these are, by the newest token beside them. Raises DocumentError where none is genuine."""
    refused: DocumentError = DocumentMalformed(f"no flight below {root} has a token beside it")
    for flight in reversed(flights_in(root)):
        try:
            token = verify_token((flight.folder / TOKEN_FILE).read_bytes(), trust)
        except FileNotFoundError:
            continue
        except DocumentError as error:
            refused = error
            continue
        if token.kind == PrincipalKind.NODE:
            return Anchor(token.deployment_id, token.principal_id, token.device_sign_pk)
        refused = DocumentMalformed(f"{token.principal_id} is no node")
    raise refused


def _named(flight: Flight, judged: Judged) -> Iterator[Found]:
    """Hold a folder's name against the manifest in it."""
    if judged.manifest is not None:
        name = f"{judged.manifest.flight_number:06d}-{judged.manifest.flight_id.hex()[:8]}"
        if flight.folder.name != name:
            yield Found(flight.number, 0, 0, f"by its manifest it is {name}, and its folder is {flight.folder.name}")


def _first(begun: Iterable[Judged]) -> Iterator[Found]:
    """Tell of flights before the first: they may have been deleted to make room."""
    first = next(iter(begun), None)
    if first is None or first.manifest is None:
        return
    if first.number > 1 or first.manifest.previous_flight_id:
        before = f"flight {first.manifest.previous_flight_id.hex()[:8]}, which ended with record "
        because = f"the flights before it are not here: {before}{first.manifest.previous_seq}"
        yield Found(max(first.number - 1, 0), 0, first.manifest.previous_seq, because, wrong=False)


def _link(before: Judged, after: Judged) -> Iterator[Found]:
    """Hold the end of a flight against what the next one says of it."""
    manifest, count = after.manifest, len(before.leaves)
    if manifest is None:
        return
    named = f"flight {after.number} says of it"
    if manifest.previous_flight_id != before.flight_id:
        other = manifest.previous_flight_id.hex()[:8] or "none"
        yield Found(before.number + 1, 0, 0, f"flight {after.number} follows {other}, not {before.flight_id.hex()[:8]}")
        return
    if count <= manifest.previous_seq:
        yield Found(before.number, 0, count, f"{named} that it ended with record {manifest.previous_seq}")
    elif count > manifest.previous_seq + 1:
        first = manifest.previous_seq + 1
        yield Found(before.number, 0, first, f"{named} that it ended before record {first}")
    elif before.leaves[-1] != manifest.previous_leaf:
        yield Found(before.number, 0, count - 1, f"{named} that its last leaf was another one")
    else:
        return
    if count in before.signed:  # then it is the next one's word against a signature, and either may be what was changed
        because = f"or it is wrong about flight {before.number}, which is signed up to its end"
        yield Found(after.number, 0, 0, because)


def _witnessed(begun: list[Judged], kept: Kept) -> Iterator[Found]:
    """Hold the flights against the checkpoint that a witness kept."""
    number, size = kept.log_key.flight_number, kept.checkpoint.size
    said = f"a witness kept a checkpoint over {size} records"
    flight = next((each for each in begun if each.number == number), None)
    if flight is None:
        gone = bool(begun) and begun[0].number > number
        yield Found(number, 0, 0, f"{said}, and the flight is not here", wrong=not gone)
    elif flight.flight_id != kept.log_key.flight_id:
        yield Found(number, 0, 0, f"{said} of {kept.log_key.flight_id.hex()[:8]}, another flight of this number")
    elif len(flight.leaves) < size:
        count = len(flight.leaves)
        yield Found(number, 0, count, f"{said}, and the log holds {count}")
    elif flight.root(size) != kept.checkpoint.root:
        yield Found(number, 0, size - 1, f"{said}, and they are not these")
    elif size not in flight.signed:
        yield Found(number, size, size, f"{said}, and it does not lie beside the log")
