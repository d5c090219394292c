"""A mission into a vehicle and back: each fault has its end, and no link makes a wrong mission believed right."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autopilot.adapters.vehicle.heard import ItemCount, ItemRequest, MissionAnswer
from autopilot.adapters.vehicle.modes import Family
from autopilot.adapters.vehicle.transfer import Say, Word
from events.schema.mission_pb2 import MissionUploaded, MissionUploadFailed, VehicleHolds
from tests.autopilot.vehicle.peers import MS, NODE, OLD, VEHICLE, Faults, Network, Peer, S, outcome, uploading

FAMILIES = (Family.COPTER, Family.PX4)
OLD_ONE, MIXED, NOTHING, UNKNOWN = (
    VehicleHolds.VEHICLE_HOLDS_OLD,
    VehicleHolds.VEHICLE_HOLDS_MIXED,
    VehicleHolds.VEHICLE_HOLDS_NOTHING,
    VehicleHolds.VEHICLE_HOLDS_UNSPECIFIED,
)


def check_failed(family: Family, faults: Faults, because: str, **expected: int | None) -> Peer:
    """Upload over a good link to a bad vehicle; check the words, and each named field."""
    peer = Peer(family, faults)
    transfer, _ = uploading(family)
    report = outcome(Network().run(transfer, peer))
    assert isinstance(report, MissionUploadFailed)
    assert report.because == because
    fields = {field.name: value for field, value in report.ListFields()}
    told = {name: fields.get(name) for name in expected}
    assert told == expected
    return peer


@pytest.mark.parametrize("family", FAMILIES)
def test_a_good_vehicle_on_a_good_link(family: Family) -> None:
    transfer, upload = uploading(family)
    peer = Peer(family)
    report = outcome(Network().run(transfer, peer))
    opaque_id = 1 if family is Family.PX4 else None
    assert report == MissionUploaded(effect_seq=5, items=6, opaque_id=opaque_id, attempts=1)
    assert peer.mission == list(upload.items)
    assert not transfer.busy


def test_what_is_said_and_in_which_order() -> None:
    transfer, upload = uploading(Family.PX4)
    said: list[Say] = []
    peer = Peer(Family.PX4)
    while transfer.busy:
        items = transfer.take()
        said += [item for item in items if isinstance(item, Say)]
        for item in items:
            for answer in peer.hear(0, item) if isinstance(item, Say) else []:
                transfer.hear(0, answer)
    said += [item for item in transfer.take() if isinstance(item, Say)]
    last = len(upload.items)
    expected = [(Word.COUNT, last), *((Word.ITEM, seq) for seq in range(last)), (Word.LIST, 0)]
    expected += [*((Word.REQUEST, seq) for seq in range(last)), (Word.ANSWER, 0)]
    assert [(say.word, say.number) for say in said] == expected
    assert {say.target for say in said} == {VEHICLE}


def test_a_refused_item_leaves_the_old_mission_only_where_missions_are_swapped_whole() -> None:
    peer = check_failed(
        Family.PX4,
        Faults(refuses=3),
        "refused, and it keeps what it had",
        mav_mission_result=3,
        item=3,
        holds=OLD_ONE,
        attempts=1,
    )
    assert peer.mission == list(OLD)
    peer = check_failed(
        Family.COPTER,
        Faults(refuses=3),
        "refused: what it has is a mixture; it was cleared",
        mav_mission_result=3,
        item=2,
        holds=NOTHING,
        attempts=1,
    )
    assert peer.mission == []


def test_a_mixture_that_can_not_be_cleared_is_said() -> None:
    for faults, words in (
        (Faults(refuses=3, no_clear=True), "it refuses to be cleared"),
        (Faults(refuses=3, mute=frozenset({Word.CLEAR})), "no answer to the clearing"),
    ):
        expected = {"mav_mission_result": 3, "item": 2, "holds": MIXED, "attempts": 1}
        check_failed(Family.COPTER, faults, f"refused: what it has is a mixture; {words}", **expected)


@pytest.mark.parametrize(("family", "index"), [(Family.COPTER, 2), (Family.PX4, 3)])
def test_an_item_that_is_altered_is_found(family: Family, index: int) -> None:
    peer = check_failed(
        family,
        Faults(alters=3),
        "an item is not what was given; it was cleared (item 3: height 35.0 for 30.0)",
        mav_mission_result=None,
        item=index,
        holds=NOTHING,
        attempts=2,
    )
    assert peer.mission == []


@pytest.mark.parametrize("family", FAMILIES)
def test_a_number_of_items_that_is_wrong_is_found(family: Family) -> None:
    last = 7 if family is Family.COPTER else 6
    plan_number = 0 if family is Family.COPTER else 2
    check_failed(
        family,
        Faults(miscounts=True),
        f"it has another number of items; it was cleared ({last - 1} items for {last}, plan {plan_number})",
        holds=NOTHING,
        attempts=2,
        item=None,
    )


@pytest.mark.parametrize("family", FAMILIES)
def test_a_vehicle_that_accepts_too_early_is_not_believed(family: Family) -> None:
    words = "refused: what it has is a mixture; it was cleared"
    check_failed(family, Faults(stops_at=3), words, holds=NOTHING, attempts=2)


@pytest.mark.parametrize(
    ("mute", "because", "holds", "attempts"),
    [
        (Word.COUNT, "no answer to the offer", UNKNOWN, 1),
        (Word.ITEM, "refused: what it has is a mixture; it was cleared", NOTHING, 2),
        (Word.LIST, "it does not say what it has", UNKNOWN, 2),
        (Word.REQUEST, "it does not say what it has", UNKNOWN, 2),
    ],
)
def test_a_vehicle_that_is_silent_is_named(
    mute: Word, because: str, holds: VehicleHolds.ValueType, attempts: int
) -> None:
    check_failed(Family.COPTER, Faults(mute=frozenset({mute})), because, holds=holds, attempts=attempts)


def test_its_life_ends_it() -> None:
    transfer, _ = uploading(Family.COPTER, life_s=3)
    peer = Peer(Family.COPTER, Faults(mute=frozenset({Word.ITEM})))
    reports = Network().run(transfer, peer)
    report = outcome(reports)
    assert isinstance(report, MissionUploadFailed)
    assert (report.because, report.holds, report.attempts) == ("its time is over", MIXED, 1)
    transfer, _ = uploading(Family.COPTER, life_s=0)
    report = outcome([item for item in transfer.take() if not isinstance(item, Say)])
    assert isinstance(report, MissionUploadFailed)
    assert (report.because, report.holds, report.attempts) == ("its time is over", OLD_ONE, 0)


def test_an_upload_that_is_broken_off_is_cancelled() -> None:
    transfer, _ = uploading(Family.PX4, life_s=1)
    transfer.hear(0, ItemRequest(sender=VEHICLE, target=NODE, seq=0))
    transfer.take()
    transfer.tick(S)
    cancelled, report = transfer.take()
    assert cancelled == Say(VEHICLE, Word.ANSWER, 15)
    assert isinstance(report, MissionUploadFailed)
    assert report.holds == UNKNOWN


def test_the_waits_are_the_protocol_s() -> None:
    transfer, _ = uploading(Family.PX4)
    moments: list[tuple[int, str]] = []

    def silence(until_ns: int) -> None:
        while (due_ns := transfer.due_ns()) is not None and due_ns < until_ns and transfer.busy:
            transfer.tick(due_ns)
            moments.extend((due_ns // MS, item.word.name) for item in transfer.take() if isinstance(item, Say))

    transfer.take()
    silence(7_600 * MS)
    assert moments == [(at_ms, "COUNT") for at_ms in (1_500, 3_000, 4_500, 6_000, 7_500)]
    moments.clear()
    transfer.hear(8_000 * MS, ItemRequest(sender=VEHICLE, target=NODE, seq=0))
    transfer.take()
    silence(16_000 * MS)
    assert moments == [(8_000 + at_ms, "ITEM") for at_ms in (250, 750, 1_750, 3_750, 7_750)]
    assert transfer.due_ns() == (8_000 + 15_750) * MS


def test_an_item_that_is_asked_for_again_is_given_again_and_one_out_of_turn_is_not() -> None:
    transfer, _ = uploading(Family.PX4)
    transfer.take()

    def given_for(*numbers: int) -> list[int]:
        for number in numbers:
            transfer.hear(0, ItemRequest(sender=VEHICLE, target=NODE, seq=number))
        return [item.number for item in transfer.take() if isinstance(item, Say)]

    assert given_for(1) == []
    assert given_for(0, 0, 1, 0) == [0, 0, 1, 0]
    assert given_for(3, 2, 6, 65_535) == [2]


def test_another_plan_s_number_is_found() -> None:
    """Somebody else uploads between the acknowledgement and the listing."""
    transfer, _ = uploading(Family.PX4)
    peer = Peer(Family.PX4, opaque_id=40)
    for item in transfer.take():
        assert isinstance(item, Say)
        pending = [item]
        while pending:
            for answer in peer.hear(0, pending.pop()):
                if isinstance(answer, ItemCount):
                    answer = ItemCount(sender=VEHICLE, target=NODE, count=answer.count, opaque_id=99)
                transfer.hear(0, answer)
            pending += [one for one in transfer.take() if isinstance(one, Say)]
    assert transfer.due_ns() == 5 * S


@pytest.mark.parametrize(("second", "state"), [((6, 15), "settling"), ((2, 3), "settling")])
def test_a_vehicle_that_had_every_item_may_have_swapped(second: tuple[int, int], state: str) -> None:
    """It gave the upload up after its last item, twice, or refused an item then: nobody knows what it has."""
    transfer, _ = uploading(Family.PX4)
    for at_s, (asked, result) in ((0, (6, 15)), (5, second)):
        transfer.tick(at_s * S)
        for seq in range(asked):
            transfer.hear(at_s * S, ItemRequest(sender=VEHICLE, target=NODE, seq=seq))
        transfer.hear(at_s * S, MissionAnswer(sender=VEHICLE, target=NODE, result=result, opaque_id=0))
    assert transfer.busy
    assert transfer._run is not None
    assert transfer._run.state == state


def test_one_that_refuses_after_its_last_item_may_have_swapped() -> None:
    transfer, _ = uploading(Family.PX4)
    for seq in range(6):
        transfer.hear(0, ItemRequest(sender=VEHICLE, target=NODE, seq=seq))
    transfer.hear(0, MissionAnswer(sender=VEHICLE, target=NODE, result=14, opaque_id=0))
    assert transfer.busy


def test_a_second_attempt_is_read_back_from_its_beginning() -> None:
    transfer, _ = uploading(Family.PX4)
    read: list[int] = []
    for at_s, alters in ((0, 3), (5, 1)):
        peer = Peer(Family.PX4, Faults(alters=alters))
        transfer.tick(at_s * S)
        while pending := [item for item in transfer.take() if isinstance(item, Say)]:
            read += [say.number for say in pending if say.word is Word.REQUEST]
            for answer in [answer for say in pending for answer in peer.hear(at_s * S, say)]:
                transfer.hear(at_s * S, answer)
    assert read == [0, 1, 2, 3, 0, 1]


def test_messages_that_are_nobody_s_are_named() -> None:
    transfer, _ = uploading(Family.COPTER)
    answer = MissionAnswer(sender=NODE, target=NODE, result=3, opaque_id=0)
    assert not transfer.hear(0, answer)
    assert transfer.busy
    assert transfer.hear(0, MissionAnswer(sender=VEHICLE, target=NODE, result=3, opaque_id=0))


def test_what_follows_an_upload_rests_first() -> None:
    """A message of the one before may still be on its way."""
    transfer, upload = uploading(Family.PX4)
    Network().run(transfer, Peer(Family.PX4), seconds=2)
    assert not transfer.busy
    transfer.begin(2 * S, upload)
    due_ns = transfer.due_ns()
    assert due_ns is not None
    assert 5 * S <= due_ns < 6 * S
    assert transfer.take() == []


FAULTS = st.builds(
    Faults,
    refuses=st.sampled_from([-1, -1, -1, 0, 3]),
    alters=st.sampled_from([-1, -1, -1, 1, 2, 3]),
    stops_at=st.sampled_from([-1, -1, -1, 2, 4]),
    miscounts=st.sampled_from([False, False, False, True]),
    no_clear=st.booleans(),
)


@given(
    family=st.sampled_from(FAMILIES),
    seed=st.integers(0, 2**32),
    loss=st.floats(0, 0.3),
    twice=st.floats(0, 0.3),
    late_ms=st.integers(0, 2_000),
    faults=FAULTS,
)
@settings(max_examples=120, deadline=None, derandomize=True)
def test_no_link_makes_a_wrong_mission_believed_right(
    family: Family, seed: int, loss: float, twice: float, late_ms: int, faults: Faults
) -> None:
    """It ends in the mission that was given, or by name; and what is said of the vehicle is so."""
    transfer, upload = uploading(family)
    peer = Peer(family, faults)
    report = outcome(Network(seed, loss, twice, late_ms).run(transfer, peer))
    if isinstance(report, MissionUploaded):
        assert peer.mission == list(upload.items)
        return
    assert report.because
    if report.holds == OLD_ONE and faults.stops_at < 0:  # one that takes half a mission is no PX4
        assert peer.mission == list(OLD)
    if report.holds == NOTHING:
        assert peer.mission == []


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("late_ms", [0, 500, 2_000])
def test_a_bad_link_to_a_good_vehicle_mostly_carries_it(family: Family, late_ms: int) -> None:
    """30 % loss both ways, a tenth twice: of 20 seeds most get through, each other one has a name."""
    reports = [outcome(Network(seed, 0.3, 0.1, late_ms).run(uploading(family)[0], Peer(family))) for seed in range(20)]
    assert sum(isinstance(report, MissionUploaded) for report in reports) >= 12
    assert all(report.because for report in reports if isinstance(report, MissionUploadFailed))


def test_the_last_item_is_compared_too() -> None:
    check_failed(
        Family.PX4,
        Faults(alters=5),
        "an item is not what was given; it was cleared (item 5: height 35.0 for 30.0)",
        item=5,
        holds=NOTHING,
        attempts=2,
    )


def test_what_comes_after_the_last_item() -> None:
    """A request for one more is not served; an error may mean that the acknowledgement was lost: it is read."""
    transfer, _ = uploading(Family.PX4)
    for seq in range(7):
        transfer.hear(0, ItemRequest(sender=VEHICLE, target=NODE, seq=seq))
    transfer.hear(0, MissionAnswer(sender=VEHICLE, target=NODE, result=1, opaque_id=0))
    said = [item.word for item in transfer.take() if isinstance(item, Say)]
    assert said == [Word.COUNT, *[Word.ITEM] * 6, Word.LIST]
