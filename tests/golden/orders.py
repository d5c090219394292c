"""Golden flights about orders: every gate, every outcome in every state, restarts, a baseline. They check nothing."""

from __future__ import annotations

from events.schema.flight_pb2 import BaselineCarried
from events.schema.trust_pb2 import EpochTaken, RevocationsTaken, RootTaken, TimeLearned
from statecharts import carry_over
from tests.flights import Flight, closed, limits, opened, opened_well, point_at_angles, point_at_place, received
from tests.golden.telling import follow, tell, tell_all
from tests.stories import Story

UNDERWAY = {"i": (), "s": ("sent {}",), "p": ("answered {} 5",)}
OUTCOMES = (
    ("again {}", "again {} body=abcd", "sent {}", "answered {} 0"),
    ("answered {} 5", "answered {} 2"),
    ("answered {} 4",),
    ("answered {} 3",),
    ("unanswered {} superseded",),
    ("unanswered {} no answer",),
)
ENDS = ("answered {} 0", "answered {} 1", "answered {} 9", "unanswered {} no answer")
AFTER = ("sent {}", "answered {} 5", "unanswered {} no answer", "again {}", "again {} body=abcd", "published {}")


def gates() -> Flight:
    """Every gate of an order says no once, in the words that the issuer reads; then one passes."""
    story = Story(sightings_to_ask=1, decide_shortest_ms=1_000, decide_longest_ms=1_000, asks_per_minute=1)
    tell(
        story,
        """
        0.1 | order z dance nonce=n seq=5 life=1
        1   | order a dance nonce=n seq=5 life=0 roles= target=x
        1.1 | order b dance nonce=n seq=5 life=0 roles=
        1.2 | order c dance nonce=n seq=5 life=0
        1.3 | order d dance seq=5 life=0
        1.4 | order e dance life=0
        1.5 | order f dance
        1.6 | vehicle down
        1.7 | order g point camera=7 at=null
        1.8 | order h release camera=2
        1.9 | order i point at=null
        2   | order j confirm p9
        2.1 | frame person@9,9 car@90,0
        2.2 | order k confirm p2
        2.3 | order l decline p1
        2.4 | order m confirm p1
        3   | order n point
        3.1 | vehicle up
        3.2 | order o point by=viewer roles=viewer
        3.3 | order p point by=viewer roles=viewer,camera
        3.4 | answered p 0
        3.5 | malformed q
        4   | close
        """,
    )
    return story.flight


def believing() -> Flight:
    """An overdue list, time that is not known, a lost memory, and a list that is older than one before."""
    flight = Flight()
    told = [RevocationsTaken(key_id=b"k" * 16, list_version=number, digest=bytes(32)) for number in (7, 5)]
    tell_all(flight, [told[0], RootTaken(root_version=1), EpochTaken(epoch_id=1), TimeLearned(floor_ms=5)])
    late = limits().overdue_camera_ms + 1
    orders = (
        point_at_place("a", revocation_overdue_ms=late - 1),
        point_at_place("b", order_seq=2, revocation_overdue_ms=late),
        received("c", order_seq=3, time_uncertain=True),
        point_at_place("d", order_seq=4, time_uncertain=True),
        point_at_place("e", order_seq=5, before_memory=True),
    )
    tell_all(flight, [*orders, told[1], point_at_place("f", order_seq=6), closed()])
    return flight


def outcomes() -> Flight:
    """In each state of an order, each thing that can become of it; and what comes too late changes nothing."""
    story = Story()
    for state, way in UNDERWAY.items():
        for number, outcome in enumerate(OUTCOMES):
            name = f"{state}{number}"
            follow(story, [f"order {name} point", *(one.format(name) for one in (*way, *outcome))])
        follow(story, [f"order {state}t turn life=100", *(one.format(f"{state}t") for one in way)])
        story.flight.wait(6_000)
    for number, end in enumerate(ENDS):
        follow(story, (one.format(f"e{number}") for one in ("order {} turn", end, *AFTER)))
    follow(story, ["order u point target=zzzz", "again u", "again u body=abcd", "published u", "close"])
    return story.flight


