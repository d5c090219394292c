"""The digest of the state: followed row by row it is what it is from scratch, also after what was rolled back."""

from __future__ import annotations

from hashlib import sha256, shake_128
from unittest.mock import patch

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from statecharts import State, journal, restore, step, steps_of
from statecharts.codec import COLUMNS, encode
from statecharts.digest import Rows, StateDigest, combined, digest_of, rows_of, sums_of
from statecharts.snapshot import merge_into
from tests.checks import check_equal
from tests.flights import Flight, position, story
from tests.random_flights import Draw, draws, fly


def check_followed(state: State, digest: StateDigest, known: Rows) -> None:
    """Check a digest that was followed, and the rows that it told of, against the whole state."""
    merge_into(known, digest.advance())
    check_equal(digest.value, digest_of(state))
    check_equal(digest.sums, sums_of(rows_of(state)))
    present = {name: {key: row for key, row in table.items() if row} for name, table in known.items()}
    check_equal(
        {name: table for name, table in present.items() if table}, {k: v for k, v in rows_of(state).items() if v}
    )


@settings(max_examples=40, deadline=None)
@given(draws, st.lists(st.integers(0, 3), min_size=200, max_size=200), st.sampled_from([0, 5, 8192]))
def test_followed_is_from_scratch(drawn: list[Draw], luck: list[int], sort_at: int) -> None:
    """Steps are taken, undone, taken back and applied again; now and then somebody asks."""
    state, known = State(), Rows()
    digest = StateDigest(state)
    with patch.object(journal, "SORT_AT", sort_at):
        for recorded, chance in zip(steps_of(fly(drawn).records), luck, strict=False):
            if chance == 0:
                step(state, recorded[0])
                state.journal.rollback()
            restore(state, recorded)
            if chance > 1:
                check_followed(state, digest, known)
    check_followed(state, digest, known)


def test_it_may_begin_anywhere() -> None:
    """With a state that is there already, whose rows are then told once."""
    flight = story()
    half = list(steps_of(flight.records))[: len(flight.records) // 4]
    state, known = State(), Rows()
    for recorded in half:
        restore(state, recorded)
    digest = StateDigest(state)
    check_equal(digest.value, digest_of(state))
    check_followed(state, digest, known)
    for recorded in list(steps_of(flight.records))[len(half) :]:
        restore(state, recorded)
    check_followed(state, digest, known)
    check_equal(digest.advance(), {})
    check_equal(digest_of(state), digest_of(flight.state))


def test_a_second_one_takes_over() -> None:
    """What the first was not asked for any more does not count twice."""
    flight = Flight()
    StateDigest(flight.state)
    flight.tell(position(1, 1))
    digest = StateDigest(flight.state)
    flight.tell(position(2, 2))
    digest.advance()
    check_equal(digest.value, digest_of(flight.state))


def test_with_sums_that_are_known_nothing_is_told_twice() -> None:
    """As after a start from a snapshot."""
    flight = story()
    digest = StateDigest(flight.state, sums_of(rows_of(flight.state)))
    check_equal((digest.advance(), digest.value), ({}, digest_of(flight.state)))


@pytest.mark.parametrize("column", [column.name for column in COLUMNS])
def test_every_table_counts(column: str) -> None:
    """Without any one of its rows, or with one more, the digest is another."""
    state = story().state
    before, table = digest_of(state), getattr(state, column)
    rows = rows_of(state)
    rows[column] = {**rows[column], b"k": b"r"}
    check_equal(combined(sums_of(rows)) == before, False)
    del rows[column]
    check_equal((combined(sums_of(rows)) == before), not table.whole())


def test_it_is_what_the_specification_says() -> None:
    """Computed once more, from docs/proof.md alone."""
    state = story().state
    whole = sha256()
    for name in sorted(set(State.__slots__) - {"journal", "grid"}):
        total = 0
        for key, row in getattr(state, name).whole().items():
            data = encode(key)
            text = name.encode() + b"\0" + len(data).to_bytes(4, "big") + data + encode(row)
            total += int.from_bytes(shake_128(text).digest(512), "big")
        whole.update(name.encode() + b"\0" + (total % (1 << 4096)).to_bytes(512, "big"))
    check_equal(digest_of(state), whole.digest())
