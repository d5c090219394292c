"""The chart `camera` as tables: one master, last write wins with a name, holds and pauses that end by themselves."""

from __future__ import annotations

from tests.checks import check_chart, check_equal
from tests.stories import Story


def test_a_hold_and_a_pause_run_out() -> None:
    """Each order of the holder starts the hold again; a release rests for its pause."""
    check_chart(
        "camera",
        """
        at_s | observe         | state         | say          | why
        0    | order a point   | 1/1 operator  | ALPHA has it | an operator points it
        5    | answered a 0    | -             | -            | -
        30   | order b turn    | 1/1 operator  | ALPHA has it | an operator points it: last write wins
        30   | answered b 0    | -             | -            | -
        90   | time            | 1/1 automatic | -            | the hold ran out
        100  | order c release | 1/1 released  | -            | an operator lets it go
        101  | answered c 0    | -             | -            | -
        103  | time            | 1/1 automatic | -            | the pause is over
        104  | order d point   | 1/1 operator  | ALPHA has it | an operator points it
        105  | order e release | 1/1 released  | -            | an operator lets it go
        107  | order f release | 1/1 released  | -            | an operator lets it go again
        108  | order g point   | 1/1 operator  | ALPHA has it | an operator points it
        124  | time            | -             | -            | -
        """,
        arrival_patience_ms=1_000_000,
    )


def test_two_operators_last_write_wins_with_attribution() -> None:
    """Whoever points it last has it, by name; whoever was refused does not, and judging a finding takes nothing."""
    story = check_chart(
        "camera",
        """
        at_s | observe                | state        | say          | why
        0    | order a point          | 1/1 operator | ALPHA has it | an operator points it
        1    | order b point by=bravo | 1/1 operator | BRAVO has it | an operator points it: last write wins
        2    | order c point roles=   | -            | -            | -
        3    | order d confirm p1     | -            | -            | -
        4    | order e point seq=1    | -            | -            | -
        """,
    )
    camera = story.flight.state.cameras["1/1"]
    check_equal((camera.principal_id, camera.callsign, camera.command_id), ("bravo", "BRAVO", "b"))
    check_equal(camera.until_ns, 61_000_000_000)
    check_chart("camera", "at_s | observe | state\n5 | order f release | 1/1 released", story)
    camera = story.flight.state.cameras["1/1"]
    check_equal((camera.state, camera.principal_id, camera.callsign, camera.command_id), ("released", "", "", ""))
    check_equal((camera.vehicle, camera.camera, camera.gimbal), (1, 1, 1))


def test_a_restart_does_not_end_a_hold_and_an_answer_does_not_either() -> None:
    """Acceptance, silence and a start of the daemon leave the camera with its master."""
    check_chart(
        "camera",
        """
        at_s | observe       | state         | say          | why
        0    | order a point | 1/1 operator  | ALPHA has it | an operator points it
        1    | answered a 0  | -             | -            | -
        2    | start         | -             | -            | -
        60   | time          | 1/1 automatic | -            | the hold ran out
        """,
    )


def test_an_outage_of_unknown_length_ends_holds_and_pauses() -> None:
    """Nobody holds a camera by an order of which nobody knows how old it is; one that is free stays free."""
    story = check_chart(
        "camera",
        """
        at_s | observe         | state         | say          | why
        0    | order a point   | 1/1 operator  | ALPHA has it | an operator points it
        1    | answered a 0    | -             | -            | -
        2    | start no clock  | 1/1 automatic | -            | off for an unknown time: the hold is over
        3    | start no clock  | -             | -            | -
        4    | vehicle up      | -             | -            | -
        5    | order b release | 1/1 released  | -            | an operator lets it go
        6    | start no clock  | 1/1 automatic | -            | off for an unknown time: the pause is over
        """,
    )
    check_equal(story.flight.state.cameras["1/1"].until_ns, 0)
    check_equal(story.flight.state.waiting("camera"), ())


def test_a_refused_order_holds_nothing() -> None:
    """Denied, unsupported or never sent: the camera is automatic again at once; silence is no refusal."""
    check_chart(
        "camera",
        """
        at_s | observe                 | state         | say          | why
        0    | order a point           | 1/1 operator  | ALPHA has it | an operator points it
        1    | answered a 5            | -             | -            | -
        2    | answered a 2            | 1/1 automatic | -            | the vehicle refused: the hold is over
        3    | order b turn            | 1/1 operator  | ALPHA has it | an operator points it
        4    | answered b 3            | 1/1 automatic | -            | the vehicle refused: the hold is over
        5    | order c point           | 1/1 operator  | ALPHA has it | an operator points it
        5    | unanswered c no vehicle | 1/1 automatic | -            | the vehicle refused: the hold is over
        6    | order d point           | 1/1 operator  | ALPHA has it | an operator points it
        8    | unanswered d silence    | -             | -            | -
        66   | time                    | 1/1 automatic | -            | the hold ran out
        """,
    )


