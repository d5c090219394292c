"""The gimbal and the camera of a link: discovered, described, watched, taken, zoomed."""

from __future__ import annotations

import math
from typing import Any, TypeVar

import pytest
from google.protobuf.message import Message
from pymavlink.dialects.v20 import common as dialect

from autopilot.ports.config import VehicleSection
from events.schema.vehicle_pb2 import (
    CameraDescribed,
    CameraZoomed,
    CommandAnswered,
    CommandUnanswered,
    GimbalControlChanged,
    GimbalDescribed,
    GimbalReported,
)
from tests.autopilot.vehicle.vehicles import (
    Bench,
    answer,
    at_angles,
    attitude,
    camera,
    controlled,
    gimbal,
    give_up,
    information,
    packed,
    position,
    take,
    zoom,
    zoomed,
)

M = TypeVar("M", bound=Message)
DESCRIBED: dict[str, Any] = {"vehicle": 1, "gimbal": 1}


def told(bench: Bench, kind: type[M]) -> list[M]:
    """Return the reports of a kind."""
    return [report for report in bench.reports if isinstance(report, kind)]


def asked(bench: Bench, message_id: int) -> int:
    """Return how often a message was asked for by itself."""
    return sum(getattr(one, "command", 0) == 512 and one.param1 == message_id for one in bench.sent)


def beat(vehicle_type: int = 2, autopilot: int = 3) -> bytes:
    return packed(dialect.MAVLink_heartbeat_message(vehicle_type, autopilot, 0, 0, 4, 3))


def until(bench: Bench, from_s: float, to_s: float, *datagrams: bytes) -> None:
    """Let time pass, a heartbeat and these datagrams each half second."""
    for half in range(round(from_s * 2), round(to_s * 2)):
        bench.hear(half / 2, beat(), *datagrams)


def check_described(vehicle_type: int, tells: bytes, **expected: Any) -> None:
    """The vehicle's gimbal is described so."""
    bench = Bench()
    bench.hear(0, beat(vehicle_type), tells)
    assert bench.reported(GimbalDescribed) == [GimbalDescribed(**DESCRIBED, managed=True, **expected)]


PITCH = {"pitch_min_cdeg": -9_000, "pitch_max_cdeg": 2_000}
WHOLE = {"yaw_min_cdeg": -18_000, "yaw_max_cdeg": 18_000}
NONE = {"yaw_min_cdeg": 0, "yaw_max_cdeg": 0}


def test_what_pans_and_what_turns_the_vehicle() -> None:
    """By limits, by axes where no limits are told, and by what the vehicle is."""
    check_described(2, information(), pans=True, turns_vehicle=False, **PITCH, **WHOLE)
    check_described(2, information(yaw_deg=(0, 0)), pans=False, turns_vehicle=True, **PITCH, **NONE)
    check_described(20, information(yaw_deg=(0, 0)), pans=False, turns_vehicle=True, **PITCH, **NONE)
    check_described(1, information(yaw_deg=(0, 0)), pans=False, turns_vehicle=False, **PITCH, **NONE)
    check_described(2, information(flags=32), pans=False, turns_vehicle=True, **PITCH, **WHOLE)
    check_described(2, information((0, 0), (0, 0), flags=256 + 32), pans=True, turns_vehicle=False)
    check_described(2, information((0, 0), (0, 0)), pans=False, turns_vehicle=True)
    check_described(2, information(yaw_deg=(0, 0), flags=2048), pans=True, turns_vehicle=False, **PITCH, **NONE)
    play = {"yaw_min_cdeg": -490, "yaw_max_cdeg": 490}
    check_described(2, information(yaw_deg=(-4.9, 4.9)), pans=False, turns_vehicle=True, **PITCH, **play)
    just = {"yaw_min_cdeg": -500, "yaw_max_cdeg": 510}
    check_described(2, information(yaw_deg=(-5, 5.1)), pans=True, turns_vehicle=False, **PITCH, **just)


