"""Rewrites the syntax tree of a core module so that its iterations, numbers, calls and texts go through hooks.

The rewritten module does what it did. Sets may be made, asked and sorted; where their order could be seen, and where a
float comes into being, a hook notes it. Annotations and patterns are left alone: they are not run.
"""

from __future__ import annotations

import ast
from collections.abc import Callable
from types import BuiltinFunctionType, MethodType
from typing import Any

from tests.guard.findings import ANY, CALLS, FLOAT, HANDS, ITERATES, SHOWS, Seen

CORE = ("events", "statecharts", "projections")
HOOKS = ("_guard_iter", "_guard_value", "_guard_call", "_guard_text")
ORDERLESS = (len, sorted, min, max, sum, any, all, bool, set, frozenset, isinstance, type)
SETS = (set, frozenset)
FLOATS = (float, complex)
ONLY_WITHOUT_KEY = (sorted, min, max)  # elements with the same key come in the order of the set


def instrumented(source: str | bytes, path: str) -> ast.Module:
    """Return the tree of a module with its hooks. Raises SyntaxError."""
    tree = _Instrument().visit(ast.parse(source, path))
    assert isinstance(tree, ast.Module)
    return ast.fix_missing_locations(tree)


def hooks(path: str, seen: Seen) -> dict[str, Callable[..., Any]]:
    """Return what an instrumented module finds under the names in HOOKS."""
    made = _Hooks(path, seen)
    return dict(zip(HOOKS, (made.iter, made.value, made.call, made.text), strict=True))


class _Hooks:
    """What watches one module. Types are compared as they are: hooks that call C functions would be watched as well."""

    def __init__(self, path: str, seen: Seen) -> None:
        self._path = path
        self._seen = seen

    def iter(self, line: int, iterated: Any) -> Any:
        """Watch what is gone through."""
        if type(iterated) in SETS:
            self._seen.add(self._path, line, ITERATES)
        return iterated

    def value(self, line: int, value: Any) -> Any:
        """Watch what was computed or read."""
        if type(value) in FLOATS:
            self._seen.add(self._path, line, FLOAT)
        return value

    def text(self, line: int, shown: Any) -> Any:
        """Watch what becomes text."""
        if type(shown) in SETS:
            self._seen.add(self._path, line, SHOWS)
        return shown

    def call(self, line: int, called: Any, /, *given: Any, **named: Any) -> Any:
        """Watch a call and what comes back."""
        if type(called) is BuiltinFunctionType and (what := _of_address_or_any(called)):
            self._seen.add(self._path, line, what)
        for one in (*given, *[named[name] for name in named]):
            if type(one) in SETS and (what := _of_sets(called, "key" in named)):
                self._seen.add(self._path, line, what)
        return self.value(line, called(*given, **named))


def _of_address_or_any(called: BuiltinFunctionType) -> str:
    """Return what is wrong with a C function, or with a method of a set, whatever it is given."""
    if type(called.__self__) in SETS:
        return ANY if called.__name__ == "pop" else ""
    return f"{CALLS} {called.__name__}" if called is id or called is hash else ""


def _of_sets(called: Any, has_key: bool) -> str:
    """Return how a call that is given a set makes its order visible, empty where it does not."""
    if type(getattr(called, "__self__", None)) in SETS or _is_core(called):
        return ""
    if called in ORDERLESS and not (has_key and called in ONLY_WITHOUT_KEY):
        return ""
    return f"{HANDS} {getattr(called, '__qualname__', called)}"


def _is_core(called: Any) -> bool:
    """Say whether it is Python code of the core, which has hooks of its own. Generated messages have none."""
    if isinstance(called, BuiltinFunctionType):
        return False
    function = called.__func__ if isinstance(called, MethodType) else called
    module = str(getattr(function, "__module__", ""))
    return module.split(".")[0] in CORE and not module.endswith("_pb2")


