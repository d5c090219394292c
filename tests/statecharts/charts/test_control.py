"""The chart `control` as tables: taken once, never from another, given up once."""

from __future__ import annotations

from events.schema.flight_pb2 import CameraFitting
from events.schema.vehicle_pb2 import GiveUpGimbal, TakeGimbal
from tests.checks import check_chart, check_equal
from tests.flights import opened, opened_well
from tests.stories import Story


def test_taken_once_and_given_up_once() -> None:
    """Before the first pointing leaves; when the hold is over it is nobody's."""
    check_chart(
        "control",
        """
        at_s | observe              | state       | say     | why
        0    | control 0/0          | 1/1 nobody  | -       | nobody controls it
        1    | order a turn         | 1/1 asked   | take    | asked for: an operator points it
        1.1  | order b point        | -           | -       | -
        1.2  | control 1/191 ours   | 1/1 ours    | -       | this node controls it
        2    | order c point        | -           | -       | -
        2.5  | control 1/191 ours   | -           | -       | -
        5    | order d release      | -           | -       | -
        6    | control 0/0          | 1/1 nobody  | -       | nobody controls it
        7    | control 1/191 ours   | 1/1 ours    | -       | this node controls it
        8    | time                 | 1/1 nobody  | give up | given up: no operator holds the camera any more
        8.1  | control 0/0          | -           | -       | -
        9    | order e turn         | 1/1 asked   | take    | asked for: an operator points it
        """,
    )


def test_it_leaves_before_the_pointing_and_names_the_gimbal() -> None:
    """PX4 denies angles to whoever does not control the gimbal, so the order of the two matters."""
    story = Story()
    story.tell("control 0/0")
    kinds = [record.kind.name for record in story.tell("order a turn")]
    check_equal(kinds.index("take_gimbal") < kinds.index("point_at_angles"), True)
    taken = [record.message for record in story.flight.records if record.kind.name == "take_gimbal"]
    check_equal(taken, [TakeGimbal(vehicle=1, gimbal=1, life_ms=5_000)])
    story.tell("order b release")
    given = [record.message for record in story.flight.wait(3_000) if record.kind.name == "give_up_gimbal"]
    check_equal(given, [GiveUpGimbal(vehicle=1, gimbal=1, life_ms=5_000)])


def test_the_first_follow_takes_it_too() -> None:
    """And keeps it while it follows, though no operator holds the camera; whoever takes the camera next has it."""
    story = Story(sightings_to_ask=1, frame_rate_floor_mhz=0)
    for line in ("frame person@9,9", "time", "order z confirm p1"):
        story.tell(line)
    story = check_chart(
        "control",
        """
        at_s | observe            | state      | say     | why
        0    | control 0/0        | 1/1 nobody | -       | nobody controls it
        1    | order a follow p1  | 1/1 asked  | take    | asked for: an operator points it
        1.1  | control 1/191 ours | 1/1 ours   | -       | this node controls it
        2    | order b follow p1  | -          | -       | -
        3    | control 0/0        | 1/1 nobody | -       | nobody controls it
        4    | control 1/191 ours | 1/1 ours   | -       | this node controls it
        5    | order d turn       | -          | -       | -
        6    | order e follow p1  | -          | -       | -
        7    | order f release    | -          | -       | -
        10   | time               | 1/1 nobody | give up | given up: no operator holds the camera any more
        """,
        story,
    )
    check_equal(story.flight.state.scans["1/1"].state, "zoomed_out")


def test_another_is_left_it() -> None:
    """Nothing is sent while another has it, nor for what nobody points; free again, the next order takes it."""
    check_chart(
        "control",
        """
        at_s | observe            | state      | say     | why
        0    | order a point      | -          | -       | -
        1    | control 255/190    | 1/1 others | -       | another controls it
        2    | order b turn       | -          | -       | -
        3    | control 9/1        | -          | -       | -
        4    | control 0/0        | 1/1 nobody | -       | nobody controls it
        5    | lens zooms         | -          | -       | -
        5.1  | order c zoom       | -          | -       | -
        5.2  | order d release    | -          | -       | -
        6    | order e turn       | 1/1 asked  | take    | asked for: an operator points it
        6.1  | control 255/190    | 1/1 others | -       | another controls it
        7    | order f release    | -          | -       | -
        10   | time               | -          | -       | -
        """,
    )


def test_taken_from_another_where_that_is_configured() -> None:
    """Once; who takes it back is left it only until the next order."""
    check_chart(
        "control",
        """
        at_s | observe            | state      | say     | why
        0    | control 255/190    | 1/1 others | -       | another controls it
        1    | order a turn       | 1/1 asked  | take    | asked for: an operator points it
        1.1  | control 1/191 ours | 1/1 ours   | -       | this node controls it
        2    | control 255/190    | 1/1 others | -       | another controls it
        3    | order b turn       | 1/1 asked  | take    | asked for: an operator points it
        3.1  | control 0/0        | 1/1 nobody | -       | nobody controls it
        """,
        take_from_others=True,
    )


def test_what_is_found_to_be_ours_is_given_up_where_nobody_points() -> None:
    """After a start, in the next flight, or where the vehicle did not hear the first time."""
    check_chart(
        "control",
        """
        at_s | observe            | state      | say     | why
        0    | control 1/191 ours | 1/1 nobody | give up | given up: no operator holds the camera
        1    | control 1/191 ours | 1/1 nobody | give up | given up: no operator holds the camera
        2    | order a turn       | 1/1 asked  | take    | asked for: an operator points it
        3    | control 255/190    | 1/1 others | -       | another controls it
        4    | control 1/191 ours | 1/1 ours   | -       | this node controls it
        5    | answered a 0       | -          | -       | -
        12   | time               | -          | -       | -
        62   | time               | 1/1 nobody | give up | given up: no operator holds the camera any more
        """,
    )


def test_two_cameras_on_a_gimbal_hold_it_together() -> None:
    """It is given up with the last of them: one that is free again takes nothing from who holds the other."""
    manifest = opened()
    manifest.configuration.cameras.append(CameraFitting(vehicle=1, camera=3, gimbal=1))
    story = Story(manifest, *opened_well()[1:])
    for words in ("control 0/0", "order a turn", "answered a 0", "order b release camera=3", "answered b 0"):
        story.tell(words)
    told = story.flight.wait(3_000)
    check_equal(story.flight.state.cameras["1/3"].state, "automatic")
    check_equal([record for record in told if record.kind.name == "give_up_gimbal"], [])
    given = [record for record in story.flight.wait(60_000) if record.kind.name == "give_up_gimbal"]
    check_equal(len(given), 1)
