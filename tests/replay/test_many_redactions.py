"""A seeded sample of the redactions that run in full as torture."""

from __future__ import annotations

from tests.torture.redact import run


def test_a_sample_of_redactions_holds() -> None:
    """Each copy keeps what it promises, and all three sorts of decision occur."""
    counts = run(25, 1, lambda _: None)
    assert (counts["copies"], counts["forgeries"]) == (25, 25)
    assert min(counts.values()) > 0
