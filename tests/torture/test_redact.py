"""A seeded sample of the redactions; the full count runs as an area of `python -m tests.torture`."""

from __future__ import annotations

from tests.torture.redact import run


def test_copies_say_what_they_are_and_no_more() -> None:
    """Twenty copies: none diverges, every proof stands, every forged hash is found."""
    counts = run(20, 1, lambda _: None)
    assert counts["copies"] == counts["forgeries"] == 20
    assert counts["compared"] > 0
    assert counts["uncompared"] > 0
