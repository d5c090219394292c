"""What can be said to a vehicle: the closed list, and how each thing on it looks on the wire."""

from __future__ import annotations

import ast
import math
from pathlib import Path
from typing import Any

import pytest
from google.protobuf.message import Message
from pymavlink.dialects.v20 import common as dialect

import autopilot.adapters.vehicle as adapter
from autopilot.adapters.vehicle.egress import REQUESTABLE, SENDABLE, STREAMS_US, Egress
from autopilot.adapters.vehicle.flight_words import NotEncodable
from autopilot.adapters.vehicle.heard import Sender
from autopilot.adapters.vehicle.mission_form import given
from autopilot.adapters.vehicle.modes import Family, Kind
from autopilot.adapters.vehicle.orders import Form
from autopilot.adapters.vehicle.transfer import Say, Word
from events.schema.mission_pb2 import ArmVehicle, StartMission
from events.schema.safety_pb2 import FlightMode, FlyToPlace, SetVehicleMode
from events.schema.vehicle_pb2 import CommandSent, GiveUpGimbal, PointAtPlace, TakeGimbal
from tests.autopilot.vehicle.vehicles import (
    arm,
    at_angles,
    at_place,
    decode,
    fly_to,
    give_up,
    go_to_item,
    mode,
    plan,
    release,
    start,
    take,
    upload,
    zoom,
)

VEHICLE = Sender(system=7, component=1)


COPTER, PLANE = Kind(autopilot=3, vehicle_type=2), Kind(autopilot=3, vehicle_type=1)
VTOL, PX4, OTHER = (
    Kind(autopilot=3, vehicle_type=20),
    Kind(autopilot=12, vehicle_type=2),
    Kind(autopilot=0, vehicle_type=0),
)
EFFECTS: dict[int, Message] = {
    195: at_place(),
    1000: at_angles(),
    197: release(),
    1001: take(),
    531: zoom(),
    176: mode("RETURN"),
    400: arm(),
    300: start(),
    224: go_to_item(2),
    192: fly_to(),
}


FORMS = (Form.LONG, Form.INT, Form.INT_OTHER_FRAME)  # of a command


def everything() -> list[bytes]:
    """Return one of each thing that the public face of egress can encode."""
    egress = Egress(191)
    items = [Say(VEHICLE, Word.ITEM, item.seq, item) for item in given(plan(), Family.COPTER)]
    return [
        egress.heartbeat(7),
        *(egress.ask_stream(7, VEHICLE, message_id) for message_id in STREAMS_US),
        egress.ask_version(7, VEHICLE),
        egress.timesync(7, VEHICLE, 0, 5),
        *(egress.ask_message(7, message_id) for message_id in REQUESTABLE),
        *(egress.effect(7, VEHICLE, effect, 0, form=form, kind=PX4) for effect in EFFECTS.values() for form in FORMS),
        egress.effect(7, VEHICLE, go_to_item(2), 0, form=Form.MESSAGE, kind=PX4),
        *(egress.say(7, Say(VEHICLE, word)) for word in Word if word is not Word.ITEM),
        *(egress.say(7, say) for say in items),
    ]


def said(effect: Message, kind: Kind = COPTER, **changes: Any) -> Any:
    return decode(Egress(191).effect(7, VEHICLE, effect, 0, kind=kind, **changes))


def check_refused(effect: Message, kind: Kind | None = COPTER) -> None:
    with pytest.raises(NotEncodable):
        Egress(191).effect(7, VEHICLE, effect, 0, kind=kind)


def test_the_list_is_closed() -> None:
    """Every pair, written out here again: whoever adds one changes these lines and says why."""
    commands = (176, 192, 195, 197, 224, 300, 400, 531, 1000, 1001)
    both_forms = [(form, command) for form in (75, 76) for command in commands]
    asking = [(76, 511), (76, 512)]
    mission = [(41, None), (43, None), (44, None), (45, None), (47, None), (51, None)]
    items = [(73, command) for command in (16, 20, 21, 22, 178)]
    expected = {(0, None), (111, None), *both_forms, *asking, *mission, *items}
    assert expected == SENDABLE
    assert {
        (message.get_msgId(), getattr(message, "command", None)) for message in map(decode, everything())
    } == expected


def test_nothing_that_drops_something_or_ends_a_flight_is_on_it() -> None:
    forbidden = {
        "SERVO",
        "RELAY",
        "PARACHUTE",
        "GRIPPER",
        "WINCH",
        "PAYLOAD",
        "DIGICAM",
        "FLIGHTTERMINATION",
        "SPRAYER",
        "MOTOR",
        "REBOOT",
        "PARAMETER",
        "HOME",
        "FENCE",
    }
    names = [dialect.enums["MAV_CMD"][command].name for _, command in SENDABLE if command is not None]
    assert [name for name in names if any(word in name for word in forbidden)] == []


