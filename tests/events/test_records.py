"""Records, kinds and ids: every kind encodes and decodes, unknown ones are loud, ids derive from the log."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from uuid import RFC_4122, UUID

import pytest
from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.message import Message
from hypothesis import given, settings
from hypothesis import strategies as st

from events import (
    KINDS,
    BodyBroken,
    Kind,
    Moment,
    Role,
    UnknownKind,
    encode,
    kind_named,
    kind_numbered,
    kind_of,
    make_record,
    read_record,
    uuid_of,
)
from events.kinds import FAMILIES
from events.records import Stored
from events.schema.common_pb2 import Issuer, Place
from events.schema.flight_pb2 import TimePassed
from events.schema.orders_pb2 import OrderReceived
from tests.checks import check_equal

AT = Moment(1, 2, 3, 4, 2)
INTEGERS = {
    FieldDescriptor.CPPTYPE_INT32: st.integers(-(2**31), 2**31 - 1),
    FieldDescriptor.CPPTYPE_INT64: st.integers(-(2**63), 2**63 - 1),
    FieldDescriptor.CPPTYPE_UINT32: st.integers(0, 2**32 - 1),
    FieldDescriptor.CPPTYPE_UINT64: st.integers(0, 2**64 - 1),
    FieldDescriptor.CPPTYPE_BOOL: st.booleans(),
}
TEXT = st.text(st.characters(codec="utf-8"), max_size=5)


def value_of(draw: Callable[[Any], Any], field: Any) -> Any:
    """Draw a value for a field of any type that an event may have."""
    if field.cpp_type == FieldDescriptor.CPPTYPE_MESSAGE:
        return fill(draw, field.message_type._concrete_class())
    if field.cpp_type == FieldDescriptor.CPPTYPE_ENUM:
        return draw(st.sampled_from([value.number for value in field.enum_type.values]))
    if field.cpp_type == FieldDescriptor.CPPTYPE_STRING:
        return draw(TEXT if field.type == FieldDescriptor.TYPE_STRING else st.binary(max_size=5))
    return draw(INTEGERS[field.cpp_type])


def fill(draw: Callable[[Any], Any], message: Any) -> Any:
    """Fill a message, field by field; each may stay away."""
    for field in message.DESCRIPTOR.fields:
        if not draw(st.booleans()):
            continue
        if field.is_repeated:
            getattr(message, field.name).extend(value_of(draw, field) for _ in range(draw(st.integers(1, 2))))
        elif field.cpp_type == FieldDescriptor.CPPTYPE_MESSAGE:
            getattr(message, field.name).CopyFrom(value_of(draw, field))
        else:
            setattr(message, field.name, value_of(draw, field))
    return message


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_every_kind_is_stable(kind: Kind) -> None:
    """Encoded, decoded and encoded again it is the same bytes, the same message and the same record."""

    @settings(max_examples=8, deadline=None)
    @given(st.data())
    def check(data: st.DataObject) -> None:
        message = fill(data.draw, kind.message())
        record = make_record(7, 3, AT, message)
        check_equal((record.kind, record.version, record.body), (kind, kind.version, encode(message)))
        read = read_record(Stored(7, 3, AT, kind.number, kind.version, record.body, b""))
        check_equal(read, record)
        check_equal(encode(read.message), record.body)

    check()


def test_the_catalogue_is_found_by_name_number_and_message() -> None:
    """Each kind once; numbers and names mean one thing."""
    check_equal([kind_numbered(kind.number) for kind in KINDS], list(KINDS))
    check_equal([kind_named(kind.name) for kind in KINDS], list(KINDS))
    check_equal([kind_of(kind.message) for kind in KINDS], list(KINDS))
    check_equal([kind_of(kind.message()) for kind in KINDS], list(KINDS))
    check_equal(sorted({kind.number for kind in KINDS}), [kind.number for kind in KINDS])


def test_numbers_that_are_given_stay_given() -> None:
    """What was recorded under a number once: the list may only grow."""
    given = {
        "flight_opened": 1, "baseline_carried": 2, "node_started": 3, "flight_closed": 4, "time_passed": 5,
        "origin_set": 6, "step_failed": 7, "inputs_dropped": 8, "samples_rejected": 9, "moved": 10,
        "order_received": 20, "order_malformed": 21, "send_ack": 22, "ack_published": 23,
        "point_at_place": 40, "point_at_angles": 41, "release_pointing": 42, "command_sent": 43,
        "command_answered": 44, "command_unanswered": 45, "vehicle_state_reported": 46, "vehicle_link_changed": 47,
        "position_reported": 48, "gimbal_reported": 49, "frame_observed": 60, "eyes_changed": 61,
        "sightings_classified": 70, "poi_opened": 71, "item_ignored": 72, "camera_taken": 73, "poi_joined": 74,
        "sighting_muted": 75, "poi_left": 76, "log_recovered": 100, "log_damaged": 101, "disk_full": 102,
        "flight_deleted": 103, "log_key_certified": 120, "seal_refused": 121, "checkpoint_cosigned": 122,
    }  # fmt: skip
    check_equal({name: kind_named(name).number for name in given}, given)


def test_every_message_with_a_kind_is_in_the_catalogue() -> None:
    """No family is forgotten, and roles, durability and ports are as the schema says."""
    messages = [value for family in FAMILIES for value in vars(family).values() if isinstance(value, type)]
    named = [one for one in messages if issubclass(one, Message) and "number" in str(one.DESCRIPTOR.GetOptions())]
    check_equal(len(named), len(KINDS))
    ports = {kind.name: kind.port for kind in KINDS if kind.role is Role.EFFECT}
    pointing = ("point_at_place", "point_at_angles", "release_pointing", "take_gimbal", "give_up_gimbal", "set_zoom")
    flying = ("set_vehicle_mode", "fly_to_place", "arm_vehicle", "start_mission", "set_mission_item", "upload_mission")
    elsewhere = {"send_ack": "mesh", "fetch_mission": "missions", "post_waypoint": "missions"}
    elsewhere["push_observations"] = "missions"
    elsewhere["run_selftest"] = "selftest"
    check_equal(ports, elsewhere | dict.fromkeys((*pointing, *flying), "vehicle"))
    sync = {kind.name for kind in KINDS if kind.sync}
    check_equal({"order_received", "order_malformed", "flight_opened", "step_failed", "point_at_place"} - sync, set())
    check_equal({"frame_observed", "moved", "gimbal_reported", "position_reported"} & sync, set())
    check_equal({kind.version for kind in KINDS}, {1})


def check_loud(words: str, call: Callable[[], object], error: type[Exception] = UnknownKind) -> None:
    """Check that what is not known is an error that says so."""
    with pytest.raises(error, match=words):
        call()


def test_what_is_unknown_is_loud() -> None:
    """A number, a name, a part, a newer body, and bytes that are no such message."""
    check_loud("no event kind has number 9999", lambda: kind_numbered(9999))
    check_loud("no event kind is named 'fly'", lambda: kind_named("fly"))
    check_loud("Place is a part", lambda: kind_of(Place))
    check_loud("Issuer is a part", lambda: make_record(0, -1, AT, Issuer()))
    stored = Stored(3, -1, AT, 20, 1, encode(OrderReceived(command_id="a")), b"")
    check_loud("newer version", lambda: read_record(stored._replace(kind_number=999)))
    check_loud("record 3 is order_received version 2; known is 1", lambda: read_record(stored._replace(version=2)))
    check_loud("record 3 is no order_received", lambda: read_record(stored._replace(body=b"\xff")), BodyBroken)
    check_loud("record 3 is no order_received", lambda: read_record(stored._replace(body=stored.body[:-1])), BodyBroken)


def test_a_record_keeps_its_bytes() -> None:
    """The original body, never a re-encoding: what a newer writer added stays in it."""
    body = encode(OrderReceived(command_id="a")) + b"\xfa\x7f\x01x"
    record = read_record(Stored(0, -1, AT, 20, 1, body, b""))
    check_equal(record.body, body)
    check_equal(make_record(0, -1, AT, TimePassed()).body, b"")


@given(st.binary(min_size=16, max_size=16), st.integers(0, 2**64 - 1))
@settings(max_examples=50, deadline=None)
def test_ids_are_uuids_of_their_place(flight_id: bytes, seq: int) -> None:
    """UUIDv8, the same for the same place, another for its neighbour."""
    uuid = UUID(uuid_of(flight_id, seq))
    check_equal((uuid.version, uuid.variant, str(uuid)), (8, RFC_4122, uuid_of(flight_id, seq)))
    check_equal(uuid_of(flight_id, seq) == uuid_of(flight_id, seq ^ 1), False)


def test_one_id_for_ever() -> None:
    """What people wrote down stays findable."""
    check_equal(uuid_of(bytes(range(16)), 1), "112ac280-cda0-8f4c-959e-4150e2be4230")
