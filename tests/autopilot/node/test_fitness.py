"""The items of the self-test at each of their limits, and the performer that looks and reports."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from google.protobuf.message import Message

from autopilot.node import selftest as performer
from autopilot.node.fitness import DEGRADED, FAIL, HOUR_MS, ITEMS, MIB, PASS, SKIPPED, Found, judged
from autopilot.node.selftest import PROBE, Noted, written
from autopilot.ports.config import Config
from autopilot.ports.edges import EyesFacts, InputClass, Offer, VehicleFacts
from events.schema.mission_pb2 import RunSelftest, SelftestReported
from statecharts import State
from tests import flying
from tests.checks import check_equal
from tests.stories import Story

VEHICLE = VehicleFacts(
    linked=True,
    commandable=True,
    armed=False,
    fix_type=3,
    satellites=8,
    hdop_e2=150,
    charge_percent=50,
    voltage_mv=15_000,
    home=None,
    heard_ms_ago={},
)
WELL = Found(
    log_failure="",
    free_bytes=1000 * MIB,
    space_failure="",
    needed_bytes=1000 * MIB,
    clock_trusted=True,
    token_left_ms=HOUR_MS,
    has_epoch=True,
    list_overdue_ms=0,
    has_camera=True,
    frame_ms_ago=3_000,
    detector_us=100_000,
    has_gimbal=True,
    gimbal_ms_ago=3_000,
    vehicle=VEHICLE,
    return_percent=25,
    fences=1,
    mission_items=1,
    has_mesh=True,
    operator_ms_ago=5_000,
)


def test_at_its_limits_everything_passes() -> None:
    """But for the map, which nobody fetches."""
    verdicts = {item.name: item.verdict for item in judged(WELL)}
    check_equal(verdicts, dict.fromkeys(ITEMS, PASS) | {"map": SKIPPED})
    check_equal(list(verdicts), list(ITEMS))
    check_equal(all(item.words for item in judged(WELL)), True)


def vehicle(**changes: Any) -> VehicleFacts:
    """Return the vehicle with changes."""
    return replace(VEHICLE, **changes)


@pytest.mark.parametrize(
    ("name", "changes", "verdict", "words"),
    [
        ("log", {"log_failure": "Read-only file system"}, FAIL, "Read-only"),
        ("space", {"free_bytes": 1000 * MIB - 1}, DEGRADED, "less than the 1000 MiB"),
        ("space", {"free_bytes": 250 * MIB - 1}, FAIL, "249 MiB free"),
        ("space", {"free_bytes": None, "space_failure": "Input/output error"}, FAIL, "free: Input/output error"),
        ("clock", {"clock_trusted": False}, DEGRADED, "challenge"),
        ("keys", {"token_left_ms": HOUR_MS - 1}, DEGRADED, "59 min"),
        ("keys", {"token_left_ms": 0}, FAIL, "expired"),
        ("epoch", {"has_epoch": False}, FAIL, "no group key"),
        ("epoch", {"list_overdue_ms": 60_000}, DEGRADED, "1 min"),
        ("camera", {"frame_ms_ago": 3_001}, FAIL, "no frames"),
        ("camera", {"frame_ms_ago": None}, FAIL, "no frames"),
        ("camera", {"has_camera": False, "frame_ms_ago": None}, SKIPPED, "no camera"),
        ("detector", {"detector_us": 100_001}, DEGRADED, "100 ms"),
        ("detector", {"detector_us": None}, FAIL, "not answered"),
        ("detector", {"has_camera": False}, SKIPPED, "no camera"),
        ("gimbal", {"gimbal_ms_ago": 3_001}, DEGRADED, "silent for 3 s"),
        ("gimbal", {"gimbal_ms_ago": None}, DEGRADED, "never"),
        ("gimbal", {"has_gimbal": False}, SKIPPED, "fixed"),
        ("position", {"vehicle": None}, FAIL, "does not tell"),
        ("position", {"vehicle": vehicle(fix_type=None)}, FAIL, "does not tell"),
        ("position", {"vehicle": vehicle(fix_type=2)}, FAIL, "no 3D fix"),
        ("position", {"vehicle": vehicle(satellites=7)}, DEGRADED, "7 satellites"),
        ("position", {"vehicle": vehicle(satellites=5)}, FAIL, "5 satellites"),
        ("position", {"vehicle": vehicle(satellites=None)}, DEGRADED, "? satellites"),
        ("position", {"vehicle": vehicle(hdop_e2=151)}, DEGRADED, "HDOP 1.51"),
        ("position", {"vehicle": vehicle(hdop_e2=251)}, FAIL, "HDOP 2.51"),
        ("position", {"vehicle": vehicle(hdop_e2=None)}, DEGRADED, "HDOP ?"),
        ("battery", {"vehicle": vehicle(charge_percent=None)}, DEGRADED, "does not tell"),
        ("battery", {"vehicle": None}, DEGRADED, "does not tell"),
        ("battery", {"vehicle": vehicle(charge_percent=49)}, DEGRADED, "49 %"),
        ("battery", {"vehicle": vehicle(charge_percent=25)}, FAIL, "25 %"),
        ("geofence", {"fences": 0}, DEGRADED, "no fence"),
        ("mission", {"mission_items": 0}, FAIL, "no items"),
        ("mission", {"mission_items": None}, FAIL, "no items"),
        ("link", {"vehicle": vehicle(linked=False)}, FAIL, "not heard"),
        ("link", {"vehicle": None}, FAIL, "not heard"),
        ("link", {"vehicle": vehicle(commandable=False)}, FAIL, "modes"),
        ("link", {"operator_ms_ago": 5_001}, DEGRADED, "no operator"),
        ("link", {"operator_ms_ago": None}, DEGRADED, "no operator"),
        ("link", {"operator_ms_ago": None, "has_mesh": False}, SKIPPED, "no mesh"),
    ],
)
def test_beyond_them(name: str, changes: dict[str, Any], verdict: int, words: str) -> None:
    """One item at a time: it alone changes, and says what a pilot has to know."""
    found = replace(WELL, **changes)
    verdict_found, words_found = ITEMS[name](found)
    check_equal(verdict_found, verdict)
    check_equal(words in words_found, True)


def test_it_looks_when_what_led_to_it_is_noted(monkeypatch: pytest.MonkeyPatch) -> None:
    """The plan is recorded in the same batch as the effect, which is performed before the batch is noted."""
    monkeypatch.setattr(performer, "OFFER_AGAIN_S", 0.0)
    offered: list[Any] = []
    looked_at: list[int] = []
    unused: Any = None

    def offer(input_class: InputClass, observation: Message) -> bool:
        del input_class
        offered.append(observation)
        return True

    async def run() -> None:
        selftest = performer.Selftest(unused, unused, unused, offer, None, lambda: EyesFacts(None, None))

        def look(*_: object) -> Found:
            looked_at.append(selftest.noted.head)
            return WELL

        monkeypatch.setattr(selftest, "_look", look)
        selftest.noted.head = 4
        selftest.perform(5, RunSelftest(vehicle=1), 0)
        for _ in range(20):
            await asyncio.sleep(0)
        assert looked_at == []
        last: Any = SimpleNamespace(seq=6, kind=SimpleNamespace(name="moved"), message=None, at=SimpleNamespace(boot=1))
        selftest.noted.hear((last,))
        await asyncio.wait_for(asyncio.gather(*selftest._tasks), 10)

    asyncio.run(run())
    assert (looked_at, [one.effect_seq for one in offered]) == ([6], [5])


def fitted(folder: Path, offer: Offer, eyes: EyesFacts) -> performer.Selftest:
    """Return a performer with a book and a clock that know nothing worth asking for, and a camera."""
    eyes_section = {"source": "external", "endpoint": "127.0.0.1:1", "empty_frame_period_s": 60}
    node = {"flights": str(folder), "keys": "k", "projections": "p"}
    config = Config.model_validate({"node": node, "eyes": eyes_section})
    held = SimpleNamespace(token=SimpleNamespace(not_after_ms=HOUR_MS), epochs={})
    time = SimpleNamespace(trusted=True, now_ms=0)
    book: Any = SimpleNamespace(time=lambda: time, held=held, overdue_ms=lambda: 0)
    clock: Any = SimpleNamespace(mono_ns=lambda: 0)
    return performer.Selftest(config, clock, book, offer, lambda: VEHICLE, lambda: eyes)


def reported(selftest: performer.Selftest, offered: list[SelftestReported]) -> dict[str, tuple[int, str]]:
    """Return verdict and words of each item of the one report that comes of a test."""

    async def run() -> None:
        selftest.noted.head = 5
        selftest.perform(5, RunSelftest(vehicle=1), 0)
        await asyncio.wait_for(asyncio.gather(*selftest._tasks), 10)

    asyncio.run(run())
    (report,) = offered
    check_equal((report.effect_seq, report.vehicle), (5, 1))
    return {item.name: (item.verdict, item.words) for item in report.items}


def taken(offered: list[Any]) -> Offer:
    """Return an inbox that takes everything."""

    def offer(input_class: InputClass, observation: Message) -> bool:
        check_equal(input_class, InputClass.OUTCOME)
        offered.append(observation)
        return True

    return offer


def test_frames_are_counted_by_the_eyes(tmp_path: Path) -> None:
    """However seldom empty ones are recorded: the age is that of the newest frame."""
    for frame_ms_ago, verdict in ((3_000, PASS), (3_001, FAIL), (None, FAIL)):
        offered: list[Any] = []
        found = reported(fitted(tmp_path, taken(offered), EyesFacts(frame_ms_ago, 90_000)), offered)
        check_equal((found["camera"][0], found["detector"]), (verdict, (PASS, "90 ms a frame")))


def test_a_disk_that_fails_is_an_item_like_others(tmp_path: Path) -> None:
    """A folder that is gone can't be written to, and nobody knows what is free there; the rest is judged."""
    offered: list[Any] = []
    found = reported(fitted(tmp_path / "gone", taken(offered), EyesFacts(0, 0)), offered)
    gone = "No such file or directory"
    check_equal(found["log"], (FAIL, f"nothing can be written beside the log: {gone}"))
    check_equal(found["space"], (FAIL, f"it can't be told how much is free: {gone}"))
    check_equal((list(found), found["keys"][0], found["camera"][0]), (list(ITEMS), PASS, PASS))


