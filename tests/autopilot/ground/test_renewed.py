"""An issuer that stays open takes what is newer: from its folder, from the mesh, and for its next order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from autopilot.adapters.mesh.trust_client import TrustClient
from autopilot.ground import compose
from autopilot.trust.envelope import MessageType
from autopilot.trust.identity import EPOCH_FILE, REVOCATIONS_FILE, TOKEN_FILE, Epoch, Identity, load_identity
from autopilot.trust.keys import digest
from autopilot.trust.verdict import Opened, Rejected
from autopilot.wire.keys import bundle_key
from events.schema.waypoint_pb2 import AuthEnvelope, EnvelopeHeader, IdentityToken, NodeStatus
from tests.autopilot.ground.test_issuer import Desk
from tests.autopilot.trust.papers import HOUR_MS, a_bundle, a_list, epoch_secret
from tests.autopilot.trust.world import NOW_MS, FakeClock, Forge, node_gate, people, retokened


@pytest.fixture
def desk(tmp_path: Path) -> Desk:
    return Desk(tmp_path)


def folder_of(desk: Desk) -> Path:
    """Return the folder of Alice's identity."""
    return desk.issuer._identity.folder


def at_epoch_two() -> Identity:
    """Return wasp-01 as it is when epoch 2 is all that it takes."""
    epoch = Epoch(2, epoch_secret(2), NOW_MS, NOW_MS + 24 * HOUR_MS, 1)
    return replace(people().wasp, epochs={2: epoch})


def asked_of(desk: Desk) -> list[str]:
    """Return what is asked of the Directory from now on, as it comes."""
    asked = list[str]()
    client: Any = desk.issuer._believing._client
    client.request = lambda what, _=None: asked.append(what)
    return asked


def next_header(desk: Desk) -> EnvelopeHeader:
    """Give an order; return the header of its envelope."""
    desk.send()
    return EnvelopeHeader.FromString(AuthEnvelope.FromString(desk.wire.puts[-1][1]).header)


def by_hand(desk: Desk) -> None:
    """Put the next bundle into the folder, as a renewal does."""
    (folder_of(desk) / EPOCH_FILE).write_bytes(a_bundle(2, recipient=people().alice))
    desk.issuer.renew()


def over_the_mesh(desk: Desk) -> None:
    """Have the Directory publish it."""
    taking: TrustClient = desk.issuer._believing._client
    taking._give("epoch", a_bundle(2, recipient=people().alice))


@pytest.mark.parametrize("bring", [by_hand, over_the_mesh])
def test_an_epoch_that_begins_while_it_is_open_seals_its_next_order(desk: Desk, bring: Callable[[Desk], None]) -> None:
    """It opens at a node that has nothing but that epoch; and what the node seals then is opened here."""
    gate = node_gate(at_epoch_two(), FakeClock())
    assert next_header(desk).epoch_id == 1
    assert gate.judge(*desk.wire.puts[-1][:2]) == Rejected("unknown_epoch")
    bring(desk)
    order = desk.send()
    opened = gate.judge(*desk.wire.puts[-1][:2])
    assert isinstance(opened, Opened)
    desk.answer(order, opened.message.digest, at_epoch_two())
    assert order.answer.state == "final"
    desk.tell(NodeStatus(at_ms=5), at_epoch_two())
    assert desk.issuer.status("wasp-01") is not None


def test_a_start_afterwards_has_it_too(desk: Desk) -> None:
    over_the_mesh(desk)
    assert sorted(load_identity(folder_of(desk)).epochs) == [1, 2]


def test_it_listens_for_its_own_bundles_and_asks_for_what_it_hears_of(desk: Desk) -> None:
    """What a node holds that this side lacks is asked for."""
    with desk.issuer:
        assert bundle_key("coast-watch", people().alice.sign_key.key_id) in desk.wire.subscriptions
    desk.issuer.watch("wasp-01")
    asked = asked_of(desk)
    desk.tell(NodeStatus(at_ms=5), at_epoch_two())
    assert asked == ["epoch"]


