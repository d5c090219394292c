"""The MAVLink 2 link to the vehicle: telemetry in, pointing, flight and missions out, and nothing else out.

`egress` holds the closed list of what may be encoded, `ingress` and `ingress_flight` turn bytes into plain values or
named rejections, `orders` and `flight_words` say which command carries an effect, `modes` how an autopilot numbers its
modes, `commands` matches answers to commands, `mission_form` and `transfer` bring a mission in and read it back,
`performing` joins these, `presence` knows which autopilot is the vehicle, `upkeep` keeps heartbeat and streams alive,
`poses` and `pointing` do the geometry, `telemetry` thins, `reports` tells of the flight, `session` joins all without a
socket, and `link` is the UDP around it.
"""

from autopilot.adapters.vehicle.link import VehicleLink as VehicleLink
