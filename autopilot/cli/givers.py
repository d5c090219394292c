"""Who gave an order of a flight, from what lies beside its log; the checking is `autopilot.ground.ordered`'s."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from autopilot.ground.ordered import ORDER, Addressee, check_order
from autopilot.ground.papers import NODE, ProofRefused, principal_of, trust_root_of
from autopilot.trust.identity import ROOT_FILE, TOKEN_FILE
from events.store import Reader


def givers(reader: Reader, folder: Path, seqs: Iterable[int]) -> dict[int, str]:
    """Return for each of these records that is an order, in words, who signed it, or why that is not proved."""
    orders = {seq: one for seq in seqs for one in reader.stored(seq, seq + 1) if one.kind_number == ORDER}
    if not orders:
        return {}
    try:
        to = _addressee(folder)
    except OSError as error:
        return dict.fromkeys(orders, f"Not proved: who gave it, for nothing beside the log vouches for keys: {error}")
    except ProofRefused as error:
        return dict.fromkeys(orders, f"Not proved: who gave it: {error}")
    return {seq: _words(seq, one.body, to) for seq, one in orders.items()}


def _words(seq: int, body: bytes, to: Addressee) -> str:
    try:
        order = check_order(seq, body, to)
    except ProofRefused as error:
        return f"Not proved: who gave it: {error}"
    return order.words() if order is not None else "Not proved: who gave it, for the log holds no envelope of it"


def _addressee(folder: Path) -> Addressee:
    """Read whose flight it is. Raises OSError, ProofRefused."""
    deployment, token_key = trust_root_of((folder / ROOT_FILE).read_bytes())
    node, _, node_key = principal_of((folder / TOKEN_FILE).read_bytes(), deployment, token_key, kinds=(NODE,))
    return Addressee(deployment, node, node_key, token_key)
