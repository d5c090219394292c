"""The operators' link, heard: whose word counts, how often the node is told, and what is dropped and counted."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import pytest
from google.protobuf.message import Message
from hypothesis import given
from hypothesis import strategies as st

from autopilot.adapters.mesh import MeshAdapter
from autopilot.adapters.mesh.hearing import PRESENCES_BURST, Hearing
from autopilot.ports.config import MeshSection
from autopilot.ports.edges import InputClass
from autopilot.trust.book import TrustBook
from autopilot.trust.envelope import MessageType
from autopilot.trust.freshness import TrustClock
from autopilot.trust.identity import Identity
from autopilot.trust.limits import WINDOW_PER_DEVICE
from autopilot.trust.verdict import Sender
from autopilot.wire.keys import presence_key, presences_of
from events.schema.safety_pb2 import OperatorHeard
from events.schema.waypoint_pb2 import DeviceCommand, OperatorPresence, PrincipalKind
from tests.autopilot.trust.papers import HostClocks
from tests.autopilot.trust.world import COMMAND_ID, KEY, NOW_MS, FakeClock, FakeWire, Forge, people, retokened, seeded

PERIOD_MS = 2000
HERE = presence_key("wasp-01", "alice")


@dataclass
class Node:
    """A node's mesh over a fake wire, whose operators have a role."""

    attending: tuple[str, ...] = ("operator",)
    book: TrustBook | None = None
    clock: FakeClock = field(default_factory=FakeClock)
    takes: bool = True
    sent: int = 0

    def __post_init__(self) -> None:
        self.heard: list[tuple[InputClass, Message]] = []
        self.wire = FakeWire()
        self.adapter = MeshAdapter(
            MeshSection(samples_per_s=100_000, samples_burst=100_000),
            people().wasp,
            self.clock,
            lambda *_: None,
            self.offer,
            wire=self.wire,
            random=seeded(5),
            book=self.book,
            attending=self.attending,
        )
        self.adapter.start()

    def offer(self, input_class: InputClass, observation: Message) -> bool:
        """Take an observation, or refuse it."""
        if not self.takes:
            return False
        if isinstance(observation, OperatorHeard):
            self.heard.append((input_class, observation))
        return True

    def presence(self, who: Identity | None = None, key: str = "", **forged: object) -> None:
        """Let a presence come in, a fresh envelope each time."""
        self.sent += 1
        sender = who or people().alice
        values: dict[str, object] = {
            "key_expr": key or presence_key("wasp-01", sender.principal_id),
            "content": OperatorPresence(heard_head_seq=5).SerializeToString(),
            "seq": self.sent,
            "issued_at_ms": self.clock.now_ms,
            "ttl_ms": 3000,
        }
        made = Forge(sender, MessageType.PRESENCE, **(values | forged))  # type: ignore[arg-type]
        self.receive(made.key_expr, made.envelope())

    def order(self, who: Identity | None = None, content: bytes | None = None) -> None:
        """Let an order come in."""
        self.sent += 1
        asked = DeviceCommand(command_id=COMMAND_ID, target_node_pubkey=people().wasp.public_key)
        body = asked.SerializeToString() if content is None else content
        made = Forge(who or people().alice, content=body, seq=self.sent, issued_at_ms=self.clock.now_ms)
        self.adapter.receive(KEY, made.envelope())

    def receive(self, key: str, payload: bytes) -> None:
        """Let a sample of presence come in."""
        self.wire.subscriptions[presences_of("wasp-01")](key, payload)

    def callsigns(self) -> list[str]:
        """Return whom the node was told of."""
        return [message.callsign for _, message in self.heard if isinstance(message, OperatorHeard)]


def check_dropped(node: Node, because: str) -> None:
    """Check that the node was told nothing, and that it is counted by this name, once; nothing is answered."""
    assert node.heard == []
    assert node.adapter.take_rejections() == {f"presence: {because}": 1}
    assert node.wire.puts == []


def test_presence_is_heard_at_once_and_then_thinned() -> None:
    """The first at once; then at most every two seconds, by the monotonic clock; silence says nothing."""
    node = Node()
    node.presence()
    ((input_class, heard),) = node.heard
    assert input_class is InputClass.OUTCOME
    assert heard == OperatorHeard(principal_id="alice", callsign="ALICE")
    for _ in range(PERIOD_MS - 1):
        node.clock.now_ms += 1
    node.presence()
    assert node.callsigns() == ["ALICE"]
    node.clock.now_ms += 1
    node.presence()
    assert node.callsigns() == ["ALICE", "ALICE"]
    assert node.adapter.take_rejections() == {}


@given(st.lists(st.tuples(st.integers(0, 700), st.integers(0, 49)), max_size=200))
def test_however_many_speak_the_node_is_told_at_most_once_a_period(words: list[tuple[int, int]]) -> None:
    """Of fifty people in any order: never twice within the period, and never later than the first word after it."""
    clock, told = FakeClock(), list[int]()

    def offer(input_class: InputClass, observation: Message) -> bool:
        del input_class, observation
        told.append(clock.now_ms)
        return True

    hearing, spoken = Hearing(clock, frozenset({"operator"}), PERIOD_MS / 1000, offer), list[int]()
    for pause_ms, number in words:
        clock.now_ms += pause_ms
        sender = Sender(
            principal_id=f"p{number}", callsign="", kind=PrincipalKind.OPERATOR, roles=("operator",),
            public_key=b"", device_key_id=b"",
        )  # fmt: skip
        assert hearing.hear(sender) == ""
        spoken.append(clock.now_ms)
    assert all(later - earlier >= PERIOD_MS for earlier, later in pairwise(told))
    assert told[:1] == spoken[:1]
    for at_ms in spoken:
        assert any(at_ms - PERIOD_MS < each <= at_ms for each in told)


