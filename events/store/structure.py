"""Whether a database is built as the log of a flight is, beside what its records say: rot can lie there too.

A letter of the schema can hide a whole table, and a count in a page some of its rows, without a word from SQLite. The
chain and the head file answer for the records; for what lies beside them this does. It reads only.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import apsw

_SCHEMA_OF = "SELECT type, name, tbl_name, sql FROM sqlite_schema"


def misfit(connection: apsw.Connection, script: str) -> str:
    """Return what does not fit the schema that `script` makes, "" where everything does. Raises apsw.Error."""
    rows: Any = connection.execute(_SCHEMA_OF).fetchall()
    if not set(rows) <= _made_by(script):
        return "its schema is not that of a flight"
    said = connection.pragma("quick_check", "checkpoint")  # of a table that is not there it says ok
    return "" if said == "ok" else f"table checkpoint: {said}"


@cache
def _made_by(script: str) -> frozenset[Any]:
    connection = apsw.Connection(":memory:")
    connection.execute(script)
    found: Any = connection.execute(_SCHEMA_OF).fetchall()
    connection.close()
    return frozenset(found)
