"""The tables of a flight's database, and of a redacted copy of one. What lies beside these is damage (`structure`)."""

from __future__ import annotations

_HEADER = """
    seq INTEGER PRIMARY KEY,
    cause INTEGER NOT NULL,
    flight_ns INTEGER NOT NULL,
    mono_ns INTEGER NOT NULL,
    boot INTEGER NOT NULL,
    wall_ns INTEGER NOT NULL,
    clock_quality INTEGER NOT NULL,
    kind INTEGER NOT NULL,
    version INTEGER NOT NULL,
"""
_BESIDE = """
CREATE TABLE meta (name TEXT PRIMARY KEY, value BLOB NOT NULL) WITHOUT ROWID;
CREATE TABLE checkpoint (size INTEGER PRIMARY KEY, note TEXT NOT NULL);
"""
# Signed notes (`checkpoint`) lie outside the chain.
LOG = f"CREATE TABLE record ({_HEADER}    body BLOB NOT NULL,\n    leaf BLOB NOT NULL\n);{_BESIDE}"
# A removed body and its salt are NULL, and so is the hash of one that is there.
COPY = f"""CREATE TABLE record ({_HEADER}    body BLOB,
    leaf BLOB NOT NULL,
    salt BLOB,
    removed BLOB,
    CHECK ((body IS NULL) = (salt IS NULL) AND (body IS NULL) = (removed IS NOT NULL))
);{_BESIDE}"""
# Name in `meta` that tells a redacted copy, in place of `secret`.
REDACTED = "redacted"
