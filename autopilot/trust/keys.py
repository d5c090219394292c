"""Keys and the files that hold them: Ed25519 to sign, X25519 to receive, key ids to look up.

Secret files are 0600 and refused when others may read them. This file knows no document and no
envelope.
"""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from nacl import bindings
from nacl.exceptions import CryptoError

from autopilot.trust.limits import KEY_BYTES, KEY_ID_BYTES, SIGNATURE_BYTES, WRAPPED_KEY_BYTES

Random = Callable[[int], bytes]


class SignatureInvalid(Exception):
    """A signature does not belong to these bytes and this key."""


class SealBroken(Exception):
    """A sealed text does not open with this key."""


class SecretFileError(Exception):
    """A secret file is missing, has the wrong length, or may be read by others."""


def key_id(public_key: bytes) -> bytes:
    """Return the 16-byte id of a public key: a hint for look-up, until the whole key is compared."""
    return hashlib.blake2b(public_key, digest_size=KEY_ID_BYTES, person=b"wp.keyid.v1").digest()


def digest(data: bytes) -> bytes:
    """Return BLAKE2b-256, the digest of tokens, bodies and signature inputs."""
    return hashlib.blake2b(data, digest_size=KEY_BYTES).digest()


@dataclass(frozen=True, slots=True)
class SignKey:
    """An Ed25519 key pair (RFC 8032); `seed` is the secret half."""

    seed: bytes = field(repr=False)
    public: bytes
    _expanded: bytes = field(repr=False)

    @classmethod
    def from_seed(cls, seed: bytes) -> SignKey:
        """Derive the pair from its 32-byte seed. Raises ValueError on another length."""
        if len(seed) != KEY_BYTES:
            raise ValueError(f"an Ed25519 seed has {KEY_BYTES} bytes, not {len(seed)}")
        public, expanded = bindings.crypto_sign_seed_keypair(seed)
        return cls(seed, public, expanded)

    @property
    def key_id(self) -> bytes:
        """The id of the public half."""
        return key_id(self.public)

    def sign(self, message: bytes) -> bytes:
        """Return the 64-byte pure Ed25519 signature of `message`."""
        return bindings.crypto_sign(message, self._expanded)[:SIGNATURE_BYTES]


@dataclass(frozen=True, slots=True)
class BoxKey:
    """An X25519 key pair (RFC 7748), made apart from the signing key."""

    secret: bytes = field(repr=False)
    public: bytes

    @classmethod
    def from_secret(cls, secret: bytes) -> BoxKey:
        """Derive the pair from its 32-byte secret. Raises ValueError on another length."""
        if len(secret) != KEY_BYTES:
            raise ValueError(f"an X25519 secret has {KEY_BYTES} bytes, not {len(secret)}")
        return cls(secret, bindings.crypto_scalarmult_base(secret))

    def open(self, wrapped: bytes) -> bytes:
        """Open what `wrap` sealed to this key. Raises SealBroken."""
        if len(wrapped) != WRAPPED_KEY_BYTES:
            raise SealBroken(f"a wrapped key has {WRAPPED_KEY_BYTES} bytes, not {len(wrapped)}")
        try:
            return bindings.crypto_box_seal_open(wrapped, self.public, self.secret)
        except CryptoError as error:
            raise SealBroken("the wrapped key was made for another device") from error


def wrap(secret: bytes, recipient: bytes, random: Random) -> bytes:
    """Seal `secret` to an X25519 public key as libsodium's crypto_box_seal does.

    Written out, and not called, because the library takes its ephemeral key from the system; here
    chance is an argument. It names no sender: whoever relies on it must sign what contains it.
    """
    ephemeral = BoxKey.from_secret(random(KEY_BYTES))
    nonce = hashlib.blake2b(ephemeral.public + recipient, digest_size=24).digest()
    return ephemeral.public + bindings.crypto_box(secret, nonce, recipient, ephemeral.secret)


def verify(public_key: bytes, message: bytes, signature: bytes) -> None:
    """Return when `signature` is `public_key`'s over `message`; raise SignatureInvalid otherwise.

    Lengths are checked first: the bindings raise other errors on them.
    """
    if len(signature) != SIGNATURE_BYTES or len(public_key) != KEY_BYTES:
        raise SignatureInvalid("a signature or key has the wrong length")
    try:
        bindings.crypto_sign_open(signature + message, public_key)
    except CryptoError as error:
        raise SignatureInvalid("the signature does not match") from error


def write_file(path: Path, data: bytes, *, secret: bool = False) -> None:
    """Replace `path` by `data` in one step; a secret is 0600 from its first byte on."""
    partial = path.with_name(path.name + ".part")
    partial.unlink(missing_ok=True)
    descriptor = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600 if secret else 0o644)
    with os.fdopen(descriptor, "wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    partial.replace(path)


def sync_folder(folder: Path) -> None:
    """Make names in a folder durable: what was replaced stays so after a power cut. Raises OSError."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def erase_file(path: Path) -> None:
    """Overwrite a file, then remove it. Raises OSError.

    What it held is gone from this file's blocks; a flash disk may keep a copy elsewhere.
    """
    with path.open("r+b") as file:
        file.write(bytes(path.stat().st_size))
        file.flush()
        os.fsync(file.fileno())
    path.unlink()


def read_secret(path: Path, length: int = KEY_BYTES) -> bytes:
    """Read a secret of `length` bytes. Raises SecretFileError naming the file and the fix."""
    try:
        mode = path.stat().st_mode
        data = path.read_bytes()
    except OSError as error:
        raise SecretFileError(f"{path}: {error.strerror}; `autopilot directory issue` writes it") from error
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise SecretFileError(f"{path}: others may read this secret (mode {mode & 0o777:04o}); run: chmod 600 {path}")
    if len(data) != length:
        raise SecretFileError(f"{path}: has {len(data)} bytes, a key has {length}; issue the identity again")
    return data
