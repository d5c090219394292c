"""A router with rules, live: what each rule lets through and what it stops, between real sessions and a real process.

That something does not arrive is shown by what was sent after it, on the same link, and did arrive.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import zenoh

from autopilot.adapters.mesh.link import session_config
from autopilot.wire.keys import (
    ack_key,
    acks_of,
    cosign_key,
    order_key,
    orders_of,
    presence_key,
    proof_key,
    status_key,
)
from tests.whole.daemons import wait_for
from tests.whole.relays import Ears, RelayProcess, authority, free_port, listen, plain, put, relaying, session, shown

pytestmark = pytest.mark.whole
WASP, HORNET = "wasp-01", "hornet-02"
LAST = "last"
NO_LIMITS = dict.fromkeys(("orders_hz", "cosignatures_hz", "presence_hz", "acks_hz", "status_hz", "proofs_hz"), 0)
EVERYBODY = {
    "ground": {"side": "ground", "nodes": [WASP]},
    "node": {"side": "node", "nodes": [WASP]},
}


def tables(endpoint: str, **others: Any) -> dict[str, Any]:
    """Return the configuration of a plain router."""
    return {
        "relay": {"mode": "router"},
        "outer": {"listen": [endpoint], **others.pop("outer", {})},
        "rates": NO_LIMITS,
        "who": EVERYBODY,
        **others,
    }


@dataclass
class Mesh:
    """A router and two sessions."""

    relay: RelayProcess
    endpoint: str
    node: zenoh.Session
    ground: zenoh.Session


@pytest.fixture(scope="module")
def mesh(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Mesh]:
    """A router without limits of rate, where everybody may be ground and node of wasp-01."""
    endpoint = plain()
    with ExitStack() as stack:
        relay = stack.enter_context(relaying(tmp_path_factory.mktemp("router"), tables(endpoint)))
        yield Mesh(relay, endpoint, stack.enter_context(session(endpoint)), stack.enter_context(session(endpoint)))


def heard_until(ears: Ears, last: str) -> list[str]:
    """Wait until a key was heard; return all that were heard up to then."""
    ears.wait(lambda: last in ears.keys)
    return ears.keys


def settled(hearer: zenoh.Session, sayer: zenoh.Session, key_expr: str, last: str) -> tuple[Ears, object]:
    """Subscribe, and put until something arrives, so that the subscription is known to be in force."""
    ears, held = listen(hearer, key_expr)

    def arrived() -> bool:
        put(sayer, last)
        return bool(ears.keys)

    wait_for(arrived, f"anything on {key_expr}")
    return ears, held


@pytest.mark.parametrize(
    ("key_expr", "stopped", "passes"),
    [
        (orders_of(WASP), order_key(WASP, "a") + "/b", order_key(WASP, LAST)),
        ("**", order_key(HORNET, "a"), order_key(WASP, LAST)),
        ("**", f"waypoint/global/trust/{WASP}", order_key(WASP, LAST)),
        ("**", "anything", order_key(WASP, LAST)),
        ("**", "@/router/local/config/mode", order_key(WASP, LAST)),
    ],
)
def test_a_key_that_no_rule_names_passes_nowhere(mesh: Mesh, key_expr: str, stopped: str, passes: str) -> None:
    """Not another node's, not a key of our own making, not administration; nor by a subscription to everything."""
    ears, _held = settled(mesh.node, mesh.ground, orders_of(WASP), passes)
    wide, _wide = listen(mesh.node, key_expr)
    put(mesh.ground, stopped)
    before = len(ears.keys)
    put(mesh.ground, passes)
    ears.wait(lambda: len(ears.keys) > before)
    assert set(ears.keys) == {passes}
    assert stopped not in wide.keys


def test_what_is_deleted_passes_nowhere(mesh: Mesh) -> None:
    """A deletion is no sample of ours; Zenoh would deliver it as one without content."""
    last = order_key(WASP, LAST)
    ears, _held = settled(mesh.node, mesh.ground, orders_of(WASP), last)
    mesh.ground.delete(order_key(WASP, "gone"))
    before = len(ears.keys)
    put(mesh.ground, last)
    ears.wait(lambda: len(ears.keys) > before)
    assert set(ears.keys) == {last}


