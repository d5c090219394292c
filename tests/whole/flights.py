"""A mission on the demo's stage, with the door of its world in a test's hand; nothing here checks anything.

The world runs `speed_up` times as fast as the node's clock. What the node waits for in the vehicle's own time (late
answers, the distance between two places) is configured that much shorter; the limits of [safety] are not.
"""

from __future__ import annotations

import json
import math
import socket
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

from autopilot.cli.demonstration.cast import NODE
from autopilot.cli.demonstration.mission_stage import MissionStage, Polygon, mission, place
from autopilot.ground import compose
from autopilot.ground.attending import PRESENCE_S
from autopilot.ground.issuer import Issuer
from autopilot.ground.ledger import Answer
from events import Record, read_record
from events.schema.waypoint_pb2 import DeviceCommand, NodeStatus
from events.store import StoreFailed, read_flight
from replay.verify import verify

WITHIN_S = 40.0
LIFE_S = 10.0
LOOK_S = 0.05
REGION_M: Polygon = ((20.0, 15.0), (80.0, 15.0), (80.0, 60.0), (20.0, 60.0))
INCLUSION_M: Polygon = ((-40.0, -40.0), (130.0, -40.0), (130.0, 100.0), (-40.0, 100.0))
EXCLUSION_M: Polygon = ((92.0, 70.0), (112.0, 70.0), (112.0, 90.0), (92.0, 90.0))
SMALL = mission((10.0, 10.0), REGION_M, INCLUSION_M, EXCLUSION_M)
# A plane needs room for its turns.
WIDE = mission(
    (60.0, 120.0),
    ((40.0, 150.0), (160.0, 150.0), (160.0, 230.0), (40.0, 230.0)),
    ((-700.0, -700.0), (1100.0, -700.0), (1100.0, 1100.0), (-700.0, 1100.0)),
    ((900.0, 900.0), (950.0, 900.0), (950.0, 950.0), (900.0, 950.0)),
)
# Nobody gets to the end of this one while a test lasts.
LONG = mission(
    (10.0, 10.0),
    ((20.0, 15.0), (320.0, 15.0), (320.0, 220.0), (20.0, 220.0)),
    ((-40.0, -40.0), (350.0, -40.0), (350.0, 250.0), (-40.0, 250.0)),
    EXCLUSION_M,
)


class Door:
    """The way into the simulated world."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=10)
        self._lines = self._socket.makefile("rw", encoding="utf-8")

    def ask(self, **order: Any) -> dict[str, Any]:
        """Do something to the world. Raises RuntimeError where it can't be done."""
        self._lines.write(json.dumps(order) + "\n")
        self._lines.flush()
        answer: dict[str, Any] = json.loads(self._lines.readline())
        if "error" in answer:
            raise RuntimeError(answer["error"])
        return answer

    def state(self) -> dict[str, Any]:
        """Return the truth."""
        truth: dict[str, Any] = self.ask(state=True)["state"]
        return truth

    def close(self) -> None:
        """Go."""
        self._lines.close()
        self._socket.close()


