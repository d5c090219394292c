"""Asks a serving Directory, for a command: one link, a few questions, and what is answered is judged by others.

Anybody on the mesh may answer; so all answers are tried, and the first that is believed counts. A running node asks by
`adapters.mesh.trust_client` instead.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import product
from typing import Final

from google.protobuf.message import DecodeError

from autopilot.adapters.mesh.link import ANSWERS_MAX, Link, Wire
from autopilot.ground.enrolment import ANSWER_BYTES_MAX, EnrolmentError
from autopilot.ground.renewal import Fresh, refresh, renewal_request
from autopilot.trust.identity import Identity, IdentityError
from autopilot.wire import keys
from autopilot.wire.directory_pb2 import Documents
from autopilot.wire.keys import Channel, trust_key

TIMEOUT_S: Final = 3.0
NODES_MAX: Final = 1024  # of one answer
TRIED_MAX: Final = ANSWERS_MAX**2  # of the combinations of what several answered


def enrolment_answers(endpoints: Sequence[str], request: bytes, wait_s: float) -> list[bytes]:
    """Return what is answered to an enrolment request. Raises EnrolmentError without a link."""
    with _linked(endpoints, wait_s) as wire:
        return wire.ask(trust_key(keys.ENROLMENTS, ""), request, TIMEOUT_S)


def renew(held: Identity, endpoints: Sequence[str], wait_s: float) -> list[str]:
    """Bring an identity folder up to date; return the files that changed.

    Raises EnrolmentError without a link or answer, IdentityError when nothing of it is believed, OSError.
    """
    with _linked(endpoints, wait_s) as wire:
        return renew_over(wire, held)


def renew_over(wire: Wire, held: Identity) -> list[str]:
    """Do what `renew` does over a link that is open."""

    def ask(channel: Channel, question: bytes) -> list[bytes]:
        answers = wire.ask(trust_key(channel, held.deployment_id), question, TIMEOUT_S)
        if not answers:
            raise EnrolmentError(f"no answer for {channel.name}; check that `autopilot directory serve` runs")
        return answers

    parts = [
        ask(keys.TRUST_ROOTS, b""),
        ask(keys.RENEWALS, renewal_request(held)),
        ask(keys.REVOCATIONS, b""),
        [first for answer in ask(keys.EPOCHS, held.sign_key.key_id) for first in _documents(answer)[:1]],
    ]
    nodes = [each for answer in ask(keys.NODES, b"") for each in _documents(answer)[:NODES_MAX]]
    because = IdentityError(f"{held.folder}: what was served can't be read; nothing was changed")
    for _, (trust_root, token, revocations, epoch) in zip(range(TRIED_MAX), product(*parts), strict=False):
        try:
            fresh = Fresh(trust_root=trust_root, token=token, revocations=revocations, epoch=epoch, nodes=nodes)
            return refresh(held, fresh)
        except IdentityError as error:
            because = error
    raise because


def _documents(answer: bytes) -> list[bytes]:
    try:
        return list(Documents.FromString(answer).documents)
    except DecodeError:
        return []


@contextmanager
def _linked(endpoints: Sequence[str], wait_s: float) -> Iterator[Wire]:
    link = Link(connect=endpoints, answer_bytes_max=ANSWER_BYTES_MAX)
    link.start()
    try:
        if not _waited(link, wait_s):
            raise EnrolmentError(f"no link to {', '.join(endpoints)} within {wait_s:g} s; check the address")
        yield link
    finally:
        link.stop()


def _waited(link: Link, wait_s: float) -> bool:
    pause = threading.Event()
    for _ in range(max(1, int(wait_s / 0.1))):
        if link.linked():
            return True
        pause.wait(0.1)
    return link.linked()
