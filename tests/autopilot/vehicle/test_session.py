"""The link without its socket: what is sent, what is reported, what is refused."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as dialect

from autopilot.ports.config import VehicleSection
from events.schema.safety_pb2 import FlightMode
from events.schema.vehicle_pb2 import (
    CommandAnswered,
    CommandSent,
    CommandUnanswered,
    GimbalReported,
    PositionReported,
    VehicleLinkChanged,
    VehicleStateReported,
)
from tests.autopilot.vehicle.vehicles import (
    LATITUDE_E7,
    PEER,
    Bench,
    S,
    answer,
    at_angles,
    at_place,
    attitude,
    gimbal,
    heartbeat,
    packed,
    position,
    release,
    system_time,
)

STRANGER = ("127.0.0.1", 9)


def flying(bench: Bench | None = None) -> Bench:
    """Return a bench with a vehicle that has told where it is and where it looks."""
    bench = bench or Bench()
    bench.hear(0, heartbeat(), position(0), attitude(0, 90), gimbal(0, -35, 0))
    return bench


def gimbals(bench: Bench) -> list[tuple[int, int, int, int]]:
    return [
        (one.pitch_cdeg, one.yaw_cdeg, one.effect_seq, one.error_cdeg)
        for one in bench.reports
        if isinstance(one, GimbalReported)
    ]


def check_unanswered(bench: Bench, because: str) -> None:
    (report,) = bench.reported(CommandUnanswered)
    assert report == CommandUnanswered(effect_seq=5, attempts=0, because=because)
    assert bench.commands() == []


def check_rejected(bench: Bench, because: str, *datagrams: bytes, peer: tuple[str, int] = PEER) -> None:
    """The datagrams are counted under that name and change nothing else."""
    reports = len(bench.reports)
    bench.hear(0.1, *datagrams, peer=peer)
    assert dict(bench.session.rejected) == {because: len(datagrams)}
    assert len(bench.reports) == reports


def test_the_node_speaks_first_and_adopts() -> None:
    bench = Bench()
    bench.turn(0)
    (first,) = bench.sent
    assert (first.get_type(), first.get_srcSystem(), first.get_srcComponent()) == ("HEARTBEAT", 1, 191)
    bench.hear(0.5, heartbeat(7))
    bench.turn(1)
    assert bench.sent[-1].get_srcSystem() == 1
    bench.turn(3.5)
    assert {message.get_srcSystem() for message in bench.sent[-2:]} == {7}


def test_no_heartbeat_while_unhealthy() -> None:
    well = [False]
    bench = Bench(healthy=lambda: well[0])
    for second in range(3):
        bench.turn(second)
    assert bench.sent == []
    well[0] = True
    bench.turn(3)
    assert [message.get_type() for message in bench.sent] == ["HEARTBEAT"]


def test_state_and_link_are_told_when_they_change() -> None:
    bench = Bench(VehicleSection(connect="x:1", link_timeout_s=5))
    bench.hear(0, heartbeat(), heartbeat())
    bench.hear(1, heartbeat(armed=True, mode=3), heartbeat(armed=True, mode=3))
    bench.turn(6)
    bench.hear(7, heartbeat(armed=True, mode=3))
    told = bench.reported(VehicleStateReported, VehicleLinkChanged)
    state: dict[str, Any] = {"vehicle": 1, "system_id": 1, "autopilot": 3, "vehicle_type": 2}
    assert told == [
        VehicleLinkChanged(vehicle=1, up=True),
        VehicleStateReported(**state, armed=False, custom_mode=0),
        VehicleStateReported(**state, armed=True, custom_mode=3, flight_mode=FlightMode.FLIGHT_MODE_MISSION),
        VehicleLinkChanged(vehicle=1, up=False),
        VehicleLinkChanged(vehicle=1, up=True),
        VehicleStateReported(**state, armed=True, custom_mode=3, flight_mode=FlightMode.FLIGHT_MODE_MISSION),
    ]


def test_streams_are_asked_for_and_asked_for_again() -> None:
    bench = flying()
    asked = [(m.command, m.param1, m.param2) for m in bench.sent if m.get_type() == "COMMAND_LONG"]
    assert (511, 24, 1_000_000) in asked
    assert (512, 280, 0) in asked
    for tenth in range(10, 30):
        bench.hear(tenth / 10, heartbeat(), position(100 * tenth), attitude(100 * tenth, 90))
    bench.sent.clear()
    bench.hear(5.5, heartbeat())
    assert {m.param1 for m in bench.sent if m.get_type() == "COMMAND_LONG"} >= {33, 30, 285}


def test_a_vehicle_that_tells_the_time_is_not_asked_for_it() -> None:
    bench = flying()
    bench.hear(0.5, system_time(1_790_000_000_000))
    bench.sent.clear()
    for second in range(1, 11):
        bench.hear(second, heartbeat())
    assert 2 not in {m.param1 for m in bench.sent if m.get_type() == "COMMAND_LONG"}
    bench.hear(11, heartbeat())
    assert 2 in {m.param1 for m in bench.sent if m.get_type() == "COMMAND_LONG"}


def test_positions_are_thinned_and_wait_for_the_origin() -> None:
    known = [False]
    bench = Bench(place=lambda *_: at_place().place if known[0] else None)
    bench.hear(0, heartbeat(), position(0))
    assert bench.reported(PositionReported) == []
    known[0] = True
    for tenth in range(1, 21):
        bench.hear(tenth / 10, position(tenth * 100, lat=LATITUDE_E7 + tenth * 100, vx=-1, vy=2, vz=3))
    assert len(bench.reported(PositionReported)) == 4
    (first, *_) = bench.reported(PositionReported)
    assert first == PositionReported(
        vehicle=1,
        place=at_place().place,
        height_mm=30_000,
        heading_cdeg=9_000,
        north_mm_s=-10,
        east_mm_s=20,
        up_mm_s=-30,
    )


@pytest.mark.parametrize(("armed", "told"), [(False, 1), (True, 5)], ids=["disarmed", "armed"])
def test_while_armed_each_place_is_told_at_its_period(armed: bool, told: int) -> None:
    """A vehicle that creeps over a fence moves by less than the threshold."""
    bench = Bench()
    for tenth in range(21):
        bench.hear(tenth / 10, heartbeat(armed=armed), position(tenth * 100, lat=LATITUDE_E7 + tenth))
    assert len(bench.reported(PositionReported)) == told


def test_an_unknown_heading_is_left_out() -> None:
    bench = Bench()
    bench.hear(0, heartbeat(), position(0, hdg=65535))
    (report,) = bench.reported(PositionReported)
    assert not report.HasField("heading_cdeg")


def test_the_first_fix_is_told_once() -> None:
    bench = Bench()
    fix = dialect.MAVLink_gps_raw_int_message(1, 3, 470_000_000, 80_000_000, 400_000, 1, 1, 1, 1, 9)
    bench.hear(0, heartbeat(), position(0, lat=0, lon=0))
    assert bench.fixes == []
    bench.hear(0, packed(fix), position(0), packed(fix))
    assert bench.fixes == [(47.0, 8.0, 400.0)]
    assert flying().fixes == [(47.3977, 8.5456, 518.0)]


def test_a_place_is_commanded_answered_and_measured() -> None:
    bench = flying()
    bench.perform(0.1, 5, at_place(473_977_000, 85_456_000 + 4_000))  # 30 m east, 30 m below: 45 degrees down
    bench.hear(0.2, answer(195))
    assert bench.reported(CommandSent, CommandAnswered) == [
        CommandSent(effect_seq=5),
        CommandAnswered(effect_seq=5, mav_result=0, progress=0, attempts=1),
    ]
    for tenth, pitch in ((3, -38), (4, -41), (5, -44.6), (6, -44.9), (7, -44.9)):
        bench.hear(tenth / 10, position(tenth * 100), attitude(tenth * 100, 90), gimbal(tenth * 100, pitch, 0))
    told = gimbals(bench)
    assert told[0] == (-3500, 9000, 0, 0)
    assert [one[:3] for one in told[1:]] == [(-3800, 9000, 5), (-4100, 9000, 5), (-4460, 9000, 5)]
    assert [one[3] for one in told[1:]] == pytest.approx([685, 385, 25], abs=20)


def test_a_pointing_that_was_there_already_is_seen_to_have_arrived() -> None:
    bench = flying()
    bench.perform(0.1, 5, at_angles(-3_500, 9_000))
    bench.hear(0.2, gimbal(200, -35, 0))
    bench.hear(0.3, answer(1000), gimbal(300, -35, 0))
    bench.hear(0.4, gimbal(400, -35, 0))
    assert gimbals(bench)[1:] == [(-3500, 9000, 5, 0), (-3500, 9000, 5, 0)]
    assert [type(report) for report in bench.reports[-2:]] == [CommandAnswered, GimbalReported]


@pytest.mark.parametrize(("yaw_locked", "error_cdeg"), [(True, 4_836), (False, 4_052)])
def test_angles_are_measured_in_their_own_frame(yaw_locked: bool, error_cdeg: int) -> None:
    bench = flying()
    bench.perform(0.1, 5, at_angles(-3_500, 15_000 if yaw_locked else 5_000, yaw_locked=yaw_locked))
    bench.hear(0.2, answer(1000), gimbal(200, -35, 0))
    assert gimbals(bench)[-1][3] == pytest.approx(error_cdeg, abs=5)


def test_the_error_shrinks_over_the_threshold_only_in_news() -> None:
    bench = flying()
    for number in range(1, 10):
        bench.hear(number / 10, attitude(number * 100, 90), gimbal(number * 100, -35 - number * 0.2, 0))
    assert [one[0] for one in gimbals(bench)] == [-3500, -3560, -3620, -3680]


def test_a_small_move_over_the_tolerance_is_news() -> None:
    bench = flying()
    bench.perform(0.1, 5, at_angles(-3_610, 9_000))
    bench.hear(0.2, answer(1000), gimbal(200, -35, 0))
    bench.hear(0.3, gimbal(300, -35.05, 0))
    bench.hear(0.4, gimbal(400, -35.2, 0))
    assert gimbals(bench)[1:] == [(-3500, 9000, 5, 110), (-3520, 9000, 5, 90)]


def test_a_release_and_a_refusal_ask_for_nothing() -> None:
    bench = flying()
    bench.perform(0.1, 5, at_angles())
    bench.hear(0.2, answer(1000, 4), gimbal(200, -50, 0))
    assert gimbals(bench)[-1][2:] == (0, 0)
    bench.perform(0.3, 6, at_angles())
    bench.hear(0.4, answer(1000), gimbal(400, -40, 0))
    assert gimbals(bench)[-1][2] == 6
    bench.perform(0.5, 7, release())
    bench.hear(0.6, answer(197), attitude(600, 90), gimbal(600, -40, 0))
    assert gimbals(bench)[-1][2:] == (0, 0)
    assert bench.commands() == [1000, 1000, 197]


def test_what_never_leaves_says_why() -> None:
    bench = Bench()
    bench.perform(0, 5, at_place())
    check_unanswered(bench, "no vehicle")
    bench = flying()
    bench.perform(0, 5, at_place(0, 0, altitude_mm=0))
    check_unanswered(bench, "not encodable")
    bench = flying()
    bench.perform(0, 5, CommandSent(effect_seq=1))
    check_unanswered(bench, "not encodable")
    bench = flying()
    bench.session.perform(6 * S, 5, at_place(), 6 * S)
    bench.turn(6)
    check_unanswered(bench, "expired before sending")


def test_confirmation_counts_in_command_long_only() -> None:
    bench = flying()
    bench.perform(0.1, 5, at_angles())
    bench.turn(0.8)
    bench.turn(1.5)
    assert [m.confirmation for m in bench.sent if getattr(m, "command", 0) == 1000] == [0, 1, 2]
    bench.turn(2.2)
    assert bench.reported(CommandUnanswered) == [CommandUnanswered(effect_seq=5, attempts=3, because="no answer")]


def test_strangers_are_counted_and_ignored() -> None:
    check_rejected(flying(), "foreign peer", answer(195), heartbeat(armed=True), peer=STRANGER)
    check_rejected(flying(), "foreign system", heartbeat(9, armed=True), packed(decode_attitude(), 9))
    check_rejected(flying(), "foreign component", packed(decode_attitude(), 1, 44))
    check_rejected(flying(), "unmatched answer", answer(195), answer(999))
    check_rejected(flying(), "answer to another", answer(195, target=(255, 190)))


def decode_attitude() -> object:
    return dialect.MAVLink_attitude_message(1, 0, 0, 0, 0, 0, 0)


@pytest.mark.parametrize(
    ("datagram", "peer"),
    [
        (answer(195, target=(1, 190)), PEER),
        (answer(195, target=(2, 191)), PEER),
        (answer(1000), PEER),
        (answer(195), STRANGER),
        (packed(dialect.MAVLink_command_ack_message(195, 0, 0, 0, 1, 191), 2, 1), PEER),
        (packed(dialect.MAVLink_command_ack_message(195, 0, 0, 0, 1, 191), 1, 154), PEER),
    ],
)
def test_an_answer_that_does_not_match_answers_nothing(datagram: bytes, peer: tuple[str, int]) -> None:
    bench = flying()
    bench.perform(0.1, 5, at_place())
    bench.hear(0.2, datagram, peer=peer)
    assert bench.reported(CommandAnswered) == []
    bench.hear(0.3, answer(195, target=(0, 0)))
    assert len(bench.reported(CommandAnswered)) == 1


def test_answers_to_upkeep_are_nobody_s() -> None:
    bench = flying()
    bench.hear(0.1, answer(511), answer(512, 4))
    assert dict(bench.session.rejected) == {}
    assert bench.reported(CommandAnswered) == []


def test_a_gimbal_of_its_own_may_report() -> None:
    bench = Bench()
    bench.hear(0, heartbeat(), attitude(0, 90), gimbal(0, -20, 10, component=154))
    assert gimbals(bench) == [(-2000, 10_000, 0, 0)]


def test_in_listen_mode_the_first_autopilot_is_the_peer() -> None:
    bench = Bench(VehicleSection(listen="127.0.0.1:0"), peer=None)
    bench.turn(0)
    assert bench.sent == []
    bench.hear(1, b"noise", peer=STRANGER)
    bench.hear(1, heartbeat())
    assert bench.session.peer == PEER
    bench.turn(2)
    assert "HEARTBEAT" in {message.get_type() for message in bench.sent}
    bench.hear(2, heartbeat(), peer=STRANGER)
    assert dict(bench.session.rejected) == {"garbage": 1, "foreign peer": 1}


@given(
    st.lists(st.one_of(st.binary(max_size=80), st.sampled_from([heartbeat(), position(5), answer(195)])), max_size=30)
)
@settings(max_examples=100, deadline=None, derandomize=True)
def test_no_stream_of_datagrams_upsets_it(datagrams: list[bytes]) -> None:
    bench = flying()
    bench.perform(0, 5, at_place())
    for number, datagram in enumerate(datagrams):
        bench.hear(number / 10, datagram)
    bench.hear(9, heartbeat())
    assert len(bench.reported(CommandAnswered, CommandUnanswered)) == 1


def test_a_number_of_the_link_is_a_message_that_left() -> None:
    """A gap would be a lost message to whoever counts; what is refused or only judged takes no number."""
    bench = flying()
    bench.perform(0, 5, at_place(0, 0))
    bench.perform(0, 6, at_place())
    bench.hear(0.1, answer(195))
    bench.perform(0.2, 7, at_angles())
    numbers = [message.get_seq() for message in bench.sent]
    assert bench.commands() == [195, 1000]
    assert numbers == list(range(len(numbers)))


def test_nothing_is_commanded_into_a_vehicle_that_is_lost() -> None:
    """Neither what waits nor what was to be sent again: its own failsafe is at work."""
    bench = Bench(VehicleSection(connect="x:1", link_timeout_s=1, answer_timeout_s=0.7, attempts=3))
    bench.hear(0, heartbeat())
    bench.perform(0.9, 5, at_angles())
    assert bench.commands() == [1000]
    for tenth in range(10, 50):
        bench.turn(tenth / 10)
    bench.perform(5, 6, at_place())
    bench.turn(9)
    assert bench.commands() == [1000]
    assert bench.reported(VehicleLinkChanged)[-1] == VehicleLinkChanged(vehicle=1, up=False)
    assert bench.reported(CommandUnanswered) == [
        CommandUnanswered(effect_seq=5, attempts=1, because="no answer"),
        CommandUnanswered(effect_seq=6, attempts=0, because="no vehicle"),
    ]
    assert {one.get_type() for one in bench.sent[-5:]} == {"HEARTBEAT"}
