"""The vehicle's end of the mission protocol, against a client that was written from the guide."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as dialect

from autopilot.sim.aircraft import HOME
from autopilot.sim.vehicle import PersonalityName
from tests.autopilot.sim.ground import ARM, HOME_E7, MODE, NAN, START, Ground, Row, ground, row

BOTH: tuple[PersonalityName, ...] = ("ardupilot", "px4")
KEPT, ERROR, FRAME, UNKNOWN, NO_SPACE = range(5)
BAD_SEQUENCE, DENIED, CANCELLED = 13, 14, 15
LARGEST = 2**31 - 1


def legs(count: int, up_m: float = 20.0) -> list[Row]:
    """Return a mission of so many items; the first is a take-off behind home."""
    return [row(16, 0, 0, 0), row(22, 0, 0, up_m), *(row(16, 10.0 * n, 5, up_m) for n in range(count - 2))]


def count(number: int, mission_type: int = 0) -> Any:
    return dialect.MAVLink_mission_count_message(1, 1, number, mission_type)


def opaque_id(message: Any, at_byte: int) -> int:
    """Return the id behind the fields that the dialect knows (`get_payload` begins within the header)."""
    return int.from_bytes(bytes(message.get_msgbuf())[10:-2][at_byte : at_byte + 4], "little")


def results(station: Ground) -> list[int]:
    return [message.type for message in station.of("MISSION_ACK")]


@pytest.mark.parametrize(
    ("sent", "kept"),
    [
        (row(16, 5, 5, 20, 6, p1=2.7, p2=3, p3=1, p4=NAN), row(16, 5, 5, 20, 3, p1=2)),
        (row(16, 5, 5, 500.123, 5), row(16, 5, 5, 500.12, 0)),
        (row(16, 5, 5, 20, 11), row(16, 5, 5, 20, 10)),
        (row(22, 5, 5, 20, 3, p1=1.5, p4=NAN), row(22, 5, 5, 20, 3, p1=1)),
        (row(21, 5, 5, 0, 6, p4=NAN), row(21, 5, 5, 0, 3, p4=1)),
        (Row(178, 3, p1=1, p2=4.5, p3=-1), Row(178, 0, p1=1, p2=4.5, p3=-1)),
        (row(195, 5, 5, 480, 2), row(195, 5, 5, 480, 0)),
        (Row(1000, 2, p1=-30.7, p2=10.2), Row(1000, 0, p1=-30, p2=10)),
        (Row(20, 6), Row(20, 0)),
    ],
)
def test_what_ardupilot_keeps_of_an_item(sent: Row, kept: Row) -> None:
    station = ground()
    assert station.upload([row(16, 1, 1, 1), sent]) == KEPT
    back = station.download()
    assert back is not None
    home = Row(16, 0, x=HOME_E7[0], y=HOME_E7[1], z=HOME[2])
    assert back[0] == home
    assert replace(back[1], z=round(back[1].z, 3)) == kept


@pytest.mark.parametrize(
    ("sent", "kept"),
    [
        (row(16, 5, 5, 20.123, 6, p1=2.7, p2=3), row(16, 5, 5, 20.123, 6, p1=2.7, p2=3)),
        (row(16, 5, 5, 20, 3), row(16, 5, 5, 20, 6)),
        (row(16, 5, 5, 500, 0), row(16, 5, 5, 500, 5)),
        (Row(178, 0, p1=1, p2=4.5), Row(178, 2, p1=1, p2=4.5)),
    ],
)
def test_what_px4_keeps_of_an_item(sent: Row, kept: Row) -> None:
    station = ground("px4")
    assert station.upload([sent]) == KEPT
    back = station.download()
    assert back is not None
    assert [replace(one, z=round(one.z, 3), p1=round(one.p1, 3)) for one in back] == [kept]


def test_px4_keeps_what_is_not_set() -> None:
    station = ground("px4")
    assert station.upload([row(16, 5, 5, 20, p4=NAN)]) == KEPT
    back = station.download()
    assert back is not None
    assert math.isnan(back[0].p4)


@pytest.mark.parametrize(
    ("item", "ardupilot", "px4"),
    [
        (row(16, 5, 5, 20), KEPT, KEPT),
        (row(31000, 5, 5, 20), UNKNOWN, UNKNOWN),
        (Row(530), UNKNOWN, KEPT),
        (Row(1001), UNKNOWN, KEPT),
        (Row(531), KEPT, KEPT),
        (Row(2000), KEPT, KEPT),
        (Row(177, p1=1, p2=3), UNKNOWN, UNKNOWN),
        (Row(16, x=950_000_000, z=20), 10, 10),
        (Row(16, x=LARGEST, z=20), 10, 10),
        (Row(16, x=1, y=1_900_000_000, z=20), 11, 11),
        (row(16, 5, 5, NAN), 12, 12),
        (row(16, 5, 5, 20, p1=NAN), 6, 5),
        (row(16, 5, 5, 20, p2=NAN), 7, KEPT),
        (row(16, 5, 5, 20, p3=NAN), 8, KEPT),
        (row(16, 5, 5, 20, p4=NAN), KEPT, KEPT),
        (row(22, 5, 5, 20, p4=NAN), KEPT, KEPT),
        (row(21, 5, 5, 20, p4=NAN), KEPT, KEPT),
        (row(19, 5, 5, 20, p1=5, p4=NAN), 9, KEPT),
        (Row(1000, p1=NAN), 6, KEPT),
        (Row(1000, p3=NAN), 8, KEPT),
        (Row(178, p2=3, p3=NAN), 8, KEPT),
        (Row(2000, p3=NAN), 8, KEPT),
        (row(16, 5, 5, 20, p2=math.inf), 7, 7),
        (row(16, 5, 5, 20, frame=1), FRAME, FRAME),
        (row(16, 5, 5, 20, frame=2), KEPT, FRAME),
        (row(195, 5, 5, 20, frame=2), KEPT, FRAME),
        (row(16, 5, 5, 20, frame=10), KEPT, FRAME),
    ],
)
def test_items_are_judged(item: Row, ardupilot: int, px4: int) -> None:
    for name, result in (("ardupilot", ardupilot), ("px4", px4)):
        station = ground(name)  # type: ignore[arg-type]
        assert station.upload([row(16, 0, 0, 0), item]) == result, name


def test_ardupilot_asks_by_request_and_px4_by_request_int() -> None:
    for name, kind, other in (
        ("ardupilot", "MISSION_REQUEST", "MISSION_REQUEST_INT"),
        ("px4", "MISSION_REQUEST_INT", "MISSION_REQUEST"),
    ):
        station = ground(name)  # type: ignore[arg-type]
        assert station.upload(legs(4)) == KEPT
        assert [message.seq for message in station.of(kind)] == [0, 1, 2, 3]
        assert station.of(other) == []


def test_a_silent_client_is_asked_each_second_and_cancelled_after_eight() -> None:
    station = ground()
    station.send(count(5))
    station.pass_time(7.9)
    assert [message.seq for message in station.of("MISSION_REQUEST")] == [0] * 8
    assert results(station) == []
    station.pass_time(0.2)
    assert results(station) == [CANCELLED]
    station.pass_time(5)
    assert len(station.of("MISSION_REQUEST")) == 8


def test_px4_asks_more_often_and_gives_up_without_a_word_of_the_protocol() -> None:
    station = ground("px4")
    station.send(count(5))
    station.pass_time(4.9)
    assert 18 <= len(station.of("MISSION_REQUEST_INT")) <= 20
    station.pass_time(5)
    assert len(station.of("MISSION_REQUEST_INT")) <= 20
    assert results(station) == []
    assert "Mission upload timeout" in station.texts()


def test_a_refused_upload_leaves_a_mixture_on_ardupilot_and_nothing_new_on_px4() -> None:
    """11 good items, then 7 of which the fifth is refused: 7 stay, 4 of them new; PX4 keeps its 11."""
    good = legs(11)
    bad = [row(16, 500.0 + n, 500, 50) for n in range(4)] + [Row(16, x=LARGEST)] + legs(2)
    for name in BOTH:
        station = ground(name)
        assert station.upload(good) == KEPT
        before = station.download()
        assert station.upload(bad) == 10
        if name == "ardupilot":
            assert station.download(within_s=3) is None  # nobody may, while it still waits for the item
            assert DENIED in results(station)
        station.pass_time(9)
        after = station.download()
        assert before is not None
        assert after is not None
        if name == "px4":
            assert after == before
        else:
            assert len(after) == 7
            assert [one.z for one in after[1:]] == pytest.approx([50, 50, 50, 20, 20, 20])


def test_a_refusal_does_not_end_it_on_ardupilot() -> None:
    """The right item may still come; on PX4 it is over."""
    for name, last in (("ardupilot", KEPT), ("px4", ERROR)):
        station = ground(name)  # type: ignore[arg-type]
        station.send(count(1 + (name == "ardupilot")))
        seq = 0
        if name == "ardupilot":
            station.send(station.item(0, row(16, 0, 0, 0)))
            seq = 1
        station.send(station.item(seq, Row(31_000)))
        station.send(station.item(seq, row(16, 0, 0, 20)))
        station.pass_time(0.1)
        assert results(station) == [UNKNOWN, last]


def test_an_item_out_of_order() -> None:
    """ArduPilot says so, PX4 asks again; neither takes it."""
    for name in BOTH:
        station = ground(name)
        station.send(count(3))
        station.send(station.item(1, row(16, 5, 5, 20)))
        station.pass_time(0.1)
        said, asked = ([BAD_SEQUENCE], 1) if name == "ardupilot" else ([], 2)
        assert results(station) == said
        requests = station.of("MISSION_REQUEST") + station.of("MISSION_REQUEST_INT")
        assert [message.seq for message in requests] == [0] * asked


def test_an_item_that_nobody_asked_for_is_an_error() -> None:
    for name in BOTH:
        station = ground(name)
        station.send(station.item(0, row(16, 5, 5, 20)))
        station.pass_time(0.1)
        assert results(station) == [ERROR]
        assert station.vehicle.flight.items == []


def test_a_second_client_has_to_wait() -> None:
    for name, result in (("ardupilot", DENIED), ("px4", ERROR)):
        station = ground(name)  # type: ignore[arg-type]
        station.send(count(3))
        other = Ground(station.vehicle, 42, 1, ("127.0.0.1", 2))
        other.send(count(9))
        other.pass_time(0.1)
        assert results(other) == [result]
        other.send(other.item(0, row(16, 5, 5, 20)))
        other.pass_time(0.1)
        assert results(other) == [result, ERROR]
        assert station.upload(legs(3)) == KEPT
        assert len(station.vehicle.flight.items) == 3


def test_a_float_item_is_taken_too() -> None:
    station = ground()
    station.send(count(2))
    for seq in range(2):
        item = dialect.MAVLink_mission_item_message(1, 1, seq, 3, 16, 0, 1, 0, 0, 0, 0, 47.4, 8.5, 20, 0)
        station.send(item)
    station.pass_time(0.1)
    assert results(station) == [KEPT]
    assert station.vehicle.flight.items[1].x == pytest.approx(474_000_000, abs=20)
    station.send(dialect.MAVLink_mission_request_message(1, 1, 1, 0))
    station.pass_time(0.1)
    assert station.of("MISSION_ITEM")[-1].x == pytest.approx(47.4, abs=1e-5)


@pytest.mark.parametrize("latitude_deg", [NAN, 1e9, -math.inf])
def test_a_float_item_off_the_earth_is_refused(latitude_deg: float) -> None:
    for name in BOTH:
        station = ground(name)
        station.send(count(2))
        station.send(station.item(0, row(16, 0, 0, 0)))
        item = dialect.MAVLink_mission_item_message(1, 1, 1, 3, 16, 0, 1, 0, 0, 0, 0, latitude_deg, 8.5, 20, 0)
        station.send(item)
        station.pass_time(0.1)
        assert results(station) == [10]


def test_other_kinds_of_missions_and_too_many_items() -> None:
    for name, most in (("ardupilot", 724), ("px4", 2000)):
        station = ground(name)  # type: ignore[arg-type]
        for message, result in ((count(3, 1), UNKNOWN), (count(most + 1), NO_SPACE)):
            station.send(message)
            station.pass_time(0.1)
            assert results(station)[-1] == result


def test_clearing() -> None:
    clear = dialect.MAVLink_mission_clear_all_message(1, 1, 0)
    for name in BOTH:
        station = ground(name)
        for message in (clear, count(0)):
            assert station.upload(legs(4)) == KEPT
            station.send(message)
            station.pass_time(0.1)
            assert results(station)[-1] == KEPT
            assert station.download() == []


def test_in_auto_ardupilot_does_not_clear() -> None:
    station = flying(legs(4))
    station.send(dialect.MAVLink_mission_clear_all_message(1, 1, 0))
    station.pass_time(0.1)
    assert results(station)[-1] == ERROR
    assert len(station.vehicle.flight.items) == 4


def flying(rows: list[Row]) -> Ground:
    """Return a station whose copter is in the air with a mission."""
    station = ground()
    assert station.upload(rows) == KEPT
    assert station.long(MODE, 1, 4) + station.long(ARM, 1) + station.long(START) == [0, 0, 0]
    station.until(lambda: station.vehicle.flight.runner.current > 1)
    return station


def test_an_upload_in_auto_begins_the_current_item_anew() -> None:
    rows = [row(16, 0, 0, 0), row(22, 0, 0, 20), row(16, 400, 0, 20), Row(20)]
    station = flying(rows)
    station.pass_time(10)
    assert station.upload([*rows[:2], row(16, 0, 400, 20), Row(20)]) == KEPT
    assert station.texts()[-2:] == ["Flight plan received", "Mission: 2 WP"]
    station.pass_time(20)
    assert station.vehicle.flight.body.north_m > 50


def test_while_an_upload_is_under_way_the_old_item_is_flown() -> None:
    rows = [row(16, 0, 0, 0), row(22, 0, 0, 20), row(16, 400, 0, 20), Row(20)]
    station = flying(rows)
    station.send(count(4))
    for seq, one in enumerate([*rows[:2], row(16, -400, 0, 20)]):
        station.send(station.item(seq, one))
    station.pass_time(5)
    assert station.vehicle.flight.body.east_m_s > 5


def test_ids_tell_missions_apart_on_px4_only() -> None:
    station = ground("px4")
    ids = []
    for rows in (legs(4), legs(5), legs(4)):
        assert station.upload(rows) == KEPT
        ids.append(opaque_id(station.of("MISSION_ACK")[-1], 4))
        assert station.download() is not None
        assert opaque_id(station.of("MISSION_COUNT")[-1], 5) == ids[-1]
        station.pass_time(1.1)
        assert opaque_id(station.of("MISSION_CURRENT")[-1], 6) == ids[-1]
    assert ids[0] == ids[2] != ids[1]
    assert 0 not in ids
    copter = ground()
    assert copter.upload(legs(4)) == KEPT
    assert opaque_id(copter.of("MISSION_ACK")[-1], 4) == 0


def test_the_current_item_that_px4_is_told() -> None:
    station = ground("px4")
    station.send(count(3))
    for seq in range(3):
        station.send(station.item(seq, row(16, 5.0 * seq, 5, 20), current=int(seq == 2)))
    assert station.vehicle.flight.runner.current == 2


def test_the_end_of_an_upload_may_not_be_told() -> None:
    """The mission is on board all the same."""
    for name in BOTH:
        station = ground(name)
        station.vehicle.unkind.mission_ack_lost = 1
        assert station.upload(legs(4), within_s=3) is None
        assert len(station.vehicle.flight.items) == 4


def test_asking_for_what_is_not_there() -> None:
    for name, result in (("ardupilot", BAD_SEQUENCE), ("px4", ERROR)):
        station = ground(name)  # type: ignore[arg-type]
        assert station.upload(legs(3)) == KEPT
        station.send(dialect.MAVLink_mission_request_int_message(1, 1, 3, 0))
        station.pass_time(0.1)
        assert results(station)[-1] == result


def test_an_acknowledgement_in_the_middle_ends_it_on_px4_only() -> None:
    """ArduPilot knows no cancelling."""
    for name, last in (("ardupilot", KEPT), ("px4", ERROR)):
        station = ground(name)  # type: ignore[arg-type]
        station.send(count(1))
        station.send(dialect.MAVLink_mission_ack_message(1, 1, CANCELLED, 0))
        station.send(station.item(0, row(16, 5, 5, 20)))
        station.pass_time(0.1)
        assert results(station) == [last]
