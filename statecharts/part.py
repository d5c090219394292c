"""What a chart's file gives to the engine."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from google.protobuf.message import Message

from events.records import Record
from statecharts.state import State
from statecharts.table import Chart

Decide = Callable[[State, Record], tuple[Message, ...]]
Evolve = Callable[[State, Record], None]


@dataclass(frozen=True)
class Part:
    """A chart, what it hears, what it says, and how its part of the state changes."""

    chart: Chart[Any]
    alphabet: frozenset[str]  # kinds that are delivered to `decide`; the rest is not
    decide: Decide
    evolve: Mapping[str, Evolve]  # kind to the change it makes; a chart changes its own tables only
    safety: bool = False  # runs on in safe mode
    moves_of: frozenset[str] | None = None  # charts whose moves concern it, beside its own; None: all
