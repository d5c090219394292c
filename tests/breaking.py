"""Charts that raise, for tests of what the engine does then. Nothing outside a test is touched."""

from __future__ import annotations

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


def _broken(part: Part, chart: str, kind: str) -> Part:
    if part.chart.name != chart:
        return part

    def decide(state: State, record: Record) -> tuple[Message, ...]:
        if record.kind.name == kind:
            raise RuntimeError("broken for a test")
        return part.decide(state, record)

    return replace(part, decide=decide)
