"""The mesh: orders in, acks and status out, over Zenoh.

`MeshAdapter` is what the node joins; `Link` is a Zenoh session that keeps trying, used by the
ground tools too; `TrustClient` and `TrustFolder` fetch a Directory's documents. No Zenoh type leaves this package.
"""

from autopilot.adapters.mesh.adapter import MeshAdapter as MeshAdapter
from autopilot.adapters.mesh.link import Link as Link
from autopilot.adapters.mesh.link import LinkDown as LinkDown
from autopilot.adapters.mesh.link import Wire as Wire
from autopilot.adapters.mesh.trust_client import TrustClient as TrustClient
from autopilot.adapters.mesh.trust_folder import TrustFolder as TrustFolder
