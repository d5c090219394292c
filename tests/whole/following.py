"""Operators who go away while a camera follows what they confirmed: a check of a mission that is being flown.

It is given a `Mission` in the air that flies its mission, with its operator attending, and leaves it so.
`tests.torture.flights` flies it too, at the real limits.
"""

from __future__ import annotations

from autopilot.cli.demonstration.cast import NODE
from autopilot.ground import compose
from events import Record
from events.schema.common_pb2 import Moved
from events.schema.safety_pb2 import FLIGHT_MODE_RETURN, SetVehicleMode
from tests.whole import misfortunes
from tests.whole.flights import WITHIN_S, Mission

NS_PER_S = 1_000_000_000
UNHEARD = "no operator is heard any more"


def follow(flight: Mission) -> None:
    """Let the camera follow the first finding that the mission leads over, confirmed by its operator."""
    status = flight.status(lambda one: len(one.pois) > 0, "a finding", 3 * WITHIN_S)
    poi_id, since = status.pois[0].poi_id, flight.next_seq()
    assert flight.order(compose.judge(poi_id, confirmed=True), by=flight.operator).result == "accepted"
    assert flight.order(compose.follow(poi_id), by=flight.operator).result == "accepted"
    flight.wait_record(lambda one: _moved(one, "scan", "following"), "the camera to follow it", since)


def check_silence_while_following(flight: Mission, lost_s: float, grace_s: float) -> None:
    """Nobody is heard until the vehicle returns: that is told after `lost_s`, and done `grace_s` later, not before."""
    follow(flight)
    since = flight.next_seq()
    flight.wait_record(_is_a_word, "a word of an operator", since)
    flight.supervisor.leave(NODE)
    within_s = lost_s + grace_s + WITHIN_S
    lost = flight.wait_record(lambda one: _moved(one, "link", "lost"), "the link to be lost", since, within_s)
    told = [one for one in flight.records() if since <= one.seq <= lost.seq]
    word = [one for one in told if _is_a_word(one)][-1]
    following = next(one for one in told if _moved(one, "link", "lost_following"))
    assert [_state(one) for one in told if _state(one)] == ["degraded", "lost_following", "lost"]
    assert following.at.flight_ns - word.at.flight_ns >= lost_s * NS_PER_S
    assert lost.at.flight_ns - word.at.flight_ns >= (lost_s + grace_s) * NS_PER_S
    assert [one for one in told if isinstance(one.message, SetVehicleMode)] == []
    command = misfortunes._failsafe(flight, since, FLIGHT_MODE_RETURN, UNHEARD)
    assert command.cause == lost.cause
    flight.truth(lambda one: one["doing"] == misfortunes.RETURNS, "the return")
    flight.supervisor.attend(NODE)
    flight.wait_record(lambda one: _moved(one, "link", "ok"), "an operator to be heard", lost.seq)
    misfortunes._back_to_the_mission(flight, since)


def _is_a_word(record: Record) -> bool:
    return record.kind.name in ("operator_heard", "order_received")


def _state(record: Record) -> str:
    """Return where the operators' link moved to; "" for another record."""
    message = record.message
    return message.to_state if isinstance(message, Moved) and message.chart == "link" else ""


def _moved(record: Record, chart: str, to: str) -> bool:
    message = record.message
    return isinstance(message, Moved) and (message.chart, message.to_state) == (chart, to)
