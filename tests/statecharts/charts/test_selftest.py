"""The chart `selftest` as tables: no pass by silence, and one report's acknowledgement serves no other."""

from __future__ import annotations

import pytest

from statecharts.charts.selftest import CHART
from tests import flying
from tests.checks import check_chart, check_equal, check_exactly_one_row
from tests.stories import Story


def story(**changes: object) -> Story:
    """Return a story that begins on the ground, with a mission to fly."""
    return Story(*flying.opening(**changes))


def test_all_pass_and_that_stays() -> None:
    """A second plan, a late report and a restart change nothing; what is skipped does not count."""
    check_chart(
        "selftest",
        """
        at_s | observe             | state     | say  | why
        0    | planned             | 1 running | test | there is a mission: is this node fit to fly it?
        1    | planned rev=b       | -         | -    | -
        2    | report pass,skipped | 1 passed  | -    | all items pass
        3    | planned rev=c       | -         | -    | -
        4    | report fail         | -         | -    | -
        5    | start               | -         | -    | -
        6    | start unknown       | -         | -    | -
        """,
        story(),
    )


@pytest.mark.parametrize(
    ("words", "state", "why"),
    [
        ("pass,fail,degraded", "1 failed", "an item failed"),
        ("pass,degraded", "1 awaiting", "degraded: a person has to take it on"),
        ("", "1 failed", "an item failed"),
    ],
)
def test_what_a_report_comes_to(words: str, state: str, why: str) -> None:
    """One failed item is enough, a degraded one asks for a person, and a report without items is none."""
    check_chart(
        "selftest",
        f"""
        at_s | observe        | state     | why
        0    | planned        | 1 running | there is a mission: is this node fit to fly it?
        1    | report {words} | {state}   | {why}
        """,
        story(),
    )


def test_only_the_newest_report_counts() -> None:
    """A start runs the test anew; the report of the run before is of no use, also when it passes."""
    tale = check_chart(
        "selftest",
        """
        at_s | observe | state     | say  | why
        0    | planned | 1 running | test | there is a mission: is this node fit to fly it?
        1    | start   | 1 running | test | started again: tested again
        """,
        story(),
    )
    first = next(record.seq for record in tale.flight.records if record.kind.name == "run_selftest")
    check_chart(
        "selftest",
        f"""
        at_s | observe           | state    | why
        2    | report-of {first} | -        | -
        3    | report pass       | 1 passed | all items pass
        """,
        tale,
    )


def test_a_person_takes_it_on() -> None:
    """Only with this report's number, with a role of the flight, and before the time is over."""
    tale = check_chart(
        "selftest",
        """
        at_s | observe         | state      | why
        0    | planned         | 1 running  | there is a mission: is this node fit to fly it?
        1    | report degraded | 1 awaiting | degraded: a person has to take it on
        2    | order z acknowledge 3 | -    | -
        """,
        story(),
    )
    report = tale.flight.state.selftests[1].effect_seq
    check_chart(
        "selftest",
        f"""
        at_s | observe                                 | state    | why
        3    | order a acknowledge {report} by=c roles=camera | -        | -
        4    | order b acknowledge {report}                 | 1 passed | a person took it on
        """,
        tale,
    )
    check_equal(
        [tale.flight.state.orders[f"{who}/{name}"].state for who, name in (("alpha", "z"), ("c", "a"))],
        ["rejected", "unauthorised"],
    )


def test_nobody_takes_it_on() -> None:
    """Silence for its time is a failure; a person who asks again has it tested again."""
    check_chart(
        "selftest",
        """
        at_s | observe         | state      | say  | why
        0    | planned         | 1 running  | test | there is a mission: is this node fit to fly it?
        1    | report degraded | 1 awaiting | -    | degraded: a person has to take it on
        121  | time            | 1 failed   | -    | nobody took it on in time
        130  | order a begin   | 1 running  | test | a person asks again: tested again
        140  | time            | 1 failed   | -    | no report came
        141  | planned rev=b   | 1 running  | test | another plan: tested again
        142  | report pass     | 1 passed   | -    | all items pass
        """,
        story(),
    )


def test_time_that_nobody_knows_is_over() -> None:
    """After an outage that can't be measured the time to take it on has passed; after a known one it goes on."""
    check_chart(
        "selftest",
        """
        at_s | observe         | state      | why
        0    | planned         | 1 running  | there is a mission: is this node fit to fly it?
        1    | report degraded | 1 awaiting | degraded: a person has to take it on
        2    | start           | -          | -
        3    | start no clock  | 1 failed   | off for an unknown time: the time to take it on is over
        """,
        story(),
    )


def test_a_node_that_flies_no_missions_tests_nothing() -> None:
    """Also when a plan comes."""
    check_chart(
        "selftest",
        """
        at_s | observe | state | say
        0    | planned | -     | -
        """,
        story(mission_enabled=False),
    )


def test_exactly_one_row() -> None:
    """Whatever the guards say."""
    check_exactly_one_row(CHART)
