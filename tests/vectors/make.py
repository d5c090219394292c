"""Writes the test vectors anew: `python -m tests.vectors.make`; the same bytes every time.

Only for a change of the format that is meant: whoever reads these files elsewhere has to change too. The page
docs/envelope.md gets its worked example from here as well.
"""

from __future__ import annotations

import json
from typing import Any

from tests.house import REPO
from tests.vectors import cast, edges, negatives, page, positive
from tests.vectors.receiving import FOLDER


def positive_file() -> dict[str, Any]:
    """Return what is good, with every intermediate value."""
    return {
        "seed": cast.SEED,
        "now_ms": cast.NOW_MS,
        "deployment_id": cast.DEPLOYMENT,
        "keys": positive.keys(),
        "papers": positive.papers(),
        "messages": positive.messages(),
        "checkpoint": positive.checkpoint(),
    }


def negative_file() -> dict[str, Any]:
    """Return what must be rejected, with the counter of each."""
    return {"now_ms": cast.NOW_MS, "cases": negatives.negatives()}


def primitives_file() -> dict[str, Any]:
    """Return the edges of the two primitives."""
    return {"ed25519": edges.signatures(), "xchacha20_poly1305": edges.seals()}


def text_of(content: dict[str, Any]) -> str:
    """Return a file's text."""
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def main() -> None:
    """Write them all."""
    made = positive_file()
    files = {"positive": made, "negative": negative_file(), "primitives": primitives_file()}
    for name, content in files.items():
        (FOLDER / f"{name}.json").write_text(text_of(content), "utf-8")
    path = REPO / "docs/envelope.md"
    path.write_text(page.with_example(path.read_text("utf-8"), made), "utf-8")


if __name__ == "__main__":
    main()
