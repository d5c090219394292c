"""A mission office over HTTP: hands out missions, takes waypoints for their middle, and misbehaves on demand.

`python -m autopilot.sim.office --port 8088 examples/missions/field.json` says "ready" and its address on stdout and
serves until SIGTERM; all is bound to loopback.

| request | answer |
|---|---|
| `GET /missions/ID` | 200 with the mission and its ETag; 304 where If-None-Match has it; 404 |
| `POST /missions/ID/waypoints` with `{"id", "at", "before"}` | 201, and the mission has another revision |
| `POST /missions/ID/mapobjects` with a MapObjectsBundle of seed 004 | 201; what it has under an id already it keeps |
| the same again (Idempotency-Key) | 200, and nothing changed; another body under that key: 422 |
| `GET /missions/ID/mapobjects` | 200 with the observations and ignored items that it was given |

`before` is the id of the item before which the waypoint goes; without it, it goes last, but for a return. With a token
everything else is 401. It knows JSON and no more of a mission than its items' ids: judging it is the reader's part.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import signal
import threading
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

LOOPBACK = "127.0.0.1"
BODY_BYTES_MAX = 65_536  # of a POST: one waypoint
BUNDLE_BYTES_MAX = 1_048_576  # of a POST with what was seen
DRAINED_BYTES_MAX = 1 << 24  # of a POST that is too long
KEYS_MAX = 1024  # idempotency keys that are remembered
SLOW_STEP_S = 0.1
SEEN = ("observations", "ignored_items")  # what a node pushes after a flight


@dataclass(slots=True)
class Faults:
    """How the office misbehaves; set them while it runs. Counts go down by one with each request that they spoil."""

    failing: int = 0  # answers 500
    dropping: int = 0  # does what is asked, and says nothing
    refusing: int = 0  # answers 409
    truncated: int = 0  # sends half a mission and hangs up
    slow_s: float = 0.0  # seconds from request to answer
    other_major: bool = False  # the mission's schema_version becomes 2.0.0
    padding_bytes: int = 0  # blanks behind the mission: more than anybody takes
    no_etag: bool = False

    def spoil(self, name: str) -> bool:
        """Whether this request is spoilt that way."""
        left: int = getattr(self, name)
        if left > 0:
            setattr(self, name, left - 1)
        return left > 0


@dataclass(slots=True)
class _Kept:
    """A mission with its revision, and what was answered under which key."""

    tree: dict[str, Any]
    revision: int = 1
    answered: dict[str, tuple[bytes, dict[str, Any]]] = field(default_factory=dict)
    seen: dict[str, dict[str, Any]] = field(default_factory=lambda: {name: {} for name in SEEN})  # by list and by id


class Office:
    """Serves missions on a thread of its own; `start`, look at `url`, `stop`."""

    def __init__(self, missions: Sequence[dict[str, Any]] = (), token: str = "") -> None:
        self.faults = Faults()
        self.token = token
        self.asked: Counter[str] = Counter()  # requests, by method
        self.answered: Counter[int] = Counter()  # answers, by status
        self._lock = threading.Lock()
        self._missions = {str(tree["mission_id"]).lower(): _Kept(tree) for tree in missions}
        self._closing = threading.Event()
        self._server: _Server | None = None
        self._thread: threading.Thread | None = None

    @property
    def url(self) -> str:
        """Return where it is, once it is started."""
        assert self._server is not None
        return f"http://{LOOPBACK}:{self._server.server_address[1]}"

    def start(self, port: int = 0) -> None:
        """Listen; 0 lets the system choose. Raises OSError where the port is taken."""
        self._server = _Server(self, port)
        self._thread = threading.Thread(target=self._server.serve_forever, name="office", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Close; slow answers are cut short."""
        self._closing.set()
        if self._server is not None:
            self._server.shutdown()
            self._server.server_close()
        if self._thread is not None:
            self._thread.join(timeout=5)

    def put(self, tree: dict[str, Any]) -> None:
        """Take a mission, or another revision of one."""
        with self._lock:
            known = self._missions.setdefault(str(tree["mission_id"]).lower(), _Kept(tree, revision=0))
            known.tree = tree
            known.revision += 1

    def mission(self, mission_id: str) -> dict[str, Any]:
        """Return a mission as it is now. Raises KeyError."""
        with self._lock:
            tree: dict[str, Any] = json.loads(json.dumps(self._missions[mission_id].tree))
        return tree

    def get(self, mission_id: str) -> tuple[bytes, str] | None:
        """Return a mission's bytes and its ETag; None: there is none."""
        with self._lock:
            known = self._missions.get(mission_id.lower())
            if known is None:
                return None
            tree = known.tree | ({"schema_version": "2.0.0"} if self.faults.other_major else {})
            data = json.dumps(tree, indent=2).encode()
            return data, f'"{known.revision}-{hashlib.sha256(data).hexdigest()[:16]}"'

    def mapobjects(self, mission_id: str) -> dict[str, Any] | None:
        """Return what was seen in a mission, in the order in which it came; None: there is no such mission."""
        with self._lock:
            known = self._missions.get(mission_id.lower())
            if known is None:
                return None
            seen = {name: list(rows.values()) for name, rows in known.seen.items()}
            return {"mission_id": known.tree["mission_id"], **seen}

    def post(self, mission_id: str, what: str, key: str, body: bytes) -> tuple[int, dict[str, Any]]:
        """Take a waypoint for the middle of a mission, or what was seen in it; return status and answer."""
        with self._lock:
            known = self._missions.get(mission_id.lower())
            if known is None:
                return HTTPStatus.NOT_FOUND, {"error": "there is no such mission"}
            if key in known.answered:
                before, answer = known.answered[key]
                same = before == hashlib.sha256(body).digest()
                return (200, answer) if same else (422, {"error": "this Idempotency-Key came with another body"})
            status, answer = _TAKERS[what](known, body)
            if status == HTTPStatus.CREATED and key:
                known.answered[key] = hashlib.sha256(body).digest(), answer
                if len(known.answered) > KEYS_MAX:
                    known.answered.pop(next(iter(known.answered)))
            return status, answer

    def rest(self) -> None:
        """Wait as long as `slow_s` says, or until it is switched off or the office closes."""
        waited_s = 0.0
        while waited_s < self.faults.slow_s and not self._closing.wait(SLOW_STEP_S):
            waited_s += SLOW_STEP_S


