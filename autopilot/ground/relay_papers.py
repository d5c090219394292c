"""The public documents that a relay verifies by: the newest trust root and the newest revocation list that it has seen.

It begins with those in a folder of their own; the root there is what it is pinned to. A secret in the folder is
refused, so that a relay never has one by mistake. Newer ones are taken from the list's file when it changes, and from
what a Directory says through the relay; what is older, or another of the same version, is not. Nothing is written: a
restart begins with the folder again.
"""

from __future__ import annotations

import threading
from pathlib import Path
from typing import NamedTuple

from autopilot.trust import documents
from autopilot.trust.documents import DocumentError, DocumentUnsigned, Revocations, Trust, parse
from autopilot.trust.identity import BOX_FILE, EPOCH_FILE, REVOCATIONS_FILE, ROOT_FILE, SIGN_FILE
from autopilot.trust.keys import digest, key_id
from autopilot.trust.limits import DOCUMENT_BYTES_MAX
from autopilot.trust.pae import TRUST_ROOT
from events.schema.waypoint_pb2 import SignedDoc

SECRETS = (SIGN_FILE, BOX_FILE, EPOCH_FILE)


class PapersError(Exception):
    """The folder can't be used; the text names the file and the fix."""


class Judged(NamedTuple):
    """What a relay thinks of a document."""

    because: str  # why it must not pass; empty: it may
    version: int = 0  # of two that may pass, the higher is newer


class Papers:
    """What a relay knows of whom to believe. Any thread."""

    def __init__(self, folder: Path, now_ms: int) -> None:
        """Read and verify the folder. Raises PapersError. `now_ms` is wall milliseconds since 1970."""
        for name in SECRETS:
            if (folder / name).exists():
                raise PapersError(f"{folder / name}: a relay holds no secrets; give it a folder with public documents")
        self._path = folder / REVOCATIONS_FILE
        self._lock = threading.Lock()
        self._trust = _root(folder / ROOT_FILE, now_ms)
        self._taken, self._revocations = self._list()  # digest of the file that was taken last

    @property
    def trust(self) -> Trust:
        """The newest trust root that was taken."""
        return self._trust

    def revocations(self) -> Revocations:
        """Return the newest list that was taken."""
        return self._revocations

    def look(self) -> str:
        """Look at the list's file again: take a newer one. Returns what is wrong with it, or nothing."""
        with self._lock:
            try:
                if digest(_read(self._path)) == self._taken:
                    return ""
                taken, found = self._list()
            except PapersError as error:
                return str(error)
            newest, because = self._revocations, _against(found, self._revocations)
            if not because:
                self._taken, self._revocations = taken, found
        if because == "old":
            return f"{self._path}: version {found.version} is older than {newest.version}, which is held"
        return f"{self._path}: another list of version {found.version}, which is held" if because else ""

    def take_list(self, data: bytes) -> Judged:
        """Judge a list that came over the mesh, and go by it where it is newer."""
        with self._lock:
            try:
                found = documents.verify_revocations(data, self._trust)
            except DocumentError as error:
                return Judged(fault(error, data, self._trust, "revoke"))
            because = _against(found, self._revocations)
            if not because:
                self._revocations = found
            return Judged(because, found.version)

    def take_root(self, data: bytes, now_ms: int) -> Judged:
        """Judge a trust root that came over the mesh, and go by it where it is newer: it must follow the one held."""
        with self._lock:
            try:
                found = documents.verify_trust_root(data)
                documents.verified_body(TRUST_ROOT, data, self._trust.root_keys, self._trust.threshold)
            except DocumentError as error:
                return Judged(fault(error, data, self._trust, ""))
            because = _wrong_root(found, self._trust, now_ms)
            if not because and found.version > self._trust.version:
                self._trust = found
            return Judged(because, found.version)

    def _list(self) -> tuple[bytes, Revocations]:
        data = _read(self._path)
        try:
            return digest(data), documents.verify_revocations(data, self._trust)
        except DocumentError as error:
            raise PapersError(f"{self._path}: {error}; copy the Directory's newest list there") from error


def fault(error: DocumentError, data: bytes, trust: Trust, purpose: str) -> str:
    """Return the counter of a document that is not what it must be.

    `other_purpose`: it says itself that a Directory's key for another purpose signed it.
    """
    if not isinstance(error, DocumentUnsigned):
        return "malformed"
    others = {key_id(key) for other, key in trust.keys.items() if other != purpose}
    return "other_purpose" if others & {sig.key_id for sig in parse(SignedDoc, data).sigs} else "unsigned"


def _against(found: Revocations, held: Revocations) -> str:
    """Say why a list must not take the place of the one that is held; versions count for each key apart."""
    if found.key_id != held.key_id or found.version > held.version:
        return ""
    if found.version < held.version:
        return "old"
    return "equivocation" if found.digest != held.digest else ""


def _wrong_root(found: Trust, held: Trust, now_ms: int) -> str:
    """Say why a root must not take the place of the one that is held, whose keys signed it."""
    if found.deployment_id != held.deployment_id:
        return "foreign"
    if found.version < held.version or found.expires_ms <= now_ms:
        return "old"
    return "equivocation" if found.version == held.version and found.digest != held.digest else ""


def _root(path: Path, now_ms: int) -> Trust:
    try:
        trust = documents.verify_trust_root(_read(path))
    except DocumentError as error:
        raise PapersError(f"{path}: {error}; copy the Directory's trust root there") from error
    if trust.expires_ms <= now_ms:
        raise PapersError(f"{path}: has expired; copy the Directory's newest trust root there")
    return trust


def _read(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(DOCUMENT_BYTES_MAX + 1)
    except OSError as error:
        raise PapersError(f"{path}: {error.strerror}; copy it from the Directory's folder") from error
