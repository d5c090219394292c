"""The simulated office itself: what it answers, and how it misbehaves. Asked through plain `http.client`."""

from __future__ import annotations

import http.client
import json
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest

from autopilot.sim.office import Office, parser
from tests.autopilot.planning.missions import MISSION_ID, tree, uid, vertex, waypoint
from tests.house import REPO

pytestmark = pytest.mark.whole
PATH = f"/missions/{MISSION_ID}"


@pytest.fixture
def office() -> Iterator[Office]:
    """An office with one mission, behaving."""
    made = Office([tree(waypoint((10, 20)), waypoint((30, 20)), {"kind": "return"})])
    made.start()
    yield made
    made.stop()


def ask(
    office: Office, method: str, path: str, body: bytes | None = None, **headers: str
) -> tuple[int, bytes, str | None]:
    """Return status, body and ETag."""
    host = office.url.removeprefix("http://")
    connection = http.client.HTTPConnection(host, timeout=10)
    try:
        connection.request(method, path, body, {name.replace("_", "-"): value for name, value in headers.items()})
        response = connection.getresponse()
        return response.status, response.read(), response.headers.get("ETag")
    finally:
        connection.close()


def post(office: Office, number: int, before: str | None, key: str = "") -> tuple[int, Any]:
    """Ask for a waypoint; return status and answer."""
    asked = {"id": uid(number), "at": vertex((20, 20), 40)} | ({} if before is None else {"before": before})
    status, data, _ = ask(office, "POST", PATH + "/waypoints", json.dumps(asked).encode(), Idempotency_Key=key)
    return status, json.loads(data)


def ids(office: Office) -> list[str]:
    """Return the ids of the mission's items, as numbers."""
    return [str(int(item["id"].replace("-", ""), 16) - 1) for item in office.mission(MISSION_ID)["items"]]


def test_a_mission_and_its_revision(office: Office) -> None:
    """The ETag saves sending it again, until it changes."""
    status, data, etag = ask(office, "GET", PATH)
    assert (status, json.loads(data)) == (200, office.mission(MISSION_ID))
    assert etag is not None
    assert ask(office, "GET", PATH, If_None_Match=etag) == (304, b"", etag)
    assert ask(office, "GET", PATH.upper().replace("MISSIONS", "missions"))[0] == 200
    office.put(office.mission(MISSION_ID))
    assert ask(office, "GET", PATH, If_None_Match=etag)[0] == 200
    assert ask(office, "GET", "/missions/" + uid(9))[0] == 404
    assert ask(office, "GET", "/elsewhere/" + MISSION_ID)[0] == 404


def test_a_waypoint_goes_where_it_is_asked_for(office: Office) -> None:
    """Before an item; without one last, but for the return."""
    assert post(office, 5, uid(1)) == (201, {"mission_id": MISSION_ID, "revision": 2})
    assert ids(office) == ["0", "5", "1", "2"]
    assert post(office, 6, None)[0] == 201
    assert ids(office) == ["0", "5", "1", "6", "2"]
    assert post(office, 7, uid(99))[0] == 409
    assert post(office, 5, None)[0] == 409
    assert ask(office, "POST", PATH + "/waypoints", b"[]")[0] == 400
    assert ask(office, "POST", PATH + "/waypoints", b"x" * 70_000)[0] == 413
    assert ask(office, "POST", PATH, b"{}")[0] == 404
    assert ids(office) == ["0", "5", "1", "6", "2"]


def test_the_same_question_twice_is_done_once(office: Office) -> None:
    """The stored answer comes back; under the same key nothing else is done."""
    first = post(office, 5, uid(1), "key")
    assert post(office, 5, uid(1), "key") == (200, first[1])
    assert post(office, 6, uid(1), "key")[0] == 422
    assert ids(office) == ["0", "5", "1", "2"]


def push(office: Office, key: str, *numbers: int, **other: Any) -> tuple[int, Any]:
    """Push observations with these ids, and one ignored item; return status and answer."""
    rows = [{"id": uid(number), "class": "person"} for number in numbers]
    bundle = {"schema_version": "1.0.0", "mission_id": MISSION_ID, "observations": rows, "ignored_items": [{"id": "i"}]}
    data = json.dumps(bundle | other).encode()
    status, said, _ = ask(office, "POST", PATH + "/mapobjects", data, Idempotency_Key=key)
    return status, json.loads(said)


