"""A Directory outside a verifying relay, a node behind it, each a process: what is new reaches the node, and only that.

Then a Directory that lies, in the place of the real one: everything that it says stays outside, each by its counter.
"""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh

from autopilot.adapters.mesh.link import Link
from autopilot.adapters.mesh.trust_client import TrustClient
from autopilot.ground.directory import Directory
from autopilot.ground.directory_papers import open_directory, signed_beacon, signed_bundle
from autopilot.trust import pae
from autopilot.trust.clock import HostClock, wall_ms
from autopilot.trust.documents import sign
from autopilot.trust.fetching import Offered, What
from autopilot.trust.identity import REVOCATIONS_FILE, ROOT_FILE, load_identity
from autopilot.trust.keys import SignKey
from autopilot.trust.limits import DOCUMENT_BYTES_MAX
from autopilot.wire.directory_pb2 import Documents
from autopilot.wire.keys import BUNDLES, EPOCHS, REVOCATIONS, TIMES, TRUST_ROOTS, Channel, orders_of, trust_key
from events.schema.waypoint_pb2 import SignedDoc, TimeBeacon
from tests.whole.daemons import WITHIN_S, ended, log, started, wait_for, write_config
from tests.whole.relays import listen, plain, put, relaying, session
from tests.whole.test_relay_verifying import NODE, packed_by, people, verifying

pytestmark = pytest.mark.whole
AUTOPILOT = [sys.executable, "-m", "autopilot.cli.main"]
CHALLENGE = b"c" * 16


def configured(outer: str, inner: str) -> dict[str, Any]:
    """Return the configuration of a relay that a Directory may connect to."""
    found = verifying(outer, inner)
    found["rates"]["documents_hz"] = 0
    found["who"]["directory"] = {"side": "directory", "nodes": [NODE]}
    return found


@contextmanager
def serving(folder: Path, endpoint: str) -> Iterator[None]:
    """Serve the Directory in a process of its own."""
    command = [*AUTOPILOT, "directory", "serve", "directory", "--connect", endpoint]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, cwd=folder)
    try:
        assert process.stderr is not None
        assert "serving" in process.stderr.readline()
        yield
    finally:
        process.kill()
        process.communicate()


def learned(folder: Path) -> dict[str, Any]:
    """Return what a node's log says of list, epoch, and where its time is from."""
    found: dict[str, Any] = {"list": 0, "epoch": 0, "time": set()}
    for record in log(folder):
        message: Any = record.message
        match record.kind.name:
            case "revocations_taken":
                found["list"] = message.list_version
            case "epoch_taken":
                found["epoch"] = message.epoch_id
            case "time_learned":
                found["time"].add(message.source)
    return found


