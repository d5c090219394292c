"""Chart `safety`: the failsafes of a vehicle: "1/fence", "1/battery", "1/link" (seed 004; its system's executor).

Theory of operation. A failsafe is a level, not an edge. At every look, and every report and every deadline is one, it
is asked what the facts demand now: nothing, the return, or the landing. While something is demanded and the vehicle is
not seen to comply, the node commands it, and again every `failsafe_again_ms`, for as long as it takes; the time of the
last command is in the log, so that a restart neither forgets to go on nor hurries. What demands:

    fence     the place now, or the way over the next `fence_ahead_ms`, breaks a fence (`geometry`): return
    battery   charge at or under `battery_return_percent`: return; under `battery_land_percent`: land
    link      the operators' link is lost (chart `link`): return

An episode begins when something is demanded, and ends with `ok`. The limit of rate holds within one; the first command
of the next waits for nothing, for it answers another danger. So it matters when an episode is over. It is not with the
first look that demands nothing, for at a fence's edge the noise of places makes and ends a breach twice a second, and
each would be commanded. It is over when nothing is demanded and the vehicle is seen in the mode that was commanded: it
obeyed, and only a further change of modes makes another command. Where it is not seen to obey, the episode is over
when its last command is `failsafe_again_ms` old, or when nothing was demanded for `CALM_MS`; until then the failsafe is
`settling`. Not to know is not to see that nothing is demanded: where the vehicle is not heard, or not where it is, as
after each start, an episode goes on.

In the order of its rows: nothing is demanded of a vehicle that is disarmed. A person may hold a return off for a while
(chart `override`), never a landing; the failsafe looks as soon as that begins. To a vehicle that is not heard nothing
is said: what it does then is its own failsafe's business. Where the landing is demanded, nobody demands the return. A
vehicle complies that is seen in the mode that was demanded; one that lands complies with a return, too, and one that
is disarmed with everything.

It must never command where neither `flight_enabled` nor `mission_enabled` is set, and within an episode never more
often than that. It commands against whoever put the vehicle into another mode, a pilot with a remote control included:
who wants otherwise holds the failsafe off, or disarms.
"""

from __future__ import annotations

from dataclasses import dataclass

from statecharts.table import Chart, Row, ignore, move

COMMANDS = ("returning", "landing")
# A failsafe has its way, or waits to have it.
DEMANDING = ("unreachable", "overruled", "complying", "pending", *COMMANDS)


@dataclass(frozen=True, slots=True)
class Facts:
    """What the guards look at."""

    demand: str = ""  # "returning", "landing"; "" for nothing
    known: bool = True  # whether anything is demanded
    held: bool = False  # a person holds the return off
    link: bool = True
    landing_elsewhere: bool = False  # another failsafe demands the landing
    complies: bool = False  # with what is demanded; where nothing is, with what it last commanded
    rested: bool = False  # nothing was demanded for so long that what comes now is another episode
    commanded: str = ""  # what it last commanded in this episode
    since_ns: int = 0  # how long ago
    again_ns: int = 0


def at_rest(facts: Facts) -> bool:
    """Nothing is demanded, and that is known."""
    return facts.known and not facts.demand


def over(facts: Facts) -> bool:
    """Nothing is demanded, and the episode is over: obeyed, or its last command is old, or it was so for a while."""
    return at_rest(facts) and (facts.complies or facts.rested or not _recent(facts))


def _recent(facts: Facts) -> bool:
    return bool(facts.commanded) and facts.since_ns < facts.again_ns


def held_off(facts: Facts) -> bool:
    """A person holds off what is demanded; the landing can't be."""
    return facts.held and facts.demand != "landing"


def unheard(facts: Facts) -> bool:
    """The vehicle is not heard, or not where it is."""
    return not facts.link or not facts.known


def overruled(facts: Facts) -> bool:
    """The landing is demanded elsewhere, and it is stronger than a return."""
    return facts.landing_elsewhere and facts.demand != "landing"


def complies(facts: Facts) -> bool:
    """The vehicle is seen to do it."""
    return facts.complies


def too_soon(facts: Facts) -> bool:
    """The last command of this episode is not old enough; only the landing need not wait for a return."""
    stronger = facts.demand == "landing" and facts.commanded == "returning"
    return _recent(facts) and not stronger and not facts.rested


def must_land(facts: Facts) -> bool:
    """The landing is demanded."""
    return facts.demand == "landing"


_LOOKS = (
    ("ok", "nothing is demanded any more", over),
    ("settling", "nothing is demanded for the moment", at_rest),
    ("held_off", "a person holds it off", held_off),
    ("unreachable", "the vehicle is not heard, or not where it is: its own failsafe is at work", unheard),
    ("overruled", "the vehicle must land, which is stronger", overruled),
    ("complying", "the vehicle is seen to do it", complies),
    ("pending", "commanded a moment ago", too_soon),
    ("landing", "it must land", must_land),
    ("returning", "it must return", None),
)


def _rows(source: str) -> tuple[Row[Facts], ...]:
    rows: list[Row[Facts]] = []
    for band, (target, because, guard) in enumerate(_LOOKS, start=1):
        waits = target == "pending" and source in COMMANDS
        if source in COMMANDS and target == source:
            rows.append(move(source, "looked", target, f"{because}: not seen to comply", guard, band))
        elif source == target or waits:
            rows.append(ignore(source, "looked", "still so", guard, band))
        else:
            rows.append(move(source, "looked", target, because, guard, band))
    return tuple(rows)


_STATES = tuple(target for target, _, _ in _LOOKS)

CHART: Chart[Facts] = Chart(
    name="safety",
    initial="ok",
    states=_STATES,
    terminal=(),
    triggers=("looked",),
    rows=tuple(row for state in _STATES for row in _rows(state)),
)
