"""What a flight saw goes to the mission office: once, in parts, whatever the office does. Through a real server."""

from __future__ import annotations

import asyncio
import json
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from autopilot.adapters.missions.client import Answer, Client, Failed
from autopilot.adapters.missions.pushing import LISTS, Bundle, Part, parts_of, read_in_child
from autopilot.ports.config import MissionSection
from autopilot.sim.office import Office
from events.schema.mission_pb2 import PushObservations, PushReported
from projections.bundle import build_push
from projections.canonical import json_text
from tests.autopilot.cli.flown import story_on_disk
from tests.autopilot.missions.bench import Bench, at, example, said
from tests.autopilot.planning.missions import MISSION_ID, uid
from tests.flights import story

pytestmark = pytest.mark.whole
PUSH = PushObservations(vehicle=1, mission_id=MISSION_ID, life_ms=20_000)


@pytest.fixture
def office() -> Iterator[Office]:
    """An office with the example."""
    made = Office([example()])
    made.start()
    yield made
    made.stop()


def seen(observations: int = 3, ignored: int = 1) -> Bundle:
    """Return what a flight saw, as its child prints it."""
    push: Bundle = json.loads(json_text(build_push(story().records)))
    row, item = push["observations"][0], push["ignored_items"][0]
    rows = [row | {"id": f"{number:032d}", "mission_id": MISSION_ID} for number in range(observations)]
    items = [item | {"id": f"{number:032d}"} for number in range(ignored)]
    return push | {"mission_id": MISSION_ID, "observations": rows, "ignored_items": items}


def bench_of(settings: MissionSection, bundle: Bundle | Failed) -> Bench:
    """Return a bench whose flight saw this."""
    bench = Bench(settings)
    bench.seen = bundle
    return bench


def check_office(office: Office, bundle: Bundle) -> None:
    """Check that the office has what was seen, each once and as it is."""
    assert office.mapobjects(MISSION_ID) == {name: bundle[name] for name in ("mission_id", *LISTS)}


def reasons(bench: Bench) -> list[str]:
    """Return what stood in the way, report by report."""
    return [report.because for report in bench.offered if isinstance(report, PushReported)]


def test_what_was_seen_is_with_the_office(office: Office) -> None:
    """Observations and ignored items apart; pushed again, by another effect, nothing is there twice."""
    bundle = seen()
    bench = bench_of(at(office), bundle)
    assert said(bench.run(PUSH, PUSH)) == ["1 3+1 pushed, 0 left after 2", "2 3+1 pushed, 0 left after 2"]
    assert reasons(bench) == ["", ""]
    assert office.answered == {201: 4}
    check_office(office, bundle)


def test_where_nothing_was_seen_nothing_is_sent(office: Office) -> None:
    """And that is a push that was done."""
    assert said(bench_of(at(office), seen(0, 0)).run(PUSH)) == ["1 0+0 pushed, 0 left after 0"]
    assert office.asked["POST"] == 0


@pytest.mark.parametrize("fault", ["failing", "dropping", "truncated"])
def test_what_may_be_better_later_is_tried_again(office: Office, fault: str) -> None:
    """Under the same key: what the office did though nobody heard of it is done once. The reason is said once."""
    setattr(office.faults, fault, 2)
    bundle = seen()
    bench = bench_of(at(office), bundle)
    assert said(bench.run(PUSH)) == ["1 0+0 pushed, 4 left after 1, goes on", "1 3+1 pushed, 0 left after 4"]
    assert bench.waits_s == [1, 2]
    assert office.answered[200] == {"failing": 0}.get(fault, 2)
    check_office(office, bundle)


def test_an_office_that_is_out_of_reach_gets_no_more(office: Office, monkeypatch: pytest.MonkeyPatch) -> None:
    """As often as may be tried; what it took before it took."""
    bundle = seen(60, 5)
    bench = bench_of(at(office, push_bytes=20_000), bundle)
    parts = list(parts_of(bundle, 20_000, "x"))
    posted = office.post

    def third_fails(*words: Any) -> Any:
        if office.asked["POST"] == 2:
            office.faults.failing = 99
        return posted(*words)

    monkeypatch.setattr(office, "post", third_fails)
    took = sum(part.observations for part in parts[:2])
    assert said(bench.run(PUSH)) == [
        f"1 {took}+0 pushed, {65 - took} left after 3, goes on",
        f"1 {took}+0 pushed, {65 - took} left after 6",
    ]
    assert reasons(bench)[-1].endswith("the office answers 500 Internal Server Error")
    assert [len(rows) for name, rows in (office.mapobjects(MISSION_ID) or {}).items() if name in LISTS] == [took, 0]


