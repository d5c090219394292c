"""The whole state of the core. Only `evolve` changes it, and only from records (design, section 3)."""

from __future__ import annotations

from events.records import Record
from events.schema.mission_pb2 import MissionPlanned
from statecharts.facts import (
    Aim,
    Arrival,
    Camera,
    Control,
    Effect,
    Failsafe,
    Gimbal,
    Ignored,
    Lens,
    Link,
    Manifest,
    MapObject,
    Mission,
    Order,
    Override,
    Poi,
    Scan,
    Selftest,
    Spot,
    Trusted,
    Vehicle,
    Whereabouts,
)
from statecharts.geometry import Fence
from statecharts.journal import Journal, Keyed, Single


class State:
    """Everything that decisions depend on. Keys are named beside each table."""

    __slots__ = (
        "aims",
        "arrival",
        "batteries",
        "cameras",
        "controls",
        "deadlines",
        "effects",
        "failsafes",
        "failures",
        "fences",
        "forgot_ns",
        "frame",
        "gimbals",
        "grid",
        "health",
        "ignored",
        "journal",
        "lenses",
        "links",
        "lists",
        "manifest",
        "missions",
        "next_seq",
        "nonces",
        "objects",
        "open_pois",
        "order_seqs",
        "orders",
        "origin",
        "overrides",
        "owed_acks",
        "plans",
        "pois",
        "scans",
        "selftests",
        "surfacings",
        "trusted",
        "vehicles",
        "whereabouts",
    )

    def __init__(self) -> None:
        journal = self.journal = Journal()
        self.next_seq: Single[int] = Single(journal, 0)
        self.manifest: Single[Manifest | None] = Single(journal, None)
        self.origin: Single[Spot | None] = Single(journal, None)
        self.health: Single[str] = Single(journal, "normal")
        self.failures: Single[tuple[int, ...]] = Single(journal, ())  # flight_ns of failed steps
        self.arrival: Single[Arrival | None] = Single(journal, None)
        self.orders: Keyed[str, Order] = Keyed(journal)  # order key
        self.order_seqs: Keyed[bytes, int] = Keyed(journal)  # device key id
        self.nonces: Keyed[tuple[bytes, bytes], int] = Keyed(journal)  # device key id, nonce: kept until
        self.forgot_ns: Single[int] = Single(journal, 0)  # when old orders and nonces were last looked for
        self.effects: Keyed[int, Effect] = Keyed(journal)  # seq of the effect
        self.owed_acks: Keyed[int, str] = Keyed(journal)  # seq of the send_ack: order key
        self.trusted: Single[Trusted] = Single(journal, Trusted())
        self.lists: Keyed[bytes, tuple[int, bytes]] = Keyed(journal)  # Directory's key id: version, digest; the newest
        self.cameras: Keyed[str, Camera] = Keyed(journal)  # camera key
        self.aims: Keyed[str, Aim] = Keyed(journal)  # gimbal key
        self.controls: Keyed[str, Control] = Keyed(journal)  # gimbal key
        self.gimbals: Keyed[str, Gimbal] = Keyed(journal)  # gimbal key; those that were described
        self.lenses: Keyed[str, Lens] = Keyed(journal)  # camera key; those that were described
        self.vehicles: Keyed[int, Vehicle] = Keyed(journal)  # vehicle number
        self.plans: Keyed[int, MissionPlanned] = Keyed(journal)  # vehicle number; as recorded, never changed
        self.missions: Keyed[int, Mission] = Keyed(journal)  # vehicle number
        self.selftests: Keyed[int, Selftest] = Keyed(journal)  # vehicle number
        self.fences: Keyed[int, Fence] = Keyed(journal)  # index in the mission
        self.links: Keyed[str, Link] = Keyed(journal)  # "operators"
        self.failsafes: Keyed[str, Failsafe] = Keyed(journal)  # vehicle and name: "1/fence"
        self.overrides: Keyed[tuple[int, int], Override] = Keyed(journal)  # vehicle, OverrideScope
        self.whereabouts: Keyed[int, Whereabouts] = Keyed(journal)  # vehicle number; not there: not told
        self.batteries: Keyed[int, int] = Keyed(journal)  # vehicle number: charge in percent, as last known
        self.objects: Keyed[int, MapObject] = Keyed(journal)  # object number, from 1
        self.grid: Keyed[tuple[str, int, int], tuple[int, ...]] = Keyed(journal)  # class group, cell east, cell north
        self.pois: Keyed[str, Poi] = Keyed(journal)  # UUID string
        self.open_pois: Keyed[str, None] = Keyed(journal)  # those of `pois` that are enqueued or surfaced
        self.ignored: Keyed[str, Ignored] = Keyed(journal)  # UUID string of the declined point of interest
        self.surfacings: Single[tuple[int, ...]] = Single(journal, ())  # flight_ns of questions in the last minute
        self.frame: Single[Record | None] = Single(journal, None)  # the newest frame, for what is said about it
        self.scans: Keyed[str, Scan] = Keyed(journal)  # camera key
        self.deadlines: Keyed[tuple[str, str], int] = Keyed(journal)  # chart, instance: flight_ns

    @property
    def flight(self) -> Manifest:
        """The manifest. Raises LookupError before the flight was opened: our fault."""
        manifest = self.manifest.value
        if manifest is None:
            raise LookupError("the flight has no manifest yet")
        return manifest

    @property
    def commands_flight(self) -> bool:
        """Whether this node has a say in how its vehicle flies: orders, a mission, failsafes."""
        if self.manifest.value is None:
            return False
        limits = self.manifest.value.limits
        return limits.flight_enabled or limits.mission_enabled

    def passed(self, chart: str, now_ns: int) -> tuple[str, ...]:
        """Return the instances of a chart whose deadline has passed, in order."""
        return tuple(key[1] for key, at_ns in self.deadlines.items() if key[0] == chart and at_ns <= now_ns)

    def waiting(self, chart: str) -> tuple[str, ...]:
        """Return the instances of a chart that have a deadline at all, in order."""
        return tuple(key[1] for key, _ in self.deadlines.items() if key[0] == chart)
