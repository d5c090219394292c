"""A flight that begins in the air, in the place of one whose log can't be written: its mission goes on where it was."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from events.schema.common_pb2 import Moved
from events.schema.flight_pb2 import BaselineCarried
from events.schema.mission_pb2 import ArmVehicle
from events.schema.safety_pb2 import FLIGHT_MODE_LOITER
from events.schema.state_pb2 import CarriedState
from projections.describe import describe
from projections.picture import MissionPicture
from statecharts.carry import carry_over
from statecharts.charts.mission import IN_THE_AIR
from statecharts.charts.mission_state import has_middle
from statecharts.state import State
from tests import flying
from tests.checks import check_chart, check_equal
from tests.monitors import complaints
from tests.projections.test_status import check_agrees, folded
from tests.statecharts.charts.test_mission import AIR, story
from tests.statecharts.charts.test_mission_following import followed
from tests.statecharts.test_monitors import changed, steps
from tests.stories import Story

FOLLOWED = ("order f follow p1 by=bravo", "planned rev=b items=takeoff,go,go,go,home", "uploaded", "mode mission")
WAYS: dict[str, tuple[str, ...]] = {
    "flying": ("at 2 reached=1",),
    "paused": ("at 2 reached=1", "order p pause", "mode loiter"),
    "engaging": ("at 2 reached=1", "order p pause", "mode loiter", "order r resume"),
    "uploading": ("at 2 reached=1", "planned rev=b"),
    "returning": ("mode return",),
    "aborting": ("order x abort",),
    "following": (*FOLLOWED, "at 3 reached=2", "mode loiter"),
}


def before(way: Iterable[str], tale: Story | None = None) -> Story:
    """Return a flight that was told so far."""
    tale = tale or followed()
    for words in way:
        tale.tell(words)
    return tale


def carried_of(tale: Story) -> CarriedState:
    """Return what it hands over."""
    return carry_over(tale.flight.state, tale.flight.now_ns)


def after(tale: Story) -> Story:
    """Return the flight that begins in its place."""
    manifest, _, started, _, _ = flying.opening(sightings_to_ask=1, frame_rate_floor_mhz=0)
    return Story(manifest, BaselineCarried(state=carried_of(tale)), started)


def meant(state: State) -> dict[str, object]:
    """Return what the state of a mission means, without seqs."""
    now, plan, vehicle = state.missions[1], state.plans[1], state.vehicles[1]
    kept = now._replace(effect_seq=0, plan_seq=0, held_seq=0, middle_seq=0, refusal="")
    items = [item.SerializeToString(deterministic=True) for item in plan.items]
    told = (plan.mission_id, plan.revision, plan.json_sha256, plan.fixed_wing)
    holds = now.held_seq > now.plan_seq
    about = (vehicle.armed, vehicle.flight_mode)
    return {"mission": kept, "items": items, "plan": told, "holds": holds, "middle": has_middle(state), "is": about}


def test_every_state_of_the_air_has_a_way_here() -> None:
    """What is handed over is tested in each of them."""
    check_equal(sorted(WAYS), sorted(IN_THE_AIR))


@pytest.mark.parametrize("name", IN_THE_AIR)
def test_the_first_state_is_what_was_carried(name: str) -> None:
    """In every state of the air, before anything else happened in the new flight."""
    tale = before(WAYS[name])
    check_equal(tale.flight.state.missions[1].state, name)
    manifest, *_ = flying.opening()
    new = Story(manifest, BaselineCarried(state=carried_of(tale))).flight.state
    check_equal(meant(new), meant(tale.flight.state))


def test_what_is_known_of_a_try_is_carried_too() -> None:
    """How often it was tried; the mode that a pause was to end; and what was flown before."""
    tale = before(("mode return", "order p pause"))
    tale.flight.state.missions.put(1, tale.flight.state.missions[1]._replace(tries=2, flown_revision="z"))
    manifest, *_ = flying.opening()
    new = Story(manifest, BaselineCarried(state=carried_of(tale))).flight.state
    check_equal(meant(new), meant(tale.flight.state))
    check_equal((new.missions[1].tries, new.missions[1].flown_revision), (2, "z"))


def test_it_flies_on_to_its_end() -> None:
    """Watched as after a restart in the air; nothing is asked of a vehicle that does what it should."""
    tale = check_chart(
        "mission",
        """
        at_s | observe        | state       | say | why
        1    | vehicle up     | -           | -   | -
        1.1  | mode mission   | -           | -   | -
        1.2  | at 2 reached=1 | -           | -   | -
        30   | at 3 reached=2 | 1 returning | -   | the mission is on its way home
        60   | disarmed       | 1 landed    | -   | disarmed
        70   | time           | 1 syncing   | push m in 60 s | over: what was seen goes to the mission office
        """,
        after(before(WAYS["flying"])),
    )
    check_equal(tale.flight.state.missions[1].flown_revision, "a")
    check_equal(complaints(steps(tale.flight.records)), [])


@pytest.mark.parametrize(
    ("name", "way", "state", "say"),
    [
        ("engaging", "vehicle up", "engaging", "item 2; go mission"),
        ("uploading", "vehicle up", "uploading", "upload 4"),
        ("aborting", "vehicle up", "aborting", "go return"),
        ("paused", "vehicle up|mode loiter|order r resume seq=99", "engaging", "item 2; go mission"),
        ("paused", "vehicle up|mode mission", "flying", ""),
        ("paused", "vehicle up|mode return", "returning", ""),
        ("returning", "vehicle up|mode loiter", "paused", ""),
        ("flying", "vehicle up|mode loiter", "paused", ""),
        ("flying", "vehicle up|mode mission|order p pause seq=99", "paused", "go loiter"),
        ("following", "", "engaging", ""),
        ("following", "vehicle up", "engaging", "item 3; go mission"),
    ],
)
def test_it_goes_on_in_each_state(name: str, way: str, state: str, say: str) -> None:
    """What was asked in the flight before is asked anew, once the vehicle is heard; what is followed is over."""
    tale = after(before(WAYS[name]))
    said = [flying.words_of(one.message) for words in filter(None, way.split("|")) for one in tale.tell(words)]
    check_equal((tale.flight.state.missions[1].state, "; ".join(filter(None, said))), (state, say))
    check_equal(complaints(steps(tale.flight.records)), [])


def test_what_was_followed_by_a_plan_that_has_changed() -> None:
    """It is uploaded first, as at the end of the following."""
    tale = after(before((*WAYS["following"], "planned rev=c")))
    check_equal((tale.flight.state.missions[1].state), "uploading")


def test_a_start_in_the_air_goes_on_following() -> None:
    """In the same flight the camera follows still."""
    tale = before((*WAYS["following"], "start"))
    check_equal(tale.flight.state.missions[1].state, "following")


def test_a_waypoint_that_the_plan_has_is_waited_at_no_more_than_it_was_asked_for() -> None:
    """One that had come is in the plan; one that the office was asked for died with the process."""
    for way, middle in ((FOLLOWED, 2), (FOLLOWED[:1], -1)):
        tale = before(way)
        new = after(tale)
        check_equal(
            (way, new.flight.state.missions[1].middle_item, has_middle(new.flight.state)), (way, middle, middle > 0)
        )
    tale = after(before(FOLLOWED))
    for words in ("vehicle up", "mode mission", "at 3 reached=2"):
        tale.tell(words)
    check_equal(tale.flight.state.missions[1].state, "following")
    check_equal(complaints(steps(tale.flight.records)), [])


def test_an_upload_of_the_flight_before_is_not_believed() -> None:
    """Its effect has a seq of that flight, which may be another's here."""
    tale = after(before(WAYS["uploading"]))
    tale.tell("uploaded 0")
    check_equal(tale.flight.state.missions[1].state, "uploading")
    check_equal(tale.flight.state.missions[1].effect_seq, -1)


