"""How one TrustRoot follows another: what was pinned at enrolment decides what may replace it.

The keys of the root stay the same as long as a deployment lives; what a new version changes are the Directory's keys
and the expiry. Nothing is stored here.
"""

from __future__ import annotations

from autopilot.trust.documents import DocumentMalformed, Trust, parse, verified_body, verify_trust_root
from autopilot.trust.pae import TRUST_ROOT
from events.schema.waypoint_pb2 import SignedDoc, TrustRoot


def root_of(data: bytes) -> TrustRoot:
    """Return the body of a TrustRoot that was verified before. Raises DocumentMalformed."""
    return parse(TrustRoot, parse(SignedDoc, data).body)


def verify_successor(data: bytes, pinned: bytes) -> Trust:
    """Verify `data` as the TrustRoot that replaces `pinned`, which is believed already. Raises DocumentError.

    1. It is whole, and signed by the root that it names itself.
    2. It is signed by as many of the pinned root's keys as the pinned root asks for (TUF 1.0.34, section 5.3.4).
    3. It is of the same deployment.
    4. Its version is higher: an older root would bring keys back that were rotated away.
    """
    old = root_of(pinned)
    found = verify_trust_root(data)  # 1
    verified_body(TRUST_ROOT, data, list(old.root_keys), old.threshold)  # 2
    if found.deployment_id != old.deployment_id:  # 3
        raise DocumentMalformed("TrustRoot: deployment_id: is another deployment's")
    if found.version <= old.version:  # 4
        raise DocumentMalformed(f"TrustRoot: version: {found.version} does not follow {old.version}")
    return found
