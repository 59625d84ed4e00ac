"""A connected piconet: who is served in which slot, what is repeated, what is filtered, and when a link is lost.

The master's clock begins a TX slot at time 0, so that slot pair j starts at j * 1.25 ms unless a test says otherwise.
"""

import pytest

from cosim.channels.bluetooth.hopping import basic_channel
from cosim.channels.bluetooth.packets import ACL, DM1
from cosim.channels.bluetooth.radio import Heard
from cosim.channels.clock import NativeClock
from cosim.kernel import Kernel
from cosim.machine import BROADCAST, Outcome
from cosim.units import MS, SLOT, TICK, US, S, Time
from tests.channels.bluetooth.piconet_bench import MASTER, PAIR, WORD, Bench

# ---------------------------------------------------------------- polls


def test_an_idle_link_is_polled_every_t_poll_slots_and_answers_in_the_next_slot() -> None:
    bench = Bench(t_poll_slots=40)
    bench.run(110 * MS)
    assert bench.on_air() == [
        (80 * j + half, kind, 1) for j in (1, 2, 3, 4) for half, kind in ((0, "POLL"), (2, "NULL"))
    ]


def test_links_that_are_due_together_are_polled_by_due_time_then_lt_addr() -> None:
    bench = Bench(size=3, t_poll_slots=16)
    bench.run(45 * MS)
    assert bench.on_air("POLL") == [(start + 4 * (k - 1), "POLL", k) for start in (80, 112) for k in (1, 2, 3)]


def test_an_idle_hour_of_seven_slaves_is_counted_without_an_event_for_any_poll() -> None:
    bench = Bench(size=7, idle=False)
    bench.kernel.run(3600 * S + 25 * MS)  # the first polls are due at 25 ms
    counts = bench.piconet.counts()
    assert counts == {"POLL": 7 * 144_000, "NULL": 7 * 144_000, "idle": 7 * 144_000}
    assert bench.frames == []


def test_idle_frames_have_the_time_and_channel_that_clock_and_address_give() -> None:
    clock = NativeClock(phase=(2**28 - 40) * TICK + 123, ppm=-250)
    first = clock.tick(0)
    bench = Bench(size=2, clock=clock, first_due=first, t_poll_slots=16)
    bench.run(60 * MS)
    assert len(bench.frames) == 24
    for frame, heard in bench.frames:
        tick = clock.tick(frame.start)
        assert frame.start == clock.time_of(tick)
        assert frame.channel == basic_channel(WORD, tick % 2**28)
        assert tick % 4 == (0 if frame.kind == "POLL" else 2)
        assert (frame.source == MASTER) == (frame.kind == "POLL")
        assert frame.duration == 126 * US
        assert heard is Heard.RECEIVED


# ---------------------------------------------------------------- exchanges


@pytest.mark.parametrize("size", [1, 2, 3, 4, 7])
@pytest.mark.parametrize("n_bc", [1, 2, 3])
def test_a_full_exchange_takes_its_slots_and_no_more(size: int, n_bc: int) -> None:
    """M broadcasts and M - 1 data polls with answers waiting: 2 N_BC M + 2 (M - 1) slots for a team of M."""
    bench = Bench(size=size, n_bc=n_bc, first_due=4000, t_poll_slots=200, idle=False)
    for slave in range(1, size + 1):
        bench.send(0, slave, MASTER, b"answer")
    bench.send(0, MASTER, BROADCAST, b"state")
    for slave in range(1, size + 1):
        bench.send(0, MASTER, slave, b"poll")
        bench.send(0, MASTER, BROADCAST, b"state")
    bench.run(1 * S)
    team = size + 1
    starts = [tick for tick, kind, _ in bench.on_air("DM1") if tick % 4 == 0]
    assert starts[0] == 0
    assert (starts[-1] - starts[0]) // 2 + 2 == 2 * n_bc * team + 2 * (team - 1)
    assert len(bench.arrivals) == team * size + 2 * size


def test_longer_packets_push_the_next_slot_on() -> None:
    bench = Bench(size=1, first_due=4000, idle=False)
    bench.send(0, MASTER, BROADCAST, bytes(339))  # DH5: 5 slots, and one that stays empty
    bench.send(0, MASTER, 1, bytes(121))  # DM3: 3 slots
    bench.send(0, 1, MASTER, bytes(224))  # DM5 in the answer: 5 slots
    bench.send(0, MASTER, BROADCAST, b"x")
    bench.run(50 * MS)
    assert bench.on_air("DH5", "DM3", "DM5", "DM1") == [
        (0, "DH5", 0),
        (12, "DM3", 1),
        (12 + 6, "DM5", 1),
        (12 + 6 + 10, "DM1", 0),
    ]


