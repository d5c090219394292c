"""Chart `mission`: from the link to the vehicle to its landing, and to the push of what was seen (seed 004, section 4).

Theory of operation. A start looks for the vehicle (`linking`), fetches and plans the mission (`checking`), waits for
the self-test (`selftest`) and, unless configured to begin by itself, for an order of a person (`ready`). The plan is
then put into the vehicle and read back (`uploading`) before any motor turns. A multirotor is started in the way that
ArduPilot and PX4 both take: hold (`readying`), arm (`arming`), mission mode (`engaging`), MISSION_START (`starting`).
Where a pilot starts it, as always with a fixed wing, the node waits until it sees that (`waiting_for_pilot`). In the
air it watches: what the vehicle says of its mode and of its items is what counts, not what it was told. As it begins
to fly, cameras that nobody holds are turned down as the plan was made for.

A step that asks something of the vehicle goes on only when the answer or the vehicle's own state says so. It is tried
`mission_tries` times, `mission_step_ms` apart whether it was refused or not answered, for what an autopilot refuses
(its checks before arming) takes time to mend; then the mission is `paused`, for a person to look at. A vehicle that
leaves the mission's mode was taken by somebody: paused, and nothing is commanded against it. A failsafe is the safety
chart's; this chart follows it (`returning`). `aborting` asks for the return until the vehicle is seen to comply.

What the vehicle said when it was told to do something else may be said once more by a heartbeat that left before. So a
vehicle that is paused, or sent back into the mission, is not believed to return, nor to fly the mission, on the word
that it had said before: it has to be seen in another mode first. One that keeps returning is asked to hold
`mission_tries` times, and then it is `returning`; at once where a failsafe has it.

While a camera follows a finding, the mission office is asked for a waypoint there; the changed plan is uploaded in the
air, the vehicle waits at that waypoint (`following`), and goes on behind it when the following ends.

A vehicle that is not heard is asked for nothing; when it is heard again it is asked anew. Nor is one that a failsafe
brings home or down: then this chart only watches. A plan that changes before the arming is uploaded again first; one
that changes in the air, as soon as the vehicle flies the mission.

After the landing the mission office, where there is one, is asked to take what the flight saw (`syncing`). The mission
is done when it has, or when it won't: then what was seen stays in the flight's log. A start asks again.

It must never arm on an order from before a start, nor before the newest plan was read back, never begin with a vehicle
that is armed already, never start what a self-test has not passed, never command a vehicle that somebody else has
taken, and never fly a plan a second time by itself.
"""

from __future__ import annotations

from statecharts.charts.mission_guards import (
    Facts,
    armed,
    at_middle,
    back_in_mission,
    by_waypoint,
    disarmed,
    flown_already,
    followed,
    goes_home,
    goes_home_in_air,
    goes_on_trying,
    going_home,
    holding,
    holds_plan,
    homeward,
    homeward_in_mission,
    in_air,
    in_air_with_plan,
    in_mission,
    in_mission_in_air,
    in_mission_or_holding,
    in_mission_with_plan,
    keeps_returning,
    landed,
    last_try,
    lingers,
    may_begin,
    off,
    outward,
    pilot,
    pushes,
    started_by_pilot,
    taken,
    tested,
    tested_and_begun,
    was_refused,
)
from statecharts.table import Chart, Row, ignore, move

STATES = (
    *("idle", "linking", "checking", "selftest", "ready", "uploading", "waiting_for_pilot"),
    *("readying", "arming", "engaging", "starting", "flying", "following"),
    *("paused", "returning", "aborting", "landed", "syncing", "done", "aborted"),
)
TRIGGERS = (
    *("node_started", "linked", "planned", "unavailable", "tested", "begin", "pause", "resume", "abort"),
    *("uploaded", "upload_failed", "accepted", "refused", "reported", "progressed", "failsafe"),
    *("follow_began", "follow_ended", "pushed", "not_pushed", "time_passed"),
)
# What an operator may ask of the mission in each state: the command chart refuses the rest with a reason.
MAY_BEGIN = ("linking", "checking", "selftest", "ready", "done", "aborted")
MAY_PAUSE = ("uploading", "readying", "arming", "engaging", "starting", "flying", "following", "returning")
MAY_RESUME = ("paused",)
OVER = ("idle", "landed", "syncing", "done", "aborting", "aborted")
# States of a mission that is under way in the air, which a flight hands over where the next one begins there.
IN_THE_AIR = ("uploading", "engaging", "flying", "following", "paused", "returning", "aborting")


