"""Where flights end: a stop on the ground, or some time after landing, when nothing is awaited any more."""

from __future__ import annotations

from pathlib import Path

from autopilot.node.loop import Stop
from autopilot.ports.edges import InputClass
from events.chain import FIRST_LEAF_BEFORE
from events.schema.flight_pb2 import (
    CLOSE_DISARMED,
    CLOSE_INPUT_ENDED,
    CLOSE_STOPPED,
    FlightOpened,
)
from events.schema.mission_pb2 import MissionUnavailable, MissionUploaded
from events.store import flights_in, read_flight
from tests import flying
from tests.autopilot.node.histories import Begin, check_hands_over, check_history, fly
from tests.autopilot.node.nodes import Node, config, heard_vehicle, of_kind, vehicle_state
from tests.flights import answered, place, point_at_place, published


def test_a_stop_on_the_ground_closes_and_one_in_the_air_does_not(begin: Begin, tmp_path: Path) -> None:
    """SIGTERM in the air may be a supervisor that restarts: the next start goes on."""
    node = begin().start()
    node.tell(*heard_vehicle())
    node.loop._finish(node.session, Stop(CLOSE_STOPPED))
    check_history(tmp_path, (1, ""))
    again = begin().start()
    again.tell(vehicle_state(armed=False))
    again.loop._finish(again.session, Stop(CLOSE_INPUT_ENDED))
    check_history(tmp_path, (2, "CLOSE_INPUT_ENDED"))
    third = begin().start()
    check_history(tmp_path, (2, "CLOSE_INPUT_ENDED"), (1, ""))
    check_hands_over(third.log(0), third.log(1))


def test_a_landing_closes_the_flight_after_a_while_and_the_next_begins(begin: Begin, tmp_path: Path) -> None:
    """close_after_s after disarm, not before; the manifest names the head of the flight before."""
    node = begin().start()
    fly(node)
    node.turn(after_ms=179_000)
    check_history(tmp_path, (1, ""))
    node.turn(after_ms=1_000)
    check_history(tmp_path, (1, "CLOSE_DISARMED"), (1, ""))
    check_hands_over(node.log(0), node.log(1))
    manifest = next(of_kind(node.log(1), "flight_opened"))
    reader = read_flight(flights_in(tmp_path)[0].folder)
    assert (manifest.previous_flight_id, manifest.previous_leaf) == (reader.flight_id, reader.head.leaf)
    reader.close()
    assert manifest.previous_leaf != FIRST_LEAF_BEFORE
    assert CLOSE_DISARMED == 2


def test_a_flight_that_begins_in_the_same_process_knows_its_vehicle(begin: Begin) -> None:
    """The link says only what changes, so the new flight is told what stands: else every order were refused."""
    node = begin().start()
    fly(node)
    node.turn(after_ms=181_000)
    node.turn(after_ms=200)
    assert node.kinds(1)[3:5] == ["vehicle_link_changed", "vehicle_state_reported"]
    node.tell(point_at_place("a2", order_seq=2), input_class=InputClass.ORDER)
    assert node.kinds(1).count("point_at_place") == 1


def test_a_vehicle_that_never_armed_closes_nothing(begin: Begin, tmp_path: Path) -> None:
    """Standing on the ground for a day is one flight."""
    node = begin().start()
    node.tell(*heard_vehicle(armed=False))
    node.turn(after_ms=86_400_000)
    node.turn(after_ms=200)
    check_history(tmp_path, (1, ""))


def test_arming_again_in_time_is_the_same_flight(begin: Begin, tmp_path: Path) -> None:
    """A short stop on the ground."""
    node = begin().start()
    fly(node)
    node.tell(vehicle_state(armed=True), after_ms=170_000)
    node.turn(after_ms=200)
    node.turn(after_ms=20_000)
    node.tell(vehicle_state(armed=False))
    node.turn(after_ms=200)
    node.turn(after_ms=179_000)
    check_history(tmp_path, (1, ""))
    node.turn(after_ms=1_500)
    check_history(tmp_path, (1, "CLOSE_DISARMED"), (1, ""))


def test_arming_at_the_last_moment_is_in_time(begin: Begin, tmp_path: Path) -> None:
    """What was heard counts before it is durable: a flight is not cut in the air."""
    node = begin().start()
    fly(node)
    node.turn(after_ms=179_700)
    node.tell(vehicle_state(armed=True), after_ms=150)
    node.turn(after_ms=200)
    check_history(tmp_path, (1, ""))


def test_a_flight_is_not_closed_while_an_outcome_is_awaited(begin: Begin, tmp_path: Path) -> None:
    """Outcomes name the seq of their effect, which means nothing in the next flight."""
    node = begin().start()
    node.tell(*heard_vehicle())
    node.tell(point_at_place("a1"), input_class=InputClass.ORDER)
    effect = node.performed[-1].seq
    node.tell(vehicle_state(armed=False), after_ms=200)
    node.turn(after_ms=200)
    node.turn(after_ms=181_000)
    check_history(tmp_path, (1, ""))
    (ack,) = [one.seq for one in node.performed if one.kind.name == "send_ack"]  # the order has timed out
    node.tell(published(ack))
    node.tell(answered(effect, mav_result=5))
    node.turn(after_ms=200)
    check_history(tmp_path, (1, ""))
    node.tell(answered(effect))
    node.turn(after_ms=200)
    check_history(tmp_path, (1, "CLOSE_DISARMED"), (1, ""))


