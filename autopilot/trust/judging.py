"""How a document that is offered in flight is judged against what a device holds. Pure functions; nothing is stored.

A revocation list, in this order (seed 000; TUF 5.3.11, tough CVE-2025-2888: judge before anything is kept):

1.  size, parse, signature of `dir.revoke`, deployment                  malformed unsigned
2.  its version against the newest that was taken of the same key:
    lower: rollback, alarm; same and another body: equivocation, alarm;
    same: nothing to do                                                 rollback equivocation same
3.  else it is newer, and taken. Another key's versions are counted apart: so a list of version 2^63, signed by whoever
    stole the key, is overcome by a TrustRoot that names another key.

Whether a list is overdue does not matter here: an overdue list still revokes.

An epoch bundle:

1.  size, parse, signature of `dir.epoch`, deployment, for this device  malformed unsigned foreign
2.  an epoch that is held: same key: nothing to do; another: alarm      same equivocation
3.  an epoch below the newest ever taken, or below the list's least     old
4.  the wrapped key opens and is the one committed to                   malformed

A TrustRoot:

1.  whole by its own word, and signed by the root keys that are held, as many as those ask for
                                                                        malformed unsigned foreign
2.  lower version: rollback; same version, another body: equivocation; same: nothing to do
                                                                        rollback equivocation same
    Root keys themselves change only by issuing the identity again: one that names other root keys is unsigned.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from autopilot.trust import documents
from autopilot.trust.documents import DocumentError, DocumentUnsigned, Revocations, Trust
from autopilot.trust.fetching import Offered, What
from autopilot.trust.identity import Epoch, Identity, open_epoch
from autopilot.trust.keys import SealBroken, key_id
from autopilot.trust.pae import TRUST_ROOT
from events.schema.trust_pb2 import TrustAlarm
from events.schema.waypoint_pb2 import EpochBundle


class Known(NamedTuple):
    """A version that was taken, and of what."""

    version: int
    digest: bytes


NONE = Known(0, b"")


@dataclass(frozen=True, slots=True)
class Floors:
    """The highest that was ever taken, as the log has it: what is held may be older where a disk lost it."""

    lists: Mapping[bytes, Known]  # by the id of the key that signed them
    epoch_id: int = 0
    root: Known = NONE


@dataclass(frozen=True, slots=True)
class Refused:
    """Why a document is not taken."""

    what: Offered
    alarm: TrustAlarm | None = None


def judge_revocations(data: bytes, held: Identity, floors: Floors) -> Revocations | Refused:
    """Judge a list; return it where it is to be taken."""
    try:
        offered = documents.verify_revocations(data, held.trust)
    except DocumentError as error:
        return Refused(_fault(error))
    newest = floors.lists.get(offered.key_id, NONE)
    if offered.version == newest.version == held.revocations.version and offered.digest == newest.digest:
        return Refused(Offered.SAME)
    return _against(newest, Known(offered.version, offered.digest), "revocations") or offered


def judge_epoch(data: bytes, held: Identity, floors: Floors) -> Epoch | Refused:
    """Judge a bundle; return its opened key where it is to be taken."""
    try:
        bundle = documents.verify_epoch_bundle(data, held.trust)
    except DocumentError as error:
        return Refused(_fault(error))
    if bundle.recipient_device_key_id != key_id(held.public_key):
        return Refused(Offered.FOREIGN)
    known = held.epochs.get(bundle.epoch_id)
    if known is not None:
        return Refused(Offered.SAME) if _is_same(bundle, known) else _two_keys(bundle, known)
    if bundle.epoch_id < max(floors.epoch_id, held.revocations.min_epoch_id):
        return Refused(Offered.OLD)
    try:
        return open_epoch(bundle, held.sign_key, held.box_key)
    except SealBroken:
        return Refused(Offered.MALFORMED)


def judge_root(data: bytes, held: Identity, floors: Floors) -> Trust | Refused:
    """Judge a TrustRoot; return it where it is to be taken."""
    try:
        offered = documents.verify_trust_root(data)
        documents.verified_body(TRUST_ROOT, data, held.trust.root_keys, held.trust.threshold)
    except DocumentError as error:
        return Refused(_fault(error))
    if offered.deployment_id != held.deployment_id:
        return Refused(Offered.FOREIGN)
    wrong = _against(floors.root, Known(offered.version, offered.digest), "trust_root")
    if wrong is None and offered.version == held.trust.version:
        return Refused(Offered.SAME)
    return wrong or offered


def _against(newest: Known, offered: Known, document: What) -> Refused | None:
    """Say what is wrong with an offered version; None: nothing, it is newer, or the one that was lost."""
    if offered.version < newest.version:
        return Refused(Offered.ROLLBACK, _alarm("rollback", document, newest, offered))
    if offered.version == newest.version and offered.digest != newest.digest:
        return Refused(Offered.EQUIVOCATION, _alarm("equivocation", document, newest, offered))
    return None


def _two_keys(bundle: EpochBundle, known: Epoch) -> Refused:
    held = Known(known.epoch_id, documents.epoch_commitment(known.epoch_id, known.secret))
    offered = Known(bundle.epoch_id, bundle.key_commitment)
    return Refused(Offered.EQUIVOCATION, _alarm("equivocation", "epoch", held, offered))


def _is_same(bundle: EpochBundle, known: Epoch) -> bool:
    return bundle.key_commitment == documents.epoch_commitment(known.epoch_id, known.secret)


def _alarm(what: str, document: What, held: Known, offered: Known) -> TrustAlarm:
    return TrustAlarm(
        what=what,
        document=document,
        held_version=held.version,
        offered_version=offered.version,
        held_digest=held.digest,
        offered_digest=offered.digest,
    )


def _fault(error: DocumentError) -> Offered:
    return Offered.UNSIGNED if isinstance(error, DocumentUnsigned) else Offered.MALFORMED