@pytest.mark.parametrize(
    ("key", "limit"),
    [
        (order_key(WASP, "a"), 4096),
        (cosign_key(WASP), 4096),
        (presence_key(WASP, "a"), 4096),
        (ack_key(WASP, "a"), 4096),
        (status_key(WASP), 18_432),
    ],
)
def test_no_sample_is_longer_than_an_envelope_of_its_type(mesh: Mesh, key: str, limit: int) -> None:
    """One byte more is stopped at the door, long before anybody parses it."""
    ears, _held = settled(mesh.node, mesh.ground, key, key)
    put(mesh.ground, key, b"x" * (limit + 1))
    put(mesh.ground, key, b"x" * limit)
    ears.wait(lambda: len(ears.payloads[-1]) == limit)
    assert [len(payload) for payload in ears.payloads if len(payload) > limit] == []


def test_liveliness_passes_nowhere(mesh: Mesh) -> None:
    """A deny of everything has let it through before; here a token is neither seen nor found."""
    ears, last = Ears(), order_key(WASP, LAST)
    _tokens = mesh.node.liveliness().declare_subscriber("**", ears.take)
    orders, _held = settled(mesh.node, mesh.ground, orders_of(WASP), last)
    token = mesh.ground.liveliness().declare_token(order_key(WASP, "alive"))
    before = len(orders.keys)
    put(mesh.ground, last)
    orders.wait(lambda: len(orders.keys) > before)
    assert list(mesh.node.liveliness().get("**", timeout=0.5)) == []
    assert ears.keys == []
    token.undeclare()  # type: ignore[no-untyped-call]


def test_questions_go_to_the_node_and_nowhere_else(mesh: Mesh) -> None:
    """A proof is asked for and answered; a question on another key finds nobody."""

    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, b"answer")

    _answers = mesh.node.declare_queryable(proof_key(WASP), answer)
    _others = mesh.node.declare_queryable("anything", answer)

    def asked(key: str) -> list[bytes]:
        replies = mesh.ground.get(key, timeout=1.0, payload=b"?")
        return [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]

    wait_for(lambda: asked(proof_key(WASP)) == [b"answer"], "an answer")
    assert (asked("anything"), asked(proof_key(HORNET))) == ([], [])


def test_whoever_looks_for_others_finds_nobody(mesh: Mesh) -> None:
    """A peer that gossips and scouts learns of no other session, so it can't go around the rules."""
    looks = {"scouting/gossip/enabled": True, "scouting/gossip/multihop": True}
    with session(mesh.endpoint, "peer", **looks) as stranger:
        ears, _held = settled(mesh.node, stranger, orders_of(WASP), order_key(WASP, LAST))
        put(stranger, order_key(HORNET, "around"))
        before = len(ears.keys)
        put(stranger, order_key(WASP, LAST))
        ears.wait(lambda: len(ears.keys) > before)
        assert (stranger.info.peers_zid(), len(stranger.info.routers_zid())) == ([], 1)
        assert set(ears.keys) == {order_key(WASP, LAST)}


def test_a_flood_is_thinned_at_the_door(tmp_path: Path) -> None:
    """Of one session no more than the rate comes in; the other's order arrives in the middle of it."""
    endpoint = plain()
    config = tables(endpoint, rates=NO_LIMITS | {"orders_hz": 20})
    with (
        relaying(tmp_path, config),
        session(endpoint) as node,
        session(endpoint) as flooder,
        session(endpoint) as ground,
    ):
        ears, _held = settled(node, flooder, orders_of(WASP), order_key(WASP, "flood"))
        sent = 0
        before = len(ears.keys)
        while order_key(WASP, LAST) not in ears.keys:
            for _ in range(500):
                put(flooder, order_key(WASP, "flood"))
            sent += 500
            put(ground, order_key(WASP, LAST))
        arrived = ears.keys[before:].count(order_key(WASP, "flood"))
        assert arrived * 20 < sent


def test_no_more_sessions_than_allowed(tmp_path: Path) -> None:
    """One too many is refused, not served slowly."""
    endpoint = plain()
    config = tables(endpoint, outer={"max_sessions": 1})
    with relaying(tmp_path, config), session(endpoint), pytest.raises(zenoh.ZError):
        zenoh.open(_quick(endpoint))


def _quick(endpoint: str) -> zenoh.Config:
    return session_config("client", connect=[endpoint], over={"connect/timeout_ms": 1000})