class Book:
    """Remembers what was offered."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._offers: list[tuple[What, bytes]] = []

    def offer(self, kind: What, data: bytes) -> Offered:
        """Remember."""
        with self._lock:
            self._offers.append((kind, data))
        return Offered.TAKEN

    def kinds(self) -> set[What]:
        """Return the kinds of what was offered."""
        with self._lock:
            return {kind for kind, _ in self._offers}


def test_a_node_behind_it_learns_what_a_directory_outside_says(tmp_path: Path) -> None:
    """Time, list and group key, as they are published and as they are asked for; the relay goes by the list as well."""
    people(tmp_path)
    outer, inner = plain(), plain()
    with ExitStack() as stack:
        relay = stack.enter_context(relaying(tmp_path, configured(outer, inner)))
        stack.enter_context(serving(tmp_path, outer))
        clock, mesh = {"trusted": False}, {"connect": [inner], "reconnect_ms": 100}
        daemon = started(write_config(tmp_path, tmp_path / NODE, mesh=mesh, clock=clock))
        stack.callback(ended, daemon)
        wait_for(lambda: "beacon" in learned(tmp_path)["time"], "the time from the Directory")
        revoke = [*AUTOPILOT, "directory", "revoke", "directory", "bob"]
        subprocess.run(revoke, check=True, capture_output=True, cwd=tmp_path, timeout=WITHIN_S)
        wait_for(lambda: (learned(tmp_path)["list"], learned(tmp_path)["epoch"]) == (2, 2), "the new list and epoch")
        _asks_for_all(load_identity(tmp_path / NODE), inner)
        with session(outer) as outside, session(inner) as inside:
            orders, _orders = listen(inside, orders_of(NODE))
            put(outside, *packed_by(tmp_path, "bob"))

            def arrived() -> bool:
                put(outside, *packed_by(tmp_path, "alice"))
                return bool(orders.keys)

            wait_for(arrived, "an order inside")
        counts = relay.counts()
    assert (counts["orders"]["received"] - counts["orders"]["passed"], counts["orders"]["revoked"]) == (1, 1)
    documents = {channel: counts[channel.name] for channel in (TRUST_ROOTS, REVOCATIONS, EPOCHS, BUNDLES, TIMES)}
    assert all(found["received"] == found["passed"] >= 1 for found in documents.values()), documents
    assert counts["questions"]["answered"] >= 5  # of the node: the time; of the client: each kind once


def _asks_for_all(wasp: Any, endpoint: str) -> None:
    """Ask behind the relay for each kind of document, until all have come."""
    book, link = Book(), Link(connect=[endpoint], answer_bytes_max=DOCUMENT_BYTES_MAX)
    client = TrustClient(link, HostClock(), book.offer, deployment_id="t", device_key_id=wasp.sign_key.key_id)
    client.start()
    link.start()
    try:
        wait_for(link.linked, "the link")

        for what in ("trust_root", "revocations", "epoch"):
            client.request(what)
        client.request("time", CHALLENGE)
        wait_for(lambda: book.kinds() == {"trust_root", "revocations", "epoch", "time"}, "all kinds of documents")
    finally:
        client.stop()
        link.stop()


def lies(made: Directory, tmp_path: Path, older: bytes) -> dict[Channel, dict[str, bytes]]:
    """Return what a liar answers, by the counter that it must end in."""
    stranger, wasp = SignKey.from_seed(b"s" * 32), load_identity(tmp_path / NODE)
    beacon = TimeBeacon.FromString(SignedDoc.FromString(signed_beacon(made, CHALLENGE, 1)).body)
    bundle = signed_bundle(made, made.state.epochs[-1], load_identity(tmp_path / "alice").token)
    body = SignedDoc.FromString(older).body
    return {
        REVOCATIONS: {"old": older, "malformed": older + b"\0", "unsigned": _signed_again(older, stranger)},
        EPOCHS: {
            "foreign": Documents(documents=[bundle]).SerializeToString(),
            "size": bytes(9_000),
            "malformed": body,
            "other_purpose": Documents(documents=[older]).SerializeToString(),
        },
        TIMES: {
            "unsigned": sign(pae.TIME_BEACON, beacon, [stranger]),
            "other_purpose": sign(pae.TIME_BEACON, beacon, [made.purpose_keys["epoch"]]),
            "unasked": signed_beacon(made, b"d" * 16, wall_ms(HostClock())),
            "size": bytes(2_000),
        },
        TRUST_ROOTS: {"malformed": wasp.token_bytes, "size": bytes(20_000)},
    }


def _signed_again(document: bytes, key: SignKey) -> bytes:
    found = SignedDoc.FromString(document)
    found.sigs[0].key_id = key.key_id
    return found.SerializeToString(deterministic=True)


def test_what_a_liar_says_stays_outside(tmp_path: Path) -> None:
    """Forged, old, oversized, for another purpose, for another device: nothing comes in, and each has its counter."""
    made, outer, inner = people(tmp_path), plain(), plain()
    older = (tmp_path / "public" / REVOCATIONS_FILE).read_bytes()
    revoke = [*AUTOPILOT, "directory", "revoke", "directory", "bob"]
    subprocess.run(revoke, check=True, capture_output=True, cwd=tmp_path, timeout=WITHIN_S)
    newer = (tmp_path / "directory" / REVOCATIONS_FILE).read_bytes()
    (tmp_path / "public" / REVOCATIONS_FILE).write_bytes(newer)
    assert (tmp_path / "public" / ROOT_FILE).exists()
    told = lies(open_directory(made.folder), tmp_path, older)
    device = load_identity(tmp_path / NODE).sign_key.key_id
    with ExitStack() as stack:
        relay = stack.enter_context(relaying(tmp_path, configured(outer, inner)))
        liar, inside = stack.enter_context(session(outer)), stack.enter_context(session(inner))
        heard, _heard = listen(inside, trust_key(REVOCATIONS, "t"))
        roots, _roots = listen(inside, trust_key(TRUST_ROOTS, "t"))
        saying: dict[str, bytes] = {}
        held = [_answers(liar, trust_key(channel, "t"), saying) for channel in told]
        for channel, answers in told.items():
            question = {EPOCHS: device, TIMES: CHALLENGE}.get(channel, b"")
            for because, answer in answers.items():
                saying[trust_key(channel, "t")] = answer
                assert _asked(inside, trust_key(channel, "t"), question) == [], (channel.name, because)
            saying.pop(trust_key(channel, "t"))
        for channel in (REVOCATIONS, TRUST_ROOTS):
            for answer in told[channel].values():
                put(liar, trust_key(channel, "t"), answer)

        def came() -> bool:
            put(liar, trust_key(REVOCATIONS, "t"), newer)
            return bool(heard.keys)

        wait_for(came, "the one document that is true")
        assert (set(heard.payloads), roots.payloads, len(held)) == ({newer}, [], 4)
        counts = relay.counts()
    for channel, answers in told.items():
        found = counts[channel.name]
        assert {because: found.get(because, 0) > 0 for because in answers} == dict.fromkeys(answers, True), found
        assert found["received"] == sum(found.values()) - found["received"]
        assert (found["passed"] > 0) == (channel is REVOCATIONS)


def _answers(opened: zenoh.Session, key_expr: str, saying: dict[str, bytes]) -> object:
    """Answer with what is to be said on a key; hold on to what is returned."""

    def on_query(query: zenoh.Query) -> None:
        with query:
            if key_expr in saying:
                query.reply(key_expr, saying[key_expr])

    return opened.declare_queryable(key_expr, on_query)


def _asked(opened: zenoh.Session, key_expr: str, question: bytes) -> list[bytes]:
    """Ask as a node does; return what comes in."""
    replies = opened.get(key_expr, payload=question, timeout=3.0, target=zenoh.QueryTarget.ALL)
    return [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]
