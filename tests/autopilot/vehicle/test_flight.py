"""The session with a vehicle that flies: what it tells of its flight, and what of ours reaches it."""

from __future__ import annotations

from typing import Any

import pytest
from google.protobuf.message import Message
from pymavlink.dialects.v20 import common as dialect

from autopilot.ports.config import VehicleSection
from autopilot.ports.edges import VehicleFacts
from events.schema.common_pb2 import Place
from events.schema.mission_pb2 import MissionProgressReported
from events.schema.safety_pb2 import BatteryReported, FlightMode, HomeReported
from events.schema.vehicle_pb2 import CommandAnswered, CommandSent, CommandUnanswered, VehicleStateReported
from tests.autopilot.vehicle.vehicles import (
    LATITUDE_E7,
    LONGITUDE_E7,
    Bench,
    answer,
    arm,
    at_place,
    attitude,
    fly_to,
    go_to_item,
    heartbeat,
    mode,
    packed,
    plain_place,
    position,
    start,
)

PX4_MISSION = 4 << 16 | 4 << 24


def status(charge_percent: int, voltage_mv: int = 12_000) -> bytes:
    return packed(dialect.MAVLink_sys_status_message(0, 0, 0, 0, voltage_mv, -1, charge_percent, 0, 0, 0, 0, 0, 0))


def battery(charge_percent: int, *cells_mv: int, number: int = 0) -> bytes:
    cells = [*cells_mv, *[65_535] * (10 - len(cells_mv))]
    return packed(dialect.MAVLink_battery_status_message(number, 0, 0, 0, cells, -1, -1, -1, charge_percent))


def home(latitude_e7: int = LATITUDE_E7, altitude_mm: int = 488_000) -> bytes:
    q = [1.0, 0.0, 0.0, 0.0]
    return packed(dialect.MAVLink_home_position_message(latitude_e7, LONGITUDE_E7, altitude_mm, 0, 0, 0, q, 0, 0, 0))


def current(seq: int, state: int = 0) -> bytes:
    return packed(dialect.MAVLink_mission_current_message(seq, 0, state))


def reached(seq: int) -> bytes:
    return packed(dialect.MAVLink_mission_item_reached_message(seq))


def landed(state: int) -> bytes:
    return packed(dialect.MAVLink_extended_sys_state_message(0, state))


def gps(fix_type: int, eph: int = 80, satellites: int = 12) -> bytes:
    return packed(
        dialect.MAVLink_gps_raw_int_message(1, fix_type, LATITUDE_E7, LONGITUDE_E7, 500_000, eph, 1, 1, 1, satellites)
    )


def armed(**changes: Any) -> Bench:
    """Return a bench with a copter in the air."""
    bench = Bench()
    bench.hear(0, heartbeat(armed=True, **changes), position(0), attitude(0, 90))
    return bench


def check_reported(bench: Bench, kind: type[Message], *expected: Message) -> None:
    assert bench.reported(kind) == list(expected)


def reported(bench: Bench, kind: type[Message]) -> list[Any]:
    return list(bench.reported(kind))


def sent(bench: Bench, command: int) -> list[Any]:
    return [message for message in bench.sent if getattr(message, "command", 0) == command]


def test_the_state_has_what_the_mode_means_and_whether_it_is_landed() -> None:
    bench = Bench()
    bench.hear(0, heartbeat(autopilot=12, armed=True, mode=PX4_MISSION), landed(2), landed(2), landed(0))
    plain = VehicleStateReported(
        vehicle=1,
        system_id=1,
        autopilot=12,
        vehicle_type=2,
        armed=True,
        custom_mode=PX4_MISSION,
        flight_mode=FlightMode.FLIGHT_MODE_MISSION,
    )
    in_the_air = VehicleStateReported()
    in_the_air.CopyFrom(plain)
    in_the_air.landed_state = 2
    check_reported(bench, VehicleStateReported, plain, in_the_air)


def test_the_battery_is_told_by_the_percent_and_in_full_at_the_start() -> None:
    bench = Bench()
    bench.hear(0, heartbeat(), status(80), status(80, 11_000), status(79, 11_900), battery(12, 3_000), status(-1))
    check_reported(
        bench,
        BatteryReported,
        BatteryReported(vehicle=1, charge_percent=80, voltage_mv=12_000),
        BatteryReported(vehicle=1, charge_percent=79, voltage_mv=11_900),
        BatteryReported(vehicle=1, voltage_mv=12_000),
    )
    bench.turn(9)
    bench.hear(10, heartbeat(), status(-1))
    assert len(bench.reported(BatteryReported)) == 4


