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

# What stands in the source (`standing.py`).
AT_REST = (
    Escape("events/kinds.py", "vars(...)", 1, "once, at import; what it finds is sorted by number"),
    Escape("events/kinds.py", "!r", 1, "in the words of an error, which are not recorded"),
    Escape("events/kinds.py", "__name__", 1, "in the words of an error, which are not recorded"),
    Escape("events/upcasts.py", "__name__", 1, "in the words of an error, which are not recorded"),
    Escape("projections/canonical.py", "__name__", 1, "in the words of an error, which are not recorded"),
    Escape(
        "statecharts/codec.py", "__name__", 5, "names of our own classes, for the digest of the layout and in errors"
    ),
    Escape("statecharts/table.py", "__name__", 1, "the names of our own guards, for the digest of the charts"),
    Escape("statecharts/engine.py", "__name__", 1, "step_failed names the class of an error: a builtin's or our own"),
    Escape(
        "statecharts/engine.py",
        "except Exception",
        2,
        "whatever a chart raises must not stop the node; what the machine raises shows as a divergence",
    ),
    Escape(
        "projections/words.py", "a power", 2, "digits of a unit, constants where it is called, never below those shown"
    ),
)