def test_the_queue_is_first_in_first_out_across_unicast_and_broadcast() -> None:
    bench = Bench(size=2, first_due=4000)
    for number, destination in enumerate((2, BROADCAST, 1, 1, BROADCAST, 2)):
        bench.send(0, MASTER, destination, bytes([number]))
    bench.run(50 * MS)
    assert [data[0] for _, _, data in bench.arrivals] == [0, 1, 1, 2, 3, 4, 4, 5]
    assert bench.on_air("DM1") == [
        *((0, "DM1", 2), (4, "DM1", 0), (4, "DM1", 0), (8, "DM1", 1)),
        *((12, "DM1", 1), (16, "DM1", 0), (16, "DM1", 0), (20, "DM1", 2)),
    ]


def test_a_payload_of_this_instant_is_sent_in_the_slot_that_starts_now_and_a_later_one_in_the_next() -> None:
    for at, tick in ((PAIR, 4), (PAIR + 1, 8)):
        bench = Bench(idle=False)
        bench.send(at, MASTER, 1)
        bench.run(10 * MS)
        assert bench.on_air("DM1") == [(tick, "DM1", 1)]


def test_a_slave_answers_the_poll_that_starts_now_and_not_one_that_has_started() -> None:
    poll = 80 * TICK
    for at, tick in ((poll, 82), (poll + 1, 162)):
        bench = Bench(idle=False)
        bench.send(at, 1, MASTER)
        bench.run(100 * MS)
        assert bench.on_air("DM1") == [(tick, "DM1", 1)]


def test_an_overdue_link_is_served_before_the_queue_and_with_the_head_if_that_is_for_it() -> None:
    bench = Bench(size=2, first_due=0)
    bench.send(0, MASTER, 2, b"head")
    bench.run(5 * MS)
    assert [item for item in bench.on_air() if item[0] % 4 == 0][:2] == [(0, "POLL", 1), (4, "DM1", 2)]


def test_data_is_a_poll_too() -> None:
    bench = Bench(t_poll_slots=16)
    bench.send(0, MASTER, 1)
    bench.run(12 * MS)
    assert bench.on_air("DM1", "POLL") == [(0, "DM1", 1), (32, "POLL", 1)]


def test_a_broadcast_reaches_seven_slaves_in_one_event_at_the_end_of_its_frame() -> None:
    bench = Bench(size=7)
    bench.send(0, MASTER, BROADCAST, b"all", token=5)
    bench.run(2 * MS)
    end = DM1.air_time(3)
    assert bench.arrivals == [(end, slave, b"all") for slave in range(1, 8)]
    assert bench.fates() == [(end, MASTER, 5, Outcome.SENT)]
    assert bench.deliveries == 1


def test_repetitions_of_a_broadcast_are_sent_each_and_delivered_once() -> None:
    bench = Bench(size=2, n_bc=3, first_due=4000)
    bench.outage(0, 1 * MS, (MASTER, 2))
    bench.send(0, MASTER, BROADCAST, b"b", token=1)
    bench.run(10 * MS)
    air = DM1.air_time(1)
    assert [tick for tick, _, _ in bench.on_air("DM1")] == [0, 0, 4, 4, 8, 8]
    assert bench.arrivals == [(air, 1, b"b"), (PAIR + air, 2, b"b")]
    assert bench.fates() == [(2 * PAIR + air, MASTER, 1, Outcome.SENT)]


# ---------------------------------------------------------------- retransmission


def test_data_is_acknowledged_at_the_end_of_the_answer() -> None:
    bench = Bench()
    bench.send(0, MASTER, 1, b"abc", token=7)
    bench.run(10 * MS)
    assert bench.arrivals == [(DM1.air_time(3), 1, b"abc")]
    assert bench.fates() == [(SLOT + 126 * US, MASTER, 7, Outcome.DELIVERED)]


def test_data_that_is_not_heard_is_sent_again_in_every_tx_slot() -> None:
    bench = Bench()
    bench.outage(0, 3 * PAIR, (MASTER, 1))
    bench.send(0, MASTER, 1, b"abc", token=7)
    bench.run(20 * MS)
    assert bench.on_air("DM1") == [(4 * j, "DM1", 1) for j in range(4)]
    assert [h for f, h in bench.frames if f.kind == "DM1"] == [Heard.OUT_OF_RANGE] * 3 + [Heard.RECEIVED]
    assert bench.arrivals == [(3 * PAIR + DM1.air_time(3), 1, b"abc")]
    assert bench.fates() == [(3 * PAIR + SLOT + 126 * US, MASTER, 7, Outcome.DELIVERED)]


def test_data_whose_acknowledgement_is_lost_is_sent_again_and_delivered_once() -> None:
    bench = Bench()
    bench.outage(0, 2 * PAIR, (1, MASTER))
    bench.send(0, MASTER, 1, b"one")
    bench.send(0, MASTER, 1, b"two")
    bench.run(20 * MS)
    assert len(bench.on_air("DM1")) == 4
    air = DM1.air_time(3)
    assert bench.arrivals == [(air, 1, b"one"), (3 * PAIR + air, 1, b"two")]


