"""Cosignatures on the node: from an envelope to a line beside the log, and every way of not getting there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from google.protobuf.message import Message

from autopilot.adapters.mesh import MeshAdapter
from autopilot.node.board import Board
from autopilot.node.cosigned import RECENT_MAX, Cosigned
from autopilot.ports.config import MeshSection
from autopilot.ports.edges import InputClass
from autopilot.trust.cosignatures import COSIGNATURES_MAX, Cosignature, cosign, cosigned, cosigner_name, parted
from autopilot.trust.envelope import MessageType
from autopilot.trust.identity import Identity
from autopilot.trust.keys import SignKey
from autopilot.trust.notes import Checkpoint, sign_note
from autopilot.trust.verdict import Sealed as SealedMessage
from autopilot.wire.keys import cosign_key
from events.records import NO_CAUSE, Record, make_record
from events.schema.flight_pb2 import CheckpointCosigned, InputsDropped
from events.schema.waypoint_pb2 import CheckpointCosignature, PrincipalKind
from projections.describe import describe
from tests.autopilot.node.nodes import Node as LoopNode
from tests.autopilot.trust.world import NOW_MS, FakeWire, Forge, people, retokened
from tests.flights import story
from tests.replay.sealed import Sealed, sealed_story, sealer

KEY = cosign_key("wasp-01")
NOW_S = NOW_MS // 1000
MORE = InputsDropped(input_class="frame", count=1)


@dataclass
class Node:
    """A sealed flight, and the door of its mesh."""

    root: Path
    takes: bool = True
    offered: list[tuple[InputClass, Message]] = field(default_factory=list)
    sent: int = 0

    def __post_init__(self) -> None:
        self.flown: Sealed = sealed_story(self.root, close=False)
        self.sealing = self.flown.sealing
        self.moment = story().moment()
        self.sealing.seal(1)
        self.clock = self.flown.clock
        self.wire = FakeWire()
        self.adapter = MeshAdapter(
            MeshSection(), people().wasp, self.clock, lambda *_: None, self.offer, wire=self.wire, judge=self.judge
        )
        self.adapter.start()

    def judge(self, message: SealedMessage, note: str) -> CheckpointCosigned | str:
        """Judge as the board does."""
        return self.sealing.cosigned.judge(message, note)

    def offer(self, input_class: InputClass, observation: Message) -> bool:
        """Take an observation, or refuse it."""
        self.offered += [(input_class, observation)] * self.takes
        return self.takes

    def send(self, note: str, who: Identity | None = None, key_expr: str = KEY) -> None:
        """Send a cosigned note as somebody, in an envelope that is in order."""
        self.sent += 1
        content = CheckpointCosignature(checkpoint=note).SerializeToString()
        forge = Forge(
            who or people().alice, MessageType.COSIGNATURE, key_expr, content, seq=self.sent, issued_at_ms=NOW_MS
        )
        self.wire.subscriptions[KEY](key_expr, forge.envelope())

    def record(self) -> Record:
        """Make the newest observation durable, as the loop does."""
        observation = self.offered[-1][1]
        record = make_record(self.flown.store.head.seq + 1, NO_CAUSE, self.moment, observation)
        self.flown.append(record)
        self.sealing.cosigned.hear([record])
        return record

    def grow(self) -> None:
        """Record something and sign it."""
        self.flown.append(make_record(self.flown.store.head.seq + 1, NO_CAUSE, self.moment, MORE))
        self.sealing.seal(2)

    def stored(self) -> str:
        """Return the newest checkpoint as it is kept."""
        return self.flown.store.checkpoints()[-1][1]


@pytest.fixture
def node(tmp_path: Path) -> Node:
    return Node(tmp_path)


def by(who: Identity, note: str, time_s: int = NOW_S, name: str = "", key: SignKey | None = None) -> str:
    """Return a checkpoint with somebody's line under it."""
    text, bare, _ = parted(note)
    name = name or cosigner_name("coast-watch", who.principal_id)
    return cosigned(bare, [cosign(text, name, key or who.sign_key, time_s)])


def check_taken(node: Node, who: Identity, note: str) -> CheckpointCosigned:
    """Check that a cosignature becomes an observation, then a line under the checkpoint."""
    before = len(node.offered)
    node.send(by(who, note), who)
    assert node.adapter.take_rejections() == {}
    ((input_class, observation),) = node.offered[before:]
    assert isinstance(observation, CheckpointCosigned)
    assert (input_class, observation.witness.principal_id) == (InputClass.OUTCOME, who.principal_id)
    assert observation.token == who.token_bytes
    node.record()
    return observation


def check_refused(node: Node, note: str, because: str, who: Identity | None = None) -> None:
    """Check that it is dropped by this name, and changes nothing."""
    before = (list(node.offered), node.flown.store.checkpoints(), node.sealing.cosigned.newest)
    node.send(note, who)
    assert node.adapter.take_rejections() == {f"cosign: {because}": 1}
    assert (node.offered, node.flown.store.checkpoints(), node.sealing.cosigned.newest) == before


