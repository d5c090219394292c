"""Chart `scan`: what the node itself does with a camera that nobody holds (seed 004; scan_controller of its system).

Theory of operation. Zoomed out, the camera looks ahead at a fixed pitch, and the flight sweeps it over the ground. A
new point of interest is looked at: the camera rests on its place for `look_ms` (zoomed in), then looks ahead, or at
the next. While an operator holds the camera or it rests released, the node keeps its hands off. Under the frame-rate
floor it does not look closer, for what it would see there could not be followed; it comes back with a margin, so
that it does not flicker. An operator may have it follow what a person has confirmed: the camera rests on it and turns
after it when it has moved by half of `same_object_mm`, until somebody takes the camera. It must never move a camera
that somebody holds, never ask for a place that would turn a vehicle which must not be turned, and never move a camera
at all where `scan_enabled` is off, except to follow what it was ordered to.
"""

from __future__ import annotations

from dataclasses import dataclass

from statecharts.table import Chart, ignore, move


@dataclass(frozen=True, slots=True)
class Facts:
    """What the guards look at."""

    enabled: bool = False  # configured, its vehicle is heard, and there is a gimbal that looks without turning that
    candidate: bool = False  # a point of interest waits to be looked at
    camera: str = ""  # state of the camera's chart
    rate_mhz: int = 0
    floor_mhz: int = 0
    moved_away: bool = False  # what is followed is no longer where the camera points, which may be turned there


def slow(facts: Facts) -> bool:
    """Frames come slower than the floor."""
    return facts.rate_mhz < facts.floor_mhz


def quick(facts: Facts) -> bool:
    """Frames come clearly faster than the floor: a tenth above it."""
    return 10 * facts.rate_mhz >= 11 * facts.floor_mhz


def may_look(facts: Facts) -> bool:
    """The node may move the camera, it is the master, and there is something to look at."""
    return facts.enabled and facts.candidate and facts.camera == "automatic"


def held(facts: Facts) -> bool:
    """Somebody holds the camera, or it rests."""
    return facts.camera != "automatic"


def moved_away(facts: Facts) -> bool:
    """What is followed is no longer where the camera points, and the camera may be turned there."""
    return facts.moved_away


CHART: Chart[Facts] = Chart(
    name="scan",
    initial="zoomed_out",
    states=("zoomed_out", "zoomed_in", "following", "operator_held", "blocked"),
    terminal=(),
    triggers=("frame_observed", "camera_moved", "time_passed", "follow"),
    rows=(
        move("zoomed_out", "frame_observed", "blocked", "frames come too slowly to look closer", slow, band=1),
        move("zoomed_out", "frame_observed", "zoomed_in", "looks closer at a finding", may_look, band=2),
        ignore("zoomed_out", "frame_observed", "nothing to look at", band=3),
        move("zoomed_out", "camera_moved", "operator_held", "somebody has the camera", held, band=1),
        ignore("zoomed_out", "camera_moved", "it is free", band=2),
        ignore("zoomed_out", "time_passed", "waits for nothing"),
        ignore("zoomed_in", "frame_observed", "looks at it for its time"),
        move("zoomed_in", "camera_moved", "operator_held", "somebody has the camera", held, band=1),
        ignore("zoomed_in", "camera_moved", "it is free", band=2),
        move("zoomed_in", "time_passed", "zoomed_out", "has looked long enough"),
        *(
            move(state, "follow", "following", "an operator has it follow a finding")
            for state in ("zoomed_out", "zoomed_in", "operator_held", "blocked")
        ),
        move("following", "follow", "following", "an operator has it follow another finding"),
        move("following", "frame_observed", "following", "it has moved", moved_away, band=1),
        ignore("following", "frame_observed", "keeps it in view", band=2),
        move("following", "camera_moved", "operator_held", "somebody has the camera", held, band=1),
        ignore("following", "camera_moved", "it is free", band=2),
        ignore("following", "time_passed", "waits for nothing"),
        ignore("operator_held", "frame_observed", "hands off", held, band=1),
        move("operator_held", "frame_observed", "zoomed_out", "the camera was freed while nobody was asked", band=2),
        ignore("operator_held", "camera_moved", "somebody else has it now", held, band=1),
        move("operator_held", "camera_moved", "zoomed_out", "the camera is free again", band=2),
        ignore("operator_held", "time_passed", "waits for nothing"),
        move("blocked", "frame_observed", "zoomed_out", "frames come quickly enough again", quick, band=1),
        ignore("blocked", "frame_observed", "frames still come too slowly", band=2),
        move("blocked", "camera_moved", "operator_held", "somebody has the camera", held, band=1),
        ignore("blocked", "camera_moved", "it is free", band=2),
        ignore("blocked", "time_passed", "waits for nothing"),
    ),
)
