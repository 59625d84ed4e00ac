"""Automatic flush and full queues: what is dropped when, and that what follows is taken for new."""

import pytest

from cosim.machine import Outcome
from cosim.units import MS, SLOT, TICK
from tests.channels.bluetooth.piconet_bench import PAIR, Bench


def test_a_payload_that_is_not_acknowledged_in_time_is_flushed_at_the_next_slot_boundary() -> None:
    bench = Bench(1, flush=10 * MS, first_due=4000)
    bench.outage(0, 30 * MS, (0, 1))
    bench.send(0, 0, 1, b"lost", token=1)
    bench.run(60 * MS)
    assert bench.fates() == [(10 * MS, 0, 1, Outcome.FLUSHED)]  # 10 ms is a boundary of 1.25 ms
    assert len(bench.on_air("DM1")) == 8  # one in every pair of 1.25 ms, the last at 8.75 ms
    assert bench.arrivals == []


def test_a_payload_that_is_on_the_air_is_flushed_when_its_slot_pair_is_over() -> None:
    bench = Bench(1, flush=10 * MS + 1, first_due=4000)
    bench.outage(0, 30 * MS, (0, 1))
    bench.send(0, 0, 1, bytes(300), token=1)
    bench.run(60 * MS)
    # DH5 takes six slots where no answer comes: 0, 3.75, 7.5 ms
    assert bench.on_air("DH5") == [(0, "DH5", 1), (12, "DH5", 1), (24, "DH5", 1)]
    assert bench.fates() == [(11_250_000, 0, 1, Outcome.FLUSHED)]


def test_one_that_is_acknowledged_in_time_is_not_flushed_and_each_is_judged_by_its_own_age() -> None:
    bench = Bench(1, flush=10 * MS, first_due=4000)
    bench.send(0, 0, 1, b"a", token=1)
    bench.outage(2 * MS, 16 * MS, (0, 1))
    bench.send(3 * MS, 0, 1, b"b", token=2)
    bench.send(9 * MS, 0, 1, b"c", token=3)
    bench.run(60 * MS)
    assert [(token, outcome) for *_, token, outcome in bench.fates()] == [
        (1, Outcome.DELIVERED),
        (2, Outcome.FLUSHED),
        (3, Outcome.DELIVERED),
    ]
    assert bench.fates()[1][0] == 13_750_000  # the first multiple of 1.25 ms from 13 ms on
    assert [data for *_, data in bench.arrivals] == [b"a", b"c"]


@pytest.mark.parametrize("lost", [(0, 1), (1, 0)], ids=["payloads", "acknowledgements"])
@pytest.mark.parametrize("source", [0, 1], ids=["down", "up"])
@pytest.mark.parametrize("count", [1, 2])
def test_the_payload_after_a_flush_is_new_whatever_its_receiver_has_seen(
    lost: tuple[int, int], source: int, count: int
) -> None:
    bench = Bench(1, flush=30 * MS, t_poll_slots=16, first_due=4)
    bench.outage(0, 100 * MS, lost)
    for i in range(count):
        bench.send(i * 40 * MS + 1, source, 1 - source, b"flushed", token=i)
    bench.send(100 * MS, source, 1 - source, b"new", token=8)
    bench.send(150 * MS, source, 1 - source, b"newer", token=9)
    bench.run(200 * MS)
    outcomes = [outcome for *_, outcome in bench.fates()]
    assert outcomes == [*[Outcome.FLUSHED] * count, Outcome.DELIVERED, Outcome.DELIVERED]
    assert [data for *_, data in bench.arrivals if data != b"flushed"] == [b"new", b"newer"]


def test_without_a_time_out_nothing_is_flushed() -> None:
    bench = Bench(1, first_due=4000)
    bench.outage(0, 300 * MS, (0, 1))
    bench.send(0, 0, 1, b"x", token=1)
    bench.run(400 * MS)
    assert [(token, outcome) for *_, token, outcome in bench.fates()] == [(1, Outcome.DELIVERED)]


def test_a_device_holds_so_many_payloads_and_refuses_more() -> None:
    bench = Bench(2, queue=2, first_due=80)
    for token in range(3):
        bench.send(1000, 0, 1, b"d", token)
        bench.send(1000, 1, 0, b"u", 10 + token)
    bench.send(20 * MS, 0, 2, b"later", 20)
    bench.run(80 * TICK + 4 * PAIR + SLOT)
    assert bench.fates()[:2] == [(1000, 0, 2, Outcome.QUEUE_FULL), (1000, 1, 12, Outcome.QUEUE_FULL)]
    assert sorted(data for *_, data in bench.arrivals) == [b"d", b"d", b"later", b"u", b"u"]


def test_an_acknowledgement_of_what_was_flushed_does_not_count_for_what_follows() -> None:
    """The master has the first payload at 2 ms, but says so at its next poll only, at 11.25 ms: too late."""
    bench = Bench(1, flush=5 * MS, t_poll_slots=16, first_due=4)
    bench.send(1, 1, 0, b"first", token=1)
    bench.send(8 * MS, 1, 0, b"second", token=2)
    bench.run(40 * MS)
    assert [data for *_, data in bench.arrivals] == [b"first", b"second"]
    assert [(token, outcome) for *_, token, outcome in bench.fates()] == [(1, Outcome.FLUSHED), (2, Outcome.FLUSHED)]
