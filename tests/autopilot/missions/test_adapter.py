"""The node's side of a mission office: outcomes for every effect, whatever the office does. Through a real server."""

from __future__ import annotations

import asyncio
import hashlib
import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from autopilot.ports.config import MissionSection
from autopilot.sim.office import Office
from events.schema.mission_pb2 import FetchMission, MissionPlanned, MissionUnavailable, PostWaypoint, WaypointPosted
from tests.autopilot.missions.bench import Bench, at, because, example, said
from tests.autopilot.planning.missions import AROUND, MISSION_ID, fence, tree, uid, vertex, waypoint

pytestmark = pytest.mark.whole


@pytest.fixture
def office() -> Iterator[Office]:
    """An office with the example."""
    made = Office([example()])
    made.start()
    yield made
    made.stop()


def test_a_mission_is_fetched_planned_and_kept(office: Office) -> None:
    """With places for the core, heights above the sea and above home, and the JSON under its digest."""
    bench = Bench(at(office))
    (made,) = bench.run(FetchMission(vehicle=1))
    assert isinstance(made, MissionPlanned)
    assert (made.vehicle, made.mission_id, made.effect_seq, made.fixed_wing) == (1, MISSION_ID, 1, False)
    assert [item.command for item in made.items][:4] == [22, 178, 16, 16]
    assert (made.items[-2].command, made.items[-1].command) == (20, 21)
    up, speed, first = made.items[:3]
    assert (up.height_mm, up.place.altitude_mm, up.place.east_mm) == (40_000, 480_000, 0)
    assert (speed.parameter_1_e3, speed.parameter_2_e3, speed.parameter_3_e3) == (1000, 7000, -1000)
    assert (speed.HasField("place"), speed.HasField("height_mm"), speed.source_id) == (False, False, uid(0))
    assert (round(first.place.east_mm, -2), round(first.place.north_mm, -2)) == (20_000, 20_000)
    assert (first.HasField("parameter_4_e3"), first.place.h3_cell > 0) == (False, True)
    assert list(made.breakpoints) == [len(made.items) - 2]
    assert [(it.inclusion, len(it.vertices)) for it in made.fences] == [(True, 4)]
    assert (made.return_place.east_mm, made.return_place.altitude_mm) == (0, 440_000)
    assert list(bench.kept) == [made.json_sha256.hex()]
    assert hashlib.sha256(bench.kept[made.json_sha256.hex()]).digest() == made.json_sha256
    assert made.revision.startswith('"1-')


def test_what_has_not_changed_is_not_sent_again(office: Office) -> None:
    """The second answer is 304, and the plan is told again; a change comes through."""
    bench = Bench(at(office))

    def change(seq: int) -> None:
        if seq == 3:
            office.put(example() | {"items": example()["items"][:1]})

    assert said(bench.run(*[FetchMission(vehicle=1)] * 3, before=change)) == [
        "1 planned 15",
        "2 planned 15",
        "3 planned 4",
    ]
    assert dict(office.answered) == {200: 2, 304: 1}
    first, second, third = bench.offered
    assert isinstance(first, MissionPlanned)
    assert isinstance(second, MissionPlanned)
    assert isinstance(third, MissionPlanned)
    assert (first.revision == second.revision, first.revision == third.revision) == (True, False)


def test_without_an_etag_the_digest_is_the_revision(office: Office) -> None:
    """And the mission is sent each time."""
    office.faults.no_etag = True
    bench = Bench(at(office))
    made, again = bench.run(FetchMission(vehicle=1), FetchMission(vehicle=1))
    assert isinstance(made, MissionPlanned)
    assert isinstance(again, MissionPlanned)
    assert made.revision == again.revision == made.json_sha256.hex()
    assert office.answered[200] == 2


@pytest.mark.parametrize("fault", ["failing", "dropping", "truncated"])
def test_what_may_be_better_later_is_tried_again(office: Office, fault: str) -> None:
    """After 1, 2 and 4 s; the reason is said once."""
    setattr(office.faults, fault, 3)
    bench = Bench(at(office))
    assert said(bench.run(FetchMission(vehicle=1)))[-1] == "1 planned 15"
    assert bench.waits_s == [1, 2, 4]
    assert [message.final for message in bench.offered if isinstance(message, MissionUnavailable)] == [False]


def test_waits_end_at_the_longest_and_tries_at_the_last(office: Office) -> None:
    """1, 2, 4 ... 30, 30; then it is final."""
    office.faults.failing = 99
    bench = Bench(at(office, attempts=8))
    assert said(bench.run(FetchMission(vehicle=1))) == ["1 none after 1", "1 none after 8, final"]
    assert bench.waits_s == [1, 2, 4, 8, 16, 30, 30]
    assert because(bench.offered[-1]).endswith("the office answers 500 Internal Server Error")
    assert office.asked["GET"] == 8


