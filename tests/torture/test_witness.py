"""A seeded sample of the lying nodes; the full count runs as an area of `python -m tests.torture`."""

from __future__ import annotations

from tests.torture.witness import run


def test_lying_nodes_before_a_witness() -> None:
    """Twenty histories: honest ones are believed, every proof is worth what it is worth."""
    counts = run(histories=20, records=1500)
    assert counts["answers: contradicts"] > 0
    assert counts["answers: proven"] > 30
    assert counts["roll-backs and forks found as they were heard"] > 0
    assert counts["answers that proved nothing"] > 20
    assert counts["honest nodes"] + counts["lying nodes"] == 20
