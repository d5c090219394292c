"""Other code: charts with another row, guard, constant, message or order, for as long as a patch holds.

What a row says is under the digest in the manifest; what stands in a function is not. `CODE` holds both sorts,
`ENVIRONMENT` code that decides by something else than the log. Nothing outside a patch is touched.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import ModuleType
from typing import Any

import pytest
from google.protobuf.message import Message

from events import Record
from events.schema.orders_pb2 import SendAck
from statecharts import CHARTS, State, engine, journal
from statecharts.charts import (
    aim,
    camera,
    command,
    command_part,
    command_state,
    health,
    mapping,
    poi,
    poi_part,
    scan,
    scan_part,
)
from statecharts.facts import MapObject, Poi, Scan, Spot
from statecharts.table import Chart, Row

Patch = Callable[[pytest.MonkeyPatch], None]
MODULES: dict[str, tuple[ModuleType, ...]] = {
    "command": (command, command_part, command_state),
    "camera": (camera,),
    "map": (mapping,),
    "poi": (poi, poi_part),
    "scan": (scan, scan_part),
    "aim": (aim,),
    "health": (health,),
}


def _rows(chart: str, change: Callable[[Row[Any]], Row[Any] | None]) -> Patch:
    """Return the patch that changes rows of a chart; None takes one out."""

    def patch(monkeypatch: pytest.MonkeyPatch) -> None:
        old: Chart[Any] = MODULES[chart][0].CHART
        rows = tuple(row for row in map(change, old.rows) if row is not None)
        new = Chart(old.name, old.initial, old.states, old.terminal, old.triggers, rows)
        for module in MODULES[chart]:
            monkeypatch.setattr(module, "CHART", new)
        monkeypatch.setattr(engine, "CHARTS", tuple(new if one is old else one for one in CHARTS))

    return patch


def _guard(chart: str, name: str, guard: Callable[[Any], bool]) -> Patch:
    """Return the patch that gives a guard another body; its name, which the digest covers, stays."""
    guard.__name__ = name
    return _rows(chart, lambda row: replace(row, guard=guard) if row.guard and row.guard.__name__ == name else row)


def _reworded(chart: str, because: str) -> Patch:
    return _rows(chart, lambda row: replace(row, because="in other words") if row.because == because else row)


def _removed(chart: str, because: str) -> Patch:
    return _rows(chart, lambda row: None if row.because == because else row)


def _retargeted(chart: str, because: str, target: str) -> Patch:
    return _rows(chart, lambda row: replace(row, target=target) if row.because == because else row)


def _set(module: ModuleType, name: str, value: object) -> Patch:
    return lambda monkeypatch: monkeypatch.setattr(module, name, value)


def _order(one: int, other: int) -> Patch:
    """Return the patch that asks two charts in the other order."""

    def patch(monkeypatch: pytest.MonkeyPatch) -> None:
        places = list(engine._PLACES)
        places[one], places[other] = places[other], places[one]
        monkeypatch.setattr(engine, "_PLACES", tuple(places))

    return patch


def _said(chart: str, kind: type[Message], change: Callable[[Any], None]) -> Patch:
    """Return the patch that changes what a chart says."""

    def patch(monkeypatch: pytest.MonkeyPatch) -> None:
        def part_of(part: Any) -> Any:
            if part.chart.name != chart:
                return part

            def decide(state: State, record: Record) -> tuple[Message, ...]:
                said: tuple[Message, ...] = part.decide(state, record)
                for message in said:
                    if isinstance(message, kind):
                        change(message)
                return said

            return replace(part, decide=decide)

        monkeypatch.setattr(engine, "_PLACES", tuple((bit, part_of(part)) for bit, part in engine._PLACES))

    return patch


def _shorter(ack: SendAck) -> None:
    ack.detail = ack.detail[:12]


def _not_final(ack: SendAck) -> None:
    ack.duplicate = not ack.duplicate


def _no_reply(ack: SendAck) -> None:
    ack.ClearField("in_reply_to")


def _newest(state: State, _key: str) -> Poi | None:
    waiting = [state.pois[key] for key, _ in state.open_pois.items() if not state.pois[key].looked]
    return max(waiting, key=lambda one: (one.opened_ns, one.poi_id), default=None)


def _any_class(state: State, _group: str, spot: Spot, thing: MapObject) -> bool:
    return spot.within(thing.spot, state.flight.limits.same_poi_mm)


def _rate_of_all(scan_of: Scan, floor_mhz: int) -> int:
    span_ns = scan_of.captures[-1] - scan_of.captures[0] if scan_of.captures else 0
    return len(scan_of.captures) * 10**12 // span_ns if span_ns > 0 else floor_mhz


def _square(square: int) -> int:
    return square >> 10


# Rows: the digest in the manifest tells.
ROWS: dict[str, Patch] = {
    "no row for a silent vehicle": _removed("command", "no vehicle is heard"),
    "no row for an older order": _removed("command", "stale: a newer order came first"),
    "another reason for a role": _reworded("command", "role not permitted"),
    "a judgement is rejected": _retargeted("command", "recorded", "rejected"),
    "a hold ends released": _retargeted("camera", "the hold ran out", "released"),
    "another reason for a question": _reworded("poi", "put to an operator"),
    "another reason for an arrival": _reworded("aim", "measured within the tolerance"),
    "a sweep in other words": _reworded("scan", "has looked long enough"),
    "an answer in other words": _reworded("command", "all gates passed"),
}
# Bodies of functions, constants, order: the manifest does not tell.
BODIES: dict[str, Patch] = {
    "older lets its equal pass": _guard(
        "command", "older", lambda facts: facts.arrival.order_seq < facts.arrival.newest_seq
    ),
    "replayed never": _guard("command", "replayed", lambda facts: False),
    "role by name": _guard("command", "role_missing", lambda facts: facts.received.issuer.principal_id == "alpha"),
    "silent never": _guard("command", "vehicle_silent", lambda facts: False),
    "cameras all turn": _guard("command", "poi_over", lambda facts: False),
    "accepted in progress": _guard("command", "vehicle_accepted", lambda facts: facts.mav_result in (0, 4)),
    "busy never": _guard("command", "vehicle_busy", lambda facts: facts.mav_result == 77),
    "near by half": _guard("aim", "near", lambda facts: facts.error_cdeg * 2 <= facts.tolerance_cdeg),
    "quick at once": _guard("scan", "quick", lambda facts: True),
    "other body ignored": _guard("command", "other_body", lambda facts: False),
    "grace of 1 s": _set(command_state, "OUTCOME_GRACE_NS", 1_000_000_000),
    "rate of four frames": _set(scan_part, "RATE_FRAMES", 4),
    "a minute of 20 s": _set(poi_part, "MINUTE_NS", 20_000_000_000),
    "rate of all frames": _set(scan_part, "_rate_mhz", _rate_of_all),
    "temporarily refused goes on": _set(aim, "MAV_GOES_ON", (0, 3, 4, 5)),
    "unsupported is refused": _set(command, "MAV_UNSUPPORTED_ALL", (7, 8, 9)),
    "no square root": _set(mapping, "_root", _square),
    "questions of any class": _set(poi_part, "_same", _any_class),
    "the newest question": _set(scan_part, "_candidate", _newest),
    "nothing is left alone": _set(poi_part, "_left_alone", lambda *_: False),
    "details are cut": _said("command", SendAck, _shorter),
    "repeats are turned round": _said("command", SendAck, _not_final),
    "answers without envelope": _said("command", SendAck, _no_reply),
    "the camera before the command": _order(1, 2),
    "scan after aim": _order(5, 6),
    "questions after the scan": _order(4, 5),
}
CODE = ROWS | BODIES


def _items_by_hash(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journal, "_key_of", lambda item: hash(str(item[0])))


def _passed_by_hash(monkeypatch: pytest.MonkeyPatch) -> None:
    def passed(self: State, chart: str, now_ns: int) -> tuple[str, ...]:
        keys = (key[1] for key, at_ns in self.deadlines.items() if key[0] == chart and at_ns <= now_ns)
        return tuple(sorted(keys, key=hash))

    monkeypatch.setattr(State, "passed", passed)


def _by_chance_of_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    """Decide by how often was decided before: a value that leaks from step to step."""
    calls = [0]

    def count(ack: SendAck) -> None:
        calls[0] += 1
        ack.detail += "." * (calls[0] % 7)

    _said("command", SendAck, count)(monkeypatch)


def _set_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    def mention(ack: SendAck) -> None:
        ack.detail = "/".join({ack.detail, ack.command_id, ack.principal_id, "answer"})

    _said("command", SendAck, mention)(monkeypatch)


ENVIRONMENT: dict[str, Patch] = {
    "rows in the order of hashes": _items_by_hash,
    "deadlines in the order of hashes": _passed_by_hash,
    "by the number of calls": _by_chance_of_calls,
    "a set in an answer": _set_in_words,
}
# What an interpreter that rounds otherwise would do; it is there while a flight is recorded, and not afterwards.
ANOTHER_INTERPRETER = "another interpreter"
RECORDING: dict[str, Patch] = {ANOTHER_INTERPRETER: _set(mapping, "_root", _square)}
