"""What can be said to a vehicle: the closed list, and how each thing on it looks on the wire."""

from __future__ import annotations

import ast
import math
from pathlib import Path

import pytest
from google.protobuf.message import Message
from pymavlink.dialects.v20 import common as dialect

import autopilot.adapters.vehicle as adapter
from autopilot.adapters.vehicle.egress import REQUESTABLE, SENDABLE, STREAMS_US, Egress, NotEncodable
from autopilot.adapters.vehicle.heard import Sender
from events.schema.vehicle_pb2 import CommandSent, GiveUpGimbal, PointAtPlace, TakeGimbal
from tests.autopilot.vehicle.vehicles import at_angles, at_place, decode, give_up, release, take, zoom

VEHICLE = Sender(system=7, component=1)


def everything() -> list[bytes]:
    """Return one of each thing that the public face of egress can encode."""
    egress = Egress(191)
    return [
        egress.heartbeat(7),
        *(egress.ask_stream(7, VEHICLE, message_id) for message_id in STREAMS_US),
        egress.ask_version(7, VEHICLE),
        egress.timesync(7, VEHICLE, 0, 5),
        *(egress.ask_message(7, message_id) for message_id in REQUESTABLE),
        *(egress.effect(7, VEHICLE, effect, 0) for effect in (at_place(), at_angles(), release(), take(), zoom())),
    ]


def check_refused(effect: Message) -> None:
    with pytest.raises(NotEncodable):
        Egress(191).effect(7, VEHICLE, effect, 0)


def test_the_list_is_closed() -> None:
    """The nine pairs, written out here again: whoever adds one changes this line and says why."""
    commands = [(75, 195), (76, 1000), (76, 1001), (76, 197), (76, 511), (76, 512), (76, 531)]
    assert sorted(SENDABLE, key=str) == [(0, None), (111, None), *commands]
    assert {
        (message.get_msgId(), getattr(message, "command", None)) for message in map(decode, everything())
    } == SENDABLE


def test_nothing_that_moves_the_aircraft_or_drops_something_is_on_it() -> None:
    forbidden = {
        "ARM",
        "SET_MODE",
        "MISSION",
        "SERVO",
        "RELAY",
        "PARACHUTE",
        "GRIPPER",
        "WINCH",
        "PAYLOAD",
        "TAKEOFF",
        "LAND",
        "REPOSITION",
        "LAUNCH",
        "DIGICAM",
        "FLIGHTTERMINATION",
        "SPRAYER",
        "MOTOR",
    }
    names = [dialect.enums["MAV_CMD"][command].name for _, command in SENDABLE if command is not None]
    assert [name for name in names if any(word in name for word in forbidden)] == []


@pytest.mark.parametrize(
    "message",
    [
        dialect.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0),
        dialect.MAVLink_command_long_message(1, 1, 195, 0, 0, 0, 0, 0, 0, 0, 0),
        dialect.MAVLink_set_mode_message(1, 1, 4),
        dialect.MAVLink_mission_count_message(1, 1, 3),
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
    assert importing == {"egress.py", "frames.py", "ingress.py"}


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
