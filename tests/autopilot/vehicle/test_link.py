"""The UDP link: outcomes are kept until taken, addresses are judged, and the whole against a simulated aircraft."""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import Awaitable, Callable, Iterator
from contextlib import asynccontextmanager, suppress
from typing import Any

import pytest
from google.protobuf.message import Message

from autopilot.adapters.vehicle import VehicleLink
from autopilot.geo import Origin
from autopilot.ports.config import VehicleSection
from autopilot.ports.edges import InputClass
from autopilot.sim.aircraft import HOME, Aircraft, Unkindness
from autopilot.sim.process import Simulation
from autopilot.sim.world import World
from autopilot.trust.clock import HostClock
from events.schema.vehicle_pb2 import (
    CommandAnswered,
    CommandSent,
    CommandUnanswered,
    GimbalReported,
    PointAtPlace,
    PositionReported,
    VehicleLinkChanged,
    VehicleStateReported,
)
from tests.autopilot.vehicle.vehicles import answer, at_angles, at_place, decode, heartbeat, plain_place

WITHIN_S = 20.0


class Stopped:
    """A clock that stands still."""

    def mono_ns(self) -> int:
        return 1_000_000_000

    def wall_ns(self) -> int:
        return 0


class Inbox:
    """Takes what is offered, unless told not to; a test waits for what it needs."""

    def __init__(self) -> None:
        self.taken: list[tuple[InputClass, Message]] = []
        self.refuses = False
        self._news = asyncio.Event()

    def offer(self, input_class: InputClass, observation: Message) -> bool:
        if self.refuses and input_class is InputClass.OUTCOME:
            return False
        self.taken.append((input_class, observation))
        self._news.set()
        return True

    def of(self, kind: type[Message]) -> Iterator[Any]:
        return (observation for _, observation in self.taken if isinstance(observation, kind))

    async def wait_for(self, kind: type[Message], fits: Callable[[Any], bool] = bool) -> Any:
        """Return the first observation of a kind that fits, now or later."""
        async with asyncio.timeout(WITHIN_S):
            while True:
                for observation in self.of(kind):
                    if fits(observation):
                        return observation
                self._news.clear()
                await self._news.wait()


def link_to(settings: VehicleSection, inbox: Inbox, clock: Any = None) -> VehicleLink:
    origin = Origin()

    def on_first_fix(latitude_deg: float, longitude_deg: float, altitude_m: float) -> None:
        origin.set(latitude_deg, longitude_deg, altitude_m)

    return VehicleLink(
        settings,
        inbox.offer,
        clock or HostClock(),
        origin.place,
        on_first_fix,
        lambda: True,
        on_time=lambda _: None,
    )


def test_outcomes_are_offered_until_taken_and_in_order() -> None:
    inbox = Inbox()
    link = link_to(VehicleSection(connect="127.0.0.1:1"), inbox, clock=Stopped())
    inbox.refuses = True
    for seq in (5, 6):
        link.perform(seq, at_place(), 1_000_000_000)
    assert inbox.taken == []
    inbox.refuses = False
    link.perform(7, at_place(), 1_000_000_000)
    assert [(kind, told.effect_seq, told.because) for kind, told in inbox.taken] == [  # type: ignore[attr-defined]
        (InputClass.OUTCOME, seq, "no vehicle") for seq in (5, 6, 7)
    ]


def test_life_counts_from_the_record() -> None:
    inbox = Inbox()
    link = link_to(VehicleSection(connect="127.0.0.1:1"), inbox, clock=Stopped())
    link.perform(5, PointAtPlace(vehicle=1, gimbal=1, life_ms=300, place=at_place().place), 700_000_000)
    link.perform(6, PointAtPlace(vehicle=1, gimbal=1, life_ms=301, place=at_place().place), 700_000_000)
    assert [told.because for told in inbox.of(CommandUnanswered)] == ["expired before sending", "no vehicle"]


@asynccontextmanager
async def flight(unkind: Unkindness | None = None, **changes: Any) -> Any:
    """Yield a simulated aircraft, a link to it, and the link's inbox."""
    aircraft = Aircraft(1, 60, unkind=unkind)
    simulation = Simulation(aircraft, World(1, aircraft.route), HostClock())
    await simulation.start()
    inbox = Inbox()
    link = link_to(VehicleSection(connect=f"127.0.0.1:{simulation.mavlink_port}", **changes), inbox)
    await link.start()
    try:
        yield aircraft, link, inbox
    finally:
        await link.stop()
        await simulation.stop()