def test_nobody_there(office: Office) -> None:
    """No connection is tried again too."""
    settings = at(office, attempts=2)
    office.stop()
    bench = Bench(settings)
    assert said(bench.run(FetchMission(vehicle=1))) == ["1 none after 1", "1 none after 2, final"]


def test_an_office_that_trickles_is_given_up(office: Office) -> None:
    """The time is for the whole answer."""
    office.faults.slow_s = 30
    bench = Bench(at(office, attempts=1, timeout_s=0.3))
    assert said(bench.run(FetchMission(vehicle=1))) == ["1 none after 1, final"]
    assert because(bench.offered[0]).endswith("no whole answer within 0.3 s")


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda it: setattr(it.faults, "other_major", True), "and this program reads version 1.x.y"),
        (lambda it: setattr(it.faults, "padding_bytes", 2_000_000), "the answer has more than 1048576 bytes"),
        (lambda it: it._missions.clear(), "the office answers 404"),
        (lambda it: setattr(it, "token", "x"), "the office answers 401; see [mission] token_file"),
        (lambda it: it.put(example() | {"items": []}), "$.items: has 0 entries"),
        (
            lambda it: it.put(tree(waypoint((900, 0)), fences=[fence(AROUND, "INCLUSION")])),
            "$.items[0].at: is forbidden by",
        ),
        (
            lambda it: it._missions[MISSION_ID].tree.update(mission_id=uid(7)),
            f"the office sent mission {uid(7)}, which was not asked for",
        ),
    ],
)
def test_what_will_not_be_better_is_said_at_once(office: Office, spoil: Callable[[Office], None], words: str) -> None:
    """Once, as final, without waiting."""
    spoil(office)
    bench = Bench(at(office))
    assert said(bench.run(FetchMission(vehicle=1))) == ["1 none after 1, final"]
    assert words in because(bench.offered[0])
    assert bench.waits_s == []
    assert bench.kept == {}


def test_home_is_waited_for(office: Office) -> None:
    """A mission is planned around it."""
    bench = Bench(at(office), home_after=3)
    assert said(bench.run(FetchMission(vehicle=1))) == ["1 none after 0", "1 planned 15"]
    assert bench.waits_s == [1, 1, 1]


def test_an_inbox_without_room_is_offered_again(office: Office) -> None:
    """No outcome is lost."""
    bench = Bench(at(office), room_after=2)
    assert said(bench.run(FetchMission(vehicle=1))) == ["1 planned 15"]
    assert bench.waits_s == [0.05, 0.05]


def test_a_mission_that_cannot_be_kept_is_not_told(office: Office) -> None:
    """The log would name what is not there."""
    bench = Bench(at(office, attempts=1))
    bench.kept_badly = OSError(28, "No space left on device")
    assert said(bench.run(FetchMission(vehicle=1))) == ["1 none after 1, final"]
    assert because(bench.offered[0]) == "the mission can't be kept: No space left on device"


def middle(before_item: int = 2) -> PostWaypoint:
    """Return the wish for a waypoint."""
    made = PostWaypoint(vehicle=1, mission_id=MISSION_ID, height_mm=35_000, before_item=before_item, poi_id=uid(50))
    spot = vertex((60, 60))
    made.place.latitude_e7, made.place.longitude_e7 = round(spot["latitude"] * 1e7), round(spot["longitude"] * 1e7)
    return made


def test_a_waypoint_in_the_middle(office: Office) -> None:
    """It is asked for, and the mission is planned as it is then."""
    bench = Bench(at(office))
    assert said(bench.run(FetchMission(vehicle=1), middle(3))) == ["1 planned 15", "2 posted", "2 planned 16"]
    items = office.mission(MISSION_ID)["items"]
    assert [item["kind"] for item in items][:3] == ["waypoint", "waypoint", "region_search"]
    assert items[1]["at"] == vertex((60, 60)) | {"altitude_m": 35.0}
    planned = bench.offered[-1]
    assert isinstance(planned, MissionPlanned)
    assert planned.items[3].source_id == items[1]["id"]


@pytest.mark.parametrize(
    ("before_item", "place"),
    [(0, 0), (1, 0), (2, 1), (3, 1), (4, 3), (12, 3), (13, 3), (14, 3), (99, 3)],
)
def test_where_a_waypoint_goes(office: Office, before_item: int, place: int) -> None:
    """Before the item that the planned one comes from; out of the middle of one, behind it."""
    Bench(at(office)).run(FetchMission(vehicle=1), middle(before_item))
    items = office.mission(MISSION_ID)["items"]
    assert [item["id"] not in [uid(n) for n in range(4)] for item in items].index(True) == place


