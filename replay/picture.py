"""A state in words and as plain values: what is in which table, and what was open. It judges nothing."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from replay.seek import Seen
from statecharts import State
from statecharts.charts.command import FINAL
from statecharts.codec import COLUMNS, LAYOUT, table_of
from statecharts.journal import Keyed


def counts(state: State) -> dict[str, int]:
    """Return how many rows each table has."""
    tables = {column.name: table_of(state, column.name) for column in COLUMNS}
    return {name: len(table) for name, table in tables.items() if isinstance(table, Keyed)}


def open_things(state: State) -> dict[str, list[dict[str, Any]]]:
    """Return what waited for something: orders, effects, answers, questions, masters of cameras, deadlines."""
    orders = [(key, order) for key, order in state.orders.items() if order.state not in FINAL]
    held = [(key, camera) for key, camera in state.cameras.items() if camera.state != "automatic"]
    pois = [state.pois[poi_id] for poi_id, _ in state.open_pois.items()]
    return {
        "orders": [{"order": key, "state": order.state, "verb": order.verb} for key, order in orders],
        "effects": [
            {"seq": seq, "gimbal": effect.gimbal, "order": effect.order}
            for seq, effect in state.effects.items()
            if not effect.done
        ],
        "owed_answers": [{"seq": seq, "order": key} for seq, key in state.owed_acks.items()],
        "questions": [{"poi": poi.poi_id, "state": poi.state, "class": poi.class_name} for poi in pois],
        "cameras": [{"camera": key, "state": camera.state, "callsign": camera.callsign} for key, camera in held],
        "deadlines": [
            {"chart": key[0], "instance": key[1], "flight_ns": at_ns} for key, at_ns in state.deadlines.items()
        ],
    }


def plain(seen: Seen) -> dict[str, Any]:
    """Return a state as a JSON-able structure."""
    state = seen.state
    return {
        "seq": seen.seq,
        "flight_ns": seen.record.at.flight_ns,
        "kind": seen.record.kind.name,
        "digest": seen.digest.hex(),
        "layout": LAYOUT.hex(),
        "read_from": seen.start,
        "refused": list(seen.refused),
        "health": state.health.value,
        "vehicles": {str(number): vehicle._asdict() for number, vehicle in state.vehicles.items()},
        "tables": counts(state),
        "open": open_things(state),
    }


def lines(seen: Seen) -> Iterator[str]:
    """Yield a state as lines."""
    state = seen.state
    yield f"after record {seen.seq} ({seen.record.kind.name}), digest {seen.digest.hex()}, layout {LAYOUT.hex()}"
    yield f"health: {state.health.value}"
    for number, vehicle in state.vehicles.items():
        link, armed = "heard" if vehicle.link else "silent", "armed" if vehicle.armed else "disarmed"
        yield f"vehicle {number}: {link}, {armed}, mode {vehicle.custom_mode}"
    yield "rows: " + ", ".join(f"{name} {count}" for name, count in counts(state).items() if count)
    for what, found in open_things(state).items():
        for one in found:
            yield f"{what.replace('_', ' ')}: " + ", ".join(f"{name} {value}" for name, value in one.items())
