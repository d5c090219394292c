"""The MAVLink 2 link to the vehicle: telemetry in, gimbal pointing out, and nothing else out.

`egress` holds the closed list of what may be encoded, `ingress` turns bytes into plain values or
named rejections, `commands` matches answers to commands, `presence` knows which autopilot is the
vehicle, `upkeep` keeps heartbeat and streams alive, `poses` and `pointing` do the geometry,
`telemetry` thins, `session` joins them without a socket, and `link` is the UDP around it.
"""

from autopilot.adapters.vehicle.link import VehicleLink as VehicleLink
