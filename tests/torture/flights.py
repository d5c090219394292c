"""Missions with everything that goes wrong, at the real limits, with both autopilots that a node can fly.

For each: a flight in which answers are lost, doubled, forged and never final, the gimbal is taken, the clock jumps and
the autopilot starts again; one in which the place jumps and another station flies it over a fence; one with operators
who are silent for 4, 6, 31 and 70 s after their last recorded word; one in which they go away while a camera follows
what they confirmed; and one whose battery sags. The world runs four times as fast where nothing of that depends on it,
and as fast as the node where it does. Each flight must replay identically, with no property broken.
"""

from __future__ import annotations

import shutil
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.whole import following, misfortunes
from tests.whole.flights import LONG, Mission

PERSONALITIES = ("ardupilot", "px4")
ROUNDS = 1  # of each misfortune, in each flight
AT_ONCE = 4  # flights: most of each is waiting
SILENCES = ((4.0, ""), (6.0, "degraded"), (31.0, "lost"), (70.0, "lost"))  # seconds, and what the link comes to
LOST_S, GRACE_S = 30.0, 30.0
Report = Callable[[str], None]


class Seen:
    """What came of it."""

    def __init__(self) -> None:
        self.flights = 0
        self.records = 0
        self.checks = Counter[str]()
        self.rejected = Counter[str]()
        self.detected_to_sent_ms: list[int] = []
        self.beyond_the_fence_m: list[float] = []


def run(count: int | None, seed: int, report: Report) -> dict[str, Any]:
    """Fly with each autopilot, `count` rounds of misfortunes (None: 1). Raises AssertionError, TimeoutError."""
    del seed  # the world has nothing of chance that matters here
    seen, rounds = Seen(), count or ROUNDS
    with ThreadPoolExecutor(AT_ONCE) as pool:
        jobs = [
            pool.submit(fly, seen, personality, rounds, report)
            for fly in (_silences, _following, _fences, _answers, _battery)
            for personality in PERSONALITIES
        ]
        for job in jobs:
            job.result()
    return {
        "flights_that_replay_identically": seen.flights,
        "records": seen.records,
        "misfortunes": dict(sorted(seen.checks.items())),
        "not_believed": dict(sorted(seen.rejected.items())),
        "place_to_bytes_ms": sorted(seen.detected_to_sent_ms),
        "beyond_the_fence_m": [round(one, 1) for one in sorted(seen.beyond_the_fence_m)],
        "properties_broken": 0,
    }


@contextmanager
def _flight(seen: Seen, personality: str, speed_up: float, report: Report) -> Iterator[Mission]:
    """A mission in the air, at the limits as they are by default; its log is held to its promises at the end."""
    folder = Path(tempfile.mkdtemp(prefix="torture-"))
    report(f"{personality} flies in {folder}")  # where something breaks, it is still there to look at
    mission = Mission(folder, personality=personality, speed_up=speed_up, flies=LONG, failsafe_again_s=5)
    with mission:
        mission.take_off()
        yield mission
        records = mission.ended()
    broken = [one for one in records if one.kind.name in ("property_broken", "step_failed")]
    assert broken == [], broken
    seen.flights, seen.records = seen.flights + 1, seen.records + len(records)
    seen.rejected += misfortunes.rejected(records)
    shutil.rmtree(folder)


def _answers(seen: Seen, personality: str, rounds: int, report: Report) -> None:
    checks = (
        misfortunes.check_answer_lost,
        misfortunes.check_answer_twice,
        misfortunes.check_answer_of_a_stranger,
        misfortunes.check_in_progress_for_ever,
        misfortunes.check_gimbal_taken,
        misfortunes.check_clock_jump,
        misfortunes.check_reboot,
    )
    with _flight(seen, personality, 4, report) as flight:
        for _ in range(rounds):
            for check in checks:
                check(flight)
                seen.checks[check.__name__.removeprefix("check_")] += 1


def _fences(seen: Seen, personality: str, rounds: int, report: Report) -> None:
    """Fly over a fence at the world's own speed; late answers of the modes before would keep a pause waiting."""
    with _flight(seen, personality, 1, report) as flight:
        for _ in range(rounds):
            ms, beyond_m = misfortunes.check_fence_at_speed(flight)
            seen.detected_to_sent_ms.append(ms)
            seen.beyond_the_fence_m.append(beyond_m)
            misfortunes.rest(flight.failsafe_again_s)
            seen.detected_to_sent_ms.append(misfortunes.check_gps_jump(flight))
            misfortunes.rest(flight.failsafe_again_s)
            seen.checks.update(("fence_at_speed", "gps_jump"))


def _silences(seen: Seen, personality: str, rounds: int, report: Report) -> None:
    del rounds
    with _flight(seen, personality, 1, report) as flight:
        for seconds, deepest in SILENCES:
            misfortunes.check_silence(flight, seconds, deepest)
            seen.checks[f"silence of {seconds:g} s"] += 1


def _following(seen: Seen, personality: str, rounds: int, report: Report) -> None:
    del rounds
    with _flight(seen, personality, 1, report) as flight:
        following.check_silence_while_following(flight, LOST_S, GRACE_S)
        seen.checks["silence while something is followed"] += 1


def _battery(seen: Seen, personality: str, rounds: int, report: Report) -> None:
    del rounds
    with _flight(seen, personality, 4, report) as flight:
        misfortunes.check_battery(flight)
        seen.checks["battery"] += 1
