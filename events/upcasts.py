"""Old shapes of events, lifted to the present one: small independent steps, one from each version to the next.

A body that was recorded is never rewritten; only the message that is read from it is of the present shape. A field
that is added needs no step, for protobuf reads what lacks it. A step is for a change of meaning: another unit, a field
split in two, an enumeration told apart further. The old message stays in the schema under a name of its own, without
the option that would make it a kind (docs/evolution.md).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from google.protobuf.message import Message

from events.kinds import KINDS, Kind


class UpcastGap(Exception):
    """The steps do not lead from every version of every kind to its present one. Our fault, found at start."""


@dataclass(frozen=True, slots=True)
class Upcast:
    """One step: what version `version` of a kind said, said as version + 1."""

    kind: str
    version: int
    shape: type[Message]  # what a body of this version is decoded as
    lift: Callable[[Any], Message]  # pure and total: a record that was taken once is read for ever


Ladder = Mapping[tuple[str, int], Upcast]


def ladder(kinds: Iterable[Kind], upcasts: Iterable[Upcast]) -> dict[tuple[str, int], Upcast]:
    """Return the steps by kind and version. Raises UpcastGap where one is missing, double or leads nowhere."""
    steps: dict[tuple[str, int], Upcast] = {}
    for upcast in upcasts:
        if steps.setdefault((upcast.kind, upcast.version), upcast) is not upcast:
            raise UpcastGap(f"there are two upcasts of {upcast.kind} version {upcast.version}")
    wanted = [(kind.name, version) for kind in kinds for version in range(1, kind.version)]
    for name, version in wanted:
        if (name, version) not in steps:
            raise UpcastGap(f"no upcast lifts {name} version {version}: logs that hold it could not be read")
    for name, version in steps:
        if (name, version) not in wanted:
            raise UpcastGap(f"the upcast of {name} version {version} leads to a version that does not exist")
    return steps


# No kind has a second version yet.
LADDER: dict[tuple[str, int], Upcast] = ladder(KINDS, ())


def lift(kind: Kind, version: int, body: bytes, steps: Ladder = LADDER) -> Message:
    """Decode the body of any known version, 1 to `kind.version`, as the present message. Raises DecodeError."""
    if version == kind.version:
        return kind.message.FromString(body)
    message = steps[kind.name, version].shape.FromString(body)
    for number in range(version, kind.version):
        message = steps[kind.name, number].lift(message)
        following = steps.get((kind.name, number + 1))
        expected = kind.message if following is None else following.shape
        if type(message) is not expected:
            raise UpcastGap(f"the upcast of {kind.name} version {number} makes {type(message).__name__}")
    return message
