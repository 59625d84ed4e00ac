"""What becomes of procedures and links when a device leaves range, or is switched off, at any instant of them.

A sweep takes one course of events, and strikes at every half slot of it and a nanosecond about the boundaries of its
frames: one way of the air falls silent, or both, or a radio is switched off, for ever or for a while. Whatever comes of
it, every command has one answer in time, every payload one fate, both sides end with the same links, the trace says
what the frames have met, and who has no link can be found and paged again.
"""

from collections import Counter
from collections.abc import Callable

import pytest

from cosim.kernel import WORLD
from cosim.machine import (
    BROADCAST,
    Connected,
    Disconnect,
    Discovered,
    Fate,
    Inquire,
    InquiryComplete,
    Lost,
    Outcome,
    Page,
    PageFailed,
    Role,
    Scan,
    Share,
)
from cosim.units import MS, SLOT, TICK, US, S, Time
from tests.channels.bluetooth.bluetooth_arena import (
    CONTINUOUS,
    EXCHANGE,
    FAULTS,
    PAGE_TIMEOUT,
    SUPERVISION,
    Arena,
    check,
    check_at_rest,
    instants,
    paging,
    strike,
)
from tests.tiers import all_pairs

# ---------------------------------------------------------------- pages


def page_span() -> tuple[Arena, Time, Time]:
    """Return a page without a fault, when its first heard ID begins, and when the last frame has ended."""
    world = paging()
    world.kernel.run(PAGE_TIMEOUT)
    frames = world.frames()
    assert [frame["kind"] for frame in frames] == ["ID", "ID", "FHS", "ID", "POLL", "NULL"]
    return world, frames[0]["time_ns"], frames[-1]["time_ns"] + frames[-1]["duration_ns"]


@pytest.mark.slow
@pytest.mark.parametrize("lasting", [None, 700 * US, 3 * MS, 40 * MS])
@pytest.mark.parametrize("fault", FAULTS)
def test_a_page_that_is_struck_at_any_instant_ends_in_time_on_both_sides(fault: str, lasting: Time | None):
    reference, begin, end = page_span()
    steps = set()  # types of the frames that were not received
    for number, at in enumerate(instants(reference, begin - SLOT, end + SLOT)):
        world = paging()
        strike(world, FAULTS[fault], at, None if lasting is None else at + lasting, number)
        world.kernel.run(PAGE_TIMEOUT + EXCHANGE + 2 * MS)
        pager = world.hosts[0]
        answers = pager.got(PageFailed) + pager.got(Connected)
        if fault != "master_off":
            assert len(answers) == 1, at
        elif at != end:  # at its very end the order decides
            assert [type(event) for event in answers] == ([] if at < end else [Connected]), at
        if PageFailed(1) in answers:
            assert pager.when(PageFailed)[0] <= PAGE_TIMEOUT + EXCHANGE + 2 * SLOT
        steps |= {frame["kind"] for frame in world.frames() if frame["outcome"] != "received"}
        # three supervision times: until one side has lost the link, until the other has noticed, and once more
        world.kernel.run(PAGE_TIMEOUT + 3 * SUPERVISION)
        killed = {"master_off": 0, "slave_off": 1}.get(fault)
        check(world, killed)
        if killed is None:
            assert (1 in world.links(0)) == (0 in world.links(1)), at
        if lasting is None:
            check_at_rest(world)
    if lasting is None and fault in ("down", "both"):
        assert {"FHS", "POLL"} <= steps
    if lasting is None and fault in ("up", "both"):
        assert {"ID", "NULL"} <= steps


def test_a_page_to_a_device_that_is_off_fails_after_its_timeout_and_sends_nothing_that_is_heard():
    world = paging()
    world.switch(1, on=False)
    world.kernel.run(1 * S)
    assert world.hosts[0].got(PageFailed) == [PageFailed(1)]
    assert PAGE_TIMEOUT <= world.hosts[0].when(PageFailed)[0] <= PAGE_TIMEOUT + 2 * SLOT
    assert world.frames() == []
    world.at(1 * S, lambda: world.switch(1, on=True))
    world.kernel.run(1 * S + 1)
    check_at_rest(world)


