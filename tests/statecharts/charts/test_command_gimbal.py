"""The chart `command` as tables: what a gimbal can't do, what would turn the vehicle, who has it, and zoom."""

from __future__ import annotations

import pytest

from events.schema.flight_pb2 import ROI_TURNING_REFUSE, ROI_TURNING_WARN
from events.schema.orders_pb2 import SendAck
from statecharts.words import degrees, degrees_rounded
from tests.checks import check_chart, check_equal
from tests.stories import Story


def test_angles_beyond_the_limits() -> None:
    """The limit itself is allowed; the words name axis, angle and limit. Yaw from north is not judged."""
    check_chart(
        "command",
        """
        at_s | observe | say | why
        0 | order z turn pitch=9000 yaw=18000 | turn 90,180 | all gates passed
        0.1 | described pans pitch=-9000,2000 yaw=-3050,4000 | - | -
        1 | order a turn pitch=2001 | a rejected | pitch 20.01 is above the limit of 20
        1.1 | order b turn pitch=-9001 | b rejected | pitch -90.01 is below the limit of -90
        1.2 | order c turn nose yaw=4001 | c rejected | yaw 40.01 is above the limit of 40
        1.3 | order d turn nose yaw=32949 | d rejected | yaw -30.51 is below the limit of -30.5
        1.4 | order e turn pitch=-9000 yaw=18000 | turn -90,180 | all gates passed
        1.5 | order f turn nose pitch=2000 yaw=32950 | turn 20,329.5 | all gates passed
        1.6 | order g turn nose yaw=4000 | turn -30,40 | all gates passed
        1.7 | order h point | look 1,1 | all gates passed
        2 | described pans pitch=-9000,2000 yaw=-18000,18000 | - | -
        2.1 | order i turn nose yaw=18000 | turn -30,180 | all gates passed
        2.2 | described pans yaw=-17000,19000 | - | -
        2.3 | order k turn nose yaw=18500 | turn -30,185 | all gates passed
        3 | described pans | - | -
        3.1 | order j turn nose pitch=9000 yaw=18000 | turn 90,180 | all gates passed
        """,
    )


def test_a_place_that_would_turn_the_vehicle_is_refused() -> None:
    """Also while the gimbal is not known; angles and letting go turn nothing."""
    check_chart(
        "command",
        """
        at_s | observe                    | say         | why
        0    | order a point              | a rejected  | the gimbal is not known yet: the vehicle itself might turn
        0.1  | order b turn               | turn -30,90 | all gates passed
        1    | described turns            | -           | -
        1.1  | order c point              | c rejected  | no gimbal that pans: the vehicle itself would turn
        1.2  | order d turn               | turn -30,90 | all gates passed
        1.3  | order e release            | let go      | all gates passed
        2    | described pans pitch=0,1   | -           | -
        2.1  | order f point              | look 1,1    | all gates passed
        2.2  | answered f 0               | f accepted  | COMMAND_ACK: MAV_RESULT_ACCEPTED
        """,
        roi_turning=ROI_TURNING_REFUSE,
    )


def test_a_place_that_may_turn_the_vehicle_is_warned_of() -> None:
    """In the answer's words, on the way and at the end; the order is carried out."""
    story = check_chart(
        "command",
        """
        at_s | observe       | why
        0    | described turns | -
        1    | order a point | all gates passed
        1.2  | answered a 0  | COMMAND_ACK: MAV_RESULT_ACCEPTED; no gimbal that pans: the vehicle itself may turn
        2    | order b turn  | all gates passed
        2.2  | answered b 0  | COMMAND_ACK: MAV_RESULT_ACCEPTED
        """,
        roi_turning=ROI_TURNING_WARN,
    )
    told = [record.message for record in story.flight.records if record.kind.name == "send_ack"]
    assert isinstance(told[0], SendAck)
    check_equal(told[0].detail, "all gates passed; no gimbal that pans: the vehicle itself may turn")


def test_who_else_has_the_gimbal_is_said() -> None:
    """Whatever the vehicle answers; not for what does not point."""
    check_chart(
        "command",
        """
        at_s | observe         | say         | why
        0    | control 255/190 | -           | -
        0.1  | lens zooms      | -           | -
        1    | order a point   | look 1,1    | all gates passed
        1.2  | answered a 0    | a accepted  | COMMAND_ACK: MAV_RESULT_ACCEPTED; 255/190 controls the gimbal
        2    | order b turn    | turn -30,90 | all gates passed
        2.2  | answered b 2    | b rejected  | COMMAND_ACK: MAV_RESULT_DENIED; 255/190 controls the gimbal
        3    | order c zoom    | zoom 40     | all gates passed
        3.2  | answered c 0    | c accepted  | COMMAND_ACK: MAV_RESULT_ACCEPTED
        4    | order d release | let go      | all gates passed
        4.2  | answered d 0    | d accepted  | COMMAND_ACK: MAV_RESULT_ACCEPTED
        5    | control 0/0     | -           | -
        6    | order e point   | take; look 1,1 | all gates passed
        6.2  | answered e 0    | e accepted  | COMMAND_ACK: MAV_RESULT_ACCEPTED
        """,
    )


