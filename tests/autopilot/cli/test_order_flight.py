"""What `autopilot order watch` says of the flight: what its orders need, and no word where all is well."""

from __future__ import annotations

import pytest

from autopilot.cli.order_flight import flight_words
from events.schema.waypoint_pb2 import FailsafeStatus, MissionStatus, NodeStatus, OverrideStatus

AWAITING = MissionStatus(
    state="selftest", mission_id="m", items=17, selftest="awaiting", report_id=41, findings=["map: skipped, none"]
)


@pytest.mark.parametrize(
    ("status", "expected"),
    [
        (NodeStatus(operator_link="ok", failsafes_enabled=True), []),
        (NodeStatus(battery_percent=0, operator_link="lost"), ["battery 0 %", "link to operators lost"]),
        (NodeStatus(mission=MissionStatus(state="linking", because="looks")), ["mission linking: looks"]),
        (
            NodeStatus(mission=MissionStatus(state="checking", unavailable="the office answers 500")),
            ["mission checking", "the office answers 500"],
        ),
        (
            NodeStatus(mission=AWAITING),
            ["mission selftest, item 1 of 17", "self-test awaiting, report 41", "map: skipped, none"],
        ),
        (
            NodeStatus(
                failsafes=[
                    FailsafeStatus(name="link", state="held off"),
                    FailsafeStatus(name="fence", state="returning"),
                ],
                overrides=[OverrideStatus(scope="link_return", callsign="S-1", reason="in sight", left_ms=61_999)],
                properties_broken=["one_master: two"],
            ),
            [
                "failsafe link held off",
                "failsafe fence returning",
                "S-1 holds link_return off for 61 s: in sight",
                "BROKEN one_master: two",
            ],
        ),
    ],
)
def test_what_is_said_of_the_flight(status: NodeStatus, expected: list[str]) -> None:
    """The number that an acknowledgement names among it."""
    assert list(flight_words(status)) == expected
