"""What remembers: nonces that must not come again, and the bucket that bounds the rate.

Both are bounded and take their time as an argument. Neither knows an envelope.
"""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Iterable

from autopilot.trust.limits import WINDOW_PER_DEVICE, WINDOW_TOTAL


class ReplayWindow:
    """Nonces seen and still alive, by device.

    An entry goes only when its message would be too old anyway. When a device or the whole
    window is full, new entries are refused: a live one is never evicted. All times are wall
    milliseconds since 1970.
    """

    def __init__(self, per_device: int = WINDOW_PER_DEVICE, total: int = WINDOW_TOTAL) -> None:
        self._per_device = per_device
        self._total = total
        self._nonces: defaultdict[bytes, set[bytes]] = defaultdict(set)
        self._expiry: list[tuple[int, bytes, bytes]] = []

    def __len__(self) -> int:
        """How many nonces are held."""
        return len(self._expiry)

    def seen(self, device_key_id: bytes, nonce: bytes) -> bool:
        """Say whether the nonce is held. Changes nothing, so anybody's message may be asked about."""
        return nonce in self._nonces.get(device_key_id, ())

    def has_room(self, device_key_id: bytes, now_ms: int) -> bool:
        """Forget what has expired, then say whether this device may add one more."""
        while self._expiry and self._expiry[0][0] < now_ms:
            self._forget(*heapq.heappop(self._expiry)[1:])
        return len(self) < self._total and len(self._nonces.get(device_key_id, ())) < self._per_device

    def insert(self, device_key_id: bytes, nonce: bytes, until_ms: int) -> None:
        """Hold the nonce until `until_ms`; only for a message that was authenticated and opened."""
        if not self.seen(device_key_id, nonce):
            self._nonces[device_key_id].add(nonce)
            heapq.heappush(self._expiry, (until_ms, device_key_id, nonce))

    def restore(self, entries: Iterable[tuple[bytes, bytes, int]], now_ms: int) -> None:
        """Hold again what a log remembers: (device_key_id, nonce, milliseconds that remain)."""
        for device_key_id, nonce, remaining_ms in entries:
            if remaining_ms > 0:
                self.insert(device_key_id, nonce, now_ms + remaining_ms)

    def _forget(self, device_key_id: bytes, nonce: bytes) -> None:
        held = self._nonces[device_key_id]
        held.discard(nonce)
        if not held:
            del self._nonces[device_key_id]


class TokenBucket:
    """Lets `burst` messages through at once and `per_s` a second from then on."""

    def __init__(self, per_s: float, burst: int) -> None:
        self._per_s = per_s
        self._burst = burst
        self._level = float(burst)
        self._filled_ns: int | None = None

    def take(self, mono_ns: int) -> bool:
        """Take one; False when the bucket is empty."""
        if self._filled_ns is not None:
            grown = max(0, mono_ns - self._filled_ns) * self._per_s / 1e9
            self._level = min(self._burst, self._level + grown)
        self._filled_ns = mono_ns
        if self._level < 1:
            return False
        self._level -= 1
        return True
