"""What stands in the core's source and needs an excuse: found, counted, excused one by one."""

from __future__ import annotations

from collections import Counter

import pytest

from tests.guard.escapes import AT_REST
from tests.guard.standing import findings
from tests.house import source_of
from tests.test_floors import core


def test_what_stands_in_the_core_is_excused() -> None:
    """Each escape is counted, and each is needed."""
    found = [finding for source in core() for finding in findings(source)]
    places = Counter((finding.path, finding.what) for finding in found)
    assert places == {(one.path, one.what): one.places for one in AT_REST}, [str(one) for one in found]
    assert sum(one.places for one in AT_REST) == 16
    assert all(one.because for one in AT_REST)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("a = vars(b)", "vars(...)"),
        ("a = dir(b)", "dir(...)"),
        ("a = globals()", "globals(...)"),
        ("a = locals()", "locals(...)"),
        ("a = repr(b)", "repr(...)"),
        ("a = ascii(b)", "ascii(...)"),
        ("a = b.lower()", "lower"),
        ("a = b.isdigit()", "isdigit"),
        ("a = type(b).__name__", "__name__"),
        ("a = b.__dict__", "__dict__"),
        ("a = 2 ** b", "a power"),
        ("a = 2 ** -1", "a power"),
        ("a = f'{b!r}'", "!r"),
        ("a = f'{b!a}'", "!r"),
        ("a = f'{b:.2f}'", "shown as f"),
        ("a = f'{b:{c}e}'", "shown as e"),
        ("a = f'{b:n}'", "shown as n"),
        ("a = f'{b:.0%}'", "shown as %"),
        ("try:\n    a()\nexcept Exception:\n    pass", "except Exception"),
        ("try:\n    a()\nexcept BaseException:\n    pass", "except Exception"),
        ("try:\n    a()\nexcept:\n    pass", "except Exception"),
        ("a = sorted({1, 2}, key=b)", "sorted(set, key)"),
        ("a = min(set(b), key=c)", "min(set, key)"),
        ("a = max({b for b in c}, key=d)", "max(set, key)"),
        ("A = frozenset(b)\nfor c in A:\n    pass", "goes through A"),
        ("A: frozenset[str] = frozenset(b)\nc = [d for d in A]", "goes through A"),
    ],
)
def test_each_is_found(text: str, what: str) -> None:
    """A rule that can't fail guards nothing."""
    found = findings(source_of("statecharts/bad.py", text))
    assert [finding.what for finding in found] == [what]
    assert found[0].because


@pytest.mark.parametrize(
    "text",
    [
        "a = 10 ** 12",
        "a = f'{b:04d}{c:x}{d!s}{e}'",
        "try:\n    a()\nexcept (KeyError, ValueError):\n    pass",
        "a = sorted({1, 2}), min([1, 2], key=b), max(*b, key=c)",
        "A = frozenset(b)\nc = [d for d in sorted(A)]\ne = 1 in A",
        "a = b.strip(' ').join(c)",
    ],
)
def test_what_comes_out_the_same_is_silent(text: str) -> None:
    """Integers, ASCII and sorted sets."""
    assert [str(finding) for finding in findings(source_of("statecharts/good.py", text))] == []