@pytest.mark.parametrize("part", ["_vehicle", "_eyes", "_book", "_clock"])
@pytest.mark.parametrize("error", [OSError("Input/output error"), KeyError("x"), RuntimeError("Input/output error")])
def test_whatever_a_look_raises_there_is_a_report(tmp_path: Path, part: str, error: Exception) -> None:
    """Every item fails and says why: the mission waits for the report, and nobody flies on it."""
    offered: list[Any] = []
    selftest = fitted(tmp_path, taken(offered), EyesFacts(0, 0))
    selftest.noted.heard_ns["operator_heard"] = 0

    def broken(*_: object) -> Any:
        raise error

    setattr(selftest, part, broken if part in ("_vehicle", "_eyes") else SimpleNamespace(time=broken, mono_ns=broken))
    words = f"this could not be looked at: {type(error).__name__}: {error}"
    check_equal(reported(selftest, offered), dict.fromkeys(ITEMS, (FAIL, words)))


def test_the_probe_writes_and_leaves_nothing(tmp_path: Path) -> None:
    """Also where something of that name is left from before; a folder that is gone is told in words."""
    (tmp_path / PROBE).write_text("old")
    check_equal((written(tmp_path), list(tmp_path.iterdir())), ("", []))
    check_equal(written(tmp_path / "gone"), "No such file or directory")


