"""What happens in the demo, scene by scene, told in words while it happens.

Each scene does what a person would do and then looks at what the node itself says became of it: nothing that is
printed here is known beforehand. A scene whose expectation does not come true raises `Surprise`.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass

from autopilot.cli.demonstration.cast import NODE
from autopilot.cli.demonstration.stage import Stage
from autopilot.geo.frame import offset
from autopilot.ground import compose
from autopilot.ground.issuer import Issuer
from autopilot.ground.ledger import Answer, Order
from autopilot.sim.aircraft import HOME
from autopilot.sim.route import Route
from autopilot.wire.keys import order_key
from events.schema.waypoint_pb2 import CameraStatus, NodeStatus, PoiStatus

WHOLE_STORY_S = 45.0
ROUTER_AWAY_S = 5.0
ORDER_LIFE_S = 15.0
LOOK_AGAIN_S = 2.5

Say = Callable[[str], None]


class Surprise(RuntimeError):
    """The demo did not go as it should: a defect, or a machine that is far too slow."""


@dataclass(frozen=True, slots=True)
class Consoles:
    """What each of the cast sits at."""

    first: Issuer
    second: Issuer
    supervisor: Issuer
    viewer: Issuer
    forger: Issuer

    @classmethod
    def of(cls, stage: Stage) -> Consoles:
        """Make a console for each; nothing is connected yet."""
        cast = stage.cast
        people = (cast.first, cast.second, cast.supervisor, cast.viewer, cast.forger)
        return cls(*(Issuer(identity, [stage.endpoint], reconnect_ms=250) for identity in people))

    def __enter__(self) -> Consoles:
        for issuer in self._all:
            issuer.start()
        for operator in (self.first, self.second):
            operator.attend(NODE)
        return self

    def __exit__(self, *_error: object) -> None:
        for issuer in self._all:
            issuer.stop()

    @property
    def _all(self) -> tuple[Issuer, ...]:
        return self.first, self.second, self.supervisor, self.viewer, self.forger


class Story:
    """The scenes, and who tells them."""

    def __init__(self, stage: Stage, consoles: Consoles, route: Route, say: Say) -> None:
        self.stage = stage
        self.first, self.second = consoles.first, consoles.second
        self.viewer, self.forger = consoles.viewer, consoles.forger
        self.route = route
        self.say = say
        self._began = time.monotonic()

    def tell(self, *, whole: bool) -> None:
        """Play all scenes up to the landing; without `whole` only those that a short flight has time for."""
        self._node_comes_up()
        order = self._camera_points_at_a_place()
        self._not_before(0.22)
        self._same_order_again(order)
        self._strangers(order)
        if whole:
            self._not_before(0.32)
            self._last_write_wins()
        self._not_before(0.42)
        self._release()
        self._not_before(0.55)
        self._findings(whole=whole)
        if whole:
            self._router_goes_away()
        self._landing()

    def _not_before(self, part: float) -> None:
        """Let the flight get so far first: a person takes a while to look, and the reader wants to follow."""
        time.sleep(max(self._began + part * self.route.seconds - time.monotonic(), 0))

    def _node_comes_up(self) -> None:
        status = self._wait(lambda status: status.vehicle_link and status.HasField("latitude_e7"), "the node", 20)
        self.say(
            f"{NODE} is up: MAVLink is heard, position {status.latitude_e7 / 1e7:.5f} {status.longitude_e7 / 1e7:.5f}. "
            f"It records in {self.stage.flight.name}."
        )
        self._wait(lambda status: status.armed and status.height_mm > 3000, "take-off", 30)
        self.say("The aircraft has taken off and flies its own route; the node only watches and points the camera.")

    def _camera_points_at_a_place(self) -> Order:
        latitude, longitude = offset(HOME[0], HOME[1], *self.route.centre_m)
        command = compose.point_at_place(latitude, longitude, HOME[2])
        self.say(f"K-1 points the camera at {latitude:.5f} {longitude:.5f}, {HOME[2]:.0f} m AMSL.")
        order = self.first.send(NODE, command, ORDER_LIFE_S)
        answer = self.first.wait(order)
        self._expect(answer, "accepted")
        camera = _camera(self._wait(lambda status: _camera(status).aim in ("arrived", "missed"), "the gimbal", 12))
        self.say(
            f"  answer: {answer.result} ({answer.detail}). Held by {camera.callsign}. "
            f"Measured on the gimbal: {_aim(camera)}."
        )
        return order

    def _same_order_again(self, order: Order) -> None:
        again = self.first.repeat(order, ORDER_LIFE_S)
        answer = self.first.wait(again)
        self._expect(answer, "accepted")
        if not answer.duplicate:
            raise Surprise("a repeated order was not recognised as a duplicate")
        self.say(f"K-1's console sends it again: answered with the first result ({answer.result}), not done twice.")

    def _strangers(self, order: Order) -> None:
        before = _dropped(self._status())
        self.forger.know_node(NODE, order.node_key)
        forged = self.forger.send(NODE, compose.point_at_angles(-90, 0), 4)
        self.first.publish_raw(order_key(NODE, forged.command_id), os.urandom(300))
        refused = self.viewer.wait(self.viewer.send(NODE, compose.point_at_angles(-90, 0), ORDER_LIFE_S))
        self._expect(refused, "unauthorised")
        now = _dropped(
            self._wait(lambda status: sum(_dropped(status).values()) >= sum(before.values()) + 2, "the gate", 8)
        )
        fresh = {
            reason: count - before.get(reason, 0) for reason, count in now.items() if count > before.get(reason, 0)
        }
        counted = ", ".join(f"{reason} {count}" for reason, count in sorted(fresh.items()))
        self.say(
            f"A forger who calls himself K-1, and plain garbage: dropped without an answer and counted ({counted})."
        )
        self.say(f"V-1, a viewer, tries too: {refused.result} ({refused.detail}).")

    def _last_write_wins(self) -> None:
        answer = self.second.wait(self.second.send(NODE, compose.point_at_angles(-40, 90), ORDER_LIFE_S))
        self._expect(answer, "accepted")
        camera = _camera(self._wait(lambda status: _camera(status).callsign == "K-2", "the camera's new holder", 8))
        self.say(
            f"K-2 turns the camera to the right: {answer.result}. Last write wins; all see whose: {camera.callsign}."
        )

    def _release(self) -> None:
        answer = self.second.wait(self.second.send(NODE, compose.release(), ORDER_LIFE_S))
        self._expect(answer, "accepted")
        self.say("K-2 releases the camera; after a pause the node itself looks closer at what it finds.")

    def _router_goes_away(self) -> None:
        self.say(f"The router stands still for {ROUTER_AWAY_S:.0f} s. K-1 orders the camera to look ahead meanwhile.")
        self.stage.router.pause()
        order = self.first.send(NODE, compose.point_at_angles(-30, 0), ORDER_LIFE_S)
        time.sleep(ROUTER_AWAY_S)
        self.stage.router.resume()
        answer = self.first.wait(order)
        self._expect(answer, "accepted")
        times = len(order.envelopes)
        if times < 2:
            raise Surprise("the order was not published again")
        self.say(f"  it is back: the order was published {times} times, and done once: {answer.result}.")

    def _findings(self, *, whole: bool) -> None:
        asked = self._wait_for_questions()
        if whole and len(asked) < 2:
            raise Surprise(f"the node asks about {len(asked)} finding(s); two are needed")
        if not asked:
            self.say("Nothing was found that a person would have to look at.")
            return
        surest, doubtful = asked[0], asked[-1]
        self.say(f"The node asks about {len(asked)} finding(s): {', '.join(_finding(poi) for poi in asked)}.")
        confirmed = self.first.wait(self.first.send(NODE, compose.judge(surest.poi_id, confirmed=True), ORDER_LIFE_S))
        self._expect(confirmed, "accepted")
        self.say(f"K-1 confirms the {_finding(surest)}: {confirmed.result}.")
        if doubtful.poi_id == surest.poi_id:
            return
        declined = self.second.wait(
            self.second.send(NODE, compose.judge(doubtful.poi_id, confirmed=False), ORDER_LIFE_S)
        )
        self._expect(declined, "accepted")
        self.say(f"K-2 declines the {_finding(doubtful)}: {declined.result}. What is like it and near it stays quiet.")
        if whole:
            self._look_again(doubtful)

    def _look_again(self, declined: PoiStatus) -> None:
        """Point at what was declined: it is seen again, and nobody is asked again."""
        place = compose.point_at_place(declined.latitude_e7 / 1e7, declined.longitude_e7 / 1e7, HOME[2])
        self._expect(self.second.wait(self.second.send(NODE, place, ORDER_LIFE_S)), "accepted")
        camera = _camera(self._wait(lambda status: _camera(status).aim in ("arrived", "missed"), "the gimbal", 12))
        time.sleep(LOOK_AGAIN_S)
        if any(poi.mgrs == declined.mgrs and poi.class_name == declined.class_name for poi in self._status().pois):
            raise Surprise("a declined finding was asked about again")
        self.say(f"K-2 looks at it once more ({_aim(camera)}): no question.")

    def _wait_for_questions(self) -> list[PoiStatus]:
        """Wait for two questions, or until the aircraft is on its way down."""
        self.first.wait_status(NODE, lambda status: len(status.pois) >= 2 or not status.armed, self.route.seconds / 4)
        return sorted(self._status().pois, key=lambda poi: -poi.confidence_e4)

    def _landing(self) -> None:
        status = self._wait(lambda status: not status.armed, "the landing", self.route.seconds + 20)
        self.say(f"Landed and disarmed. {status.map_objects} objects are on the map.")

    def _status(self) -> NodeStatus:
        seen = self.first.status(NODE)
        if seen is None:
            raise Surprise(f"{NODE} says nothing of itself")
        return seen.status

    def _wait(self, until: Callable[[NodeStatus], bool], what: str, timeout_s: float) -> NodeStatus:
        seen = self.first.wait_status(NODE, until, timeout_s)
        if seen is None:
            raise Surprise(f"waited {timeout_s:.0f} s for {what}")
        return seen.status

    def _expect(self, answer: Answer, result: str) -> None:
        if answer.result != result:
            raise Surprise(f"expected {result}, got {answer.result or answer.state}: {answer.detail}")


def _camera(status: NodeStatus) -> CameraStatus:
    return status.cameras[0] if status.cameras else CameraStatus()


def _aim(camera: CameraStatus) -> str:
    if camera.aim == "arrived":
        return f"arrived, {camera.error_cdeg / 100:.1f} deg off, after {camera.arrived_after_ms / 1000:.1f} s"
    return f"not there yet, {camera.error_cdeg / 100:.1f} deg off"


def _dropped(status: NodeStatus) -> dict[str, int]:
    return {each.reason: each.count for each in status.dropped}


def _finding(poi: PoiStatus) -> str:
    return f"{poi.class_name} at {poi.mgrs} ({poi.confidence_e4 / 100:.0f} %)"
