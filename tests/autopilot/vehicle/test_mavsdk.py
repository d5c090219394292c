"""Another implementation of MAVLink, MAVSDK, as the autopilot: it takes the node's mission, gives it back, and arms.

Its servers tell of no autopilot's kind (MAV_AUTOPILOT_GENERIC), so nothing is known of how it rounds or numbers modes:
every item has to come back as it was given.
"""

from __future__ import annotations

import asyncio
import math
import queue
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from mavsdk import ComponentType, Configuration, ConnectionResult, Mavsdk
from mavsdk.plugins.action_server import ActionServer
from mavsdk.plugins.mission_raw_server import MissionRawServer

from autopilot.adapters.vehicle.mission_form import given
from autopilot.adapters.vehicle.modes import Family
from autopilot.ports.config import VehicleSection
from autopilot.trust.clock import HostClock
from events.schema.mission_pb2 import MissionUploaded
from events.schema.vehicle_pb2 import CommandAnswered, CommandUnanswered, VehicleStateReported
from tests.autopilot.vehicle.test_link import WITHIN_S, Inbox, link_to, run
from tests.autopilot.vehicle.vehicles import arm, mode, plan, upload


@contextmanager
def autopilot(port: int) -> Iterator[queue.Queue[Any]]:
    """Run MAVSDK as an autopilot that speaks to a port; yield the missions that it takes."""
    missions: queue.Queue[Any] = queue.Queue()
    with Mavsdk(Configuration.create_with_component_type(ComponentType.AUTOPILOT)) as mavsdk:
        assert mavsdk.add_any_connection(f"udpout://127.0.0.1:{port}") == ConnectionResult.SUCCESS
        component = mavsdk.server_component()
        actions: Any = ActionServer(component)
        actions.set_armable(True, False)
        server: Any = MissionRawServer(component)
        server.subscribe_incoming_mission(lambda _, mission, __: missions.put(mission.mission_items))
        yield missions


def _plain(item: Any) -> tuple[Any, ...]:
    """Return an item of either side; unset is no number, which is unequal to itself."""
    names = ("param1", "param2", "param3", "param4")
    values = getattr(item, "parameters", None) or tuple(getattr(item, name) for name in names)
    numbers = ["unset" if math.isnan(value) else value for value in values]
    goes_on = item.goes_on if hasattr(item, "goes_on") else item.autocontinue
    return (item.seq, item.frame, item.command, bool(item.current), bool(goes_on), *numbers, item.x, item.y, item.z)


@pytest.mark.whole
def test_mavsdk_takes_a_mission_and_is_armed() -> None:
    async def story() -> None:
        inbox = Inbox()
        link = link_to(VehicleSection(listen="127.0.0.1:0"), inbox)
        await link.start()
        assert link.address is not None
        with autopilot(link.address[1]) as missions:
            try:
                await inbox.wait_for(VehicleStateReported)
                link.perform(5, upload(), HostClock().mono_ns())
                told = await inbox.wait_for(MissionUploaded)
                assert (told.effect_seq, told.items, told.attempts) == (5, 6, 1)
                taken = await asyncio.to_thread(missions.get, timeout=WITHIN_S)
                assert list(map(_plain, taken)) == list(map(_plain, given(plan(), Family.OTHER)))
                link.perform(6, arm(), HostClock().mono_ns())
                answered = await inbox.wait_for(CommandAnswered)
                assert (answered.effect_seq, answered.mav_result) == (6, 0)
                link.perform(7, mode("RETURN"), HostClock().mono_ns())
                assert (await inbox.wait_for(CommandUnanswered)).because == "not encodable"
            finally:
                await link.stop()

    run(story)
