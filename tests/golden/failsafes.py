"""Golden flights in danger: batteries, fences and silent operators, by chance and by plan.

What happens by chance is drawn as in `chance`; a shell that is late lets two things change between two looks. Nothing
here checks anything.
"""

from __future__ import annotations

from tests.flights import Flight
from tests.golden.chance import Chance
from tests.stories import Story
from tests.stories_of_safety import SAFE_LIMITS

PAUSES_MS = (0, 0, 0, 0, 1_000, 3_000, 5_000, 6_000)
FENCES = "fence in=-100,-100,100,100 out=60,-9,80,9"
# Somebody is heard, and nobody is missed.
FAR_OFF = {"operator_degraded_ms": 10**9, "operator_lost_ms": 2 * 10**9, "failsafe_again_ms": 3_000}
LINES = (
    *("battery 90", "battery 25", "battery 20", "battery 14", "battery -"),
    *("spot 0,0", "spot 200,0", "spot 50,0 speed=20,-3"),
    *("flies", "flies", "flies return", "flies land", "grounded"),
    *("vehicle up", "vehicle up", "vehicle down", "heard alpha"),
    *("override battery for=3", "override fence for=4", "override battery for=9", "override fence for=700"),
)


# By plan: seconds since the line before, and what happens. A pause that begins with "late" passes without the shell
# having noticed. Each part begins with a vehicle that was on the ground for long.
PLAN = """
0 grounded | 20 vehicle up | 0 spot 0,0 | 0 battery 90 | 0 flies
0 battery 20 | 0 battery 90 | 0 battery 20 | 0 spot 0,0 | 0 flies return
0 grounded | 20 flies | 0 battery 90 | 0 battery 20 | 0 vehicle down | 0 vehicle up | 0 spot 0,0
0 grounded | 20 flies | 0 battery 90 | 0 battery 20 | 0 order x1 override battery for=9 | 0 spot 0,0 | 0 battery 14
0 grounded | 20 battery 90 | 0 flies | 0 battery 14 | late4 battery 20
0 grounded | 20 battery 90 | 0 flies | 0 battery 20 | 0 battery 90 | 0 battery 20 | 4 spot 0,0
0 grounded | 20 battery 90 | 0 flies | 0 battery 20 | 0 vehicle down | 0 vehicle up | 0 flies return | 9 battery 14
0 grounded | 20 battery 14 | 0 flies | 0 order x0 override battery for=9 | 0 battery 20
0 grounded | 20 battery 20 | 0 flies | 0 order x2 override battery for=1 | 0 spot 0,0 | 2 spot 0,0
0 grounded | 20 battery 90 | 0 flies | 0 spot 200,0 | 0 battery 14 | 0 battery 90 | 0 battery 14
0 order x3 override fence for=2 | 0 spot 200,0 | 9 spot 200,0
0 order x4 override landing | 0 order x5 override fence because= | 0 order x6 override link roles=camera
0 order x7 override link for=9 | 0 order x8 override link for=5 by=bravo | 0 start no clock | 0 vehicle up
0 grounded | 20 battery 90 | 0 flies | 0 spot 0,0 | 0 battery 20 | 0 battery 90 | 0 battery 14 | 0 battery 90
0 flies return | 0 battery 20 | 0 battery 90 | 0 grounded | 20 flies | 0 spot 200,0 | 0 spot 0,0 | 0 battery 14
0 spot 200,0 | 0 grounded | 20 battery 90 | 0 flies | 0 spot 0,0 | 0 battery 20 | 0 battery 90
0 order x9 override battery for=2 | 0 battery 20 | 0 battery 90 | 9 spot 0,0
"""
SILENCE = """
0 grounded | 0 start no clock | 0 flies | 6 spot 0,0 | 0 grounded | 0 flies | 40 spot 0,0 | 0 grounded | 0 vehicle up
0 flies | late40 spot 0,0 | 0 grounded | 0 flies | 0 start no clock | 0 start no clock | 0 vehicle up | 0 heard alpha
0 heard bravo | 6 spot 0,0 | 0 heard alpha | 6 spot 0,0 | 0 start no clock | 0 vehicle up | 9 heard alpha
0 start no clock | 0 vehicle up | 0 heard alpha | late40 spot 0,0 | 0 battery 14 | 0 vehicle down | 0 vehicle up
0 battery 90 | 0 order y1 override link for=9 | 0 spot 0,0 | 20 spot 0,0 | 0 heard alpha | 40 flies return
"""


def failsafes() -> Flight:
    """Return a flight in which failsafes demand, command, wait and are held off, on a shell that is often late."""
    chance, story = Chance(19), Story(**SAFE_LIMITS | FAR_OFF)
    story.tell(FENCES)
    for number in range(220):
        pause_ms = chance.of(PAUSES_MS)
        line = chance.of(LINES)
        _pass(story, pause_ms, late=chance.below(2) > 0 and line.split()[0] not in ("override", "heard"))
        story.tell(f"order o{number} {line}" if line.startswith("override") else line)
    _follow(story, PLAN)
    return story.flight


def silence() -> Flight:
    """Return a flight in which operators come and go, and some were never there."""
    story = Story(**SAFE_LIMITS)
    _follow(story, SILENCE)
    return story.flight


def no_say() -> Flight:
    """Return a flight in which all of this happens to a node that has no say in it."""
    story = Story(**SAFE_LIMITS | {"flight_enabled": False})
    for words in (FENCES, "spot 200,0", "battery 10", "heard alpha", "order a override battery", "start no clock"):
        story.tell(words)
        story.flight.wait(40_000)
    story.tell("close")
    return story.flight


def _pass(story: Story, pause_ms: int, late: bool) -> None:
    if late:
        story.at(story.flight.now_ns // 1_000_000 + pause_ms)
    else:
        story.flight.wait(pause_ms)


def _follow(story: Story, plan: str) -> None:
    for line in (line for row in plan.strip().splitlines() for line in row.split(" | ")):
        pause, _, words = line.partition(" ")
        _pass(story, 1000 * int(pause.removeprefix("late")), late=pause.startswith("late"))
        story.tell(words)
    story.tell("close")
