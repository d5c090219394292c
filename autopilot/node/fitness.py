"""What each item of the self-test comes to: plain values in, a verdict and words for a pilot out.

Pass: as it should be. Degraded: it can be flown with where a person takes that on. Fail: it can't. Skipped: this node
has no such thing, so there is nothing to ask. Nothing here measures anything; `selftest` does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from autopilot.ports.edges import VehicleFacts
from events.schema.mission_pb2 import (
    SELFTEST_DEGRADED,
    SELFTEST_FAIL,
    SELFTEST_PASS,
    SELFTEST_SKIPPED,
    SelftestItem,
    SelftestVerdict,
)

HOUR_MS = 3_600_000
MIB = 1 << 20

FIX_3D = 3  # GPS_FIX_TYPE
SATELLITES_GOOD, SATELLITES_FEW = 8, 6
HDOP_GOOD_E2, HDOP_POOR_E2 = 150, 250  # dilution of 1.5 is usual under open sky; from 2.5 on a fence is a guess
GIMBAL_SILENT_MS = 3_000  # it is asked for ten times a second
FRAMES_SILENT_MS = 3_000  # of all frames, not of those that are recorded
WARM_US = 100_000  # a detector that takes longer than this for a frame is not yet warm, or too slow (10 a second)
BATTERY_MARGIN_PERCENT = 25  # above the charge at which the vehicle returns: else the flight ends as it begins
OPERATOR_SILENT_MS = 5_000
TOKEN_LEAST_MS = HOUR_MS  # a node whose token ends in flight can't answer any more

Verdict = tuple[SelftestVerdict.ValueType, str]
PASS, DEGRADED, FAIL, SKIPPED = SELFTEST_PASS, SELFTEST_DEGRADED, SELFTEST_FAIL, SELFTEST_SKIPPED


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """What was found; None where there is no such thing here, or nothing of it was heard."""

    log_failure: str  # why nothing can be written beside the log; "" where it can
    free_bytes: int | None  # None: it could not be found out, and `space_failure` says why
    space_failure: str
    needed_bytes: int  # what `[retention] min_free_mib` keeps free
    clock_trusted: bool
    token_left_ms: int
    has_epoch: bool
    list_overdue_ms: int
    has_camera: bool
    frame_ms_ago: int | None
    detector_us: int | None
    has_gimbal: bool
    gimbal_ms_ago: int | None
    vehicle: VehicleFacts | None
    return_percent: int  # charge at which the vehicle returns; 0: never
    fences: int
    mission_items: int | None  # None: no mission was planned
    has_mesh: bool
    operator_ms_ago: int | None


def log(found: Found) -> Verdict:
    """Whether the log's folder takes what is written to it."""
    if found.log_failure:
        return FAIL, f"nothing can be written beside the log: {found.log_failure}"
    return PASS, "can be written"


def space(found: Found) -> Verdict:
    """Whether the disk has room for the flight."""
    if found.free_bytes is None:
        return FAIL, f"it can't be told how much is free: {found.space_failure}"
    words = f"{found.free_bytes // MIB} MiB free"
    if found.free_bytes < found.needed_bytes // 4:
        return FAIL, f"{words}: push and delete flights first"
    if found.free_bytes < found.needed_bytes:
        return DEGRADED, f"{words}, less than the {found.needed_bytes // MIB} MiB that are kept free"
    return PASS, words


def clock(found: Found) -> Verdict:
    """Whether the node knows what time it is."""
    if found.clock_trusted:
        return PASS, "the time is known"
    return DEGRADED, "the time is uncertain: orders must echo this node's challenge"


def keys(found: Found) -> Verdict:
    """Whether the node's identity lasts."""
    if found.token_left_ms <= 0:
        return FAIL, "this node's token has expired: enrol it again"
    if found.token_left_ms < TOKEN_LEAST_MS:
        return DEGRADED, f"this node's token ends in {found.token_left_ms // 60_000} min"
    return PASS, f"this node's token holds for {found.token_left_ms // HOUR_MS} h"


def epoch(found: Found) -> Verdict:
    """Whether the group key and the list of the revoked are fresh."""
    if not found.has_epoch:
        return FAIL, "no group key: no order can be opened"
    if found.list_overdue_ms > 0:
        return DEGRADED, f"the revocation list is overdue by {found.list_overdue_ms // 60_000} min"
    return PASS, "group key and revocation list are fresh"


def camera(found: Found) -> Verdict:
    """Whether frames come."""
    if not found.has_camera:
        return SKIPPED, "no camera is configured"
    if found.frame_ms_ago is None or found.frame_ms_ago > FRAMES_SILENT_MS:
        return FAIL, "no frames come"
    return PASS, "frames come"


