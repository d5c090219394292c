"""Mutants of the gate: each check of what judges a message removed, negated, moved by one; a test must fail each time.

    run(None, seed=1, report=print)     every mutant; a count is that many, by seed

The result lists every mutant with the test that caught it. A mutant that changes nothing that can be seen is named in
EQUIVALENT, with the reason.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from random import Random
from typing import Any

from tests.house import REPO
from tests.torture.mutating import Mutant, mutants

# What judges a message, and of the files that do more, the functions that take part in it.
MODULES: dict[str, frozenset[str] | None] = {
    "autopilot.trust.gate": None,
    "autopilot.trust.keyless": None,
    "autopilot.trust.window": None,
    "autopilot.trust.documents": None,
    "autopilot.trust.envelope": frozenset(
        {"open_sealed", "ciphertext_limit", "envelope_limit", "sealing_key", "signature_input"}
    ),
    "autopilot.trust.keys": frozenset({"verify", "BoxKey.open"}),
    "autopilot.trust.pae": None,
    "autopilot.trust.tally": None,
}
TESTS = (
    "tests/autopilot/trust/test_gate.py",
    "tests/autopilot/trust/test_gate_bounds.py",
    "tests/autopilot/trust/test_gate_believing.py",
    "tests/autopilot/trust/test_keyless.py",
    "tests/autopilot/trust/test_keyless_bounds.py",
    "tests/autopilot/trust/test_documents.py",
    "tests/autopilot/trust/test_vectors_gate.py",
    "tests/autopilot/trust/test_identity.py",
    "tests/autopilot/trust/test_envelope.py",
    "tests/autopilot/trust/test_primitives.py",
)
EQUIVALENT: dict[str, str] = {
    "autopilot.trust.envelope.open_sealed: len(ciphertext) <= limits.TAG_BYTES or len(nonce) != limits.NONCE_BYTES: "
    "without len(nonce) != limits.NONCE_BYTES": "the bindings refuse another nonce themselves, with a CryptoError",
}


def all_mutants() -> list[Mutant]:
    """Return every mutant but those that change nothing."""
    made = [mutant for module, only in MODULES.items() for mutant in numbered(mutants(module, only))]
    return [mutant for mutant in made if mutant.name not in EQUIVALENT]


def numbered(made: Sequence[Mutant]) -> Iterator[Mutant]:
    """Tell mutants of the same change apart, by their number in the function."""
    seen = Counter[str]()
    for mutant in made:
        seen[mutant.name] += 1
        before = seen[mutant.name]
        yield mutant if before == 1 else replace(mutant, change=f"{mutant.change} ({before})")


def run(count: int | None, seed: int, report: Callable[[str], None]) -> dict[str, Any]:
    """Try `count` mutants, all of them for None. Raises AssertionError where one survives."""
    chosen = all_mutants()
    if count is not None:
        chosen = Random(seed).sample(chosen, min(count, len(chosen)))
    assert caught([None]) == [""], "the tests fail without a mutant"
    report(f"{len(chosen)} mutants")
    found = caught(chosen)
    survived = [mutant.name for mutant, by in zip(chosen, found, strict=True) if not by]
    for name in survived:
        report(f"survived: {name}")
    assert not survived, f"{len(survived)} of {len(chosen)} mutants survived"
    return {
        "mutants": len(chosen),
        "survived": 0,
        "equivalent": EQUIVALENT,
        "caught_by": {mutant.name: by for mutant, by in zip(chosen, found, strict=True)},
    }


def caught(asked: Sequence[Mutant | None], jobs: int | None = None) -> list[str]:
    """Return for each mutant the test that caught it, "" where none did."""
    jobs = jobs or os.cpu_count() or 1
    shares = [range(start, len(asked), jobs) for start in range(jobs)]
    with ThreadPoolExecutor(jobs) as pool:
        answers = dict(pair for share in pool.map(lambda share: list(_worker(asked, share)), shares) for pair in share)
    return [answers[number] for number in range(len(asked))]


def _worker(asked: Sequence[Mutant | None], numbers: Sequence[int]) -> Iterator[tuple[int, str]]:
    lines = [
        json.dumps({"number": number, "tests": TESTS, "mutant": asdict(one) if (one := asked[number]) else None})
        for number in numbers
    ]
    command = [sys.executable, "-m", "tests.torture.mutating"]
    paths = os.environ | {"PYTHONPATH": str(REPO)}
    run = subprocess.run(
        command, cwd=REPO, env=paths, input="\n".join(lines), capture_output=True, text=True, check=True
    )
    for line in run.stdout.splitlines():
        answer = json.loads(line)
        yield answer["number"], answer["caught_by"]
