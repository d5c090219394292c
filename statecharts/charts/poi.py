"""Chart `poi`: the life of a point of interest, up to a person's decision (seed 004, POI and IgnoredItem).

Theory of operation. A thing on the map that was seen often and surely enough becomes a question. Questions wait
(`enqueued`) and are put to an operator (`surfaced`) at most `asks_per_minute` in a rolling minute, the surest first.
A person confirms or declines; silence past the deadline, longer for a surer finding, is `expired`: forgotten without a
trace on the map, and not asked again for `ask_again_ms`. A decline makes an ignored item: whatever of its class
group lies near it stays quiet, and each such sighting is counted, so that people can see what is muted. What still
waits at the end of a flight is `withdrawn`; after an outage of which nobody knows how long it was, `expired`.

All sightings of one thing are one question: a map object of the same class group within `same_poi_mm` of a live
question joins it, and leaves it when it has moved away: a mute is a place's, so whoever walks past one is seen again
further on. It must never confirm by a score, never ask below `ask_confidence_e4`, and never ask twice at once
about one place.
"""

from __future__ import annotations

from dataclasses import dataclass

from statecharts.table import Chart, Row, ignore, move

LIVE = ("enqueued", "surfaced", "confirmed")
ENDED = ("suppressed", "confirmed", "declined", "expired", "withdrawn")


@dataclass(frozen=True, slots=True)
class Facts:
    """What the guards look at."""

    confirmed: bool = False


def confirmed(facts: Facts) -> bool:
    """A person said that it is real."""
    return facts.confirmed


def declined(facts: Facts) -> bool:
    """A person said that it is not."""
    return not facts.confirmed


def _ended(source: str) -> tuple[Row[Facts], ...]:
    return tuple(
        ignore(source, trigger, "it has ended")
        for trigger in ("may_ask", "judged", "muted", "time_passed", "time_lost", "flight_closed")
    )


CHART: Chart[Facts] = Chart(
    name="poi",
    initial="enqueued",
    states=("enqueued", "surfaced", *ENDED),
    terminal=ENDED,
    triggers=("may_ask", "judged", "muted", "time_passed", "time_lost", "flight_closed"),
    rows=(
        move("enqueued", "may_ask", "surfaced", "put to an operator"),
        ignore("enqueued", "judged", "only what was asked can be judged; the order was refused"),
        move("enqueued", "muted", "suppressed", "something like it was declined here"),
        move("enqueued", "time_passed", "expired", "waited too long to be asked"),
        move("enqueued", "time_lost", "expired", "off for an unknown time"),
        move("enqueued", "flight_closed", "withdrawn", "the flight ended"),
        ignore("surfaced", "may_ask", "asked already"),
        move("surfaced", "judged", "confirmed", "confirmed by a person", confirmed),
        move("surfaced", "judged", "declined", "declined by a person", declined),
        ignore("surfaced", "muted", "a person is looking at it: their word decides"),
        move("surfaced", "time_passed", "expired", "nobody decided in time"),
        move("surfaced", "time_lost", "expired", "off for an unknown time"),
        move("surfaced", "flight_closed", "withdrawn", "the flight ended"),
        *(row for state in ENDED for row in _ended(state)),
    ),
)
