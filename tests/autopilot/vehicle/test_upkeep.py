"""Who the vehicle is, the heartbeat, and streams that are asked for until they come."""

from __future__ import annotations

from autopilot.adapters.vehicle.egress import STREAMS_US
from autopilot.adapters.vehicle.heard import Heartbeat, Sender
from autopilot.adapters.vehicle.presence import Presence, Vehicle
from autopilot.adapters.vehicle.upkeep import Heart, Stream, Streams
from autopilot.ports.config import VehicleSection

S = 1_000_000_000
HERE, THERE = ("127.0.0.1", 1), ("127.0.0.1", 2)


def beat(system: int) -> Heartbeat:
    sender = Sender(system=system, component=1)
    return Heartbeat(sender=sender, autopilot=3, vehicle_type=2, armed=False, custom_mode=0)


def check_adopted(heard: list[tuple[float, int]], at_s: float, expected: int | None) -> None:
    presence = Presence(VehicleSection(system_id=1, link_timeout_s=5))
    for moment_s, system in heard:
        presence.tick(round(moment_s * S))
        presence.hear(round(moment_s * S), beat(system), HERE)
    presence.tick(round(at_s * S))
    adopted = None if presence.vehicle is None else presence.vehicle.sender.system
    assert adopted == expected
    assert presence.system == (expected or 1)


def test_the_configured_one_is_taken_at_once() -> None:
    check_adopted([(0, 1)], 0, 1)
    check_adopted([(0, 7), (0.5, 1)], 0.5, 1)


def test_the_only_other_one_is_taken_after_three_seconds() -> None:
    check_adopted([(0, 7), (1, 7), (2, 7)], 2.99, None)
    check_adopted([(0, 7), (1, 7), (2, 7)], 3, 7)


def test_of_several_others_none_is_taken() -> None:
    check_adopted([(0, 7), (1, 8), (2, 7)], 3, None)
    check_adopted([(0, 7), (1, 8), (4, 7), (5, 8), (6, 1)], 6, 1)


def test_silence_ends_it_and_it_comes_back() -> None:
    check_adopted([(0, 1), (4, 1)], 8.99, 1)
    check_adopted([(0, 1), (4, 1)], 9, None)
    check_adopted([(0, 1), (20, 1)], 20, 1)


def test_a_heartbeat_from_elsewhere_keeps_nobody_alive() -> None:
    presence = Presence(VehicleSection(link_timeout_s=5))
    presence.hear(0, beat(1), HERE)
    presence.hear(4 * S, beat(1), THERE)
    assert presence.vehicle == Vehicle(Sender(system=1, component=1), HERE)
    assert presence.due_ns() == 5 * S
    presence.tick(5 * S)
    assert presence.vehicle is None


def test_many_autopilots_take_no_more_than_their_place() -> None:
    presence = Presence(VehicleSection(system_id=200))
    for system in range(1, 100):
        presence.hear(0, beat(system), HERE)
    assert len(presence._candidates) == 8


def check_asks(stream: Stream, until_s: int, expected_s: list[float]) -> None:
    """Ask ten times a second."""
    asked = [tenth / 10 for tenth in range(until_s * 10) if stream.tick(tenth * S // 10)]
    assert asked == expected_s


def test_a_stream_is_asked_for_ever_more_rarely() -> None:
    check_asks(Stream(), 100, [0, 1, 3, 7, 15, 31, 61, 91])


def test_a_stream_that_stops_is_asked_for_again() -> None:
    stream = Stream()
    for second in range(10):
        stream.heard(second * S)
    check_asks(stream, 20, [11, 12, 14, 18])


def test_what_came_once_for_good_is_not_asked_for_again() -> None:
    stream = Stream(once=True)
    check_asks(stream, 2, [0, 1])
    stream.heard(2 * S)
    check_asks(stream, 99, [])
    assert stream.due_ns() is None


def test_all_streams_are_asked_for() -> None:
    streams = Streams()
    assert streams.tick(0) == list(STREAMS_US) == [33, 30, 285, 24, 281, 2, 1, 42, 245]
    streams.heard(0, 33)
    assert streams.tick(S) == [30, 285, 24, 281, 2, 1, 42, 245]
    streams.reset(S)
    assert 33 in streams.tick(S)


def test_a_slow_stream_has_stopped_after_twice_its_period() -> None:
    stream = Stream(period_us=5_000_000)
    stream.heard(0)
    check_asks(stream, 15, [10, 11, 13])


def test_one_beat_a_second() -> None:
    heart = Heart()
    assert [tenth for tenth in range(35) if heart.tick(tenth * S // 10)] == [0, 10, 20, 30]
