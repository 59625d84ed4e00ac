"""Hold and sniff: in which slots a link is used, and what both hosts learn."""

import itertools

import pytest

from cosim.channels.clock import NativeClock
from cosim.machine import BROADCAST, Address, Hold, LinkEvent, Lost, Mode, Outcome, Sniff
from cosim.units import MS, SLOT, TICK, S, Time
from tests.channels.bluetooth.piconet_bench import Bench


@pytest.mark.parametrize("side", [0, 1])
def test_a_link_on_hold_is_silent_for_so_long_and_both_hosts_know(side: Address) -> None:
    bench = Bench(2, t_poll_slots=16)
    bench.ask(100 * SLOT, side, Hold(1 - side, 200))
    bench.run(400 * SLOT)
    first = [tick for tick, _, k in bench.on_air("POLL") if k == 1]
    second = [tick for tick, _, k in bench.on_air("POLL") if k == 2]
    assert [tick for tick in first if 200 <= tick < 600] == []
    assert 600 in first  # 300 slots: it has been due all the while
    assert max(b - a for a, b in itertools.pairwise(second)) == 32
    begins, ends = 100 * SLOT, 300 * SLOT
    assert bench.modes() == [
        (begins, 0, 1, Mode.HOLD),
        (begins, 1, 0, Mode.HOLD),
        (ends, 0, 1, Mode.ACTIVE),
        (ends, 1, 0, Mode.ACTIVE),
    ]


def test_payloads_wait_for_the_end_of_a_hold_and_broadcasts_are_missed() -> None:
    bench = Bench(2)
    bench.ask(100 * SLOT, 0, Hold(1, 200))
    bench.send(110 * SLOT, 0, BROADCAST, b"all", token=1)
    bench.send(120 * SLOT, 0, 1, b"down", token=2)
    bench.send(120 * SLOT, 1, 0, b"up", token=3)
    bench.send(130 * SLOT, 0, 2, b"other", token=4)
    bench.run(400 * SLOT)
    assert [(address, data) for _, address, data in bench.arrivals] == [
        (2, b"all"),
        (2, b"other"),
        (1, b"down"),
        (0, b"up"),
    ]
    assert bench.on_air("DM1")[-2:] == [(600, "DM1", 1), (602, "DM1", 1)]
    assert {token: outcome for *_, token, outcome in bench.fates()}[1] is Outcome.SENT


def test_nothing_is_scheduled_while_a_link_is_on_hold() -> None:
    bench = Bench(1)
    bench.ask(100 * SLOT, 0, Hold(1, 8000))
    bench.send(101 * SLOT, 0, 1)
    bench.run(102 * SLOT)
    before = bench.kernel.executed
    bench.run(8000 * SLOT)
    assert bench.kernel.executed - before <= 2


@pytest.mark.parametrize(
    ("slots", "mode"), [(0, Mode.ACTIVE), (1520, Mode.HOLD), (1521, Mode.ACTIVE), (-4, Mode.ACTIVE)]
)
def test_a_hold_that_supervision_would_not_survive_is_refused(slots: int, mode: Mode) -> None:
    bench = Bench(1, supervision=1 * S)  # 1600 slots, of which twice T_poll = 40 are for the waits before and after
    bench.ask(0, 0, Hold(1, slots))
    bench.run(3 * S)
    assert bench.modes()[0] == (0, 0, 1, mode)
    assert bench.lost() == []


def test_a_link_out_of_reach_or_a_strange_one_changes_no_mode() -> None:
    bench = Bench(2)
    bench.outage(1, 1 * S, (1, 0))
    bench.ask(10 * MS, 0, Hold(1, 100))
    bench.ask(10 * MS, 1, Sniff(0, 100, 0, 2))
    bench.ask(10 * MS, 1, Hold(2, 100))
    bench.ask(10 * MS, 0, Hold(7, 100))
    bench.run(2 * S)
    at = 10 * MS
    assert bench.modes() == [
        (at, 0, 1, Mode.ACTIVE),
        (at, 1, 0, Mode.ACTIVE),
        (at, 1, 2, Mode.NONE),
        (at, 0, 7, Mode.NONE),
    ]


