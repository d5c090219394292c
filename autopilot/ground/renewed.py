"""What an issuer that stays open for hours believes: its identity folder, and what is newer, as it comes.

The book of trust judges and keeps, as on a node; what it is brought comes from the Directory over the mesh, and from
the folder itself, where `autopilot enrol --renew` or a hand puts it. There is no log here, so what the book takes is in
force at once, and the clock of an operator's computer is taken as right (docs/belief.md).
"""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Final

from google.protobuf.message import Message

from autopilot.adapters.mesh.link import Wire
from autopilot.adapters.mesh.trust_client import TrustClient
from autopilot.adapters.mesh.trust_folder import TrustFolder
from autopilot.trust.believing import Heard
from autopilot.trust.book import TrustBook
from autopilot.trust.clock import Clock, wall_ms
from autopilot.trust.freshness import Time, TrustClock, known_time
from autopilot.trust.identity import TOKEN_FILE, Identity, IdentityError, load_identity

TURN_S: Final = 1.0


class Renewed:
    """A `Believing` that follows the Directory. Any thread."""

    def __init__(self, identity: Identity, clock: Clock, wire: Wire) -> None:
        """`start` begins; whoever owns `wire` starts it afterwards."""
        self._clock = clock
        self._own = identity  # whose token counts
        self._book = TrustBook(identity, TrustClock(clock, host_trusted=True), record=self._taken)
        self._folder = TrustFolder(identity.folder, self._book.offer)
        self._client = TrustClient(
            wire,
            clock,
            self._book.offer,
            deployment_id=identity.deployment_id,
            device_key_id=identity.sign_key.key_id,
        )
        self._book.ask_through(self._client)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="renewed", daemon=True)

    @property
    def held(self) -> Identity:
        """What is in force now."""
        held, own = self._book.held, self._own
        if held.token is own.token:
            return held
        return replace(held, token=own.token, token_bytes=own.token_bytes, token_digest=own.token_digest)

    def time(self) -> Time:
        """By the clock that is taken as right."""
        return known_time(self._clock)

    def echoes(self, challenge: bytes) -> bool:
        """Nobody asks this side for an echo."""
        del challenge
        return False

    def heard(self, heard: Heard) -> None:
        """Whoever knows of something newer makes the book ask for it."""
        self._book.heard(heard)

    def start(self) -> None:
        """Begin to ask, to listen and to look; returns at once."""
        self._client.start()
        self._thread.start()

    def stop(self) -> None:
        """End."""
        self._over.set()
        if self._thread.is_alive():
            self._thread.join(timeout=5)
            self._client.stop()

    def turn(self) -> None:
        """Take what the folder holds and is newer, and do what is due by the clock. Never raises."""
        self._folder.look()
        self._take_token()
        self._book.turn()

    def _take_token(self) -> None:
        """Go by a token that was written anew; while it does not fit the rest of the folder, by the one before."""
        try:
            if (self._own.folder / TOKEN_FILE).read_bytes() == self._own.token_bytes:
                return
            found = load_identity(self._own.folder, wall_ms(self._clock))
        except (OSError, IdentityError):
            return  # it is being written, or it is no use; a start would say so
        if found.token.not_before_ms >= self._own.token.not_before_ms:
            self._own = found

    def _taken(self, message: Message) -> bool:
        self._book.recorded(message)
        return True

    def _run(self) -> None:
        while not self._over.is_set():
            self.turn()
            self._over.wait(TURN_S)
