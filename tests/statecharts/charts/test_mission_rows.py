"""The rows of the chart `mission` one by one: where each trigger leads, and by which facts alone."""

from __future__ import annotations

from typing import Any

import pytest

from statecharts.charts.mission import CHART
from statecharts.charts.mission_guards import Facts
from statecharts.table import Answer
from tests import flying
from tests.checks import check_equal, check_exactly_one_row

MODES = {name: int(mode) for name, mode in flying.MODES.items()}
AIRBORNE: dict[str, Any] = {"armed": True, "flown": True}


def check_row(state: str, trigger: str, target: str, mode: str = "none", **facts: Any) -> None:
    """Check where a trigger leads in a state, by the rows alone; a row that stays leads to its own state."""
    row = CHART.ask(state, trigger, Facts(mode=MODES[mode], **facts))
    check_equal((state, trigger, facts, row.target), (state, trigger, facts, target))


@pytest.mark.parametrize("step", ["readying", "arming", "engaging", "starting"])
def test_every_step_that_asks_something_of_the_vehicle(step: str) -> None:
    """Tried again, then paused; stopped by an operator and by a failsafe; aborted as its motors ask for."""
    for refused in (True, False):
        check_row(step, "time_passed", step, refused=refused)
        check_equal(CHART.ask(step, "time_passed", Facts(refused=refused)).answer, Answer.MOVE)
    check_equal(CHART.ask(step, "refused", Facts(refused=True)).answer, Answer.IGNORE)
    for trigger in ("refused", "time_passed"):
        check_row(step, trigger, "paused", last_try=True, refused=True)
        check_row(step, trigger, "paused", last_try=True)
    check_row(step, "pause", "paused")
    check_row(step, "abort", "aborted")
    check_row(step, "abort", "aborting", armed=True)
    check_row(step, "failsafe", "returning")


def test_what_is_seen_decides_each_step() -> None:
    """Of its mode and its motors; what is not there yet is waited for."""
    for mode, target in (("guided", "arming"), ("loiter", "arming"), ("mission", "readying"), ("none", "readying")):
        check_row("readying", "reported", target, mode)
    check_row("arming", "reported", "arming")
    check_row("arming", "reported", "engaging", armed=True)
    for mode, target in (("mission", "starting"), ("guided", "engaging"), ("return", "returning")):
        check_row("engaging", "reported", target, mode, armed=True)
    check_row("engaging", "reported", "flying", "mission", **AIRBORNE)
    check_row("engaging", "reported", "landed", flown=True)
    check_row("engaging", "reported", "paused", "return")
    check_row("engaging", "reported", "paused", "loiter", left_mission=True, **AIRBORNE)
    check_row("engaging", "reported", "engaging", "loiter", left_mission=True, armed=True)
    for mode, target in (("mission", "starting"), ("land", "returning"), ("guided", "paused"), ("none", "paused")):
        check_row("starting", "reported", target, mode, armed=True)
    for mode, facts, target in (
        ("mission", {"armed": True}, "flying"),
        ("guided", {"armed": True}, "waiting_for_pilot"),
        ("mission", {}, "waiting_for_pilot"),
    ):
        check_row("waiting_for_pilot", "reported", target, mode, **facts)


@pytest.mark.parametrize("state", ["uploading", "readying", "arming"])
def test_a_start_on_the_ground_waits_for_an_order(state: str) -> None:
    """Armed, an upload goes on."""
    check_row(state, "node_started", "ready")
    check_row(state, "node_started", "uploading" if state == "uploading" else "ready", armed=True)


def test_while_the_plan_goes_up() -> None:
    """In the air a vehicle that lands, or goes home, is followed; an operator's word is heard."""
    check_row("uploading", "reported", "landed", flown=True)
    check_row("uploading", "reported", "uploading")
    check_row("uploading", "reported", "returning", "land", **AIRBORNE)
    check_row("uploading", "reported", "uploading", "mission", **AIRBORNE)
    check_row("uploading", "reported", "paused", "loiter", left_mission=True, **AIRBORNE)
    check_row("uploading", "reported", "uploading", "loiter", left_mission=True, armed=True)
    check_row("uploading", "uploaded", "engaging", **AIRBORNE)
    check_row("uploading", "uploaded", "waiting_for_pilot", pilot=True, armed=True)
    check_row("uploading", "uploaded", "paused", armed=True)
    check_row("uploading", "pause", "paused")
    check_row("uploading", "abort", "aborting", armed=True)
    check_row("uploading", "abort", "aborted")
    check_row("uploading", "failsafe", "returning")
    for trigger in ("time_passed", "upload_failed"):
        check_row("uploading", trigger, "paused", last_try=True)
        check_row("uploading", trigger, "uploading")