_NOT_NOW = {
    "node_started": "goes on with what it was at",
    "linked": "the vehicle is there",
    "planned": "the plan is kept for when it is needed",
    "unavailable": "not waited for",
    "tested": "not waited for",
    "begin": "noted, or refused where it was asked",
    "pause": "refused where it was asked",
    "resume": "refused where it was asked",
    "abort": "refused where it was asked",
    "uploaded": "of an upload that is waited for no more",
    "upload_failed": "of an upload that is waited for no more",
    "accepted": "what the vehicle does counts, not what it answers",
    "refused": "not waited for",
    "reported": "as expected",
    "progressed": "noted",
    "failsafe": "nothing of this mission flies",
    "follow_began": "the vehicle goes its way",
    "follow_ended": "the vehicle goes its way",
    "pushed": "of a push that is waited for no more",
    "not_pushed": "of a push that is waited for no more",
    "time_passed": "waits for nothing",
}


def _whole(*rows: Row[Facts]) -> tuple[Row[Facts], ...]:
    """Return these rows and, for every cell that none of them is in, one that stays."""
    taken = {(row.source, row.trigger): True for row in rows}
    empty = [(state, trigger) for state in STATES for trigger in TRIGGERS if (state, trigger) not in taken]
    return (*rows, *(ignore(state, trigger, _NOT_NOW[trigger]) for state, trigger in empty))


def _tried(source: str, no: str, because: str, silence: str) -> tuple[Row[Facts], ...]:
    """Return what becomes of a step that is refused by the trigger `no`, or of which nothing comes in its time."""
    often = "as often as it may be tried"
    return (
        move(source, no, "paused", f"{because}, {often}", last_try, band=5),
        ignore(source, no, f"{because}: tried again when its time is over", band=6),
        move(source, "time_passed", "paused", f"{silence}, {often}", last_try, band=5),
        move(source, "time_passed", source, f"{because}: tried again", was_refused, band=6),
        move(source, "time_passed", source, f"{silence}: tried again", band=7),
    )


def _heard_again(source: str) -> tuple[Row[Facts], ...]:
    return (move(source, "linked", source, "the vehicle is heard again: asked anew"),)


def _step(source: str) -> tuple[Row[Facts], ...]:
    """Return what every step has in common that asks something of a vehicle which has not taken off."""
    return (
        *_tried(source, "refused", "the vehicle did not do it", "nothing came of it"),
        *_heard_again(source),
        move(source, "pause", "paused", "an operator pauses it"),
        move(source, "abort", "aborting", "an operator aborts it", armed, band=1),
        move(source, "abort", "aborted", "an operator aborts it", band=2),
        move(source, "failsafe", "returning", "a failsafe sends the vehicle home"),
    )


# An order to begin does not outlive a start on the ground: hours later somebody may stand beside the propellers.
_AGAIN = "started again on the ground: waits for an order anew"


def _replanned(source: str) -> tuple[Row[Facts], ...]:
    return (move(source, "planned", "uploading", "the plan has changed"),)


def _before_upload(source: str) -> tuple[Row[Facts], ...]:
    return (move(source, "abort", "aborted", "an operator gives it up"),)


def _in_the_air(source: str) -> tuple[Row[Facts], ...]:
    return (
        move(source, "reported", "landed", "disarmed", disarmed, band=1),
        move(source, "abort", "aborting", "an operator aborts it"),
    )


def _while_not_looked_at(source: str) -> tuple[Row[Facts], ...]:
    """Return what the vehicle may do by itself while the node is busy with its plan."""
    return (
        move(source, "reported", "landed", "disarmed", landed, band=1),
        move(source, "reported", "returning", "the vehicle goes home by itself", goes_home, band=2),
        move(source, "reported", "paused", "somebody took the vehicle out of the mission", taken, band=3),
        ignore(source, "reported", "its plan comes first", band=4),
    )


def _under_way(source: str) -> tuple[Row[Facts], ...]:
    return (
        *_in_the_air(source),
        move(source, "reported", "returning", "the vehicle goes home by itself", going_home, band=2),
        move(source, "pause", "paused", "an operator pauses it"),
        move(source, "failsafe", "returning", "a failsafe sends the vehicle home"),
    )


