"""Fuzz of the gate: envelopes that somebody without a key changed, and ones that a member signed, malformed.

Nothing that was changed is believed, every signed one ends in the counter that it must, no exception escapes and none
is `internal`, every sample is counted once, and neither memory nor a table grows.
"""

from __future__ import annotations

import gc
import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from multiprocessing import get_context
from random import Random
from typing import Any, NamedTuple

import psutil

from autopilot.adapters.mesh.orders import Order, read_order
from autopilot.trust import limits
from autopilot.trust.envelope import MessageType
from autopilot.trust.gate import Gate
from autopilot.trust.verdict import Malformed, Opened, Rejected
from events.schema.common_pb2 import Place
from tests.autopilot.trust.world import ISSUERS, KEY, FakeClock, people
from tests.torture.fuzz_presence import share
from tests.torture.fuzzing import ANY_REJECTION, ELSEWHERE, MALFORMED, OPENED, Case, insider, outsider, splices
from tests.torture.fuzzing import OUTSIDERS as CHANGED

OUTSIDERS, INSIDERS = 1_000_000, 200_000
SHARES = 20  # each has a gate of its own, and a seed
PRESENCE_SHARE = 20  # one of so many samples more is thrown at the door for presence
STEP_MS = 100  # between two signed samples, so that the window forgets
GROWTH_BYTES_MAX = 4_000_000  # of one process over a whole share, after its first tenth; an allocator's slack
Report = Callable[[str], None]


class Share(NamedTuple):
    """What one process is asked."""

    seed: int
    outsiders: int
    insiders: int


class Found(NamedTuple):
    """What came of it."""

    kinds: Counter[str]
    verdicts: Counter[str]
    believed: Counter[str]  # opened or malformed, by kind
    grown_bytes: int
    tokens: int
    nonces: int


def run(count: int | None, seed: int, report: Report) -> dict[str, Any]:
    """Try `count` samples, a fifth of them signed; the full count for None. Raises AssertionError."""
    outsiders, insiders = (OUTSIDERS, INSIDERS) if count is None else (count * 5 // 6, count // 6)
    shares = [Share(seed * SHARES + number, outsiders // SHARES, insiders // SHARES) for number in range(SHARES)]
    kinds, verdicts, believed = Counter[str](), Counter[str](), Counter[str]()
    grown: list[int] = []
    for number, found in enumerate(_mapped(shares, count), start=1):
        kinds, verdicts, believed = kinds + found.kinds, verdicts + found.verdicts, believed + found.believed
        grown.append(found.grown_bytes)
        report(f"share {number} of {SHARES}: {found.grown_bytes} bytes more")
    present = outsiders // PRESENCE_SHARE, insiders // PRESENCE_SHARE
    presence = share(seed, *present)
    return {
        "presence": {"unauthenticated": present[0], "signed": present[1], "rejected": dict(sorted(presence.items()))},
        "unauthenticated": len(splices()) * SHARES + sum(share.outsiders for share in shares),
        "signed": sum(share.insiders for share in shares),
        "unauthenticated_believed": sum(believed[name] for name in dict(CHANGED)),
        "internal": verdicts["internal"],
        "grown_bytes_max": max(grown),
        "kinds": dict(sorted(kinds.items())),
        "believed": dict(sorted(believed.items())),
        "verdicts": dict(sorted(verdicts.items())),
    }


def _mapped(shares: Iterable[Share], count: int | None) -> Iterator[Found]:
    if count is not None:
        yield from map(share_of, shares)
        return
    with get_context("spawn").Pool(os.cpu_count() or 1) as pool:
        yield from pool.imap(share_of, shares)


def share_of(asked: Share) -> Found:
    """Run one share. Raises AssertionError naming the first sample that did what it must not."""
    fuzz = Fuzz(asked.seed)
    for case in splices():
        fuzz.check(case, f"seed {asked.seed}")
    fuzz.forget()
    before_bytes = 0
    for number in range(asked.outsiders):
        if number == asked.outsiders // 10:
            before_bytes = _rss_bytes()
        fuzz.check(outsider(fuzz.random), f"seed {asked.seed}, outsider {number}")
    fuzz.check_untouched()
    for number in range(asked.insiders):
        fuzz.clock.now_ms += STEP_MS
        case = insider(fuzz.random, number + 10, fuzz.clock.now_ms)
        fuzz.check(case, f"seed {asked.seed}, insider {number}")
    fuzz.check_bounded()
    return fuzz.found(_rss_bytes() - before_bytes)


class Fuzz:
    """A node's gate with the node's own reader, and what it said."""

    def __init__(self, seed: int) -> None:
        self.random, self.clock = Random(seed), FakeClock()
        self._kinds, self._verdicts, self._believed = Counter[str](), Counter[str](), Counter[str]()
        self.gate = self._fresh()

    def _fresh(self) -> Gate[Order]:
        return Gate(
            people().wasp,
            MessageType.ORDER,
            kinds=ISSUERS,
            is_ours=lambda key: key in (KEY, ELSEWHERE),
            reader=lambda message, content: read_order(message, content, located),
            clock=self.clock,
            samples_per_s=1e9,
            samples_burst=1_000_000_000,
        )

    def forget(self) -> None:
        """Take a gate that has seen nothing."""
        self.gate = self._fresh()

    def check(self, case: Case, where: str) -> None:
        """Judge one sample: its verdict is one that it may have, and it is counted once."""
        before = self.gate.tally()
        verdict = self.gate.judge(case.key_expr, case.payload)
        said = _word(verdict)
        rejected = said not in (OPENED, MALFORMED, "internal")
        fits = said in case.expected or (ANY_REJECTION in case.expected and rejected)
        assert fits, f"{where}: {case.kind}: {said}, not {case.expected}: {case.payload.hex()}"
        after = self.gate.tally()
        assert after.balances(), where
        assert after.received == before.received + 1, where
        self._kinds[case.kind] += 1
        self._verdicts[said] += 1
        self._believed[case.kind] += said in (OPENED, MALFORMED)

    def check_untouched(self) -> None:
        """Nothing that was not authenticated is remembered; a true token may be, for it is the Directory's word."""
        assert len(self.gate._window) == 0
        assert len(self.gate._tokens) <= 2

    def check_bounded(self) -> None:
        """The tables hold what is alive, and no more."""
        alive = (10_000 + 2 * limits.SKEW_MS) // STEP_MS + 1
        assert len(self.gate._window) <= alive
        assert len(self.gate._tokens) <= 3

    def found(self, grown_bytes: int) -> Found:
        """Return what came of the share; memory must not have grown."""
        assert grown_bytes <= GROWTH_BYTES_MAX, f"{grown_bytes} bytes more"
        return Found(
            self._kinds, self._verdicts, +self._believed, grown_bytes, len(self.gate._tokens), len(self.gate._window)
        )


def _word(verdict: Opened[Order] | Malformed | Rejected) -> str:
    match verdict:
        case Rejected(reason):
            return reason
        case Malformed():
            return MALFORMED
        case Opened():
            return OPENED


def located(latitude_e7: int, longitude_e7: int, altitude_mm: int) -> Place:
    """Return a place, and insist that the reader lets only places of this world through."""
    assert abs(latitude_e7) <= 900_000_000
    assert abs(longitude_e7) <= 1_800_000_000
    return Place(latitude_e7=latitude_e7, longitude_e7=longitude_e7, altitude_mm=altitude_mm)


def _rss_bytes() -> int:
    gc.collect()
    return int(psutil.Process().memory_info().rss)
