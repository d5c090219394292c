"""The link against the simulated vehicle in its own process: a mission given, read back, flown, and broken off."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from typing import Any

import pytest

from autopilot.adapters.vehicle import VehicleLink
from autopilot.ports.config import VehicleSection
from autopilot.trust.clock import HostClock
from events.schema.mission_pb2 import MissionProgressReported, MissionUploaded
from events.schema.safety_pb2 import BatteryReported, FlightMode, HomeReported
from events.schema.vehicle_pb2 import CommandAnswered, PositionReported, VehicleStateReported
from tests.autopilot.sim.test_process import free_ports
from tests.autopilot.vehicle.test_link import Inbox, link_to, run
from tests.autopilot.vehicle.vehicles import arm, fly_to, go_to_item, mode, plan, planned, start, upload

TIMES = 5  # faster than the real one


@contextmanager
def vehicle(personality: str, frame: str) -> Iterator[int]:
    """Yield the MAVLink port of a simulated vehicle that is told what to do, in its own process."""
    mavlink_port, eyes_port = free_ports()
    command = [sys.executable, "-m", "autopilot.sim.process", "--seconds", "300", "--pilot", "node"]
    command += ["--personality", personality, "--frame", frame, "--speed-up", str(TIMES)]
    command += ["--mavlink-port", str(mavlink_port), "--eyes-port", str(eyes_port)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == b"ready\n"
            yield mavlink_port
        finally:
            process.terminate()


@asynccontextmanager
async def linked(port: int, **settings: Any) -> AsyncIterator[tuple[VehicleLink, Inbox]]:
    """A link to it, and what the link reports."""
    inbox = Inbox()
    link = link_to(VehicleSection(connect=f"127.0.0.1:{port}", **settings), inbox)
    await link.start()
    try:
        yield link, inbox
    finally:
        await link.stop()


async def check_done(link: VehicleLink, inbox: Inbox, seq: int, effect: Any) -> None:
    """The effect is accepted."""
    link.perform(seq, effect, HostClock().mono_ns())
    answer = await inbox.wait_for(CommandAnswered, lambda told: told.effect_seq == seq and told.mav_result != 5)
    assert answer.mav_result == 0, answer


async def in_mode(inbox: Inbox, name: str) -> None:
    wanted = FlightMode.Value(f"FLIGHT_MODE_{name}")
    await inbox.wait_for(VehicleStateReported, lambda told: told.flight_mode == wanted)


@pytest.mark.whole
@pytest.mark.parametrize("personality", ["ardupilot", "px4"])
def test_a_mission_is_given_flown_and_broken_off(personality: str) -> None:
    async def story(port: int) -> None:
        async with linked(port, late_answer_s=0.3) as (link, inbox):
            await inbox.wait_for(HomeReported)
            await inbox.wait_for(BatteryReported)
            link.perform(1, upload(), HostClock().mono_ns())
            uploaded = await inbox.wait_for(MissionUploaded)
            assert (uploaded.effect_seq, uploaded.items, uploaded.attempts) == (1, len(plan()), 1)
            assert uploaded.HasField("opaque_id") == (personality == "px4")
            await check_done(link, inbox, 2, mode("GUIDED"))
            await check_done(link, inbox, 3, arm())
            await inbox.wait_for(VehicleStateReported, lambda told: told.armed)
            await check_done(link, inbox, 4, mode("MISSION"))
            await check_done(link, inbox, 5, start())
            await in_mode(inbox, "MISSION")
            await inbox.wait_for(MissionProgressReported, lambda told: told.current_item >= 2)
            await inbox.wait_for(PositionReported, lambda told: told.north_mm_s > 500)
            await check_done(link, inbox, 6, fly_to())
            await in_mode(inbox, {"ardupilot": "GUIDED", "px4": "LOITER"}[personality])
            await check_done(link, inbox, 7, mode("RETURN"))
            await in_mode(inbox, "RETURN")
            facts = link.facts()
            assert (facts.linked, facts.commandable, facts.armed, facts.home is not None) == (True, True, True, True)
            assert (facts.fix_type or 0) >= 3
            assert facts.charge_percent is not None

    with vehicle(personality, "copter") as port:
        run(lambda: story(port))


@pytest.mark.whole
@pytest.mark.parametrize("personality", ["ardupilot", "px4"])
def test_a_mission_is_changed_in_the_air(personality: str) -> None:
    """It is read back there too, the vehicle flies on, and goes to the item that it is told, by the new plan."""

    async def story(port: int) -> None:
        async with linked(port, late_answer_s=0.3) as (link, inbox):
            await inbox.wait_for(HomeReported)
            link.perform(1, upload(), HostClock().mono_ns())
            await inbox.wait_for(MissionUploaded)
            for seq, effect in ((2, mode("GUIDED")), (3, arm()), (4, mode("MISSION")), (5, start())):
                await check_done(link, inbox, seq, effect)
            await inbox.wait_for(MissionProgressReported, lambda told: told.current_item >= 2)
            items = [*plan()[:2], *(planned(16, north) for north in (150, 160, 170, 180)), plan()[-1]]
            link.perform(6, upload(items), HostClock().mono_ns())
            changed = await inbox.wait_for(MissionUploaded, lambda told: told.effect_seq == 6)
            assert (changed.items, changed.attempts) == (len(items), 1)
            await check_done(link, inbox, 7, go_to_item(4))
            await check_done(link, inbox, 8, mode("MISSION"))
            await inbox.wait_for(MissionProgressReported, lambda told: told.current_item == 4)
            await in_mode(inbox, "MISSION")
            assert link.facts().armed

    with vehicle(personality, "copter") as port:
        run(lambda: story(port))


@pytest.mark.whole
def test_a_plane_takes_its_mission() -> None:
    async def story(port: int) -> None:
        async with linked(port) as (link, inbox):
            await inbox.wait_for(VehicleStateReported)
            items = [planned(16, north) for north in (50, 90, 130)]
            link.perform(1, upload(items), HostClock().mono_ns())
            assert (await inbox.wait_for(MissionUploaded)).items == 3

    with vehicle("ardupilot", "plane") as port:
        run(lambda: story(port))
