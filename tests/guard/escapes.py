"""What is excused in the core, counted: each with the reason why it can't make two runs differ.

An escape that is no longer needed fails the tests, as one that is missing does.
"""

from __future__ import annotations

from typing import NamedTuple


class Escape(NamedTuple):
    """So many places in a file that do something the core may not do."""

    path: str
    what: str
    places: int
    because: str


# What the guard sees when golden flights are flown.
AT_RUN_TIME = (
    Escape(
        "statecharts/table.py",
        "calls _thread.RLock",
        1,
        "`transitions` asks its logger whether it may speak; the lock is the logger's, and nothing is read from it",
    ),
)
