"""What Zenoh is told on behalf of a relay: who may say what on which key and in which direction, how large, how often.

Denied is what no rule allows. The rules are made from the table of key expressions (`autopilot.wire.keys`), so that a
key that is not in it passes nowhere; of administration, deletion and liveliness nothing is allowed to anybody. Rules
bind sessions that come over a link; the relay's own session in the same process is not bound.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final, Literal

from autopilot.ground.relay_config import InnerSection, OuterSection, RatesSection, RelayConfig, TlsSection, WhoSection
from autopilot.trust.envelope import envelope_limit
from autopilot.trust.limits import DOCUMENT_BYTES_MAX
from autopilot.wire.keys import (
    ACKS,
    CHANNELS,
    COSIGNATURES,
    DIRECTORY_CHANNELS,
    ORDERS,
    PRESENCE,
    PROOFS,
    STATUS,
    Channel,
    Direction,
)

Side = Literal["node", "ground", "directory"]
Flow = tuple[str, tuple[str, ...]]
Settings = dict[str, object]

QUERY_BYTES_MAX: Final = 4096  # an answer of a proof; a question is far shorter
# Half-open connections keep newcomers out until they are shed, which Zenoh does after 10 s unless it is told.
ACCEPT_MS: Final = 3_000  # a handshake over a satellite link takes a second and a half
ACCEPTS_PENDING: Final = 256  # handshakes at a time
# What a sender does, what a taker does, as Zenoh names it, by the way it crosses the relay's door.
_SAYS: Final = (("ingress", ("put",)), ("egress", ("declare_subscriber",)))
_HEARS: Final = (("egress", ("put",)), ("ingress", ("declare_subscriber",)))
_ASKS: Final = (("ingress", ("query",)), ("egress", ("reply", "declare_queryable")))
_ANSWERS: Final = (("egress", ("query",)), ("ingress", ("reply", "declare_queryable")))


def outer_settings(config: RelayConfig) -> Settings:
    """Return what the outer session is told over the settings that every session has."""
    sides: tuple[Side, ...] = (
        ("ground", "directory") if config.relay.mode == "verifying" else ("node", "ground", "directory")
    )
    return _settings(config, config.outer, sides) | {
        "transport/link/rx/max_message_size": config.outer.max_message_bytes,
    }


def inner_settings(config: RelayConfig) -> Settings:
    """Return the same of the inner session; one that only connects has nobody to bind."""
    assert config.inner is not None
    if config.inner.connect:
        return _tls(config.inner.tls, listens=False)
    return _settings(config, config.inner, ("node",))


def _settings(config: RelayConfig, side: OuterSection | InnerSection, sides: Sequence[Side]) -> Settings:
    who = {name: one for name, one in config.who.items() if one.side in sides}
    return {
        "access_control": access(who),
        "downsampling": downsampling(config.rates),
        "low_pass_filter": low_pass(),
        "transport/unicast/max_sessions": side.max_sessions,
        "transport/unicast/accept_timeout": ACCEPT_MS,
        "transport/unicast/accept_pending": ACCEPTS_PENDING,
        "adminspace/enabled": False,
        "plugins_loading/enabled": False,
        **_tls(side.tls, listens=True),
    }


def access(who: dict[str, WhoSection]) -> Settings:
    """Return the access control: deny, and for each of `who` what its part allows."""
    rules = {name: list(_rules(name, one)) for name, one in who.items()}
    return {
        "enabled": True,  # else all of this is read and nothing is filtered
        "default_permission": "deny",
        "rules": [rule for each in rules.values() for rule in each],
        "subjects": [_subject(name, one) for name, one in who.items()],
        "policies": [{"rules": [rule["id"] for rule in each], "subjects": [name]} for name, each in rules.items()],
    }


def _subject(name: str, who: WhoSection) -> Settings:
    """Return whom it means; an empty list would mean nobody, so what is not given is left out."""
    subject: Settings = {"id": name}
    if who.common_names:
        subject["cert_common_names"] = list(who.common_names)
    if who.interfaces:
        subject["interfaces"] = list(who.interfaces)
    return subject


def _rules(name: str, who: WhoSection) -> Iterable[Settings]:
    for channel in CHANNELS:
        for flow, messages in _part(channel, who.side):
            for message in messages:
                yield {
                    "id": f"{name}:{channel.name}:{flow}:{message}",
                    "permission": "allow",
                    "flows": [flow],
                    "messages": [message],
                    "key_exprs": [_key(channel, node, message) for node in who.nodes],
                }


def _part(channel: Channel, side: Side) -> tuple[Flow, ...]:
    """Return what a side does on a channel; directions in the table are seen from the node."""
    if channel in DIRECTORY_CHANNELS:  # who serves answers and publishes; everybody else asks and hears
        return (*_ANSWERS, *_SAYS) if side == "directory" else (*_ASKS, *_HEARS)
    if side == "directory":
        return ()
    towards = (channel.direction is Direction.IN) == (side == "node")
    if channel.envelope_type is None:
        return _ANSWERS if towards else _ASKS
    return _HEARS if towards else _SAYS


def _key(channel: Channel, node: str, message: str) -> str:
    """Return the keys of a rule. A subscription may be as wide as all orders of a node, a sample has one key."""
    command = "**" if message == "declare_subscriber" else "*"
    pattern = channel.pattern.replace("<deployment>", "*").replace("<device_key_id>", "*").replace("<principal>", "*")
    return pattern.replace("<node>", node).replace("<cmd_id>", command)


def key_of(channel: Channel) -> str:
    """Return the key expression of every sample of a channel."""
    return _key(channel, "*", "put")


def downsampling(rates: RatesSection) -> list[Settings]:
    """Return the limits of what comes in, by kind of key; Zenoh counts each session for itself."""
    limits = (
        (ORDERS, rates.orders_hz),
        (COSIGNATURES, rates.cosignatures_hz),
        (PRESENCE, rates.presence_hz),
        (ACKS, rates.acks_hz),
        (STATUS, rates.status_hz),
        (PROOFS, rates.proofs_hz),
        *((channel, rates.documents_hz) for channel in DIRECTORY_CHANNELS),
    )
    return [
        {
            "id": f"rate:{channel.name}",
            "flows": ["ingress"],
            "messages": _limited(channel),
            "rules": [{"key_expr": key_of(channel), "freq": hz}],
        }
        for channel, hz in limits
        if hz > 0
    ]


def low_pass() -> list[Settings]:
    """Return the limits of size of what comes in: no envelope of its type is longer."""
    return [
        {
            "id": f"size:{channel.name}",
            "flows": ["ingress"],
            "messages": ["query", "reply", "put"] if channel.envelope_type is None else ["put"],
            "key_exprs": [key_of(channel)],
            "size_limit": _limit(channel),
        }
        for channel in CHANNELS
    ]


def _limited(channel: Channel) -> list[str]:
    """Return what of a channel is limited in its rate: what a session sends of itself."""
    if channel.envelope_type is not None:
        return ["put"]
    return ["query", "put"] if channel in DIRECTORY_CHANNELS else ["query"]


def _limit(channel: Channel) -> int:
    """Return the bytes that anything on a channel may have."""
    if channel.envelope_type is not None:
        return envelope_limit(channel.envelope_type)
    return DOCUMENT_BYTES_MAX if channel in DIRECTORY_CHANNELS else QUERY_BYTES_MAX


def _tls(tls: TlsSection | None, *, listens: bool) -> Settings:
    if tls is None:
        return {"transport/link/protocols": ["tcp"]}
    way = "listen" if listens else "connect"
    return {
        "transport/link/protocols": ["tls"],
        "transport/link/tls/root_ca_certificate": tls.authority,
        f"transport/link/tls/{way}_certificate": tls.certificate,
        f"transport/link/tls/{way}_private_key": tls.private_key,
        "transport/link/tls/enable_mtls": tls.mutual,
        "transport/link/tls/close_link_on_expiration": True,
    }
