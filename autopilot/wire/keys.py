"""Every Zenoh key expression in one table: which way it goes, how often, what it carries, whether it is recorded.

Building and taking apart keys is all that happens here; who listens where is the adapters' business.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

PREFIX = "waypoint/global"


class Direction(Enum):
    """Which way a message goes, seen from the node."""

    IN = "in"
    OUT = "out"


class Delivery(Enum):
    """What Zenoh is asked to do with a message when the link is slow."""

    BLOCK = "reliable, block, high priority"  # nothing is dropped; the sender waits
    DROP = "reliable, drop, normal priority"  # the newest replaces what could not leave


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """One row of the table."""

    name: str
    pattern: str  # with <node> and <cmd_id> as the seed writes them, <deployment>, <device_key_id>, <principal>
    direction: Direction
    envelope_type: int | None  # None: a query, in no envelope
    content: str  # message of package waypoint.v1 that is sealed inside
    rate_hz: float | None  # None: as people order
    delivery: Delivery
    input_class: str | None  # class of the node's inbox; None: the node does not take it in
    recorded: bool
    says: str


ORDERS = Channel(
    name="orders",
    pattern=f"{PREFIX}/cmd/<node>/<cmd_id>",
    direction=Direction.IN,
    envelope_type=1,
    content="DeviceCommand",
    rate_hz=None,
    delivery=Delivery.BLOCK,
    input_class="order",
    recorded=True,
    says="An order for one node; re-published as fresh envelopes while it lives.",
)
ACKS = Channel(
    name="acks",
    pattern=f"{PREFIX}/ack/<node>/<cmd_id>",
    direction=Direction.OUT,
    envelope_type=2,
    content="CommandAck",
    rate_hz=None,
    delivery=Delivery.BLOCK,
    input_class=None,
    recorded=True,
    says="The node's answer to one envelope of an order.",
)
STATUS = Channel(
    name="status",
    pattern=f"{PREFIX}/status/<node>",
    direction=Direction.OUT,
    envelope_type=3,
    content="NodeStatus",
    rate_hz=1.0,
    delivery=Delivery.DROP,
    input_class=None,
    recorded=False,
    says="What the node says of itself, once a second and on change; upkeep, not an effect.",
)
COSIGNATURES = Channel(
    name="cosignatures",
    pattern=f"{PREFIX}/cosign/<node>",
    direction=Direction.IN,
    envelope_type=5,
    content="CheckpointCosignature",
    rate_hz=None,
    delivery=Delivery.DROP,
    input_class="outcome",
    recorded=True,
    says="A witness's signature under a checkpoint that the node published.",
)
PRESENCE = Channel(
    name="presence",
    # The source system's heartbeat/<principal>, bound to one node: an envelope can echo one challenge only.
    pattern=f"{PREFIX}/heartbeat/<node>/<principal>",
    direction=Direction.IN,
    envelope_type=6,
    content="OperatorPresence",
    rate_hz=1.0,
    delivery=Delivery.DROP,
    input_class="outcome",
    recorded=True,
    says="An operator is there and attends this node; recorded thinned, as operator_heard; never answered.",
)
PROOFS = Channel(
    name="proofs",
    pattern=f"{PREFIX}/proof/<node>",
    direction=Direction.IN,
    envelope_type=None,
    content="ConsistencyRequest",
    rate_hz=2.0,
    delivery=Delivery.DROP,
    input_class=None,
    recorded=False,
    says="A query, answered with a ConsistencyAnswer; hashes only, so neither is sealed or signed.",
)
TRUST_ROOTS = Channel(
    name="trust roots",
    pattern=f"{PREFIX}/trust/<deployment>/trust_root",
    direction=Direction.IN,
    envelope_type=None,
    content="SignedDoc",
    rate_hz=None,
    delivery=Delivery.DROP,
    input_class=None,
    recorded=False,
    says="The newest TrustRoot: published by the Directory when it changes, and its answer to an empty query.",
)
REVOCATIONS = Channel(
    name="revocations",
    pattern=f"{PREFIX}/trust/<deployment>/revocations",
    direction=Direction.IN,
    envelope_type=None,
    content="SignedDoc",
    rate_hz=None,
    delivery=Delivery.DROP,
    input_class=None,
    recorded=False,
    says="The newest RevocationList, likewise.",
)
EPOCHS = Channel(
    name="epochs",
    pattern=f"{PREFIX}/trust/<deployment>/epoch",
    direction=Direction.IN,
    envelope_type=None,
    content="SignedDoc",
    rate_hz=None,
    delivery=Delivery.DROP,
    input_class=None,
    recorded=False,
    says="A query with a device's key id, answered with Documents: its EpochBundles, in use and next.",
)
BUNDLES = Channel(
    name="bundles",
    pattern=f"{PREFIX}/trust/<deployment>/epoch/<device_key_id>",
    direction=Direction.IN,
    envelope_type=None,
    content="SignedDoc",
    rate_hz=None,
    delivery=Delivery.DROP,
    input_class=None,
    recorded=False,
    says="A new EpochBundle for one device, published when it is made.",
)
TIMES = Channel(
    name="times",
    pattern=f"{PREFIX}/trust/<deployment>/time",
    direction=Direction.IN,
    envelope_type=None,
    content="SignedDoc",
    rate_hz=None,
    delivery=Delivery.DROP,
    input_class=None,
    recorded=False,
    says="A query with a challenge of 16 bytes, answered with a TimeBeacon.",
)
NODES = Channel(
    name="nodes",
    pattern=f"{PREFIX}/trust/<deployment>/nodes",
    direction=Direction.OUT,
    envelope_type=None,
    content="SignedDoc",
    rate_hz=None,
    delivery=Delivery.DROP,
    input_class=None,
    recorded=False,
    says="An operator's empty query, answered with Documents: the IdentityTokens of the nodes that there are.",
)
RENEWALS = Channel(
    name="renewals",
    pattern=f"{PREFIX}/trust/<deployment>/renew",
    direction=Direction.IN,
    envelope_type=None,
    content="SignedDoc",
    rate_hz=None,
    delivery=Delivery.DROP,
    input_class=None,
    recorded=False,
    says="A query with a RenewalRequest signed by a device, answered with its newest IdentityToken.",
)
ENROLMENTS = Channel(
    name="enrolments",
    pattern=f"{PREFIX}/enrol",
    direction=Direction.IN,
    envelope_type=None,
    content="SignedDoc",
    rate_hz=None,
    delivery=Delivery.DROP,
    input_class=None,
    recorded=False,
    says="A query with an EnrolmentRequest under a code, answered with an EnrolmentAnswer; empty: refused.",
)
NODE_CHANNELS = (ORDERS, ACKS, STATUS, COSIGNATURES, PRESENCE, PROOFS)
DIRECTORY_CHANNELS = (TRUST_ROOTS, REVOCATIONS, EPOCHS, BUNDLES, TIMES, NODES, RENEWALS, ENROLMENTS)
CHANNELS = (*NODE_CHANNELS, *DIRECTORY_CHANNELS)


@dataclass(frozen=True, slots=True)
class Address:
    """A key of orders or acks taken apart."""

    node: str
    command_id: str


def order_key(node: str, command_id: str) -> str:
    """Key that an order for `node` is published on."""
    return f"{PREFIX}/cmd/{node}/{command_id}"


def ack_key(node: str, command_id: str) -> str:
    """Key that `node` answers an order on."""
    return f"{PREFIX}/ack/{node}/{command_id}"


def status_key(node: str) -> str:
    """Key that `node` publishes its status on."""
    return f"{PREFIX}/status/{node}"


def cosign_key(node: str) -> str:
    """Key that cosignatures for `node` are published on."""
    return f"{PREFIX}/cosign/{node}"


def presence_key(node: str, principal: str) -> str:
    """Key that an operator's presence at `node` is published on."""
    return f"{PREFIX}/heartbeat/{node}/{principal}"


