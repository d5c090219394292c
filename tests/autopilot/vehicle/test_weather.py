"""The session against the simulated vehicle, in one process and in simulated time: bad links, bad answers, by seed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal

import pytest
from google.protobuf.message import Message

from autopilot.adapters.vehicle.mission_form import given
from autopilot.adapters.vehicle.modes import Family
from autopilot.adapters.vehicle.session import Transmit
from autopilot.sim.lossy import Weather
from autopilot.sim.vehicle import Vehicle
from events.schema.mission_pb2 import MissionProgressReported, MissionUploaded, MissionUploadFailed, VehicleHolds
from events.schema.vehicle_pb2 import CommandAnswered, CommandUnanswered
from tests.autopilot.vehicle.vehicles import (
    PEER,
    Bench,
    S,
    arm,
    at_angles,
    at_place,
    go_to_item,
    mode,
    plan,
    planned,
    start,
    upload,
)

Name = Literal["ardupilot", "px4"]
STEP_S = 0.02
BAD = Weather(lost=0.3, twice=0.1, overtaken=0.2, late_s=2.0)


class Air:
    """A session and a vehicle, and the air between them."""

    def __init__(self, seed: int, name: Name = "ardupilot", weather: Weather | None = None) -> None:
        self.vehicle, self.bench, self.now_s = Vehicle(seed, name), Bench(), 0.0
        self.run(5)
        self.vehicle.inward.weather = self.vehicle.outward.weather = weather or Weather()

    def run(self, seconds: float) -> None:
        """Let them talk for so long."""
        until_s = self.now_s + seconds
        session = self.bench.session
        while self.now_s < until_s:
            self.now_s += STEP_S
            self.vehicle.step(STEP_S)
            for _, datagram in self.vehicle.take():
                session.hear(round(self.now_s * S), PEER, datagram)
            session.tick(round(self.now_s * S))
            while outputs := session.take():
                for output in outputs:
                    self._put(output)

    def _put(self, output: Any) -> None:
        if not isinstance(output, Transmit):
            self.bench.reports.append(output.observation)
            return
        self.vehicle.hear(("127.0.0.1", 2), output.data)
        if output.effect_seq is not None:
            self.bench.session.sent(output.effect_seq)

    def perform(self, seq: int, effect: Message, life_s: float = 5) -> None:
        """Give the session an effect."""
        now_ns = round(self.now_s * S)
        self.bench.session.perform(now_ns, seq, effect, now_ns + round(life_s * S))

    def told(self, *kinds: type[Message]) -> list[Any]:
        """Return what was reported."""
        return list(self.bench.reported(*kinds))


def check_mission(vehicle: Vehicle) -> None:
    """The vehicle has the plan, home apart."""
    name: Name = "px4" if vehicle.transfer.rules.atomic else "ardupilot"
    items = given(plan(), Family.PX4 if name == "px4" else Family.COPTER)
    has = vehicle.flight.items
    assert [item.command for item in has] == [item.command for item in items]
    located = [(one, two) for one, two in zip(has, items, strict=True) if two.command in (16, 21, 22)][-4:]
    assert [(one.x, one.y) for one, _ in located] == [(two.x, two.y) for _, two in located]


@pytest.mark.parametrize("name", ["ardupilot", "px4"])
@pytest.mark.parametrize("seed", range(4))
def test_a_mission_through_bad_weather(name: Name, seed: int) -> None:
    """30 % loss, a tenth twice, a fifth overtaken, up to 2 s late: the mission that was given, or a name."""
    air = Air(seed, name, BAD)
    air.perform(5, upload(), life_s=120)
    air.run(121)
    (report,) = air.told(MissionUploaded, MissionUploadFailed)
    if isinstance(report, MissionUploaded):
        check_mission(air.vehicle)
    else:
        assert report.because


def answers(name: str, **unkind: Any) -> list[tuple[int, int]]:
    """Return seq and result of each answer to two pointings and an arming."""
    air = Air(1)
    for key, value in unkind.items():
        setattr(air.vehicle.unkind, key, value)
    effects = {"pointing": (at_place(), at_angles()), "flight": (mode("GUIDED"), arm())}[name]
    for seq, effect in enumerate(effects):
        air.perform(seq, effect, life_s=20)
        air.run(8)
    return [(told.effect_seq, told.mav_result) for told in air.told(CommandAnswered)]


@pytest.mark.parametrize("effects", ["pointing", "flight"])
@pytest.mark.parametrize("unkind", [{}, {"ack_twice": 1.0}, {"ack_stranger": 1.0}, {"ack_late_s": 0.5}])
def test_bad_answers_are_told_from_good_ones(effects: str, unkind: dict[str, float]) -> None:
    assert answers(effects, **unkind) == [(0, 0), (1, 0)]


def test_lost_answers_and_progress_for_ever() -> None:
    assert answers("pointing", ack_lost=1.0) == []
    assert [result for _, result in answers("flight", ack_forever=1.0)] == [5, 5]
    air = Air(1)
    air.vehicle.unkind.ack_lost = 1.0
    for seq, effect in enumerate((mode("RETURN"), at_angles(), arm())):
        air.perform(seq, effect)
    air.run(6)
    told = {one.effect_seq: (one.attempts, one.because) for one in air.told(CommandUnanswered)}
    assert told == {0: (3, "no answer"), 1: (3, "no answer"), 2: (1, "no answer")}


@pytest.mark.parametrize(
    ("unkind", "effect", "results"),
    [
        ({"only_int": True}, mode("GUIDED"), [0]),
        ({"only_long": True}, at_place(), [7]),
        ({"frames_refused": (0,)}, at_place(), [0]),
        ({"frames_refused": (0, 5)}, at_place(), [9]),
    ],
)
def test_a_vehicle_that_wants_another_form(unkind: dict[str, Any], effect: Message, results: list[int]) -> None:
    air = Air(1)
    for key, value in unkind.items():
        setattr(air.vehicle.unkind, key, value)
    air.perform(5, effect)
    air.run(6)
    assert [told.mav_result for told in air.told(CommandAnswered)] == results


@pytest.mark.parametrize(("name", "first"), [("ardupilot", 1), ("px4", 0)])
@pytest.mark.parametrize(("unknown", "result"), [((), 0), ((224,), 3)])
def test_an_item_is_gone_on_with_on_every_vehicle(
    name: Name, first: int, unknown: tuple[int, ...], result: int
) -> None:
    """By the command, and by the message that it superseded where a vehicle does not know it; the answer is told."""
    air = Air(1, name)
    air.vehicle.unkind.unknown = unknown
    air.perform(5, upload(), life_s=120)
    air.run(10)
    air.perform(6, go_to_item(3))
    air.run(4)
    assert air.vehicle.flight.runner.current == 3 + first
    assert [told.mav_result for told in air.told(CommandAnswered)] == [result]
    assert air.told(MissionProgressReported)[-1].current_item == 3


def test_a_mission_that_is_refused_in_the_air_leaves_px4_the_one_it_flies() -> None:
    """It swaps whole missions, there too; it flies on, and the failure says what it has."""
    air = Air(1, "px4")
    air.perform(5, upload(), life_s=120)
    air.run(10)
    for seq, effect in ((6, mode("GUIDED")), (7, arm()), (8, mode("MISSION")), (9, start())):
        air.perform(seq, effect)
        air.run(5)
    before = list(air.vehicle.flight.items)
    air.vehicle.transfer.rules = replace(air.vehicle.transfer.rules, judge=lambda item, seq: 4 if seq == 2 else 0)
    air.perform(10, upload([*plan()[:2], planned(16, 70), *plan()[3:]]), life_s=120)
    air.run(10)
    (failed,) = air.told(MissionUploadFailed)
    assert (failed.effect_seq, failed.item, failed.holds) == (10, 2, VehicleHolds.VEHICLE_HOLDS_OLD)
    assert air.vehicle.flight.items == before
    assert air.vehicle.flight.armed


def test_a_late_answer_of_a_real_radio_is_not_the_next_one_s() -> None:
    """The first is refused 2 s late, when it was given up; the second is accepted, and nothing else."""
    air = Air(1, weather=Weather(late_s=0, least_s=1.2))
    air.perform(5, at_place(), life_s=1)
    air.run(2)
    air.perform(6, at_place(), life_s=20)
    air.run(10)
    (unanswered,) = air.told(CommandUnanswered)
    (answered,) = air.told(CommandAnswered)
    assert (unanswered.effect_seq, answered.effect_seq) == (5, 6)
    assert air.bench.session.rejected["late answer"] > 0
