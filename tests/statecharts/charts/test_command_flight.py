"""The chart `command` as tables: to which places the vehicle is sent, and when nothing of the flight is asked."""

from __future__ import annotations

import pytest

from statecharts.charts.safety import CHART as SAFETY
from statecharts.charts.safety_part import failsafe_flies
from statecharts.facts import Failsafe, Mission
from tests import flying
from tests.checks import check_chart, check_equal
from tests.stories import Story
from tests.stories_of_safety import SAFE_LIMITS

FENCES = "fence in=-100,-100,100,100 in2=-100,-100,90,200 out=20,-50,40,50"


def story(*words: str, **changes: object) -> Story:
    """Return an armed flight on a node that takes orders of the flight, with three fences, after these words."""
    told = Story(**SAFE_LIMITS | changes)
    for one in (FENCES, *words):
        told.tell(one)
    return told


@pytest.mark.parametrize(
    ("to", "why"),
    [
        ("0,0", "all gates passed"),
        ("0,99.999", "all gates passed"),
        ("0,100", "outside the fence"),
        ("0,150", "outside the fence"),
        ("95,0", "outside the fence"),
        ("90,0", "outside the fence"),
        ("89.999,0", "all gates passed"),
        ("0,-100", "outside the fence"),
        ("20,0", "inside an exclusion fence"),
        ("19.999,0", "all gates passed"),
        ("30,0", "inside an exclusion fence"),
        ("40,50", "inside an exclusion fence"),
        ("40.001,50", "all gates passed"),
    ],
)
def test_the_place_must_keep_every_fence(to: str, why: str) -> None:
    """To the millimetre, each edge being the unsafe side; where the vehicle is, is not known."""
    check_equal(answer(story(), to), why)


def answer(told: Story, to: str) -> str:
    """Return what an order to fly to a place is told at last, or first."""
    acks = [record.message for record in told.tell(f"order a fly to={to}") if record.kind.name == "send_ack"]
    return acks[-1].detail  # type: ignore[attr-defined,no-any-return]


@pytest.mark.parametrize(
    ("at", "to", "why"),
    [
        ("0,0", "50,0", "through a fence"),
        ("0,0", "19,0", "all gates passed"),
        ("0,50", "50,50", "through a fence"),
        ("0,50.001", "50,50.001", "all gates passed"),
        ("95,0", "50,0", "through a fence"),
        ("30,0", "0,0", "through a fence"),
        ("0,0", "0,0", "all gates passed"),
    ],
)
def test_the_way_there_must_keep_every_fence(at: str, to: str, why: str) -> None:
    """Straight from where the vehicle is; from outside a fence there is no way, where nobody holds the failsafe off."""
    check_equal(answer(story(f"spot {at}"), to), why)


@pytest.mark.parametrize(
    ("at", "to", "held", "why"),
    [
        ("0,120", "0,0", "fence", "all gates passed"),
        ("0,120", "0,0", "battery", "through a fence"),
        ("0,120", "0,0", "fence for=0.5", "through a fence"),
        ("0,120", "0,110", "fence", "outside the fence"),
        ("0,120", "30,0", "fence", "inside an exclusion fence"),
        ("0,100", "0,0", "fence", "all gates passed"),
        ("110,0", "0,0", "fence", "through a fence"),
        ("110,60", "0,60", "fence", "all gates passed"),
        ("30,0", "0,0", "fence", "all gates passed"),
        ("30,0", "60,0", "fence", "all gates passed"),
        ("110,110", "50,50", "fence", "through a fence"),
        ("0,0", "60,0", "fence", "through a fence"),
        ("0,0", "19,0", "fence", "all gates passed"),
    ],
)
def test_straight_back_in_while_that_failsafe_is_held_off(at: str, to: str, held: str, why: str) -> None:
    """Over each fence once, inwards; not at a corner, not across another, and not when the time is over."""
    told = story(f"order z override {held}", f"spot {at}")
    told.at(1_000)
    check_equal(answer(told, to), why)


def test_a_place_from_before_a_silence_is_no_beginning_of_a_way() -> None:
    """Where the vehicle is not known, the place alone counts."""
    told = story("spot 0,0", "vehicle down", "vehicle up")
    check_equal(answer(told, "50,0"), "all gates passed")


def test_only_an_order_to_fly_is_held_against_the_fences() -> None:
    """A camera looks where it likes, and a mode has no place; without fences every place is allowed."""
    check_chart(
        "command",
        """
        at_s | observe                | say       | why
        0    | order a point          | look 1,1  | all gates passed
        1    | order b go-into loiter | -         | all gates passed
        2    | fence                  | -         | -
        3    | order c fly to=500,0   | fly 500,0 | all gates passed
        """,
        story("fence out=-5,-5,5,5", "spot 0,0"),
    )


def test_in_which_order_it_is_refused() -> None:
    """Without an origin nothing can be held against a fence; the fence is named before a vehicle that is silent."""
    told = story("spot 30,0", "vehicle down")
    check_equal(answer(told, "0,200"), "outside the fence")
    told.tell("vehicle up")
    told.tell("grounded")
    check_equal(told.flight.state.orders["alpha/a"].state, "rejected")
    told.tell("order b fly to=30,0")
    check_equal(told.flight.state.orders["alpha/b"].detail, "inside an exclusion fence")
    told.tell("order c fly to=0,0")
    check_equal(told.flight.state.orders["alpha/c"].detail, "the vehicle is not armed")


@pytest.mark.parametrize("verb", ["fly to=0,0", "go-into loiter"])
def test_a_node_that_takes_no_orders_of_the_flight_says_so(verb: str) -> None:
    """Also where it flies missions."""
    told = story(flight_enabled=False, mission_enabled=True)
    told.tell(f"order a {verb}")
    check_equal(told.flight.state.orders["alpha/a"].state, "unsupported")


@pytest.mark.parametrize("name", SAFETY.states)
def test_when_a_failsafe_has_the_vehicle(name: str) -> None:
    """In every state but where nothing is demanded, or a person holds it off; whichever of them it is."""
    for key in ("1/battery", "1/link"):
        told = story()
        told.flight.state.failsafes.put(key, Failsafe(name))
        check_equal((name, failsafe_flies(told.flight.state, 1)), (name, name not in ("ok", "held_off", "settling")))


@pytest.mark.parametrize(
    ("verb", "state", "because"),
    [
        ("pause", "flying", "a failsafe has the vehicle: it must be held off first"),
        ("resume", "paused", "a failsafe has the vehicle: it must be held off first"),
        ("abort", "flying", "recorded"),
    ],
)
def test_what_is_asked_of_a_mission_that_a_failsafe_has(verb: str, state: str, because: str) -> None:
    """It may be aborted; and on a silent vehicle likewise."""
    for words, answer in (
        ("spot 0,0", because),
        ("vehicle down", "no vehicle is heard" if verb != "abort" else because),
    ):
        told = Story(*flying.opening())
        told.tell("planned")
        told.flight.state.missions.put(1, Mission(state=state))
        told.tell(words)
        told.flight.state.failsafes.put("1/battery", Failsafe("complying"))
        told.tell(f"order a {verb}")
        check_equal(told.flight.state.orders["alpha/a"].detail, answer)