def _inserted(known: _Kept, body: bytes) -> tuple[int, dict[str, Any]]:
    """Put the waypoint that a body describes where it belongs; return status and answer."""
    try:
        asked = json.loads(body)
        item = {"id": asked["id"], "kind": "waypoint", "at": asked["at"]}
    except (ValueError, TypeError, KeyError):
        return HTTPStatus.BAD_REQUEST, {"error": "a waypoint has id and at"}
    items = known.tree["items"]
    ids = [one["id"] for one in items]
    if item["id"] in ids:
        return HTTPStatus.CONFLICT, {"error": "there is an item with this id"}
    goes = asked.get("before")
    if goes is not None and goes not in ids:
        return HTTPStatus.CONFLICT, {"error": "there is no item to go before: the mission has changed"}
    last = len(items) - (items[-1]["kind"] == "return")
    place = last if goes is None else ids.index(goes)
    known.tree = known.tree | {"items": [*items[:place], item, *items[place:]]}
    known.revision += 1
    return HTTPStatus.CREATED, {"mission_id": known.tree["mission_id"], "revision": known.revision}


def _taken(known: _Kept, body: bytes) -> tuple[int, dict[str, Any]]:
    """Keep what was seen, each by its id; return status and answer."""
    try:
        bundle = json.loads(body)
        major, mission_id = bundle["schema_version"].partition(".")[0], bundle["mission_id"]
        rows = {name: {row["id"]: row for row in bundle[name]} for name in SEEN}
    except (ValueError, TypeError, KeyError, AttributeError):
        return HTTPStatus.BAD_REQUEST, {"error": "a bundle has schema_version, mission_id, observations, ignored_items"}
    if major != "1" or mission_id.lower() != known.tree["mission_id"].lower():
        return HTTPStatus.CONFLICT, {"error": "this is of another schema or another mission"}
    for name in SEEN:
        known.seen[name] |= {key: row for key, row in rows[name].items() if key not in known.seen[name]}
    return HTTPStatus.CREATED, {name: len(rows[name]) for name in SEEN}


_TAKERS = {"waypoints": _inserted, "mapobjects": _taken}


class _Server(ThreadingHTTPServer):
    """A server that knows its office."""

    daemon_threads = True

    def __init__(self, office: Office, port: int) -> None:
        self.office = office
        super().__init__((LOOPBACK, port), _Handler)


