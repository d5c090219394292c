"""One question to a mission office over HTTP, and its answer as a plain value. Retries are the caller's business.

Whatever the office does comes back as a value: `Answer`, or `Failed` with words and whether it is worth trying again.
An answer is read up to `max_bytes` and for `timeout_s`, all of it together, so neither a flood nor a trickle holds the
node up. Redirects are not followed (the token would go along), compression is not taken (it hides the size), and
proxies and passwords of the environment are not used.
"""

from __future__ import annotations

import asyncio
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import httpx

from autopilot.ports.config import MissionSection

TOKEN_BYTES_MAX: Final = 8192
ETAG_MAX: Final = 200  # characters; a longer one is not kept
_AGAIN: Final = frozenset({408, 425, 429})  # statuses below 500 that say "later" (RFC 9110, RFC 8470, RFC 6585)


def waits_s(settings: MissionSection) -> Iterator[float]:
    """Yield for each attempt how long to wait after it before the next, in seconds: 1, 2, 4 ... as configured."""
    wait_s = settings.retry_first_s
    for _ in range(settings.attempts):
        yield wait_s
        wait_s = min(2 * wait_s, settings.retry_longest_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What the office said."""

    status: int
    data: bytes
    etag: str  # as it came; empty: none


@dataclass(frozen=True, slots=True)
class Failed:
    """Why there is no answer."""

    because: str
    again: bool  # worth trying again


class Client:
    """Speaks HTTP with one office."""

    def __init__(self, settings: MissionSection, transport: httpx.AsyncBaseTransport | None = None) -> None:
        """Take the settings; nothing is opened before the first question. `transport` is a test's."""
        self._settings = settings
        self._http = httpx.AsyncClient(
            timeout=settings.timeout_s,
            follow_redirects=False,
            trust_env=False,
            limits=httpx.Limits(max_connections=4, max_keepalive_connections=1),
            headers={"Accept": "application/json", "Accept-Encoding": "identity"},
            transport=transport,
        )

    async def close(self) -> None:
        """Close its connections."""
        await self._http.aclose()

    async def get(self, path: str, etag: str = "") -> Answer | Failed:
        """Ask for something; `etag` is that of what is already here."""
        return await self._ask("GET", path, {"If-None-Match": etag} if etag else {}, None)

    async def post(self, path: str, key: str, body: bytes) -> Answer | Failed:
        """Ask for something to be done; the same `key` again does nothing twice."""
        headers = {"Idempotency-Key": key, "Content-Type": "application/json"}
        return await self._ask("POST", path, headers, body)

    async def _ask(self, method: str, path: str, headers: dict[str, str], body: bytes | None) -> Answer | Failed:
        token = bearer(self._settings.token_file)
        if isinstance(token, Failed):
            return token
        if token:
            headers = headers | {"Authorization": f"Bearer {token}"}
        url = self._settings.url.rstrip("/") + path
        try:
            async with (
                asyncio.timeout(self._settings.timeout_s),
                self._http.stream(method, url, headers=headers, content=body) as response,
            ):
                return await self._judged(response, url)
        except (TimeoutError, httpx.TimeoutException):
            return Failed(f"{url}: no whole answer within {self._settings.timeout_s:g} s", again=True)
        except httpx.InvalidURL as error:
            return Failed(f"[mission] url: {error}", again=False)
        except httpx.HTTPError as error:
            return Failed(f"{url}: {str(error) or type(error).__name__}", again=True)

    async def _judged(self, response: httpx.Response, url: str) -> Answer | Failed:
        status = response.status_code
        if status >= 500 or status in _AGAIN:
            return Failed(f"{url}: the office answers {status} {response.reason_phrase}", again=True)
        if status in (401, 403):
            return Failed(f"{url}: the office answers {status}; see [mission] token_file", again=False)
        if 300 <= status < 400 and status != 304:
            return Failed(f"{url}: the office answers {status} and points elsewhere; name that place", again=False)
        if response.headers.get("Content-Encoding", "identity") != "identity":
            return Failed(f"{url}: the answer is compressed, which was not asked for", again=False)
        data = await self._read(response)
        if data is None:
            return Failed(f"{url}: the answer has more than {self._settings.max_bytes} bytes", again=False)
        if status >= 400:
            return Failed(f"{url}: the office answers {status}: {_words(data)}", again=False)
        etag = response.headers.get("ETag", "")
        return Answer(status=status, data=data, etag=etag if etag.isprintable() and len(etag) <= ETAG_MAX else "")

    async def _read(self, response: httpx.Response) -> bytes | None:
        """Return the body; None once it is too long, and no more of it is read."""
        data = bytearray()
        async for chunk in response.aiter_raw():
            data += chunk
            if len(data) > self._settings.max_bytes:
                return None
        return bytes(data)


def bearer(token_file: str) -> str | Failed:
    """Return the token that a file holds, empty where no file is configured; nobody else may be able to read it."""
    if not token_file:
        return ""
    try:
        if stat.S_IMODE(Path(token_file).stat().st_mode) & 0o077:
            return Failed(f"[mission] token_file: {token_file} can be read by others; chmod 600 it", again=False)
        with Path(token_file).open("rb") as file:
            token = file.read(TOKEN_BYTES_MAX + 1).strip()
    except OSError as error:
        return Failed(f"[mission] token_file: {token_file}: {error.strerror}", again=False)
    if not token or len(token) > TOKEN_BYTES_MAX or any(not 0x21 <= byte <= 0x7E for byte in token):
        return Failed(f"[mission] token_file: {token_file} holds no token: one line of visible ASCII", again=False)
    return token.decode("ascii")


def _words(data: bytes) -> str:
    """Return the beginning of what an office says about a failure, fit to be recorded."""
    text = data[:200].decode(errors="replace")
    return "".join(character if character.isprintable() else " " for character in text).strip() or "no words"