class _Instrument(ast.NodeTransformer):
    """Puts the hooks in; each method says where."""

    def visit_For(self, node: ast.For) -> ast.AST:
        """Hook b of `for a in b`."""
        return self._gone_through(node, "iter")

    def visit_comprehension(self, node: ast.comprehension) -> ast.AST:
        """Hook b of `[a for a in b]`."""
        return self._gone_through(node, "iter")

    def visit_YieldFrom(self, node: ast.YieldFrom) -> ast.AST:
        """Hook a of `yield from a`."""
        return self._gone_through(node, "value")

    def visit_Starred(self, node: ast.Starred) -> ast.AST:
        """Hook a of `f(*a)` and `[*a]`; in `*a = b` it is no value."""
        return self._gone_through(node, "value") if isinstance(node.ctx, ast.Load) else node

    def visit_Assign(self, node: ast.Assign) -> ast.AST:
        """Hook c of `a, b = c`."""
        unpacks = any(isinstance(target, ast.Tuple | ast.List) for target in node.targets)
        return self._gone_through(node, "value") if unpacks else self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> Any:
        """Hook b of `a += b`, which may lengthen a list, and then what a has become."""
        self._gone_through(node, "value")
        target = ast.copy_location(ast.parse(ast.unparse(node.target), mode="eval").body, node)
        return [node, ast.copy_location(ast.Expr(_hooked("_guard_value", target)), node)]

    def visit_FormattedValue(self, node: ast.FormattedValue) -> ast.AST:
        """Hook what a text shows."""
        self.generic_visit(node)
        node.value = _hooked("_guard_text", node.value)
        return node

    def visit_Call(self, node: ast.Call) -> ast.AST:
        """Hook `f(a)`; `super()` looks at its caller, so it stays."""
        self.generic_visit(node)
        if isinstance(node.func, ast.Name) and node.func.id == "super":
            return node
        hook, line = ast.Name("_guard_call", ast.Load()), ast.Constant(node.lineno)
        return ast.copy_location(ast.Call(hook, [line, node.func, *node.args], node.keywords), node)

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        """Hook `0.5`."""
        return _hooked("_guard_value", node) if isinstance(node.value, FLOATS) else node

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        """Hook `a + b`."""
        return _hooked("_guard_value", self._inside(node))

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        """Hook `a.b` where it is read."""
        inside = self._inside(node)
        return _hooked("_guard_value", inside) if isinstance(node.ctx, ast.Load) else inside

    def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
        """Hook `a[b]` where it is read."""
        inside = self._inside(node)
        return _hooked("_guard_value", inside) if isinstance(node.ctx, ast.Load) else inside

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        """Hook c of `a: B = c`; the annotation is not run."""
        return self._without(node, "annotation", ast.Constant(None))

    def visit_arg(self, node: ast.arg) -> ast.AST:
        """Leave an annotation alone."""
        return node

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        """Hook a function; the annotation of its result is not run."""
        return self._without(node, "returns", None)

    def visit_match_case(self, node: ast.match_case) -> ast.AST:
        """Hook guard and body of a case; a pattern is no expression."""
        return self._without(node, "pattern", ast.MatchAs())

    def _inside(self, node: ast.expr) -> ast.expr:
        self.generic_visit(node)
        return node

    def _gone_through(self, node: ast.AST, part: str) -> ast.AST:
        self.generic_visit(node)
        setattr(node, part, _hooked("_guard_iter", getattr(node, part)))
        return node

    def _without(self, node: ast.AST, part: str, instead: ast.AST | None) -> ast.AST:
        kept = getattr(node, part)
        setattr(node, part, instead)
        self.generic_visit(node)
        setattr(node, part, kept)
        return node


def _hooked(hook: str, node: ast.expr) -> ast.expr:
    call = ast.Call(ast.Name(hook, ast.Load()), [ast.Constant(node.lineno), node], [])
    return ast.copy_location(call, node)
