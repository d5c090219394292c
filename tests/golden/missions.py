"""Golden flights of a mission: how it goes, and what it does not heed in each of its states. It checks nothing.

A flight is told as the ways into a state and what comes there. What a state ignores is told one after the other, for
it stays; what moves it has a line of its own in the ways.
"""

from __future__ import annotations

from typing import Any

from google.protobuf.message import Message

from events.schema.flight_pb2 import BaselineCarried
from events.schema.mission_pb2 import MissionUploaded, MissionUploadFailed, PushReported
from events.schema.safety_pb2 import FLIGHT_MODE_LOITER
from events.schema.state_pb2 import CarriedMission, CarriedState
from tests import flights, flying
from tests.flights import Flight
from tests.stories import Story
from tests.stories_of_safety import SAFE_LIMITS

# Every trigger of the chart in words; what of it moves a state is left out there.
WORDS = {
    "node_started": "start",
    "linked": "vehicle up",
    "planned": "planned",
    "unavailable": "no-mission",
    "begin": "order {} begin",
    "pause": "order {} pause",
    "resume": "order {} resume",
    "abort": "order {} abort",
    "uploaded": "own uploaded",
    "upload_failed": "own failed",
    "accepted": "own 0",
    "refused": "own 4",
    "reported": "disarmed",
    "progressed": "at 1",
    "follow_began": "order {} follow p1 roles=camera",
    "follow_ended": "order {} turn roles=camera",
    "pushed": "own pushed",
    "not_pushed": "own not-pushed",
}
FAILSAFE = "wait 6|flies|battery 20|battery 90|disarmed"
UP = "uploaded|did 0|armed|mode mission|did 0"
CLEAN = {"operator_lost_ms": 0, "sightings_to_ask": 1, "frame_rate_floor_mhz": 0, "operator_hold_ms": 1_000}
LIMITS: dict[str, Any] = flying.LIMITS | SAFE_LIMITS | CLEAN


