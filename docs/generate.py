"""Write the pages that are drawn from the source: `python -m docs.generate` (make diagrams).

docs/charts.md comes from the rows of the statecharts, docs/events.md from the schema with its comments.
A test draws both again and compares, so they can't fall behind.
"""

from __future__ import annotations

from pathlib import Path

from docs import catalogue, charts
from statecharts.charts import CHARTS, transfer

REPO = Path(__file__).resolve().parent.parent


def pages() -> dict[str, str]:
    """Return every drawn page under its path in the repository. Raises SchemaUnread."""
    return {
        "docs/charts.md": charts.page((*CHARTS, transfer.CHART)),
        "docs/events.md": catalogue.page(REPO / "events" / "schema"),
    }


def main() -> None:
    """Write the pages."""
    for path, text in pages().items():
        (REPO / path).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
