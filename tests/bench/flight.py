"""The records that the benchmarks append and read: what a flight at ten frames a second looks like.

Made from the record's number alone, so that every run and every contestant writes the same bytes. It is
a log's shape and size, not a log that the charts would have written: nothing here can be replayed.
"""

from __future__ import annotations

from google.protobuf.message import Message

from events.records import NO_CAUSE, Moment, Record, make_record
from events.schema.common_pb2 import Place
from events.schema.eyes_pb2 import Detection, FrameObserved
from events.schema.findings_pb2 import DiffKind, Sighting, SightingsClassified
from events.schema.vehicle_pb2 import GimbalReported, PositionReported

FLIGHT_ID = bytes(range(16))
SECRET = bytes(range(32))
STEPS_A_SECOND = 27
STEP_NS = 1_000_000_000 // STEPS_A_SECOND


def place(seq: int) -> Place:
    """Return a place a few metres from the one before."""
    east, north = seq * 731 % 400_000, seq * 977 % 400_000
    return Place(
        latitude_e7=521_000_000 + north // 11,
        longitude_e7=43_000_000 + east // 7,
        altitude_mm=30_000,
        h3_cell=0x8A1969C0A007FFF,
        mgrs="31UFT8500072000",
        east_mm=east,
        north_mm=north,
        error_major_mm=4_000,
        error_minor_mm=2_000,
        error_bearing_cdeg=seq * 13 % 36_000,
    )


def detection(seq: int) -> Detection:
    """Return a person somewhere in the image."""
    left = seq * 37 % 9_000
    return Detection(
        class_name="person",
        confidence_e4=6_000 + seq % 3_000,
        x_min_e4=left,
        x_max_e4=left + 400,
        y_min_e4=4_000,
        y_max_e4=5_200,
        place=place(seq),
    )


def frame(seq: int) -> FrameObserved:
    """Return a frame with none to five people in it."""
    found = [detection(seq + nth) for nth in range(seq * 7 % 6)]
    return FrameObserved(
        vehicle=1, camera=1, frame_seq=seq, captured_ns=seq * STEP_NS, latency_us=31_000, detections=found
    )


def classified(seq: int) -> SightingsClassified:
    """Return what the map says of the frame before."""
    known = [
        Sighting(
            detection=nth, diff=DiffKind.EXISTING, object=seq % 50 + nth + 1, class_group="person", distance_mm=900
        )
        for nth in range((seq - 1) * 7 % 6)
    ]
    return SightingsClassified(sightings=known)


def message(seq: int) -> Message:
    """Return the message of record `seq`: of 27, ten are frames, ten decisions on them, two positions, five gimbal."""
    in_second = seq % STEPS_A_SECOND
    if in_second >= 22:
        return GimbalReported(vehicle=1, gimbal=1, pitch_cdeg=-3_000, yaw_cdeg=seq * 11 % 36_000)
    if in_second >= 20:
        return PositionReported(vehicle=1, place=place(seq), height_mm=30_000, heading_cdeg=seq * 7 % 36_000)
    return classified(seq) if in_second % 2 else frame(seq)


def moment(seq: int) -> Moment:
    """Return when record `seq` was recorded."""
    return Moment(seq * STEP_NS, 9_000_000_000 + seq * STEP_NS, 1, 1_790_000_000_000_000_000 + seq * STEP_NS, 2)


def records(count: int) -> list[Record]:
    """Return the first `count` records of the flight."""
    return [make_record(seq, NO_CAUSE, moment(seq), message(seq)) for seq in range(count)]
