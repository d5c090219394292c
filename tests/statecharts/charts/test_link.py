"""Chart `link`: silence of the operators, to the millisecond."""

from __future__ import annotations

import pytest

from statecharts.facts import Scan
from tests.checks import check_chart, check_equal
from tests.stories import Story
from tests.stories_of_safety import SAFE_LIMITS


def flight(**changes: object) -> Story:
    """Return an armed flight whose link is watched, and in which nothing follows from it."""
    story = Story(**SAFE_LIMITS | changes)
    story.tell("vehicle down")
    return story


def following(story: Story, state: str = "following") -> None:
    """Let the camera be in a state of the chart `scan`."""
    story.flight.state.scans.put("1/1", Scan(state=state))


def test_silence_leads_down_and_a_word_leads_back() -> None:
    """5 s are degraded, 30 s are lost; whoever is heard makes it good."""
    check_chart(
        "link",
        """
        at_s   | observe      | state                | why
        1      | heard alpha  | operators ok         | an operator is heard
        4      | heard bravo  | -                    | -
        8.999  | spot 0,0       | -                    | -
        9      | time         | operators degraded   | nobody is heard for a while
        10     | heard alpha  | operators ok         | an operator is heard
        15     | time         | operators degraded   | nobody is heard for a while
        39.999 | spot 0,0       | -                    | -
        40     | time         | operators lost       | nobody is heard any more
        90     | spot 0,0       | -                    | -
        100    | heard alpha  | operators ok         | an operator is heard again
        """,
        flight(),
    )


def test_what_is_followed_gets_a_grace() -> None:
    """30 s more, but not longer than something is followed, and a word leads back from it."""
    table = """
        at_s   | observe      | state
        0      | heard alpha  | operators ok
        5      | time         | operators degraded
        30     | time         | operators lost_following
        59.999 | spot 0,0       | -
        60     | time         | operators lost
        """
    story = flight()
    following(story)
    check_chart("link", table, story)
    story = flight()
    following(story)
    head, *lines = table.strip().splitlines()
    check_chart("link", "\n".join([head, *lines[:4]]), story)
    following(story, "zoomed_out")
    check_chart("link", "at_s | observe | state\n59.999 | spot 0,0 | operators lost", story)
    story = flight()
    following(story)
    check_chart("link", "\n".join([head, *lines[:3], "31 | heard alpha | operators ok"]), story)


def test_an_order_is_a_word_too() -> None:
    """Also one that is refused or can't be read."""
    for words in ("order a point", "order a point roles=viewer", "malformed a"):
        check_chart(
            "link", f"at_s | observe | state\n3 | {words} | operators ok\n8 | time | operators degraded", flight()
        )


def test_nobody_was_ever_heard() -> None:
    """On the ground that is normal; in the air silence counts from arming, and no longer after landing."""
    story = flight()
    check_chart(
        "link",
        """
        at_s | observe  | state
        1    | grounded | -
        50   | spot 0,0   | -
        60   | flies    | -
        62   | flies    | -
        65   | time     | operators degraded
        90   | time     | operators lost
        95   | grounded | operators unheard
        200  | flies    | -
        203  | grounded | -
        210  | flies    | -
        215  | time     | operators degraded
        216  | grounded | operators unheard
        300  | spot 0,0   | -
        301  | heard a  | operators ok
        302  | grounded | -
        306  | time     | operators degraded
        """,
        story,
    )


def test_a_shell_that_is_late_skips_states() -> None:
    """How long the silence is decides, not how often it was looked at."""
    story = flight()
    story.tell("heard alpha")
    story.at(31_000)
    check_equal([getattr(one.message, "to_state", "") for one in story.tell("time")][:2], ["", "lost"])
    story = flight()
    following(story)
    story.tell("heard alpha")
    story.at(31_000)
    check_equal([getattr(one.message, "to_state", "") for one in story.tell("time")][:2], ["", "lost_following"])


@pytest.mark.parametrize(
    ("before", "state"),
    [
        (("heard a",), "operators lost"),
        (("flies",), "operators lost"),
        (("grounded",), "-"),
        (("heard a", "grounded"), "operators lost"),
    ],
)
def test_an_unknown_outage_is_silence(before: tuple[str, ...], state: str) -> None:
    """What nobody knows the length of counts as too long; a short one that is known counts as it is."""
    story = flight()
    for words in before:
        story.tell(words)
    check_chart(
        "link", f"at_s | observe | state\n0 | start | -\n0 | start no clock | {state}\n0 | start no clock | -", story
    )


def test_a_known_outage_counts_as_silence() -> None:
    """Flight time goes on over it."""
    story = flight()
    story.tell("heard a")
    story.at(40_000)
    story.tell("start")
    check_equal(story.flight.due, 5_000_000_000)
    check_equal([getattr(one.message, "to_state", "") for one in story.tell("time")][1], "lost")


@pytest.mark.parametrize("changes", [{"operator_lost_ms": 0}, {"flight_enabled": False}])
def test_nothing_is_watched_where_nothing_is_configured(changes: dict[str, object]) -> None:
    """As in every log from before this chart, and where nothing would follow from it."""
    story = flight(**changes)
    check_chart(
        "link",
        """
        at_s | observe        | state
        0    | heard a        | -
        0    | grounded       | -
        50   | flies          | -
        50   | start no clock | -
        90   | order a turn   | -
        """,
        story,
    )
    check_equal((len(story.flight.state.links), story.flight.state.deadlines.get(("link", "operators"))), (0, None))