def test_an_interface_that_nobody_comes_by_allows_nothing(tmp_path: Path) -> None:
    """Under a default of deny a rule that matches no link is no hole: nothing passes, also what others may do."""
    endpoint = plain()
    who: dict[str, Any] = {
        "node": EVERYBODY["node"],
        "ground": EVERYBODY["ground"] | {"nodes": [HORNET], "interfaces": ["lo"]},
        "elsewhere": EVERYBODY["ground"] | {"interfaces": ["nosuch0"]},
    }
    who["node"] = who["node"] | {"nodes": ["*"]}
    with relaying(tmp_path, tables(endpoint, who=who)), session(endpoint) as node, session(endpoint) as ground:
        ears, _held = listen(node, "waypoint/global/cmd/*/**")

        def arrived() -> bool:
            put(ground, order_key(WASP, "a"))
            put(ground, order_key(HORNET, LAST))
            return bool(ears.keys)

        wait_for(arrived, "what may pass")
        assert set(ears.keys) == {order_key(HORNET, LAST)}


Shown = Callable[[str], str]


@pytest.fixture
def certified(tmp_path: Path) -> Iterator[Shown]:
    """A router with certificates: wasp-01 is a node, alice the ground; the function gives anybody's endpoint."""
    port = free_port()
    papers = authority(tmp_path / "ca", "relay", WASP, "alice", "stranger", "Alice", "alice2")
    others = authority(tmp_path / "other", "alice")
    who = {
        "node": {"side": "node", "nodes": [WASP], "common_names": [WASP]},
        "ground": {"side": "ground", "nodes": [WASP], "common_names": ["alice"]},
    }
    outer = {"listen": [f"tls/127.0.0.1:{port}"], "tls": papers["relay"] | {"mutual": True}}
    config = {"relay": {"mode": "router"}, "outer": outer, "rates": NO_LIMITS, "who": who}
    with relaying(tmp_path, config):
        yield lambda name: shown(port, others["alice"] if name == "forged" else papers[name])


def test_a_certificate_says_what_a_session_may_do(certified: Shown) -> None:
    """The node hears orders and answers; a stranger with a certificate of the same authority does neither."""
    with session(certified(WASP)) as node, session(certified("alice")) as alice:
        orders, _orders = settled(node, alice, orders_of(WASP), order_key(WASP, "first"))
        acks, _acks = settled(alice, node, acks_of(WASP), ack_key(WASP, "first"))
        for name in ("stranger", "Alice", "alice2"):
            with session(certified(name)) as stranger:
                heard, _heard = listen(stranger, acks_of(WASP))
                everything, _everything = listen(stranger, "**")
                put(stranger, order_key(WASP, name))
                put(stranger, ack_key(WASP, name))
                count = len(acks.keys)
                put(node, ack_key(WASP, "first"))
                put(alice, order_key(WASP, LAST))
                orders.wait(lambda: LAST in orders.keys[-1])
                acks.wait(lambda count=count: len(acks.keys) > count)  # type: ignore[misc]
                own = {order_key(WASP, name), ack_key(WASP, name)}  # a session hears itself, without any link
                assert {*heard.keys, *everything.keys} <= own
        assert set(orders.keys) == {order_key(WASP, "first"), order_key(WASP, LAST)}
        assert set(acks.keys) == {ack_key(WASP, "first")}


def test_a_node_may_not_order_and_an_operator_may_not_answer(certified: Shown) -> None:
    """Each does its part only: a stolen drone's link carries no orders, not even to itself."""
    with ExitStack() as stack:
        node, twin = (stack.enter_context(session(certified(WASP))) for _ in range(2))
        alice, other = (stack.enter_context(session(certified("alice"))) for _ in range(2))
        orders, _orders = settled(twin, alice, orders_of(WASP), order_key(WASP, "first"))
        acks, _acks = settled(other, node, acks_of(WASP), ack_key(WASP, "first"))
        put(node, order_key(WASP, "own"))
        put(alice, ack_key(WASP, "own"))
        put(alice, order_key(WASP, LAST))
        put(node, ack_key(WASP, LAST))
        orders.wait(lambda: order_key(WASP, LAST) in orders.keys)
        acks.wait(lambda: ack_key(WASP, LAST) in acks.keys)
        assert order_key(WASP, "own") not in orders.keys
        assert ack_key(WASP, "own") not in acks.keys


def test_another_authoritys_certificate_opens_nothing(certified: Shown) -> None:
    """Not even a session; nor does no certificate."""
    with session(certified("alice")):
        pass
    bare = certified("alice").split(";connect_certificate_file")[0]
    for endpoint in (certified("forged"), bare):
        with pytest.raises(zenoh.ZError):
            zenoh.open(_quick(endpoint))