@pytest.mark.parametrize("before_item", [4, 8, 12])
def test_in_the_plan_it_stands_where_it_was_asked_for(office: Office, before_item: int) -> None:
    """Also in the middle of a search; all else keeps its order, and the breakpoint its item."""
    first, _, second = Bench(at(office)).run(FetchMission(vehicle=1), middle(before_item))
    assert isinstance(first, MissionPlanned)
    assert isinstance(second, MissionPlanned)
    sources = [uid(number) for number in range(4)]
    new = [index for index, item in enumerate(second.items) if item.source_id and item.source_id not in sources]
    assert new == [before_item]
    assert [*second.items[:before_item], *second.items[before_item + 1 :]] == list(first.items)
    assert second.items[second.breakpoints[0]].command == first.items[first.breakpoints[0]].command


@pytest.mark.parametrize(("fault", "waits"), [("failing", [1]), ("dropping", [1])])
def test_an_answer_that_was_lost_puts_no_second_waypoint(office: Office, fault: str, waits: list[float]) -> None:
    """The office did it and said nothing: asked again under the same key it does nothing more."""
    bench = Bench(at(office))

    def spoil(seq: int) -> None:
        if seq == 2:
            setattr(office.faults, fault, 1)

    assert said(bench.run(FetchMission(vehicle=1), middle(), before=spoil))[1:] == ["2 posted", "2 planned 16"]
    assert (len(office.mission(MISSION_ID)["items"]), office.asked["POST"], bench.waits_s) == (5, 2, waits)


def test_a_waypoint_that_is_refused(office: Office) -> None:
    """The office's own words, once."""
    bench = Bench(at(office))

    def change(seq: int) -> None:
        if seq == 2:
            office.put(example() | {"items": example()["items"][1:2]})

    (posted,) = bench.run(FetchMission(vehicle=1), middle(1), before=change)[1:]
    assert isinstance(posted, WaypointPosted)
    assert 'answers 409: {"error": "there is no item to go before: the mission has changed"}' in posted.failure


def test_a_waypoint_after_a_restart_fetches_first(office: Office) -> None:
    """What planned item is meant is known from the plan; of another mission it is refused."""
    assert said(Bench(at(office)).run(middle())) == ["1 posted", "1 planned 16"]
    other = middle()
    other.mission_id = uid(3)
    assert said(Bench(at(office)).run(other)) == ["1 posted: this mission can't be had from the office"]


def test_a_token_goes_along(office: Office, tmp_path: Path) -> None:
    """From a file that nobody else can read; read again each time."""
    office.token = "s3cret"
    file = tmp_path / "token"
    file.write_text("s3cret\n")
    file.chmod(0o600)
    assert said(Bench(at(office, token_file=str(file))).run(FetchMission(vehicle=1))) == ["1 planned 15"]


def test_a_mission_from_a_file(tmp_path: Path) -> None:
    """Its digest is its revision; it takes no waypoints."""
    file = tmp_path / "m.json"
    data = json.dumps(example()).encode()
    file.write_bytes(data)
    settings = MissionSection(file=str(file))
    bench = Bench(settings)
    assert said(bench.run(FetchMission(vehicle=1), middle())) == [
        "1 planned 15",
        "2 posted: the mission comes from a file: there is no office to ask",
    ]
    planned = bench.offered[0]
    assert isinstance(planned, MissionPlanned)
    assert planned.revision == hashlib.sha256(data).hexdigest()
    file.write_bytes(b" " * 2_000_000)
    bench = Bench(settings)
    assert "has 1048577 bytes, more than 1048576" in because(bench.run(FetchMission(vehicle=1))[0])
    file.unlink()
    bench = Bench(settings)
    assert because(bench.run(FetchMission(vehicle=1))[0]) == f"[mission] file: {file}: No such file or directory"


def test_too_much_at_once_is_refused(office: Office) -> None:
    """Each effect has an outcome, also those for which there is no room."""
    office.faults.slow_s = 0.2
    bench = Bench(at(office))

    async def work() -> None:
        for seq in range(10):
            bench.adapter.perform(seq, FetchMission(vehicle=1), 0)
        async with asyncio.timeout(30):
            await asyncio.gather(*bench.adapter._tasks)
        await bench.adapter.stop()

    asyncio.run(work())
    assert sorted(said(bench.offered)) == sorted(
        [f"{seq} planned 15" for seq in range(8)] + [f"{seq} none after 0, final" for seq in (8, 9)]
    )


def test_stopping_gives_up(office: Office) -> None:
    """In the middle of a wait nothing hangs."""
    office.faults.slow_s = 30
    bench = Bench(at(office, timeout_s=60))

    async def work() -> None:
        bench.adapter.perform(1, FetchMission(vehicle=1), 0)
        while office.asked["GET"] == 0:
            await asyncio.sleep(0.01)
        async with asyncio.timeout(10):
            await bench.adapter.stop()

    asyncio.run(work())
    assert bench.offered == []
