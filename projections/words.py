"""Numbers and moments as text, by integer arithmetic: the same text on every processor.

It knows units and nothing of records.
"""

from __future__ import annotations

from collections.abc import Iterable

NS_PER_S = 1_000_000_000
NS_PER_MS = 1_000_000
SECONDS_PER_DAY = 86_400
_DAYS_0000_TO_1970 = 719_468  # counted from 1 March of year 0, where the leap day ends a year
_DAYS_PER_ERA = 146_097  # 400 Gregorian years


def scaled(value: int, digits: int) -> str:
    """Return value / 10**digits as a decimal with all its digits: -5 at 3 digits is "-0.005"."""
    whole, rest = divmod(abs(value), 10**digits)
    sign = "-" if value < 0 else ""
    return f"{sign}{whole}.{rest:0{digits}d}" if digits else f"{sign}{whole}"


def short(value: int, digits: int, shown: int) -> str:
    """Return value / 10**digits rounded (half away from zero) to `shown` digits behind the point."""
    step = 10 ** (digits - shown)
    rounded = (abs(value) + step // 2) // step
    return scaled(-rounded if value < 0 else rounded, shown)


def degrees(angle_cdeg: int) -> str:
    """Return an angle of 0.01 degrees as degrees with one digit."""
    return short(angle_cdeg, 2, 1)


def metres(length_mm: int) -> str:
    """Return millimetres as metres with one digit."""
    return short(length_mm, 3, 1)


def seconds(span_ns: int) -> str:
    """Return nanoseconds as seconds with one digit."""
    return short(span_ns, 9, 1)


def coordinates(latitude_e7: int, longitude_e7: int) -> str:
    """Return latitude and longitude in degrees with all seven digits."""
    return f"{scaled(latitude_e7, 7)} {scaled(longitude_e7, 7)}"


def percent(share_e4: int) -> str:
    """Return a share of 1e-4 as whole percent."""
    return f"{(share_e4 + 50) // 100} %"


def ranges(numbers: Iterable[int]) -> str:
    """Return numbers as ranges, in order and each once: [4, 1, 2, 3, 9] is "1-4,9"."""
    runs: list[tuple[int, int]] = []
    for number in sorted(set(numbers)):
        if runs and runs[-1][1] == number - 1:
            runs[-1] = runs[-1][0], number
        else:
            runs.append((number, number))
    return ",".join(str(first) if first == last else f"{first}-{last}" for first, last in runs)


def timestamp(wall_ns: int) -> str:
    """Return nanoseconds since 1970 as an RFC 3339 time in UTC, to the millisecond (cut, not rounded)."""
    of_day_ns = wall_ns % (SECONDS_PER_DAY * NS_PER_S)
    year, month, day = _date(wall_ns // (SECONDS_PER_DAY * NS_PER_S))
    second, millisecond = divmod(of_day_ns // NS_PER_MS, 1000)
    hour, minute, second = second // 3600, second // 60 % 60, second % 60
    return f"{year:04d}-{month:02d}-{day:02d}T{hour:02d}:{minute:02d}:{second:02d}.{millisecond:03d}Z"


def _date(day_number: int) -> tuple[int, int, int]:
    """Return year, month and day of a day counted from 1 January 1970, in the Gregorian calendar."""
    era, of_era = divmod(day_number + _DAYS_0000_TO_1970, _DAYS_PER_ERA)
    year_of_era = (of_era - of_era // 1460 + of_era // 36_524 - of_era // 146_096) // 365
    of_year = of_era - (365 * year_of_era + year_of_era // 4 - year_of_era // 100)
    month_from_march = (5 * of_year + 2) // 153
    day = of_year - (153 * month_from_march + 2) // 5 + 1
    month = month_from_march + 3 if month_from_march < 10 else month_from_march - 9
    return era * 400 + year_of_era + (1 if month <= 2 else 0), month, day
