"""The chart `scan` as tables: looks once at each finding, keeps its hands off, and minds the frame rate."""

from __future__ import annotations

from typing import Any

import pytest

from statecharts.charts.scan import Facts, may_look
from tests.checks import check_chart, check_equal
from tests.flights import NS_PER_MS
from tests.stories import Story

QUICK: dict[str, Any] = {"scan_enabled": True, "sightings_to_ask": 1, "frame_rate_floor_mhz": 0}


def test_it_looks_at_each_finding_once_and_sweeps_on() -> None:
    """The oldest first, four seconds each, then back to the sweep."""
    check_chart(
        "scan",
        """
        at_s | observe                   | state          | say        | why
        0    | frame                     | -              | -          | -
        1    | frame person@0,0          | 1/1 zoomed_in  | look 0,0   | looks closer at a finding
        1    | time                      | -              | -          | -
        2    | frame person@0,0 car@90,0 | -              | -          | -
        2    | time                      | -              | -          | -
        5    | time                      | 1/1 zoomed_out | turn -35,0 | has looked long enough
        5.2  | frame                     | 1/1 zoomed_in  | look 90,0  | looks closer at a finding
        9.2  | time                      | 1/1 zoomed_out | turn -35,0 | has looked long enough
        9.3  | frame person@0,0          | -              | -          | -
        """,
        **QUICK,
    )


def test_hands_off_while_somebody_has_the_camera() -> None:
    """Taken while it looks, while it sweeps, and while the camera rests: nothing is asked of the gimbal."""
    check_chart(
        "scan",
        """
        at_s | observe                | state             | say         | why
        0    | frame person@0,0       | 1/1 zoomed_in     | look 0,0    | looks closer at a finding
        0    | time                   | -                 | -           | -
        1    | order a turn           | 1/1 operator_held | turn -30,90 | somebody has the camera
        2    | frame person@90,0      | -                 | -           | -
        2    | time                   | -                 | -           | -
        3    | frame person@90,0      | -                 | -           | -
        5    | order b point by=bravo | -                 | look 1,1    | -
        6    | order c release        | -                 | let go      | -
        7    | frame person@90,0      | -                 | -           | -
        9    | time                   | 1/1 zoomed_out    | turn -35,0  | the camera is free again
        9.1  | frame person@90,0      | 1/1 zoomed_in     | look 90,0   | looks closer at a finding
        """,
        **QUICK,
    )


def test_it_does_nothing_where_it_may_not() -> None:
    """Switched off, a finding is never looked at; but it knows who has the camera."""
    check_chart(
        "scan",
        """
        at_s | observe          | state             | say      | why
        0    | frame person@0,0 | -                 | -        | -
        0    | time             | -                 | -        | -
        1    | frame person@0,0 | -                 | -        | -
        2    | order a point    | 1/1 operator_held | look 1,1 | somebody has the camera
        3    | order b release  | -                 | let go   | -
        6    | time             | 1/1 zoomed_out    | -        | the camera is free again
        """,
        **{**QUICK, "scan_enabled": False},
    )


def test_a_fixed_camera_is_not_turned() -> None:
    """Findings of camera 2, which nothing turns, move neither it nor the other one."""
    check_chart(
        "scan",
        """
        at_s | observe                   | state | say | why
        0    | frame person@0,0 camera=2 | -     | -   | -
        0    | time                      | -     | -   | -
        1    | frame person@0,0 camera=2 | -     | -   | -
        1    | frame camera=1            | -     | -   | -
        """,
        **QUICK,
    )