@pytest.mark.parametrize(
    "tale",
    [
        lambda: before(("disarmed",)),
        lambda: before(("order x abort", "disarmed")),
        lambda: before(("disarmed", "mode mission")),
        lambda: before(("armed",), check_chart("mission", AIR[: AIR.index("    5    |")], story())),
        lambda: before((), check_chart("mission", AIR[: AIR.index("    7    |")], story())),
        lambda: before(("armed",), story()),
    ],
)
def test_what_is_not_under_way_in_the_air_begins_anew(tale: object) -> None:
    """On the ground, over, or begun and not flown yet: nothing of it may be taken up by itself."""
    made = tale()  # type: ignore[operator]
    check_equal(carried_of(made).HasField("mission"), False)
    check_equal(after(made).flight.state.missions[1].state, "linking")


def test_a_waypoint_that_was_waited_at_is_not_carried() -> None:
    """It is behind the vehicle, though the plan has it still."""
    tale = before((*WAYS["following"], "order t turn by=bravo"))
    check_equal(carried_of(tale).mission.HasField("middle_item"), False)
    check_equal(after(tale).flight.state.missions[1].middle_item, -1)


def test_a_vehicle_that_is_down_is_not_in_the_air_whatever_the_mission_is_at() -> None:
    """As in safe mode, where nobody asks the mission."""
    tale = before(WAYS["flying"])
    tale.flight.state.vehicles.put(1, tale.flight.state.vehicles[1]._replace(armed=False))
    check_equal(carried_of(tale).HasField("mission"), False)


def test_the_monitors_take_it_over() -> None:
    """What was held and begun is; a waypoint that nobody asked for is waited at by nobody."""
    for way, message, expected in (
        (WAYS["flying"], ArmVehicle(vehicle=1), "no self-test has passed"),
        (WAYS["uploading"], ArmVehicle(vehicle=1), "the vehicle does not hold the newest plan"),
        (WAYS["flying"], Moved(chart="mission", instance="1", to_state="following"), "the plan that has the waypoint"),
        (FOLLOWED, Moved(chart="mission", instance="1", to_state="following"), ""),
    ):
        flight = steps(after(before(way)).flight.records)
        flight[-1].append(changed(flight[-1][0], message))
        known = ("hold the newest plan", "no self-test", "nobody ordered", "the plan that has")
        found = [one for one in complaints(flight) if any(said in one for said in known)]
        check_equal([expected in one for one in found[:1]], [True] if expected else [])
        check_equal([one for one in found if "nobody ordered" in one], [])


def test_it_is_seen_in_the_status_and_in_words() -> None:
    """Whoever looks at the new flight sees the mission at once."""
    tale = after(before(WAYS["paused"]))
    picture = folded(tale.flight).picture
    check_agrees(picture, tale.flight.state)
    mission = picture.mission or MissionPicture()
    about = (mission.mission_id, mission.items, mission.state, mission.next_item)
    check_equal(about, ("m", 4, "paused", 2))
    check_equal(mission.because, "the flight before ended in the air: it goes on")
    words = [describe(one) for one in tale.flight.records if one.kind.name == "baseline_carried"]
    check_equal([", a mission in the air, paused" in one for one in words], [True])
    check_equal(tale.flight.state.vehicles[1].flight_mode, FLIGHT_MODE_LOITER)
