"""A man in the middle of the MAVLink link: he passes datagrams on, counts commands, and may say and delay things.

He reads; what he passes on is as it came.
"""

from __future__ import annotations

import random
import select
import socket
import threading
import time
from collections import Counter

from pymavlink.dialects.v20 import common as dialect

ANSWERS_LATE_S = (0.0, 0.9)  # some later than the node waits before it sends again
POINTING = {
    dialect.MAV_CMD_DO_SET_ROI_LOCATION,
    dialect.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
    dialect.MAV_CMD_DO_SET_ROI_NONE,
}


class Middle(threading.Thread):
    """Passes datagrams between node and aircraft and counts the pointing commands by what they say.

    With a `chance` the aircraft's answers come late, so that a kill finds orders underway.
    """

    def __init__(self, aircraft_port: int, chance: random.Random | None = None) -> None:
        super().__init__(name="middle", daemon=True)
        self.pointed = threading.Event()  # a pointing command has just passed
        self.seen: Counter[tuple[int, float, float]] = Counter()
        self._aircraft = ("127.0.0.1", aircraft_port)
        self._node: tuple[str, int] | None = None
        self._inner = _bound()
        self._outer = _bound()
        self._over = threading.Event()
        self._chance = chance
        self._late: list[tuple[float, bytes]] = []
        self.port: int = self._inner.getsockname()[1]

    def stop(self) -> None:
        """End it."""
        self._over.set()
        self.join(5)
        self._inner.close()
        self._outer.close()

    def say(self, datagram: bytes) -> None:
        """Say something to the node in the aircraft's name."""
        assert self._node is not None
        self._inner.sendto(datagram, self._node)

    def run(self) -> None:
        """Pass on until stopped."""
        while not self._over.is_set():
            self._pass_on_late()
            for ready in select.select([self._inner, self._outer], [], [], 0.02)[0]:
                try:
                    data, sender = ready.recvfrom(2048)
                    self._pass_on(ready, data, sender)
                except OSError:
                    continue  # a dead node's port: the next one has another

    def _pass_on(self, ready: socket.socket, data: bytes, sender: tuple[str, int]) -> None:
        if ready is self._outer:
            late_s = self._chance.uniform(*ANSWERS_LATE_S) if self._chance and _is_answer(data) else 0.0
            self._late.append((time.monotonic() + late_s, data))
            self._pass_on_late()
            return
        self._node = sender
        self._count(data)
        self._outer.sendto(data, self._aircraft)

    def _pass_on_late(self) -> None:
        now_s = time.monotonic()
        due = [data for at_s, data in self._late if at_s <= now_s]
        self._late = [item for item in self._late if item[0] > now_s]
        for data in due:
            if self._node is not None:
                self._inner.sendto(data, self._node)

    def _count(self, data: bytes) -> None:
        for message in dialect.MAVLink(None).parse_buffer(bytearray(data)) or []:
            if message.get_type() == "COMMAND_INT" and message.command in POINTING:
                self.seen[message.command, message.x, message.y] += 1
                self.pointed.set()
            if message.get_type() == "COMMAND_LONG" and message.command in POINTING:
                self.seen[message.command, round(message.param1, 3), round(message.param2, 3)] += 1


def _is_answer(data: bytes) -> bool:
    """Whether a datagram is a COMMAND_ACK (MAVLink guide, Packet Serialization: the id is in bytes 7 to 9)."""
    return bool(int.from_bytes(data[7:10], "little") == dialect.MAVLINK_MSG_ID_COMMAND_ACK)


def _bound() -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind(("127.0.0.1", 0))
    return made
