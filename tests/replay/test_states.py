"""The state's digest at checkpoints: one that differs is found, told once, and by the records between which it came."""

from __future__ import annotations

import base64

import pytest

from events.store import MemoryStore
from replay.states import stated
from replay.verdict import Outcome, Verdict
from replay.verify import verify
from statecharts import State, restore, steps_of
from statecharts.codec import LAYOUT
from statecharts.digest import digest_of
from tests.checks import check_equal
from tests.flights import FLIGHT_ID, SECRET, Flight, resealed, story
from tests.replay.changes import forged

STORY = story()


def note(store: MemoryStore, size: int, digest: bytes, layout: bytes = LAYOUT) -> str:
    """Return a checkpoint's note, whose signature nobody asks for here."""
    from events.tree import Tree

    root = base64.b64encode(Tree(one.leaf for one in store.stored(0, size)).root()).decode()
    return f"origin\n{size}\n{root}\nflight_ns 7\nstate {layout.hex()} {base64.b64encode(digest).decode()}\n\n— o x\n"


def sealed(wrong_at: int | None = None, layout: bytes = LAYOUT, flight: Flight = STORY) -> MemoryStore:
    """Return the story with a checkpoint after each step, of which one may name another state."""
    store, state, size = resealed(flight.records), State(), 0
    for recorded in steps_of(flight.records):
        restore(state, recorded)
        size += len(recorded)
        wrong = size == wrong_at
        store.add_checkpoint(size, note(store, size, bytes(32) if wrong else digest_of(state), layout))
    return store


def check_diverges(verdict: Verdict, seq: int, between: str, further: int = 0) -> None:
    """Check that a state's digest is what differs first."""
    assert verdict.first is not None
    first = verdict.first
    check_equal((verdict.outcome, first.seq, first.what, first.kind), (Outcome.DIVERGES, seq, "state digest", "state"))
    check_equal((first.field, first.causes, verdict.further), (between, (), further))


def test_states_that_are_the_signed_ones() -> None:
    """After every step of a flight."""
    verdict = verify(sealed())
    check_equal((verdict.outcome, verdict.records), (Outcome.IDENTICAL, len(STORY.records)))


@pytest.mark.parametrize("number", [0, 3, 20])
def test_a_state_that_is_not_the_signed_one(number: int) -> None:
    """The first is told, with what lay between it and the last that was equal."""
    sizes = [size for size, _ in sealed().checkpoints()]
    wrong, before = sizes[number], [0, *sizes][number]
    verdict = verify(sealed(wrong))
    check_diverges(verdict, wrong - 1, f"between records {before} and {wrong - 1}")
    assert verdict.first is not None
    check_equal(verdict.first.recorded, bytes(32).hex())
    check_equal("state digest: recorded 0000" in verdict.words(), True)


def test_a_state_of_another_layout_is_not_compared() -> None:
    """Nobody can tell whether it is the same."""
    size = sealed().checkpoints()[5][0]
    check_equal(verify(sealed(size)).outcome, Outcome.DIVERGES)
    check_equal(verify(sealed(size, bytes(4))).outcome, Outcome.IDENTICAL)


def test_a_difference_that_stays_is_told_once() -> None:
    """What is wrong once is wrong at every checkpoint that follows."""
    store = sealed()
    sizes = [size for size, _ in store.checkpoints()][5:]
    for size in sizes:
        store.add_checkpoint(size, note(store, size, bytes(32)))
    check_diverges(verify(store), sizes[0] - 1, f"between records {store.checkpoints()[4][0]} and {sizes[0] - 1}")


def test_a_forged_decision_comes_first() -> None:
    """The state goes on from what was recorded, so it is the one that was signed, or the second thing to tell."""
    flight = Flight()
    flight.records = forged(STORY, 22, because="forged")
    verdict = verify(sealed(flight=flight))
    assert verdict.first is not None
    check_equal((verdict.outcome, verdict.first.what, verdict.further), (Outcome.DIVERGES, "field", 0))
    store = sealed(flight=flight)
    size = len(STORY.records)
    store.add_checkpoint(size, note(store, size, bytes(32)))
    verdict = verify(store)
    assert verdict.first is not None
    check_equal((verdict.first.what, verdict.further), ("field", 1))


@pytest.mark.parametrize(
    "line",
    ["", "state", "state 00", "other 00000000 AAAA", "state zz AAAA", "state 00000000 A", "state 00000000 AAAA x"],
)
def test_notes_that_name_no_state(line: str) -> None:
    """Of an older version, or written otherwise."""
    check_equal(stated(f"origin\n1\nroot\nflight_ns 7\n{line}\n\n— o x\n"), None)
    check_equal(stated("nothing"), None)


def test_the_secret_is_the_flights() -> None:
    """What these tests reseal is the story itself."""
    check_equal(resealed(STORY.records).head, story(MemoryStore(FLIGHT_ID, SECRET)).store.head)
