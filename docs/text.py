"""Markdown from values."""

from __future__ import annotations

from collections.abc import Iterable


def cells(*texts: str) -> str:
    """Return one row of a table."""
    return "| " + " | ".join(text.replace("|", "\\|") for text in texts) + " |"


def table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> list[str]:
    """Return the lines of a table, and the empty line that ends it."""
    return [cells(*head), cells(*("---" for _ in head)), *(cells(*row) for row in rows), ""]