def presences_of(node: str) -> str:
    """Key expression of everybody's presence at `node`."""
    return f"{PREFIX}/heartbeat/{node}/*"


def proof_key(node: str) -> str:
    """Key that `node` answers queries for consistency proofs on."""
    return f"{PREFIX}/proof/{node}"


def trust_key(channel: Channel, deployment: str) -> str:
    """Key of one of the Directory's channels in a deployment."""
    return channel.pattern.replace("<deployment>", deployment)


def bundle_key(deployment: str, device_key_id: bytes) -> str:
    """Key that new EpochBundles for a device are published on."""
    return trust_key(BUNDLES, deployment).replace("<device_key_id>", device_key_id.hex())


def orders_of(node: str) -> str:
    """Key expression of every order for `node`."""
    return f"{PREFIX}/cmd/{node}/**"


def acks_of(node: str) -> str:
    """Key expression of every ack of `node`."""
    return f"{PREFIX}/ack/{node}/*"


def order_address(key_expr: str) -> Address | None:
    """Take an order's key apart; None when it is no such key."""
    return _address(key_expr, "cmd")


def ack_address(key_expr: str) -> Address | None:
    """Take an ack's key apart; None when it is no such key."""
    return _address(key_expr, "ack")


def status_node(key_expr: str) -> str | None:
    """Return the node whose status is published on `key_expr`; None when it is no such key."""
    head, _, node = key_expr.rpartition("/")
    return node if head == f"{PREFIX}/status" and node else None


def _address(key_expr: str, verb: str) -> Address | None:
    head, _, rest = key_expr.partition(f"/{verb}/")
    node, _, command_id = rest.partition("/")
    if head != PREFIX or not node or not command_id or "/" in command_id:
        return None
    return Address(node, command_id)
