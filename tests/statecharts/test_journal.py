"""What can be rolled back, against a plain dictionary that is copied."""

from __future__ import annotations

from unittest.mock import patch

from hypothesis import given, settings
from hypothesis import strategies as st

from statecharts import journal
from statecharts.journal import Journal, Keyed, Single
from tests.checks import check_equal

KEYS = st.sampled_from("abcde")
CHANGES = st.lists(
    st.one_of(
        st.tuples(st.just("put"), KEYS, st.integers(0, 9)),
        st.tuples(st.just("drop"), KEYS, st.just(0)),
        st.tuples(st.just("drop_where"), KEYS, st.integers(0, 9)),
        st.tuples(st.just("set"), KEYS, st.integers(0, 9)),
    )
)


class Pair:
    """A journalled table and value beside a plain model of both."""

    def __init__(self) -> None:
        self.journal = Journal()
        self.rows: Keyed[str, int] = Keyed(self.journal)
        self.value: Single[int] = Single(self.journal, -1)
        self.model: dict[str, int] = {}
        self.model_value = -1

    def change(self, verb: str, key: str, number: int) -> None:
        """Make the same change to both."""
        if verb == "put":
            self.rows.put(key, number)
            self.model[key] = number
        elif verb == "drop":
            self.rows.drop(key)
            self.model.pop(key, None)
        elif verb == "drop_where":
            self.rows.drop_where(lambda row: row > number)
            self.model = {key: row for key, row in self.model.items() if row <= number}
        else:
            self.value.set(number)
            self.model_value = number

    def check(self) -> None:
        """Check that both hold the same, in the order of keys."""
        rows = self.rows
        check_equal(list(rows.items()), sorted(self.model.items()))
        check_equal(list(rows.values()), [self.model[key] for key in sorted(self.model)])
        check_equal([rows.get(key) for key in "abcde"], [self.model.get(key) for key in "abcde"])
        check_equal((len(rows), rows.least()), (len(self.model), min(self.model.values(), default=None)))
        check_equal({key: rows[key] for key in "abcde" if key in rows}, self.model)
        check_equal(self.value.value, self.model_value)


@settings(max_examples=150, deadline=None)
@given(CHANGES, CHANGES, CHANGES)
def test_rolled_back_is_as_if_it_had_never_been(
    before: list[tuple[str, str, int]], between: list[tuple[str, str, int]], after: list[tuple[str, str, int]]
) -> None:
    """What was let stand stays, what came after it goes, and life goes on from there."""
    pair = Pair()
    for change in before:
        pair.change(*change)
    pair.journal.clear()
    kept, kept_value = dict(pair.model), pair.model_value
    for change in between:
        pair.change(*change)
        pair.check()
    pair.journal.rollback()
    pair.model, pair.model_value = kept, kept_value
    pair.check()
    pair.journal.rollback()
    pair.check()
    for change in after:
        pair.change(*change)
    pair.check()


@settings(max_examples=150, deadline=None)
@given(CHANGES, st.lists(st.tuples(CHANGES, st.booleans()), max_size=6), st.sampled_from([0, 3, 8192]))
def test_what_changed_is_known_and_what_it_was(
    before: list[tuple[str, str, int]], steps: list[tuple[list[tuple[str, str, int]], bool]], sort_at: int
) -> None:
    """Since it was asked for last, whatever was rolled back in between; and never a change that is not told."""
    pair = Pair()
    for change in before:
        pair.change(*change)
    pair.journal.watch()
    pair.journal.take()
    rows, value = dict(pair.model), pair.model_value
    with patch.object(journal, "SORT_AT", sort_at):
        for changes, undone in steps:
            pair.journal.clear()
            kept, kept_value = dict(pair.model), pair.model_value
            for change in changes:
                pair.change(*change)
            if undone:
                pair.journal.rollback()
                pair.model, pair.model_value = kept, kept_value
    told = pair.journal.take()
    for key in "abcde":
        was = told.get(pair.rows, {}).get(key, pair.rows.held(key))
        check_equal(was, rows.get(key, journal.ABSENT))
    check_equal(told.get(pair.value, {}).get(None, pair.value.value), value)
    check_equal(pair.journal.take(), {})
    kept, kept_value = dict(pair.model), pair.model_value
    for change in before:
        pair.change(*change)
    pair.journal.rollback()
    pair.model, pair.model_value = kept, kept_value
    pair.check()


def test_nobody_pays_who_does_not_watch() -> None:
    """Without a watcher nothing is kept beyond a step."""
    pair = Pair()
    pair.change("put", "a", 1)
    pair.journal.clear()
    check_equal(pair.journal.take(), {})
    pair.change("put", "a", 2)
    pair.journal.watch()
    pair.change("put", "a", 3)
    pair.journal.clear()
    check_equal(pair.journal.take(), {pair.rows: {"a": 2}})