def test_how_it_begins() -> None:
    """Off, without a vehicle, with one; given up before anything flies; planned anew with a test that was passed."""
    check_row("idle", "node_started", "idle")
    check_row("idle", "node_started", "linking", enabled=True)
    for state in ("linking", "checking", "selftest", "ready", "waiting_for_pilot"):
        check_row(state, "abort", "aborted")
    check_row("checking", "planned", "selftest", may_begin=True)
    check_row("checking", "planned", "ready", tested=True)
    check_row("checking", "planned", "uploading", tested=True, may_begin=True)
    check_row("checking", "planned", "done", tested=True, may_begin=True, flown_already=True)


def test_whoever_has_it_paused() -> None:
    """What is resumed depends on where the vehicle is; aborting brings it home if it is up."""
    check_row("paused", "resume", "engaging", holds_plan=True, **AIRBORNE)
    check_row("paused", "resume", "uploading", **AIRBORNE)
    check_row("paused", "resume", "uploading", tested=True, may_begin=True)
    check_row("paused", "resume", "ready", tested=True)
    check_row("paused", "resume", "checking", may_begin=True)
    check_row("paused", "resume", "checking")
    check_row("paused", "abort", "aborting", armed=True)
    check_row("paused", "abort", "aborted")
    check_row("paused", "reported", "paused", "mission", armed=True)
    check_row("paused", "reported", "paused", "return")
    check_row("paused", "reported", "paused", "return", armed=True)
    check_row("paused", "reported", "returning", "return", **AIRBORNE)
    check_row("returning", "reported", "paused", "mission", armed=True)
    check_row("paused", "reported", "landed", flown=True)
    check_row("paused", "failsafe", "paused")


def test_what_lingers_is_not_believed() -> None:
    """A vehicle that says what it said before; a failsafe is believed, and in the end whoever keeps returning."""
    for state, target in (("paused", "returning"), ("uploading", "returning"), ("engaging", "returning")):
        for mode in ("return", "land"):
            check_row(state, "reported", state, mode, lingers=True, **AIRBORNE)
            check_row(state, "reported", target, mode, lingers=True, failsafe=True, **AIRBORNE)
            check_row(state, "reported", target, mode, failsafe=True, **AIRBORNE)
    check_row("paused", "reported", "paused", "mission", lingers=True, **AIRBORNE)
    check_row("paused", "reported", "flying", "mission", **AIRBORNE)
    for mode, facts, target in (
        ("return", {"last_try": True}, "returning"),
        ("return", {"failsafe": True}, "returning"),
        ("return", {}, "paused"),
        ("mission", {"last_try": True}, "paused"),
        ("mission", {"failsafe": True}, "paused"),
    ):
        check_row("paused", "time_passed", target, mode, lingers=True, **AIRBORNE, **facts)
    check_row("paused", "time_passed", "paused", "return", lingers=True, last_try=True, armed=True)
    for lingers, answer in ((True, Answer.MOVE), (False, Answer.IGNORE)):
        check_equal(CHART.ask("paused", "time_passed", Facts(lingers=lingers)).answer, answer)


def test_on_the_way_home() -> None:
    """By its mode or by its mission; back in the mission, stopped, paused, aborted, down."""
    for mode in ("return", "land"):
        check_row("returning", "reported", "returning", mode, **AIRBORNE)
    check_row("returning", "reported", "flying", "mission", **AIRBORNE)
    check_row("returning", "reported", "returning", "mission", homeward=True, **AIRBORNE)
    check_row("returning", "reported", "paused", "loiter", **AIRBORNE)
    check_row("returning", "reported", "landed", "return", flown=True)
    check_row("returning", "pause", "paused")
    check_row("returning", "abort", "aborting")
    check_row("aborting", "time_passed", "aborting", "return")
    for facts, answer in (({}, Answer.MOVE), ({"armed": True}, Answer.IGNORE)):
        check_equal(CHART.ask("aborting", "linked", Facts(mode=MODES["land"], **facts)).answer, answer)
    check_row("waiting_for_pilot", "planned", "uploading")
    check_row("waiting_for_pilot", "planned", "waiting_for_pilot", armed=True)
    for state in ("flying", "following"):
        check_row(state, "failsafe", "returning", **AIRBORNE)
        check_row(state, "reported", "returning", "return", **AIRBORNE)


def test_how_it_ends() -> None:
    """With a push where there is an office; done in any case, but for a push that still goes on."""
    check_row("landed", "time_passed", "syncing", pushes=True)
    check_row("landed", "time_passed", "done")
    check_equal(CHART.ask("syncing", "node_started", Facts()).answer, Answer.MOVE)
    for trigger in ("pushed", "not_pushed", "time_passed"):
        check_row("syncing", trigger, "done")
    check_row("syncing", "not_pushed", "syncing", final=False)
    for trigger in ("reported", "failsafe", "linked", "planned"):
        check_row("syncing", trigger, "syncing", "mission", **AIRBORNE)


def test_exactly_one_row() -> None:
    """Whatever the guards say."""
    check_exactly_one_row(CHART)
