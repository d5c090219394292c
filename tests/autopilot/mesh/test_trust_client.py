"""Documents are fetched from a mesh where anybody may answer, and from a folder; the book judges, here a fake one."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from autopilot.adapters.mesh.lane import WAITING_MAX
from autopilot.adapters.mesh.trust_client import DOCUMENTS_MAX, TAKEN_BURST, TrustClient
from autopilot.adapters.mesh.trust_folder import TrustFolder
from autopilot.trust.fetching import Fetch, Offered, What
from autopilot.trust.limits import DOCUMENT_BYTES_MAX
from autopilot.wire.directory_pb2 import Documents
from tests.autopilot.trust.world import FakeClock, FakeWire

DEVICE = b"d" * 16
PREFIX = "waypoint/global/trust/coast-watch"
WAIT_S = 20


class Book:
    """Takes all that is offered, and remembers it."""

    def __init__(self) -> None:
        self.offers: list[tuple[What, bytes]] = []
        self.came = threading.Semaphore(0)

    def offer(self, kind: What, data: bytes) -> Offered:
        """Remember."""
        self.offers.append((kind, data))
        self.came.release()
        return Offered.TAKEN

    def wait(self, count: int) -> list[tuple[What, bytes]]:
        """Return what was offered when so much has come."""
        for _ in range(count):
            assert self.came.acquire(timeout=WAIT_S), self.offers
        return self.offers


class Gate(FakeWire):
    """A wire whose answers wait until they are let through."""

    def __init__(self) -> None:
        super().__init__()
        self.asking, self.open = threading.Event(), threading.Event()

    def ask(self, key_expr: str, question: bytes, timeout_s: float) -> list[bytes]:
        """Wait."""
        self.asking.set()
        assert self.open.wait(WAIT_S)
        return super().ask(key_expr, question, timeout_s)


def client(wire: FakeWire, book: Book, clock: FakeClock | None = None) -> TrustClient:
    """Return a client of wasp's, started."""
    made = TrustClient(wire, clock or FakeClock(), book.offer, deployment_id="coast-watch", device_key_id=DEVICE)
    made.start()
    return made


def settled(made: TrustClient) -> dict[str, int]:
    """Return the counts when everything that was begun is done."""
    done = threading.Semaphore(0)
    for lane in made._lanes.values():
        assert lane.put(lambda: done.release())
    for _ in made._lanes:
        assert done.acquire(timeout=WAIT_S)
    made.stop()
    return dict(made.counts())


def several(*found: bytes) -> bytes:
    """Encode an answer of several documents."""
    return Documents(documents=found).SerializeToString(deterministic=True)


@pytest.mark.parametrize(
    ("what", "challenge", "place", "question", "answer", "offered"),
    [
        ("trust_root", None, "trust_root", b"", b"root", [b"root"]),
        ("revocations", None, "revocations", b"", b"list", [b"list"]),
        ("epoch", None, "epoch", DEVICE, several(b"one", b"two"), [b"one", b"two"]),
        ("time", b"c" * 16, "time", b"c" * 16, b"beacon", [b"beacon"]),
    ],
)
def test_what_is_asked_for_is_offered(
    what: What, challenge: bytes | None, place: str, question: bytes, answer: bytes, offered: list[bytes]
) -> None:
    """From whoever answers: two did."""
    wire, book = FakeWire(answers=[answer, answer]), Book()
    made = client(wire, book)
    made.request(what, challenge)
    assert settled(made) == {f"{what}: taken": 2 * len(offered)}
    assert (book.offers, wire.asked) == ([(what, each) for each in offered * 2], [(f"{PREFIX}/{place}", question)])


def test_what_is_published_is_offered() -> None:
    """A new bundle for this device comes on a key of its own."""
    wire, book = FakeWire(), Book()
    made = client(wire, book)
    assert sorted(wire.subscriptions) == [
        f"{PREFIX}/epoch/{DEVICE.hex()}",
        f"{PREFIX}/revocations",
        f"{PREFIX}/trust_root",
    ]
    for key, receive in wire.subscriptions.items():
        receive(key, key.encode())
    assert sum(settled(made).values()) == 3
    assert {kind for kind, _ in book.offers} == {"trust_root", "revocations", "epoch"}


def test_a_challenge_goes_with_the_time_and_only_there() -> None:
    """Else nothing is asked."""
    wire, book = FakeWire(answers=[b"x"]), Book()
    made = client(wire, book)
    for what, challenge in (("time", None), ("time", b"c" * 15), ("epoch", b"c" * 16)):
        made.request(what, challenge)  # type: ignore[arg-type]
    assert settled(made) == {"time: unasked": 2, "epoch: unasked": 1}
    assert wire.asked == []