def test_a_battery_that_does_not_know_its_charge_is_told_by_its_voltage() -> None:
    bench = Bench()
    bench.hear(0, heartbeat(), status(-1), status(-1, 11_881), status(-1, 11_880), status(-1, 65_535))
    assert [report.voltage_mv for report in reported(bench, BatteryReported)] == [12_000, 11_880]
    bench.hear(1, battery(55, 3_000, 3_100), battery(20, 3_000, number=1))
    assert bench.reported(BatteryReported)[2:] == [BatteryReported(vehicle=1, charge_percent=55, voltage_mv=6_100)]


def test_a_battery_that_says_nothing_is_told_once() -> None:
    bench = Bench()
    bench.hear(0, heartbeat(), status(-1, 65_535), status(-1, 65_535))
    check_reported(bench, BatteryReported, BatteryReported(vehicle=1))


def test_home_is_asked_for_until_it_is_told() -> None:
    known = [False]
    bench = Bench(place=lambda *where: plain_place(*where) if known[0] else None)
    bench.hear(0, heartbeat(), home())
    assert bench.reported(HomeReported) == []
    bench.hear(1.5, heartbeat())
    asked = [message.param1 for message in sent(bench, 512)]
    assert asked.count(242) == 2
    known[0] = True
    bench.hear(2, home(), home(LATITUDE_E7 + 100), home(LATITUDE_E7 + 300), home(altitude_mm=485_900))
    first = Place(latitude_e7=LATITUDE_E7, longitude_e7=LONGITUDE_E7, altitude_mm=488_000)
    places = [report.place for report in reported(bench, HomeReported)]
    assert places[0] == first
    assert [place.latitude_e7 - LATITUDE_E7 for place in places] == [0, 300, 0]
    bench.sent.clear()
    bench.hear(40, heartbeat())
    bench.hear(41, heartbeat())
    assert 242 not in [message.param1 for message in sent(bench, 512)][1:]


@pytest.mark.parametrize(("autopilot", "first"), [(3, 1), (12, 0)])
def test_progress_is_in_the_plan_s_numbers(autopilot: int, first: int) -> None:
    bench = Bench()
    bench.hear(0, heartbeat(autopilot=autopilot), current(first), current(first), reached(first), current(first + 2))
    bench.hear(1, reached(first + 4), reached(first + 3))
    told = [(one.current_item, one.HasField("reached_item"), one.reached_item) for one in _progress(bench)]
    assert told == [(0, False, 0), (0, True, 0), (2, True, 0), (2, True, 4)]


def _progress(bench: Bench) -> list[Any]:
    return reported(bench, MissionProgressReported)


def test_home_and_a_mission_that_was_not_begun_are_no_item() -> None:
    bench = Bench()
    bench.hear(0, heartbeat(), current(0), reached(0))
    check_reported(bench, MissionProgressReported, MissionProgressReported(vehicle=1))
    bench = Bench()
    bench.hear(0, heartbeat(autopilot=12), current(3, state=2), current(3, state=1), current(3, state=3))
    told = [one.HasField("current_item") for one in _progress(bench)]
    assert told == [False, True]


def test_what_was_reached_is_of_this_flight_of_the_mission() -> None:
    for effect, command in ((start(), 300), (go_to_item(1), 224)):
        bench = armed()
        bench.hear(0.1, reached(5), current(6))
        bench.perform(0.2, 7, effect)
        bench.hear(0.3, answer(command), current(2))
        assert not _progress(bench)[-1].HasField("reached_item")


def test_an_item_is_gone_on_with_by_a_message_where_the_command_is_not_known() -> None:
    """What was reached before is of before then, too; a vehicle that refuses the item keeps what it told."""
    for result, said, kept in ((3, 1, False), (2, 0, True)):
        bench = armed()
        bench.hear(0.1, reached(5), current(6))
        bench.perform(0.2, 7, go_to_item(1))
        bench.hear(0.3, answer(224, result), current(2))
        assert _progress(bench)[-1].HasField("reached_item") is kept
        assert [message.get_type() for message in bench.sent].count("MISSION_SET_CURRENT") == said


