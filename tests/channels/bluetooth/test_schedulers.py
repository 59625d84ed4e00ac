"""Polling schedulers, slot by slot: who is addressed in which slot, and that T_poll is kept and nobody starves."""

import itertools

import pytest

from cosim.machine import BROADCAST, Outcome
from cosim.units import SLOT, TICK, S
from tests.channels.bluetooth.piconet_bench import PAIR, Bench

EAGER = ("round_robin", "exhaustive", "backlog")


def addressed(bench: Bench) -> list[int]:
    """LT_ADDR of the master's frames in order."""
    return [frame.lt_addr for frame, _ in bench.frames if frame.source == 0]


@pytest.mark.parametrize("scheduler", EAGER)
def test_every_slot_pair_polls_the_next_slave_in_turn_and_none_is_a_kernel_event(scheduler: str) -> None:
    bench = Bench(3, first_due=76, scheduler=scheduler)
    bench.run(12 * PAIR)
    assert bench.on_air("POLL") == [(4 * i, "POLL", 1 + i % 3) for i in range(12)]
    before = bench.kernel.executed
    bench.run(4 * S)
    assert bench.piconet.counts()["idle"] == 4 * S // PAIR
    assert bench.kernel.executed - before <= 2  # the end of the run, and supervision


@pytest.mark.parametrize("scheduler", EAGER)
def test_idle_polls_that_nobody_records_are_counted_as_if_they_were(scheduler: str) -> None:
    bench = Bench(3, first_due=76, idle=False, scheduler=scheduler)
    bench.run(4 * S)
    assert bench.piconet.counts()["idle"] == 4 * S // PAIR


def test_the_lazy_scheduler_polls_only_what_is_due() -> None:
    bench = Bench(3, first_due=76, scheduler="lazy")
    bench.run(81 * TICK)
    assert bench.on_air("POLL") == [(76, "POLL", 1), (80, "POLL", 2)]


def test_round_robin_gives_each_slave_one_pair_whatever_waits() -> None:
    bench = Bench(3, first_due=76, scheduler="round_robin")
    for _ in range(3):
        bench.send(0, 0, 2)
        bench.send(0, 3, 0)
    bench.run(9 * PAIR)
    assert bench.on_air() == [
        *((0, "POLL", 1), (2, "NULL", 1), (4, "DM1", 2), (6, "NULL", 2), (8, "POLL", 3), (10, "DM1", 3)),
        *((12, "POLL", 1), (14, "NULL", 1), (16, "DM1", 2), (18, "NULL", 2), (20, "POLL", 3), (22, "DM1", 3)),
        *((24, "POLL", 1), (26, "NULL", 1), (28, "DM1", 2), (30, "NULL", 2), (32, "POLL", 3), (34, "DM1", 3)),
    ]
    assert len(bench.arrivals) == 6


def test_exhaustive_stays_with_a_slave_until_both_sides_are_empty() -> None:
    bench = Bench(3, first_due=76, scheduler="exhaustive")
    for _ in range(2):
        bench.send(0, 0, 2)
    for _ in range(3):
        bench.send(0, 2, 0)
        bench.send(0, 3, 0)
    bench.run(10 * PAIR)
    # a payload stays in its queue until the next packet of the other side has acknowledged it: 3 payloads, 4 pairs
    assert addressed(bench) == [1, 2, 2, 2, 2, 3, 3, 3, 3, 1]


def test_backlog_serves_the_longest_pair_of_queues_first() -> None:
    bench = Bench(3, first_due=76, scheduler="backlog")
    for _ in range(1):
        bench.send(0, 0, 1)
    for _ in range(2):
        bench.send(0, 0, 3)
        bench.send(0, 0, 2)
    bench.send(0, 3, 0)
    bench.run(6 * PAIR)
    # backlogs 1, 2, 3; a pair with 3 takes two of its three, but the upward one waits for its acknowledgement
    assert addressed(bench) == [3, 2, 3, 1, 2, 3]


@pytest.mark.parametrize("scheduler", EAGER)
def test_t_poll_is_kept_while_one_link_has_far_more_to_send(scheduler: str) -> None:
    bench = Bench(3, first_due=76, scheduler=scheduler, t_poll_slots=16)
    for _ in range(200):
        bench.send(0, 0, 2)
        bench.send(0, 2, 0)
    bench.run(100 * PAIR)
    for k in (1, 3):
        ticks = [tick for tick, kind, lt_addr in bench.on_air("POLL") if lt_addr == k]
        assert len(ticks) >= 9
        assert max(b - a for a, b in itertools.pairwise(ticks)) <= 2 * 16 + 4


@pytest.mark.parametrize("scheduler", EAGER)
def test_broadcasts_keep_their_place_in_the_queue_and_do_not_starve(scheduler: str) -> None:
    bench = Bench(3, first_due=76, scheduler=scheduler)
    bench.send(0, 0, 1, b"before", token=1)
    bench.send(0, 0, BROADCAST, b"all", token=2)
    bench.send(0, 0, 1, b"after", token=3)
    for _ in range(50):
        bench.send(0, 3, 0)
    bench.run(200 * PAIR)
    to_first = [data for _, address, data in bench.arrivals if address == 1]
    assert to_first == [b"before", b"all", b"after"]
    assert [(token, outcome) for _, address, token, outcome in bench.fates() if address == 0] == [
        (1, Outcome.DELIVERED),
        (2, Outcome.SENT),
        (3, Outcome.DELIVERED),
    ]
    assert [data for _, address, data in bench.arrivals if address == 2] == [b"all"]
    assert sum(address == 0 for _, address, _ in bench.arrivals) == 50


@pytest.mark.parametrize("scheduler", EAGER)
def test_what_is_sent_does_not_depend_on_who_looks(scheduler: str) -> None:
    """Decided in bulk or looked at in every slot, frames are the same: what is queued later changes nothing before."""
    runs = []
    for looks in (False, True):
        bench = Bench(4, first_due=76, scheduler=scheduler, t_poll_slots=16)
        for i in range(40):
            at = (i * 7919) % 200 * SLOT + i * 1000
            source, destination = ((0, 1 + i % 4), (1 + i % 3, 0), (0, BROADCAST))[i % 3]
            bench.send(at, source, destination, bytes(i * 8 % 300))
        for i in range(300 if looks else 0):
            bench.kernel.at(i * SLOT + 1, lambda bench=bench: bench.piconet.advance(bench.kernel.now))
        bench.run(300 * SLOT)
        runs.append((bench.frames, bench.arrivals, bench.piconet.counts()))
    assert runs[0] == runs[1]
    assert len(runs[0][1]) > 40


@pytest.mark.parametrize("scheduler", EAGER)
def test_t_poll_is_kept_while_broadcasts_queue_up(scheduler: str) -> None:
    bench = Bench(2, first_due=76, scheduler=scheduler, t_poll_slots=16)
    for _ in range(100):
        bench.send(0, 0, BROADCAST)
    bench.run(80 * PAIR)
    ticks = [tick for tick, *_ in bench.on_air("POLL")]
    assert ticks == [76 + 4 * k + 32 * i for i in range(8) for k in (0, 1)]


def test_what_waits_behind_a_broadcast_is_no_backlog_yet() -> None:
    bench = Bench(2, first_due=76, scheduler="backlog")
    bench.send(0, 0, 1)
    bench.send(0, 0, BROADCAST)
    for _ in range(3):
        bench.send(0, 0, 2)
    bench.run(5 * PAIR)
    assert [(tick, k) for tick, _, k in bench.on_air("DM1")] == [(0, 1), (4, 0), (4, 0), (8, 2), (12, 2), (16, 2)]
