"""A sample of the cuts that `python -m tests.torture powercut` makes, and that the same harness finds a breach."""

from __future__ import annotations

import pytest

from autopilot.node.flights import Session
from autopilot.node.loop import NodeLoop
from events.kinds import Role
from events.store.recovery import Action
from tests.disk.powercut import Tally, cut_life
from tests.disk.promises import LOST, UNRECORDED, UNSEALED
from tests.disk.trace import NORMAL, Setting
from tests.torture import powercut


class Hasty(NodeLoop):
    """A loop that acts, and writes then."""

    def _commit(self, session: Session) -> None:
        perform = self._perform
        for record in self._pending:
            if record.kind.role is Role.EFFECT:
                perform(record)
        self._perform = lambda _: None
        super()._commit(session)
        self._perform = perform


def check_found(tally: Tally, *breaches: str) -> None:
    """Check that these promises were found broken."""
    assert set(breaches) <= set(tally.broken), tally.broken
    assert len(tally.examples) == 5


def test_nothing_is_lost_and_nothing_is_done_twice() -> None:
    """Two lives, the second on what a cut of another has left; every kind of find is seen on the way."""
    found = powercut.run(1_000, 2, lambda _: None)
    assert found["states"] >= 1_000
    assert found["distinct_images"] > found["states"] // 3
    assert found["lives"] == 2
    assert min(found["acknowledged_records_looked_for"], found["of_these_class_sync"], found["effects_looked_for"]) > 0
    assert {name: found[name] for name in powercut._COUNTS} == dict.fromkeys(powercut._COUNTS, 0)
    assert {word.partition(" ")[0] for word in found["classified"]} == {"go", "cut", "pass", "there"}
    assert Action.GO_ON_AND_SAY.value not in found["classified"]  # the head file is there whatever is lost


def test_a_recovery_that_is_cut_is_recovered_from() -> None:
    """The life begins on what a cut has left."""
    tally = cut_life(1, 2)
    assert (dict(tally.broken), tally.examples) == ({}, [])
    assert tally.states > 500


def test_a_log_that_does_not_sync_is_found_out() -> None:
    """With synchronous NORMAL a commit that returned may be gone: this is what the harness is for."""
    check_found(cut_life(0, 1, setting=Setting(synchronous=NORMAL)), LOST, UNRECORDED, UNSEALED)


def test_a_loop_that_acts_before_it_writes_is_found_out() -> None:
    """Its effects leave without their record, so that the flight which goes on knows nothing of them."""
    check_found(cut_life(0, 1, setting=Setting(loop_of=Hasty)), UNRECORDED)


def test_the_full_run_says_what_broke(monkeypatch: pytest.MonkeyPatch) -> None:
    """A breach ends it, with where it was."""
    monkeypatch.setattr(powercut, "cut_life", lambda seed, states, tearing: cut_life(0, 1, setting=Setting(NORMAL)))
    with pytest.raises(AssertionError, match=r"(?s)is lost.*life 0, operation \d+: "):
        powercut.run(1, 1, lambda _: None)