def test_the_facts_for_the_self_test() -> None:
    bench = Bench()
    nothing = bench.session.reports.facts(0)
    assert nothing == VehicleFacts(
        linked=False,
        commandable=False,
        armed=False,
        fix_type=None,
        satellites=None,
        hdop_e2=None,
        charge_percent=None,
        voltage_mv=None,
        home=None,
        heard_ms_ago={},
    )
    bench.hear(1, heartbeat(armed=True), status(80), home(), gps(2, 150, 5))
    facts = bench.session.reports.facts(3_000_000_000)
    assert (facts.linked, facts.commandable, facts.armed, facts.home) == (
        True,
        True,
        True,
        (LATITUDE_E7 / 1e7, LONGITUDE_E7 / 1e7, 488.0),
    )
    assert (facts.fix_type, facts.satellites, facts.hdop_e2) == (2, 5, 150)
    assert (facts.charge_percent, facts.voltage_mv) == (80, 12_000)
    assert facts.heard_ms_ago == dict.fromkeys(("heartbeat", "battery", "home", "reception"), 2_000)
    bench.hear(1, gps(3, 65_535, 255))
    facts = bench.session.reports.facts(3_000_000_000)
    assert (facts.fix_type, facts.satellites, facts.hdop_e2) == (3, None, None)
    assert facts.heard_ms_ago["fix"] == 2_000
    bench.hear(1, heartbeat(), gps(3))
    other = Bench()
    other.hear(0, heartbeat(autopilot=0))
    assert not other.session.reports.facts(0).commandable


def test_nothing_flies_while_it_is_disarmed() -> None:
    for effect in (fly_to(), start()):
        bench = Bench()
        bench.hear(0, heartbeat())
        bench.perform(0.1, 5, effect)
        check_reported(bench, CommandUnanswered, CommandUnanswered(effect_seq=5, attempts=0, because="disarmed"))
        assert bench.commands() == []
        bench.hear(0.2, heartbeat(armed=True))
        bench.perform(0.3, 6, effect)
        assert len(bench.commands()) == 1


def test_a_vehicle_that_took_the_arming_is_armed() -> None:
    """The next heartbeat is up to a second away."""
    bench = Bench()
    bench.hear(0, heartbeat())
    bench.perform(0.1, 5, arm())
    bench.perform(0.2, 6, start())
    bench.hear(0.3, answer(400))
    bench.perform(0.4, 7, start())
    assert bench.commands() == [400, 300]
    bench.hear(0.5, heartbeat())
    bench.perform(0.6, 8, fly_to())
    assert bench.commands() == [400, 300]


def test_effects_of_the_flight_end_like_pointing() -> None:
    bench = armed()
    for seq, effect, command in ((5, mode("LOITER"), 176), (6, go_to_item(2), 224), (7, fly_to(), 192)):
        bench.perform(seq / 10, seq, effect)
        bench.hear(seq / 10, answer(command, seq - 5))
    assert bench.reported(CommandSent, CommandAnswered) == [
        message
        for seq in (5, 6, 7)
        for message in (
            CommandSent(effect_seq=seq),
            CommandAnswered(effect_seq=seq, mav_result=seq - 5, attempts=1, progress=0),
        )
    ]
    assert [message.param1 for message in sent(bench, 224)] == [3]


def test_a_flight_effect_for_nobody_says_so() -> None:
    bench = Bench()
    for seq, effect in enumerate((mode("RETURN"), arm(), start(), go_to_item(1), fly_to())):
        bench.perform(0, seq, effect)
    assert {report.because for report in reported(bench, CommandUnanswered)} == {"no vehicle"}
    bench = Bench()
    bench.hear(0, heartbeat(autopilot=0))
    bench.perform(0.1, 5, mode("RETURN"))
    check_reported(bench, CommandUnanswered, CommandUnanswered(effect_seq=5, attempts=0, because="not encodable"))


def test_nothing_is_sent_again_while_the_vehicle_is_gone() -> None:
    """A lost link is the airframe's own failsafe's business; nothing raises."""
    bench = Bench(VehicleSection(connect="x:1", link_timeout_s=0.5))
    bench.hear(0, heartbeat(armed=True))
    bench.perform(0.1, 5, mode("RETURN"))
    bench.turn(0.8)
    bench.turn(1.5)
    assert [message.param2 for message in sent(bench, 176)] == [6]


def test_a_failsafe_leaves_in_the_same_turn() -> None:
    """Whatever is in flight, waits, or may still be answered."""
    bench = armed()
    bench.perform(0.1, 5, mode("LOITER", order="a/1"))
    bench.perform(0.2, 6, mode("GUIDED"))
    bench.perform(0.25, 7, mode("RETURN"))
    assert [message.param2 for message in sent(bench, 176)] == [5, 6]
    bench.hear(0.3, answer(176, 4))
    assert bench.session.rejected["late answer"] == 1
    assert bench.reported(CommandAnswered) == []


def test_a_pointing_is_measured_and_a_flight_effect_is_not() -> None:
    bench = armed()
    bench.perform(0.1, 5, at_place())
    bench.perform(0.2, 6, mode("LOITER"))
    assert bench.session.telemetry.pointing.effect_seq == 5
