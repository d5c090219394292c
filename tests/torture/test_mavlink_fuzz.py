"""A seeded sample of broken MAVLink, and that it would find something; the full count is an area of `tests.torture`."""

from __future__ import annotations

from typing import Any

import pytest

from autopilot.adapters.vehicle import fitness, ingress, ingress_flight
from autopilot.adapters.vehicle.session import Session
from events.schema.common_pb2 import Place
from events.schema.safety_pb2 import BatteryReported, HomeReported
from tests.torture import mavlink_fuzz
from tests.torture.mavlink_fuzz import out_of_range, share_of


@pytest.mark.parametrize("seed", range(3))
def test_a_sample_of_broken_frames(seed: int) -> None:
    """Nothing escapes, and each way of being wrong is met by its name."""
    told = share_of(seed, 3_000)
    expected = ("not finite", "out of range", "bad checksum", "truncated", "incompatible", "foreign system")
    assert [name for name in expected if not told[name]] == []
    assert told["VehicleStateReported"] > 1
    assert told["BatteryReported"] > 1


def test_it_is_the_same_every_time() -> None:
    assert share_of(7, 500) == share_of(7, 500)


def test_an_area_counts_what_it_threw() -> None:
    assert mavlink_fuzz.run(600, 3, lambda _: None)["frames"] == 600


@pytest.mark.parametrize("checks", [("within",), ("within", "finite")])
def test_a_check_that_is_gone_is_found(checks: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    for check in checks:  # "finite" alone is not missed: what is no number is in no range either
        for module, name in ((ingress, f"_{check}"), (ingress_flight, check), (fitness, check)):
            monkeypatch.setattr(module, name, lambda *_: None)
    with pytest.raises(AssertionError, match="seed 1, frame"):
        share_of(1, 3_000)


def test_what_escapes_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def hear(*_: Any) -> None:
        raise ValueError("made up")

    monkeypatch.setattr(Session, "_transferred", hear)
    with pytest.raises(AssertionError, match="seed 1, frame"):
        share_of(1, 3_000)


def test_an_observation_out_of_range_is_found() -> None:
    assert list(out_of_range(BatteryReported(vehicle=1, charge_percent=101))) == ["charge_percent"]
    assert list(out_of_range(HomeReported(vehicle=1, place=Place(latitude_e7=900_000_001)))) == ["latitude_e7"]
    assert list(out_of_range(BatteryReported(vehicle=1, charge_percent=100, voltage_mv=1))) == []
