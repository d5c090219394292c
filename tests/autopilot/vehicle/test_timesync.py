"""The vehicle's clock against ours: the quickest answers count, others' do not; what the autopilot says that it is."""

from __future__ import annotations

import random
import struct

import pytest

from autopilot.adapters.vehicle.heard import Sender, Timesync
from autopilot.adapters.vehicle.timesync import AGAIN_NS, ENOUGH, Timing
from events.schema.link_pb2 import VehicleIdentified, VehicleTimeCompared
from tests.autopilot.vehicle.vehicles import US, Bench, S, framed, heartbeat, version

MS = 1_000_000
NOBODY = (0, 0)


def timesync(tc1_ns: int, ts1_ns: int, target: tuple[int, int] = US, sender: tuple[int, int] = (1, 1)) -> bytes:
    return framed(111, struct.pack("<qqBB", tc1_ns, ts1_ns, *target), sender)


def heard(tc1_ns: int, ts1_ns: int) -> Timesync:
    return Timesync(
        sender=Sender(system=1, component=1), tc1_ns=tc1_ns, ts1_ns=ts1_ns, target=Sender(system=1, component=191)
    )


class Clockwork:
    """A `Timing` with a vehicle whose clock is `offset_ns` ahead."""

    def __init__(self, threshold_ms: float = 20) -> None:
        self.timing = Timing(threshold_ms)
        self.offset_ns = 5 * S
        self.now_ns = 1_000 * S
        self.told: list[VehicleTimeCompared] = []

    def exchange(self, there_ns: int, back_ns: int) -> object:
        """Wait for the next question; answer it after these journeys."""
        self.now_ns = max(self.now_ns, self.timing.due_ns())
        ts1_ns = self.timing.ask(self.now_ns)
        assert ts1_ns is not None
        tc1_ns = self.now_ns + there_ns + self.offset_ns
        self.now_ns += there_ns + back_ns
        said = self.timing.hear(self.now_ns, heard(tc1_ns, ts1_ns))
        self.told += [said] if isinstance(said, VehicleTimeCompared) else []
        return said


def test_the_quickest_answers_tell_the_offset_and_how_sure_it_is() -> None:
    """Journeys of 1 to 200 ms, there and back apart; the error is bounded by half the quickest round trip."""
    clockwork, chance = Clockwork(1), random.Random(5)
    for _ in range(ENOUGH):
        clockwork.exchange(chance.randint(1, 200) * MS, chance.randint(1, 200) * MS)
    clockwork.exchange(1 * MS, 1 * MS)
    (first, *_) = clockwork.told
    assert (first.vehicle, first.samples) == (1, ENOUGH)
    assert abs(first.offset_us - 5_000_000) <= first.round_trip_us // 2
    last = clockwork.told[-1]
    assert (last.offset_us, last.round_trip_us, last.samples) == (5_000_000, 2_000, ENOUGH + 1)
    assert 0 < last.spread_us < 200_000


def test_nothing_is_said_before_there_is_enough_and_then_only_news() -> None:
    clockwork = Clockwork()
    began_ns = clockwork.now_ns
    for _ in range(ENOUGH):
        assert clockwork.told == []
        clockwork.exchange(MS, MS)
    assert len(clockwork.told) == 1
    assert clockwork.now_ns - began_ns < ENOUGH * S
    clockwork.exchange(MS, MS)
    assert clockwork.timing.due_ns() - clockwork.now_ns > 9 * S
    told_ns = began_ns + (ENOUGH - 1) * S + 2 * MS
    while clockwork.timing.due_ns() + 2 * MS < told_ns + AGAIN_NS:
        clockwork.exchange(MS, MS)
    assert len(clockwork.told) == 1
    clockwork.exchange(MS, MS)
    assert len(clockwork.told) == 2


