"""Charts that raise or decide otherwise, for tests of what is said of it. Nothing outside a test is touched."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from google.protobuf.message import Message

from events import Record
from statecharts import State, engine
from statecharts.part import Part


def break_chart(monkeypatch: pytest.MonkeyPatch, chart: str, kind: str) -> None:
    """Let a chart raise RuntimeError whenever it is asked about a kind of record; it says what it can before."""
    places = tuple((bit, _broken(part, chart, kind)) for bit, part in engine._PLACES)
    monkeypatch.setattr(engine, "_PLACES", places)


def alter_chart(monkeypatch: pytest.MonkeyPatch, chart: str, change: Callable[[Message], Message | None]) -> None:
    """Let a chart decide otherwise: each of its decisions is what `change` makes of it, or none."""
    places = tuple((bit, _altered(part, chart, change)) for bit, part in engine._PLACES)
    monkeypatch.setattr(engine, "_PLACES", places)


def _altered(part: Part, chart: str, change: Callable[[Message], Message | None]) -> Part:
    if part.chart.name != chart:
        return part

    def decide(state: State, record: Record) -> tuple[Message, ...]:
        return tuple(said for decision in part.decide(state, record) if (said := change(decision)) is not None)

    return replace(part, decide=decide)


def _broken(part: Part, chart: str, kind: str) -> Part:
    if part.chart.name != chart:
        return part

    def decide(state: State, record: Record) -> tuple[Message, ...]:
        if record.kind.name == kind:
            raise RuntimeError("broken for a test")
        return part.decide(state, record)

    return replace(part, decide=decide)
