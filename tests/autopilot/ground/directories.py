"""A Directory in a folder with a node and an operator, for the tests of what changes in it; nothing here tests."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from autopilot.ground import directory
from autopilot.ground import directory_changes as changes
from autopilot.ground import enrolment_desk as desk
from autopilot.ground.directory import HOUR_MS, Directory, open_directory
from autopilot.ground.directory_changes import Changed, Removal
from autopilot.ground.directory_papers import signed_bundle
from autopilot.trust import documents
from autopilot.trust.identity import Identity, load_identity
from autopilot.trust.keys import Random, key_id
from events.schema.waypoint_pb2 import EpochBundle, IdentityToken
from tests.autopilot.trust.world import NOW_MS, seeded


@dataclass(frozen=True)
class World:
    """A Directory `coast-watch` with wasp-01 (a node) and alice (an operator), at NOW_MS."""

    root: Path
    random: Random

    @property
    def folder(self) -> Path:
        """The Directory's folder."""
        return self.root / "directory"

    def open(self) -> Directory:
        """Open the Directory as it is now."""
        return open_directory(self.folder)

    def issue(self, principal: str, kind: str = "operator", at_ms: int = NOW_MS) -> Identity:
        """Issue an identity to a folder of the principal's name."""
        out = self.root / principal
        directory.issue(self.open(), principal, out, kind=kind, roles=(), callsign="", now_ms=at_ms, random=self.random)
        return load_identity(out)

    def identity(self, principal: str) -> Identity:
        """Load an identity that was issued."""
        return load_identity(self.root / principal)

    def revoke(self, *principals: str, at_ms: int = NOW_MS, removal: Removal | None = None) -> Changed:
        """Revoke."""
        return changes.revoke(self.folder, removal or Removal(principals=principals), at_ms, self.random)

    def rotate(self, purpose: str, at_ms: int = NOW_MS, *roots: Path) -> Changed:
        """Replace a purpose key."""
        return changes.rotate_purpose(self.folder, purpose, at_ms, self.random, roots)

    def invite(self, principal: str = "hornet-02", kind: str = "node", valid_ms: int = HOUR_MS) -> str:
        """Give out a code."""
        described = directory.described(principal, kind, (), "")
        return desk.invite(self.folder, described, 30 * 24 * HOUR_MS, NOW_MS, valid_ms, self.random)[0]

    def bundle(self, identity: Identity) -> EpochBundle:
        """Return the newest bundle of a device, verified."""
        made = self.open()
        newest = made.state.epochs[-1]
        return documents.verify_epoch_bundle(signed_bundle(made, newest, identity.token), made.trust)

    def live(self, at_ms: int = NOW_MS) -> list[str]:
        """Return who takes part."""
        return [token.principal_id for token in self.open().live(at_ms)]


def world(root: Path, seed: int = 1) -> World:
    """Make the Directory and its two."""
    made = World(root, seeded(seed))
    directory.init(made.folder, deployment_id="coast-watch", now_ms=NOW_MS, random=made.random)
    made.issue("wasp-01", "node")
    made.issue("alice")
    return made


def device_id(identity: Identity) -> bytes:
    """Key id of an identity's device."""
    return key_id(identity.sign_key.public)


def changed_token(token: IdentityToken, change: Callable[[IdentityToken], object]) -> IdentityToken:
    """Return a copy of a token with one change."""
    other = IdentityToken()
    other.CopyFrom(token)
    change(other)
    return other


def digests(folder: Path) -> dict[str, str]:
    """Return what lies in a folder, by name and digest; the lock apart."""
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path.suffix != ".lock")
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
