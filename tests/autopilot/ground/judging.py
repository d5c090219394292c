"""What the tests of judged flights share: whose they are, how they are spoiled, and the door. It tests nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from autopilot.ground.examiner import judge
from autopilot.ground.kept import Kept
from autopilot.ground.sealed import Anchor
from autopilot.node.sealing import KEY_FILE
from autopilot.trust.keys import SignKey
from autopilot.trust.notes import Checkpoint, sign_note
from events.store import flights_in
from events.tree import Tree
from tests.autopilot.trust.world import people
from tests.torture.forging import Log, logs_in

WASP = people().wasp
ANCHOR = Anchor(WASP.deployment_id, WASP.principal_id, WASP.public_key)
Expected = tuple[int, int, int, str]


def check_found(root: Path, kept: Kept | None, *expected: Expected, wrong: bool = True) -> None:
    """Check what is found, in its order: flight, first and last record, part of the reason."""
    found = judge(root, ANCHOR, kept)
    words = [f"{one.flight}, {one.words()}" for one in found]
    assert [one[:3] for one in found] == [one[:3] for one in expected], words
    assert [part in one.because for one, (*_, part) in zip(found, expected, strict=True)] == [True] * len(found), words
    assert {one.wrong for one in found} <= {wrong}, words


def rewritten(root: Path, number: int, change: Callable[[Log], object]) -> Log:
    """Change a log as somebody can who holds the disk; head file and chain are made to fit."""
    log = logs_in(root)[number - 1]
    change(log)
    log.chain()
    log.write(head=True)
    return log


def bodied(log: Log, seq: int, body: bytes) -> None:
    """Give a record another body."""
    log.rows[seq] = log.rows[seq]._replace(body=body)


def live_key(root: Path) -> SignKey:
    """Return the log key of the open flight."""
    return SignKey.from_seed((flights_in(root)[-1].folder / KEY_FILE).read_bytes())


def sealed_with(log: Log, key: SignKey, size: int, origin: str = "", name: str = "") -> None:
    """Sign the first records as they are now."""
    own = f"{ANCHOR.signer}/{log.flight.number}"
    text = Checkpoint(origin or own, size, Tree(row.leaf for row in log.rows[:size]).root(), 1).text()
    log.checkpoints[size] = sign_note(text, name or own, key)
    log.write(head=True)