def repeats() -> Flight:
    """In each state that an order can be found in, more repeats of it within a second than are answered."""
    story = Story()
    ways = (*UNDERWAY.values(), *((end,) for end in ("answered {} 0", "answered {} 4", "unanswered {} no answer")))
    for number, way in enumerate((*ways, ("answered {} 3",))):
        follow(story, [f"order r{number} point", *(one.format(f"r{number}") for one in way)])
        follow(story, [f"again r{number}", f"again r{number} body=abcd", f"again r{number}"])
        story.flight.wait(1_000)
        follow(story, [f"again r{number}"])
    follow(
        story, ["order w point by=viewer roles=viewer", *["again w"] * 3, "order m dance", *["again m"] * 3, "close"]
    )
    return story.flight


def refusals() -> Flight:
    """The vehicle refuses an order that has the camera, had it, or never should have: what the camera goes back to."""
    story = Story(operator_hold_ms=3_000, release_pause_ms=2_000)
    tell(
        story,
        """
        1    | order a point
        1.1  | answered a 4
        2    | order b point
        2.1  | order c point by=bravo
        2.2  | answered b 4
        2.3  | answered c 4
        3    | order d release
        3.1  | answered d 0
        3.5  | order e point
        3.6  | answered e 3
        10   | order f point
        10.1 | answered f 0
        11   | order g point by=bravo
        11.1 | unanswered g superseded
        20   | order h point
        24   | answered h 4
        30   | order i point
        30.1 | order j release
        30.2 | answered i 4
        40   | close
        """,
    )
    return story.flight


def restarts() -> Flight:
    """Three starts in the air: orders in each state become "unknown", and answers that are owed are given again."""
    story = Story(dedup_keep_ms=40_000)
    tell(
        story,
        """
        1    | order a point
        1.1  | order b turn by=bravo
        1.2  | sent b
        1.3  | order c release by=carol
        1.4  | answered c 5
        1.5  | order d point by=delta
        1.6  | answered d 0
        1.7  | order e point camera=9
        1.8  | published e
        2    | start
        2.1  | published a failure=gone
        2.2  | published d
        3    | start
        3.1  | vehicle up
        3.2  | answered a 0
        3.3  | again a
        3.4  | again b body=abcd
        4    | start
        60   | order f point
        61   | again a
        75   | close
        """,
    )
    return story.flight


def handed_over() -> Flight:
    """A flight that begins with the baseline of another: what was ordered, seen and muted there is known here."""
    before = tell(
        Story(sightings_to_ask=1),
        """
        1   | order a point
        1.1 | answered a 3
        1.2 | order b turn by=bravo
        1.3 | frame person@1,1 car@41,0
        1.4 | order c decline p1
        1.5 | frame person@1,1 car@42,0
        """,
    )
    head, *rest = opened_well()
    state = carry_over(before.flight.state, before.flight.now_ns)
    story = Story(head, BaselineCarried(state=state), *rest)
    known = [point_at_place("a", order_seq=1, send=2), point_at_angles("b", order_seq=1, who="bravo", send=2)]
    fresh = [point_at_place("d", order_seq=1, send=3), point_at_angles("e", order_seq=2, who="bravo")]
    tell_all(story.flight, [*known, *fresh])
    tell(
        story,
        """
        2   | frame person@1,2 car@43,0
        2.1 | frame person@1,2 car@43,0
        3   | start
        4   | order f point by=carol
        5   | close
        """,
    )
    return story.flight


def switched_off() -> Flight:
    """Orders are switched off on this node."""
    flight = Flight(*opened_well(limits(command_enabled=False)))
    return tell_all(flight, [point_at_place("a"), point_at_place("a", send=2), closed()])


def nowhere() -> Flight:
    """A node that has no position yet and hears no vehicle."""
    flight = Flight(opened())
    return tell_all(flight, [point_at_place("a"), point_at_angles("b", order_seq=2), closed()])
