"""What keeps the link alive without being an order: the heartbeat, and asking for streams.

An autopilot sends little unasked, and forgets what it was asked when it restarts, so each stream
is a level and not an edge: while it is not heard it is asked for again, ever more rarely. The
answers to these requests are not matched; the stream itself is the answer.

No heartbeat leaves while the node says that it is not healthy (MAVLink guide, Heartbeat).
"""

from __future__ import annotations

from autopilot.adapters.vehicle.egress import STREAMS_US

HEARTBEAT_NS = 1_000_000_000
SILENCE_NS = 2_000_000_000  # a stream that is this quiet has stopped; a slow one after twice its period
PAUSE_FIRST_NS = 1_000_000_000
PAUSE_LAST_NS = 30_000_000_000  # a vehicle without a gimbal is asked this often for its attitude


class Heart:
    """Beats once a second while there is reason to."""

    def __init__(self) -> None:
        self._next_ns = 0

    def tick(self, now_ns: int) -> bool:
        """Return whether a heartbeat is due now."""
        if now_ns < self._next_ns:
            return False
        self._next_ns = now_ns + HEARTBEAT_NS
        return True

    def due_ns(self) -> int:
        """Return when the next one is due."""
        return self._next_ns


class Stream:
    """One message that should keep coming, or (once) come at all."""

    def __init__(self, *, once: bool = False, period_us: int = 0) -> None:
        self._once = once
        self._silence_ns = max(SILENCE_NS, 2_000 * period_us)
        self.reset(0)

    def reset(self, now_ns: int) -> None:
        """Begin again: the vehicle is new, or came back."""
        self._ask_ns = now_ns
        self._pause_ns = PAUSE_FIRST_NS
        self._done = False

    def heard(self, now_ns: int) -> None:
        """Note that it came."""
        self._done = self._once
        self._ask_ns = now_ns + self._silence_ns
        self._pause_ns = PAUSE_FIRST_NS

    def tick(self, now_ns: int) -> bool:
        """Return whether to ask for it now."""
        if self._done or now_ns < self._ask_ns:
            return False
        self._ask_ns = now_ns + self._pause_ns
        self._pause_ns = min(2 * self._pause_ns, PAUSE_LAST_NS)
        return True

    def due_ns(self) -> int | None:
        """Return when it may have to be asked for, or None when it has come for good."""
        return None if self._done else self._ask_ns


class Streams:
    """All streams of `egress.STREAMS_US`, by message id."""

    def __init__(self) -> None:
        self._streams = {message_id: Stream(period_us=period_us) for message_id, period_us in STREAMS_US.items()}

    def reset(self, now_ns: int) -> None:
        """Ask for all of them afresh."""
        for stream in self._streams.values():
            stream.reset(now_ns)

    def heard(self, now_ns: int, message_id: int) -> None:
        """Note that a message of the stream came."""
        self._streams[message_id].heard(now_ns)

    def tick(self, now_ns: int) -> list[int]:
        """Return the message ids to ask for now."""
        return [message_id for message_id, stream in self._streams.items() if stream.tick(now_ns)]

    def due_ns(self) -> int:
        """Return when the next one may have to be asked for."""
        return min(stream.due_ns() or 0 for stream in self._streams.values())
