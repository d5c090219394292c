"""Which flights may be deleted: a function of what is known of them, of the free space and of the time.

Only a flight that is closed, that was pushed whole, and that is none of the newest `keep_newest` closed ones: the open
flight names the head of the last of them. Of these go those that ended `keep_ms` ago; and, while the disk is under
`min_free_bytes`, the oldest of the others. What was not pushed is never deleted, and on a full disk the node says so
instead. It reads no clock and touches no file.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple


class Policy(NamedTuple):
    """What is configured."""

    keep_newest: int  # at least 1
    keep_ms: int
    min_free_bytes: int


class Candidate(NamedTuple):
    """What is known of a flight."""

    number: int
    closed: bool
    pushed: bool  # whole, to somewhere else
    ended_ms: int  # wall clock, milliseconds since 1970
    size_bytes: int


class Plan(NamedTuple):
    """What is to be done, and what stands in the way of more."""

    delete: tuple[int, ...]  # numbers of flights, the oldest first
    short: str  # why the disk stays under min_free_bytes, in words; "" where it does not


def plan(flights: Sequence[Candidate], policy: Policy, *, now_ms: int, free_bytes: int) -> Plan:
    """Return which of the flights on a disk with `free_bytes` to spare are to go at `now_ms`."""
    closed = sorted(flight for flight in flights if flight.closed)
    rest = closed[: max(len(closed) - max(policy.keep_newest, 1), 0)]
    may_go = [flight for flight in rest if flight.pushed]
    delete, free = [], free_bytes
    for flight in may_go:
        if flight.ended_ms + policy.keep_ms <= now_ms:
            delete.append(flight)
            free += flight.size_bytes
    for flight in may_go:
        if free < policy.min_free_bytes and flight not in delete:
            delete.append(flight)
            free += flight.size_bytes
    short = _short(rest, policy, free) if free < policy.min_free_bytes else ""
    return Plan(tuple(sorted(flight.number for flight in delete)), short)


def _short(rest: Sequence[Candidate], policy: Policy, free: int) -> str:
    wanted = f"{free >> 20} MiB of the disk are free, {policy.min_free_bytes >> 20} are wanted"
    waiting = [flight for flight in rest if not flight.pushed]
    if not waiting:
        return f"{wanted}: no flight may be deleted any more"
    space = sum(flight.size_bytes for flight in waiting) >> 20
    return f"{wanted}: {len(waiting)} flights ({space} MiB) wait to be pushed"
