"""Numbers of the core in words, by integer arithmetic, for the reasons that people read."""

from __future__ import annotations

MAV_RESULTS = {
    0: "MAV_RESULT_ACCEPTED",
    1: "MAV_RESULT_TEMPORARILY_REJECTED",
    2: "MAV_RESULT_DENIED",
    3: "MAV_RESULT_UNSUPPORTED",
    4: "MAV_RESULT_FAILED",
    5: "MAV_RESULT_IN_PROGRESS",
    6: "MAV_RESULT_CANCELLED",
    7: "MAV_RESULT_COMMAND_LONG_ONLY",
    8: "MAV_RESULT_COMMAND_INT_ONLY",
    9: "MAV_RESULT_COMMAND_UNSUPPORTED_MAV_FRAME",
    10: "MAV_RESULT_NOT_IN_CONTROL",
}


def degrees(angle_cdeg: int) -> str:
    """Return an angle of 0.01 degrees as degrees without zeros that say nothing: -9000 is "-90", 4550 is "45.5"."""
    whole, rest = divmod(abs(angle_cdeg), 100)
    sign = "-" if angle_cdeg < 0 else ""
    return f"{sign}{whole}" + (f".{rest:02d}".rstrip("0") if rest else "")


def degrees_rounded(angle_cdeg: int) -> str:
    """Return an angle of 0.01 degrees, not below 0, as degrees with one digit, rounded half up: 38 is "0.4"."""
    whole, tenths = divmod((angle_cdeg + 5) // 10, 10)
    return f"{whole}.{tenths}"
