"""Guards of the chart `command` about gimbals and zoom: what can't be done, and what would turn the vehicle."""

from __future__ import annotations

from typing import TYPE_CHECKING

from statecharts.charts import gimbals

if TYPE_CHECKING:
    from statecharts.charts.command import Facts
    from statecharts.facts import Order


def looks_at_place(order: Order) -> bool:
    """Whether an order has the camera look at a place: at one that it names, or where what is followed was seen."""
    return order.at_place or order.verb == "follow"


def gimbal_unknown(facts: Facts) -> bool:
    """A place is asked before it is known whether the vehicle itself would turn to it, which this flight refuses."""
    asked = looks_at_place(facts.order) and gimbals.is_refused(facts.state)
    return asked and facts.order.gimbal not in facts.state.gimbals


def turns_vehicle(facts: Facts) -> bool:
    """The vehicle itself would turn to the place that is asked, which this flight refuses."""
    asked = looks_at_place(facts.order) and gimbals.is_refused(facts.state)
    return asked and gimbals.may_turn_vehicle(facts.state, facts.order.gimbal)


def beyond_limits(facts: Facts) -> bool:
    """The angles that are asked lie beyond what the gimbal can do."""
    return bool(limit_words(facts))


def limit_words(facts: Facts) -> str:
    """Return in words which limit of the gimbal an order goes beyond; "" where it goes beyond none."""
    if facts.received is None or facts.received.WhichOneof("order") != "point_at_angles":
        return ""
    return gimbals.beyond(facts.state.gimbals.get(facts.order.gimbal), facts.received.point_at_angles)


def no_zoom(facts: Facts) -> bool:
    """A zoom is asked of a camera that has not said that it can."""
    lens = facts.state.lenses.get(facts.order.camera)
    return facts.order.verb == "zoom" and (lens is None or not lens.zooms)
