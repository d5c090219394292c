"""What an order asks for, read from the bytes that were signed and from what a node recorded: a part of the verifier.

Like the rest of the verifier it is written from docs/proof.md (Orders) and shares no code with the node. Both readings
come to one form, a word for the kind and its values, so that they can be compared. Where a mode is a word on the wire
and a number in the log, the word counts; one that is not known here is empty in both.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from autopilot.ground.papers import field_of, fields_all, parts_of

Parts = list[tuple[int, int | bytes]]
Asked = tuple[object, ...]
Reader = Callable[[Parts, str], Asked]
UNKNOWN: Final[Asked] = ("unknown",)

# Words that may be signed, by the number that a node records for them; 0 is recorded for a word that it did not know.
MODES: Final = {2: "loiter", 3: "guided", 4: "return", 5: "land"}
SCOPES: Final = {1: "battery_return", 2: "link_return", 3: "fence_return"}
VERBS: Final = {1: "begin", 2: "pause", 3: "resume", 4: "abort"}
MODES_RECORDED: Final = MODES | {1: "mission"}  # a mode that no order asks for


def signed_order(command: Parts, what: str) -> Asked:
    """Return what a DeviceCommand asks for; UNKNOWN for another kind. Raises ProofRefused."""
    return _read(command, _SIGNED, what)


def recorded_order(record: Parts, what: str) -> Asked:
    """Return what an `order_received` says was asked. Raises ProofRefused."""
    return _read(record, _RECORDED, what)


def words(asked: Asked) -> str:
    """Return what was asked as a part of a sentence."""
    match asked:
        case ("place", camera, int(latitude), int(longitude), int(altitude)):
            return f"point camera {camera} at {_place(latitude, longitude, altitude)}"
        case ("angles", camera, int(pitch), int(yaw), locked):
            frame = "from north" if locked else "from the nose"
            return f"point camera {camera} to pitch {pitch / 100:.2f}, yaw {yaw / 100:.2f} {frame}"
        case ("zoom", camera, int(zoom_e4)):
            return f"zoom camera {camera} to {zoom_e4 / 100:.2f} % of its range"
        case ("release", camera):
            return f"let go of camera {camera}"
        case (("confirm" | "decline") as word, poi_id):
            return f"{word} finding {poi_id}"
        case ("follow", poi_id, camera):
            return f"keep finding {poi_id} in view with camera {camera}"
    return _flight_words(asked)


def _flight_words(asked: Asked) -> str:
    match asked:
        case ("fly", int(latitude), int(longitude), int(altitude)):
            return f"fly to {_place(latitude, longitude, altitude)}, and stay there"
        case ("mode", str(mode)):
            return f"put the vehicle into mode {mode or _NOT_KNOWN}"
        case ("override", str(scope), str(reason), int(held_ms)):
            return f"hold {scope or _NOT_KNOWN} off for {held_ms / 1000:.1f} s, because of {reason!r}"
        case ("acknowledge", report):
            return f"take on self-test {report} as it came out"
        case ("mission", str(verb)):
            return f"{verb or 'do something that this version does not know with'} the mission"
    return "do something that this version does not know"


_NOT_KNOWN: Final = "(none that this version knows)"


def _place(latitude_e7: int, longitude_e7: int, altitude_mm: int) -> str:
    return f"{latitude_e7 / 1e7:.7f} {longitude_e7 / 1e7:.7f}, {altitude_mm / 1000:.1f} m AMSL"


def _read(parts: Parts, readers: Mapping[int, Reader], what: str) -> Asked:
    """Read the arm of a oneof: the last that is there and known, as protobuf does."""
    for number, _ in reversed(parts):
        if number in readers:
            return readers[number](inner_of(parts, number, what), what)
    return UNKNOWN


def _signed_place(inner: Parts) -> Asked:
    """A place on the wire has its altitude in decimetres."""
    return signed_of(inner, 1), signed_of(inner, 2), signed_of(inner, 3) * 100


def _recorded_place(inner: Parts, number: int, what: str) -> Asked:
    place = inner_of(inner, number, what)
    return tuple(signed_of(place, field) for field in (1, 2, 3))


def _known(text: str, among: Mapping[int, str]) -> str:
    return text if text in among.values() else ""


_SIGNED: Final[dict[int, Reader]] = {
    10: lambda one, _: ("place", number_of(one, 20) or 1, *_signed_place(one)),
    11: lambda one, _: (
        *("angles", number_of(one, 20) or 1),
        *(signed_of(one, 1), number_of(one, 2), number_of(one, 21)),
    ),
    20: lambda one, _: ("release", number_of(one, 1) or 1),
    21: lambda one, _: ("confirm", text_of(one, 1)),
    22: lambda one, _: ("decline", text_of(one, 1)),
    23: lambda one, _: ("zoom", number_of(one, 2) or 1, number_of(one, 1)),
    30: lambda one, _: ("fly", *_signed_place(one)),
    31: lambda one, _: ("mode", _known(text_of(one, 1), MODES)),
    32: lambda one, _: ("override", _known(text_of(one, 1), SCOPES), text_of(one, 2), number_of(one, 3)),
    33: lambda one, _: ("acknowledge", number_of(one, 1)),
    34: lambda one, _: ("mission", _known(text_of(one, 1), VERBS)),
    35: lambda one, _: ("follow", text_of(one, 1), number_of(one, 2) or 1),
}
_RECORDED: Final[dict[int, Reader]] = {
    20: lambda one, what: ("place", number_of(one, 1), *_recorded_place(one, 2, what)),
    21: lambda one, _: ("angles", number_of(one, 1), signed_of(one, 2), number_of(one, 3), number_of(one, 4)),
    22: lambda one, _: ("release", number_of(one, 1)),
    23: lambda one, _: ("confirm" if number_of(one, 2) else "decline", text_of(one, 1)),
    24: lambda one, _: ("zoom", number_of(one, 1), number_of(one, 2)),
    30: lambda one, what: ("fly", *_recorded_place(one, 1, what)),
    31: lambda one, _: ("mode", MODES_RECORDED.get(number_of(one, 1), "")),
    32: lambda one, _: ("override", SCOPES.get(number_of(one, 1), ""), text_of(one, 2), number_of(one, 3)),
    33: lambda one, _: ("acknowledge", number_of(one, 1)),
    34: lambda one, _: ("mission", VERBS.get(number_of(one, 1), "")),
    35: lambda one, _: ("follow", text_of(one, 1), number_of(one, 2)),
}


def inner_of(parts: Parts, number: int, what: str) -> Parts:
    """Return a message in a field that must be there once. Raises ProofRefused."""
    return parts_of(field_of(parts, number, what), what)


def number_of(parts: Parts, number: int) -> int:
    """Return a number; 0 where it is absent."""
    return next((value for field, value in parts if field == number and isinstance(value, int)), 0)


def signed_of(parts: Parts, number: int) -> int:
    """Return a field of type sint32; 0 where it is absent."""
    value = number_of(parts, number)
    return (value >> 1) ^ -(value & 1)


def text_of(parts: Parts, number: int) -> str:
    """Return a text; empty where it is absent."""
    return b"".join(fields_all(parts, number)).decode("utf-8", "replace")