def test_what_was_heard_before_a_boot_is_not_heard_now() -> None:
    """The monotonic time of another boot is no age; the plan is of the log, and stays."""
    noted, tale = Noted({}), Story(*flying.opening())
    for words in ("planned", "heard alpha"):
        tale.tell(words)
    noted.hear(tuple(tale.flight.records))
    check_equal((list(noted.heard_ns), noted.plan), (["operator_heard"], tale.flight.state.plans[1]))
    newest = tale.flight.records[-1]
    noted.hear((newest,))
    check_equal(list(noted.heard_ns), ["operator_heard"])
    planned = next(record for record in tale.flight.records if record.kind.name == "mission_planned")
    noted.hear((replace(planned, at=planned.at._replace(boot=planned.at.boot + 1)),))
    check_equal((noted.heard_ns, noted.plan), ({}, tale.flight.state.plans[1]))


def test_a_start_from_a_snapshot_knows_the_plan() -> None:
    """Its records are not told; a log without a plan takes none away."""
    noted, tale = Noted({}), Story(*flying.opening())
    noted.resume(tale.flight.state)
    check_equal(noted.plan, None)
    tale.tell("planned")
    plan = tale.flight.state.plans[1]
    for state in (tale.flight.state, State()):
        noted.resume(state)
        check_equal(noted.plan, plan)
