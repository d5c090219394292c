"""A Zenoh session that never fails at start and keeps trying: the only file that talks to Zenoh for node and ground.

Scouting and gossip are off: peers that find each other would go around a router's access rules.
What is put while the link is down is gone; whoever needs it delivered asks `linked` first or sends
again. Nothing here seals, signs or believes anything.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from itertools import islice
from typing import Literal, Protocol

import zenoh

RX_MESSAGE_BYTES_MAX = 1_048_576  # Zenoh would gather fragments of one message up to 1 GiB
SESSIONS_MAX = 64  # a peer's or router's own bound on who may connect

ANSWERS_MAX = 8  # answers to one question that are looked at; anybody on the mesh may give one
ANSWER_BYTES_MAX = 4096  # a consistency path among 2^63 records is shorter

Receive = Callable[[str, bytes], None]
Reply = Callable[[bytes], None]
Answer = Callable[[bytes, Reply], None]


class LinkDown(Exception):
    """There is no session, or it refused the message."""


class Wire(Protocol):
    """What an outbox or issuer needs of a link; tests bring their own."""

    def linked(self) -> bool:
        """Say whether anybody is connected now."""

    def put(self, key_expr: str, payload: bytes, *, urgent: bool) -> None:
        """Publish. Raises LinkDown."""

    def subscribe(self, key_expr: str, receive: Receive) -> None:
        """Call `receive(key, payload)` for every sample, from a thread of the link's."""

    def answer(self, key_expr: str, receive: Answer) -> None:
        """Call `receive(question, reply)` for every question on a key, from a thread of the link's."""

    def ask(self, key_expr: str, question: bytes, timeout_s: float) -> list[bytes]:
        """Return what is answered within `timeout_s`, by whomever; nothing without a link."""

    def start(self) -> None:
        """Begin to connect; returns at once."""

    def stop(self) -> None:
        """Close; no call of `receive` follows."""


def session_config(
    mode: Literal["client", "peer", "router"],
    connect: Sequence[str] = (),
    listen: Sequence[str] = (),
    reconnect_ms: int = 500,
    over: Mapping[str, object] | None = None,
) -> zenoh.Config:
    """Return the configuration of every session of this project; `over` lies over it, path by path.

    A client opens once and fails at once (the opener tries again; once open, Zenoh itself
    reconnects and declares again). A peer keeps connecting in the background by itself. Peers
    talk to peers: behind a router use clients, for without gossip a router passes nothing between peers.
    """
    settings: dict[str, object] = {
        "mode": mode,
        "connect/endpoints": list(connect),
        "connect/timeout_ms": 0 if mode == "client" else -1,
        "connect/exit_on_failure": mode == "client",
        "connect/retry": {
            "period_init_ms": reconnect_ms,
            "period_max_ms": reconnect_ms,
            "period_increase_factor": 1,
        },
        "listen/endpoints": list(listen),
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
        "transport/unicast/compression/enabled": False,
        "transport/unicast/max_sessions": SESSIONS_MAX,
        "transport/link/rx/max_message_size": RX_MESSAGE_BYTES_MAX,
    }
    config = zenoh.Config()
    for path, value in (settings | dict(over or {})).items():
        config.insert_json5(path, json.dumps(value))
    return config


