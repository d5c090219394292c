"""What goes wrong in a flight, each with the record that is expected of it: checks of a mission that is being flown.

Each is given a `Mission` in the air that flies its mission, with its operator attending, and leaves it so unless its
words say otherwise. `tests.torture.flights` flies them too, at the real limits.
"""

from __future__ import annotations

import os
import resource
import signal
import threading
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

from autopilot.cli.demonstration.stage import Process
from autopilot.ground import compose
from events import Record
from events.schema.common_pb2 import Moved
from events.schema.flight_pb2 import SamplesRejected
from events.schema.safety_pb2 import FLIGHT_MODE_LAND, FLIGHT_MODE_RETURN, OverrideBegun, OverrideEnded, SetVehicleMode
from events.schema.vehicle_pb2 import (
    CommandAnswered,
    CommandSent,
    CommandUnanswered,
    GimbalControlChanged,
    PointAtAngles,
    PositionReported,
    VehicleStateReported,
)
from tests.whole.flights import Mission, verified
from tests.whole.silences import check_silences
from tests.whole.station import Station

IN_PROGRESS, ACCEPTED = 5, 0
OTHER_STATION = (255, 190)
RETURNS, LANDS = "return", "land"


def check_answer_lost(flight: Mission) -> None:
    """Sent as often as is harmless, then given up by name; the order times out, and the gimbal did it all the same."""
    flight.door.ask(unkind={"ack_lost": 1})
    outcomes, result = _point(flight, -20)
    flight.door.ask(unkind={"ack_lost": 0})
    assert [(one.because, one.attempts) for one in outcomes if isinstance(one, CommandUnanswered)] == [("no answer", 3)]
    assert [one for one in outcomes if isinstance(one, CommandAnswered)] == []
    assert result == "timeout"
    flight.truth(lambda one: abs(one["gimbal_pitch_deg"] + 20) < 2, "the gimbal")


def check_answer_twice(flight: Mission) -> None:
    """One outcome is recorded; the second answer is counted, and believed of nothing."""
    flight.door.ask(unkind={"ack_twice": 1})
    outcomes, result = _point(flight, -30)
    flight.door.ask(unkind={"ack_twice": 0})
    assert [type(one) for one in outcomes] == [CommandSent, CommandAnswered]
    assert result == "accepted"


def check_answer_of_a_stranger(flight: Mission) -> None:
    """Another system's FAILED is no answer; the vehicle's own is."""
    flight.door.ask(unkind={"ack_stranger": 1})
    outcomes, result = _point(flight, -40)
    flight.door.ask(unkind={"ack_stranger": 0})
    assert [one.mav_result for one in outcomes if isinstance(one, CommandAnswered)] == [ACCEPTED]
    assert result == "accepted"


def check_in_progress_for_ever(flight: Mission) -> None:
    """It is told, waited for, and given up by name."""
    flight.door.ask(unkind={"ack_forever": 1})
    outcomes, result = _point(flight, -50)
    flight.door.ask(unkind={"ack_forever": 0})
    assert [one.mav_result for one in outcomes if isinstance(one, CommandAnswered)] == [IN_PROGRESS]
    assert [one.because for one in outcomes if isinstance(one, CommandUnanswered)] == ["no answer"]
    assert result == "timeout"


def check_gimbal_taken(flight: Mission) -> None:
    """Another station takes the gimbal and turns it: an event, and the operator is told that it drifted and why."""
    since = flight.next_seq()
    _point(flight, -60)
    flight.status(lambda one: one.cameras[0].aim == "arrived", "the gimbal to arrive")
    flight.door.ask(take_gimbal=list(OTHER_STATION), point_gimbal=[10, 45])
    taken = flight.wait_record(lambda one: _controls(one) == OTHER_STATION, "the change of hands", since)
    status = flight.status(lambda one: one.cameras[0].aim == "drifted", "the operator to be told")
    assert "255/190" in status.cameras[0].aim_because
    assert "255/190" in status.cameras[0].gimbal_control
    flight.door.ask(take_gimbal=[0, 0])
    flight.wait_record(lambda one: _controls(one) == (0, 0), "the gimbal to be free", taken.seq)