def test_a_slaves_data_waits_for_the_masters_next_packet_to_be_acknowledged() -> None:
    bench = Bench(t_poll_slots=40)
    bench.send(1, 1, MASTER, b"up", token=3)
    bench.run(60 * MS)
    poll = 80 * TICK
    assert bench.arrivals == [(poll + SLOT + DM1.air_time(2), MASTER, b"up")]
    assert bench.on_air("DM1", "NULL") == [(82, "DM1", 1), (162, "NULL", 1)]
    assert bench.fates() == [(160 * TICK + 126 * US, 1, 3, Outcome.DELIVERED)]


def test_a_slaves_data_is_repeated_if_the_acknowledging_packet_is_lost_and_filtered_by_the_master() -> None:
    bench = Bench(t_poll_slots=40)
    bench.send(1, 1, MASTER, b"up", token=3)
    bench.outage(40 * MS, 60 * MS, (MASTER, 1))
    bench.run(110 * MS)
    assert bench.on_air("DM1", "NULL") == [(82, "DM1", 1), (242, "DM1", 1), (322, "NULL", 1)]
    assert len(bench.arrivals) == 1
    assert bench.fates() == [(320 * TICK + 126 * US, 1, 3, Outcome.DELIVERED)]


def test_a_slaves_payloads_follow_each_other_poll_by_poll() -> None:
    bench = Bench(t_poll_slots=16)
    for number in range(3):
        bench.send(1, 1, MASTER, bytes([number]))
    bench.run(60 * MS)
    assert [(data[0], time) for time, _, data in bench.arrivals] == [
        (n, (80 + 32 * n) * TICK + SLOT + DM1.air_time(1)) for n in range(3)
    ]


def test_reach_is_that_of_the_start_of_the_slot_pair_even_when_slots_are_computed_later() -> None:
    bench = Bench(t_poll_slots=40)
    bench.outage(50 * MS, 75 * MS, (MASTER, 1))  # exactly at the polls of ticks 160 and 240
    bench.run(110 * MS)
    polls = [(bench.clock.tick(frame.start), heard) for frame, heard in bench.frames if frame.kind == "POLL"]
    received, missed = Heard.RECEIVED, Heard.OUT_OF_RANGE
    assert polls == [(80, received), (160, missed), (240, received), (320, received)]
    assert bench.on_air("NULL") == [(82, "NULL", 1), (242, "NULL", 1), (322, "NULL", 1)]


# ---------------------------------------------------------------- work


def test_only_slots_with_a_payload_are_events() -> None:
    bench = Bench(size=7, idle=False)
    before = _executed(bench.kernel, 10 * S)
    bench = Bench(size=7, idle=False)
    bench.send(1 * S + 15 * MS, MASTER, BROADCAST)
    bench.send(2 * S, 3, MASTER)
    after = _executed(bench.kernel, 10 * S)
    assert before == 0
    # two sends; the broadcast's slot and end; start and both ends of the pair that serves the slave, and of the next
    assert after == 2 + 2 + 3 + 3


def _executed(kernel: Kernel, until: Time) -> int:
    count = 0
    while kernel.environment.peek() < until:
        kernel.environment.step()
        count += 1
    return count


def test_frames_are_counted_by_type() -> None:
    bench = Bench(size=2, n_bc=2, first_due=4000, types=tuple(ACL.values()), idle=False)
    bench.send(0, MASTER, BROADCAST, b"x")
    bench.send(0, MASTER, 1, bytes(100))
    bench.run(10 * MS)
    counts = bench.piconet.counts()
    assert counts == {"DM1": 2, "DM3": 1, "POLL": 0, "NULL": 1, "idle": 0}


def test_a_poll_that_fetches_or_acknowledges_a_payload_is_not_idle() -> None:
    bench = Bench(idle=False)
    bench.send(0, 1, MASTER)
    bench.run(110 * MS)
    assert bench.on_air() == [(80, "POLL", 1), (82, "DM1", 1), (160, "POLL", 1), (162, "NULL", 1)]
    assert bench.piconet.counts() == {"DM1": 1, "POLL": 4, "NULL": 3, "idle": 2}


def test_an_idle_poll_in_a_busy_slot_is_not_recorded_unless_idle_frames_are() -> None:
    bench = Bench(size=2, first_due=0, idle=False)
    bench.send(0, MASTER, 2)
    bench.run(5 * MS)
    assert bench.on_air() == [(4, "DM1", 2), (6, "NULL", 2)]


def test_a_slot_that_is_put_off_is_still_decided_when_it_comes() -> None:
    bench = Bench(t_poll_slots=40, idle=False)
    bench.send(1, 1, MASTER, b"a")
    bench.send(10 * MS, MASTER, BROADCAST)
    bench.send(30 * MS, 1, MASTER, b"b")  # after the poll of tick 80, before that of tick 160
    bench.run(60 * MS)
    assert [(tick, kind) for tick, kind, _ in bench.on_air() if tick > 32] == [
        *((80, "POLL"), (82, "DM1"), (160, "POLL"), (162, "DM1")),
    ]
