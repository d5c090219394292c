"""Where else what a record says may lie: what it led to, and what says one of its places again.

A decision repeats its observation, an effect the order's place, a question the detection's. Who removes the one and
leaves the other has removed nothing. Words that people typed and names are not looked for: those stand where the kind
says so.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Set
from typing import NamedTuple, cast

from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.message import Message

from events import NO_CAUSE, BodyBroken, UnknownKind, read_record
from events.records import Stored
from events.schema.common_pb2 import Place
from events.store import Reader
from replay.causes import led_from

Spot = tuple[int, int]  # latitude and longitude in 1e-7 degrees


class Descent(NamedTuple):
    """Records that may give away what others said; none is in both."""

    led_to: frozenset[int]  # by cause, or by the effect that an outcome answers
    same_place: frozenset[int]  # says a place of the chosen ones again, or was led to by one that does

    @property
    def all(self) -> frozenset[int]:
        """Both."""
        return self.led_to | self.same_place


def descent(reader: Reader, chosen: Set[int]) -> Descent:
    """Return what descends from the chosen records, without these. Raises StoreFailed."""
    led_to = _closure(reader, chosen) - chosen
    spots = {spot for stored in reader.stored() if stored.seq in chosen for spot in _spots(stored)}
    echoes = {stored.seq for stored in reader.stored() if spots and not spots.isdisjoint(_spots(stored))}
    same_place = _closure(reader, echoes - chosen - led_to) - chosen - led_to
    return Descent(frozenset(led_to), frozenset(same_place))


def computed_again(reader: Reader, removed: Set[int]) -> list[int]:
    """Return the removed decisions whose observation is not removed: whoever replays the copy decides them again."""
    return [
        one.seq for one in reader.stored() if one.seq in removed and one.cause != NO_CAUSE and one.cause not in removed
    ]


def _closure(reader: Reader, of: Set[int]) -> set[int]:
    found = set(of)
    if found:
        for stored in reader.stored(min(found)):
            if led_from(stored) in found:
                found.add(stored.seq)
    return found


def _spots(stored: Stored) -> Iterable[Spot]:
    """Return the places that a record says; none where it can't be read."""
    try:
        return set(_places(read_record(stored).message))
    except (UnknownKind, BodyBroken):
        return ()


def _places(message: Message) -> Iterator[Spot]:
    if isinstance(message, Place):
        yield message.latitude_e7, message.longitude_e7
        return
    for field, value in cast("list[tuple[FieldDescriptor, object]]", message.ListFields()):
        if field.message_type is not None:
            for part in value if field.is_repeated else (value,):  # type: ignore[attr-defined]
                yield from _places(part)