def check_clock_jump(flight: Mission) -> None:
    """An hour in SYSTEM_TIME changes nothing: neither the node's time nor whose orders it takes."""
    before = flight.records()
    flight.door.ask(clock_jump_s=3600)
    threading.Event().wait(1.5 / flight.speed_up)  # SYSTEM_TIME comes once a second of the vehicle's time
    _, result = _point(flight, -45)
    flight.door.ask(clock_jump_s=0)
    after = flight.records()
    assert result == "accepted"
    walls = [record.at.wall_ns - record.at.mono_ns for record in (before[-1], after[-1])]
    assert abs(walls[1] - walls[0]) < 10**9
    assert before[-1].at.clock_quality == after[-1].at.clock_quality


def check_reboot(flight: Mission) -> None:
    """It is seen in another mode, nothing is commanded against it, streams come again; a person lets it go on."""
    since = flight.next_seq()
    flight.door.ask(reboot=True)
    paused = flight.wait_record(lambda one: _moves(one, "mission", "paused"), "the mission to stop", since)
    flight.wait_record(lambda one: isinstance(one.message, PositionReported), "its places", paused.seq)
    flight.status(lambda one: one.mission.state == "paused", "the operator to be told")
    assert _commands(flight.records(), paused.seq) == []
    _resume(flight)
    flight.truth(lambda one: one["doing"] == "mission", "the mission to go on")


def check_gps_jump(flight: Mission) -> int:
    """A place outside the fence: the return is commanded; return the ms from the place's record to the bytes' one."""
    since = flight.next_seq()
    flight.door.ask(gps_jump_m=[500, 0])
    command = _failsafe(flight, since, FLIGHT_MODE_RETURN, "outside an inclusion fence")
    ms = _detected_to_sent(flight, command)
    flight.truth(lambda one: one["doing"] == RETURNS, "the return")
    flight.door.ask(gps_jump_m=0)
    flight.wait_record(lambda one: _moves(one, "safety", "ok"), "the fence to hold again", command.seq)
    _back_to_the_mission(flight, since)
    return ms


def check_fence_at_speed(flight: Mission) -> tuple[int, float]:
    """Another station sends it over the fence: commanded home; return ms to the bytes, and metres beyond the fence."""
    since = flight.next_seq()
    with Station(flight.stage.ports.mavlink, OTHER_STATION) as station:
        station.fly_to(flight, 50, -160, 20)
        flight.wait_record(lambda one: _moves(one, "mission", "paused"), "the mission to stop", since)
        command = _failsafe(flight, since, FLIGHT_MODE_RETURN, "inclusion fence")
    ms = _detected_to_sent(flight, command)
    beyond_m = 0.0
    while (truth := flight.door.state())["north_m_s"] < 0.5:
        beyond_m = max(beyond_m, -40.0 - truth["north_m"])
        threading.Event().wait(0.02)
    flight.truth(lambda one: one["doing"] == RETURNS, "the return")
    flight.wait_record(lambda one: _moves(one, "safety", "ok"), "the fence to hold again", command.seq)
    _back_to_the_mission(flight, since)
    return ms, beyond_m