def frames(story: Story, number: int, every_ms: int) -> list[str]:
    """Tell empty frames at a rate; return the state of the scan after each."""
    states = []
    for _ in range(number):
        story.at(story.flight.now_ns // NS_PER_MS + every_ms)
        story.tell("frame")
        states.append(story.flight.state.scans["1/1"].state if "1/1" in story.flight.state.scans else "none")
    return states


def test_too_few_frames_block_it_with_hysteresis() -> None:
    """Under 10 a second it is blocked; at exactly 10 it stays as it was; a tenth above it is free again."""
    story = Story(**(QUICK | {"frame_rate_floor_mhz": 10_000}))
    check_equal(set(frames(story, 30, 100)), {"zoomed_out"})
    check_equal(frames(story, 1, 101), ["blocked"])
    check_equal(set(frames(story, 30, 100)), {"blocked"})
    check_equal(set(frames(story, 30, 91)), {"blocked"})
    check_equal(frames(story, 1, 90), ["zoomed_out"])


def test_the_first_frames_say_nothing_of_the_rate() -> None:
    """Ten frames make a rate; frames that bear one time make none."""
    story = Story(**(QUICK | {"frame_rate_floor_mhz": 10_000}))
    check_equal(frames(story, 10, 1_000), ["zoomed_out"] * 9 + ["blocked"])
    check_equal(set(frames(story, 20, 0)), {"blocked"})


def test_a_blocked_scan_does_not_look_closer() -> None:
    """A finding waits until frames come quickly enough; a blocked camera can be taken and comes back unblocked."""
    story = Story(**(QUICK | {"frame_rate_floor_mhz": 10_000}))
    frames(story, 10, 1_000)
    check_chart(
        "scan",
        """
        at_s | observe          | state             | say         | why
        11   | frame person@0,0 | -                 | -           | -
        11   | time             | -                 | -           | -
        12   | order a turn     | 1/1 operator_held | turn -30,90 | somebody has the camera
        13   | order b release  | -                 | let go      | -
        16   | time             | 1/1 zoomed_out    | turn -35,0  | the camera is free again
        16.1 | frame            | 1/1 blocked       | -           | frames come too slowly to look closer
        """,
        story,
    )
    check_equal(frames(story, 10, 80)[-2:], ["zoomed_out", "zoomed_in"])


def test_it_finds_the_camera_free_after_safe_mode() -> None:
    """What it was not asked about in safe mode it sees with the next frame."""
    story = Story(**QUICK)
    check_chart("scan", "at_s | observe | state\n0 | order a turn | 1/1 operator_held", story)
    story.flight.state.health.set("safe_mode")
    check_chart(
        "scan",
        """
        at_s | observe | state          | say        | why
        10   | time    | -              | -          | -
        20   | time    | -              | -          | -
        60   | time    | -              | -          | -
        61   | start   | -              | -          | -
        62   | frame   | 1/1 zoomed_out | turn -35,0 | the camera was freed while nobody was asked
        """,
        story,
    )


@pytest.mark.parametrize("camera", ["operator", "released"])
def test_a_held_camera_closes_the_guard_by_itself(camera: str) -> None:
    """Whatever state the scan is in: the guard does not rely on it."""
    check_equal(may_look(Facts(enabled=True, candidate=True, camera=camera)), False)
    check_equal(may_look(Facts(enabled=True, candidate=True, camera="automatic")), True)


def test_it_follows_what_a_person_has_confirmed() -> None:
    """It rests on it, turns after it, and gives up as soon as somebody takes the camera; whoever had it lets it go."""
    check_chart(
        "scan",
        """
        at_s | observe              | state             | say         | why
        0    | frame person@0,0     | -                 | -           | -
        0    | time                 | -                 | -           | -
        1    | order a turn         | 1/1 operator_held | turn -30,90 | somebody has the camera
        2    | order f follow p1    | -                 | -           | -
        3    | order c confirm p1   | -                 | -           | -
        4    | order g follow p1    | 1/1 following     | look 0,0    | an operator has it follow a finding
        5    | frame person@6,0     | -                 | -           | -
        6    | frame person@9,0     | 1/1 following     | look 9,0    | it has moved
        7    | frame person@9,0     | -                 | -           | -
        8    | order h follow p1    | 1/1 following     | look 9,0    | an operator has it follow another finding
        9    | order d turn         | 1/1 operator_held | turn -30,90 | somebody has the camera
        10   | frame person@20,0    | -                 | -           | -
        11   | order i follow p1    | 1/1 following     | look 20,0   | an operator has it follow a finding
        12   | order e release      | 1/1 operator_held | let go      | somebody has the camera
        """,
        **(QUICK | {"scan_enabled": False, "same_object_mm": 12_000, "same_poi_mm": 20_000}),
    )


def test_nothing_that_is_not_confirmed_is_followed() -> None:
    """A question, a declined one, one that never was, no vehicle, no camera: each with its reason."""
    story = Story(**QUICK)
    for words in ("frame person@0,0 car@90,0", "time", "order a decline p2"):
        story.tell(words)
    reasons = {}
    for name, words in (("q", "p1"), ("n", "p2"), ("x", "p9"), ("k", "p1 camera=2"), ("v", "p1")):
        if name == "v":
            story.tell("order c confirm p1")
            story.tell("vehicle down")
        story.tell(f"order {name} follow {words}")
        reasons[name] = story.flight.state.orders[f"alpha/{name}"].detail
    check_equal(
        reasons,
        dict.fromkeys("qnx", "only what a person has confirmed is followed")
        | {"k": "no such camera, or nothing turns it", "v": "no vehicle is heard"},
    )