@pytest.mark.parametrize(("drift_ms", "told"), [(19, 1), (21, 2)])
def test_a_clock_that_moves_is_news(drift_ms: int, told: int) -> None:
    clockwork = Clockwork()
    for _ in range(ENOUGH):
        clockwork.exchange(MS, MS)
    clockwork.offset_ns += drift_ms * MS
    clockwork.exchange(MS // 2, MS // 2)
    assert len(clockwork.told) == told


def test_a_vehicle_that_started_again_is_compared_afresh() -> None:
    clockwork = Clockwork()
    for _ in range(ENOUGH):
        clockwork.exchange(MS, MS)
    clockwork.offset_ns = -3 * S
    for _ in range(ENOUGH):
        clockwork.exchange(2 * MS, 2 * MS)
    assert [one.offset_us for one in clockwork.told] == [5_000_000, -3_000_000]


def test_answers_to_no_question_and_late_ones_are_named() -> None:
    clockwork = Clockwork()
    assert clockwork.exchange(2 * S, 1) == "late time"
    assert clockwork.timing.hear(clockwork.now_ns, heard(1, 2)) == "unasked time"
    asked_ns = clockwork.now_ns = clockwork.timing.due_ns()
    assert clockwork.timing.ask(asked_ns) == asked_ns
    assert clockwork.timing.ask(asked_ns) is None
    assert clockwork.timing.hear(asked_ns + 1, heard(1, asked_ns)) is None
    assert clockwork.timing.hear(asked_ns + 1, heard(1, asked_ns)) == "unasked time"


def questions(bench: Bench) -> list[tuple[int, int, tuple[int, int]]]:
    """Return tc1, ts1 and target of each TIMESYNC that was sent."""
    found = [bytes(one.get_msgbuf()) for one in bench.sent if one.get_type() == "TIMESYNC"]
    return [(*struct.unpack("<qq", frame[10:26]), (frame[26], frame[27])) for frame in found]


def test_the_vehicle_is_asked_and_its_answers_are_reported() -> None:
    bench = Bench()
    bench.hear(1, heartbeat(7))
    assert questions(bench) == []
    bench.hear(4, heartbeat(7))
    bench.turn(4)
    assert questions(bench) == [(0, 4 * S, (7, 1))]
    for second in range(4, 4 + ENOUGH):
        bench.hear(second, heartbeat(7))
        answer = timesync(second * S + 9 * S, second * S, (7, 191), (7, 1))
        bench.hear(second + 0.002, answer)
    (told,) = bench.reported(VehicleTimeCompared)
    assert told == VehicleTimeCompared(vehicle=1, offset_us=8_999_000, spread_us=0, round_trip_us=2_000, samples=ENOUGH)
    assert bench.session.rejected == {"foreign system": 2}  # the heartbeats before it was adopted


def test_a_vehicle_that_came_back_is_asked_at_once_and_compared_afresh() -> None:
    bench = Bench()
    for begin in (10, 100):
        for second in range(begin, begin + ENOUGH):
            bench.hear(second, heartbeat())
            bench.hear(second + 0.002, timesync(second * S, second * S))
        bench.turn(begin + 50)
    told = bench.reported(VehicleTimeCompared)
    assert [one.samples for one in told] == [ENOUGH, ENOUGH]  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("target", "answered"), [(US, True), (NOBODY, False), ((1, 190), False), ((2, 191), False), ((1, 0), False)]
)
@pytest.mark.parametrize("sender", [(1, 1), (1, 100)])
def test_a_question_is_answered_where_it_is_for_us(
    target: tuple[int, int], answered: bool, sender: tuple[int, int]
) -> None:
    bench = Bench()
    bench.hear(1, heartbeat())
    before = len(questions(bench))
    bench.hear(2.5, timesync(0, 77, target, sender))
    assert [one for one in questions(bench)[before:] if one[0]] == [(2_500_000_000, 77, sender)] * answered


def test_others_answers_are_not_the_vehicles() -> None:
    """Another component's, one that is for another, and another system's."""
    bench = Bench()
    bench.hear(1, heartbeat())
    bench.hear(1.1, timesync(5, S, US, (1, 100)), timesync(5, S, (1, 190)), timesync(5, S, US, (2, 1)))
    assert bench.session.rejected == {"foreign system": 1}
    bench.hear(1.2, timesync(5, S, NOBODY), timesync(5, S))
    assert bench.session.rejected == {"foreign system": 1, "unasked time": 1}


def test_the_autopilot_is_asked_what_it_is_until_it_says_so() -> None:
    bench = Bench()
    bench.hear(0, heartbeat(autopilot=12))
    bench.hear(1, heartbeat(autopilot=12))
    asked = [one.param1 for one in bench.sent if getattr(one, "command", 0) == 512]
    assert asked.count(148) == 2
    bench.hear(1.5, version(), version())
    assert bench.reported(VehicleIdentified) == [
        VehicleIdentified(
            vehicle=1, autopilot=12, vehicle_type=2, capabilities=0xF, software_version=0x04060000, board_version=9
        )
    ]
    bench.sent.clear()
    for second in range(2, 60):
        bench.hear(second, heartbeat(autopilot=12))
    assert 148 not in {one.param1 for one in bench.sent if getattr(one, "command", 0) == 512}
    bench.turn(70)
    bench.hear(71, heartbeat(autopilot=12), version())
    assert len(bench.reported(VehicleIdentified)) == 2
