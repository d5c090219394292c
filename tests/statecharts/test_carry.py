"""The baseline: what a flight hands over, field by field, and that the next one lives by it."""

from __future__ import annotations

from events.schema.flight_pb2 import BaselineCarried
from events.schema.state_pb2 import CarriedState
from statecharts import carry_over
from tests.checks import check_chart, check_equal
from tests.flights import opened_well
from tests.stories import Story

NOW_NS = 10_000_000_000


def before() -> Story:
    """Return a flight with one of everything that is carried."""
    story = Story(sightings_to_ask=1)
    check_chart(
        "command",
        """
        at_s | observe                   | say
        0    | frame person@3,4:90       | -
        0    | time                      | -
        1    | order a decline p1 seq=41 | a accepted
        1    | published a               | -
        2    | frame person@3,4 car@9,9  | -
        2    | time                      | -
        3    | order b point by=bravo    | look 1,1
        4    | order c point by=bravo    | look 1,1
        4    | answered c 3              | c unsupported
        """,
        story,
    )
    story.flight.now_ns = NOW_NS
    return story


def after(carried: CarriedState) -> Story:
    """Return a flight that begins with this baseline, and was not started yet."""
    manifest, _started, *_rest = opened_well()
    return Story(manifest, BaselineCarried(state=carried))


def test_what_is_carried() -> None:
    """Orders with their results, numbers, nonces, map, mutes and origin; lives as what is left of them, rounded up."""
    carried = carry_over(before().flight.state, NOW_NS + 1)
    orders = [(one.principal_id, one.command_id, one.chart_state, one.detail, one.keep_ms) for one in carried.orders]
    check_equal(
        orders,
        [
            ("alpha", "a", "accepted", "recorded", 86_400_000 - 9_000),
            ("bravo", "b", "intended", "all gates passed", 86_400_000 - 7_000),
            ("bravo", "c", "unsupported", "COMMAND_ACK: MAV_RESULT_UNSUPPORTED", 86_400_000 - 6_000),
        ],
    )
    check_equal([one.mav_result for one in carried.orders if one.HasField("mav_result")], [3])
    check_equal(sorted(one.order_seq for one in carried.order_seqs), [2, 41])
    check_equal(sorted(one.keep_ms for one in carried.nonces), [36_000, 38_000, 39_000])
    things = [
        (one.number, one.class_name, one.class_group, one.confidence_e4, one.sightings) for one in carried.objects
    ]
    check_equal(things, [(1, "person", "person", 8_000, 2), (2, "car", "vehicle", 8_000, 1)])
    check_equal([(one.place.east_mm, one.place.north_mm) for one in carried.objects], [(3_000, 4_000), (9_000, 9_000)])
    check_equal([(one.class_group, one.principal_id, one.muted) for one in carried.ignored], [("person", "alpha", 1)])
    check_equal((carried.origin.east_mm, carried.origin.mgrs), (0, "31UFT5000050000"))
    check_equal([one.command_id for one in carried.unanswered], ["b", "c"])
    check_equal([len(one.in_reply_to) for one in carried.unanswered], [32, 32])


def test_a_nonce_whose_life_is_over_is_not_carried() -> None:
    """To the nanosecond: at its end it is over, just before it a millisecond is left."""
    state = before().flight.state
    first_ns = 46_000_000_000
    check_equal(sorted(one.keep_ms for one in carry_over(state, first_ns).nonces), [2_000, 3_000])
    check_equal(sorted(one.keep_ms for one in carry_over(state, first_ns - 1).nonces), [1, 2_001, 3_001])
    check_equal({one.keep_ms for one in carry_over(state, 10**18).orders}, {0})


def test_the_first_state_is_what_was_carried() -> None:
    """Field by field: tables of the next flight hold what the flight before had."""
    old = before().flight.state
    new = after(carry_over(old, NOW_NS)).flight.state
    for number, thing in old.objects.items():
        loaded = new.objects[number]
        check_equal(
            (loaded.spot, loaded.class_name, loaded.confidence_e4), (thing.spot, thing.class_name, thing.confidence_e4)
        )
        check_equal((loaded.class_group, loaded.sightings), (thing.class_group, thing.sightings))
    check_equal(dict(new.grid.items()), {key: numbers for key, numbers in old.grid.items() if numbers})
    check_equal(dict(new.ignored.items()), dict(old.ignored.items()))
    check_equal(dict(new.order_seqs.items()), dict(old.order_seqs.items()))
    check_equal(new.origin.value, old.origin.value)
    check_equal({key: until - NOW_NS for key, until in old.nonces.items()}, dict(new.nonces.items()))
    for key, order in old.orders.items():
        loaded_order = new.orders[key]
        check_equal(
            (loaded_order.state, loaded_order.detail, loaded_order.mav_result, loaded_order.digest),
            (order.state, order.detail, order.mav_result, order.digest),
        )
        check_equal(loaded_order.keep_until_ns, order.keep_until_ns - NOW_NS)
    check_equal(sorted(new.owed_acks.values()), ["bravo/c"])
    check_equal(after(CarriedState()).flight.state.origin.value, None)


def test_the_next_flight_lives_by_it() -> None:
    """Owed answers are given, repeats and stale orders recognised, mutes kept, and new things get new numbers."""
    old = before()
    story = after(carry_over(old.flight.state, NOW_NS))
    story._orders = old._orders
    check_chart(
        "command",
        """
        at_s | observe                  | state     | say
        0    | start                    | b timeout | b timeout; c unsupported
        0    | vehicle up               | -         | -
        1    | again a                  | -         | a accepted again
        1    | again b                  | -         | b timeout again
        1    | again b body=evil        | -         | b rejected
        2    | order d point seq=41     | d rejected | d rejected
        3    | order e point seq=42     | e intended | look 1,1
        """,
        story,
    )
    check_chart("map", "at_s | observe | say\n4 | frame person@3,4 person@30,30 | same 1 0mm, new 3", story)
    check_equal([item.muted for item in story.flight.state.ignored.values()], [2])
    check_equal([story.flight.state.objects[1].muted_by != ""], [True])
