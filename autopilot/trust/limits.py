"""Bounds of the format: what no configuration may change, each with its unit and reason.

They belong to the wire, not to a deployment, so they are constants; what a deployment may tune is in
`autopilot.ports.config`.
"""

from typing import Final

KEY_BYTES: Final = 32  # Ed25519 and X25519 public keys, secrets, digests (RFC 8032, RFC 7748)
SIGNATURE_BYTES: Final = 64  # Ed25519 (RFC 8032)
KEY_ID_BYTES: Final = 16  # BLAKE2b-128: a look-up hint, never an identity by itself
NONCE_BYTES: Final = 24  # XChaCha20: 8 of the running number, 16 random
TAG_BYTES: Final = 16  # Poly1305
TOKEN_ID_BYTES: Final = 16
CHALLENGE_BYTES: Final = 16  # random, of a node whose time is uncertain, or of one that asks for the time
SALT_BYTES: Final = 32  # random in front of the sealed body, so that its commitment hides it
WRAPPED_KEY_BYTES: Final = 80  # crypto_box_seal: 32 ephemeral key, 16 tag, 32 secret

ENVELOPE_BYTES_MIN: Final = 200  # below it no envelope has all its parts
ENVELOPE_BYTES_MAX: Final = 4096  # an order or ack is near 600 bytes; more only costs parsing time
HEADER_BYTES_MAX: Final = 512
TOKEN_BYTES_MAX: Final = 1024
CIPHERTEXT_BYTES_MAX: Final = 2048
STATUS_ENVELOPE_BYTES_MAX: Final = 18_432  # a status lists cameras, findings and counters
STATUS_CIPHERTEXT_BYTES_MAX: Final = 16_384
DOCUMENT_BYTES_MAX: Final = 262_144  # 256 KiB: a full revocation list
REVOKED_MAX: Final = 4096  # entries of a revocation list
TEXT_CHARACTERS_MAX: Final = 128  # any string on the wire
CALLSIGN_CHARACTERS_MAX: Final = 64
ROLES_MAX: Final = 8
ROLE_CHARACTERS_MAX: Final = 32

SKEW_MS: Final = 5_000  # two clocks that are kept may differ by this
TTL_MS_MAX: Final = 30_000  # a longer life would need a longer memory for nonces
ORDER_TTL_MS: Final = 10_000  # life of an order when its issuer says nothing else
PRESENCE_TTL_MS: Final = 3_000  # life of a presence: the next two are under way by then, an older one says nothing
OVERLAP_MS: Final = 120_000  # an epoch's key opens this long after its retirement

WINDOW_PER_DEVICE: Final = 512  # one device cannot lock the others out
WINDOW_TOTAL: Final = 4096  # nonces in memory, 40 s of them at 100 a second
TOKEN_CACHE: Final = 256  # verified tokens kept, so that a known sender costs one verification

ASK_AGAIN_NS: Final = (
    10_000_000_000  # a document is asked for at most this often, whoever says that there is a newer one
)
CHALLENGE_TURN_NS: Final = 30_000_000_000  # a challenge is replaced after this; the one before it still counts
CHALLENGE_LIFE_MS: Final = 60_000  # so an order by challenge was made at most this long ago
CLOCK_JUMP_MS: Final = 600_000  # a clock that moves further at once is believed no longer
BEACON_RTT_MS_MAX: Final = SKEW_MS  # a beacon that took longer says less than a clock that is kept
BEACON_AGAIN_NS: Final = 3_600_000_000_000  # a crystal of 100 ppm is 0.4 s off by then
BUILD_MS: Final = 1_767_225_600_000  # 2026-01-01: no time before it can be the present
HORIZON_MS: Final = TTL_MS_MAX + 2 * SKEW_MS  # by then everything that was sent before has run out
