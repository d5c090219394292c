"""A simulated vehicle that flies what it is told over MAVLink 2: ArduPilot or PX4, copter or plane, system 1/1.

No socket and no clock: `step` moves its time, `hear` takes a datagram, `take` gives those that are due.
It is a small world to edit between steps: `vehicle.flight.battery.charge_percent = 12`,
`vehicle.flight.gps.jump_east_m = 500`, `vehicle.unkind.ack_lost = 1`, `vehicle.outward.weather.lost = 0.3`,
`vehicle.clock_jump_s = 3600`, `vehicle.reboot()`. The same seed and the same calls give the same flight.
Time of everything, the protocols' too, is that of `step`.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from typing import Any, Literal

from pymavlink.dialects.v20 import common as dialect

from autopilot.geo import LocalFrame
from autopilot.sim import personality_ardupilot, personality_px4
from autopilot.sim.aircraft import COMPONENT, HOME, SYSTEM, command_of
from autopilot.sim.answers import ACCEPTED, DENIED, FAILED, UNSUPPORTED, Command, Desk
from autopilot.sim.flight import STEP_S, FixedWing, Multirotor
from autopilot.sim.flying import Flight
from autopilot.sim.gimbal import Angles, Gimbal
from autopilot.sim.missions import ROI_NONE, ROI_OLD, ROI_PLACE, Item
from autopilot.sim.modes import Doing
from autopilot.sim.personality_ardupilot import ArduPilot
from autopilot.sim.personality_px4 import Px4
from autopilot.sim.post import US, Post
from autopilot.sim.route import Motion
from autopilot.sim.transfer import Address, Transfer
from autopilot.sim.unkind import Unkind, answers_of, form_refused
from autopilot.sim.vehicle_messages import ARDUPILOT_UNASKED_S, BUILDERS, PX4_UNASKED_S, VehicleInstant

PersonalityName = Literal["ardupilot", "px4"]
FrameName = Literal["copter", "plane"]

REBOOT_S = 3.0
TIMESYNC_S = 10.0
UNIX_S = 1_767_225_600.0  # 2026-01-01, where the caller gives no other time
NOTICE = 5  # MAV_SEVERITY
MISSION_MESSAGES = frozenset(range(39, 48)) | {51, 73}


class Vehicle:
    """One vehicle; whoever speaks becomes a peer, answers go to who asked, streams to all."""

    def __init__(
        self,
        seed: int,
        personality: PersonalityName = "ardupilot",
        frame: FrameName = "copter",
        home: tuple[float, float, float] = HOME,
        unix_s: float = UNIX_S,
    ) -> None:
        module = personality_ardupilot if personality == "ardupilot" else personality_px4
        self.home = LocalFrame(*home)
        self.flight: Flight = module.flight_of(Multirotor() if frame == "copter" else FixedWing(), self.home)
        self.flight.on_do = self._do
        self._unasked_s = ARDUPILOT_UNASKED_S if personality == "ardupilot" else PX4_UNASKED_S
        self.desk = Desk(self.home, periods_s=dict(self._unasked_s), known=frozenset(BUILDERS))
        self.personality: ArduPilot | Px4 = (ArduPilot if personality == "ardupilot" else Px4)(self.flight, self.desk)
        self.transfer = Transfer(module.RULES, self.flight)
        self.unkind = Unkind()
        self._post = Post(seed)
        self.inward, self.outward = self._post.inward, self._post.outward
        self.time_s = 0.0
        self.clock_jump_s = 0.0  # how wrong SYSTEM_TIME is
        self.gimbal_fitted = True  # without one a copter turns its nose to what it is to look at
        self.ground_station_lost_s: float | None = None  # returns when no ground station is heard for so long
        self._unix_s = unix_s
        self._chance = random.Random(f"vehicle {seed}")
        self._steps = 0
        self._booted_s = 0.0
        self._silent_until_s = 0.0
        self._ground_heard_s = 0.0
        self._timesync_s = 0.0
        self._next_s: dict[int, float] = {}

    @property
    def gimbal(self) -> Gimbal:
        """The gimbal, to look at or to change."""
        return self.desk.gimbal

    @property
    def custom_mode(self) -> int:
        """The mode as HEARTBEAT tells it."""
        return self.personality.modes[self.flight.doing]

    @property
    def motion(self) -> Motion:
        """Where it truly is and how it moves."""
        return self.flight.motion(self.custom_mode)

    def step(self, dt_s: float) -> None:
        """Let time pass; the flight goes on in steps of a fixed length."""
        self.time_s += dt_s
        while (self._steps + 1) * STEP_S <= self.time_s + 1e-9:
            self._steps += 1
            self.flight.step()
            self.gimbal.step(STEP_S, self.flight.motion(self.custom_mode, seen=True))
            self._watch_ground_station()
        self._listen()
        if not self._silent:
            self._answer_all(self.transfer.tick(self.time_s))

    def meet(self, peer: Address) -> None:
        """Send to this address from now on; whoever speaks is met by itself."""
        self._post.meet(self.time_s, peer)

    def hear(self, peer: Address, datagram: bytes) -> None:
        """Take a datagram, when the link lets it through; what isn't MAVLink is dropped."""
        self.inward.put(self.time_s, (peer, datagram))
        self._listen()

    def take(self) -> list[tuple[Address, bytes]]:
        """Return the datagrams that have come through the link until now, in order."""
        if not self._silent:
            self._post.send(self.time_s, self._stream())
        return self.outward.due(self.time_s)

    def reboot(self, silent_s: float = REBOOT_S) -> None:
        """Start the autopilot again, as its watchdog does in flight: armed it stays armed, and holds as a pilot would.

        It says nothing for a while; streams that were asked for, uploads and gimbal control are forgotten, the
        mission and home are not.
        """
        self._silent_until_s = self._booted_s = self.time_s + silent_s
        self.desk.periods_s = dict(self._unasked_s)
        self.desk.requested.clear()
        self.gimbal.primary = (0, 0)
        self._post.burn()
        self._next_s.clear()
        self.transfer.forget()
        self.flight.enter(self.personality.first_mode)
        self.flight.runner.reset()
        self.flight.texts.clear()
        self.flight.reached.clear()

    def switch_mode(self, custom_mode: int) -> int:
        """Change the mode as a pilot's switch does; return the MAV_RESULT that a command would get."""
        return self.personality.set_mode(custom_mode)

    def launch(self, up_m: float) -> None:
        """Let the pilot arm and take off by hand, and circle or hover at a height above home."""
        self.flight.enter(Doing.MANUAL)
        self.flight.arm()
        self.flight.take_off(up_m)

    @property
    def _silent(self) -> bool:
        return self.time_s < self._silent_until_s

    def _listen(self) -> None:
        """Take what has come through the link."""
        for peer, message in self._post.arrived(self.time_s):
            if not self._silent:
                self.meet(peer)
                self._hear(peer, message)

    def _hear(self, peer: Address, message: Any) -> None:
        kind = message.get_msgId()
        if kind == dialect.MAVLINK_MSG_ID_HEARTBEAT:
            if message.type == dialect.MAV_TYPE_GCS:
                self._ground_heard_s = self.time_s
        elif kind == dialect.MAVLINK_MSG_ID_TIMESYNC:
            if message.tc1 == 0:
                self._post.write(self.time_s, peer, dialect.MAVLink_timesync_message(self._boot_ns(), message.ts1))
        elif kind == dialect.MAVLINK_MSG_ID_SET_MODE:
            self._set_mode(peer, message)
        elif kind in (dialect.MAVLINK_MSG_ID_COMMAND_INT, dialect.MAVLINK_MSG_ID_COMMAND_LONG):
            if self._for_us(message):
                self._command(peer, message)
        elif kind == dialect.MAVLINK_MSG_ID_MISSION_SET_CURRENT:
            if self._for_us(message) and self.flight.runner.choose(self.flight, message.seq):
                self.desk.requested.append(dialect.MAVLINK_MSG_ID_MISSION_CURRENT)
        elif kind in MISSION_MESSAGES and self._for_us(message):
            self._answer_all(self.transfer.hear(self.time_s, peer, message))

    def _for_us(self, message: Any) -> bool:
        """Another system's message is not ours; whether another component's is depends on the personality."""
        ours = message.target_component in (0, COMPONENT) or self.personality.answers_for_others
        return message.target_system in (0, SYSTEM) and ours

    def _set_mode(self, peer: Address, message: Any) -> None:
        """SET_MODE is acknowledged like a command; ArduPilot names the message's own number."""
        if message.target_system != SYSTEM:
            return
        custom = message.base_mode & 1
        result = self.switch_mode(message.custom_mode) if custom else DENIED
        named = 11 if isinstance(self.personality, ArduPilot) else dialect.MAV_CMD_DO_SET_MODE
        self._acknowledge(peer, message, named, result)

    def _command(self, peer: Address, message: Any) -> None:
        command = command_of(message)
        result = UNSUPPORTED if command.command in self.unkind.unknown else form_refused(self.unkind, command.frame)
        if result is None:
            result = self._without_gimbal(command)
        if result is None:
            sender = (message.get_srcSystem(), message.get_srcComponent())
            result = self.personality.answer(command, sender)
        self._acknowledge(peer, message, command.command, result)

    def _acknowledge(self, peer: Address, message: Any, command: int, result: int) -> None:
        target = (message.get_srcSystem(), message.get_srcComponent())
        for answer in answers_of(self.unkind, self._chance, result):
            ack = dialect.MAVLink_command_ack_message(command, answer.result, 0, 0, *target)
            self._post.write(self.time_s + answer.after_s, peer, ack, answer.source or US)

    def _without_gimbal(self, command: Command) -> int | None:
        """Where no gimbal is fitted, the nose is turned to a place, and angles can't be had."""
        if self.gimbal_fitted:
            return None
        if command.command == dialect.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW:
            return FAILED
        if command.command not in (ROI_PLACE, ROI_OLD, ROI_NONE):
            return None
        spot = None
        if command.command != ROI_NONE and abs(command.p5) <= 90 and abs(command.p6) <= 180:
            place = self.home.place(command.p5, command.p6, 0.0)
            spot = (place.east_mm / 1000, place.north_mm / 1000)
        if isinstance(self.flight.frame, Multirotor):
            self.flight.frame.nose_at_m = spot
        return ACCEPTED

    def _do(self, item: Item) -> None:
        """Do a mission's DO item that concerns the camera; others have no effect here."""
        if item.command in (ROI_PLACE, ROI_OLD, ROI_NONE, dialect.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW):
            placed = item.command in (ROI_PLACE, ROI_OLD)
            where = (item.x / 1e7, item.y / 1e7) if placed else (float(item.x), float(item.y))
            command = Command(
                command=item.command,
                frame=item.frame,
                p1=item.p1,
                p2=item.p2,
                p3=item.p3,
                p4=item.p4,
                p5=where[0],
                p6=where[1],
                p7=item.z,
            )
            if self._without_gimbal(command) is None:
                self.desk.answer(command)

    def _watch_ground_station(self) -> None:
        limit_s = self.ground_station_lost_s
        if limit_s is None or self.time_s - self._ground_heard_s < limit_s or self.flight.grounded:
            return
        if self.flight.armed and self.flight.doing not in (Doing.RETURN, Doing.LAND):
            self.flight.say("GCS Failsafe")
            self.flight.enter(Doing.RETURN)

    def _boot_ns(self) -> int:
        return max(round((self.time_s - self._booted_s) * 1e9), 0) + 1

    def _answer_all(self, sent: list[tuple[Address, Any]]) -> None:
        for peer, message in sent:
            lost = message.get_type() == "MISSION_ACK" and self._chance.random() < self.unkind.mission_ack_lost
            if not lost:
                self._post.write(self.time_s, peer, message)

    def _stream(self) -> list[Any]:
        """Return the messages that are due for everybody."""
        told, due = list(self._events()), list(self._due())
        if not due:
            return told
        flight, aim = self.flight, self.gimbal.aim
        now = VehicleInstant(
            boot_ms=self._boot_ns() // 1_000_000,
            home=self.home,
            motion=flight.motion(self.custom_mode, seen=True),
            gimbal=self.gimbal,
            yaw_locked=isinstance(aim, Angles) and aim.from_north,
            flight=flight,
            autopilot=self.personality.autopilot,
            version=self.personality.version,
            unix_us=round((self._unix_s + self.time_s + self.clock_jump_s) * 1e6),
            transfer=self.transfer,
        )
        streamed = [BUILDERS[message_id](now) for message_id in due]
        return told + [one for one in streamed if self._chance.random() >= self.unkind.stream_lost]

    def _events(self) -> Iterator[Any]:
        """Yield what has happened since the last time, and a TIMESYNC now and then."""
        for text in self.desk.texts + self.flight.texts:
            yield dialect.MAVLink_statustext_message(NOTICE, text.encode()[:50])
        for seq in self.flight.reached:
            yield dialect.MAVLink_mission_item_reached_message(seq)
        self.desk.texts.clear()
        self.flight.texts.clear()
        self.flight.reached.clear()
        if self.time_s >= self._timesync_s:
            self._timesync_s = self.time_s + TIMESYNC_S
            yield dialect.MAVLink_timesync_message(0, self._boot_ns() + SYSTEM)

    def _due(self) -> Iterator[int]:
        """Yield the message ids that are asked for or whose period has passed."""
        requested = list(self.desk.requested)
        self.desk.requested.clear()
        yield from requested
        for message_id, period_s in self.desk.periods_s.items():
            next_s = self._next_s.get(message_id, 0.0)
            if self.time_s >= next_s:
                self._next_s[message_id] = max(next_s + period_s, self.time_s)
                yield message_id
