"""Golden flights about what is seen: questions and their ends, mutes, the scan. It checks nothing."""

from __future__ import annotations

from tests.flights import Flight
from tests.golden.telling import tell
from tests.stories import Story


def questions() -> Flight:
    """Questions that are answered, that nobody answers, that nobody is even asked, and that the end withdraws."""
    story = Story(
        sightings_to_ask=1, asks_per_minute=2, queue_longest_ms=45_000, ask_again_ms=50_000, decide_longest_ms=90_000
    )
    tell(
        story,
        """
        1     | frame person@0,0:95 person@40,0:60 person@80,0:50 car@0,0:42 car@3,0:41 dog@1,1
        1.1   | frame person@- person@0,1:95 person@120,0:39
        5     | order a confirm p1
        5.1   | frame person@0,2:95 person@3,2:90
        6     | order b decline p3
        40    | frame person@40,1:60 person@0,-40:99
        70    | frame person@40,1:60
        100   | frame person@40,1:60 person@80,1:60 car@0,1
        119   | frame person@40,1:60 person@80,1:60 car@0,1
        119.5 | order c decline p5
        121   | frame person@200,0:90 person@240,0:91 person@280,0:92
        122   | close
        122.5 | frame person@200,1:90
        130   | order d decline p1
        """,
    )
    return story.flight


def mutes() -> Flight:
    """What was declined stays quiet and is counted; what walks away from a muted place is seen again."""
    story = Story(sightings_to_ask=2, asks_per_minute=1, same_object_mm=5_000, same_poi_mm=15_000)
    tell(
        story,
        """
        1   | frame person@0,0:90 person@12,0:80 car@4,4
        1.1 | frame person@0,0:90 person@12,0:80 car@4,4
        1.2 | frame person@0,0:90 person@14,3:80 car@4,4 person@4,16:70
        1.3 | frame person@0,0:90 person@16,5:80 car@4,4 person@4,16:70
        2   | order a decline p1
        2.1 | frame person@1,0 person@16,5
        2.2 | frame person@1,0 person@9,9
        2.3 | frame person@5,0 person@9,9
        2.4 | frame person@9,0 person@9,9
        2.5 | frame person@13,0
        2.6 | frame person@17,0
        2.7 | frame person@17,0
        70  | frame person@0,1 person@-60,0
        71  | frame person@0,1 person@-60,0
        200 | frame person@-60,0
        290 | frame person@-60,1
        600 | frame person@-60,1
        601 | order b decline p6
        602 | frame person@-60,1
        603 | close
        """,
    )
    return story.flight


def scans() -> Flight:
    """The node looks at findings one by one, keeps off a camera that somebody has, and minds the frame rate."""
    story = Story(scan_enabled=True, sightings_to_ask=1, frame_rate_floor_mhz=5_000, operator_hold_ms=9_000)
    tell(story, "1 | frame person@0,0 car@90,0")
    tell(
        story,
        """
        1.2  | sent own
        1.3  | answered own 0
        2    | frame
        2.2  | gimbal own error=400
        2.4  | gimbal own error=90
        5.5  | frame
        6    | order a point
        6.1  | answered a 0
        6.12 | gimbal a error=100
        6.13 | gimbal a error=90
        6.14 | answered a 4
        6.16 | order r release
        6.2  | order b turn by=bravo
        6.3  | unanswered b no answer
        6.4  | order c release
        6.5  | order d release by=bravo
        9.7  | frame person@40,40 camera=2
        9.8  | frame person@70,70
        10.2 | order e release
        14   | frame
        14.1 | order f turn
        25   | frame
        """,
    )
    tell(story, "\n".join(f"{30 + number} | frame" for number in range(11)))
    tell(story, "41 | order g point\n42 | order h release")
    tell(story, "\n".join(f"{50 + number} | frame" for number in range(3)))
    tell(story, "\n".join(f"{60 + number / 10} | frame person@{number},0" for number in range(25)))
    tell(
        story,
        """
        70   | vehicle down
        70.1 | frame person@300,0
        71   | vehicle up
        71.1 | frame person@300,0
        72   | order i point
        90   | close
        """,
    )
    return story.flight