@pytest.mark.parametrize("phase", [0, 5 * TICK + 7])
def test_a_sniffing_slave_is_addressed_in_its_attempts_only(phase: Time) -> None:
    bench = Bench(2, t_poll_slots=16, clock=NativeClock(phase))
    bench.ask(0, 1, Sniff(0, 100, 20, 4))
    bench.send(55 * SLOT, 0, 1, bytes(300))
    bench.run(1000 * SLOT)
    ticks = [tick for tick, kind, k in bench.on_air("POLL", "DH5") if k == 1]
    assert ticks[:6] == [240, 440, 640, 840, 1040, 1240] if phase == 0 else [t % 200 for t in ticks[:6]] == [40] * 6
    assert all(tick % 200 in (40, 44) for tick in ticks)
    assert len(bench.arrivals) == 1
    assert bench.modes() == [(0, 0, 1, Mode.SNIFF), (0, 1, 0, Mode.SNIFF)]
    second = [tick for tick, _, k in bench.on_air("POLL") if k == 2]
    assert len(second) > 50


def test_sniffing_ends_when_asked_to() -> None:
    bench = Bench(1, t_poll_slots=16)
    bench.ask(0, 0, Sniff(1, 400, 0, 2))
    bench.ask(500 * SLOT, 0, Sniff(1, 0, 0, 0))
    bench.run(700 * SLOT)
    ticks = [tick for tick, *_ in bench.on_air("POLL")]
    assert ticks[:1] == [800]
    assert ticks[1:] == [1000 + 32 * i for i in range(len(ticks) - 1)]
    assert len(ticks) > 8
    assert bench.modes()[2:] == [(500 * SLOT, 0, 1, Mode.ACTIVE), (500 * SLOT, 1, 0, Mode.ACTIVE)]


@pytest.mark.parametrize(
    "wish",
    [(100, 0, 0), (101, 0, 2), (100, 1, 2), (100, 0, 3), (100, 100, 2), (100, 0, 102), (40_000, 0, 2), (-4, 0, 2)],
)
def test_a_sniff_that_means_nothing_is_refused(wish: tuple[int, int, int]) -> None:
    bench = Bench(1)
    bench.ask(0, 0, Sniff(1, *wish))
    bench.run(100 * SLOT)
    assert bench.modes() == [(0, 0, 1, Mode.ACTIVE)]
    assert bench.on_air("POLL")[0][0] == 80


def test_a_broadcast_reaches_a_sniffing_slave_in_its_attempt_only() -> None:
    bench = Bench(2)
    bench.ask(0, 0, Sniff(1, 100, 0, 8))
    bench.send(50 * SLOT, 0, BROADCAST, b"missed")
    bench.send(100 * SLOT, 0, BROADCAST, b"heard")
    bench.run(200 * SLOT)
    assert [data for _, address, data in bench.arrivals if address == 1] == [b"heard"]
    assert [data for _, address, data in bench.arrivals if address == 2] == [b"missed", b"heard"]


def test_a_link_that_is_lost_on_hold_and_made_again_is_active() -> None:
    bench = Bench(1)
    bench.ask(0, 0, Hold(1, 1000))
    bench.kernel.at(100 * SLOT, lambda: bench.piconet.close(0, 1))
    bench.kernel.at(101 * SLOT, lambda: bench.piconet.add_slave(1, 1, 400))
    bench.run(1100 * SLOT)
    assert [event for _, _, event in bench.news if isinstance(event, LinkEvent)][2:] == [Lost(1), Lost(0)]
    assert bench.on_air("POLL")[0] == (400, "POLL", 1)
    assert bench.modes() == [(0, 0, 1, Mode.HOLD), (0, 1, 0, Mode.HOLD)]
