"""Sins, planted one by one in a chart in memory while an order is judged: each must be seen for what it is.

The chart is `command`, in whose file `PLACE` stands once; the file itself is not changed.
"""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.util import module_from_spec

from tests.guard.findings import ANY, CALLS, FLOAT, HANDS, ITERATES, REACHES, SHOWS
from tests.guard.loading import Guarding
from tests.guard.watching import Watch

MODULE = "statecharts.charts.command_part"
PLACE = "    arrival = state.arrival.value\n"

SINS = {
    "for _ in {'a', 'b'}: pass": ITERATES,
    "[one for one in frozenset(('a', 'b'))]": ITERATES,
    "{one: 1 for one in {'a', 'b'}}": ITERATES,
    "first, second = {'a', 'b'}": ITERATES,
    "[*{'a', 'b'}]": ITERATES,
    "all_of = []; all_of += {'a', 'b'}": ITERATES,
    "deep = lambda: (yield from {'a', 'b'}); tuple(deep())": ITERATES,
    "list({'a', 'b'})": f"{HANDS} list",
    "tuple(map(len, {'a', 'b'}))": f"{HANDS} map",
    "','.join({'a', 'b'})": f"{HANDS} str.join",
    "'{all_of}'.format(all_of={'a', 'b'})": f"{HANDS} str.format",
    "sorted({'a', 'b'}, key=len)": f"{HANDS} sorted",
    "min({'a', 'b'}, key=len)": f"{HANDS} min",
    "dict.fromkeys({'a', 'b'})": f"{HANDS} dict.fromkeys",
    "record.message.issuer.roles.extend({'a', 'b'})": f"{HANDS} RepeatedScalarContainer.extend",
    "type(record.message.issuer)(roles={'a', 'b'})": f"{HANDS} Issuer",
    "{'a', 'b'}.pop()": ANY,
    "f'{ {1, 2} }'": SHOWS,
    "str({'a', 'b'})": f"{HANDS} str",
    "half = 0.5": FLOAT,
    "half = 1 / 2": FLOAT,
    "half = 2 ** -1": FLOAT,
    "half = 1; half /= 2": FLOAT,
    "float(1)": FLOAT,
    "__import__('math').sqrt(2)": FLOAT,
    "match 1:\n        case one:\n            one /= 2": FLOAT,
    "__import__('sys').float_info[0]": FLOAT,
    "def inner(given: float = 0.5) -> float: return given": FLOAT,
    "inner: float = 0.5": FLOAT,
    "complex(1)": FLOAT,
    "__import__('sys').float_info.max": FLOAT,
    "import time; time.time()": f"{CALLS} time.time",
    "import time; time.monotonic_ns()": f"{CALLS} time.monotonic_ns",
    "import time; time.sleep(0)": f"{CALLS} time.sleep",
    "import datetime; datetime.datetime.now()": f"{CALLS} datetime.datetime.now",
    "import datetime; datetime.date.today()": f"{CALLS} datetime.date.today",
    "import random; random.random()": f"{CALLS} random.Random",
    "import random; random.choice('ab')": f"{CALLS} random.Random",
    "import os; os.urandom(4)": f"{CALLS} posix.urandom",
    "import uuid; uuid.uuid4()": f"{CALLS} posix.urandom",
    "import secrets; secrets.token_bytes(4)": f"{CALLS} posix.urandom",
    "import os; os.getpid()": f"{CALLS} posix.getpid",
    "open('/dev/null').close()": f"{REACHES}: open",
    "import os; os.listdir('.')": f"{REACHES}: os.listdir",
    "import socket; socket.socket().close()": f"{REACHES}: socket.__new__",
    "import threading; threading.Thread(target=int).start()": f"{CALLS} _thread.start_new_thread",
    "import this_module_is_not_there": f"{REACHES}: import",
    "print(end='')": f"{CALLS} print",
    "id(state)": f"{CALLS} id",
    "hash('a')": f"{CALLS} hash",
}
HARMLESS = (
    "sorted({'a', 'b'})",
    "len({'a', 'b'})",
    "max({1, 2})",
    "'a' in {'a', 'b'}",
    "{'a'} | {'b'} == frozenset('ab')",
    "{'a', 'b'}.union({'c'})",
    "for _ in {'a': 1, 'b': 2}: pass",
    "first, second = 1, 2",
    "half = 1 // 2; half += 1",
    "{1: 2}.pop(1)",
    "{('a', 1): 2}[('a', 1)]",
    "f'{1}{[2]}'",
)


def seen_of(statement: str, guarding: Guarding, watch: Watch) -> list[str]:
    """Plant a statement in the chart, let it judge one order, and return what was seen of it in the chart's file."""
    from statecharts import engine
    from tests.flights import Flight, point_at_place

    guarding.plants = {MODULE: (PLACE, f"    {statement}\n{PLACE}")}
    places, flight = engine._PLACES, Flight()
    guarding.seen.sins.clear()
    part = _loaded(guarding)
    engine._PLACES = tuple((bit, part if one.chart.name == "command" else one) for bit, one in places)
    try:
        with watch.on():
            flight.tell(point_at_place("a"))
    finally:
        engine._PLACES = places
    return [sin.what for sin in guarding.seen.sins if sin.path == "statecharts/charts/command_part.py"]


def _loaded(guarding: Guarding):  # type: ignore[no-untyped-def]
    """Load the chart's file anew, beside the one that is in use."""
    package = import_module("statecharts.charts")
    spec = guarding.find_spec(MODULE, package.__path__)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    assert sys.modules[MODULE] is not module
    return module.PART