def test_zoom_where_there_is_one() -> None:
    """Only a camera that says that it can is zoomed; a fixed one may be; none that is not on board."""
    check_chart(
        "command",
        """
        at_s | observe                              | say           | why
        0    | order a zoom                         | a unsupported | this camera has no zoom
        0.1  | lens fixed                           | -             | -
        0.2  | order b zoom                         | b unsupported | this camera has no zoom
        0.3  | order c zoom camera=7                | c rejected    | no such camera, or nothing turns it
        0.4  | order d zoom camera=2                | d unsupported | this camera has no zoom
        1    | lens zooms                           | -             | -
        1.1  | order e zoom overdue=259200000       | zoom 40       | all gates passed
        1.2  | answered e 3                         | e unsupported | COMMAND_ACK: MAV_RESULT_UNSUPPORTED
        1.3  | order f zoom by=viewer roles=viewer  | f unauthorised | role not permitted
        1.4  | vehicle down                         | -             | -
        1.5  | order g zoom                         | g rejected    | no vehicle is heard
        """,
    )


def test_a_zoom_takes_the_camera() -> None:
    """Whoever zooms has it, so that the node keeps its hands off; the aim stays whose it was."""
    story = check_chart(
        "camera",
        """
        at_s | observe               | state         | say          | why
        0    | lens zooms            | -             | -            | -
        0.1  | order a zoom          | 1/1 operator  | ALPHA has it | an operator zooms it
        1    | order b zoom by=bravo | 1/1 operator  | BRAVO has it | an operator zooms it: last write wins
        2    | order c release       | 1/1 released  | -            | an operator lets it go
        3    | order d zoom          | 1/1 operator  | ALPHA has it | an operator zooms it
        """,
    )
    check_equal(story.flight.state.aims.get("1/1") is None or story.flight.state.aims["1/1"].order, "")


def test_the_node_does_not_look_closer_where_that_turns_the_vehicle() -> None:
    """Its own wish for a place is refused like an operator's."""
    for words, looks in (("described turns", False), ("zoomed 0", False), ("described pans", True)):
        story = Story(scan_enabled=True, sightings_to_ask=1, frame_rate_floor_mhz=0, roi_turning=ROI_TURNING_REFUSE)
        for line in (words, "frame person@9,9", "frame person@9,9"):
            story.tell(line)
        kinds = {record.kind.name for record in story.flight.records}
        check_equal("point_at_place" in kinds, looks)


def confirmed(**changes: object) -> Story:
    """Return a story with a finding at 9, 9 that a person has confirmed, on a vehicle that is not turned by it."""
    story = Story(sightings_to_ask=1, frame_rate_floor_mhz=0, **({"roi_turning": ROI_TURNING_REFUSE} | changes))
    for line in ("frame person@9,9", "time", "order c confirm p1"):
        story.tell(line)
    return story


def test_nothing_is_followed_that_would_turn_the_vehicle() -> None:
    """Following has the camera look at places, so it is held to the same as a place is."""
    check_chart(
        "command",
        """
        at_s | observe           | say        | why
        1    | order a follow p1 | a rejected | the gimbal is not known yet: the vehicle itself might turn
        2    | described turns   | -          | -
        3    | order b follow p1 | b rejected | no gimbal that pans: the vehicle itself would turn
        4    | described pans    | -          | -
        5    | order d follow p1 | d accepted; look 9,9 | the camera follows it
        """,
        confirmed(),
    )


def test_whoever_has_something_followed_is_told_what_may_turn_and_who_has_the_gimbal() -> None:
    """As whoever points; control is asked for before the camera is turned."""
    check_chart(
        "command",
        """
        at_s | observe           | say                        | why
        1    | described turns   | -                          | -
        2    | control 255/190   | -                          | -
        3    | order a follow p1 | a accepted; look 9,9       | the camera follows it; 255/190 controls the gimbal; \
no gimbal that pans: the vehicle itself may turn
        4    | described pans    | -                          | -
        5    | control 0/0       | -                          | -
        6    | order b follow p9 | b rejected                 | only what a person has confirmed is followed
        7    | order d follow p1 | take; d accepted; look 9,9 | the camera follows it
        8    | again d           | d accepted again           | the camera follows it
        """,
        confirmed(roi_turning=ROI_TURNING_WARN),
    )


@pytest.mark.parametrize(
    ("words", "turns"),
    [("described turns", False), ("vehicle down", False), ("described pans", True), ("zoomed 0", True)],
)
def test_what_is_followed_is_not_turned_after_where_that_turns_the_vehicle(words: str, turns: bool) -> None:
    """Nor while the vehicle is not heard; what is known of the gimbal may change while something is followed."""
    story = confirmed()
    for line in ("described pans", "order a follow p1", words):
        story.tell(line)
    kinds = {record.kind.name for record in story.tell("frame person@14,9")}
    check_equal("point_at_place" in kinds, turns)


@pytest.mark.parametrize(
    ("angle_cdeg", "words", "rounded"),
    [(0, "0", "0.0"), (9_000, "90", "90.0"), (-4_550, "-45.5", ""), (1, "0.01", "0.0"), (1_095, "10.95", "11.0")],
)
def test_degrees_in_words(angle_cdeg: int, words: str, rounded: str) -> None:
    """By integers alone."""
    check_equal(degrees(angle_cdeg), words)
    if angle_cdeg >= 0:
        check_equal(degrees_rounded(angle_cdeg), rounded)
