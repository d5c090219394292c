"""The chart `poi` as tables: what is asked, when, how often, and what a person's word or silence does."""

from __future__ import annotations

import pytest

from statecharts.facts import Spot
from tests.checks import check_chart, check_equal
from tests.stories import Story


def test_seen_often_and_surely_enough_it_is_asked_at_once() -> None:
    """The third sighting opens the question, and it is put without waiting for another frame."""
    check_chart(
        "poi",
        """
        at_s | observe             | state       | say           | why
        0    | frame person@0,0:39 | -           | -             | -
        1    | frame person@1,0    | -           | -             | -
        2    | frame person@2,0:39 | -           | -             | -
        3    | frame person@3,0:40 | -           | open p1 for 1 | -
        3    | time                | p1 surfaced | -             | put to an operator
        4    | frame person@4,0    | -           | -             | -
        """,
    )


def test_a_person_confirms() -> None:
    """Only what was put to people can be judged, once; a confirmed thing is not asked about again."""
    check_chart(
        "poi",
        """
        at_s | observe                      | state        | say              | why
        0    | frame person@0,0             | -            | open p1 for 1    | -
        0    | order a confirm p1           | -            | a rejected       | unknown_poi_id
        0    | time                         | p1 surfaced  | -                | put to an operator
        1    | vehicle down                 | -            | -                | -
        2    | order b confirm p1           | p1 confirmed | b accepted       | confirmed by a person
        3    | again b                      | -            | b accepted again | recorded
        4    | order c decline p1 by=bravo  | -            | c rejected       | expired: the question is closed
        5    | frame person@5,0             | -            | -                | -
        5    | frame person@5,0 person@14,0 | -            | 2 joins p1       | -
        999  | frame person@0,0             | -            | -                | -
        """,
        sightings_to_ask=1,
    )


def test_a_person_declines() -> None:
    """What is like it and near it is muted and counted; others of its group farther away, and other groups, are not."""
    story = check_chart(
        "poi",
        """
        at_s | observe                              | state       | say                          | why
        0    | frame person@0,0                     | -           | open p1 for 1                | -
        0    | time                                 | p1 surfaced | -                            | put to an operator
        1    | order a decline p1                   | p1 declined | a accepted; alpha mutes p1   | declined by a person
        2    | frame person@0,0                     | -           | 1 muted by p1                | -
        3    | frame person@0,0                     | -           | -                            | -
        4    | frame person@0,0 person@15,0 car@0,0 | -           | 2 muted by p1; open p2 for 3 | -
        4    | time                                 | p2 surfaced | -                            | put to an operator
        5    | frame person@30,0 person@0,0         | -           | open p3 for 4                | -
        """,
        sightings_to_ask=1,
    )
    item = story.flight.state.ignored[story.pois[0]]
    check_equal((item.muted, item.principal_id, item.class_group), (5, "alpha", "person"))
    check_equal([story.flight.state.objects[number].muted_by for number in (1, 2, 3)], [story.pois[0]] * 2 + [""])


def test_a_mute_is_a_places_not_a_walkers() -> None:
    """Whoever walks past a muted place is seen again further on; who comes back to it is quiet again."""
    story = check_chart(
        "poi",
        """
        at_s | observe             | state       | say                        | why
        0    | frame person@0,0    | -           | open p1 for 1              | -
        0    | time                | p1 surfaced | -                          | put to an operator
        1    | order a decline p1  | p1 declined | a accepted; alpha mutes p1 | declined by a person
        2    | frame person@7,0    | -           | 1 muted by p1              | -
        3    | frame person@14,0   | -           | -                          | -
        4    | frame person@21,0   | -           | 1 leaves p1                | -
        5    | frame person@14,0   | -           | 1 muted by p1              | -
        6    | frame person@21,0   | -           | 1 leaves p1                | -
        7    | frame person@28,0   | -           | open p2 for 1              | -
        7    | time                | p2 surfaced | -                          | put to an operator
        """,
        sightings_to_ask=1,
    )
    check_equal(story.flight.state.ignored[story.pois[0]].muted, 5)


