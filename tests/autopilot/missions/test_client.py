"""What the client makes of odd answers and of files that hold no token. No socket."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

import httpx
import pytest

from autopilot.adapters.missions.client import Answer, Client, Failed, bearer
from autopilot.ports.config import MissionSection
from tests.autopilot.planning.missions import MISSION_ID


@pytest.mark.parametrize(
    ("mode", "text", "words"),
    [
        (0o640, "t", "can be read by others; chmod 600 it"),
        (0o604, "t", "can be read by others; chmod 600 it"),
        (0o600, "", "holds no token"),
        (0o600, "a b", "holds no token"),
        (0o600, "a\r\nX-Evil: 1", "holds no token"),
        (0o600, "t" * 8193, "holds no token"),
        (None, "", "No such file or directory"),
    ],
)
def test_token_files(tmp_path: Path, mode: int | None, text: str, words: str) -> None:
    """What is no token, or no secret, is not sent."""
    file = tmp_path / "token"
    if mode is not None:
        file.write_text(text)
        file.chmod(mode)
    found = bearer(str(file))
    assert isinstance(found, Failed)
    assert words in found.because
    assert found.again is False


def answer(status: int, data: bytes = b"", **headers: str) -> Callable[[httpx.Request], httpx.Response]:
    """Return an office that says only this."""
    return lambda _: httpx.Response(
        status,
        headers={name.replace("_", "-"): value for name, value in headers.items()},
        stream=httpx.ByteStream(data),
    )


def check_answer(handler: Callable[[httpx.Request], httpx.Response], expected: Answer | str) -> None:
    """Check what the client makes of an answer that no well-behaved office gives."""

    async def work() -> Answer | Failed:
        settings = MissionSection(url="http://office", mission_id=MISSION_ID)
        client = Client(settings, httpx.MockTransport(handler))
        try:
            return await client.get("/missions/x")
        finally:
            await client.close()

    found = asyncio.run(work())
    if isinstance(expected, str):
        assert isinstance(found, Failed)
        ending = "again" if found.again else "final"
        assert f"{found.because} {ending}" == expected
    else:
        assert found == expected


def test_odd_answers() -> None:
    """Redirects are not followed, compression is not taken, an ETag has its bounds, 429 is "later"."""
    url = "http://office/missions/x"
    check_answer(answer(200, b"{}", ETag="a" * 201), Answer(status=200, data=b"{}", etag=""))
    check_answer(answer(200, b"{}", ETag="a" * 200), Answer(status=200, data=b"{}", etag="a" * 200))
    check_answer(
        answer(302, Location="http://elsewhere"),
        f"{url}: the office answers 302 and points elsewhere; name that place final",
    )
    check_answer(
        answer(200, b"x", Content_Encoding="gzip"), f"{url}: the answer is compressed, which was not asked for final"
    )
    check_answer(answer(429), f"{url}: the office answers 429 Too Many Requests again")
    check_answer(
        answer(400, b"a\x1b[2Jb\xff" + b"c" * 500), f"{url}: the office answers 400: a [2Jb\ufffd{'c' * 193} final"
    )
