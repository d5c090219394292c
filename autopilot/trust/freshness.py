"""What a node knows of the time, without a clock that it must believe (docs/belief.md).

Working time is monotonic time and an offset. How far it is believed is one of three states:

    UNSET     nothing since the start says what time it is; only that it is not before the floor
    BOUNDED   something says it that nobody signed (GPS), or what was believed has jumped
    TRUSTED   a signed beacon, or a host clock that is configured as kept and contradicts nothing

The floor is the latest moment that something signed has named: the build, revocation lists, tokens, beacons. It only
rises, it is kept in the log, and neither GPS nor the host's clock moves it: a spoofed GPS would otherwise expire every
token for good (MAVLink's "store the largest timestamp" has this ratchet; ArduPilot #13860).

GPS makes an unset time a bounded one, and moves that forth by up to ten minutes at once. A time of GPS that is further
off is not followed, whatever is believed, and is told once.

A beacon answers a challenge of ours: true time lies between what it says and that plus the journey. It alone steps
time back, or by more than ten minutes. While time is not TRUSTED an order is fresh when it echoes the node's challenge,
which is random, replaced every 30 s, and counts for 60 s by the node's own monotonic clock.

It asks for nothing and records nothing: what is to be recorded lies in `news`.
"""

from __future__ import annotations

import os
import threading
from typing import Final, NamedTuple

from autopilot.trust import limits
from autopilot.trust.clock import Clock
from autopilot.trust.keys import Random
from events.schema.flight_pb2 import CLOCK_BOUNDED, CLOCK_TRUSTED, CLOCK_UNSET, ClockQuality
from events.schema.trust_pb2 import TimeLearned
from events.schema.waypoint_pb2 import EnvelopeHeader

NS_PER_MS: Final = 1_000_000
FAR_MS: Final = 1 << 62  # "nothing says so"
FLOOR_STEP_MS: Final = 60_000  # a floor that rises by less is not worth a record


class Time(NamedTuple):
    """What is known of the present; wall milliseconds since 1970."""

    now_ms: int  # the best guess: what is written down
    earliest_ms: int
    latest_ms: int  # FAR_MS where nothing bounds it
    quality: ClockQuality.ValueType

    @property
    def trusted(self) -> bool:
        """Whether `now_ms` may be relied on."""
        return self.quality == CLOCK_TRUSTED


def taken_as_right(clock: Clock) -> Time:
    """Return a clock's time as one that is believed: an operator's computer, a test."""
    now_ms = clock.wall_ns() // NS_PER_MS
    return Time(now_ms, now_ms, now_ms, CLOCK_TRUSTED)


def known_time(clock: Clock) -> Time:
    """Return what a clock knows of the present; one that does not say how far it is to be believed is right."""
    return clock.time() if isinstance(clock, TrustClock) else taken_as_right(clock)


def life_of(header: EnvelopeHeader, time: Time) -> int:
    """Return what is left of a message's life in ms; by a challenge it is known to be fresh, not how fresh."""
    if not time.trusted or not header.issued_at_ms:
        return header.ttl_ms
    return min(header.ttl_ms, max(0, header.issued_at_ms + header.ttl_ms - time.now_ms))


def nonce_life_of(header: EnvelopeHeader, time: Time) -> int:
    """Return for how many ms a message could pass again: its own life, or that of the challenge it echoes."""
    if not time.trusted or not header.issued_at_ms:
        return limits.CHALLENGE_LIFE_MS
    return header.issued_at_ms + header.ttl_ms + 2 * limits.SKEW_MS - time.now_ms


class Beacon(NamedTuple):
    """A question for the time that is under way."""

    challenge: bytes
    asked_ns: int