def test_a_flight_is_not_closed_while_an_answer_is_on_its_way(begin: Begin, tmp_path: Path) -> None:
    """An ack's outcome names its seq too."""
    node = begin().start()
    node.tell(*heard_vehicle())
    node.tell(point_at_place("a1", roles=()), input_class=InputClass.ORDER)
    (ack,) = [one.seq for one in node.performed]
    node.tell(vehicle_state(armed=False))
    node.turn(after_ms=200)
    node.turn(after_ms=181_000)
    check_history(tmp_path, (1, ""))
    node.tell(published(ack))
    node.turn(after_ms=200)
    check_history(tmp_path, (1, "CLOSE_DISARMED"), (1, ""))


def test_an_answer_that_could_not_leave_does_not_keep_a_flight_open(begin: Begin, tmp_path: Path) -> None:
    """The operator is gone: the answer stays owed, and the next flight carries it."""
    node = begin().start()
    node.tell(*heard_vehicle())
    node.tell(point_at_place("a1"), input_class=InputClass.ORDER)
    node.tell(answered(node.performed[-1].seq))
    node.tell(published(node.performed[-1].seq, failure="no link"))
    node.tell(vehicle_state(armed=False))
    node.turn(after_ms=200)
    node.turn(after_ms=181_000)
    check_history(tmp_path, (1, "CLOSE_DISARMED"), (1, ""))
    assert [one.command_id for one in next(of_kind(node.log(1), "baseline_carried")).state.unanswered] == ["a1"]


def test_what_was_underway_before_a_restart_does_not_keep_a_flight_open(begin: Begin, tmp_path: Path) -> None:
    """Nobody will ever tell the outcome of what another process sent; landed before the restart counts too."""
    node = begin().start()
    node.tell(*heard_vehicle())
    node.tell(point_at_place("a1"), input_class=InputClass.ORDER)
    node.tell(vehicle_state(armed=False))
    node.turn(after_ms=200)
    node.kill()
    again = begin().start()
    again.tell(published(again.performed[-1].seq))
    again.turn(after_ms=200)
    again.turn(after_ms=181_000)
    check_history(tmp_path, (2, "CLOSE_DISARMED"), (1, ""))


def test_a_manifest_names_the_origin_of_the_flight_before(begin: Begin) -> None:
    """Carried, and not set again: all places stay comparable."""
    node = begin().start()
    fly(node)
    node.turn(after_ms=181_000)
    assert next(of_kind(node.log(1), "baseline_carried")).state.origin == place(0, 0)
    assert node.session.state.origin.value is not None
    assert isinstance(node.log(1)[0].message, FlightOpened)


MISSION_ID = "e351ec67-92ba-5bb1-a735-accbcdcf5a66"
OFFICE: dict[str, object] = {"enabled": True, "url": "http://127.0.0.1:9", "mission_id": MISSION_ID}

VEHICLE = {"listen": "127.0.0.1:0"}


def fly_mission(node: Node) -> None:
    """Let a pilot fly a mission that begins by itself; land, and wait until what was seen is to be pushed."""

    def asked() -> int:
        return node.performed[-1].seq

    node.tell(*heard_vehicle(armed=False))
    node.tell(MissionUnavailable(effect_seq=asked(), because="shut", attempts=1))
    plan = flying.planned()
    plan.effect_seq = asked()
    node.tell(plan)
    node.tell(flying.reported(node.heard, "pass"))
    node.tell(MissionUploaded(effect_seq=asked(), items=len(plan.items), attempts=1))
    node.tell(flying.state("mission"), after_ms=1000)
    node.tell(answered(asked()))  # the camera is turned down
    node.tell(flying.state(armed=False), after_ms=1000)
    node.turn(after_ms=15_000)
    assert node.performed[-1].kind.name == "push_observations"


def test_a_mission_keeps_no_flight_open(begin: Begin, tmp_path: Path) -> None:
    """What it asked for has come, and a push is not waited for; that it was flown is handed over all the same."""
    alone = OFFICE | {"begin": "alone", "start": "pilot", "push_s": 600}
    node = begin(settings=config(vehicle=VEHICLE, mission=alone)).start()
    fly_mission(node)
    node.turn(after_ms=164_000)
    check_history(tmp_path, (1, ""))
    node.turn(after_ms=1_000)
    check_history(tmp_path, (1, "CLOSE_DISARMED"), (1, ""))
    assert next(of_kind(node.log(1), "baseline_carried")).state.flown_revision == "a"


def test_a_plan_that_is_still_looked_for_keeps_it_open(begin: Begin, tmp_path: Path) -> None:
    """Its outcome names a seq of this flight; that no mission can be had for now is none, for good it is one."""
    node = begin(settings=config(vehicle=VEHICLE, mission=OFFICE)).start()
    node.tell(*heard_vehicle())
    effect = node.performed[-1]
    assert effect.kind.name == "fetch_mission"
    node.tell(MissionUnavailable(effect_seq=effect.seq, because="shut", attempts=1))
    node.tell(vehicle_state(armed=False), after_ms=1000)
    node.turn(after_ms=181_000)
    check_history(tmp_path, (1, ""))
    node.tell(MissionUnavailable(effect_seq=effect.seq, because="shut", attempts=8, final=True))
    node.turn(after_ms=200)
    check_history(tmp_path, (1, "CLOSE_DISARMED"), (1, ""))