@pytest.mark.parametrize("force", [(0, 0), (1, 21196), (0, 21196), (1, 1), (2, 0)])
def test_nothing_is_disarmed_nor_armed_by_force(force: tuple[int, int]) -> None:
    for message in (
        dialect.MAVLink_command_long_message(1, 1, 400, 0, *force, 0, 0, 0, 0, 0),
        dialect.MAVLink_command_int_message(1, 1, 0, 400, 0, 0, *force, 0, 0, 0, 0, 0),
    ):
        with pytest.raises(NotEncodable, match="force"):
            Egress(191)._pack(1, message)


@pytest.mark.parametrize(
    "message",
    [
        dialect.MAVLink_command_long_message(1, 1, 185, 0, 1, 0, 0, 0, 0, 0, 0),
        dialect.MAVLink_command_int_message(1, 1, 0, 511, 0, 0, 0, 0, 0, 0, 0, 0, 0),
        dialect.MAVLink_set_mode_message(1, 1, 4),
        dialect.MAVLink_mission_item_int_message(1, 1, 0, 3, 183, 0, 1, 0, 0, 0, 0, 0, 0, 0),
        dialect.MAVLink_mission_item_message(1, 1, 0, 3, 16, 0, 1, 0, 0, 0, 0, 0, 0, 0),
        dialect.MAVLink_param_set_message(1, 1, b"X", 0, 9),
    ],
)
def test_the_packer_itself_refuses(message: object) -> None:
    with pytest.raises(NotEncodable, match="not on the list"):
        Egress(191)._pack(1, message)


def test_only_egress_packs() -> None:
    """No other file of the adapter makes bytes of a message."""
    folder = Path(adapter.__file__).parent
    packing = {
        path.name
        for path in folder.glob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Attribute)
        and (node.attr in ("pack", "send") or node.attr.endswith(("_encode", "_send")))
        if node.attr != "_send" or path.name != "link.py"
    }
    importing = {path.name for path in folder.glob("*.py") if "pymavlink" in path.read_text()}
    assert packing == {"egress.py"}
    assert importing == {"egress.py", "frames.py", "ingress.py", "ingress_flight.py"}


def test_a_place_is_a_command_int_in_the_global_frame() -> None:
    message = decode(Egress(191).effect(7, VEHICLE, at_place(473_977_123, -85_456_789, altitude_mm=488_500), 2))
    assert message.get_type() == "COMMAND_INT"
    assert (message.get_srcSystem(), message.get_srcComponent()) == (7, 191)
    assert (message.target_system, message.target_component) == (7, 1)
    assert (message.command, message.frame) == (195, dialect.MAV_FRAME_GLOBAL)
    assert (message.x, message.y, message.z) == (473_977_123, -85_456_789, 488.5)


@pytest.mark.parametrize(
    ("yaw_cdeg", "locked", "yaw_deg", "flags"),
    [(9_000, True, 90, 28), (27_000, False, -90, 12), (18_000, True, -180, 28), (35_999, False, -0.01, 12)],
)
def test_angles_are_degrees_with_unset_rates(yaw_cdeg: int, locked: bool, yaw_deg: float, flags: int) -> None:
    effect = at_angles(-3_050, yaw_cdeg, yaw_locked=locked)
    message = decode(Egress(191).effect(7, VEHICLE, effect, 1))
    assert (message.get_type(), message.command, message.confirmation) == ("COMMAND_LONG", 1000, 1)
    assert (message.param1, message.param5, message.param7) == (-30.5, flags, 0)
    assert message.param2 == pytest.approx(yaw_deg, abs=1e-4)
    assert math.isnan(message.param3)
    assert math.isnan(message.param4)


def test_a_release_is_roi_none() -> None:
    message = decode(Egress(191).effect(7, VEHICLE, release(), 0))
    assert (message.get_type(), message.command) == ("COMMAND_LONG", 197)


@pytest.mark.parametrize(("effect", "who"), [(take(), -2), (give_up(), -3)])
def test_control_is_configured_as_the_sender(effect: Message, who: int) -> None:
    """Never by numbers, and secondary control is left as it is."""
    message = decode(Egress(191).effect(7, VEHICLE, effect, 1))
    assert (message.get_type(), message.command, message.confirmation) == ("COMMAND_LONG", 1001, 1)
    assert (message.param1, message.param2, message.param3, message.param4, message.param7) == (who, who, -1, -1, 0)