def test_what_joined_a_question_leaves_it_but_what_it_is_about_stays() -> None:
    """The confirmed one may walk where it likes; its neighbour that walks away is a finding of its own."""
    check_chart(
        "poi",
        """
        at_s | observe                       | state        | say           | why
        0    | frame person@0,0              | -            | open p1 for 1 | -
        0    | time                          | p1 surfaced  | -             | put to an operator
        1    | order a confirm p1            | p1 confirmed | a accepted    | confirmed by a person
        2    | frame person@0,0 person@12,0  | -            | 2 joins p1    | -
        3    | frame person@-7,0 person@19,0 | -            | 2 leaves p1   | -
        4    | frame person@-14,0            | -            | -             | -
        5    | frame person@-21,0            | -            | -             | -
        6    | frame person@19,0             | -            | open p2 for 2 | -
        6    | time                          | p2 surfaced  | -             | put to an operator
        """,
        sightings_to_ask=1,
    )


def test_waiting_questions_like_a_declined_one_are_suppressed() -> None:
    """Near and of its group; one that people look at already is theirs to decide."""
    story = Story(sightings_to_ask=1, asks_per_minute=2)
    story.tell("frame person@0,0:90 person@50,0:85 person@100,0 car@0,20")
    check_chart("poi", "at_s | observe | state\n0 | time | p1 surfaced, p2 surfaced", story)
    pois = story.flight.state.pois
    for name in story.pois[1:]:  # as if they had been opened beside the first one
        poi = pois[name]
        pois.put(name, poi._replace(spot=Spot(15_000, 0, poi.spot.place)))
    check_chart(
        "poi",
        """
        at_s | observe            | state                      | say
        3    | order a decline p1 | p1 declined, p3 suppressed | a accepted; alpha mutes p1
        4    | order b confirm p2 | p2 confirmed               | b accepted
        60   | time               | p4 surfaced                | -
        """,
        story,
    )


def test_the_operator_is_asked_so_often_in_a_rolling_minute() -> None:
    """The third of two waits until the first is a minute old, to the nanosecond; the surest and oldest goes first."""
    check_chart(
        "poi",
        """
        at_s   | observe                               | state       | say                          | why
        0      | frame person@0,0                      | -           | open p1 for 1                | -
        0      | time                                  | p1 surfaced | -                            | put to an operator
        10     | frame person@50,0                     | -           | open p2 for 2                | -
        10     | time                                  | p2 surfaced | -                            | put to an operator
        20     | frame person@100,0:70                 | -           | open p3 for 3                | -
        21     | frame person@150,0:90 person@200,0:70 | -           | open p4 for 4; open p5 for 5 | -
        30     | frame person@0,0                      | -           | -                            | -
        59.999 | frame person@0,0                      | -           | -                            | -
        60     | time                                  | p4 surfaced | -                            | put to an operator
        61     | frame person@0,0                      | -           | -                            | -
        70     | time                                  | p3 surfaced | -                            | put to an operator
        """,
        sightings_to_ask=1,
        asks_per_minute=2,
        decide_shortest_ms=120_000,
    )


def test_of_two_that_are_as_sure_the_older_goes_first() -> None:
    """Whatever their ids are."""
    story = Story(sightings_to_ask=1, asks_per_minute=1, decide_shortest_ms=120_000, queue_longest_ms=10**7)
    for number in range(6):
        story.at(1000 * number)
        story.tell(f"frame person@{50 * number},0")
        if number == 0:
            story.tell("time")
    order = []
    while story.flight.due is not None:
        story.flight.now_ns = story.flight.due
        for record in story.tell("time"):
            order += [getattr(record.message, "instance", "")] * (getattr(record.message, "to_state", "") == "surfaced")
    check_equal([story.poi_name(one) for one in order], ["p2", "p3", "p4", "p5", "p6"])


@pytest.mark.parametrize(
    ("confidence", "window_s"), [(40, 30), (55, 52.5), (70, 75), (85, 97.5), (100, 120), (99.99, 119.985)]
)
def test_the_time_to_decide_grows_with_confidence(confidence: float, window_s: float) -> None:
    """Seed 004: 30 s at 40 %, 120 s at 100 %, linear between; then it is forgotten."""
    check_chart(
        "poi",
        f"""
        at_s       | observe                       | state       | say           | why
        0          | frame person@0,0:{confidence} | -           | open p1 for 1 | -
        0          | time                          | p1 surfaced | -             | put to an operator
        {window_s} | time                          | p1 expired  | -             | nobody decided in time
        """,
        sightings_to_ask=1,
    )