def test_a_part_that_is_refused_keeps_no_other_back(office: Office) -> None:
    """It is said as final with the office's words, and only that part is left."""
    office.faults.refusing = 1
    bundle = seen()
    bench = bench_of(at(office), bundle)
    assert said(bench.run(PUSH)) == ["1 0+1 pushed, 3 left after 2"]
    assert 'answers 409: {"error": "the office does not want this"}' in reasons(bench)[0]
    check_office(office, bundle | {"observations": []})


@pytest.mark.parametrize(
    ("spoil", "settings", "words"),
    [
        (lambda it: it._missions.clear(), {}, "answers 404"),
        (lambda it: setattr(it, "token", "x"), {}, "answers 401; see [mission] token_file"),
        (
            lambda it: it._missions[MISSION_ID].tree.update(mission_id=uid(7)),
            {},
            "of another schema or another mission",
        ),
        (lambda _: None, {"push_bytes": 4_000_000}, "answers 413"),
        (
            lambda it: setattr(it.faults, "slow_s", 30),
            {"attempts": 1, "timeout_s": 0.3},
            "no whole answer within 0.3 s",
        ),
    ],
)
def test_what_will_not_be_better_is_said_at_once(
    office: Office, spoil: Callable[[Office], None], settings: dict[str, Any], words: str
) -> None:
    """Once, as final, without waiting; all of it is left."""
    spoil(office)
    bench = bench_of(at(office, **settings), seen(2_000, 0))
    (report,) = bench.run(PUSH)
    assert isinstance(report, PushReported)
    assert (report.final, report.observations, report.left, bench.waits_s) == (True, 0, 2_000, [])
    assert words in report.because


def test_an_answer_that_means_nothing_is_no_word_that_it_was_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """304 to a POST: what is not said to be there is left."""

    async def post(*_words: object) -> Answer:
        return Answer(status=304, data=b"", etag="")

    monkeypatch.setattr(Client, "post", post)
    bench = bench_of(MissionSection(url="http://127.0.0.1:9", mission_id=MISSION_ID), seen())
    assert said(bench.run(PUSH)) == ["1 0+0 pushed, 4 left after 2"]
    assert reasons(bench) == ["the office answers 304 to a push"]


def test_nobody_there(office: Office) -> None:
    """No connection is tried again too."""
    settings = at(office, attempts=2)
    office.stop()
    assert said(bench_of(settings, seen()).run(PUSH)) == [
        "1 0+0 pushed, 4 left after 1, goes on",
        "1 0+0 pushed, 4 left after 2",
    ]


def test_it_ends_with_its_life(office: Office) -> None:
    """Whatever it is at."""
    office.faults.slow_s = 30
    bench = bench_of(at(office), seen())
    life = PushObservations(vehicle=1, mission_id=MISSION_ID, life_ms=300)
    assert said(bench.run(life)) == ["1 0+0 pushed, 4 left after 1"]
    assert reasons(bench) == ["it was not done within 0.3 s"]


def test_another_flight_is_told_nothing(office: Office) -> None:
    """Where the flight ends meanwhile its push ends too: its seq would mean something else in the next."""
    office.faults.failing = 99
    bench = bench_of(at(office), seen())
    sleep = bench._sleep

    async def follow(seconds: float) -> None:
        await sleep(seconds)
        bench.folder = Path("flights/000002-5e6f7a8b")

    bench.adapter._sleep = follow
    assert said(bench.run(PUSH)) == ["1 0+0 pushed, 4 left after 1, goes on"]
    assert office.asked["POST"] == 1


def test_a_mission_from_a_file(tmp_path: Path) -> None:
    """There is nobody to push to; nor where no flight is open, nor where too much is asked for."""
    settings = MissionSection(file=str(tmp_path / "m.json"))
    bench = bench_of(settings, seen())
    bench.run(PUSH)
    assert reasons(bench) == ["the mission comes from a file: there is no office to push to"]
    bench = bench_of(MissionSection(url="http://127.0.0.1:9", mission_id=MISSION_ID), seen())
    bench.folder = None
    bench.run(PUSH)
    assert reasons(bench) == ["no flight is open"]