def test_a_flood_is_bounded_in_room_and_rate() -> None:
    """What waits, and what is verified; the time passes by on its own lane."""
    wire, book, clock = Gate(), Book(), FakeClock()
    made = client(wire, book, clock)
    made.request("revocations")
    assert wire.asking.wait(WAIT_S)
    receive = wire.subscriptions[f"{PREFIX}/revocations"]
    for _ in range(100):
        receive("", b"x")
    assert made.counts() == {"revocations: busy": 100 - WAITING_MAX}
    wire.open.set()
    for _ in range(100):
        book.wait(1) if len(book.offers) < WAITING_MAX else None
    assert len(book.offers) == WAITING_MAX
    for _ in range(TAKEN_BURST - WAITING_MAX + 1):
        made._give("revocations", b"x")
    assert made.counts()["revocations: rate"] == 1
    clock.now_ms += 200
    made._give("revocations", b"x")
    assert settled(made)["revocations: rate"] == 1


def test_the_time_does_not_wait_for_documents() -> None:
    """Its journey is its uncertainty."""
    wire, book = Gate(), Book()

    def ask(key_expr: str, question: bytes, timeout_s: float) -> list[bytes]:
        return [b"beacon"] if key_expr.endswith("time") else Gate.ask(wire, key_expr, question, timeout_s)

    wire.ask = ask  # type: ignore[method-assign]
    made = client(wire, book)
    made.request("revocations")
    assert wire.asking.wait(WAIT_S)
    made.request("time", b"c" * 16)
    assert book.wait(1) == [("time", b"beacon")]
    wire.open.set()
    settled(made)


@pytest.mark.parametrize(
    "answer", [b"\xff", several(*[b"x"] * (DOCUMENTS_MAX + 1)), several(b"x") + b"\x10\x00", several(b"x")[:-1]]
)
def test_bundles_in_no_order_are_counted(answer: bytes) -> None:
    """Nothing of it is offered."""
    wire, book = FakeWire(answers=[answer]), Book()
    made = client(wire, book)
    made.request("epoch")
    assert (settled(made), book.offers) == ({"epoch: malformed": 1}, [])


def test_what_is_too_large_or_missing_is_counted() -> None:
    """The longest document passes."""
    wire, book = FakeWire(answers=[bytes(DOCUMENT_BYTES_MAX + 1), bytes(DOCUMENT_BYTES_MAX)]), Book()
    made = client(wire, book)
    made.request("revocations")
    assert settled(made) == {"revocations: size": 1, "revocations: taken": 1}
    made = client(FakeWire(), book)
    made.request("revocations")
    assert settled(made) == {"revocations: unanswered": 1}


def test_a_stopped_client_stops_at_once_however_much_waits() -> None:
    """Nothing more is offered."""
    wire, book = Gate(), Book()
    made = client(wire, book)
    made.request("revocations")
    assert wire.asking.wait(WAIT_S)
    for _ in range(WAITING_MAX):
        wire.subscriptions[f"{PREFIX}/revocations"]("", b"x")
    wire.open.set()
    made.stop()
    assert not made._lanes["documents"]._thread.is_alive()


def filled(folder: Path, **files: bytes) -> Path:
    """Write files as an export does."""
    folder.mkdir(exist_ok=True)
    for name, data in files.items():
        (folder / name).with_suffix(".part").write_bytes(data)
        (folder / name).with_suffix(".part").replace(folder / name)
    return folder


def test_a_folder_is_offered_when_it_changes(tmp_path: Path) -> None:
    """All of it, the root first: it may be what another file waited for."""
    book = Book()
    made = TrustFolder(tmp_path / "stick", book.offer)
    made.look()
    assert book.offers == []
    filled(tmp_path / "stick", epoch=b"e", revocations=b"r", token=b"t")
    made.look()
    made.look()
    assert book.offers == [("revocations", b"r"), ("epoch", b"e")]
    filled(tmp_path / "stick", trust_root=b"t")
    made.look()
    assert book.offers[2:] == [("trust_root", b"t"), ("revocations", b"r"), ("epoch", b"e")]
    filled(tmp_path / "stick", epoch=bytes(DOCUMENT_BYTES_MAX + 1))
    made.look()
    assert (made.counts()["epoch: size"], made.counts()["epoch: taken"]) == (1, 2)


def test_a_folder_is_watched(tmp_path: Path) -> None:
    """A request looks now, whatever was asked for."""
    book = Book()
    made = TrustFolder(tmp_path, book.offer, look_every_s=WAIT_S)
    made.start()
    filled(tmp_path, revocations=os.urandom(8))
    made.request("epoch")
    assert book.wait(1)[0][0] == "revocations"
    made.stop()
    assert not made._watcher.is_alive()


def test_both_are_what_the_book_asks_through(tmp_path: Path) -> None:
    """The seam's Protocol."""
    ways: tuple[Callable[[], Fetch], ...] = (
        lambda: TrustClient(FakeWire(), FakeClock(), Book().offer, deployment_id="d", device_key_id=DEVICE),
        lambda: TrustFolder(tmp_path, Book().offer),
    )
    for way in ways:
        way().request("revocations")