def run(story: Callable[[], Awaitable[None]]) -> None:
    asyncio.run(story())  # type: ignore[arg-type]


@pytest.mark.whole
def test_a_place_is_accepted_and_the_gimbal_is_seen_to_arrive() -> None:
    async def story() -> None:
        async with flight() as (aircraft, link, inbox):
            await inbox.wait_for(GimbalReported)
            await inbox.wait_for(PositionReported)
            place = plain_place(HOME[0] + 0.0005, HOME[1] - 0.0004, HOME[2])
            effect = PointAtPlace(vehicle=1, camera=1, gimbal=1, place=place, life_ms=10_000)
            link.perform(42, effect, HostClock().mono_ns())
            answered = await inbox.wait_for(CommandAnswered)
            assert (answered.effect_seq, answered.mav_result, answered.attempts) == (42, 0, 1)
            far = await inbox.wait_for(GimbalReported, lambda told: told.effect_seq == 42)
            assert far.error_cdeg > 500
            near = await inbox.wait_for(GimbalReported, lambda told: told.effect_seq == 42 and told.error_cdeg < 100)
            assert near.pitch_cdeg / 100 == pytest.approx(aircraft.gimbal.pitch_deg, abs=2)
            kinds = [type(told) for _, told in inbox.taken]
            assert kinds.index(VehicleLinkChanged) < kinds.index(VehicleStateReported)
            assert kinds.index(CommandSent) < kinds.index(CommandAnswered)
            assert sum(link.rejected.values()) == 0
            await inbox.wait_for(VehicleStateReported, lambda told: told.armed)
            pose = link.pose_at(HostClock().mono_ns() - 100_000_000)  # while it may still have moved
            assert pose is not None
            assert pose.camera_pitch_deg == pytest.approx(aircraft.gimbal.pitch_deg, abs=10)
            assert link.limits.pitch_deg[1] == pytest.approx(20)

    run(story)


@pytest.mark.whole
def test_lost_answers_are_asked_for_again_and_a_refusal_is_told() -> None:
    async def story() -> None:
        settings = {"answer_timeout_s": 0.1, "attempts": 3, "late_answer_s": 0}
        async with flight(Unkindness(answer_lost=1), **settings) as (aircraft, link, inbox):
            await inbox.wait_for(VehicleLinkChanged)
            link.perform(5, at_angles(), HostClock().mono_ns())
            lost = await inbox.wait_for(CommandUnanswered)
            assert (lost.effect_seq, lost.attempts, lost.because) == (5, 3, "no answer")
            aircraft.unkind.answer_lost = 0
            aircraft.unkind.in_progress = 1
            link.perform(6, at_angles(), HostClock().mono_ns())
            await inbox.wait_for(CommandAnswered, lambda told: told.mav_result == 0)
            assert [told.mav_result for told in inbox.of(CommandAnswered)] == [5, 0]

    run(story)


