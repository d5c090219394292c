"""The public documents that a relay verifies by: the trust root, pinned at the start, and the newest revocation list.

They lie in a folder of their own. A secret in it is refused, so that a relay never has one by mistake. A list is taken
anew when its file changes; one that is older than what is held, or another of the same version, is not.
"""

from __future__ import annotations

from pathlib import Path

from autopilot.trust import documents
from autopilot.trust.documents import DocumentError, Revocations, Trust
from autopilot.trust.identity import BOX_FILE, EPOCH_FILE, REVOCATIONS_FILE, ROOT_FILE, SIGN_FILE
from autopilot.trust.keys import digest
from autopilot.trust.limits import DOCUMENT_BYTES_MAX

SECRETS = (SIGN_FILE, BOX_FILE, EPOCH_FILE)


class PapersError(Exception):
    """The folder can't be used; the text names the file and the fix."""


class Papers:
    """What a relay knows of whom to believe."""

    def __init__(self, folder: Path, now_ms: int) -> None:
        """Read and verify the folder. Raises PapersError. `now_ms` is wall milliseconds since 1970."""
        for name in SECRETS:
            if (folder / name).exists():
                raise PapersError(f"{folder / name}: a relay holds no secrets; give it a folder with public documents")
        self._folder = folder
        self.trust: Trust = self._root(now_ms)
        self._held, self._revocations = self._list()

    def revocations(self) -> Revocations:
        """Return the newest list that was taken."""
        return self._revocations

    def look(self) -> str:
        """Look at the list's file again: take a newer one. Returns what is wrong with it, or nothing."""
        try:
            held, found = self._list()
        except PapersError as error:
            return str(error)
        path = self._folder / REVOCATIONS_FILE
        if found.version < self._revocations.version:
            return f"{path}: version {found.version} is older than {self._revocations.version}, which is held"
        if found.version == self._revocations.version and held != self._held:
            return f"{path}: another list of version {found.version}, which is held"
        self._held, self._revocations = held, found
        return ""

    def _root(self, now_ms: int) -> Trust:
        path = self._folder / ROOT_FILE
        try:
            trust = documents.verify_trust_root(_read(path))
        except DocumentError as error:
            raise PapersError(f"{path}: {error}; copy the Directory's trust root there") from error
        if trust.expires_ms <= now_ms:
            raise PapersError(f"{path}: has expired; copy the Directory's newest trust root there")
        return trust

    def _list(self) -> tuple[bytes, Revocations]:
        path = self._folder / REVOCATIONS_FILE
        data = _read(path)
        try:
            return digest(data), documents.verify_revocations(data, self.trust)
        except DocumentError as error:
            raise PapersError(f"{path}: {error}; copy the Directory's newest list there") from error


def _read(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(DOCUMENT_BYTES_MAX + 1)
    except OSError as error:
        raise PapersError(f"{path}: {error.strerror}; copy it from the Directory's folder") from error
