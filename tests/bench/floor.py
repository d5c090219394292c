"""The least that an order must cost: `python -m tests.bench.floor KEYS LISTEN UDP_PORT DATABASE`.

A process of its own, like the daemon: a Zenoh hop in, two Ed25519 verifications, one opening, one commit
with synchronous=FULL, one datagram out. It judges nothing and keeps no chain; it is what remains when
everything that could be left out is left out.
"""

from __future__ import annotations

import socket
import sys
from pathlib import Path

import apsw

from autopilot.adapters.mesh.link import Link
from autopilot.trust.envelope import MessageType, open_sealed, sealing_key, signature_input
from autopilot.trust.identity import load_identity
from autopilot.trust.keys import verify
from events.schema.waypoint_pb2 import AuthEnvelope, EnvelopeHeader, IdentityToken, SignedDoc

ANY_ORDER = "waypoint/global/cmd/**"
FULL = 2


class Floor:
    """Takes an order through what can't be left out."""

    def __init__(self, keys: Path, database: Path, udp_port: int) -> None:
        """Open the database and the socket."""
        self._epochs = load_identity(keys).epochs
        self._public: dict[bytes, bytes] = {}
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._udp.connect(("127.0.0.1", udp_port))
        self._database = database
        self._connection: apsw.Connection | None = None

    def receive(self, _key_expr: str, payload: bytes) -> None:
        """Take one sample (called on Zenoh's thread)."""
        envelope = AuthEnvelope.FromString(payload)
        header = EnvelopeHeader.FromString(envelope.header)
        public = self._public.get(envelope.token) or self._read_token(envelope.token)
        signed = signature_input(envelope.header, envelope.token, envelope.ciphertext)
        for _ in range(2):
            verify(public, signed, envelope.device_signature)
        key = sealing_key(MessageType.ORDER, self._epochs[header.epoch_id], header.device_key_id)
        opened = open_sealed(key, header.nonce, envelope.header, envelope.ciphertext)
        connection = self._connection or self._open()
        with connection:
            connection.execute("INSERT INTO record (body) VALUES (?)", (payload + opened,))
        self._udp.send(opened[:32])

    def _read_token(self, token: bytes) -> bytes:
        body = SignedDoc.FromString(token).body
        self._public[token] = IdentityToken.FromString(body).device_sign_pk
        return self._public[token]

    def _open(self) -> apsw.Connection:
        """Open the database on the thread that uses it."""
        connection = apsw.Connection(str(self._database))
        for name, value in {"journal_mode": "wal", "synchronous": FULL}.items():
            connection.pragma(name, value)
        assert connection.pragma("synchronous") == FULL
        connection.execute("CREATE TABLE record (seq INTEGER PRIMARY KEY, body BLOB NOT NULL)")
        self._connection = connection
        return connection


def main(keys: str, listen: str, udp_port: str, database: str) -> None:
    """Serve until stdin ends."""
    floor = Floor(Path(keys), Path(database), int(udp_port))
    link = Link(mode="peer", listen=[listen])
    link.subscribe(ANY_ORDER, floor.receive)
    link.start()
    sys.stdin.read()
    link.stop()


if __name__ == "__main__":
    main(*sys.argv[1:])