@pytest.mark.parametrize(("zoom_e4", "percent"), [(0, 0), (4_050, 40.5), (10_000, 100)])
def test_a_zoom_is_a_percentage(zoom_e4: int, percent: float) -> None:
    message = decode(Egress(191).effect(7, Sender(system=7, component=100), zoom(zoom_e4), 0))
    assert (message.command, message.param1, message.param2) == (531, dialect.ZOOM_TYPE_RANGE, percent)
    assert (message.target_system, message.target_component) == (7, 100)


def test_what_is_asked_of_everybody() -> None:
    message = decode(Egress(191).ask_message(7, 280))
    assert (message.command, message.param1, message.target_system, message.target_component) == (512, 280, 7, 0)
    with pytest.raises(NotEncodable, match="not asked for"):
        Egress(191).ask_message(7, 33)


@pytest.mark.parametrize("effect", [zoom(10_001), zoom(camera=2), TakeGimbal(vehicle=1, gimbal=2), GiveUpGimbal()])
def test_what_is_not_on_this_link_is_refused(effect: Message) -> None:
    check_refused(effect)


def test_the_heartbeat_is_that_of_an_onboard_controller() -> None:
    message = decode(Egress(191).heartbeat(7))
    assert (message.type, message.autopilot) == (dialect.MAV_TYPE_ONBOARD_CONTROLLER, dialect.MAV_AUTOPILOT_INVALID)


def test_messages_are_numbered() -> None:
    egress = Egress(191)
    numbers = [decode(egress.heartbeat(7)).get_seq() for _ in range(257)]
    assert numbers == [*range(256), 0]


@pytest.mark.parametrize(
    "effect",
    [
        at_place(0, 0, altitude_mm=0),
        at_place(0, 0),
        at_place(900_000_001, 0),
        at_place(0, -1_800_000_001),
        at_place(altitude_mm=20_000_001),
        at_place(altitude_mm=-500_001),
        PointAtPlace(vehicle=1, gimbal=1),
        PointAtPlace(vehicle=2, gimbal=1, place=at_place().place),
        PointAtPlace(vehicle=1, gimbal=2, place=at_place().place),
        at_angles(9_001),
        at_angles(-9_001),
        at_angles(0, 36_000),
        CommandSent(effect_seq=1),
        fly_to(0, 0),
        fly_to(900_000_001, 0),
        fly_to(0, -1_800_000_001),
        fly_to(altitude_mm=20_000_001),
        FlyToPlace(vehicle=2, place=fly_to().place),
        FlyToPlace(vehicle=1),
        SetVehicleMode(vehicle=2, mode=FlightMode.FLIGHT_MODE_LAND),
        SetVehicleMode(vehicle=1),
        go_to_item(65_535),
        ArmVehicle(vehicle=2),
        StartMission(vehicle=0),
        upload(),
    ],
)
def test_what_must_not_be_said_is_refused(effect: Message) -> None:
    check_refused(effect)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_numbers_that_are_none_are_refused(value: float) -> None:
    egress = Egress(191)
    place = dialect.MAVLink_command_int_message(1, 1, 0, 195, 0, 0, 0, 0, 0, 0, 1, 1, value)
    angles = dialect.MAVLink_command_long_message(1, 1, 1000, 0, value, 0, math.nan, math.nan, 0, 0, 0)
    for message in (place, angles):
        with pytest.raises(NotEncodable, match="not finite"):
            egress._pack(1, message)


MODES = ("MISSION", "LOITER", "GUIDED", "RETURN", "LAND")


@pytest.mark.parametrize(
    ("kind", "asked"),
    [
        (COPTER, [(3, 0), (5, 0), (4, 0), (6, 0), (9, 0)]),
        (PLANE, [(10, 0), (12, 0), (15, 0), (11, 0), (11, 0)]),
        (VTOL, [(10, 0), (12, 0), (15, 0), (11, 0), (20, 0)]),
        (PX4, [(4, 4), (4, 3), (4, 3), (4, 5), (4, 6)]),
    ],
)
def test_a_mode_is_asked_for_in_the_autopilot_s_own_numbers(kind: Kind, asked: list[tuple[int, int]]) -> None:
    messages = [said(mode(name), kind) for name in MODES]
    assert [(m.command, m.param1) for m in messages] == [(176, 1)] * 5
    assert [(m.param2, m.param3) for m in messages] == asked


