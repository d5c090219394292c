"""Golden flights, recorded once and replayed by every version, byte for byte; and one that must diverge.

`story` holds most of what can happen once: every answer, two questions, a mute, an arrival. `forged` is the same flight
with one answer that its charts did not give, and a chain that holds: only running it again can tell.
"""

from __future__ import annotations

import shutil
from pathlib import Path

from events.store import SqliteReader
from replay.verdict import Outcome, Verdict
from replay.verify import verify

HERE = Path(__file__).parent


def check_golden(name: str, folder: Path, outcome: Outcome) -> Verdict:
    """Replay a copy of a golden flight (a reader may leave files beside a log) and compare the outcome."""
    copy = shutil.copy(HERE / f"{name}.db", folder / "flight.db")
    reader = SqliteReader(Path(copy))
    verdict = verify(reader)
    reader.close()
    assert verdict.outcome is outcome, verdict.words()
    return verdict


def test_the_story_replays_as_it_was_decided(tmp_path: Path) -> None:
    """A change that decides otherwise raises LOGIC and records the golden flights anew, knowingly."""
    verdict = check_golden("story", tmp_path, Outcome.IDENTICAL)
    assert verdict.decisions > 30


def test_the_forged_flight_diverges_where_it_was_forged(tmp_path: Path) -> None:
    """The chain holds; the decision does not."""
    verdict = check_golden("forged", tmp_path, Outcome.DIVERGES)
    assert verdict.first is not None
    assert (verdict.first.kind, verdict.first.field, verdict.first.recorded) == (
        "send_ack",
        "detail",
        "'something else'",
    )
    assert verdict.first.causes[-1].kind == "order_received"
    assert verdict.further == 0