class Link:
    """One Zenoh session, opened in the background and kept."""

    def __init__(
        self,
        *,
        mode: Literal["client", "peer", "router"] = "client",
        connect: Sequence[str] = (),
        listen: Sequence[str] = (),
        reconnect_ms: int = 500,
        answer_bytes_max: int = ANSWER_BYTES_MAX,
        over: Mapping[str, object] | None = None,
    ) -> None:
        """Make a link to `connect` (Zenoh endpoints); peers and routers may also `listen`. `start` opens it."""
        self._answer_bytes_max = answer_bytes_max
        self._settings = (mode, tuple(connect), tuple(listen), reconnect_ms, over)
        self._reconnect_s = reconnect_ms / 1000
        self._subscriptions: list[tuple[str, Receive]] = []
        self._answerers: list[tuple[str, Answer]] = []
        self._declared: list[object] = []  # Zenoh undeclares a subscriber that nobody holds
        self._session: zenoh.Session | None = None
        self._lock = threading.Lock()
        self._stopped = threading.Event()
        self._opener = threading.Thread(target=self._open, name="zenoh-opener", daemon=True)

    def start(self) -> None:
        """Begin to connect; returns at once, also when nobody answers yet."""
        self._opener.start()

    def stop(self) -> None:
        """Close the session; no callback follows."""
        self._stopped.set()
        if self._opener.is_alive():
            self._opener.join(timeout=5)
        with self._lock:
            session, self._session = self._session, None
        if session is not None:
            session.close()  # type: ignore[no-untyped-call]

    def opened(self) -> bool:
        """Say whether there is a session; one that listens then does."""
        return self._session is not None

    def linked(self) -> bool:
        """Say whether a router or peer is connected now."""
        session = self._session
        if session is None:
            return False
        try:
            return bool(session.info.routers_zid() or session.info.peers_zid())
        except zenoh.ZError:
            return False

    def put(self, key_expr: str, payload: bytes, *, urgent: bool) -> None:
        """Publish `payload` on `key_expr`.

        `urgent`: an order or ack. It goes reliably, before others, at once; when the link is slow
        this call blocks (Zenoh's default would drop it), and when the peer has died it blocks
        until Zenoh gives the transport up, which is why no callback and no event loop may call it.
        Otherwise what can't leave is dropped. Raises LinkDown without a session; with a session
        and nobody connected Zenoh drops in silence.
        """
        session = self._session
        if session is None:
            raise LinkDown("the session is not open")
        control = zenoh.CongestionControl.BLOCK if urgent else zenoh.CongestionControl.DROP
        priority = zenoh.Priority.INTERACTIVE_HIGH if urgent else zenoh.Priority.DATA
        try:
            session.put(key_expr, payload, congestion_control=control, priority=priority, express=urgent)
        except zenoh.ZError as error:
            raise LinkDown("the session refused the message") from error

    def subscribe(self, key_expr: str, receive: Receive) -> None:
        """Call `receive(key, payload)` for every sample, now or as soon as there is a session."""
        with self._lock:
            self._subscriptions.append((key_expr, receive))
            if self._session is not None:
                self._declared.append(_declare(self._session, key_expr, receive))

    def answer(self, key_expr: str, receive: Answer) -> None:
        """Call `receive(question, reply)` for every question on `key_expr`; `reply` may be called later, once."""
        with self._lock:
            self._answerers.append((key_expr, receive))
            if self._session is not None:
                self._declared.append(_declare_answerer(self._session, key_expr, receive))

    def ask(self, key_expr: str, question: bytes, timeout_s: float) -> list[bytes]:
        """Ask all who answer on `key_expr`; return their answers, those too long and too many left out.

        It waits until all have answered or declined, at most `timeout_s`.
        """
        session = self._session
        if session is None:
            return []
        channel: zenoh.handlers.FifoChannel[zenoh.Reply] = zenoh.handlers.FifoChannel(ANSWERS_MAX)
        try:
            replies = session.get(
                key_expr,
                channel,
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,  # else one answer a key is left, and not the node's
                timeout=timeout_s,
                payload=question,
            )
            found = [reply.ok.payload.to_bytes() for reply in islice(replies, ANSWERS_MAX) if reply.ok is not None]
        except zenoh.ZError:
            return []
        return [answer for answer in found if len(answer) <= self._answer_bytes_max]

    def _open(self) -> None:
        while not self._stopped.is_set():
            try:
                session = zenoh.open(session_config(*self._settings))
            except zenoh.ZError:
                self._stopped.wait(self._reconnect_s)
                continue
            with self._lock:
                self._declared += [_declare(session, *subscription) for subscription in self._subscriptions]
                self._declared += [_declare_answerer(session, *answerer) for answerer in self._answerers]
                self._session = session
            if self._stopped.is_set():
                session.close()  # type: ignore[no-untyped-call]
            return


def _declare(session: zenoh.Session, key_expr: str, receive: Receive) -> object:
    def on_sample(sample: zenoh.Sample) -> None:
        receive(str(sample.key_expr), sample.payload.to_bytes())

    return session.declare_subscriber(key_expr, on_sample)


def _declare_answerer(session: zenoh.Session, key_expr: str, receive: Answer) -> object:
    def on_query(query: zenoh.Query) -> None:
        payload = query.payload
        receive(payload.to_bytes() if payload is not None else b"", lambda answer: _reply(query, key_expr, answer))

    return session.declare_queryable(key_expr, on_query)


def _reply(query: zenoh.Query, key_expr: str, answer: bytes) -> None:
    with suppress(zenoh.ZError), query:  # whoever asked may be gone
        query.reply(key_expr, answer)
