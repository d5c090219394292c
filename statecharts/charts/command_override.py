"""Guards of the chart `command` about an order that holds a failsafe off. The rows are in `command.py`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from events.schema import safety_pb2

if TYPE_CHECKING:
    from statecharts.charts.command import Facts

# What a person may hold off. Never the landing at the lowest charge.
SCOPES = (
    safety_pb2.OVERRIDE_BATTERY_RETURN,
    safety_pb2.OVERRIDE_LINK_RETURN,
    safety_pb2.OVERRIDE_FENCE_RETURN,
)


def no_failsafes(facts: Facts) -> bool:
    """A failsafe is to be held off on a node that commands none."""
    return facts.order.verb == "override" and not facts.state.commands_flight


def unknown_scope(facts: Facts) -> bool:
    """What is to be held off is nothing that can be: the landing at the lowest charge can't."""
    asked = facts.received
    return facts.order.verb == "override" and (asked is None or asked.override_safety.scope not in SCOPES)


def no_reason(facts: Facts) -> bool:
    """Nobody holds a failsafe off without saying why."""
    asked = facts.received
    return facts.order.verb == "override" and (asked is None or not asked.override_safety.reason.strip())


def too_long(facts: Facts) -> bool:
    """It is to be held off for no time at all, or for longer than anybody may."""
    asked, longest_ms = facts.received, facts.state.flight.limits.override_longest_ms
    return facts.order.verb == "override" and (asked is None or not 0 < asked.override_safety.held_for_ms <= longest_ms)


def held_off(facts: Facts) -> bool:
    """The order holds a failsafe off: nothing leaves for the vehicle (chart `override`)."""
    return facts.order.verb == "override"