class Mission:
    """A stage, a supervisor, a door."""

    def __init__(
        self,
        folder: Path,
        *,
        personality: str = "ardupilot",
        frame: str = "copter",
        speed_up: float = 5,
        flies: dict[str, Any] = SMALL,
        failsafe_again_s: int = 1,
    ) -> None:
        self.stage = MissionStage(folder, 3, personality=personality, frame=frame, speed_up=speed_up, flies=flies)
        self.speed_up = speed_up
        self.attended_seq = 0  # what was recorded from here on was so when somebody was back
        self.failsafe_again_s = failsafe_again_s
        self.configure("safety", failsafe_again_s=self.failsafe_again_s)
        self.configure(
            "vehicle",
            late_answer_s=3 / speed_up,
            in_progress_timeout_s=3 / speed_up,
            position_period_s=round(0.5 / speed_up, 3),
        )
        self.operator = Issuer(self.stage.cast.first, [self.stage.endpoint], reconnect_ms=100)
        self.supervisor = Issuer(self.stage.cast.supervisor, [self.stage.endpoint], reconnect_ms=100)
        self.door: Door

    def configure(self, section: str, **settings: Any) -> None:
        """Put settings into a section of the node's configuration, in the place of those that are there."""
        config = self.stage.config
        lines = config.read_text().splitlines()
        at = lines.index(f"[{section}]") if f"[{section}]" in lines else len(lines)
        if at == len(lines):
            lines.append(f"[{section}]")
        end = next((n for n in range(at + 1, len(lines)) if lines[n].startswith("[")), len(lines))
        kept = [line for line in lines[at + 1 : end] if line.partition(" = ")[0] not in settings]
        new = [f"{key} = {json.dumps(value)}" for key, value in settings.items()]
        config.write_text("\n".join([*lines[: at + 1], *new, *kept, *lines[end:]]) + "\n")

    def __enter__(self) -> Self:
        self.stage.__enter__()
        try:
            self.door = Door(self.stage.ports.door)
            for issuer in (self.supervisor, self.operator):
                issuer.start()
                issuer.watch(NODE)
            self.supervisor.attend(NODE)
        except BaseException:
            self.stage.__exit__()
            raise
        return self

    def __exit__(self, *_error: object) -> None:
        self.door.close()
        self.supervisor.stop()
        self.operator.stop()
        self.stage.__exit__()

    def status(self, until: Callable[[NodeStatus], bool], what: str, within_s: float = WITHIN_S) -> NodeStatus:
        """Wait for a status. Raises TimeoutError."""
        seen = self.supervisor.wait_status(NODE, until, within_s)
        if seen is None:
            last = self.supervisor.status(NODE)
            raise TimeoutError(f"waited {within_s:.0f} s for {what}; {None if last is None else last.status.mission}")
        return seen.status

    def status_since_start(self) -> str:
        """Return what the node says of recording, of its present start."""
        now_ms = time.time_ns() // 1_000_000
        return self.status(lambda one: one.at_ms > now_ms, "a status").not_recording

    def truth(self, until: Callable[[dict[str, Any]], bool], what: str, within_s: float = WITHIN_S) -> dict[str, Any]:
        """Wait until the world is so. Raises TimeoutError."""
        give_up_at_s = time.monotonic() + within_s
        while not until(truth := self.door.state()):
            if time.monotonic() > give_up_at_s:
                raise TimeoutError(f"waited {within_s:.0f} s for {what}: {truth}")
            threading.Event().wait(LOOK_S)
        return truth

    def order(self, command: DeviceCommand, *, by: Issuer | None = None) -> Answer:
        """Order something as the supervisor, or as somebody else, and return the last word."""
        issuer = by or self.supervisor
        assert issuer.wait_status(NODE, lambda _: True, WITHIN_S) is not None
        return issuer.wait(issuer.send(NODE, command, LIFE_S))

    def begin(self) -> None:
        """Take the self-test on, and let the mission begin."""
        status = self.status(lambda one: one.mission.selftest in ("passed", "awaiting", "failed"), "the self-test")
        if status.mission.selftest == "awaiting":
            assert self.order(compose.acknowledge(status.mission.report_id)).result == "accepted"
        self.status(lambda one: one.mission.selftest == "passed", "the self-test")
        answer = self.order(compose.mission("begin"))
        assert answer.result == "accepted", answer

    def take_off(self, height_m: float = 10.0) -> None:
        """Begin, and wait until it flies its mission."""
        self.begin()
        self.truth(lambda one: one["up_m"] > height_m, "take-off")
        self.status(lambda one: one.mission.state == "flying", "the mission to fly")

    def died(self, code: int) -> None:
        """Wait until the node has ended by itself, with this code. Raises TimeoutError."""
        give_up_at_s = time.monotonic() + WITHIN_S
        while self.stage.node.running:
            if time.monotonic() > give_up_at_s:
                raise TimeoutError(f"waited {WITHIN_S:.0f} s for the node to end")
            threading.Event().wait(LOOK_S)
        assert self.stage.node.stop() == code

    def landed(self) -> None:
        """Wait until it is down and disarmed, and the mission over."""
        self.truth(lambda one: not one["armed"], "the landing", 2 * WITHIN_S)
        self.status(lambda one: not one.armed, "the landing to be heard of")

    def pushed(self) -> tuple[int, int]:
        """Wait until the mission is done; return how many observations and ignored items the office has."""
        self.status(lambda one: one.mission.state == "done", "the push", 2 * WITHIN_S)
        return self.stage.with_the_office()

    def wait_record(
        self, until: Callable[[Record], bool], what: str, since: int = 0, within_s: float = WITHIN_S
    ) -> Record:
        """Wait until such a record is durable. Raises TimeoutError."""
        give_up_at_s = time.monotonic() + within_s
        while True:
            found = next((record for record in self.records() if record.seq >= since and until(record)), None)
            if found is not None:
                return found
            if time.monotonic() > give_up_at_s:
                raise TimeoutError(f"waited {within_s:.0f} s for {what}")
            threading.Event().wait(LOOK_S)

    def away(self, seconds: float) -> None:
        """Let nobody attend for so long after the last word that was recorded, give or take half a second."""
        self.wait_record(lambda one: one.kind.name == "operator_heard", "a word of an operator", self.next_seq())
        self.supervisor.leave(NODE)
        threading.Event().wait(seconds - PRESENCE_S / 2)
        self.attended_seq = self.next_seq()
        self.supervisor.attend(NODE)

    def next_seq(self) -> int:
        """Return the number of the record that comes next."""
        return self.records()[-1].seq + 1

    def records(self, flight: Path | None = None) -> list[Record]:
        """Return what is durable of the newest flight, or of this one."""
        while True:
            try:
                reader = read_flight(flight or self.stage.flight)
            except StoreFailed:  # a moment before its first commit
                threading.Event().wait(LOOK_S)
                continue
            try:
                return [read_record(stored) for stored in reader.stored()]
            finally:
                reader.close()

    def ended(self) -> list[Record]:
        """Stop the node and return the log of its flight, which replays identically."""
        flight = self.stage.flight
        assert self.stage.node.stop() == 0
        assert verified(flight) == "identical"
        return self.records(flight)


def verified(flight: Path) -> str:
    """Return what `replay verify` says of a flight, the properties that were broken included."""
    reader = read_flight(flight)
    try:
        verdict = verify(reader)
        return verdict.outcome.value if verdict.holds else verdict.words()
    finally:
        reader.close()


def corners(polygon: Polygon) -> list[list[float]]:
    """Return a polygon for the door."""
    return [[place(*one)["latitude"], place(*one)["longitude"]] for one in polygon]


def away_m(truth: dict[str, Any], east_m: float = 0, north_m: float = 0) -> float:
    """Return how far it truly is from a point."""
    return math.dist((truth["east_m"], truth["north_m"]), (east_m, north_m))


class Track:
    """Where the vehicle truly was while it flew level, until it is disarmed again."""

    def __init__(self, door: Door, at_least_m: float = 28.0) -> None:
        self.points: list[tuple[float, float]] = []
        self._door, self._at_least_m, self._flew = door, at_least_m, False

    def note(self, truth: dict[str, Any]) -> bool:
        """Take where it is; say whether it has flown and is down."""
        self._flew = self._flew or truth["up_m"] > 1
        if truth["up_m"] >= self._at_least_m:
            self.points.append((truth["east_m"], truth["north_m"]))
        return self._flew and not truth["armed"]
