"""Upcasts for tests: kinds as an older version would have stored them, lifted rightly or wrongly.

The older form is the same message with one field in another unit, order or place; the log that replay sees holds what
the upcast made of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from random import Random
from typing import Any, NamedTuple

from google.protobuf.message import Message

from events import Record, make_record
from replay.blame.case import Lifting, copy_of

Change = Callable[[Any], None]


class Upcast(NamedTuple):
    """A step from an older version: how the old form is made of the new, and what may be made of it."""

    name: str
    kind: str
    lower: Change  # new to old
    lift: Change  # old to new
    wrong: dict[str, Change]  # old to something else


class Lifted(Lifting):
    """Knows which records were lifted, and what they were."""

    def __init__(self, stored: dict[int, Message]) -> None:
        self._stored = stored

    def unlifted(self, record: Record) -> Message | None:
        """Return the body as it was stored."""
        return self._stored.get(record.seq)


def _scale(path: str, up: int, down: int = 1) -> Change:
    *above, name = path.split(".")

    def change(message: Any) -> None:
        for parent in _parents(message, above):
            if parent.HasField(name):
                setattr(parent, name, getattr(parent, name) * up // down)

    return change


def _drop(path: str) -> Change:
    *above, name = path.split(".")

    def change(message: Any) -> None:
        for parent in _parents(message, above):
            parent.ClearField(name)

    return change


def _swap(path: str, other: str) -> Change:
    *above, name = path.split(".")

    def change(message: Any) -> None:
        for parent in _parents(message, above):
            one, two = getattr(parent, name), getattr(parent, other)
            setattr(parent, name, two)
            setattr(parent, other, one)

    return change


def _set(path: str, value: object) -> Change:
    *above, name = path.split(".")

    def change(message: Any) -> None:
        for parent in _parents(message, above):
            if parent.HasField(name):
                setattr(parent, name, value)

    return change


def _flip(path: str) -> Change:
    *above, name = path.split(".")

    def change(message: Any) -> None:
        for parent in _parents(message, above):
            setattr(parent, name, not getattr(parent, name))

    return change


def _parents(message: Any, above: Sequence[str]) -> list[Any]:
    if not above:
        return [message]
    below = getattr(message, above[0])
    entries = [below] if isinstance(below, Message) else list(below)
    return [parent for entry in entries for parent in _parents(entry, above[1:])]


def _both(*changes: Change) -> Change:
    def change(message: Any) -> None:
        for one in changes:
            one(message)

    return change


def _nothing(_message: Any) -> None:
    pass


_PLACE = "detections.place"
UPCASTS = (
    Upcast(
        "error in tenths of a degree",
        "gimbal_reported",
        _scale("error_cdeg", 1, 10),
        _scale("error_cdeg", 10),
        {"forgotten": _nothing, "twice": _scale("error_cdeg", 100), "dropped": _drop("error_cdeg")},
    ),
    Upcast(
        "places in centimetres",
        "frame_observed",
        _both(_scale(f"{_PLACE}.east_mm", 1, 10), _scale(f"{_PLACE}.north_mm", 1, 10)),
        _both(_scale(f"{_PLACE}.east_mm", 10), _scale(f"{_PLACE}.north_mm", 10)),
        {
            "forgotten": _nothing,
            "north forgotten": _scale(f"{_PLACE}.east_mm", 10),
            "exchanged": _both(
                _scale(f"{_PLACE}.east_mm", 10),
                _scale(f"{_PLACE}.north_mm", 10),
                _swap(f"{_PLACE}.east_mm", "north_mm"),
            ),
        },
    ),
    Upcast(
        "confidence in percent",
        "frame_observed",
        _scale("detections.confidence_e4", 1, 100),
        _scale("detections.confidence_e4", 100),
        {
            "forgotten": _nothing,
            "a thousandth": _scale("detections.confidence_e4", 10),
            "constant": _set("detections.confidence_e4", 10_000),
        },
    ),
    Upcast(
        "east was west",
        "frame_observed",
        _scale(f"{_PLACE}.east_mm", -1),
        _scale(f"{_PLACE}.east_mm", -1),
        {"forgotten": _nothing, "all turned round": _scale(f"{_PLACE}.north_mm", -1)},
    ),
    Upcast(
        "life in seconds",
        "order_received",
        _scale("life_ms", 1, 1000),
        _scale("life_ms", 1000),
        {"forgotten": _nothing, "a hundredth": _scale("life_ms", 100), "half a minute": _set("life_ms", 30_000)},
    ),
    Upcast(
        "order numbers doubled",
        "order_received",
        _scale("order_seq", 2),
        _scale("order_seq", 1, 2),
        {"constant": _set("order_seq", 1), "dropped": _drop("order_seq")},
    ),
    Upcast(
        "down instead of up",
        "vehicle_link_changed",
        _flip("up"),
        _flip("up"),
        {"forgotten": _nothing, "dropped": _drop("up")},
    ),
    Upcast(
        "results from one on",
        "command_answered",
        lambda answer: setattr(answer, "mav_result", answer.mav_result + 1),
        lambda answer: setattr(answer, "mav_result", answer.mav_result - 1),
        {"forgotten": _nothing, "dropped": _drop("mav_result"), "constant": _set("mav_result", 4)},
    ),
)


def _turned(message: Message, *changes: Change) -> Message:
    fresh = copy_of(message)
    for change in changes:
        change(fresh)
    return fresh


def wrong(chance: Random, records: Sequence[Record]) -> tuple[str, list[Record], Lifting]:
    """Return what replay sees of a log whose upcast of one kind is wrong."""
    upcast = chance.choice(UPCASTS)
    name = chance.choice(sorted(upcast.wrong))
    stored, seen = dict[int, Message](), list[Record]()
    for record in records:
        if record.kind.name == upcast.kind:
            stored[record.seq] = _turned(record.message, upcast.lower)
            lifted = _turned(stored[record.seq], upcast.wrong[name])
            record = make_record(record.seq, record.cause, record.at, lifted)
        seen.append(record)
    return f"{upcast.name}: {name}", seen, Lifted(stored)


def right(chance: Random, records: Sequence[Record]) -> Lifting:
    """Return a lifting of one kind that is as it should be."""
    upcast = chance.choice(UPCASTS)
    return Lifted(
        {record.seq: _turned(record.message, upcast.lower) for record in records if record.kind.name == upcast.kind}
    )
