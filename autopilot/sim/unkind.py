"""What goes wrong with a vehicle's answers, by chance from a seed that the caller holds.

`answers_of` turns the one answer that a command deserves into those that are sent: none, late, twice,
after an IN_PROGRESS, never more than that, or beside one from a stranger who says the opposite.
`form_refused` is a vehicle that takes commands in one form only.
"""

from __future__ import annotations

import random
from dataclasses import dataclass

from autopilot.sim.answers import ACCEPTED, FAILED, IN_PROGRESS

LONG_ONLY, INT_ONLY, UNSUPPORTED_FRAME = 7, 8, 9  # MAV_RESULT
STRANGER = (9, 1)
WORK_S = 0.3  # between IN_PROGRESS and the last answer


@dataclass(slots=True)
class Unkind:
    """Probabilities for each answer, and seconds. Edit it at any time."""

    ack_lost: float = 0.0
    ack_twice: float = 0.0
    ack_stranger: float = 0.0  # somebody else's answer comes first
    ack_in_progress: float = 0.0  # IN_PROGRESS comes first
    ack_forever: float = 0.0  # IN_PROGRESS comes, and nothing more
    ack_late_s: float = 0.0  # a random part of this
    mission_ack_lost: float = 0.0  # the end of an upload isn't told
    stream_lost: float = 0.0
    only_long: bool = False  # COMMAND_INT is answered LONG_ONLY
    only_int: bool = False  # COMMAND_LONG is answered INT_ONLY
    unknown: tuple[int, ...] = ()  # MAV_CMD that it doesn't know
    frames_refused: tuple[int, ...] = ()  # MAV_FRAME that a COMMAND_INT can't have


@dataclass(frozen=True, slots=True)
class Answer:
    """One COMMAND_ACK to send."""

    after_s: float
    result: int
    source: tuple[int, int] | None = None  # another than the vehicle


def form_refused(unkind: Unkind, frame: int | None) -> int | None:
    """Return the MAV_RESULT for the form of a command (frame None: COMMAND_LONG), None where it may pass."""
    if frame is None:
        return INT_ONLY if unkind.only_int else None
    if unkind.only_long:
        return LONG_ONLY
    return UNSUPPORTED_FRAME if frame in unkind.frames_refused else None


def answers_of(unkind: Unkind, chance: random.Random, result: int) -> list[Answer]:
    """Return what is sent for a command with this result, in order."""
    after_s = chance.random() * unkind.ack_late_s
    sent = []
    if chance.random() < unkind.ack_stranger:
        sent.append(Answer(after_s, FAILED if result == ACCEPTED else ACCEPTED, STRANGER))
    if chance.random() < unkind.ack_lost:
        return sent
    forever = chance.random() < unkind.ack_forever
    if forever or chance.random() < unkind.ack_in_progress:
        sent.append(Answer(after_s, IN_PROGRESS))
        after_s += WORK_S
    if not forever:
        sent.append(Answer(after_s, result))
        if chance.random() < unkind.ack_twice:
            sent.append(Answer(after_s, result))
    return sent
