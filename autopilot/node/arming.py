"""What a flight's records say of motors: whether it flew, and whether it was left (design, section 4: `abandoned`).

A fold over observations, so a start that comes in between sees what the one before it saw. Whether anything is armed
at this moment is the state's to say.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from events.records import Record
from events.schema.vehicle_pb2 import VehicleStateReported


@dataclass(slots=True)
class Arming:
    """Follows one flight."""

    flown: bool = False  # a vehicle was armed in this flight
    abandoned: bool = False  # a boot found disarmed what an earlier boot had recorded armed, and nothing armed since
    armed_in: dict[int, int] = field(default_factory=dict)  # by vehicle: the boot that last saw it armed, till disarmed

    def note(self, observation: Record) -> None:
        """Take in what a vehicle reported; anything else is no news."""
        report = observation.message
        if not isinstance(report, VehicleStateReported):
            return
        boot = observation.at.boot
        if report.armed:
            self.flown, self.abandoned = True, False
            self.armed_in[report.vehicle] = boot
        elif self.armed_in.pop(report.vehicle, boot) < boot:
            self.abandoned = True