def check_battery(flight: Mission) -> None:
    """24 % returns, which an override holds off for its time; 14 % lands, whatever is held off. It is down then."""
    since = flight.next_seq()
    assert flight.order(compose.override("battery_return", 2.0, "the last lane")).result == "accepted"
    flight.door.ask(battery_percent=24)
    held = flight.wait_record(lambda one: _moves(one, "safety", "held_off"), "the return to be held off", since)
    begun = next(one for one in flight.records() if one.seq >= since and isinstance(one.message, OverrideBegun))
    words = begun.message
    assert isinstance(words, OverrideBegun)
    assert (words.callsign, words.reason, words.held_for_ms) == ("S-1", "the last lane", 2000)
    flight.wait_record(lambda one: isinstance(one.message, OverrideEnded), "its end", held.seq)
    command = _failsafe(flight, since, FLIGHT_MODE_RETURN, "battery at 2")
    assert command.at.flight_ns - begun.at.flight_ns >= 2 * 10**9
    flight.truth(lambda one: one["doing"] == RETURNS, "the return")
    again = flight.next_seq()
    assert flight.order(compose.override("battery_return", 60.0, "one look more")).result == "accepted"
    flight.wait_record(lambda one: _moves(one, "safety", "held_off"), "the failsafe to let go of it", again)
    _back_to_the_mission(flight, since)
    since = flight.next_seq()
    flight.door.ask(battery_percent=14)
    command = _failsafe(flight, since, FLIGHT_MODE_LAND, "battery at 1")
    assert command.seq > held.seq
    flight.truth(lambda one: one["doing"] == LANDS, "the landing")
    flight.landed()


def check_silence(flight: Mission, seconds: float, deepest: str) -> None:
    """No operator is heard for so long: the link goes down, to `deepest` at least, and back; where it is lost, home."""
    since = flight.next_seq()
    flight.away(seconds)
    heard = flight.wait_record(
        lambda one: one.kind.name == "operator_heard" and one.seq >= flight.attended_seq, "an operator to be heard"
    )
    flight.status(lambda one: one.operator_link == "ok" and one.head_seq >= heard.seq, "the link to be back")
    records = flight.records()
    seen = check_silences(records, since)
    assert not deepest or deepest in seen
    lost = "lost" in seen
    returns = {(FLIGHT_MODE_RETURN, "no operator is heard any more")} if lost else set()
    assert {(one.mode, one.because) for one in _commands(records, since)} == returns
    if lost:
        flight.truth(lambda one: one["doing"] == RETURNS, "the return")
        _back_to_the_mission(flight, since)


def check_killed_before_the_bytes(flight: Mission, well: Process) -> None:
    """The node (`tests.whole.dying`) dies between a return's record and its bytes; `well` commands it again, once."""
    flight.door.ask(battery_percent=24)
    flight.died(-signal.SIGKILL)
    assert flight.door.state()["doing"] == "mission"  # nothing has left
    flight.stage.node = well
    well.start()
    flight.truth(lambda one: one["doing"] == RETURNS, "the return")
    again = [one.seq for one in flight.records() if one.kind.name == "node_started"][-1]
    flight.wait_record(lambda one: isinstance(one.message, CommandAnswered), "the vehicle's answer", again)
    records = flight.records()
    returns = [one for one in records if isinstance(one.message, SetVehicleMode) and "battery" in one.message.because]
    assert len(returns) == 2
    started = [one.seq for one in records if one.kind.name == "node_started"]
    assert returns[0].seq < started[1] < returns[1].seq
    again_ns = flight.failsafe_again_s * 10**9
    assert returns[1].at.flight_ns - returns[0].at.flight_ns >= again_ns
    sent = [one.message.effect_seq for one in records if isinstance(one.message, CommandSent)]
    assert (sent.count(returns[0].seq), sent.count(returns[1].seq)) == (0, 1)
    assert max(Counter(sent).values()) == 1


def check_disk_full(flight: Mission, ballast: Path) -> None:
    """A full disk: recorded is in the space that the log has; when that is used up the node ends, and comes up again.

    The vehicle flies its mission by itself meanwhile. What the log has left is taken away by a limit on its files.
    """
    with ballast.open("wb", buffering=0) as file, suppress(OSError):
        while True:
            file.write(bytes(1 << 16))
    full = flight.next_seq()
    for _ in range(3):  # places of after the disk was full
        full = flight.wait_record(lambda one: isinstance(one.message, PositionReported), "a place", full).seq + 1
    first = flight.stage.flight
    resource.prlimit(flight.stage.node.pid, resource.RLIMIT_FSIZE, (1 << 16, 1 << 16))
    flight.died(os.EX_IOERR)
    assert flight.door.state()["doing"] == "mission"
    assert verified(first) == "identical"
    flight.stage.node.start()
    flight.status_since_start()
    ballast.unlink()
    flight.status(lambda one: not one.not_recording and one.armed, "the node to record again")
    since = flight.next_seq()
    flight.door.ask(battery_percent=24)
    _failsafe(flight, since, FLIGHT_MODE_RETURN, "battery at 2")
    flight.truth(lambda one: one["doing"] == RETURNS, "the return")


