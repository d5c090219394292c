"""Numbers and moments as text, against an independent way of writing them."""

from __future__ import annotations

from datetime import UTC, datetime
from decimal import ROUND_HALF_UP, Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from events import KINDS, NO_CAUSE, Moment, make_record
from projections.canonical import Decimal as Number
from projections.canonical import decimal, json_text
from projections.describe import close_words, describe, result_word
from projections.words import ranges, scaled, short, timestamp
from tests.flights import said, story

NS_PER_S = 1_000_000_000


def check_text(found: str, expected: str) -> None:
    """Check a text."""
    assert found == expected


@given(st.integers(-(10**12), 10**12), st.integers(0, 9))
def test_scaled_is_exact(value: int, digits: int) -> None:
    """All digits, the sign also below one."""
    check_text(scaled(value, digits), f"{Decimal(value).scaleb(-digits):.{digits}f}")


@given(st.integers(-(10**9), 10**9).filter(lambda value: abs(value) >= 50))
def test_short_rounds_half_away(value: int) -> None:
    """Two digits behind the point become one."""
    expected = (Decimal(value) / 1000).quantize(Decimal("0.1"), ROUND_HALF_UP)
    check_text(short(value, 3, 1), str(expected))


def test_what_rounds_to_nothing_keeps_its_place() -> None:
    """Rounding is to the nearest, a half goes away from zero."""
    check_text(short(49, 3, 1), "0.0")
    check_text(short(50, 3, 1), "0.1")
    check_text(short(-50, 3, 1), "-0.1")


@given(st.integers(0, 13_569_465_600))
def test_timestamps_are_those_of_the_calendar(second: int) -> None:
    """Also over leap years and centuries."""
    expected = datetime.fromtimestamp(second, UTC).isoformat(timespec="seconds").replace("+00:00", ".987Z")
    check_text(timestamp(second * NS_PER_S + 987_654_321), expected)


def test_timestamps_before_1970() -> None:
    """A clock that was never set may say anything."""
    check_text(timestamp(-1), "1969-12-31T23:59:59.999Z")


def test_every_kind_has_words() -> None:
    """Also an empty message of each kind, and one line each."""
    lines = [describe(make_record(0, NO_CAUSE, Moment(0, 0, 0, 0, 0), kind.message())) for kind in KINDS]
    assert [line for line in lines if "\n" in line] == []
    assert len(lines) == len(KINDS)


def test_words_say_what_happened() -> None:
    """A few lines of a flight, whole."""
    flight = story()
    by_kind = {record.kind.name: describe(record) for record in reversed(flight.records)}
    check_text(
        by_kind["order_received"],
        "ALPHA (alpha) orders p1: look at 52.1002702 4.3002941, 0.0 m AMSL (31UFT5002050030), camera 1",
    )
    check_text(
        by_kind["order_malformed"], "ALPHA (alpha) sent order m1 that can't be read: camera_roi.lat_e7: 95 degrees"
    )
    check_text(by_kind["gimbal_reported"], "gimbal 1/1 at pitch -20.0, yaw 30.0, 9.0 off effect 8")
    check_text(by_kind["samples_rejected"], "samples rejected: 3 bad_signature, 1 stale")
    assert "send_ack" in said(flight.records)


def test_numbers_of_a_newer_version_are_shown_as_numbers() -> None:
    """An enumeration may grow."""
    check_text(result_word(77), "result 77")
    check_text(close_words(77), "reason 77")


def test_canonical_json() -> None:
    """Sorted keys, no spaces, decimals as they were written."""
    value = {"b": [1, None, True, 'a"\\\n\x01é'], "a": decimal(-5, 7), "c": decimal(None, 7), "d": Number("1.50")}
    check_text(json_text(value), '{"a":-0.0000005,"b":[1,null,true,"a\\"\\\\\\n\\u0001é"],"c":null,"d":1.50}')


@pytest.mark.parametrize("value", [0.5, b"x", object(), [0.5], {"a": 1.0}])
def test_a_float_is_refused(value: object) -> None:
    """And whatever else has no one way of being written."""
    with pytest.raises(TypeError):
        json_text(value)


@pytest.mark.parametrize(
    ("numbers", "text"),
    [([], ""), ([5], "5"), ([4, 1, 2, 3, 9], "1-4,9"), ([1, 1, 3], "1,3"), (range(3, 6), "3-5")],
)
def test_ranges(numbers: list[int], text: str) -> None:
    """In order, each once."""
    assert ranges(numbers) == text
