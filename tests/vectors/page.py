"""Draws the worked example of docs/envelope.md from the published order: every byte with its place and meaning."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from docs.schema import blocks_of
from tests.house import REPO
from tests.vectors import independent

BEGIN, END = "<!-- worked example -->\n", "<!-- end of the worked example -->\n"
_ROW = 24  # bytes on a line


def with_example(page: str, made: dict[str, Any]) -> str:
    """Return the page with its example drawn anew."""
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}{example(made)}{END}{after}"


def example(made: dict[str, Any]) -> str:
    """Return the example as Markdown."""
    order = made["messages"]["order"]
    envelope, content = bytes.fromhex(order["envelope"]), bytes.fromhex(order["content"])
    outer = independent.fields(envelope)
    header, token = _part(outer, 2), _part(outer, 3)
    body = _part(independent.fields(token), 1)
    plaintext = bytes.fromhex(order["plaintext"])
    parts = (
        (f"The envelope, {len(envelope)} bytes (`AuthEnvelope`)", _message("AuthEnvelope", envelope)),
        (f"Its header, {len(header)} bytes (`EnvelopeHeader`)", _message("EnvelopeHeader", header)),
        (f"Its token, {len(token)} bytes (`SignedDoc`)", _message("SignedDoc", token)),
        (f"What the Directory signed, {len(body)} bytes (`IdentityToken`)", _message("IdentityToken", body)),
        (f"The plaintext, {len(plaintext)} bytes", _plaintext(plaintext)),
        (f"The order in it, {len(content)} bytes (`DeviceCommand`)", _message("DeviceCommand", content)),
    )
    return "\n" + "".join(f"**{title}**\n\n```\n{''.join(lines)}```\n\n" for title, lines in parts)


def _part(fields: dict[int, independent.Value], number: int) -> bytes:
    value = fields[number]
    assert isinstance(value, bytes)
    return value


def _message(name: str, data: bytes) -> Iterator[str]:
    names = _names(name)
    repeated = frozenset(names)
    for number, value, start, stop in independent.spans(data, repeated):
        said = f"{number} {names[number]}"
        told = f" = {value}" if isinstance(value, int) else _text(value)
        head = stop - start if isinstance(value, int) else stop - start - len(value)
        yield from _rows(start, data[start : start + head], said + told)
        if isinstance(value, bytes):
            yield from _rows(start + head, value, "")


def _text(value: bytes) -> str:
    printable = len(value) < 64 and all(32 <= byte < 127 for byte in value)
    return f" {value.decode()!r}" if printable else f", {len(value)} bytes"


def _plaintext(data: bytes) -> Iterator[str]:
    yield from _rows(0, data[:32], "32 random bytes")
    for line in _message("SealedBody", data[32:]):
        offset, rest = line[:4], line[4:]
        yield f"{int(offset) + 32:4}{rest}"


def _rows(start: int, data: bytes, said: str) -> Iterable[str]:
    for at in range(0, len(data), _ROW):
        row = data[at : at + _ROW].hex()
        yield f"{start + at:4}  {row}{'  ' + said if said and not at else ''}\n"


def _names(message: str) -> dict[int, str]:
    text = (REPO / "events/schema/waypoint.proto").read_text("utf-8")
    block = next(block for block in blocks_of(text) if block.name == message)
    return {int(member.number): member.name for member in block.members}