def test_asked_until_it_comes_and_said_where_nobody_answers() -> None:
    """Every vehicle is asked; silence is said once, and taken back when a manager tells after all."""
    bench = Bench()
    until(bench, 0, 7.5)
    assert (asked(bench, 280), bench.reported(GimbalDescribed)) == (4, [])
    assert bench.session.due_ns() <= 8_000_000_000
    until(bench, 8, 20)
    silent = GimbalDescribed(**DESCRIBED, managed=False, pans=False, turns_vehicle=True)
    assert bench.reported(GimbalDescribed) == [silent]
    bench.hear(20, information())
    described = GimbalDescribed(**DESCRIBED, managed=True, pans=True, turns_vehicle=False, **PITCH, **WHOLE)
    assert bench.reported(GimbalDescribed) == [silent, described]
    times = asked(bench, 280)
    until(bench, 20, 60, information())
    assert asked(bench, 280) == times
    assert bench.reported(GimbalDescribed) == [silent, described]


def test_said_again_when_the_vehicle_came_back() -> None:
    bench = Bench(VehicleSection(connect="x:1", link_timeout_s=5))
    bench.hear(0, beat(), information(), controlled(0, 0), camera(), zoomed(10))
    bench.turn(6)
    bench.hear(7, beat(), information(), controlled(0, 0), camera(), zoomed(10))
    kinds = (GimbalDescribed, GimbalControlChanged, CameraDescribed, CameraZoomed)
    assert [len(bench.reported(kind)) for kind in kinds] == [2, 2, 2, 2]


def test_who_controls_it_is_said_when_it_changes() -> None:
    """The stream is asked for; ours is by system and component; of two managers the first is heard."""
    bench = Bench()
    bench.hear(0, beat())
    bench.hear(0.1, controlled(0, 0), controlled(0, 0), controlled(255, 190), controlled(1, 190))
    bench.hear(1, controlled(1, 191), controlled(9, 9, component=154), controlled(1, 191), controlled(2, 191))
    bench.hear(1.1, controlled(0, 0))
    assert (511, 281) in [(one.command, one.param1) for one in bench.sent if hasattr(one, "param1")]
    assert [(one.system_id, one.component_id, one.ours) for one in told(bench, GimbalControlChanged)] == [
        (0, 0, False),
        (255, 190, False),
        (1, 190, False),
        (1, 191, True),
        (2, 191, False),
        (0, 0, False),
    ]


@pytest.mark.parametrize(
    ("autopilot", "component", "measures", "demanded"),
    [(3, 1, None, True), (3, 154, None, False), (12, 1, None, False), (3, 1, True, False), (12, 154, False, True)],
)
def test_what_is_measured_and_what_is_demanded(
    autopilot: int, component: int, measures: bool | None, demanded: bool
) -> None:
    """ArduPilot itself tells what its servos were told; a gimbal of its own measures; configuration knows better."""
    settings = VehicleSection(connect="x:1", gimbal_measures=measures)
    bench = Bench(settings)
    bench.hear(0, beat(autopilot=autopilot), position(0), attitude(0, 0), gimbal(0, -35, 0, component=component))
    (report,) = told(bench, GimbalReported)
    assert (report.demanded, report.HasField("demanded")) == (demanded, demanded)


def test_a_gimbal_of_its_own_vouches_for_what_the_autopilot_repeats() -> None:
    bench = Bench()
    bench.hear(0, beat(), attitude(0, 0), gimbal(0, -35, 0), gimbal(0, -35, 0, component=154))
    bench.hear(1, attitude(1000, 0), gimbal(1000, -10, 0))
    assert [one.demanded for one in told(bench, GimbalReported)] == [True, False, False]


