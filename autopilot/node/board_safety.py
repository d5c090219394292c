"""What the board says of failsafes, in the words of the wire."""

from __future__ import annotations

from events.schema.waypoint_pb2 import FailsafeStatus, NodeStatus, OverrideStatus
from projections.picture import Picture

NS_PER_MS = 1_000_000
# States of the chart `safety` as an operator reads them; one that is at rest is not named.
STATES = {
    "held_off": "held off",
    "unreachable": "vehicle unreachable",
    "overruled": "landing instead",
    "pending": "about to command",
    "settling": "over for the moment",
}


def say_safety(said: NodeStatus, picture: Picture, now_ns: int) -> None:
    """Add links, charge, failsafes, and who holds them off; ends as what is left."""
    said.failsafes_enabled = picture.failsafes_enabled
    if picture.operator_link:
        said.operator_link = picture.operator_link
    charges = [one.battery_percent for one in picture.vehicles.values() if one.battery_percent is not None]
    if charges:
        said.battery_percent = charges[0]
    for key, one in picture.failsafes.items():
        if one.state != "ok":
            name, state = key.partition("/")[2], STATES.get(one.state, one.state)
            said.failsafes.append(FailsafeStatus(name=name, state=state, because=one.because))
    for held in picture.overrides.values():
        said.overrides.append(
            OverrideStatus(
                scope=held.scope,
                callsign=held.callsign or held.principal_id,
                reason=held.reason,
                left_ms=max(held.until_ns - now_ns, 0) // NS_PER_MS,
            )
        )
    said.properties_broken.extend(f"{name}: {words}" for name, words in picture.properties_broken.items())
