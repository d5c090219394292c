"""A simulated ArduCopter, system 1 component 1: it flies its own route and answers over MAVLink 2.

No socket and no clock: `step` moves its time, `hear` takes a datagram, `take` gives those that are
due. Whoever speaks becomes a peer; answers go to who asked, streams to all. Unasked it sends only
HEARTBEAT, SYS_STATUS, HOME_POSITION and GPS_GLOBAL_ORIGIN. `Unkindness` loses and delays by seed.
"""

from __future__ import annotations

import random
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import common as dialect

from autopilot.geo import LocalFrame
from autopilot.sim.answers import IN_PROGRESS, Command, Desk
from autopilot.sim.gimbal import Angles, Gimbal
from autopilot.sim.messages import BUILDERS, UNASKED_S, Instant
from autopilot.sim.route import Motion, Route

Address = tuple[str, int]

HOME = (47.3977, 8.5456, 488.0)  # latitude, longitude, metres above mean sea level
SYSTEM, COMPONENT = 1, 1
PEERS_MAX = 8
PEER_SILENCE_S = 15.0
WORK_S = 0.3  # between IN_PROGRESS and the last answer, where the seed wants one


@dataclass(slots=True)
class Unkindness:
    """What goes wrong, as probabilities and seconds."""

    answer_lost: float = 0.0
    answer_late_s: float = 0.0  # every answer comes late by a random part of this
    in_progress: float = 0.0  # probability that an answer IN_PROGRESS comes first
    stream_lost: float = 0.0


class Aircraft:
    """Edit what you like between steps: `aircraft.gimbal.rate_deg_s = 10`, `aircraft.unkind.answer_lost = 1`."""

    def __init__(
        self,
        seed: int,
        seconds: float,
        home: tuple[float, float, float] = HOME,
        unkind: Unkindness | None = None,
    ) -> None:
        self.route = Route(seed, seconds)
        self.home = LocalFrame(*home)
        self.unkind = unkind or Unkindness()
        self.time_s = 0.0
        self.held = False  # on the ground: the route's time stands still, the aircraft's own goes on
        self.flown_s = 0.0
        self._desk = Desk(self.home, periods_s=dict(UNASKED_S))
        self._chance = random.Random(f"aircraft {seed}")
        self._next_s: dict[int, float] = {}
        self._peers: dict[Address, float] = {}
        self._answers: list[tuple[float, Address, Any]] = []
        self._out = dialect.MAVLink(None, SYSTEM, COMPONENT)

    @property
    def gimbal(self) -> Gimbal:
        """The gimbal, to look at or to change."""
        return self._desk.gimbal

    @property
    def motion(self) -> Motion:
        """Where the aircraft is and how it moves."""
        return self.route.at(self.flown_s)

    def step(self, dt_s: float) -> None:
        """Let time pass."""
        self.time_s += dt_s
        if not self.held:
            self.flown_s += dt_s
        self.gimbal.step(dt_s, self.motion)

    def meet(self, peer: Address) -> None:
        """Send to this address from now on; whoever speaks is met by itself."""
        if peer in self._peers or len(self._peers) < PEERS_MAX:
            self._peers[peer] = self.time_s

    def hear(self, peer: Address, datagram: bytes) -> None:
        """Take a datagram; what is not MAVLink is dropped as a real one would."""
        reader = dialect.MAVLink(None)
        reader.robust_parsing = True
        for message in reader.parse_buffer(datagram) or []:
            if message.get_type() == "BAD_DATA":
                continue
            self.meet(peer)
            if message.get_msgId() in (dialect.MAVLINK_MSG_ID_COMMAND_INT, dialect.MAVLINK_MSG_ID_COMMAND_LONG):
                self._command(peer, message)

    def take(self) -> list[tuple[Address, bytes]]:
        """Return the datagrams that are due, in order."""
        self._peers = {peer: at_s for peer, at_s in self._peers.items() if self.time_s - at_s < PEER_SILENCE_S}
        due = [(peer, message) for at_s, peer, message in self._answers if at_s <= self.time_s]
        self._answers = [answer for answer in self._answers if answer[0] > self.time_s]
        for message in self._stream():
            due += [(peer, message) for peer in self._peers]
        return [(peer, self._pack(message)) for peer, message in due]

    def _command(self, peer: Address, message: Any) -> None:
        """Another system's command is not ours; any component's is executed (there is no other on this bus)."""
        if message.target_system not in (0, SYSTEM):
            return
        result = self._desk.answer(command_of(message))
        sender = (message.get_srcSystem(), message.get_srcComponent())
        delay_s = self._chance.random() * self.unkind.answer_late_s
        if self._chance.random() < self.unkind.in_progress:
            self._answer(peer, sender, message.command, IN_PROGRESS, delay_s)
            delay_s += WORK_S
        self._answer(peer, sender, message.command, result, delay_s)

    def _answer(self, peer: Address, sender: tuple[int, int], command: int, result: int, delay_s: float) -> None:
        if self._chance.random() >= self.unkind.answer_lost:
            message = dialect.MAVLink_command_ack_message(command, result, 0, 0, *sender)
            self._answers.append((self.time_s + delay_s, peer, message))

    def _stream(self) -> list[Any]:
        """Return the messages that are due for everybody."""
        aim = self.gimbal.aim
        now = Instant(
            boot_ms=round(self.time_s * 1000),
            home=self.home,
            motion=self.motion,
            gimbal=self.gimbal,
            yaw_locked=isinstance(aim, Angles) and aim.from_north,
        )
        messages = [BUILDERS[message_id](now) for message_id in self._due()]
        texts = [dialect.MAVLink_statustext_message(4, text.encode()[:50]) for text in self._desk.texts]
        self._desk.texts.clear()
        return texts + [one for one in messages if self._chance.random() >= self.unkind.stream_lost]

    def _due(self) -> list[int]:
        """Return the message ids that are asked for or whose period has passed."""
        due = list(self._desk.requested)
        self._desk.requested.clear()
        for message_id, period_s in self._desk.periods_s.items():
            next_s = self._next_s.get(message_id, 0.0)
            if self.time_s >= next_s:
                due.append(message_id)
                self._next_s[message_id] = max(next_s + period_s, self.time_s)
        return due

    def _pack(self, message: Any) -> bytes:
        packed = bytes(message.pack(self._out))
        self._out.seq = (self._out.seq + 1) % 256
        return packed


def command_of(message: Any) -> Command:
    """Return COMMAND_INT or COMMAND_LONG as one."""
    shared = (message.param1, message.param2, message.param3, message.param4)
    if message.get_msgId() == dialect.MAVLINK_MSG_ID_COMMAND_INT:
        frame, last = message.frame, (message.x / 1e7, message.y / 1e7, message.z)
    else:
        frame, last = None, (message.param5, message.param6, message.param7)
    names = ("p1", "p2", "p3", "p4", "p5", "p6", "p7")
    sender = (message.get_srcSystem(), message.get_srcComponent())
    return Command(
        command=message.command, frame=frame, sender=sender, **dict(zip(names, (*shared, *last), strict=True))
    )