def test_drift_is_news_though_the_view_stands_still() -> None:
    """A gimbal that is stuck while the vehicle turns is farther and farther off: each bound is told."""
    bench = Bench()
    bench.hear(0, beat(), position(0), attitude(0, 0), gimbal(0, -30, 0, flags=64))
    bench.perform(0.1, 5, at_angles(-3_000, 0, yaw_locked=False))
    bench.hear(0.2, answer(1000), attitude(200, 0), gimbal(200, -30, 0, flags=64))
    for tenth, nose_deg in ((3, 1.0), (4, 1.5), (5, 1.8), (6, 2.5), (7, 3.0), (8, 0.1)):
        at_ms = tenth * 100
        bench.hear(tenth / 10, attitude(at_ms, nose_deg), position(at_ms), gimbal(at_ms, -30, 0, flags=64))
    errors = [one.error_cdeg for one in told(bench, GimbalReported) if one.effect_seq == 5]
    assert errors == pytest.approx([0, 130, 217, 9], abs=3)


def test_control_and_pointing_leave_beside_each_other() -> None:
    """Neither takes the other's place, and taking is sent again like any harmless command."""
    bench = Bench()
    bench.hear(0, beat(), position(0), attitude(0, 90), gimbal(0, -35, 0))
    bench.perform(0.1, 5, take())
    bench.perform(0.1, 6, at_angles())
    bench.perform(0.1, 7, zoom())
    assert bench.commands() == [1001, 1000, 531]
    bench.hear(0.2, answer(1000), gimbal(200, -35, 0))
    bench.turn(0.9)
    assert bench.commands() == [1001, 1000, 531, 1001, 531]
    bench.hear(1, answer(1001), answer(531))
    assert [one.effect_seq for one in told(bench, CommandAnswered)] == [6, 5, 7]
    assert [one.effect_seq for one in told(bench, GimbalReported)][-1] == 6
    bench.perform(2, 8, take())
    bench.perform(2, 9, give_up())
    bench.perform(2, 10, take())
    assert bench.reported(CommandUnanswered) == [CommandUnanswered(effect_seq=9, attempts=0, because="superseded")]


def test_a_camera_is_found_and_zoomed_at_its_own_address() -> None:
    """Asked until it tells; its settings only where there is a zoom, and again after each zoom that was accepted."""
    bench = Bench()
    until(bench, 0, 4)
    assert (asked(bench, 259), asked(bench, 260)) == (3, 0)
    bench.hear(4, beat(), camera(), zoomed(math.nan))
    bench.hear(4.1, zoomed(12.5), zoomed(12.5))
    assert asked(bench, 260) == 1
    assert bench.reported(CameraDescribed, CameraZoomed) == [
        CameraDescribed(vehicle=1, camera=1, zooms=True),
        CameraZoomed(vehicle=1, camera=1, zoom_e4=1_250),
    ]
    bench.perform(5, 5, zoom(4_000))
    (sent,) = [one for one in bench.sent if getattr(one, "command", 0) == 531]
    assert (sent.command, sent.target_system, sent.target_component, sent.param2) == (531, 1, 100, 40)
    bench.hear(5.1, answer(531))
    assert bench.reported(CommandAnswered) == []  # the autopilot's word is not the camera's
    done = dialect.MAVLink_command_ack_message(531, 0, 0, 0, 1, 191)
    bench.hear(5.2, packed(done, component=100))
    assert len(bench.reported(CommandAnswered)) == 1
    assert asked(bench, 260) == 2
    bench.hear(5.3, zoomed(40), zoomed(41, component=101), camera(flags=0, component=101))
    assert bench.reported(CameraZoomed)[1:] == [CameraZoomed(vehicle=1, camera=1, zoom_e4=4_000)]
    bench.hear(6, camera(flags=0))
    assert bench.reported(CameraDescribed)[1:] == [CameraDescribed(vehicle=1, camera=1, zooms=False)]


def test_no_settings_are_asked_of_a_camera_without_zoom() -> None:
    bench = Bench()
    bench.hear(0, beat())
    bench.hear(0.1, camera(flags=63))
    until(bench, 0.5, 4)
    assert (asked(bench, 259), asked(bench, 260)) == (1, 0)
