"""The inbox: bounded by class, what overflows is counted or refused, orders first."""

from __future__ import annotations

import threading
from collections.abc import Callable

from hypothesis import given, settings
from hypothesis import strategies as st

from autopilot.node.inbox import Inbox
from autopilot.ports.config import LimitsSection
from autopilot.ports.edges import InputClass
from events.schema.flight_pb2 import InputsDropped
from events.schema.orders_pb2 import OrderReceived
from tests.autopilot.node.nodes import FakeClock

BOUNDS = {InputClass.ORDER: 3, InputClass.OUTCOME: 4, InputClass.TELEMETRY: 2, InputClass.FRAME: 3}
ORDER_OF_TAKING = [InputClass.ORDER, InputClass.OUTCOME, InputClass.TELEMETRY, InputClass.FRAME]
DROPS = (InputClass.TELEMETRY, InputClass.FRAME)
COUNTED = (InputClass.ORDER, *DROPS)

steps = st.one_of(
    st.tuples(st.just("offer"), st.sampled_from(list(InputClass))),
    st.tuples(st.just("take"), st.integers(min_value=1, max_value=6)),
    st.tuples(st.just("dropped"), st.none()),
    st.tuples(st.just("refuse"), st.booleans()),
)


def inbox(clock: FakeClock | None = None) -> Inbox:
    """Return an inbox with small bounds."""
    return Inbox(
        LimitsSection(inbox_orders=3, inbox_outcomes=4, inbox_telemetry=2, inbox_frames=3), clock or FakeClock()
    )


def commit(box: Inbox, clock: FakeClock, took_ms: float) -> None:
    """Let the disk take its time over a commit."""
    box.commit_began()
    clock.pass_ms(took_ms)
    box.commit_ended()


def numbered(number: int) -> InputsDropped:
    """Return an observation that can be told from others."""
    return InputsDropped(count=number)


@settings(max_examples=200, deadline=None)
@given(st.lists(steps, max_size=60))
def test_every_class_keeps_its_bound_and_its_way_of_overflowing(script: list[tuple[str, object]]) -> None:
    """Beside a plain model of four lists, the inbox gives the same answers, whatever is done to it."""
    clock = FakeClock()
    box, refuses = inbox(clock), False
    model: dict[InputClass, list[int]] = {each: [] for each in InputClass}
    dropped = dict.fromkeys(COUNTED, 0)
    for number, (what, value) in enumerate(script):
        if what == "refuse":
            refuses = bool(value)
            commit(box, clock, 2001 if refuses else 1999)
        elif what == "dropped":
            assert box.take_dropped() == {each: count for each, count in dropped.items() if count}
            dropped = dict.fromkeys(COUNTED, 0)
        elif what == "take":
            assert isinstance(value, int)
            waiting = [(each, one) for each in ORDER_OF_TAKING for one in model[each]]
            for each, one in waiting[:value]:
                model[each].remove(one)
            taken = [one.count for one in box.take(0, value) if isinstance(one, InputsDropped)]
            assert taken == [one for _, one in waiting[:value]]
        else:
            assert isinstance(value, InputClass)
            full = len(model[value]) == BOUNDS[value]
            refused = (value is InputClass.ORDER and refuses) or (full and value not in DROPS)
            assert box.offer(value, numbered(number)) is not refused
            if value in COUNTED and (refused or full):
                dropped[value] += 1
            if not refused:
                model[value] = [*model[value][full:], number]
        assert [len(model[each]) <= BOUNDS[each] for each in InputClass] == [True] * 4


def test_a_source_that_can_wait_sees_whether_there_is_room() -> None:
    """Less than half of a class is taken."""
    box = inbox()
    assert box.has_room(InputClass.FRAME)
    box.offer(InputClass.FRAME, numbered(1))
    assert box.has_room(InputClass.FRAME)
    box.offer(InputClass.FRAME, numbered(2))
    assert not box.has_room(InputClass.FRAME)
    assert box.has_room(InputClass.ORDER)


def check_returns(box: Inbox, act: Callable[[], object], expected: int) -> None:
    """Check that a `take` that may wait for long returns this many once something is done."""
    seen = list[int]()
    waiter = threading.Thread(target=lambda: seen.append(len(box.take(30, 8))), daemon=True)
    waiter.start()
    act()
    waiter.join(10)
    assert seen == [expected]


def test_a_waiting_take_returns_for_an_offer_and_for_a_wake() -> None:
    """The loop sleeps in `take`; both end it."""
    box = inbox()
    check_returns(box, lambda: box.offer(InputClass.FRAME, numbered(1)), 1)
    check_returns(box, box.wake, 0)


def test_a_wake_that_comes_before_the_sleep_is_not_lost() -> None:
    """Else a daemon that is asked to stop would sleep over it."""
    box = inbox()
    box.wake()
    check_returns(box, lambda: None, 0)


def test_orders_are_refused_while_the_disk_stalls_and_until_a_commit_is_quick() -> None:
    """Not only afterwards: what is taken in during a stall would be performed late."""
    clock = FakeClock()
    box = inbox(clock)
    box.commit_began()
    clock.pass_ms(1999)
    assert box.offer(InputClass.ORDER, numbered(1))
    clock.pass_ms(2)
    assert not box.offer(InputClass.ORDER, numbered(2))
    assert box.offer(InputClass.OUTCOME, numbered(3))
    box.commit_ended()
    assert not box.offer(InputClass.ORDER, numbered(4))
    commit(box, clock, 5)
    assert box.offer(InputClass.ORDER, numbered(5))


def test_a_node_that_ends_takes_no_orders() -> None:
    """Whatever the disk does."""
    box = inbox()
    box.close_to_orders()
    box.disk_rested()
    assert not box.offer(InputClass.ORDER, numbered(1))


def test_an_order_ages_in_the_inbox() -> None:
    """Its life counts from its record, so what it waited is taken off; none has less than nothing left."""
    clock = FakeClock()
    box = inbox(clock)
    for life_ms in (10_000, 1_000):
        box.offer(InputClass.ORDER, OrderReceived(life_ms=life_ms))
    clock.pass_ms(5_000)
    lives = [order.life_ms for order in box.take(0, 5) if isinstance(order, OrderReceived)]
    assert lives == [5_000, 0]