def test_a_page_to_a_device_that_comes_late_connects():
    world = paging()
    world.switch(1, on=False)
    world.at(60 * MS, lambda: world.switch(1, on=True))
    world.kernel.run(1 * S)
    assert world.hosts[0].when(Connected)[0] > 60 * MS
    check(world, killed=1)


@pytest.mark.parametrize("late", range(60, 88, 4))
def test_a_page_whose_time_ends_within_an_exchange_ends_with_that(late: int):
    """The scanner comes late, and none of its NULLs arrives: 16 POLLs, of which the last ones follow pageTO."""

    def exchange(until: Time, silent_from: Time | None) -> Arena:
        world = paging()
        world.switch(1, on=False)
        world.at(late * MS, lambda: world.switch(1, on=True))
        if silent_from is not None:
            world.at(silent_from, lambda: world.silence([(1, 0)]), WORLD)
        world.kernel.run(until)
        return world

    reference = exchange(2 * PAGE_TIMEOUT, None)
    poll = next(frame["time_ns"] for frame in reference.frames() if frame["kind"] == "POLL")
    world = exchange(PAGE_TIMEOUT + EXCHANGE, poll)
    assert [frame["kind"] for frame in world.frames()].count("POLL") == 16
    assert {frame["outcome"] for frame in world.frames() if frame["kind"] == "NULL"} == {"out_of_range"}
    assert world.hosts[0].got(PageFailed) == [PageFailed(1)]
    (failed,) = world.hosts[0].when(PageFailed)
    assert failed == pytest.approx(max(PAGE_TIMEOUT, poll + 16 * 2 * SLOT), abs=2 * SLOT)


