"""One cell of the matrix: runs all golden flights in the environment it was started in and prints what they come to.

It says, too, what the environment is as it sees it, so that a setting that does not bite is noticed.
"""

from __future__ import annotations

import hashlib
import json
import locale
import platform
import sys
import time

from google.protobuf.internal import api_implementation

from tests.golden.make import everything

SHA256_BYTES = bytes(1 << 23)
SUMMER_S = 1_750_000_000


def environment() -> dict[str, str]:
    """Return what may differ between two cells, as it was found."""
    locale.setlocale(locale.LC_ALL, "")
    return {
        "python": f"{platform.python_version()} ({platform.python_compiler()})",
        "protobuf": api_implementation.Type(),
        "asserts": str(sys.flags.optimize == 0),
        "hash": str(hash("a golden flight")),
        "zone": time.strftime("%z", time.localtime(SUMMER_S)),
        "half": locale.format_string("%.1f", 0.5),
        "sha256_us": str(round(min(map(_sha256_us, range(3))))),
    }


def _sha256_us(_nth: int) -> float:
    start_s = time.perf_counter()
    hashlib.sha256(SHA256_BYTES)
    return 1_000_000 * (time.perf_counter() - start_s)


def main() -> None:
    """Print environment and results as JSON."""
    print(json.dumps({"environment": environment(), "results": everything()}))


if __name__ == "__main__":
    main()