class _Teller:
    """Tells lines, gives each order a name of its own, and lets time pass."""

    def __init__(self, *opening: Message, **changes: Any) -> None:
        self.story = Story(*(opening or flying.opening(**LIMITS | changes)))
        self._names = 0

    def tell(self, way: str) -> None:
        """Tell the lines of a way; `wait 10` and `late 10` are seconds, `own` is what the mission's effect came to."""
        for words in filter(None, map(str.strip, way.replace("\n", "|").split("|"))):
            verb, _, rest = words.partition(" ")
            if verb == "wait":
                self.story.flight.wait(1_000 * int(rest))
                continue
            self.story.flight.wait(20)
            if verb == "late":
                self.story.at(self.story.flight.now_ns // 1_000_000 + 1_000 * int(rest))
                continue
            if verb == "own":
                self.story.flight.tell(_of_own(self.story.flight.state.missions[1].effect_seq, rest))
                continue
            self._names += 1
            selftest = self.story.flight.state.selftests.get(1)
            self.story.tell(words.format(f"o{self._names}", report=0 if selftest is None else selftest.effect_seq))

    def ignore(self, *but: str, **other: str) -> None:
        """Tell everything that a state ignores, in other words where they are given."""
        self.tell("|".join(words for trigger, words in (WORDS | other).items() if trigger not in but))


def _of_own(seq: int, words: str) -> Message:
    if words == "uploaded":
        return MissionUploaded(effect_seq=seq, items=4, attempts=1)
    if words == "failed":
        return MissionUploadFailed(effect_seq=seq, because="refused", attempts=2)
    if words == "pushed":
        return PushReported(effect_seq=seq, observations=1, attempts=1, final=True)
    if words in ("not-pushed", "no-push"):
        return PushReported(effect_seq=seq, because="refused", attempts=1, left=1, final=words == "no-push")
    return flights.answered(seq, int(words))


def _thrice(words: str) -> str:
    """Return the words of a step that is refused as often as it is tried."""
    return "|wait 11|".join([words] * 3)


def on_the_ground() -> Flight:
    """From the link to the arming, and what nobody heeds in between; given up, paused and begun again."""
    teller = _Teller()
    teller.tell("frame person@5,5|wait 1|order {} confirm p1 roles=camera")
    teller.ignore("planned", "abort")
    teller.tell(FAILSAFE + "|order {} abort|order {} begin|no-mission final=1|order {} resume|planned")
    teller.ignore("abort")
    teller.tell(
        FAILSAFE + "|order {} abort|order {} begin|planned|report pass,degraded|order {} acknowledge 3|wait 130"
    )
    teller.tell("planned|report fail|planned|report pass,skipped|order {} begin")
    teller.ignore("node_started", "planned", "pause", "abort", "uploaded")
    teller.tell("start|vehicle up|order {} begin|order {} pause")
    teller.ignore("resume", "abort")
    teller.tell(FAILSAFE + "|order {} abort")
    teller.ignore("begin")
    teller.tell(FAILSAFE + "|order {} begin|planned|" + _thrice("not-uploaded") + "|order {} resume")
    teller.tell("wait 200|order {} resume|planned|order {} abort|order {} begin|planned|uploaded")
    teller.ignore("node_started", "planned", "pause", "abort", "accepted")
    teller.tell("start|vehicle up|order {} begin|uploaded|" + _thrice("did 4") + "|order {} resume")
    teller.tell("uploaded|planned|uploaded|wait 40|order {} resume|uploaded|order {} pause|order {} resume|uploaded")
    teller.tell("order {} abort|order {} begin|planned|uploaded|mode guided disarmed=1")
    teller.ignore("node_started", "planned", "pause", "abort")
    teller.tell(
        "start|vehicle up|order {} begin|uploaded|did 0|" + _thrice("did 4") + "|order {} resume|uploaded|did 0"
    )
    teller.tell("planned|uploaded|did 0|wait 40|order {} resume|uploaded|did 0|order {} pause|order {} resume")
    teller.tell("uploaded|did 0|order {} abort")
    return teller.story.flight


def begun() -> Flight:
    """The last steps before it flies, each stopped in every way, by whoever may."""
    teller = _Teller(push_ms=0)
    teller.tell("frame person@5,5|wait 1|order {} confirm p1 roles=camera|planned|report pass")
    teller.ignore("begin", "abort")
    teller.tell(FAILSAFE + "|order {} abort|order {} begin|planned|uploaded|did 0|armed")
    teller.ignore("pause", "abort", reported="armed", planned="at 1")
    teller.tell("planned|did 4|wait 40|order {} resume|disarmed|order {} begin|uploaded|did 0|armed|disarmed")
    teller.tell("order {} resume|uploaded|did 0|armed|mode return|mode loiter|order {} abort|disarmed")
    teller.tell("order {} begin|planned|uploaded|did 0|armed|order {} pause|order {} abort|disarmed")
    teller.tell("order {} begin|planned|uploaded|did 0|armed|order {} abort|disarmed")
    teller.tell("order {} begin|planned|uploaded|did 0|armed|battery 20|battery 90|disarmed|wait 11")
    for end in ("disarmed", "mode return|mode none", "mode loiter", "order {} pause|mode none", "order {} abort"):
        teller.tell("order {} begin|planned|uploaded|did 0|armed|mode mission|" + end)
        teller.tell("order {} abort|disarmed")
    teller.tell("order {} begin|planned|uploaded|did 0|armed|mode mission")
    teller.ignore("pause", "abort", "refused", "accepted", reported="mode mission")
    teller.tell("planned|did 4|wait 40|mode none|order {} abort|disarmed")
    teller.tell("order {} begin|planned|uploaded|armed|disarmed|order {} resume|uploaded|did 0|battery 20|armed")
    teller.tell("battery 90|disarmed|wait 11")
    teller.ignore("begin")
    teller.tell(FAILSAFE + "|order {} begin|planned|armed|uploaded|order {} resume|disarmed|order {} begin|armed")
    teller.tell("mode return|mode none|disarmed|order {} begin|order {} abort|wait 6")
    return teller.story.flight


def stopped() -> Flight:
    """Each step before it flies, refused for good, aborted with its motors on, and overruled by a failsafe."""
    teller = _Teller(push_ms=0)
    teller.tell("planned|order {} abort|report pass|order {} begin|armed|planned|disarmed|order {} begin")
    teller.tell("order {} abort")
    ways = ("uploaded", "uploaded|mode none|did 0", "uploaded|did 0|armed", "uploaded|did 0|armed|mode mission")
    for last in (_thrice("did 4"), "mode none|order {} abort|disarmed", "mode none|battery 20|battery 90|disarmed"):
        for way in ways:
            teller.tell(f"order {{}} begin|planned|{way}|" + last.removeprefix("mode none|" * ("did 0" in way)))
            teller.tell("wait 11|order {} abort|disarmed")
    for way in ("uploaded|did 0|armed", "uploaded|did 0|armed|mode mission"):
        teller.tell(f"order {{}} begin|planned|{way}|wait 11|order {{}} abort|disarmed")
    for last in ("armed|order {} abort|disarmed", "armed|battery 20|battery 90|disarmed|wait 11"):
        teller.tell("wait 6|order {} begin|planned|" + last)
    return teller.story.flight


def in_the_air() -> Flight:
    """Flown, followed, held, taken, sent home and landed; and what nobody heeds on the way."""
    teller = _Teller()
    teller.tell("frame person@5,5|wait 1|order {} confirm p1 roles=camera|planned|order {} abort|order {} begin")
    teller.tell("report pass|planned|" + UP)
    teller.ignore("pause", "abort", reported="mode mission", planned="at 1")
    teller.tell("posted no|mode mission|uploaded|mode mission|at 2|order {} pause")
    teller.ignore("resume", "abort", reported="mode loiter", planned="at 1")
    teller.tell("mode mission|mode loiter|order {} resume|mode mission|planned|mode loiter|order {} resume|mode loiter")
    teller.tell("uploaded|mode mission|planned|mode return|mode mission|uploaded|mode mission")
    teller.tell("at 1|order {} follow p1 roles=camera|posted|planned items=takeoff,go,go,go,home|uploaded|mode mission")
    teller.tell("at 2 reached=1|mode loiter")
    teller.ignore("pause", "abort", "follow_ended", reported="mode loiter")
    teller.tell("order {} turn roles=camera|uploaded|mode mission|at 1|order {} follow p1 roles=camera|posted")
    teller.tell("planned items=takeoff,go,go,go,home|uploaded|mode mission|at 2 reached=1|mode none|mode mission")
    for end in ("order {} pause", "mode return", "battery 20|battery 90", "order {} turn roles=camera"):
        teller.tell("order {} turn roles=camera|at 1|order {} follow p1 roles=camera|posted")
        teller.tell("planned items=takeoff,go,go,go,home|uploaded|mode mission|at 2 reached=1|wait 6|" + end)
        teller.tell("mode mission|order {} resume|mode mission|uploaded|mode mission|uploaded|mode mission")
    teller.tell(
        "planned|uploaded|mode loiter|order {} resume|mode mission|at 3|mode mission|wait 6|battery 20|battery 90"
    )
    teller.ignore("pause", "abort", reported="mode return")
    teller.tell("wait 6|battery 20|battery 90|mode loiter|mode mission|at 1|mode land|mode mission|order {} pause")
    teller.tell("mode mission|mode return|order {} pause|mode return|mode mission|mode mission|uploaded|mode mission")
    teller.tell("wait 6|battery 20|battery 90|mode mission|order {} abort")
    teller.ignore(reported="mode loiter", linked="vehicle down|vehicle up")
    teller.tell("mode return|vehicle down|vehicle up|mode none|wait 11|wait 6|battery 20|battery 90|disarmed")
    teller.tell("order {} begin|planned|" + UP + "|at 3|order {} abort|disarmed|order {} begin|planned|" + UP)
    teller.tell("order {} turn roles=camera|at 1|order {} follow p1 roles=camera|posted")
    teller.tell(
        "planned items=takeoff,go,go,go,home|start|vehicle up|uploaded|mode mission|at 2 reached=1|order {} abort"
    )
    return teller.story.flight


def landed() -> Flight:
    """How it ends: seen down in each state of the air, over, and begun again by a person only."""
    teller = _Teller(mission_begun_by_order=False, pilot_starts=True)
    teller.tell("frame person@5,5|wait 1|order {} confirm p1 roles=camera|planned wing=1|report pass")
    teller.tell("uploaded")
    teller.ignore("planned", "abort")
    teller.tell(FAILSAFE + "|planned|uploaded|armed|planned|mode mission|disarmed")
    teller.ignore()
    teller.tell(FAILSAFE + "|wait 11")
    teller.ignore("node_started", "pushed")
    teller.tell("start|vehicle up|" + FAILSAFE + "|own pushed")
    teller.ignore("begin")
    teller.tell(FAILSAFE + "|order {} begin|planned|uploaded|order {} abort|order {} begin|planned|uploaded")
    for end in ("mode loiter|disarmed", "mode return|disarmed", "planned|disarmed", "planned|uploaded|disarmed"):
        teller.tell("mode mission|" + end + "|wait 11|own no-push|order {} begin|planned rev=b|uploaded")
    teller.tell("mode mission|order {} abort|disarmed|order {} begin|planned|planned|uploaded|mode mission")
    teller.tell("order {} follow p1 roles=camera|posted|planned items=takeoff,go,go,go,home|uploaded|mode mission|at 1")
    teller.tell("disarmed|wait 11|wait 66")
    return teller.story.flight


def waited() -> Flight:
    """Waited at what is followed over a start; and a return that is paused, of which the vehicle is slow to hear."""
    teller = _Teller()
    teller.tell("frame person@5,5|wait 1|order {} confirm p1 roles=camera|planned|report pass|order {} begin|" + UP)
    teller.tell("at 1|order {} follow p1 roles=camera|posted")
    teller.tell(
        "planned items=takeoff,go,go,go,home|uploaded|mode mission|at 1|at 2 reached=1|start|vehicle up|mode loiter"
    )
    teller.tell("order {} turn roles=camera|mode mission|mode return|order {} pause|mode return|wait 40|mode mission")
    teller.tell("order {} pause|mode mission|wait 11|mode loiter|order {} resume|mode mission|uploaded|mode mission")
    return teller.story.flight


def _in_its_place(*, held: bool) -> Flight:
    """Return a flight that begins in the air, where the one before had waited at what was followed."""
    mission = CarriedMission(vehicle=1, chart_state="following", begun=True, next_item=2, held=held, middle_item=1)
    mission.plan.CopyFrom(flying.planned(items="takeoff,go,go,go,home"))
    mission.vehicle_mode, mission.middle_ahead = FLIGHT_MODE_LOITER, True
    manifest, origin, *_ = flying.opening(**LIMITS)
    teller = _Teller(manifest, BaselineCarried(state=CarriedState(mission=mission)), origin)
    teller.tell("start|vehicle up|mode loiter|uploaded|mode mission|at 4 reached=3|disarmed|wait 11")
    return teller.story.flight


def in_its_place() -> Flight:
    """A flight that begins in the air goes on with the mission, by the plan that the vehicle holds."""
    return _in_its_place(held=True)


def in_its_place_replanned() -> Flight:
    """The same where the vehicle does not hold the newest plan."""
    return _in_its_place(held=False)


def by_itself() -> Flight:
    """A node whose missions begin by themselves, once: in a later flight it knows what was flown."""
    state = CarriedState(flown_revision="a")
    manifest, *rest = flying.opening(
        **LIMITS | {"mission_begun_by_order": False, "follow_by_waypoint": False, "push_ms": 0}
    )
    teller = _Teller(manifest, BaselineCarried(state=state), *rest)
    teller.tell("frame person@5,5|wait 1|order {} confirm p1 roles=camera")
    teller.tell("planned|report pass|order {} begin|planned|" + UP)
    teller.tell("at 1|order {} follow p1 roles=camera|disarmed|wait 11")
    return teller.story.flight


def switched_off() -> Flight:
    """A node that flies no missions hears of them and does nothing."""
    teller = _Teller(mission_enabled=False)
    teller.tell("frame person@5,5|wait 1|order {} confirm p1 roles=camera")
    teller.ignore("uploaded", "upload_failed", "accepted", "refused", "pushed", "not_pushed")
    teller.tell("order {} begin|" + FAILSAFE)
    return teller.story.flight


def unheard() -> Flight:
    """A vehicle that is not heard yet is looked for, and a mission may be given up before it is."""
    manifest, origin, started, _, _ = flying.opening(**LIMITS)
    teller = _Teller(manifest, origin, started)
    own = ("uploaded", "upload_failed", "accepted", "refused", "pushed", "not_pushed")
    teller.ignore("linked", "abort", *own, "follow_began", "follow_ended")
    teller.tell("report pass|order {} abort|order {} begin")
    return teller.story.flight


def tested() -> Flight:
    """The self-test: reports of others, none, bad ones, one that a person takes on, and one that nobody does."""
    teller = _Teller()
    teller.tell("planned|report-of 3|planned|order {} begin|start|vehicle up|wait 11|start|vehicle up|report pass")
    teller.tell("order {} acknowledge {report}|planned|report pass,fail|order {} begin|report degraded,skipped")
    teller.tell("planned|report pass|order {} begin|start|vehicle up|order {} acknowledge 1|wait 121")
    teller.tell("planned|report degraded|start no clock|vehicle up|planned|report degraded|start")
    teller.tell("vehicle up|order {} abort|order {} begin|no-mission final=1")
    teller.tell(
        "order {} acknowledge {report} roles=camera|order {} acknowledge {report}|order {} acknowledge {report}"
    )
    teller.tell("planned|report pass|start|vehicle up|order {} abort|order {} begin")
    return teller.story.flight


def followed() -> Flight:
    """What a camera follows, from each state of the scan; and operators who are silent meanwhile."""
    silence = {"operator_lost_ms": 30_000, "frame_rate_floor_mhz": 10_000, "scan_enabled": True}
    teller = _Teller(mission_enabled=False, **silence)
    turn, go = "order {} turn roles=camera", "order {} follow p1 roles=camera"
    teller.tell(f"flies|heard alpha|frame person@5,5|wait 1|order {{}} confirm p1 roles=camera|{go}")
    teller.tell(f"frame person@6,5|frame person@11,5|{go}|{turn}|wait 2|frame person@5,60|wait 1|{go}")
    teller.tell("|".join(["wait 1|frame person@5,5"] * 11) + f"|{turn}|wait 2|frame person@5,5|frame person@5,5")
    teller.tell(
        f"{go}|heard alpha|wait 40|heard alpha|wait 61|heard alpha|wait 40|start no clock|vehicle up|heard alpha"
    )
    teller.tell(f"wait 40|{turn}|wait 10|heard alpha|{go}|grounded|start no clock|vehicle up|flies|wait 40|grounded")
    teller.tell(f"order {{}} release roles=camera|{go}|{turn}|wait 2")
    teller.tell(f"flies|heard alpha|{turn}|wait 2|{go}|late 40|spot 0,0|late 40|spot 0,0")
    return teller.story.flight


def ordered() -> Flight:
    """Orders of the flight: to places and into modes, each refused once for each reason, and carried out."""
    teller = _Teller()
    fly, go = "order {} fly to=", "order {} go-into "
    teller.tell(
        f"{fly}0,0|{go}loiter|{go}none|planned|report pass|fence in=-99,-99,99,99 in2=-99,-99,90,99 out=20,-9,40,9"
    )
    teller.tell(f"armed|{fly}0,0|spot 0,0|{fly}95,0|{fly}30,0|{fly}50,0|{fly}0,50|did 0|{go}loiter|did 0|{go}guided")
    teller.tell("did 5|did 4|order {} begin|disarmed|order {} begin|uploaded|did 0|armed|mode mission|did 0")
    teller.tell("vehicle down|order {} pause|order {} fly to=0,0|vehicle up|spot 0,0|battery 20|order {} pause")
    teller.tell(f"start|{fly}0,0|order {{}} dance|order {{}} follow p1 roles=camera|vehicle up|order {{}} resume")
    return teller.story.flight


def refused() -> Flight:
    """The same where orders of the flight are switched off."""
    teller = _Teller(flight_enabled=False)
    teller.tell("armed|order {} fly to=0,0|order {} go-into loiter|order {} begin roles=camera")
    return teller.story.flight
