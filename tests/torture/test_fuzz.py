"""A seeded sample of the fuzz, and that it would find something; the full count is an area of `tests.torture`."""

from __future__ import annotations

import tracemalloc
from random import Random

import pytest

from autopilot.wire.keys import presence_key
from tests.autopilot.trust.world import people
from tests.torture import fuzz_presence
from tests.torture.fuzz import Fuzz, Share, located, share_of
from tests.torture.fuzzing import INSIDERS, OUTSIDERS, Case, insider, originals, outsider, splices


@pytest.mark.parametrize("seed", range(3))
def test_a_sample_of_forged_and_of_signed_samples(seed: int) -> None:
    """None is believed, each signed one ends where it must, nothing escapes, the tables stay bounded."""
    found = share_of(Share(seed, outsiders=4000, insiders=1500))
    assert sum(found.verdicts.values()) == 162 + 4000 + 1500
    assert found.verdicts["internal"] == 0
    assert found.verdicts["opened"] > 100
    assert found.verdicts["malformed"] > 200
    assert set(found.believed) == {
        *("splice", "good", "unknown variant", "bodies", "out of range", "identifiers", "contents"),
    }
    assert (found.believed["splice"], found.believed["good"]) == (3, found.kinds["good"])
    assert {name for name, _ in (*OUTSIDERS, *INSIDERS)} | {"splice"} == set(found.kinds)


def test_of_all_splices_only_the_whole_envelopes_are_believed() -> None:
    """162 combinations of header, token, ciphertext and signature, on two keys."""
    fuzz = Fuzz(0)
    opened: set[bytes] = set()
    for case in splices():
        fuzz.check(case, "splices")
        opened |= {case.payload} if fuzz.gate.tally().opened > len(opened) else set()
    assert (fuzz.gate.tally().received, opened) == (162, set(originals()))


def test_forgeries_leave_no_memory_behind() -> None:
    """Not a byte for each: what is held after five thousand is what was held after one thousand."""
    fuzz, random = Fuzz(5), Random(5)
    for number in range(1000):
        fuzz.check(outsider(random), str(number))
    cases = [outsider(random) for _ in range(5000)]
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    for case in cases:
        fuzz.gate.judge(case.key_expr, case.payload)
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert after - before < 20_000
    fuzz.check_untouched()


@pytest.mark.parametrize("seed", range(2))
def test_a_sample_of_presence_that_was_changed_and_that_was_signed(seed: int) -> None:
    """Nobody without a key is heard; what a member signs is counted; the good ones that were changed are heard."""
    counts = fuzz_presence.share(seed, outsiders=1500, insiders=400)
    assert counts["presence: unreadable"] > 200
    assert counts["presence: device_sig"] > 20
    listening = fuzz_presence.Listening(seed)
    for payload, who in zip(fuzz_presence.originals(), ("alice", "bob"), strict=True):
        listening.throw(payload, presence_key("wasp-01", who))
    assert (listening.told, listening.counts().total()) == (2, 0)


def test_it_is_the_same_every_time() -> None:
    made = [[outsider(random).payload for _ in range(50)] for random in (Random(3), Random(3))]
    assert made[0] == made[1]
    signed = [
        [insider(random, number + 1, 10**12).payload for number in range(50)] for random in (Random(3), Random(3))
    ]
    assert signed[0] == signed[1]


@pytest.mark.parametrize(
    ("payload", "expected", "said"),
    [(originals()[0], ("",), "opened"), (b"", ("opened",), "size"), (originals()[0], ("malformed",), "opened")],
)
def test_a_verdict_that_must_not_be_is_found(payload: bytes, expected: tuple[str, ...], said: str) -> None:
    with pytest.raises(AssertionError, match=f"here: made up: {said}, not"):
        Fuzz(1).check(Case("made up", payload, expected), "here")


def test_a_defect_is_found_and_is_no_rejection() -> None:
    """`internal` is a finding, also where any rejection would do; so is a message that is counted twice."""
    fuzz = Fuzz(1)
    fuzz.gate._reader = lambda _message, content: int(content)  # type: ignore[assignment, return-value]
    with pytest.raises(AssertionError, match="internal"):
        fuzz.check(Case("made up", originals()[0]), "here")
    fuzz = Fuzz(1)
    fuzz.gate._tally.received += 1
    with pytest.raises(AssertionError, match="here"):
        fuzz.check(Case("made up", b"", ("size",)), "here")


def test_a_table_that_grows_is_found() -> None:
    fuzz = Fuzz(1)
    fuzz.gate._window.insert(b"device", b"nonce", 10**15)
    with pytest.raises(AssertionError):
        fuzz.check_untouched()
    for number in range(300):
        fuzz.gate._window.insert(b"device", number.to_bytes(8, "big"), 10**15)
    with pytest.raises(AssertionError):
        fuzz.check_bounded()
    with pytest.raises(AssertionError, match="bytes more"):
        fuzz.found(5_000_000)


def test_a_cache_that_grows_is_found() -> None:
    fuzz = Fuzz(1)
    fuzz.check(Case("good", originals()[0], ("opened",)), "here")
    fuzz.forget()
    token = people().alice.token
    for number in range(4):
        fuzz.gate._tokens[number.to_bytes(32, "big")] = token
    for check in (fuzz.check_untouched, fuzz.check_bounded):
        with pytest.raises(AssertionError):
            check()


def test_a_sample_that_is_counted_twice_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    fuzz = Fuzz(1)
    judge = fuzz.gate.judge
    monkeypatch.setattr(fuzz.gate, "judge", lambda key, payload: (judge(key, payload), judge(key, payload))[1])
    with pytest.raises(AssertionError, match="here"):
        fuzz.check(Case("made up", b"", ("size",)), "here")


@pytest.mark.parametrize("place", [(900_000_001, 0), (-900_000_001, 0), (0, 1_800_000_001), (0, -1_800_000_001)])
def test_a_place_outside_this_world_is_found(place: tuple[int, int]) -> None:
    with pytest.raises(AssertionError):
        located(*place, 0)
    assert located(900_000_000, -1_800_000_000, 1).altitude_mm == 1
