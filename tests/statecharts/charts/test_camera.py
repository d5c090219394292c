"""The chart `camera` as tables: one master, last write wins with a name, holds and pauses that end by themselves."""

from __future__ import annotations

from tests.checks import check_chart, check_equal


def test_a_hold_and_a_pause_run_out() -> None:
    """Each order of the holder starts the hold again; a release rests for its pause."""
    check_chart(
        "camera",
        """
        at_s | observe         | state         | say          | why
        0    | order a point   | 1/1 operator  | ALPHA has it | an operator points it
        5    | answered a 2    | -             | -            | -
        30   | order b turn    | 1/1 operator  | ALPHA has it | an operator points it: last write wins
        30   | answered b 0    | -             | -            | -
        40   | time            | -             | -            | -
        90   | time            | 1/1 automatic | -            | the hold ran out
        100  | order c release | 1/1 released  | -            | an operator lets it go
        101  | answered c 0    | -             | -            | -
        103  | time            | 1/1 automatic | -            | the pause is over
        104  | order d point   | 1/1 operator  | ALPHA has it | an operator points it
        105  | order e release | 1/1 released  | -            | an operator lets it go
        107  | order f release | 1/1 released  | -            | an operator lets it go again
        108  | order g point   | 1/1 operator  | ALPHA has it | an operator points it
        118  | time            | -             | -            | -
        124  | time            | -             | -            | -
        """,
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
    """What the vehicle says of the command and a start of the daemon leave the camera with its master."""
    check_chart(
        "camera",
        """
        at_s | observe       | state         | say          | why
        0    | order a point | 1/1 operator  | ALPHA has it | an operator points it
        1    | answered a 2  | -             | -            | -
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
        1    | answered a 2    | -             | -            | -
        2    | start no clock  | 1/1 automatic | -            | off for an unknown time: the hold is over
        3    | start no clock  | -             | -            | -
        4    | vehicle up      | -             | -            | -
        5    | order b release | 1/1 released  | -            | an operator lets it go
        6    | start no clock  | 1/1 automatic | -            | off for an unknown time: the pause is over
        """,
    )
    check_equal(story.flight.state.cameras["1/1"].until_ns, 0)
    check_equal(story.flight.state.waiting("camera"), ())
