"""The demo's second act: a mission is fetched, planned, tested for, uploaded, flown, landed, and what it saw pushed.

A supervisor lets it begin; the node does the rest. As in the first act, what is told is what the node says of itself,
and an expectation that does not come true raises `Surprise`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from autopilot.cli.demonstration.cast import NODE
from autopilot.cli.demonstration.mission_stage import MissionStage
from autopilot.cli.demonstration.story import Surprise
from autopilot.ground import compose
from autopilot.ground.issuer import Issuer
from events.schema.waypoint_pb2 import DeviceCommand, NodeStatus

ORDER_LIFE_S = 15.0
PLANNED_WITHIN_S = 40.0
FLOWN_WITHIN_S = 240.0
PUSHED_WITHIN_S = 120.0

Say = Callable[[str], None]


class MissionAct:
    """The scenes, and who tells them."""

    def __init__(self, stage: MissionStage, supervisor: Issuer, operator: Issuer, say: Say) -> None:
        self.stage, self.supervisor, self.operator, self.say = stage, supervisor, operator, say

    def tell(self) -> None:
        """Play all scenes up to the landing and the push after it."""
        self.supervisor.attend(NODE)
        self._planned()
        self._tested()
        self._begun()
        self._flown()
        self._pushed()

    def _planned(self) -> None:
        status = self._wait(lambda one: bool(one.mission.mission_id), "the mission", PLANNED_WITHIN_S)
        one = status.mission
        self.say(
            f"{NODE} fetched mission {one.mission_id[:8]} from the office over HTTP and planned it: "
            f"{one.items} items, {one.fences} fences."
        )

    def _tested(self) -> None:
        status = self._wait(lambda one: one.mission.selftest in ("passed", "awaiting", "failed"), "the self-test", 30)
        for finding in status.mission.findings:
            self.say(f"  self-test, {finding}")
        if status.mission.selftest == "failed":
            raise Surprise("the self-test failed")
        if status.mission.selftest == "awaiting":
            self._order(self.supervisor, compose.acknowledge(status.mission.report_id), "accepted")
            self.say(f"It is degraded: S-1 takes that on, by a signed order for report {status.mission.report_id}.")
        self._wait(lambda one: one.mission.selftest == "passed", "the self-test", 10)
        self.say("The self-test has passed.")

    def _begun(self) -> None:
        self._order(self.operator, compose.mission("begin"), "unauthorised")
        self.say("K-1, who may point the camera, tries to begin the mission: unauthorised.")
        self._order(self.supervisor, compose.mission("begin"), "accepted")
        self._wait(lambda one: one.armed, "the vehicle to arm", 60)
        self.say("S-1 lets it begin: the plan is in the vehicle and was read back, and the motors are armed.")
        self._wait(lambda one: one.height_mm > 10_000 and one.mission.state == "flying", "take-off", 60)
        self.say("Taken off; it flies the mission by itself.")

    def _flown(self) -> None:
        told = 0
        while True:
            status = self._wait(partial(_news, told), "the mission", FLOWN_WITHIN_S)
            one = status.mission
            if one.state == "flying" and one.next_item > told:
                told = one.next_item + max(one.items // 4, 1) - 1
                self.say(f"  at item {one.next_item + 1} of {one.items}")
                continue
            break
        if one.state not in ("returning", "landed", "syncing", "done"):
            raise Surprise(f"the mission is {one.state}: {one.because}")
        self.say(f"The mission is over: {one.because}.")
        self._wait(lambda status: not status.armed, "the landing", FLOWN_WITHIN_S)
        self._wait(lambda status: status.mission.state in ("landed", "syncing", "done"), "the mission's end", 20)
        seen = self.stage.seen_percent()
        self.say(f"Landed and disarmed. Of the region that was to be searched the camera has truly seen {seen:.1f} %.")

    def _pushed(self) -> None:
        one = self._wait(lambda status: status.mission.state == "done", "the push", PUSHED_WITHIN_S).mission
        observations, ignored_items = self.stage.with_the_office()
        kept = f"{observations} observations and {ignored_items} ignored items are with the mission office"
        if one.pushed != kept:
            raise Surprise(f"{kept}, but the node says: {one.pushed or one.because}")
        self.say(f"What was seen is pushed: {kept}. The mission is done.")

    def _order(self, issuer: Issuer, command: DeviceCommand, result: str) -> None:
        answer = issuer.wait(issuer.send(NODE, command, ORDER_LIFE_S))
        if answer.result != result:
            raise Surprise(f"expected {result}, got {answer.result or answer.state}: {answer.detail}")

    def _wait(self, until: Callable[[NodeStatus], bool], what: str, timeout_s: float) -> NodeStatus:
        seen = self.supervisor.wait_status(NODE, until, timeout_s)
        if seen is None:
            raise Surprise(f"waited {timeout_s:.0f} s for {what}")
        return seen.status


def _news(told: int, status: NodeStatus) -> bool:
    """Whether there is something to tell: it got farther, or it is not flying any more."""
    return status.mission.state not in ("flying", "engaging") or status.mission.next_item > told