def test_a_list_that_comes_while_it_is_open_is_gone_by(desk: Desk) -> None:
    """Its own orders say that it is held; who is on it is told that he may nothing; an older one changes nothing."""
    desk.issuer.watch("wasp-01")
    desk.tell(NodeStatus(at_ms=5, command_enabled=True, camera_roles=["operator"]))
    for listed, version, allowed in (
        (a_list(9, "bob"), 9, True),
        (a_list(8), 9, True),
        (a_list(10, "alice"), 10, False),
    ):
        (folder_of(desk) / REVOCATIONS_FILE).write_bytes(listed)
        desk.issuer.renew()
        assert next_header(desk).revocation_version == version
        permitted = desk.issuer.permissions("wasp-01")
        assert permitted is not None
        assert permitted[0].allowed is allowed


def test_a_revoked_node_is_believed_no_more(desk: Desk) -> None:
    desk.issuer.watch("wasp-01")
    (folder_of(desk) / REVOCATIONS_FILE).write_bytes(a_list(9, "wasp-01"))
    desk.issuer.renew()
    desk.tell(NodeStatus(at_ms=5))
    assert desk.issuer.status("wasp-01") is None
    assert desk.issuer.tallies()["status"].rejected["revoked"] == 1


def _token(change: Callable[[IdentityToken], None]) -> bytes:
    return retokened(people().alice, change).token_bytes


def _fresh(token: IdentityToken) -> None:
    token.not_before_ms, token.not_after_ms = NOW_MS + 1, NOW_MS + HOUR_MS
    token.token_id = b"n" * 16
    token.roles[:] = ["pilot"]


def _earlier(token: IdentityToken) -> None:
    token.not_before_ms -= 1


def _anothers(token: IdentityToken) -> None:
    token.device_sign_pk = people().bob.public_key


def test_a_token_that_was_renewed_is_sent_along(desk: Desk) -> None:
    """The newer one, of this device, that the Directory signed; else the one before."""
    fresh = _token(_fresh)
    desk.clock.now_ms += 5
    desk.issuer.watch("wasp-01")
    desk.tell(NodeStatus(at_ms=5, command_enabled=True, camera_roles=["pilot"]))
    for written, carried in (
        (_token(_anothers), people().alice.token_bytes),
        (b"", people().alice.token_bytes),
        (_token(_earlier), people().alice.token_bytes),
        (fresh, fresh),
        (people().alice.token_bytes, fresh),
    ):
        (folder_of(desk) / TOKEN_FILE).write_bytes(written)
        desk.issuer.renew()
        assert next_header(desk).token_digest == digest(carried)
        permitted = desk.issuer.permissions("wasp-01")
        assert permitted is not None
        assert permitted[0].allowed == (carried == fresh)
    assert AuthEnvelope.FromString(desk.wire.puts[-1][1]).token == fresh


def test_what_is_not_believed_changes_nothing(desk: Desk) -> None:
    """A bundle of another device, and one that the Directory did not sign, in the folder and over the mesh."""
    for bad in (a_bundle(2), a_bundle(2, recipient=people().alice, key=people().bob.sign_key), b"", b"\xff"):
        (folder_of(desk) / EPOCH_FILE).write_bytes(bad)
        desk.issuer.renew()
        desk.issuer._believing._client._give("epoch", bad)
        assert next_header(desk).epoch_id == 1


def test_a_forged_header_makes_it_ask_for_nothing(desk: Desk) -> None:
    """Only whose signature holds is listened to."""
    asked = asked_of(desk)
    desk.issuer.watch("wasp-01")
    key = "waypoint/global/status/wasp-01"
    forged = Forge(
        people(2).wasp, MessageType.STATUS, key, spoil_header=lambda header: setattr(header, "revocation_version", 99)
    )
    desk.issuer.receive_status(key, forged.envelope())
    assert asked == []
    assert desk.issuer.send("wasp-01", compose.release())