def rest(seconds: float) -> None:
    """Let the time of late answers pass: until then a pause waits, and may expire."""
    threading.Event().wait(seconds)


def _point(flight: Mission, pitch_deg: float) -> tuple[list[Any], str]:
    """Point the camera as an operator; return the outcomes of its effect, and the order's result."""
    since = flight.next_seq()
    answer = flight.order(compose.point_at_angles(pitch_deg, 0), by=flight.operator)
    records = flight.records()
    own = [one for one in records if one.seq >= since and isinstance(one.message, PointAtAngles) and one.message.order]
    (effect,) = own
    kinds = CommandSent | CommandAnswered | CommandUnanswered
    outcomes = [one.message for one in records if isinstance(one.message, kinds)]
    return [one for one in outcomes if one.effect_seq == effect.seq], answer.result


def rejected(records: Iterable[Record]) -> Counter[str]:
    """Return how much of what the vehicle's link heard was not believed, by reason; it is recorded each 10 s."""
    found = Counter[str]()
    for record in records:
        if isinstance(record.message, SamplesRejected):
            found.update({one.reason: one.count for one in record.message.rejected})
    return found


def _controls(record: Record) -> tuple[int, int] | None:
    message = record.message
    return (message.system_id, message.component_id) if isinstance(message, GimbalControlChanged) else None


def _moves(record: Record, chart: str, to: str) -> bool:
    message = record.message
    return isinstance(message, Moved) and message.chart == chart and message.to_state == to != message.from_state


def _commands(records: list[Record], since: int, until: int | None = None) -> list[SetVehicleMode]:
    """Return what was commanded of the flight without an order."""
    within = [one for one in records if one.seq >= since and (until is None or one.seq < until)]
    return [one.message for one in within if isinstance(one.message, SetVehicleMode) and not one.message.order]


def _failsafe(flight: Mission, since: int, mode: int, because: str) -> Record:
    """Return the first command of a failsafe, which has this mode and reason."""
    record = flight.wait_record(
        lambda one: isinstance(one.message, SetVehicleMode) and not one.message.order, "a command", since
    )
    command = record.message
    assert isinstance(command, SetVehicleMode)
    assert (command.mode, because in command.because) == (mode, True), command
    return record


def _detected_to_sent(flight: Mission, command: Record) -> int:
    """Return the ms from the record that led to a command to that of its bytes, which left."""
    sent = flight.wait_record(
        lambda one: isinstance(one.message, CommandSent) and one.message.effect_seq == command.seq, "its bytes"
    )
    led = next(one for one in flight.records() if one.seq == command.cause)
    return round((sent.at.flight_ns - led.at.flight_ns) / 1e6)


def _resume(flight: Mission) -> None:
    assert flight.order(compose.mission("resume")).result == "accepted"
    flight.status(lambda one: one.mission.state == "flying", "the mission to go on")


def _back_to_the_mission(flight: Mission, since: int) -> None:
    """Stop a return that nothing demands any more, once the vehicle has said that it returns, and go on."""

    def says(record: Record) -> bool:
        message = record.message
        return isinstance(message, VehicleStateReported) and message.flight_mode == FLIGHT_MODE_RETURN

    flight.wait_record(says, "the vehicle to say that it returns", since)
    assert flight.order(compose.mission("pause")).result == "accepted"
    flight.truth(lambda one: one["doing"] == "hold", "the vehicle to hold")
    flight.status(lambda one: one.mission.state == "paused", "the return to be stopped")
    _resume(flight)
    flight.truth(lambda one: one["doing"] == "mission", "the mission to go on")