def test_a_cosignature_is_recorded_and_kept(node: Node) -> None:
    """A viewer's too; the status names the newest."""
    note = node.sealing.newest
    size = len(story().records)
    said = check_taken(node, people().viewer, note)
    assert (said.size, said.origin, said.cosigned_at_s) == (size, "waypoint/coast-watch/wasp-01/1", NOW_S)
    assert describe(node.record()).startswith("VIC cosigned")
    assert node.stored() == by(people().viewer, note)
    assert node.sealing.newest == note  # what is published stays the log's own word
    check_taken(node, people().alice, note)
    assert [line.name.rpartition("/")[2] for line in parted(node.stored())[2]] == ["vic", "alice"]
    assert node.sealing.cosigned.newest == (size, "alice")


def test_a_repeat_is_old(node: Node) -> None:
    """The same size by the same witness, in an envelope of its own; also after a start, which reads what is kept."""
    note = node.sealing.newest
    check_taken(node, people().alice, note)
    check_refused(node, by(people().alice, note), "old")
    again = sealer(node.clock).open(node.flown.flight, node.flown.store, node.flown.state)
    assert (again.refusal, again.newest, again.cosigned.newest) == ("", note, node.sealing.cosigned.newest)
    node.sealing = again
    check_refused(node, by(people().alice, note), "old")
    check_taken(node, people().bob, note)
    assert [line.name.rpartition("/")[2] for line in parted(node.stored())[2]] == ["alice", "bob"]
    node.grow()
    check_taken(node, people().alice, node.sealing.newest)
    check_refused(node, by(people().alice, note), "old")


def test_two_that_met_are_kept_once(node: Node) -> None:
    """Both were judged before the first was durable."""
    note = node.sealing.newest
    node.send(by(people().alice, note))
    node.send(by(people().alice, note, NOW_S + 1))
    assert len(node.offered) == 2
    node.record()
    node.offered.pop()
    kept = node.stored()
    node.record()
    assert (node.stored(), len(parted(kept)[2])) == (kept, 1)


def test_another_text_of_the_same_size_is_kept_once(node: Node) -> None:
    """A silent log is signed anew; what was cosigned first stays, and the log holds both."""
    first = node.sealing.newest
    node.sealing.seal(99)
    check_taken(node, people().alice, first)
    assert node.stored() == by(people().alice, first)
    second = sign_note(parted(first)[0].replace("flight_ns 1", "flight_ns 99"), *_log_key(node))
    check_taken(node, people().bob, second)
    assert node.stored() == by(people().alice, first)


def test_the_newest_that_is_shown_is_the_largest(node: Node) -> None:
    """An older checkpoint may be cosigned after it."""
    first = node.sealing.newest
    node.grow()
    check_taken(node, people().alice, node.sealing.newest)
    shown = node.sealing.cosigned.newest
    check_taken(node, people().bob, first)
    assert (node.sealing.cosigned.newest, shown is not None) == (shown, True)


def test_lines_under_a_note_are_bounded(node: Node) -> None:
    """The log holds them all; the note as many as one may have."""
    note = node.sealing.newest
    for number in range(COSIGNATURES_MAX + 1):
        who = f"waypoint/coast-watch/w-{number}"
        said = CheckpointCosigned(origin=_log_key(node)[0], size=len(story().records))
        said.checkpoint = by(people().alice, note, name=who)
        node.offered.append((InputClass.OUTCOME, said))
        node.record()
    assert len(parted(node.stored())[2]) == COSIGNATURES_MAX


def _log_key(node: Node) -> tuple[str, SignKey]:
    return "waypoint/coast-watch/wasp-01/1", node.sealing._key


UNKIND: dict[str, tuple[str, Callable[[Node, str], str]]] = {
    "no note": ("unreadable", lambda *_: "nothing"),
    "no line": ("unreadable", lambda _, note: note),
    "two lines": ("unreadable", lambda _, note: by(people().alice, note) + _line(people().bob, note).line()),
    "a text that is no checkpoint": (
        "unreadable",
        lambda node, _: by(people().alice, sign_note("x\n", *_log_key(node))),
    ),
    "another flight": ("another log", lambda node, _: _said(node, origin="waypoint/coast-watch/wasp-01/2")),
    "another node": ("another log", lambda node, _: _said(node, origin="waypoint/coast-watch/hornet-02/1")),
    "not the log's": ("not signed here", lambda node, _: _said(node, key=people().alice.sign_key)),
    "another's line": ("signature", lambda _, note: by(people().bob, note)),
    "another's key": ("signature", lambda _, note: by(people().alice, note, key=people().bob.sign_key)),
    "another name": ("signature", lambda _, note: by(people().alice, note, name="waypoint/coast-watch/al")),
    "another text": ("signature", lambda node, note: cosigned(note, [_line(people().alice, _said(node, flight_ns=5))])),
    "a time behind": ("time", lambda _, note: by(people().alice, note, NOW_S - 36)),
    "a time ahead": ("time", lambda _, note: by(people().alice, note, NOW_S + 6)),
    "more than there is": ("beyond this log", lambda node, _: _said(node, more=1)),
    "another history": ("another root", lambda node, _: _said(node, root=bytes(32))),
    "none that was signed": ("old", lambda node, _: _said(node, more=-1)),
}


