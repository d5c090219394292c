"""What may not stand in the core because it can come out otherwise elsewhere: beside the allow-list, and with escapes.

`tests/test_floors.py` has the rules without exception; these have some, counted in `escapes.py`.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator

from tests.house import Source
from tests.test_floors import Finding, called

NAMESPACE = "the order of names in a namespace is the interpreter's affair"
UNICODE = "what is a letter, a digit or a space depends on the Unicode tables of a Python version"
NAMED = "the name of a class or a function is an affair of its library"
POWER = "a power with a negative exponent is a float"
SHOWN = "floats are shown, or a locale is asked"
SET_ORDER = "elements with equal keys come in the order of the set, which differs from run to run"
ANY_ERROR = "it catches what depends on the machine, too: memory, depth of recursion"
MINIMA = ("sorted", "min", "max")
CALLS = dict.fromkeys(("vars", "dir", "globals", "locals"), NAMESPACE) | dict.fromkeys(("repr", "ascii"), UNICODE)
TEXT = (
    *("upper", "lower", "title", "capitalize", "casefold", "swapcase"),
    *("isalpha", "isalnum", "isdecimal", "isdigit", "isnumeric", "isspace", "isprintable", "isidentifier"),
    *("islower", "isupper", "istitle"),
)
ATTRIBUTES = dict.fromkeys(TEXT, UNICODE) | dict.fromkeys(("__name__", "__qualname__", "__dict__"), NAMED)
FLOAT_FORMATS = "eEfFgGn%"


def findings(source: Source) -> list[Finding]:
    """Return what stands in a core file that needs an escape, in the order of lines."""
    frozen = tuple(_frozen(source.tree))
    found = ((node, what) for node in ast.walk(source.tree) for what in _wrong(node, frozen))
    return sorted(Finding(source.path, getattr(node, "lineno", 0), *what) for node, what in found)


def _frozen(tree: ast.Module) -> Iterator[str]:
    """Yield the names of the module's frozensets."""
    for node in tree.body:
        value = node.value if isinstance(node, ast.Assign | ast.AnnAssign) else None
        if isinstance(value, ast.Call) and called(value) == "frozenset":
            targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
            yield from (target.id for target in targets if isinstance(target, ast.Name))


def _wrong(node: ast.AST, frozen: tuple[str, ...]) -> Iterator[tuple[str, str]]:
    match node:
        case ast.Call():
            yield from _called(node)
        case ast.Attribute(attr=name) if name in ATTRIBUTES:
            yield name, ATTRIBUTES[name]
        case ast.BinOp(op=ast.Pow(), right=exponent) if not _natural(exponent):
            yield "a power", POWER
        case ast.FormattedValue():
            yield from _formatted(node)
        case ast.ExceptHandler(type=None | ast.Name(id="Exception" | "BaseException")):
            yield "except Exception", ANY_ERROR
        case ast.For(iter=ast.Name(id=name)) | ast.comprehension(iter=ast.Name(id=name)) if name in frozen:
            yield f"goes through {name}", SET_ORDER


def _called(node: ast.Call) -> Iterator[tuple[str, str]]:
    name = called(node)
    if name in CALLS:
        yield f"{name}(...)", CALLS[name]
    keyed = any(keyword.arg == "key" for keyword in node.keywords)
    if name in MINIMA and keyed and node.args and _is_set(node.args[0]):
        yield f"{name}(set, key)", SET_ORDER


def _is_set(node: ast.expr) -> bool:
    return isinstance(node, ast.Set | ast.SetComp) or (
        isinstance(node, ast.Call) and called(node) in ("set", "frozenset")
    )


def _natural(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, int)


def _formatted(node: ast.FormattedValue) -> Iterator[tuple[str, str]]:
    if node.conversion in map(ord, "ra"):
        yield "!r", UNICODE
    spec = "" if node.format_spec is None else ast.unparse(node.format_spec).rstrip("'\"")
    if spec.endswith(tuple(FLOAT_FORMATS)):
        yield f"shown as {spec[-1]}", SHOWN
