"""A sample of the failures that `python -m tests.torture faults` tries one by one: every operation, every block."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import apsw
import pytest

from autopilot.node.flights import Session
from autopilot.node.loop import NodeLoop
from events.store import SqliteStore, reserve
from tests.checks import check_equal
from tests.disk import failing, filling
from tests.torture import faults


def test_a_run_on_a_sound_disk_goes_on() -> None:
    """And each kind of operation is one that can fail."""
    found = failing.run(0)
    check_equal((found.failed, found.end, found.broken), (None, failing.WENT_ON, ()))
    assert found.operations > 200


def test_a_failure_ends_the_run_orderly_and_loses_nothing() -> None:
    """A sample of the operations, once and for ever; only setting space aside may fail and be done without."""
    found = faults.run(40, 3, lambda _: None)
    assert found["operations_that_failed"] >= 40
    assert found["ended_orderly"] + found["went_on_and_lost_nothing"] == found["runs"]
    assert found["ended_orderly"] > found["runs"] * 0.9
    assert found["closed_in_the_space_reserved"] == found["full_disks"] // 2


def test_a_store_that_takes_no_notice_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """It acknowledges what the disk refused."""
    commit = SqliteStore._commit

    def careless(store: SqliteStore, statement: str, rows: Sequence[tuple[int | bytes | str, ...]]) -> None:
        with suppress(apsw.Error):
            commit(store, statement, rows)

    monkeypatch.setattr(SqliteStore, "_commit", careless)
    runs = [failing.run(at) for at in range(90, 170, 6)]
    assert any(run.broken for run in runs if run.end == failing.WENT_ON)


def test_a_loop_that_goes_on_after_a_failure_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """It hands over what was not written."""
    commit = NodeLoop._commit

    def careless(loop: NodeLoop, session: Session) -> None:
        pending = list(loop._pending)
        try:
            commit(loop, session)
        except OSError:
            for record in pending:
                loop._hand_over(record)
            raise

    monkeypatch.setattr(NodeLoop, "_commit", careless)
    runs = [failing.run(at) for at in range(90, 170, 6)]
    assert any(failing.AFTER in run.broken for run in runs)


@pytest.mark.parametrize("how", filling.WAYS)
@pytest.mark.parametrize("reserved", [True, False])
def test_a_flight_ends_on_a_full_disk(how: str, reserved: bool) -> None:
    """With space set aside it always has its end, signed; without, it has or the node says that it has not."""
    endings = [filling.end(how, free, reserved=reserved) for free in range(8)]
    check_equal([ending.broken for ending in endings], [()] * len(endings))
    check_equal([ending.whole for ending in endings if reserved], [True] * 8 * reserved)
    assert reserved or not endings[0].whole


def test_a_flight_that_fills_the_disk_in_the_air_says_why_it_ended() -> None:
    """Nothing is left to record in, so no other flight begins."""
    ending = filling.end(filling.ALOFT, 0, reserved=True)
    check_equal((ending.closed, ending.said.partition(";")[0]), ("CLOSE_DISK_FULL", "the disk is full"))


def test_an_end_without_its_reserve_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """The reserve is what makes the difference."""
    monkeypatch.setattr(reserve.Reserve, "give_up", lambda _: False)
    check_equal(filling.end(filling.STOPPED, 0, reserved=True).broken[:1], (filling.NOT_CLOSED,))
    check_equal(filling.end(filling.STOPPED, 1, reserved=True).broken[:1], (filling.NOT_SEALED,))
