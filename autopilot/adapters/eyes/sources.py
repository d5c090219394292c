"""Where batches come from: a child process of this node, or a detector behind a TCP connection.

Both open to a stream of framed messages and say afterwards, in words, why it stopped. Nothing
here knows what is in a message.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import sys
from collections.abc import Sequence
from typing import Protocol

from autopilot.ports.config import EyesSection

CHILD = (sys.executable, "-m", "autopilot.adapters.eyes.child")
EX_CONFIG = 78
STOP_PATIENCE_S = 2.0  # a child that has not ended this long after SIGTERM is killed
LINE_LONGEST = 500  # characters of a child's line that are kept

log = logging.getLogger("autopilot.eyes")


class Lost(Exception):
    """The source is gone; a new try makes sense. The text says why, for people."""


class Refused(Lost):
    """The source can never work as configured; a new try makes no sense."""


class Source(Protocol):
    """A stream of framed messages that can be opened again and again."""

    async def open(self) -> asyncio.StreamReader:
        """Open the stream. Raises `Lost`."""

    async def why(self) -> Lost:
        """Return why the stream has stopped; called once it has."""

    async def close(self) -> None:
        """Close the stream, whatever state it is in."""


def source_of(settings: EyesSection, camera: int) -> Source:
    """Return the source that is configured."""
    return Connection(settings.endpoint) if settings.source == "external" else Child(settings, camera)


class Child:
    """The process `autopilot.adapters.eyes.child`, in a session of its own so that Ctrl-C reaches the node alone."""

    def __init__(
        self, settings: EyesSection, camera: int, command: Sequence[str] = CHILD, patience_s: float = STOP_PATIENCE_S
    ) -> None:
        self._patience_s = patience_s
        self._told = json.dumps({**settings.model_dump(mode="json"), "camera": camera}).encode() + b"\n"
        self._command = command
        self._process: asyncio.subprocess.Process | None = None
        self._words: asyncio.Task[str] | None = None

    @property
    def pid(self) -> int | None:
        """Process id while there is a process."""
        return None if self._process is None else self._process.pid

    async def open(self) -> asyncio.StreamReader:
        """Start the process, tell it the settings, and return its output. Raises `Lost` where it cannot be started."""
        pipe = asyncio.subprocess.PIPE
        try:
            process = await asyncio.create_subprocess_exec(
                *self._command, stdin=pipe, stdout=pipe, stderr=pipe, start_new_session=True
            )
        except OSError as error:
            raise Lost(f"the detector's process does not start: {error.strerror}") from error
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        self._process = process
        self._words = asyncio.create_task(_last_line(process.stderr))
        process.stdin.write(self._told)
        process.stdin.close()
        return process.stdout

    async def why(self) -> Lost:
        """Return why the stream stopped, once the process is gone."""
        assert self._process is not None
        assert self._words is not None
        code = await self._process.wait()
        words = await self._words or f"the detector's process ended with code {code}"
        return Refused(words) if code == EX_CONFIG else Lost(words)

    async def close(self) -> None:
        """End the process: SIGTERM, and SIGKILL for one that does not hear it."""
        if self._process is None:
            return
        with contextlib.suppress(ProcessLookupError):
            self._process.terminate()
        try:
            async with asyncio.timeout(self._patience_s):
                await self._gone()
        except TimeoutError:
            self._process.kill()
            await self._gone()
        if self._words is not None:
            await self._words
        self._process = self._words = None

    async def _gone(self) -> None:
        """Wait for the end, throwing away what is still in the pipe: some releases of asyncio wait for that too."""
        assert self._process is not None
        assert self._process.stdout is not None
        while await self._process.stdout.read(65_536):
            pass
        await self._process.wait()


class Connection:
    """A detector at host:port that sends batches to whoever connects."""

    def __init__(self, endpoint: str) -> None:
        self._endpoint = endpoint
        self._writer: asyncio.StreamWriter | None = None

    async def open(self) -> asyncio.StreamReader:
        """Connect. Raises `Lost` where nobody listens."""
        host, _, port = self._endpoint.rpartition(":")
        try:
            reader, self._writer = await asyncio.open_connection(host.strip("[]"), int(port))
        except OSError as error:
            raise Lost(f"no detector at {self._endpoint}: {error.strerror or error}") from error
        return reader

    async def why(self) -> Lost:
        """Return why the stream stopped."""
        return Lost(f"the detector at {self._endpoint} closed the connection")

    async def close(self) -> None:
        """Close the connection."""
        if self._writer is not None:
            self._writer.close()
            with contextlib.suppress(OSError):
                await self._writer.wait_closed()
            self._writer = None


async def _last_line(reader: asyncio.StreamReader) -> str:
    """Log what a child says and return its last line."""
    last = ""
    while True:
        try:
            line = await reader.readline()
        except ValueError:  # longer than the reader's buffer, which is emptied then
            continue
        if not line:
            return last
        words = "".join(c for c in line.decode(errors="replace") if c.isprintable()).strip()
        if words:
            last = words[:LINE_LONGEST]
            log.warning("%s", last)