def test_too_much_at_once_is_refused(office: Office) -> None:
    """Each effect has an outcome, also those for which there is no room."""
    bench = bench_of(at(office), seen())

    async def work() -> None:
        for seq in range(10):
            bench.adapter.perform(seq, PUSH, 0)
        async with asyncio.timeout(30):
            await asyncio.gather(*bench.adapter._tasks)
        await bench.adapter.stop()

    asyncio.run(work())
    assert sorted(filter(None, reasons(bench))) == ["too much is asked for at once"] * 2
    assert len(bench.offered) == 10


def sizes(parts: list[Part]) -> list[tuple[int, int]]:
    """Return how many rows each post has."""
    return [(part.observations, part.ignored_items) for part in parts]


def test_more_than_fits_is_sent_in_several_posts() -> None:
    """As few as there can be, none too long, every row once and in order; a row that is too long by itself alone."""
    bundle = seen(60, 40)
    parts = list(parts_of(bundle, 16_384, "1/7"))
    bodies = [json.loads(part.body) for part in parts]
    for name in LISTS:
        assert [row for body in bodies for row in body[name]] == bundle[name]
    assert sizes(parts) == [tuple(len(body[name]) for name in LISTS) for body in bodies]
    assert max(len(part.body) for part in parts) <= 16_384
    row = len(json.dumps(bundle["observations"][0], separators=(",", ":"))) + 1
    assert all(len(part.body) + row > 16_384 for part in parts[: sizes(parts).index((0, parts[-1].ignored_items)) - 1])
    assert {name: body[name] for body in bodies for name in body if name not in LISTS} == {
        name: value for name, value in bundle.items() if name not in LISTS
    }
    assert sizes(list(parts_of(seen(2, 1), 10, "x"))) == [(1, 0), (1, 0), (0, 1)]


def test_a_key_is_made_of_flight_effect_and_body() -> None:
    """The same again has the same; another flight, effect or body another."""
    keys = {part.key for _ in range(2) for part in parts_of(seen(40, 4), 16_384, "1 7")}
    assert len(keys) == len(list(parts_of(seen(40, 4), 16_384, "1 7")))
    assert keys.isdisjoint(part.key for part in parts_of(seen(40, 4), 16_384, "1 8"))


def test_it_is_read_by_a_child(tmp_path: Path) -> None:
    """Up to the effect; what a child can't read it says."""
    folder = story_on_disk(tmp_path)
    records = story().records
    wanted = json.loads(json_text(build_push(records)))
    assert asyncio.run(read_in_child(folder, records[-1].seq)) == wanted
    early = asyncio.run(read_in_child(folder, 3))
    assert isinstance(early, dict)
    assert early["observations"] == []
    failed = asyncio.run(read_in_child(tmp_path / "none", 3))
    assert isinstance(failed, Failed)
    assert (failed.again, failed.because.startswith("what was seen can't be read: autopilot: ")) == (False, True)


def test_a_child_that_is_not_to_be_had(office: Office, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """It ends the push with words, and nothing is sent."""
    monkeypatch.setattr(sys, "executable", str(tmp_path / "none"))
    bench = Bench(at(office))
    bench.adapter._read = read_in_child
    bench.run(PUSH)
    assert reasons(bench) == ["what was seen can't be read: No such file or directory"]
    assert office.asked["POST"] == 0


def test_a_push_that_is_given_up_leaves_no_child(tmp_path: Path) -> None:
    """It is ended with whoever waits for it."""
    begun: list[asyncio.subprocess.Process] = []
    make = asyncio.create_subprocess_exec

    async def noted(*words: str, **how: Any) -> asyncio.subprocess.Process:
        begun.append(await make(*words, **how))
        return begun[-1]

    async def work() -> None:
        task = asyncio.create_task(read_in_child(tmp_path, 3))
        async with asyncio.timeout(10):
            while not begun:
                await asyncio.sleep(0.001)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(asyncio, "create_subprocess_exec", noted)
        asyncio.run(work())
    assert begun[0].returncode == -signal.SIGKILL