CHART: Chart[Facts] = Chart(
    name="mission",
    initial="idle",
    states=STATES,
    terminal=(),
    triggers=TRIGGERS,
    rows=_whole(
        ignore("idle", "node_started", "this node flies no missions", off, band=1),
        move("idle", "node_started", "linking", "looks for the vehicle", band=2),
        move("linking", "linked", "checking", "the vehicle is heard: which mission?"),
        *_before_upload("linking"),
        move("checking", "planned", "done", "flown already; begins again only by order", flown_already, band=1),
        move("checking", "planned", "uploading", "planned, and tested before", tested_and_begun, band=2),
        move("checking", "planned", "ready", "planned, and tested before: waits for an order", tested, band=3),
        move("checking", "planned", "selftest", "planned", band=4),
        ignore("checking", "unavailable", "it is tried again", goes_on_trying, band=1),
        move("checking", "unavailable", "paused", "no mission can be had", band=2),
        move("checking", "node_started", "checking", "started again: fetched again"),
        *_before_upload("checking"),
        move("selftest", "tested", "uploading", "fit to fly", may_begin, band=1),
        move("selftest", "tested", "ready", "fit to fly: waits for an order", band=2),
        *_before_upload("selftest"),
        move("ready", "begin", "uploading", "a person lets it begin"),
        *_before_upload("ready"),
        move("uploading", "uploaded", "engaging", "the vehicle has the plan, in the air", in_air, band=1),
        move(
            "uploading", "uploaded", "waiting_for_pilot", "the vehicle has the plan: a pilot starts it", pilot, band=2
        ),
        move("uploading", "uploaded", "paused", "armed already: somebody has it", armed, band=3),
        move("uploading", "uploaded", "readying", "the vehicle has the plan, read back", band=4),
        *_tried("uploading", "upload_failed", "the vehicle did not take the plan", "no word of the upload"),
        *_heard_again("uploading"),
        move("uploading", "node_started", "ready", _AGAIN, disarmed, band=1),
        ignore("uploading", "node_started", "armed: it is asked again when the vehicle is heard", band=2),
        *_replanned("uploading"),
        *_while_not_looked_at("uploading"),
        move("uploading", "pause", "paused", "an operator pauses it"),
        move("uploading", "abort", "aborting", "an operator aborts it", armed, band=1),
        move("uploading", "abort", "aborted", "an operator aborts it", band=2),
        move("uploading", "failsafe", "returning", "a failsafe sends the vehicle home"),
        move("waiting_for_pilot", "reported", "flying", "a pilot has started it", started_by_pilot, band=1),
        ignore("waiting_for_pilot", "reported", "not started yet", band=2),
        move("waiting_for_pilot", "planned", "uploading", "the plan has changed", disarmed, band=1),
        ignore("waiting_for_pilot", "planned", "armed: the plan is changed in the air", band=2),
        *_before_upload("waiting_for_pilot"),
        *_step("readying"),
        move("readying", "node_started", "ready", _AGAIN),
        *_replanned("readying"),
        move("readying", "accepted", "arming", "the vehicle holds"),
        move("readying", "reported", "arming", "the vehicle holds", holding, band=1),
        ignore("readying", "reported", "not yet", band=2),
        *_step("arming"),
        move("arming", "node_started", "ready", _AGAIN),
        *_replanned("arming"),
        move("arming", "reported", "engaging", "armed", armed, band=1),
        ignore("arming", "reported", "not yet", band=2),
        *_step("engaging"),
        move("engaging", "reported", "landed", "disarmed", landed, band=1),
        move("engaging", "reported", "paused", "disarmed before it began", disarmed, band=2),
        move("engaging", "reported", "returning", "the vehicle goes home by itself", goes_home, band=3),
        move("engaging", "reported", "paused", "somebody took the vehicle out of the mission", taken, band=4),
        move("engaging", "reported", "flying", "goes on with the mission", in_mission_in_air, band=5),
        move("engaging", "reported", "starting", "the vehicle is in the mission's mode", in_mission, band=6),
        ignore("engaging", "reported", "not yet", band=7),
        *_step("starting"),
        move("starting", "accepted", "flying", "the mission has begun"),
        move("starting", "reported", "paused", "disarmed before it began", disarmed, band=1),
        move("starting", "reported", "returning", "the vehicle goes home by itself", going_home, band=2),
        ignore("starting", "reported", "it is about to begin", in_mission, band=3),
        move("starting", "reported", "paused", "somebody took the vehicle out of the mission", band=4),
        *_under_way("flying"),
        ignore("flying", "reported", "it flies the mission", in_mission_with_plan, band=3),
        move("flying", "reported", "uploading", "the plan has changed meanwhile", in_mission, band=4),
        move("flying", "reported", "paused", "somebody took the vehicle out of the mission", band=5),
        move("flying", "progressed", "returning", "the mission is on its way home", homeward, band=1),
        move("flying", "progressed", "following", "waits at what is followed", at_middle, band=2),
        ignore("flying", "progressed", "noted", band=3),
        move("flying", "follow_began", "flying", "asks for a waypoint at what is followed", by_waypoint, band=1),
        ignore("flying", "follow_began", "the camera follows, the vehicle goes its way", band=2),
        move("flying", "planned", "uploading", "the plan has changed"),
        *_under_way("following"),
        ignore("following", "reported", "it waits", in_mission_or_holding, band=3),
        move("following", "reported", "paused", "somebody took the vehicle out of the mission", band=4),
        ignore("following", "node_started", "goes on with what it was at", followed, band=1),
        move("following", "node_started", "engaging", "nothing is followed in this flight", holds_plan, band=2),
        move("following", "node_started", "uploading", "nothing is followed in this flight", band=3),
        move("following", "follow_ended", "engaging", "goes on where it left the mission", holds_plan, band=1),
        move("following", "follow_ended", "uploading", "goes on by the changed plan", band=2),
        move("paused", "resume", "engaging", "an operator lets it go on", in_air_with_plan, band=1),
        move("paused", "resume", "uploading", "an operator lets it go on by the changed plan", in_air, band=2),
        move("paused", "resume", "uploading", "an operator lets it go on", tested_and_begun, band=3),
        move("paused", "resume", "ready", "an operator lets it go on: waits for an order", tested, band=4),
        move("paused", "resume", "checking", "an operator lets it go on", band=5),
        move("paused", "reported", "landed", "disarmed", landed, band=1),
        move("paused", "reported", "returning", "the vehicle goes home", goes_home_in_air, band=2),
        move("paused", "reported", "flying", "somebody put it back into the mission", back_in_mission, band=3),
        ignore("paused", "reported", "a person has it, or it was not seen to stop yet", band=4),
        move("paused", "time_passed", "returning", "it does not stop returning", keeps_returning, band=1),
        move("paused", "time_passed", "paused", "it does not hold: asked again", lingers, band=2),
        ignore("paused", "time_passed", "it holds, or somebody has it", band=3),
        ignore("paused", "failsafe", "its return is seen when the vehicle complies"),
        move("paused", "abort", "aborting", "an operator aborts it", armed, band=1),
        move("paused", "abort", "aborted", "an operator aborts it", band=2),
        *_in_the_air("returning"),
        ignore("returning", "reported", "on its way home", going_home, band=2),
        move("returning", "reported", "flying", "back in the mission", outward, band=3),
        ignore("returning", "reported", "on its way home by the mission", homeward_in_mission, band=4),
        move("returning", "reported", "paused", "somebody stopped the return", band=5),
        move("returning", "pause", "paused", "an operator pauses it"),
        move("aborting", "reported", "aborted", "disarmed", disarmed, band=1),
        ignore("aborting", "reported", "on its way home, or asked again soon", band=2),
        move("aborting", "time_passed", "aborting", "it does not comply: asked again"),
        ignore("aborting", "linked", "it complied when it was last heard", going_home, band=1),
        move("aborting", "linked", "aborting", "the vehicle is heard again: asked anew", band=2),
        move("landed", "time_passed", "syncing", "over: what was seen goes to the mission office", pushes, band=1),
        move("landed", "time_passed", "done", "the flight of the mission is over", band=2),
        move("syncing", "node_started", "syncing", "started again: pushed again"),
        move("syncing", "pushed", "done", "what was seen is with the mission office"),
        ignore("syncing", "not_pushed", "it is tried again", goes_on_trying, band=1),
        move("syncing", "not_pushed", "done", "the mission office did not take it all: the rest stays here", band=2),
        move("syncing", "time_passed", "done", "no word of the mission office: what was seen stays here"),
        move("done", "begin", "checking", "a person lets it begin again"),
        move("aborted", "begin", "checking", "a person lets it begin again"),
    ),
)