@pytest.mark.parametrize("content", [None, b"", b"\xff\xff"])
def test_an_order_counts_as_well_also_one_that_cannot_be_read(content: bytes | None) -> None:
    """It is as much a word of a person as presence is, and is thinned with it."""
    node = Node()
    node.order(content=content)
    assert node.callsigns() == ["ALICE"]
    node.presence(people().bob)
    node.order()
    assert node.callsigns() == ["ALICE"]
    node.clock.now_ms += PERIOD_MS
    node.order(people().bob)
    assert node.callsigns() == ["ALICE", "BOB"]


def test_a_viewer_keeps_no_aircraft_in_the_air() -> None:
    """By presence it is counted; by an order it is the order that is answered."""
    node = Node()
    node.presence(people().viewer)
    check_dropped(node, "role")
    node.order(people().viewer)
    assert node.callsigns() == []
    assert node.adapter.take_rejections() == {}


@pytest.mark.parametrize(
    ("attending", "heard"), [((), []), (("pilot",), []), (("operators",), []), (("pilot", "operator"), ["ALICE"])]
)
def test_the_role_is_one_of_either_list_by_its_name(attending: tuple[str, ...], heard: list[str]) -> None:
    """Where nobody may order anything nobody is listened for."""
    node = Node(attending)
    assert (presences_of("wasp-01") in node.wire.subscriptions) == bool(attending)
    if attending:
        node.presence()
    node.order()
    assert node.callsigns() == heard


@pytest.mark.parametrize("kind", [PrincipalKind.NODE, PrincipalKind.SERVICE])
def test_only_an_operator_is_heard(kind: PrincipalKind.ValueType) -> None:
    node = Node()
    node.presence(retokened(people().alice, lambda token: setattr(token, "kind", kind)))
    check_dropped(node, "token_kind")


@pytest.mark.parametrize(
    ("key", "because"),
    [
        (presence_key("wasp-01", "bob"), "unreadable"),
        (presence_key("hornet-02", "alice"), "route"),
        ("waypoint/global/heartbeat/wasp-01/a/alice", "route"),
        ("waypoint/global/heartbeat/wasp-01/", "route"),
        (KEY, "route"),
    ],
)
def test_a_presence_is_its_senders_own_and_for_this_node(key: str, because: str) -> None:
    node = Node()
    node.presence(key=key)
    check_dropped(node, because)


def test_what_is_no_presence_is_none() -> None:
    """Another type, another content, a forged one, one that ran out."""
    node = Node()
    order = Forge(people().alice, key_expr=HERE)
    node.receive(HERE, order.envelope())
    check_dropped(node, "type")
    node.presence(content=b"\xff")
    check_dropped(node, "unreadable")
    node.presence(spoil_envelope=lambda envelope: setattr(envelope, "device_signature", bytes(64)))
    check_dropped(node, "device_sig")
    node.presence(issued_at_ms=NOW_MS - 3000 - 5001)
    check_dropped(node, "clock_stale")
    node.receive(HERE, b"")
    check_dropped(node, "size")


def test_a_captured_presence_is_none() -> None:
    """Within its life by its nonce, then by the clock."""
    node = Node()
    payload = Forge(people().alice, MessageType.PRESENCE, HERE, b"\x08\x05", ttl_ms=3000).envelope()
    node.receive(HERE, payload)
    assert node.callsigns() == ["ALICE"]
    for later_ms, because in ((8000, "replay"), (1, "clock_stale")):
        node.clock.now_ms += later_ms
        node.receive(HERE, payload)
        assert node.adapter.take_rejections() == {f"presence: {because}": 1}
    assert node.callsigns() == ["ALICE"]


def test_what_the_inbox_refuses_is_told_with_the_next_word() -> None:
    """It is not taken as told, and it is counted."""
    node = Node(takes=False)
    node.presence()
    check_dropped(node, "busy")
    node.takes = True
    node.presence()
    assert node.callsigns() == ["ALICE"]


def test_presence_takes_no_room_of_the_orders_nonces() -> None:
    """As many as an order's device may have alive: the next order still passes, and so does the next presence."""
    node = Node()
    node.adapter.restore_window(())
    for _ in range(WINDOW_PER_DEVICE + 88):
        node.presence()
        node.clock.now_ms += 26  # 13 s of memory are 500 of them
    assert node.adapter.take_rejections() == {}
    for _ in range(WINDOW_PER_DEVICE - 400):
        node.order()
    assert (node.adapter.tally().opened, node.adapter.take_rejections()) == (WINDOW_PER_DEVICE - 400, {})


def test_a_flood_is_bounded_and_orders_pass_meanwhile() -> None:
    """The bucket is the presence's own."""
    node = Node()
    for _ in range(PRESENCES_BURST + 5):
        node.receive(HERE, bytes(600))
    counts = node.adapter.take_rejections()
    assert counts == {"presence: parse_env": PRESENCES_BURST, "presence: rate": 5}
    node.order()
    assert (node.adapter.tally().opened, node.callsigns()) == (1, ["ALICE"])


def test_a_node_that_does_not_know_the_time_hears_who_echoes_its_challenge() -> None:
    """So that nobody keeps a link up with what was said before it lost its clock."""
    host = HostClocks(wall_ms=0)
    clock = TrustClock(host, host_trusted=False, random=seeded(3))
    book = TrustBook(people().wasp, clock, record=lambda _: True)
    node = Node(book=book)
    node.presence()
    check_dropped(node, "challenge")
    node.presence(spoil_header=lambda header: setattr(header, "node_challenge", book.challenge()))
    assert node.callsigns() == ["ALICE"]