def _line(who: Identity, note: str) -> Cosignature:
    (line,) = parted(by(who, note))[2]
    return line


def _said(
    node: Node,
    *,
    origin: str = "waypoint/coast-watch/wasp-01/1",
    key: SignKey | None = None,
    more: int = 0,
    root: bytes = b"",
    flight_ns: int = 1,
) -> str:
    """Return Alice's line under a checkpoint that the log's key signed, or another."""
    root = root or node.sealing._peaks.root()
    checkpoint = Checkpoint(origin, len(story().records) + more, root, flight_ns)
    return by(people().alice, sign_note(checkpoint.text(), origin, key or node.sealing._key))


@pytest.mark.parametrize("name", UNKIND)
def test_what_is_not_taken_is_named(node: Node, name: str) -> None:
    because, said = UNKIND[name]
    check_refused(node, said(node, node.sealing.newest), because)


@pytest.mark.parametrize("time_s", [NOW_S - 35, NOW_S + 5])
def test_the_bounds_of_time_are_inside(node: Node, time_s: int) -> None:
    node.send(by(people().alice, node.sealing.newest, time_s))
    assert len(node.offered) == 1


def test_who_may_not(node: Node) -> None:
    """Nobody without a role, no node, nobody of another Directory; nothing on another node's key."""
    note = node.sealing.newest
    bare = retokened(people().alice, lambda token: token.ClearField("roles"))
    check_refused(node, by(bare, note), "no role", bare)
    check_refused(node, by(people().hornet, note), "token_kind", people().hornet)
    check_refused(node, by(people(2).alice, note), "token_sig", people(2).alice)
    node.send(by(people().alice, note), key_expr=cosign_key("hornet-02"))
    assert node.adapter.take_rejections() == {"cosign: route": 1}
    service = retokened(people().bob, lambda token: setattr(token, "kind", PrincipalKind.SERVICE))
    check_taken(node, service, note)


def test_garbage_and_floods_are_counted(node: Node) -> None:
    """Before anything is parsed that is not signed, and at a bounded rate."""
    receive = node.wire.subscriptions[KEY]
    receive(KEY, b"\xff" * 300)
    forge = Forge(people().alice, MessageType.COSIGNATURE, KEY)
    receive(KEY, Forge(people().alice, MessageType.COSIGNATURE, KEY, content=b"").envelope())
    receive(KEY, Forge(people().alice, MessageType.ORDER, KEY, seq=5).envelope())
    receive(KEY, Forge(people().alice, MessageType.COSIGNATURE, KEY, content=b"\x0a\x02\xff\xfe", seq=6).envelope())
    receive(KEY, forge.envelope())
    for _ in range(20):
        receive(KEY, b"")
    found = node.adapter.take_rejections()
    assert found == {
        "cosign: parse_env": 1, "cosign: rate": 15, "cosign: replay": 1, "cosign: size": 5,
        "cosign: type": 1, "cosign: unreadable": 2,
    }  # fmt: skip
    assert node.offered == []


def test_a_full_inbox_is_said(node: Node) -> None:
    node.takes = False
    check_refused(node, by(people().alice, node.sealing.newest), "busy")


def test_only_the_newest_are_remembered(node: Node) -> None:
    """Memory does not grow with the flight."""
    first = node.sealing.newest
    check_taken(node, people().bob, first)
    for _ in range(RECENT_MAX):
        node.grow()
    assert node.sealing.cosigned._notes == {}
    check_refused(node, by(people().alice, first), "old")
    assert len(node.sealing.cosigned._roots) == RECENT_MAX
    check_taken(node, people().alice, node.sealing.newest)


def test_what_is_about_another_log_is_recorded_and_not_kept(node: Node) -> None:
    """The flight was over before it was recorded."""
    before = node.flown.store.checkpoints()
    other = Cosigned("waypoint/coast-watch/wasp-01/9", bytes(32), node.flown.store, node.clock)
    node.send(by(people().alice, node.sealing.newest))
    record = make_record(0, NO_CAUSE, node.moment, node.offered[-1][1])
    other.hear([record])
    assert (node.flown.store.checkpoints(), other.newest) == (before, None)


def test_without_a_log_nothing_is_cosigned(begin: Callable[..., LoopNode]) -> None:
    """Also the status says nothing then."""
    board = Board(lambda: 5)
    board.follow(begin().start().session)
    assert board.judge_cosignature(None, "") == "no log"  # type: ignore[arg-type]
    assert board.node_status().cosigned_by == ""
