"""What a status says of an order: what the gimbal did, who commanded last, and what an operator may do."""

from __future__ import annotations

from typing import Any

import pytest

from autopilot.ground.following import Commander, Pointing, commander, permissions, pointing
from events.schema.waypoint_pb2 import CameraStatus, NodeStatus, PrincipalKind


def status(**values: Any) -> NodeStatus:
    """Return a status after record 50 with one camera."""
    camera: dict[str, Any] = {"camera": 1, "command_id": "a", "callsign": "ALPHA"} | values
    return NodeStatus(head_seq=50, cameras=[CameraStatus(camera=2, command_id="z"), CameraStatus(**camera)])


@pytest.mark.parametrize(
    ("said", "expected", "words"),
    [
        ({"aim": "moving", "error_cdeg": 900}, Pointing(state="moving", error_deg=9.0), "moving, 9.0 deg off"),
        (
            {"aim": "arrived", "error_cdeg": 40, "arrived_after_ms": 2100},
            Pointing(state="arrived", error_deg=0.4, after_s=2.1),
            "arrived, 0.4 deg off, after 2.1 s",
        ),
        ({"aim": "arrived"}, Pointing(state="arrived"), "arrived"),
        (
            {"aim": "arrived", "error_cdeg": 40, "arrived_after_ms": 2100, "aim_demanded": True},
            Pointing(state="arrived", error_deg=0.4, after_s=2.1, demanded=True),
            "commanded, 0.4 deg off, after 2.1 s, not measured",
        ),
        (
            {"aim": "drifted", "error_cdeg": 900, "aim_because": "255/190 took it"},
            Pointing(state="drifted", error_deg=9.0, because="255/190 took it"),
            "drifted: 255/190 took it",
        ),
        ({"aim": "drifted", "error_cdeg": 320}, Pointing(state="drifted", error_deg=3.2), "drifted, 3.2 deg off"),
        (
            {"aim": "missed", "aim_because": "not there in time: 9/1 controls it"},
            Pointing(state="missed", because="not there in time: 9/1 controls it"),
            "missed: not there in time: 9/1 controls it",
        ),
        # A zoom took the camera since, but the aim is still this order's.
        ({"command_id": "b", "aim_command_id": "a", "aim": "arrived"}, Pointing(state="arrived"), "arrived"),
        ({"aim": "missed", "error_cdeg": 1200}, Pointing(state="missed", error_deg=12.0), "missed, 12.0 deg off"),
        ({"aim": "idle"}, Pointing(), "waiting"),
        ({"command_id": "b", "callsign": "BRAVO"}, Pointing(state="taken", by="BRAVO"), "taken by BRAVO"),
        ({"command_id": "", "callsign": ""}, Pointing(state="over"), "nobody holds the camera any more"),
    ],
)
def test_what_the_gimbal_did(said: dict[str, Any], expected: Pointing, words: str) -> None:
    found = pointing(status(**said), "a", 1, since_seq=50)
    assert (found, found.words()) == (expected, words)
    assert found.is_done == (expected.state not in ("waiting", "moving"))


def test_a_status_from_before_the_answer_says_nothing() -> None:
    """Nor does one without the camera."""
    assert pointing(status(aim="arrived"), "a", 1, since_seq=51) == Pointing()
    assert pointing(status(aim="arrived"), "a", 3, since_seq=50) == Pointing()


def test_who_commanded_last_is_known_after_the_hold() -> None:
    """Whoever holds it; then whoever did; and nobody where nobody was seen."""
    held = commander(status(), 1, None)
    assert held == Commander("ALPHA", "a", holds=True)
    free = status(command_id="", callsign="")
    assert commander(free, 1, held) == Commander("ALPHA", "a", holds=False)
    assert commander(free, 1, None) is None
    assert commander(free, 7, None) is None
    assert commander(status(command_id="b", callsign="BRAVO"), 1, held) == Commander("BRAVO", "b", holds=True)


GOOD: dict[str, Any] = {"command_enabled": True, "health": "normal", "camera_roles": ["operator", "admin"]}


@pytest.mark.parametrize(
    ("change", "kind", "roles", "states", "because"),
    [
        ({}, PrincipalKind.OPERATOR, ["operator"], {}, ""),
        ({}, PrincipalKind.OPERATOR, ["x", "admin"], {}, ""),
        ({}, PrincipalKind.SERVICE, ["operator"], {}, "only operators give orders"),
        ({}, PrincipalKind.OPERATOR, ["viewer"], {}, "needs one of the roles admin, operator"),
        ({}, PrincipalKind.OPERATOR, [], {}, "needs one of the roles admin, operator"),
        ({"camera_roles": []}, PrincipalKind.OPERATOR, ["operator"], {}, "the node allows it to nobody"),
        ({}, PrincipalKind.NODE, ["operator"], {}, "only operators give orders"),
        ({}, PrincipalKind.OPERATOR, ["operator"], {"revoked": True}, "this identity is revoked"),
        ({}, PrincipalKind.OPERATOR, ["operator"], {"expired": True}, "this identity has expired"),
        ({"command_enabled": False}, PrincipalKind.OPERATOR, [], {}, "orders are switched off on this node"),
        ({"health": "safe mode"}, PrincipalKind.OPERATOR, ["operator"], {}, "the node is in safe mode"),
        ({"health": "safe mode"}, PrincipalKind.OPERATOR, ["x"], {}, "needs one of the roles admin, operator"),
        ({"not_recording": "disk"}, PrincipalKind.OPERATOR, ["operator"], {}, "the node takes no orders: disk"),
    ],
)
def test_what_an_operator_may_do_and_why_not(
    change: dict[str, Any], kind: PrincipalKind.ValueType, roles: list[str], states: dict[str, bool], because: str
) -> None:
    """The first of the node's own reasons, in its order."""
    asked = {"revoked": False, "expired": False} | states
    camera, flight = permissions(NodeStatus(**(GOOD | change)), kind, roles, **asked)
    assert (camera.what, camera.allowed, camera.because) == ("camera", not because, because)
    assert (flight.what, flight.allowed) == ("flight", False)


def test_the_flight_has_a_list_of_its_own() -> None:
    """A role for the one is none for the other."""
    said = NodeStatus(**GOOD, flight_roles=["pilot"])
    camera, flight = permissions(said, PrincipalKind.OPERATOR, ["pilot"], revoked=False, expired=False)
    assert (camera.allowed, flight.allowed) == (False, True)
