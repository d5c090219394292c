"""How a golden flight is told: lines of "seconds | what is observed", or messages for what has no words.

Between the lines time passes when the core asked for it, as in the daemon. It writes nothing.
"""

from __future__ import annotations

from collections.abc import Iterable

from google.protobuf.message import Message

from tests.flights import NS_PER_MS, Flight
from tests.stories import MS_PER_S, Story


def tell(story: Story, text: str) -> Story:
    """Observe line by line what a text says, at the seconds of the flight that it names; return the story."""
    for line in filter(None, map(str.strip, text.splitlines())):
        seconds, _, words = line.partition("|")
        at_ms = round(float(seconds) * MS_PER_S)
        story.flight.wait(at_ms - story.flight.now_ns // NS_PER_MS)
        story.tell(words.strip())
    return story


def follow(story: Story, lines: Iterable[str], every_ms: int = 20) -> Story:
    """Observe lines without a time, one every so often; return the story."""
    for words in lines:
        story.flight.wait(every_ms)
        story.tell(words)
    return story


def tell_all(flight: Flight, messages: Iterable[Message], every_ms: int = 20) -> Flight:
    """Observe messages, one every so often; return the flight."""
    for message in messages:
        flight.wait(every_ms)
        flight.tell(message)
    return flight