class _Handler(BaseHTTPRequestHandler):
    """One request after the other, HTTP/1.1."""

    protocol_version = "HTTP/1.1"
    timeout = 30.0

    @property
    def _office(self) -> Office:
        """Return whose connection it is."""
        assert isinstance(self.server, _Server)
        return self.server.office

    def do_GET(self) -> None:
        """Hand out a mission, or what was seen in it."""
        parts = self._begin("GET")
        if parts is not None and parts[2:] == ["mapobjects"]:
            seen = self._office.mapobjects(parts[1])
            none = {"error": "there is no such mission"}
            self._answer(HTTPStatus.NOT_FOUND if seen is None else HTTPStatus.OK, none if seen is None else seen)
            return
        found = self._office.get(parts[1]) if parts is not None and len(parts) == 2 else None
        if parts is None:
            return
        if found is None:
            self._answer(HTTPStatus.NOT_FOUND, {"error": "there is no such mission"})
            return
        data, etag = found
        if self.headers.get("If-None-Match") == etag and not self._office.faults.no_etag:
            self._send(HTTPStatus.NOT_MODIFIED, b"", etag)
            return
        self._send(HTTPStatus.OK, data + b" " * self._office.faults.padding_bytes, etag)

    def do_POST(self) -> None:
        """Take a waypoint, or what was seen."""
        longest = BUNDLE_BYTES_MAX if self.path.endswith("/mapobjects") else BODY_BYTES_MAX
        length = self.headers.get("Content-Length", "")
        if not (length.isascii() and length.isdigit() and int(length) <= longest):
            self.close_connection = True
            if length.isascii() and length.isdigit():  # what is still on its way would drown the answer
                self.rfile.read(min(int(length), DRAINED_BYTES_MAX))
            self._answer(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, {"error": "what is posted is smaller than that"})
            return
        body = self.rfile.read(int(length))
        parts = self._begin("POST")
        if parts is None:
            return
        if len(parts) != 3 or parts[2] not in _TAKERS:
            self._answer(HTTPStatus.NOT_FOUND, {"error": "there is nothing like that here"})
            return
        self._answer(*self._office.post(parts[1], parts[2], self.headers.get("Idempotency-Key", ""), body))

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 - its name in http.server
        """Say nothing: `asked` and `answered` count."""

    def _begin(self, method: str) -> list[str] | None:
        """Return the parts of the path; None where the request is spoilt or not allowed, and answered."""
        self._office.asked[method] += 1
        self._office.rest()
        if self._office.token and self.headers.get("Authorization") != f"Bearer {self._office.token}":
            self._answer(HTTPStatus.UNAUTHORIZED, {"error": "say who you are"})
            return None
        if self._office.faults.spoil("failing"):
            self._answer(HTTPStatus.INTERNAL_SERVER_ERROR, {"error": "the office has a bad day"})
            return None
        if method == "POST" and self._office.faults.spoil("refusing"):
            self._answer(HTTPStatus.CONFLICT, {"error": "the office does not want this"})
            return None
        parts = self.path.strip("/").split("/")
        return parts if parts[0] == "missions" else [""]

    def _answer(self, status: int, answer: dict[str, Any]) -> None:
        self._send(status, json.dumps(answer).encode(), "")

    def _send(self, status: int, data: bytes, etag: str) -> None:
        """Send an answer, or as much of it as the faults leave."""
        self._office.answered[int(status)] += 1
        if self._office.faults.spoil("dropping"):
            self.close_connection = True
            return
        half = bool(data) and self._office.faults.spoil("truncated")
        with contextlib.suppress(OSError):  # whoever asked has hung up
            self.send_response(status)
            self.send_header("Content-Type", "application/json")
            self.send_header("Content-Length", str(len(data)))
            if etag and not self._office.faults.no_etag:
                self.send_header("ETag", etag)
            self.end_headers()
            self.wfile.write(data[: len(data) // 2] if half else data)
        self.close_connection = self.close_connection or half


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    made = argparse.ArgumentParser(prog="python -m autopilot.sim.office", description="A simulated mission office.")
    made.add_argument("missions", nargs="+", type=Path, metavar="FILE", help="missions to hand out")
    made.add_argument("--port", type=int, default=0, help="TCP port on loopback; 0 lets the system choose")
    made.add_argument("--token", default="", help="bearer token that every request must carry")
    made.add_argument("--failing", type=int, default=0, metavar="N", help="answer the first N requests with 500")
    made.add_argument("--refusing", type=int, default=0, metavar="N", help="answer the first N posts with 409")
    made.add_argument("--dropping", type=int, default=0, metavar="N", help="do the first N requests, say nothing")
    made.add_argument("--truncated", type=int, default=0, metavar="N", help="cut the first N answers short")
    made.add_argument("--slow", type=float, default=0, metavar="S", help="wait this long before each answer")
    made.add_argument("--other-major", action="store_true", help="hand missions out as schema 2.0.0")
    made.add_argument("--padding", type=int, default=0, metavar="BYTES", help="blanks behind each mission")
    return made


def main(words: Sequence[str] | None = None) -> None:
    """Serve until SIGTERM or SIGINT."""
    arguments = parser().parse_args(words)
    office = Office([json.loads(file.read_text(encoding="utf-8")) for file in arguments.missions], arguments.token)
    office.faults = Faults(
        failing=arguments.failing,
        dropping=arguments.dropping,
        refusing=arguments.refusing,
        truncated=arguments.truncated,
        slow_s=arguments.slow,
        other_major=arguments.other_major,
        padding_bytes=arguments.padding,
    )
    over = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: over.set())
    office.start(arguments.port)
    print(f"ready {office.url}", flush=True)
    over.wait()
    office.stop()


if __name__ == "__main__":
    main()
