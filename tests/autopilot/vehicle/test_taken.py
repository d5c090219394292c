"""Core, link and simulated aircraft together, without sockets: an order to the gimbal, and who takes it away."""

from __future__ import annotations

from collections.abc import Sequence

from autopilot.adapters.vehicle.session import Report, Session, Transmit
from autopilot.ports.config import VehicleSection
from autopilot.sim.aircraft import Aircraft
from autopilot.sim.gimbal import Angles
from events import Record
from events.schema.common_pb2 import Moved
from events.schema.flight_pb2 import ROI_TURNING_REFUSE, NodeStarted, OriginSet
from events.schema.orders_pb2 import OrderReceived, SendAck
from tests.autopilot.vehicle.vehicles import PEER, plain_place
from tests.flights import Flight, limits, opened, place, point_at_angles, point_at_place, release

STEP_MS = 50


class Air:
    """A flight whose effects reach an aircraft, and that hears what the aircraft says."""

    def __init__(self, *, pans: bool = True, measures: bool = True) -> None:
        bounds = limits(roi_turning=ROI_TURNING_REFUSE, drift_cdeg=200, drift_settle_ms=2_000, operator_hold_ms=20_000)
        started = NodeStarted(boot_id="boot", start=1)
        self.flight = Flight(opened(bounds), started, OriginSet(place=place(0, 0), source="configured"))
        self.aircraft = Aircraft(1, 300)
        self.aircraft.gimbal.pans = pans
        settings = VehicleSection(connect="127.0.0.1:14550", gimbal_measures=measures)
        self.session = Session(
            settings,
            plain_place,
            lambda *_: None,
            lambda: True,
            arrival_tolerance_deg=1.0,
            peer=PEER,
            on_time=lambda _: None,
        )

    def fly(self, seconds: float) -> None:
        for _ in range(round(seconds * 1000 / STEP_MS)):
            self.aircraft.step(STEP_MS / 1000)
            self._perform(self.flight.wait(STEP_MS))
            for _, datagram in self.aircraft.take():
                self.session.hear(self.flight.now_ns, PEER, datagram)
            self._turn()

    def order(self, order: OrderReceived) -> None:
        self._perform(self.flight.tell(order))
        self._turn()

    def _turn(self) -> None:
        self.session.tick(self.flight.now_ns)
        while outputs := self.session.take():
            for output in outputs:
                if isinstance(output, Report):
                    self._perform(self.flight.tell(output.observation))
                elif isinstance(output, Transmit):
                    self.aircraft.hear(PEER, output.data)
                    if output.effect_seq is not None:
                        self.session.sent(output.effect_seq)

    def _perform(self, records: Sequence[Record]) -> None:
        for record in records:
            if record.kind.port == "vehicle":
                deadline_ns = self.flight.now_ns + 5_000_000_000
                self.session.perform(self.flight.now_ns, record.seq, record.message, deadline_ns)

    def moves(self, chart: str) -> list[tuple[str, str]]:
        changes = (record.message for record in self.flight.records)
        return [(one.to_state, one.because) for one in changes if isinstance(one, Moved) and one.chart == chart]

    def answers(self) -> list[str]:
        acks = (record.message for record in self.flight.records)
        return [ack.detail for ack in acks if isinstance(ack, SendAck) and ack.final]


def test_another_station_takes_the_gimbal() -> None:
    """Taken once, arrived, taken away and said whose it is now, given back, and let go when the hold is over."""
    air = Air()
    air.fly(3)
    air.order(point_at_angles("a", -5_000, 9_000))
    air.fly(4)
    assert air.aircraft.gimbal.primary == (1, 191)
    assert [state for state, _ in air.moves("aim")] == ["moving", "arrived"]
    air.aircraft.gimbal.take_over(255, 190, Angles(0, 0, False))
    air.fly(5)
    assert air.moves("aim")[-1] == ("drifted", "255/190 took it")
    assert [state for state, _ in air.moves("control")] == ["nobody", "asked", "ours", "others"]
    air.order(point_at_angles("b", -4_000, 9_000, order_seq=2))
    air.fly(4)
    assert air.aircraft.gimbal.primary == (255, 190)
    assert air.answers()[-1] == "COMMAND_ACK: MAV_RESULT_ACCEPTED; 255/190 controls the gimbal"
    assert air.moves("aim")[-1][0] == "arrived"
    air.aircraft.gimbal.configure((0, 0), (255, 190))
    air.fly(1)
    air.order(point_at_angles("c", -4_500, 9_000, order_seq=3))
    air.fly(1)
    assert air.aircraft.gimbal.primary == (1, 191)
    air.order(release("d", order_seq=4))
    air.fly(5)
    assert air.aircraft.gimbal.primary == (0, 0)
    assert air.moves("control")[-1] == ("nobody", "given up: no operator holds the camera any more")


def test_a_mount_that_does_not_pan_is_found_out() -> None:
    """Its place is refused before anything turns; angles that it can do are not."""
    air = Air(pans=False)
    air.fly(3)
    air.order(point_at_place("a"))
    air.order(point_at_angles("b", 2_100, 0, order_seq=2))
    air.order(point_at_angles("c", -5_000, 0, order_seq=3, yaw_locked=False))
    air.fly(4)
    assert air.answers() == [
        "no gimbal that pans: the vehicle itself would turn",
        "pitch 21 is above the limit of 20",
        "COMMAND_ACK: MAV_RESULT_ACCEPTED",
    ]
    assert air.moves("aim")[-1] == ("arrived", "measured within the tolerance")


def test_a_servo_mount_is_commanded_not_measured() -> None:
    air = Air(measures=False)
    air.fly(3)
    air.order(point_at_angles("a", -5_000, 9_000))
    air.fly(4)
    assert air.moves("aim")[-1] == ("arrived", "commanded there: nothing measures it")