def test_a_refused_order_gives_the_camera_back() -> None:
    """To who had it, for what was left of that hold, and to the pause of a camera that was let go."""
    story = check_chart(
        "camera",
        """
        at_s | observe                | state         | say          | why
        0    | order a point by=bravo | 1/1 operator  | BRAVO has it | an operator points it
        1    | answered a 0           | -             | -            | -
        40   | order b point          | 1/1 operator  | ALPHA has it | an operator points it: last write wins
        41   | answered b 4           | 1/1 operator  | BRAVO has it | the vehicle refused: back to who had it
        """,
        arrival_patience_ms=1_000_000,
    )
    camera = story.flight.state.cameras["1/1"]
    check_equal((camera.principal_id, camera.command_id, camera.until_ns), ("bravo", "a", 60_000_000_000))
    check_equal(camera.before, None)
    check_chart(
        "camera",
        """
        at_s | observe         | state         | say          | why
        60   | time            | 1/1 automatic | -            | the hold ran out
        61   | order c release | 1/1 released  | -            | an operator lets it go
        62   | order d point   | 1/1 operator  | ALPHA has it | an operator points it
        63   | answered d 2    | 1/1 released  | -            | the vehicle refused: back to its pause
        66   | time            | 1/1 automatic | -            | the pause is over
        """,
        story,
    )


def test_nothing_is_given_back_that_is_over_or_was_refused_itself() -> None:
    """A hold that ran out meanwhile, a pause that did, and one by an order that the vehicle refused too."""
    check_chart(
        "camera",
        """
        at_s | observe                      | state         | say          | why
        0    | order a point by=bravo       | 1/1 operator  | BRAVO has it | an operator points it
        1    | answered a 0                 | -             | -            | -
        59   | order b point life=30000     | 1/1 operator  | ALPHA has it | an operator points it: last write wins
        60   | answered b 2                 | 1/1 automatic | -            | the vehicle refused: the hold is over
        70   | order c release              | 1/1 released  | -            | an operator lets it go
        71   | order d point                | 1/1 operator  | ALPHA has it | an operator points it
        73   | answered d 2                 | 1/1 automatic | -            | the vehicle refused: the hold is over
        80   | order e point by=bravo       | 1/1 operator  | BRAVO has it | an operator points it
        80   | order f point                | 1/1 operator  | ALPHA has it | an operator points it: last write wins
        81   | unanswered e superseded      | -             | -            | -
        82   | answered f 2                 | 1/1 automatic | -            | the vehicle refused: the hold is over
        83   | order g point                | 1/1 operator  | ALPHA has it | an operator points it
        84   | order h release              | 1/1 released  | -            | an operator lets it go
        84.5 | answered h 2                 | -             | -            | -
        84.6 | answered g 2                 | -             | -            | -
        87   | time                         | 1/1 automatic | -            | the pause is over
        87.5 | answered g 2                 | -             | -            | -
        """,
        arrival_patience_ms=1_000_000,
    )


def test_what_the_node_refuses_takes_nothing_away() -> None:
    """An order that does not pass the gates is no refusal by the vehicle: who holds the camera keeps it."""
    check_chart(
        "camera",
        """
        at_s | observe                | state        | say          | why
        0    | order a point          | 1/1 operator | ALPHA has it | an operator points it
        1    | order b point seq=1    | -            | -            | -
        2    | order c dance by=bravo | -            | -            | -
        3    | answered a 0           | -            | -            | -
        """,
    )


def test_another_issuer_s_order_under_the_same_id_is_another_order() -> None:
    """The refusal of Alpha's order takes nothing from Bravo, who used the same id for an order of his own."""
    story = Story()
    story.tell("order a point")
    first = story.flight.effect()
    story.tell("order a turn by=bravo")
    story.tell(f"answered {first} 2")
    camera = story.flight.state.cameras["1/1"]
    check_equal((camera.state, camera.principal_id, camera.command_id), ("operator", "bravo", "a"))