class Silent:
    """A vehicle's end of a UDP link: a socket that says what a test has it say."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.port: int = self.socket.getsockname()[1]

    async def meet(self, inbox: Inbox) -> Any:
        """Wait until the link spoke, beat, and return where the link is, once it knows the vehicle."""
        _, peer = await asyncio.get_running_loop().sock_recvfrom(self.socket, 2_048)
        self.socket.sendto(heartbeat(), peer)
        await inbox.wait_for(VehicleStateReported)
        return peer

    def commands(self) -> list[int]:
        """Return the commands of the gimbal that lie there, without waiting."""
        found = []
        with suppress(BlockingIOError):
            while True:
                message = decode(self.socket.recv(2_048))
                found.append(getattr(message, "command", 0))
        return [command for command in found if command in (1000, 195)]


@pytest.mark.whole
def test_an_effect_leaves_without_the_loop_and_its_outcome_comes_with_it() -> None:
    """From a thread that brings it, while the loop is held up; what is due afterwards is the loop's."""

    async def story() -> VehicleLink:
        vehicle, inbox = Silent(), Inbox()
        settings = VehicleSection(connect=f"127.0.0.1:{vehicle.port}", answer_timeout_s=0.1, attempts=2)
        link = link_to(settings, inbox)
        await link.start()
        try:
            peer = await vehicle.meet(inbox)
            bringer = threading.Thread(target=link.perform, args=(5, at_angles(), HostClock().mono_ns()))
            bringer.start()
            bringer.join(WITHIN_S)  # the loop does nothing meanwhile
            assert vehicle.commands() == [1000]
            assert [sent.effect_seq for sent in inbox.of(CommandSent)] == [5]
            await asyncio.sleep(0)
            assert link._timer is not None
            assert link._timer.when() <= asyncio.get_running_loop().time() + 0.1  # for the second time
            unanswered = await inbox.wait_for(CommandUnanswered)
            assert (unanswered.effect_seq, unanswered.attempts) == (5, 2)
            assert vehicle.commands() == [1000]
            await asyncio.to_thread(link.perform, 6, at_place(), HostClock().mono_ns())
            vehicle.socket.sendto(answer(195), peer)
            assert (await inbox.wait_for(CommandAnswered)).effect_seq == 6
        finally:
            await link.stop()
        link.perform(7, at_angles(), HostClock().mono_ns())
        assert vehicle.commands() == [195]
        vehicle.socket.close()
        return link

    link = asyncio.run(story())
    link.perform(8, at_angles(), HostClock().mono_ns())  # there is no loop any more


@pytest.mark.whole
def test_many_threads_bring_effects_while_the_vehicle_speaks() -> None:
    """Each effect comes to exactly one end, whoever brings it and whatever is heard meanwhile."""
    threads, each = 4, 50

    def bring(link: VehicleLink, first: int) -> None:
        for seq in range(first, first + each):
            link.perform(seq, at_angles(), HostClock().mono_ns())

    async def story() -> None:
        vehicle, inbox = Silent(), Inbox()
        link = link_to(VehicleSection(connect=f"127.0.0.1:{vehicle.port}"), inbox)
        await link.start()
        try:
            peer = await vehicle.meet(inbox)
            bringers = [asyncio.to_thread(bring, link, each * number) for number in range(threads)]
            bringing = asyncio.gather(*bringers)
            while not bringing.done():
                vehicle.socket.sendto(answer(1000), peer)
                await asyncio.sleep(0)
            await bringing
            async with asyncio.timeout(WITHIN_S):
                while len(list(ended(inbox))) < threads * each:
                    vehicle.socket.sendto(answer(1000), peer)
                    await asyncio.sleep(0.01)
            assert sorted(ended(inbox)) == list(range(threads * each))
        finally:
            await link.stop()
            vehicle.socket.close()

    def ended(inbox: Inbox) -> Iterator[int]:
        return (told.effect_seq for kind in (CommandAnswered, CommandUnanswered) for told in inbox.of(kind))

    run(story)


@pytest.mark.whole
def test_in_listen_mode_the_peer_speaks_first() -> None:
    async def story() -> None:
        inbox = Inbox()
        link = link_to(VehicleSection(listen="127.0.0.1:0"), inbox)
        await link.start()
        aircraft = Aircraft(1, 60)
        simulation = Simulation(aircraft, World(1, aircraft.route), HostClock())
        await simulation.start()
        assert link.address is not None
        aircraft.meet(link.address)
        try:
            await inbox.wait_for(GimbalReported)
            link.perform(5, at_angles(), HostClock().mono_ns())
            assert (await inbox.wait_for(CommandAnswered)).mav_result == 0
        finally:
            await link.stop()
            await simulation.stop()

    run(story)


@pytest.mark.whole
def test_a_vehicle_that_goes_is_told() -> None:
    async def story() -> None:
        async with flight(link_timeout_s=1.5) as (aircraft, _, inbox):
            await inbox.wait_for(VehicleLinkChanged, lambda told: told.up)
            aircraft.unkind.stream_lost = 1
            await inbox.wait_for(VehicleLinkChanged, lambda told: not told.up)
            aircraft.unkind.stream_lost = 0
            await inbox.wait_for(VehicleStateReported)

    run(story)