def test_what_was_seen_is_kept_by_its_id(office: Office) -> None:
    """In the order in which it came, each once; under the same key nothing is done twice, and no other body taken."""
    assert push(office, "a", 2, 1) == (201, {"observations": 2, "ignored_items": 1})
    assert push(office, "a", 2, 1)[0] == 200
    assert push(office, "a", 3)[0] == 422
    assert push(office, "b", 1, 4, ignored_items=[])[0] == 201
    assert push(office, "c", observations=[{"id": uid(2), "class": "another"}])[0] == 201
    status, data, _ = ask(office, "GET", PATH + "/mapobjects")
    assert (status, json.loads(data)) == (200, office.mapobjects(MISSION_ID.upper()))
    kept = json.loads(data)
    assert [row["id"] for row in kept["observations"]] == [uid(2), uid(1), uid(4)]
    assert {row["class"] for row in kept["observations"]} == {"person"}
    assert (kept["mission_id"], kept["ignored_items"]) == (MISSION_ID, [{"id": "i"}])
    assert office.mission(MISSION_ID)["items"][0]["id"] == uid(0)


def test_what_is_no_bundle_is_refused(office: Office) -> None:
    """Of another MAJOR, another mission, without ids, too long, of a mission that is not there."""
    assert push(office, "", 1, schema_version="2.0.0")[0] == 409
    assert push(office, "", 1, mission_id=uid(9))[0] == 409
    wrong: dict[str, Any]
    for wrong in ({"observations": [{}]}, {"ignored_items": 3}, {"observations": ["x"]}, {"schema_version": 1}):
        assert push(office, "", 1, **wrong)[0] == 400
    assert ask(office, "POST", PATH + "/mapobjects", b"[")[0] == 400
    assert ask(office, "POST", PATH + "/mapobjects", b" " * 1_048_577)[0] == 413
    assert ask(office, "POST", "/missions/" + uid(9) + "/mapobjects", b"{}")[0] == 404
    assert ask(office, "GET", "/missions/" + uid(9) + "/mapobjects")[0] == 404
    office.faults.refusing = 1
    assert [push(office, "", 1)[0] for _ in range(2)] == [409, 201]
    assert len(json.loads(ask(office, "GET", PATH + "/mapobjects")[1])["observations"]) == 1


def test_faults(office: Office) -> None:
    """Each is as often as it was asked for."""
    office.faults.failing = 1
    assert [ask(office, "GET", PATH)[0] for _ in range(2)] == [500, 200]
    office.faults.dropping = 1
    with pytest.raises((http.client.RemoteDisconnected, ConnectionError)):
        ask(office, "GET", PATH)
    office.faults.truncated = 1
    with pytest.raises(http.client.IncompleteRead):
        ask(office, "GET", PATH)
    office.faults.other_major = True
    assert json.loads(ask(office, "GET", PATH)[1])["schema_version"] == "2.0.0"
    office.faults.padding_bytes = 1000
    assert ask(office, "GET", PATH)[1].endswith(b"}" + b" " * 1000)
    office.faults.no_etag = True
    assert ask(office, "GET", PATH)[2] is None
    office.token = "secret"
    assert ask(office, "GET", PATH)[0] == 401
    assert ask(office, "GET", PATH, Authorization="Bearer secret")[0] == 200


def test_as_a_process() -> None:
    """It says where it is, serves, and ends when asked to."""
    command = [
        sys.executable,
        "-m",
        "autopilot.sim.office",
        str(REPO / "examples/missions/field.json"),
        "--failing",
        "1",
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=REPO) as process:
        try:
            assert process.stdout is not None
            word, url = process.stdout.readline().split()
            assert word == "ready"
            host = http.client.HTTPConnection(url.removeprefix("http://"), timeout=10)
            host.request("GET", "/missions/e351ec67-92ba-5bb1-a735-accbcdcf5a66")
            assert host.getresponse().status == 500
        finally:
            process.terminate()
        assert process.wait(timeout=10) == 0


def test_its_help_names_every_fault() -> None:
    """Nothing can be switched that is not said."""
    text = parser().format_help()
    assert [
        flag
        for flag in ("--failing", "--dropping", "--refusing", "--truncated", "--slow", "--other-major")
        if flag not in text
    ] == []
