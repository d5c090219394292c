"""The mission on the status: the screen, the wire, and nothing where none is flown."""

from __future__ import annotations

from autopilot.cli.status import screen
from autopilot.node.board_mission import say_mission
from events.schema.waypoint_pb2 import NodeStatus
from projections import status
from tests import flying
from tests.checks import check_equal
from tests.stories import Story

TOLD = ("no-mission", "planned", "report pass,degraded,fail", "order a begin", "report degraded")


def shown(*told: str, **changes: object) -> status.Status:
    """Return the status after a story on the ground."""
    tale = Story(*flying.opening(**changes))
    for words in told:
        tale.tell(words)
    folded = status.Status()
    for record in tale.flight.records:
        folded = status.apply(folded, record)
    return folded


def lines(folded: status.Status) -> list[str]:
    """Return the lines of the screen that are about the mission."""
    whole = list(screen(status.plain(folded), 0))
    begin = next((at for at, line in enumerate(whole) if line.startswith("mission")), len(whole))
    end = next((at for at, line in enumerate(whole) if line.startswith(("camera", "failsafes"))), 0)
    return whole[begin:end]


def test_on_one_screen() -> None:
    """Before there is a mission, with a self-test that failed, and in the air."""
    check_equal(
        lines(shown("no-mission")),
        ["mission   checking: the vehicle is heard: which mission?", "          gone", "self-test idle"],
    )
    check_equal(
        lines(shown(*TOLD[:3])),
        [
            "mission   selftest: planned, item 1 of 4, 0 fences",
            "self-test failed, report 11",
            "          item 1: degraded, ",
            "          item 2: fail, ",
        ],
    )
    check_equal(lines(shown(*TOLD, "at 2 reached=2"))[0], "mission   selftest: planned, item 4 of 4, 0 fences")


def test_on_the_wire() -> None:
    """What is absent is no news."""
    said = NodeStatus()
    say_mission(said, shown(*TOLD, "at 1").picture)
    one = said.mission
    check_equal(
        (one.state, one.mission_id, one.items, one.next_item, one.selftest), ("selftest", "m", 4, 1, "awaiting")
    )
    check_equal(
        (list(one.findings), one.HasField("report_id"), one.HasField("unavailable")),
        (["item 0: degraded, "], True, False),
    )
    said = NodeStatus()
    say_mission(said, shown("no-mission").picture)
    check_equal((said.mission.HasField("mission_id"), said.mission.unavailable), (False, "gone"))


def test_what_became_of_a_push() -> None:
    """On the screen and on the wire, from its first word on."""
    said = NodeStatus()
    say_mission(said, shown("planned").picture)
    check_equal(said.mission.HasField("pushed"), False)
    kept = "3 observations and 1 ignored items are with the mission office"
    for told, words in (
        ("pushed left=2 again=", f"{kept}, 2 are not: the office is shut; 1 posts, goes on trying"),
        ("pushed left=2", f"{kept}, 2 are not: the office is shut; 1 posts, this flight keeps them"),
        ("pushed", kept),
    ):
        folded = shown("planned", told)
        say_mission(said, folded.picture)
        check_equal((said.mission.pushed, lines(folded)[1]), (words, f"          {words}"))


def test_a_node_that_flies_none_says_nothing() -> None:
    """Neither on the screen nor on the wire."""
    folded, said = shown("planned", "at 1", mission_enabled=False), NodeStatus()
    say_mission(said, folded.picture)
    check_equal((lines(folded), said.HasField("mission")), ([], False))