def detector(found: Found) -> Verdict:
    """Whether the detector is warm."""
    if not found.has_camera:
        return SKIPPED, "no camera is configured"
    if found.detector_us is None:
        return FAIL, "the detector has not answered yet"
    words = f"{found.detector_us // 1000} ms a frame"
    return (PASS, words) if found.detector_us <= WARM_US else (DEGRADED, f"{words}: slow, or still warming up")


def gimbal(found: Found) -> Verdict:
    """Whether the gimbal says where it looks."""
    if not found.has_gimbal:
        return SKIPPED, "the camera is fixed"
    if found.gimbal_ms_ago is None:
        return DEGRADED, "the gimbal has never told where it looks"
    if found.gimbal_ms_ago > GIMBAL_SILENT_MS:
        return DEGRADED, f"the gimbal has been silent for {found.gimbal_ms_ago // 1000} s"
    return PASS, "it tells where it looks"


def position(found: Found) -> Verdict:
    """Whether the vehicle knows where it is."""
    facts = found.vehicle
    if facts is None or facts.fix_type is None:
        return FAIL, "the vehicle does not tell where it is"
    if facts.fix_type < FIX_3D:
        return FAIL, "no 3D fix"
    seen, hdop_e2 = facts.satellites, facts.hdop_e2
    words = f"{'?' if seen is None else seen} satellites, HDOP {'?' if hdop_e2 is None else hdop_e2 / 100}"
    if (seen is not None and seen < SATELLITES_FEW) or (hdop_e2 is not None and hdop_e2 > HDOP_POOR_E2):
        return FAIL, words
    if seen is None or hdop_e2 is None or seen < SATELLITES_GOOD or hdop_e2 > HDOP_GOOD_E2:
        return DEGRADED, words
    return PASS, words


def battery(found: Found) -> Verdict:
    """Whether there is charge for more than the way back."""
    charge = None if found.vehicle is None else found.vehicle.charge_percent
    if charge is None:
        return DEGRADED, "the vehicle does not tell its charge: no return at low battery"
    if charge <= found.return_percent:
        return FAIL, f"{charge} %: at {found.return_percent} % the vehicle returns"
    if charge < found.return_percent + BATTERY_MARGIN_PERCENT:
        return DEGRADED, f"{charge} %, and at {found.return_percent} % the vehicle returns"
    return PASS, f"{charge} %"


def geofence(found: Found) -> Verdict:
    """Whether the mission has fences."""
    if found.fences:
        return PASS, f"{found.fences} fences"
    return DEGRADED, "the mission has no fence"


def mission(found: Found) -> Verdict:
    """Whether there is something to fly."""
    if not found.mission_items:
        return FAIL, "the mission has no items"
    return PASS, f"{found.mission_items} items"


def map_fresh(_found: Found) -> Verdict:
    """Whether the map is fresh; it is the flights' own, for none is fetched."""
    return SKIPPED, "no map is fetched: objects are those of earlier flights"


def link(found: Found) -> Verdict:
    """Whether vehicle and operator are heard."""
    if found.vehicle is None or not found.vehicle.linked:
        return FAIL, "the vehicle is not heard"
    if not found.vehicle.commandable:
        return FAIL, "it is not known how this autopilot numbers its modes"
    if not found.has_mesh:
        return SKIPPED, "the vehicle is heard; no mesh is configured"
    if found.operator_ms_ago is None or found.operator_ms_ago > OPERATOR_SILENT_MS:
        return DEGRADED, "the vehicle is heard, no operator is"
    return PASS, "vehicle and operator are heard"


ITEMS: dict[str, Callable[[Found], Verdict]] = {
    "log": log,
    "space": space,
    "clock": clock,
    "keys": keys,
    "epoch": epoch,
    "camera": camera,
    "detector": detector,
    "gimbal": gimbal,
    "position": position,
    "battery": battery,
    "geofence": geofence,
    "map": map_fresh,
    "link": link,
    "mission": mission,
}


def unlooked(because: str) -> list[SelftestItem]:
    """Return every item as one that nothing is known of: a test that could not look is no reason to fly."""
    words = f"this could not be looked at: {because}"
    return [SelftestItem(name=name, verdict=FAIL, words=words) for name in ITEMS]


def judged(found: Found) -> list[SelftestItem]:
    """Return every item in its order."""
    items = []
    for name, judge in ITEMS.items():
        verdict, words = judge(found)
        items.append(SelftestItem(name=name, verdict=verdict, words=words))
    return items
