"""The log folded into what people ask for. Folds present what was decided and decide nothing.

A fold is `apply(state, record) -> state` and looks at nothing but its arguments. `status` returns a new frozen
value each time. The others may hold a large map, so they change the state that they are given and return it: the
caller owns it, and only what came back counts.
"""