class TrustClock:
    """A clock that knows how far it is to be believed. Any thread; takes all time from `host`."""

    def __init__(
        self, host: Clock, *, host_trusted: bool, floor_ms: int = limits.BUILD_MS, random: Random = os.urandom
    ) -> None:
        """`host_trusted`: the host's wall clock is kept (RTC or NTP); it is believed while it contradicts nothing."""
        self._host = host
        self._host_trusted = host_trusted
        self._random = random
        self._lock = threading.RLock()
        self._floor_ms = self._told_floor_ms = floor_ms
        self._offset_ms = self._least_offset_ms = self._highest_offset_ms = floor_ms - self._mono_ms()
        self._quality: ClockQuality.ValueType = CLOCK_UNSET
        self._by = ""  # what the working time rests on
        self._asked: Beacon | None = None
        self._beacon_ns: int | None = None
        self._gps_is_off = False  # its last word was too far off, and that was told
        self._gps_told_ns: int | None = None
        self._challenges = (b"", random(limits.CHALLENGE_BYTES))  # the one before, the current one
        self._turned_ns = host.mono_ns()
        self._news: list[TimeLearned] = []
        self._hear_host()

    def mono_ns(self) -> int:
        """Monotonic nanoseconds of this boot."""
        return self._host.mono_ns()

    def wall_ns(self) -> int:
        """Working time in nanoseconds since 1970."""
        return self.time().now_ms * NS_PER_MS

    def time(self) -> Time:
        """Return what is known of the present."""
        with self._lock:
            self._hear_host()
            now_ms = self._working_ms()
            if self._quality == CLOCK_TRUSTED:
                return Time(now_ms, now_ms, now_ms, self._quality)
            return Time(max(now_ms, self._least_ms()), self._least_ms(), FAR_MS, self._quality)

    @property
    def floor_ms(self) -> int:
        """The latest moment that something signed has named."""
        with self._lock:
            return self._floor_ms

    def raise_floor(self, signed_ms: int, source: str) -> None:
        """Take in a moment that something signed has named; an earlier one than the floor changes nothing."""
        with self._lock:
            if signed_ms <= self._floor_ms:
                return
            self._floor_ms = signed_ms
            self._least_offset_ms = max(self._least_offset_ms, signed_ms - self._mono_ms())
            behind = self._working_ms() < signed_ms - limits.SKEW_MS
            self._offset_ms = max(self._offset_ms, signed_ms - self._mono_ms())
            if behind and self._quality == CLOCK_TRUSTED:
                self._become(CLOCK_UNSET, source, by="")  # the clock that was believed was wrong
            elif signed_ms >= self._told_floor_ms + FLOOR_STEP_MS:
                self._tell(source, self._quality)

    def restore_floor(self, floor_ms: int) -> None:
        """Take back the floor that the log remembers; what the log knows is not told again."""
        with self._lock:
            self._told_floor_ms = max(self._told_floor_ms, floor_ms)
            self.raise_floor(floor_ms, "document")

    def hear_gps(self, wall_ms: int) -> None:
        """Take in a time that nobody signed (the autopilot's SYSTEM_TIME): a guess, and never more than that."""
        with self._lock:
            self._hear_host()
            ahead_ms = wall_ms - self._working_ms()
            if self._quality == CLOCK_UNSET:
                if wall_ms >= self._least_ms():
                    self._offset_ms += ahead_ms
                    self._become(CLOCK_BOUNDED, "gps", by="gps")
            elif abs(ahead_ms) > limits.CLOCK_JUMP_MS:
                self._tell_gps_is_off(ahead_ms)
            else:
                self._gps_is_off = False
                if self._quality == CLOCK_BOUNDED:
                    self._offset_ms += max(0, ahead_ms)

    def ask(self) -> bytes | None:
        """Return the challenge of a beacon that ought to be asked for now; None while none is due.

        One is due while time is uncertain, and every hour where it rests on the last beacon; each at most every 10 s.
        """
        with self._lock:
            now_ns = self._host.mono_ns()
            if self._asked is not None and now_ns - self._asked.asked_ns < limits.ASK_AGAIN_NS:
                return None
            if self.time().trusted and not self._rests_on_an_old_beacon(now_ns):
                return None
            self._asked = Beacon(self._random(limits.CHALLENGE_BYTES), now_ns)
            return self._asked.challenge

    def hear_beacon(self, challenge: bytes, time_ms: int) -> str:
        """Take in a verified beacon; return "" or why not: "unasked", "late", "rollback" (it is before the floor)."""
        with self._lock:
            asked, now_ns = self._asked, self._host.mono_ns()
            if asked is None or challenge != asked.challenge:
                return "unasked"
            self._asked = None
            journey_ms = (now_ns - asked.asked_ns) // NS_PER_MS
            if journey_ms > limits.BEACON_RTT_MS_MAX:
                return "late"
            if time_ms + journey_ms < self._least_ms() - limits.SKEW_MS:
                return "rollback"
            self._floor_ms = max(self._floor_ms, time_ms)
            self._least_offset_ms = max(self._least_offset_ms, time_ms - self._mono_ms())
            self._offset_ms = time_ms + journey_ms // 2 - self._mono_ms()
            self._beacon_ns = now_ns
            if self._quality != CLOCK_TRUSTED or self._by != "beacon":
                self._become(CLOCK_TRUSTED, "beacon", by="beacon")
            elif self._floor_ms >= self._told_floor_ms + FLOOR_STEP_MS:
                self._tell("beacon", self._quality)
            return ""

    def challenge(self) -> bytes:
        """Return the challenge that an order may echo now, 16 bytes."""
        with self._lock:
            self._turn_challenges()
            return self._challenges[1]

    def echoes(self, challenge: bytes) -> bool:
        """Say whether this is the current challenge or the one before it."""
        with self._lock:
            self._turn_challenges()
            return len(challenge) == limits.CHALLENGE_BYTES and challenge in self._challenges

    def news(self) -> list[TimeLearned]:
        """Return what is to be recorded since the last call."""
        with self._lock:
            self._hear_host()
            fresh, self._news = self._news, []
            return fresh

    def _hear_host(self) -> None:
        """Follow a host clock that is configured as kept, until it contradicts the floor, or jumps, or goes back."""
        if not self._host_trusted:
            return
        host_ms = self._host.wall_ns() // NS_PER_MS
        if self._by in ("", "gps"):  # a host that is set right later is believed then, also where GPS was there first
            if host_ms >= self._least_ms() - limits.SKEW_MS and self._quality != CLOCK_TRUSTED:
                self._offset_ms = max(host_ms, self._least_ms()) - self._mono_ms()
                self._highest_offset_ms = self._offset_ms
                self._become(CLOCK_TRUSTED, "host", by="host")
        elif self._by == "host":
            ahead_ms = host_ms - self._working_ms()
            behind_ms = self._mono_ms() + self._highest_offset_ms - host_ms  # of the furthest that it has been
            if ahead_ms <= limits.CLOCK_JUMP_MS and behind_ms <= limits.SKEW_MS:
                self._offset_ms += ahead_ms
                self._highest_offset_ms = max(self._highest_offset_ms, self._offset_ms)
            else:
                self._become(CLOCK_BOUNDED, "host", by="jumped")

    def _rests_on_an_old_beacon(self, now_ns: int) -> bool:
        return self._beacon_ns is not None and now_ns - self._beacon_ns >= limits.BEACON_AGAIN_NS

    def _turn_challenges(self) -> None:
        turns = (self._host.mono_ns() - self._turned_ns) // limits.CHALLENGE_TURN_NS
        for _ in range(min(turns, len(self._challenges))):
            self._challenges = (self._challenges[1], self._random(limits.CHALLENGE_BYTES))
        self._turned_ns += turns * limits.CHALLENGE_TURN_NS

    def _become(self, quality: ClockQuality.ValueType, source: str, *, by: str) -> None:
        before, self._quality, self._by = self._quality, quality, by
        self._tell(source, before)

    def _tell_gps_is_off(self, jump_ms: int) -> None:
        """Tell it once until GPS is back, and not more often than every 10 s: whoever spoofs GPS may write no log."""
        now_ns = self._host.mono_ns()
        quiet = self._gps_told_ns is None or now_ns - self._gps_told_ns >= limits.ASK_AGAIN_NS
        if quiet and not self._gps_is_off:
            self._gps_is_off, self._gps_told_ns = True, now_ns
            self._tell("gps", self._quality, jump_ms)

    def _tell(self, source: str, before: ClockQuality.ValueType, jump_ms: int = 0) -> None:
        now_ms, trusted = self._working_ms(), self._quality == CLOCK_TRUSTED
        said = TimeLearned(source=source, from_quality=before, to_quality=self._quality, floor_ms=self._floor_ms)
        said.earliest_ms = now_ms if trusted else self._least_ms()
        if trusted:
            said.latest_ms = now_ms
        if jump_ms:
            said.jump_ms = jump_ms
        self._told_floor_ms = self._floor_ms
        self._news = [*self._news[-7:], said]  # a clock that jumps again and again is told eight times at once at most

    def _least_ms(self) -> int:
        """Return what the present is not before: a floor that was heard of rises with monotonic time."""
        return self._mono_ms() + self._least_offset_ms

    def _working_ms(self) -> int:
        return self._mono_ms() + self._offset_ms

    def _mono_ms(self) -> int:
        return self._host.mono_ns() // NS_PER_MS