def test_a_mode_of_an_autopilot_that_nobody_knows_is_refused() -> None:
    for kind in (OTHER, Kind(autopilot=3, vehicle_type=10), None):
        check_refused(mode("RETURN"), kind)


def test_arming_is_one_and_never_by_force() -> None:
    message = said(arm())
    assert (message.command, message.param1, message.param2) == (400, 1, 0)


def test_a_mission_is_started_whole() -> None:
    message = said(start())
    assert [message.command, message.param1, message.param2] == [300, 0, 0]


@pytest.mark.parametrize(("kind", "number"), [(COPTER, 3), (PLANE, 3), (PX4, 2), (OTHER, 2)])
def test_an_item_is_named_as_the_vehicle_counts(kind: Kind, number: int) -> None:
    message = said(go_to_item(2), kind)
    assert (message.command, message.param1, message.param2) == (224, number, 0)


@pytest.mark.parametrize(("kind", "number"), [(COPTER, 3), (PX4, 2)])
def test_an_item_is_named_by_a_message_too(kind: Kind, number: int) -> None:
    """For a vehicle that does not know the command; nothing else has such a message."""
    message = said(go_to_item(2), kind, form=Form.MESSAGE)
    assert (message.get_type(), message.seq) == ("MISSION_SET_CURRENT", number)
    assert (message.target_system, message.target_component) == (VEHICLE.system, VEHICLE.component)
    with pytest.raises(NotEncodable, match="no message of its own"):
        said(arm(), kind, form=Form.MESSAGE)


def test_a_place_to_fly_to_is_above_the_sea() -> None:
    message = said(fly_to(473_977_123, -85_456_789, 540_500))
    assert message.get_type() == "COMMAND_INT"
    assert (message.frame, message.command, message.x, message.y, message.z) == (
        0,
        192,
        473_977_123,
        -85_456_789,
        540.5,
    )
    assert [message.param1, message.param2, message.param3, message.param4] == [-1, 1, 0, 0]
    assert math.isnan(said(fly_to(), PX4).param4)


@pytest.mark.parametrize("command", sorted(EFFECTS))
def test_the_other_form_says_the_same(command: int) -> None:
    effect = EFFECTS[command]
    int_form, long_form = said(effect, PX4, form=Form.INT), said(effect, PX4, form=Form.LONG)
    assert (int_form.get_type(), long_form.get_type()) == ("COMMAND_INT", "COMMAND_LONG")
    assert (int_form.frame, said(effect, PX4, form=Form.INT_OTHER_FRAME).frame) == (0, 5)
    names = ("command", "param1", "param2", "param3", "param4")
    assert [str(getattr(int_form, name)) for name in names] == [str(getattr(long_form, name)) for name in names]
    scale = 1e7 if command in (192, 195) else 1
    assert (int_form.x, int_form.y) == pytest.approx((long_form.param5 * scale, long_form.param6 * scale), rel=1e-7)
    assert int_form.z == long_form.param7


def test_items_are_said_as_they_are() -> None:
    for item in given(plan(), Family.PX4):
        message = decode(Egress(191).say(7, Say(VEHICLE, Word.ITEM, item.seq, item)))
        assert (message.get_type(), message.mission_type) == ("MISSION_ITEM_INT", 0)
        assert (message.seq, message.frame, message.command) == (item.seq, item.frame, item.command)
        assert (message.current, message.autocontinue) == (item.current, item.goes_on)
        assert str((message.param1, message.param2, message.param3, message.param4)) == str(item.parameters)
        assert (message.x, message.y, message.z) == (item.x, item.y, item.z)


def test_what_may_be_unset_in_an_item_is_its_yaw() -> None:
    nan = math.nan
    dialect_item = dialect.MAVLink_mission_item_int_message
    Egress(191)._pack(1, dialect_item(1, 1, 0, 3, 16, 0, 1, 0, 0, 0, nan, 1, 1, 1))
    for values in ((nan, 0, 0, 0, 1, 1, 1), (0, 0, 0, math.inf, 1, 1, 1), (0, 0, 0, 0, 1, 1, nan)):
        with pytest.raises(NotEncodable, match="not finite"):
            Egress(191)._pack(1, dialect_item(1, 1, 0, 3, 16, 0, 1, *values))


def test_a_yaw_that_is_unset_is_for_the_few_that_have_one() -> None:
    for command in (176, 195, 197, 224, 300):
        with pytest.raises(NotEncodable, match="param4 is not finite"):
            Egress(191)._pack(1, dialect.MAVLink_command_long_message(1, 1, command, 0, 1, 0, 0, math.nan, 0, 0, 0))
