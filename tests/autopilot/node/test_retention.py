"""What may be deleted, when, and that what was not pushed never is."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.node.retention import Candidate, Policy, plan

MIB = 1 << 20
POLICY = Policy(keep_newest=2, keep_ms=1_000, min_free_bytes=100 * MIB)
NOW_MS = 10_000
OLD, YOUNG = NOW_MS - 1_000, NOW_MS - 999


def flights(*words: str) -> list[Candidate]:
    """Return flights of 30 MiB from words such as "old pushed", "young", "open", in their order."""
    return [
        Candidate(number, "open" not in word, "pushed" in word, YOUNG if "young" in word else OLD, 30 * MIB)
        for number, word in enumerate(words, start=1)
    ]


KEPT = ("young", "young", "open")  # the two newest closed ones, and the open one


@pytest.mark.parametrize(
    ("words", "free_mib", "delete", "short"),
    [
        (("old pushed", "young pushed", "old", *KEPT), 100, (1,), ""),
        (("old pushed", "young pushed", "old", *KEPT), 40, (1, 2), ""),
        (("young pushed", "young pushed", *KEPT), 70, (1,), ""),
        (("young pushed", "young pushed", *KEPT), 99, (1,), ""),
        (("young pushed", "young pushed", *KEPT), 69, (1, 2), ""),
        (("young pushed", "old pushed", "young pushed", *KEPT), 69, (1, 2), ""),
        (("old", "old", *KEPT), 100, (), ""),
        (("old", "old pushed", *KEPT), 0, (2,), "30 MiB of the disk are free, 100 are wanted: 1 flights (30 MiB) wait"),
        (("old pushed", *KEPT), 0, (1,), "30 MiB of the disk are free, 100 are wanted: no flight may be deleted"),
        (("old pushed", "old pushed", "open"), 0, (), "0 MiB of the disk are free"),
        (("old pushed", "old pushed open", "old", "old", "open"), 500, (1,), ""),
        (("old pushed", "old pushed", "old pushed", "open"), 500, (1,), ""),
        (("open",), 500, (), ""),
        ((), 500, (), ""),
    ],
)
def test_what_goes(words: tuple[str, ...], free_mib: int, delete: tuple[int, ...], short: str) -> None:
    """Old and pushed goes; young and pushed only while the disk is short, the oldest first; nothing else ever."""
    found = plan(flights(*words), POLICY, now_ms=NOW_MS, free_bytes=free_mib * MIB)
    assert found.delete == delete
    assert found.short.startswith(short)
    assert bool(found.short) == bool(short)


def test_flights_may_come_in_any_order() -> None:
    """Numbers say which is older."""
    given_ = flights("old pushed", "old pushed", *KEPT)
    found = plan(given_[::-1], POLICY, now_ms=NOW_MS, free_bytes=500 * MIB)
    assert found.delete == (1, 2)


candidates = st.lists(
    st.tuples(st.booleans(), st.booleans(), st.integers(0, 2 * NOW_MS), st.integers(0, 90 * MIB)), max_size=9
)


@given(candidates, st.integers(0, 4), st.integers(0, 200 * MIB))
def test_whatever_there_is(drawn: list[tuple[bool, bool, int, int]], keep_newest: int, free: int) -> None:
    """Closed, pushed, and behind at least the newest closed one; and it says so where the disk stays short."""
    given_ = [Candidate(number, *one) for number, one in enumerate(drawn, start=1)]
    found = plan(given_, POLICY._replace(keep_newest=keep_newest), now_ms=NOW_MS, free_bytes=free)
    gone = [one for one in given_ if one.number in found.delete]
    assert all(one.closed and one.pushed for one in gone)
    newest = [one.number for one in given_ if one.closed][-max(keep_newest, 1) :]
    assert not {one.number for one in gone} & set(newest)
    after = free + sum(one.size_bytes for one in gone)
    assert bool(found.short) == (after < POLICY.min_free_bytes)
    old = [one.ended_ms + POLICY.keep_ms <= NOW_MS for one in gone]
    assert all(old) or free + sum(one.size_bytes for one in gone if one.ended_ms + POLICY.keep_ms <= NOW_MS) < (
        POLICY.min_free_bytes
    )
