"""Chart `transfer`: putting a mission into a vehicle, and reading back what it then has.

Theory of operation (MAVLink guide, Mission Protocol). The mission is offered with its count; the vehicle asks for one
item after the other, and acknowledges the last one. That is not believed: the mission is listed and read back, item by
item, and compared with what this autopilot is known to make of what it was given. Only a mission that was read back
equal is `uploaded`. Whatever is silent is asked again, as often as the protocol's numbers allow.

Messages of this protocol name no transfer, so one that comes late looks like one of now. So each attempt begins with a
rest in which everything that was on its way arrives and is ignored; a mission that was cleared must not be believed on
the word of a late acknowledgement either, so there is a rest before that too.

Where an upload fails, it is begun once more, whole, unless the vehicle has named an item that it will never take. An
autopilot that swaps missions only when the new one is whole (PX4) still has the old one after a refusal, and that is
the only case where it is said to have it. On any other
the old one is gone, and it would fly the mixture: what is there is cleared.

It must never call a mission uploaded that was not read back equal; it must never end without a name for what failed.

This chart is no part of a step: `autopilot/adapters/vehicle/transfer.py` executes it at the edge. The core sees how it
ended (`mission_uploaded`, `mission_upload_failed`).
"""

from __future__ import annotations

from dataclasses import dataclass

from statecharts.table import Chart, Row, ignore, move

ACCEPTED, INVALID_SEQUENCE, CANCELLED = 0, 13, 15  # MAV_MISSION_RESULT
OF_AN_ITEM = range(2, 13)  # it names an item's frame, command or parameter, or has no space
ERROR = 1
# A second try may do better: an error of the moment, a step that was lost, an upload that the vehicle gave up.
WORTH_ANOTHER_TRY = (ERROR, INVALID_SEQUENCE, CANCELLED)


@dataclass(frozen=True, slots=True, kw_only=True)
class Facts:
    """What the guards look at."""

    seq: int = 0  # of the item that the vehicle asks for or gives back
    furthest: int = -1  # highest item that it has asked for in this attempt
    count: int = 0  # items of the mission, home included where the vehicle counts it
    reading: int = 0  # item that it was asked for
    result: int = 0  # MAV_MISSION_RESULT
    equal: bool = False  # what it gives back is what it was given
    tries_left: bool = False  # what was said last may be said again
    attempts_left: bool = False  # the upload may be begun again
    keeps_old: bool = False  # it has what it had before: it swaps whole missions only, and has not swapped
    goes_on: bool = False  # to this autopilot an item out of its turn is no end


def in_turn(facts: Facts) -> bool:
    """It asks for an item that it had asked for, or for the next."""
    return 0 <= facts.seq <= facts.furthest + 1 and facts.seq < facts.count


def all_given(facts: Facts) -> bool:
    """It accepts, and has asked for every item."""
    return facts.result == ACCEPTED and facts.furthest == facts.count - 1


def too_early(facts: Facts) -> bool:
    """It accepts, and has not asked for every item; or it only counts an item that was out of its turn."""
    out_of_step = facts.result == INVALID_SEQUENCE and facts.goes_on
    return out_of_step or (facts.result == ACCEPTED and facts.furthest < facts.count - 1)


def errs_at_the_end(facts: Facts) -> bool:
    """Every item left for it, and one came when it had no use for it: its acknowledgement may be lost."""
    return facts.result == ERROR and facts.furthest == facts.count - 1


def may_begin_again(facts: Facts) -> bool:
    """It refuses for a reason that may pass, and the upload may be begun again."""
    return facts.attempts_left and facts.result in WORTH_ANOTHER_TRY


def keeps_old(facts: Facts) -> bool:
    """It has what it had before."""
    return facts.keeps_old


def accepted(facts: Facts) -> bool:
    """It accepts."""
    return facts.result == ACCEPTED


def of_the_upload(facts: Facts) -> bool:
    """It ends an upload that was given up."""
    return facts.result in (INVALID_SEQUENCE, CANCELLED)


def tries_left(facts: Facts) -> bool:
    """What was said last may be said again."""
    return facts.tries_left


def attempts_left(facts: Facts) -> bool:
    """The upload may be begun again."""
    return facts.attempts_left


def everything_given(facts: Facts) -> bool:
    """Every item left for it."""
    return facts.furthest == facts.count - 1


def not_its_turn(facts: Facts) -> bool:
    """It gives an item that was not asked for."""
    return facts.seq != facts.reading


def equal(facts: Facts) -> bool:
    """What it gives back is what it was given."""
    return facts.equal


def equal_and_last(facts: Facts) -> bool:
    """The last item is what it was given."""
    return facts.equal and facts.seq == facts.count - 1


_STATES = ("resting", "offering", "sending", "listing", "reading", "settling", "clearing", "uploaded", "failed")
_TRIGGERS = ("requested", "acknowledged", "counted", "given_back", "silent", "expired")


