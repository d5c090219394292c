"""`python -m tests.whole.dying run ...`: the daemon, which dies between a failsafe's record and its bytes.

It kills itself with SIGKILL as the command reaches the vehicle's link: the record is durable, nothing has left.
"""

from __future__ import annotations

import os
import signal
import sys

from google.protobuf.message import Message

from autopilot.adapters.vehicle.session import Session
from autopilot.cli.main import main
from events.schema.safety_pb2 import FLIGHT_MODE_RETURN, SetVehicleMode


class DyingSession(Session):
    """A link that its process doesn't survive using for a return."""

    def perform(self, now_ns: int, effect_seq: int, effect: Message, deadline_ns: int) -> None:
        """Die of a return; take anything else."""
        if isinstance(effect, SetVehicleMode) and effect.mode == FLIGHT_MODE_RETURN and not effect.order:
            os.kill(os.getpid(), signal.SIGKILL)
        super().perform(now_ns, effect_seq, effect, deadline_ns)


if __name__ == "__main__":
    from autopilot.adapters.vehicle import link

    link.Session = DyingSession  # type: ignore[attr-defined]
    sys.exit(main())