def test_silence_is_forgotten_and_asked_again_later() -> None:
    """An expired question mutes nothing; its place is left alone for five minutes, then it is asked anew."""
    story = check_chart(
        "poi",
        """
        at_s  | observe                     | state       | say           | why
        0     | frame person@0,0:40         | -           | open p1 for 1 | -
        0     | time                        | p1 surfaced | -             | put to an operator
        30    | time                        | p1 expired  | -             | nobody decided in time
        31    | order a confirm p1          | -           | a rejected    | expired: the question is closed
        32    | frame person@0,0            | -           | -             | -
        33    | frame person@0,0 person@9,0 | -           | 2 joins p1    | -
        329.9 | frame person@0,0            | -           | -             | -
        330   | frame person@0,0            | -           | open p2 for 1 | -
        330   | time                        | p2 surfaced | -             | put to an operator
        331   | frame person@0,0 person@9,0 | -           | 2 joins p2    | -
        """,
        sightings_to_ask=1,
    )
    check_equal(len(story.flight.state.ignored), 0)


def test_a_question_that_waited_too_long_expires_unasked() -> None:
    """Five minutes in the queue."""
    check_chart(
        "poi",
        """
        at_s | observe              | state       | say           | why
        0    | frame person@0,0     | -           | open p1 for 1 | -
        0    | time                 | p1 surfaced | -             | put to an operator
        1    | frame person@50,0:50 | -           | open p2 for 2 | -
        2    | frame person@90,0    | -           | open p3 for 3 | -
        21   | time                 | p2 expired  | -             | waited too long to be asked
        22   | time                 | p3 expired  | -             | waited too long to be asked
        23   | frame person@50,0:50 | -           | -             | -
        """,
        sightings_to_ask=1,
        asks_per_minute=1,
        queue_longest_ms=20_000,
    )


def test_one_place_one_question() -> None:
    """Sightings of one group within 15 m belong together, in one frame and later; another group is another question."""
    story = check_chart(
        "poi",
        """
        at_s | observe                                       | state                    | say
        0    | frame person@0,0 person@15,0 car@0,5          | -                        | open p1 for 1; open p2 for 3
        0    | time                                          | p1 surfaced, p2 surfaced | -
        1    | frame person@0,0 person@15,0                  | -                        | 2 joins p1
        2    | frame person@0,0 person@15,0 person@-15.001,0 | -                        | open p3 for 4
        """,
        sightings_to_ask=1,
    )
    check_equal([story.flight.state.pois[one].sightings for one in story.pois], [4, 1, 1])


def test_what_waits_at_the_end_is_withdrawn() -> None:
    """Enqueued or surfaced; what was decided stays decided."""
    story = Story(sightings_to_ask=1, asks_per_minute=2)
    story.tell("frame person@0,0:90 person@50,0:80 person@100,0:70")
    check_chart("poi", "at_s | observe | state\n0 | time | p1 surfaced, p2 surfaced", story)
    story.tell("order a confirm p1")
    records = story.tell("close")
    ends = {story.poi_name(str(getattr(record.message, "instance", ""))) for record in records[1:]}
    check_equal(ends, {"p2", "p3"})
    check_equal(
        {story.poi_name(key): poi.state for key, poi in story.flight.state.pois.items()},
        {"p1": "confirmed", "p2": "withdrawn", "p3": "withdrawn"},
    )
    check_equal([key for key, _ in story.flight.state.deadlines.items() if key[0] == "poi"], [])


def test_nobody_is_asked_below_the_confidence() -> None:
    """However often it is seen."""
    table = "\n".join(f"{number} | frame person@0,0:39.99 | - | -" for number in range(30))
    check_chart("poi", f"at_s | observe | state | say\n{table}")


def test_an_outage_of_unknown_length_ends_every_question() -> None:
    """Asked and waiting alike; an outage that can be measured leaves them their deadlines."""
    story = check_chart(
        "poi",
        """
        at_s | observe                  | state                  | why
        0    | frame person@0,0 car@0,0 | -                      | -
        0    | time                     | p1 surfaced            | put to an operator
        1    | start                    | -                      | -
        2    | start no clock           | p1 expired, p2 expired | off for an unknown time
        3    | start no clock           | -                      | -
        4    | frame person@0,0         | -                      | -
        """,
        sightings_to_ask=1,
        asks_per_minute=1,
    )
    check_equal(story.flight.state.waiting("poi"), ())