def _deaf(state: str, *triggers: str, because: str) -> tuple[Row[Facts], ...]:
    return tuple(ignore(state, trigger, because) for trigger in triggers)


def _asked(state: str, target: str) -> tuple[Row[Facts], ...]:
    return (
        move(state, "requested", target, "it asks for an item", in_turn, band=1),
        ignore(state, "requested", "that item is not its turn", band=2),
    )


def _refused(state: str) -> tuple[Row[Facts], ...]:
    return (
        ignore(state, "acknowledged", "it can't mean that yet", too_early, band=2),
        move(state, "acknowledged", "resting", "refused for now: once more, whole", may_begin_again, band=3),
        move(state, "acknowledged", "failed", "refused, and it keeps what it had", keeps_old, band=4),
        move(state, "acknowledged", "settling", "refused: what it has is a mixture", band=5),
    )


def _another(state: str, trigger: str, because: str, band: int) -> tuple[Row[Facts], ...]:
    return (
        move(state, trigger, "resting", f"{because}: once more, whole", attempts_left, band=band),
        move(state, trigger, "settling", because, band=band + 1),
    )


CHART: Chart[Facts] = Chart(
    name="transfer",
    initial="resting",
    states=_STATES,
    terminal=("uploaded", "failed"),
    triggers=_TRIGGERS,
    rows=(
        move("resting", "expired", "failed", "its time is over"),
        *_deaf(
            "resting",
            *("requested", "acknowledged", "counted", "given_back"),
            because="from before this attempt",
        ),
        move("resting", "silent", "offering", "what was on its way has arrived"),
        move("offering", "expired", "failed", "its time is over"),
        *_asked("offering", "sending"),
        *_refused("offering"),
        *_deaf("offering", "counted", "given_back", because="nothing is read yet"),
        move("offering", "silent", "offering", "offered again", tries_left, band=1),
        move("offering", "silent", "failed", "no answer to the offer", band=2),
        move("sending", "expired", "failed", "its time is over"),
        *_asked("sending", "sending"),
        move("sending", "acknowledged", "listing", "it says that it has all items", all_given),
        move("sending", "acknowledged", "listing", "no word whether it has all items", errs_at_the_end, band=1),
        *_refused("sending"),
        *_deaf("sending", "counted", "given_back", because="nothing is read yet"),
        move("sending", "silent", "sending", "given again", tries_left, band=1),
        move("sending", "silent", "listing", "no word whether it has all items", everything_given, band=2),
        move("sending", "silent", "resting", "it asks no more: once more, whole", attempts_left, band=3),
        move("sending", "silent", "failed", "it asks no more", keeps_old, band=4),
        move("sending", "silent", "settling", "it asks no more: what it has is a mixture", band=5),
        move("listing", "expired", "failed", "its time is over"),
        *_asked("listing", "listing"),
        ignore("listing", "acknowledged", "what it has is read now"),
        move("listing", "counted", "reading", "it has as many", equal, band=1),
        *_another("listing", "counted", "it has another number of items", band=2),
        ignore("listing", "given_back", "no item was asked for"),
        move("listing", "silent", "listing", "listed again", tries_left, band=1),
        move("listing", "silent", "resting", "it does not list: once more, whole", attempts_left, band=2),
        move("listing", "silent", "failed", "it does not say what it has", band=3),
        move("reading", "expired", "failed", "its time is over"),
        *_asked("reading", "reading"),
        ignore("reading", "acknowledged", "what it has is read now"),
        ignore("reading", "counted", "it was counted"),
        ignore("reading", "given_back", "another item was asked for", not_its_turn, band=1),
        move("reading", "given_back", "uploaded", "all items are as given", equal_and_last, band=2),
        move("reading", "given_back", "reading", "as given", equal, band=3),
        *_another("reading", "given_back", "an item is not what was given", band=4),
        move("reading", "silent", "reading", "asked again", tries_left, band=1),
        move("reading", "silent", "resting", "it does not give items back: once more, whole", attempts_left, band=2),
        move("reading", "silent", "failed", "it does not say what it has", band=3),
        move("settling", "expired", "failed", "its time is over"),
        *_deaf(
            "settling",
            *("requested", "acknowledged", "counted", "given_back"),
            because="the upload is given up",
        ),
        move("settling", "silent", "clearing", "what was on its way has arrived"),
        move("clearing", "expired", "failed", "its time is over"),
        *_deaf("clearing", "requested", "counted", "given_back", because="the upload is given up"),
        move("clearing", "acknowledged", "failed", "it was cleared", accepted, band=1),
        ignore("clearing", "acknowledged", "that is about the upload", of_the_upload, band=2),
        move("clearing", "acknowledged", "failed", "it refuses to be cleared", band=3),
        move("clearing", "silent", "clearing", "cleared again", tries_left, band=1),
        move("clearing", "silent", "failed", "no answer to the clearing", band=2),
        *_deaf("uploaded", *_TRIGGERS, because="it is over"),
        *_deaf("failed", *_TRIGGERS, because="it is over"),
    ),
)