def leaving_during_the_first_answer(leave: Callable[[Arena], None]) -> Arena:
    reference, _, _ = page_span()
    null = reference.frames()[-1]
    world = paging()
    world.at(null["time_ns"] + null["duration_ns"] // 2, lambda: leave(world))
    world.kernel.run(2 * S)
    return world


@pytest.mark.parametrize("way", ["off", "disconnect"])
def test_a_slave_that_leaves_while_its_first_answer_is_on_the_air_is_not_connected(way: str):
    world = leaving_during_the_first_answer(
        lambda world: world.switch(1, on=False) if way == "off" else world.command(1, Disconnect(0))
    )
    assert world.hosts[0].got(PageFailed) == [PageFailed(1)]
    assert world.hosts[0].got(Connected) == []
    check_at_rest(world)


def test_a_new_slave_whose_host_scans_at_once_completes_its_page():
    world = paging()
    world.hosts[1].react = lambda event: world.command(1, Scan(True)) if isinstance(event, Connected) else None
    world.kernel.run(1 * S)
    assert world.links(0) == {1}
    assert world.links(1) == {0}
    assert world.channel.devices[1].page_scanner.enabled


def test_a_slave_that_is_switched_off_and_on_and_pages_its_former_master_has_one_link():
    world = paging()
    world.kernel.run(100 * MS)
    world.switch(1, on=False)
    world.at(110 * MS, lambda: world.switch(1, on=True))
    world.at(110 * MS, lambda: world.command(0, Scan(True)))
    world.at(120 * MS, lambda: world.command(1, Page(0)))
    world.kernel.run(2 * S)
    assert world.links(0) == {1}
    assert isinstance(world.hosts[1].got(Connected)[-1], Connected)
    assert world.hosts[1].got(Connected)[-1].role is Role.MASTER  # type: ignore[union-attr]
    world.say(0, 1, 10)
    world.say(1, 0, 10)
    world.kernel.run(2100 * MS)
    assert [host.got(Fate)[-1].outcome for host in world.hosts] == [Outcome.DELIVERED] * 2  # type: ignore[union-attr]


# ---------------------------------------------------------------- inquiries

INQUIRY = 120 * MS


def inquiring(version: str) -> Arena:
    world = Arena(3, inquiry_scan={"interval_s": CONTINUOUS, "version": version})
    world.at(0, lambda: world.command(0, Inquire(INQUIRY if version == "1.2" else 8 * INQUIRY, 9)))
    return world


@pytest.mark.slow
@pytest.mark.parametrize("version", ["1.1", "1.2"])
@pytest.mark.parametrize("fault", FAULTS)
def test_an_inquiry_that_is_struck_at_any_instant_ends_in_time_and_finds_who_has_answered(fault: str, version: str):
    duration = INQUIRY if version == "1.2" else 8 * INQUIRY
    reference = inquiring(version)
    reference.kernel.run(duration + 10 * MS)
    assert reference.hosts[0].got(Discovered)
    steps = instants(reference, 0, duration, 9 * TICK if version == "1.2" else 100 * TICK)
    lost = set()
    for number, at in enumerate(steps):
        world = inquiring(version)
        strike(world, FAULTS[fault], at, None if number % 3 else at + 7 * MS, number)
        world.kernel.run(duration + 10 * MS)
        inquirer = world.hosts[0]
        complete = inquirer.got(InquiryComplete)
        answers = [f for f in world.frames() if f["kind"] == "FHS" and f["outcome"] == "received"]
        if fault == "master_off":
            assert complete == []
            assert all(frame["time_ns"] + frame["duration_ns"] <= at for frame in answers)
        else:
            assert complete == [InquiryComplete(tuple(dict.fromkeys(frame["source"] for frame in answers)))]
            assert duration <= inquirer.when(InquiryComplete)[0] <= duration + 2 * SLOT
            assert Counter(event.peer for event in inquirer.got(Discovered)) == Counter({f["source"] for f in answers})  # type: ignore[union-attr]
        lost |= {(f["kind"], f["outcome"]) for f in world.frames() if f["source"] == 1}
        check(world, None)
        assert all(
            device.inquiry_scanner.enabled == (a not in world.off) for a, device in enumerate(world.channel.devices)
        )
        check_found_again(world)
    assert ("FHS", "received") in lost
    if fault in ("up", "both", "master_off"):
        assert {("FHS", "out_of_range"), ("FHS", "not_tuned")} & lost


def check_found_again(world: Arena) -> None:
    """Check that both others are found by a second inquiry, now that they are in reach."""
    world.silence(set(world.silent), silent=False)
    for device in list(world.off):
        world.switch(device, on=True)
    world.hosts[0].events.clear()
    world.command(0, Inquire(4 * S, 2))
    while not world.hosts[0].got(InquiryComplete):
        world.kernel.run(world.kernel.now + 100 * MS)
    (complete,) = world.hosts[0].got(InquiryComplete)
    assert isinstance(complete, InquiryComplete)
    assert set(complete.found) == {1, 2}


# ---------------------------------------------------------------- links

AFTER = 120 * MS
"""When the script of a connected piconet is over, if nothing holds it up."""


def talking(share: bool) -> tuple[Arena, Time]:
    """Return a piconet of 0 with slaves 1 and 2 that talk all the time, and when that begins."""
    world = Arena(4, n_bc=2)
    world.at(0, lambda: world.command(0, Page(1), Page(2)))
    while len(world.hosts[0].got(Connected)) < 2:
        world.kernel.run(world.kernel.now + 10 * MS)
    begin = world.kernel.now // MS * MS + 5 * MS
    if share:
        world.at(begin, lambda: world.command(1, Share(48, ((0, 4, 30),), 0)))
    for after, source, destination, length in (
        (0, 0, BROADCAST, 17),
        (1, 0, 1, 339),
        (1, 1, 0, 20),
        (2, 1, 0, 300),
        (2, 0, 2, 100),
        (12, 0, 1, 5),
        (12, 0, BROADCAST, 200),
        (12, 0, 2, 30),
        (25, 1, 0, 339),
        (25, 0, 1, 339),
        (26, 0, 1, 339),
        (26, 2, 0, 50),
        (75, 0, 1, 9),
        (75, 1, 0, 9),
        (80, 0, BROADCAST, 50),
    ):
        world.at(begin + after * MS, lambda s=source, d=destination, n=length: world.say(s, d, n))  # type: ignore[misc]
    world.at(begin + 60 * MS, lambda: world.command(0, Page(3)))  # it scans: the piconet is silent until it has come
    world.at(begin + 90 * MS, lambda: world.command(0, Inquire(20 * MS, 1)))
    return world, begin


@pytest.mark.slow
@pytest.mark.parametrize(("fault", "share", "lasting"), all_pairs(FAULTS, [False, True], [None, 5 * MS, 100 * MS]))
def test_a_link_that_is_struck_at_any_instant_ends_or_goes_on_and_every_payload_has_one_fate(
    fault: str, share: bool, lasting: Time | None
):
    killed = {"master_off": 0, "slave_off": 1}.get(fault)
    reference, begin = talking(share)
    reference.kernel.run(begin + 200 * MS)
    assert {host.address: Counter(event.outcome for event in host.got(Fate)) for host in reference.hosts[:3]} == {  # type: ignore[union-attr]
        0: {Outcome.DELIVERED: 7, Outcome.SENT: 3},
        1: {Outcome.DELIVERED: 4},
        2: {Outcome.DELIVERED: 1},
    }
    # every case looks at other instants
    all_instants = instants(reference, begin, begin + AFTER)[list(FAULTS).index(fault) + 5 * share :]
    outcomes: Counter[str] = Counter()
    for number, at in enumerate(all_instants[:: len(all_instants) // 45]):
        world, _ = talking(share)
        strike(world, FAULTS[fault], at, None if lasting is None else at + lasting, number)
        world.kernel.run(begin + AFTER + PAGE_TIMEOUT + 3 * SUPERVISION + 50 * MS)
        check(world, killed)
        for host in world.hosts[:2]:
            outcomes.update(event.outcome.value for event in host.got(Fate))  # type: ignore[union-attr]
        outcomes.update(frame["outcome"] for frame in world.frames())
        linked = 1 in world.channel.devices[0].master_of.members()
        assert linked == (0 in world.channel.devices[1].masters), at
        if lasting is None or killed is not None:
            assert not linked, at
        if lasting == 5 * MS and killed is None:
            assert linked, at
        if killed != 0:
            assert 2 in world.links(0)  # the other link does not care
            assert 0 in world.links(2)
            assert world.hosts[2].got(Fate) == [Fate(next(iter(t for s, t in world.sent if s == 2)), Outcome.DELIVERED)]
        delivered = {e.token for host in world.hosts for e in host.got(Fate) if e.outcome is Outcome.DELIVERED}  # type: ignore[union-attr]
        arrived = {int.from_bytes(data[:2], "big") for host in world.hosts for _, _, data, _ in host.received}
        assert delivered <= arrived
    if lasting is None:
        assert outcomes["flushed"] > 0
        assert outcomes["out_of_range"] + outcomes["not_tuned"] > 0
    assert outcomes["delivered"] > 0


@pytest.mark.parametrize("back_after", [1, 625 * US, 10 * MS, SUPERVISION])
def test_a_slave_that_is_switched_off_and_on_is_free_and_its_master_finds_out(back_after: Time):
    world = paging()
    world.kernel.run(100 * MS)
    world.switch(1, on=False)
    world.at(100 * MS + back_after, lambda: world.switch(1, on=True))
    world.kernel.run(100 * MS + back_after + 1)
    assert world.channel.devices[1].page_scanner.enabled
    world.kernel.run(2 * S)
    assert world.hosts[0].got(Lost) == [Lost(1)]
    assert 100 * MS < world.hosts[0].when(Lost)[0] <= 100 * MS + SUPERVISION
    assert world.hosts[1].got(Lost) == []
    check_at_rest(world)
