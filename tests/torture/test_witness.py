"""A seeded sample of the lying nodes; the full count runs as an area of `python -m tests.torture`."""

from __future__ import annotations

from tests.torture.witness import run


def test_lying_nodes_before_a_witness() -> None:
    """Twelve histories: honest ones are believed, every proof is worth what it is worth."""
    counts = run(12, 1, lambda _: None)
    assert counts["answers: contradicts"] > 0
    assert counts["answers: proven"] > 10
    assert counts["roll-backs and forks found as they were heard"] > 0
    assert counts["answers that proved nothing"] > 10
    assert counts["honest nodes"] + counts["lying nodes"] == 12
