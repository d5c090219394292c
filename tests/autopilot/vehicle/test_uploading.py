"""A mission through a session, over bytes: to vehicles that take it, refuse it, or are none."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import common as dialect

from autopilot.adapters.vehicle.heard import Item, ItemCount, ItemGiven, ItemRequest, MissionAnswer
from autopilot.adapters.vehicle.mission_form import given
from autopilot.adapters.vehicle.modes import Family
from autopilot.adapters.vehicle.transfer import Say, Word
from autopilot.ports.config import VehicleSection
from events.schema.mission_pb2 import MissionProgressReported, MissionUploaded, MissionUploadFailed, VehicleHolds
from tests.autopilot.vehicle.peers import VEHICLE, Faults, Peer
from tests.autopilot.vehicle.vehicles import (
    Bench,
    decode,
    heartbeat,
    packed,
    plan,
    planned,
    upload,
)


def _heard_of(message: Any) -> Say | None:
    """Return a message of the mission protocol as the peer reads it."""
    word = next((word for word in Word if word.value == message.get_type()), None)
    if word is None:
        return None
    number = {Word.COUNT: "count", Word.ITEM: "seq", Word.REQUEST: "seq", Word.ANSWER: "type"}.get(word)
    item = None
    if word is Word.ITEM:
        item = Item(
            seq=message.seq,
            frame=message.frame,
            command=message.command,
            current=bool(message.current),
            goes_on=bool(message.autocontinue),
            parameters=(message.param1, message.param2, message.param3, message.param4),
            x=message.x,
            y=message.y,
            z=message.z,
        )
    return Say(VEHICLE, word, getattr(message, number) if number else 0, item)


def _said_by(told: Any, target: tuple[int, int] = (1, 191), *, old_style: bool = True) -> bytes:
    """Return what the peer says as bytes, extension fields appended by hand."""
    match told:
        case ItemRequest():
            kind = dialect.MAVLink_mission_request_message if old_style else dialect.MAVLink_mission_request_int_message
            return packed(kind(*target, told.seq))
        case MissionAnswer():
            return _extended(dialect.MAVLink_mission_ack_message(*target, told.result), 4, told.opaque_id)
        case ItemCount():
            return _extended(dialect.MAVLink_mission_count_message(*target, told.count), 5, told.opaque_id)
        case ItemGiven():
            item = told.item
            return packed(
                dialect.MAVLink_mission_item_int_message(
                    *target,
                    *(item.seq, item.frame, item.command, int(item.current), int(item.goes_on)),
                    *item.parameters,
                    *(item.x, item.y, item.z),
                )
            )
    raise AssertionError(told)


def _extended(message: Any, offset: int, opaque_id: int) -> bytes:
    """Return a message with a field at `offset` of its payload that the dialect does not know."""
    frame = packed(message)
    payload = frame[10:-2].ljust(offset, b"\0") + opaque_id.to_bytes(4, "little")
    head = bytes([0xFD, len(payload)]) + frame[2:10]
    crc = dialect.x25crc(head[1:] + payload)
    crc.accumulate(bytes([dialect.mavlink_map[message.get_msgId()].crc_extra]))
    return head + payload + int(crc.crc).to_bytes(2, "little")


def fly(bench: Bench, peer: Peer, until_s: float, **style: Any) -> None:
    """Let session and peer talk, over bytes, until then."""
    done, at_s = 0, 0.2
    while at_s < until_s:
        while done < len(bench.sent):
            say, done = _heard_of(bench.sent[done]), done + 1
            for told in peer.hear(round(at_s * 1e9), say) if say is not None else []:
                bench.hear(at_s, _said_by(told, **style))
        at_s += 0.2
        bench.hear(at_s, heartbeat(autopilot=12 if peer.family is Family.PX4 else 3))
        for told in peer.tick(round(at_s * 1e9)):
            bench.hear(at_s, _said_by(told, **style))


def bench_with_vehicle() -> Bench:
    bench = Bench()
    bench.hear(0, heartbeat())
    return bench


@pytest.mark.parametrize("old_style", [True, False])
@pytest.mark.parametrize("target", [(1, 191), (0, 0)])
@pytest.mark.parametrize(("family", "opaque_id"), [(Family.COPTER, None), (Family.PX4, 0x8000_0001)])
def test_a_mission_over_bytes(family: Family, opaque_id: int | None, target: tuple[int, int], old_style: bool) -> None:
    bench = Bench()
    bench.hear(0, heartbeat(autopilot=12 if family is Family.PX4 else 3))
    peer = Peer(family, opaque_id=0x8000_0000 if opaque_id else 0)
    bench.session.perform(0, 5, upload(), 100_000_000_000)
    bench.turn(0.1)
    fly(bench, peer, 3, target=target, old_style=old_style)
    (report,) = bench.reported(MissionUploaded)
    assert report == MissionUploaded(effect_seq=5, items=6, opaque_id=opaque_id, attempts=1)
    assert list(map(str, peer.mission)) == list(map(str, given(plan(), family)))
    assert dict(bench.session.rejected) == {}


def test_a_refused_mission_over_bytes() -> None:
    bench = Bench()
    bench.hear(0, heartbeat())
    bench.session.perform(0, 5, upload(), 100_000_000_000)
    bench.turn(0.1)
    fly(bench, Peer(Family.COPTER, Faults(refuses=2)), 12)
    (report,) = bench.reported(MissionUploadFailed)
    assert report == MissionUploadFailed(
        effect_seq=5,
        because="refused: what it has is a mixture; it was cleared",
        mav_mission_result=3,
        item=1,
        holds=VehicleHolds.VEHICLE_HOLDS_NOTHING,
        attempts=1,
    )


def test_what_was_reached_is_of_the_mission_before() -> None:
    bench = bench_with_vehicle()
    reached = dialect.MAVLink_mission_item_reached_message(5)
    current = dialect.MAVLink_mission_current_message(1)
    bench.hear(0.1, packed(reached))
    bench.perform(0.2, 5, upload())
    bench.hear(0.3, packed(current))
    first, last = bench.reported(MissionProgressReported)
    assert (first.HasField("reached_item"), last.HasField("reached_item")) == (True, False)


def check_never_begun(bench: Bench, because: str) -> None:
    (report,) = bench.reported(MissionUploadFailed)
    assert report == MissionUploadFailed(
        effect_seq=6, because=because, holds=VehicleHolds.VEHICLE_HOLDS_OLD, attempts=None
    )


def test_an_upload_that_is_never_begun_says_why() -> None:
    bench = Bench()
    bench.perform(0, 6, upload())
    check_never_begun(bench, "no vehicle")
    bench = bench_with_vehicle()
    bench.perform(0, 6, upload([planned(183)]))
    check_never_begun(bench, "item 0: command 183 is not on the list")
    bench = bench_with_vehicle()
    bench.perform(0, 5, upload())
    bench.perform(0, 6, upload())
    check_never_begun(bench, "another upload is under way")
    bench = Bench(VehicleSection(connect="x:1", mission_items_max=5))
    bench.hear(0, heartbeat())
    bench.perform(0, 6, upload())
    check_never_begun(bench, "vehicle 1, 6 items: vehicle 1 takes 5")


def test_messages_of_another_s_upload_are_counted() -> None:
    bench = bench_with_vehicle()
    bench.perform(0.1, 5, upload())
    request = ItemRequest(sender=VEHICLE, target=VEHICLE, seq=0)
    bench.hear(
        0.2, _said_by(request, (255, 190)), _said_by(ItemCount(sender=VEHICLE, target=VEHICLE, count=2, opaque_id=0))
    )
    assert dict(bench.session.rejected) == {"mission of another": 1, "unmatched mission message": 1}
    assert "MISSION_ITEM_INT" not in {message.get_type() for message in bench.sent}
    stranger = decode(_said_by(request))
    bench.hear(0.3, packed(stranger, 1, 100), packed(stranger, 2, 1))
    assert (bench.session.rejected["foreign component"], bench.session.rejected["foreign system"]) == (1, 1)
