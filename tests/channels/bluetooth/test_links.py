"""Links of a piconet: what cannot be sent, what is flushed, when a link is lost or closed, and pauses of the master.

The master's clock begins a TX slot at time 0, so that slot pair j starts at j * 1.25 ms.
"""

import pytest

from cosim.channels.bluetooth.packets import DH1, DM1
from cosim.channels.bluetooth.radio import Heard
from cosim.errors import LocalProtocolError
from cosim.machine import BROADCAST, Outcome, Outgoing
from cosim.units import MS, SLOT, TICK, US, S, Time
from tests.channels.bluetooth.piconet_bench import MASTER, PAIR, Bench

# ---------------------------------------------------------------- fates


def test_what_cannot_be_sent_is_told_at_once_and_never_inside_the_call() -> None:
    bench = Bench(size=1, types=(DM1, DH1))
    seen: list[int] = []

    def ask() -> None:
        bench.piconet.send(MASTER, Outgoing(9, b"x", 1))
        bench.piconet.send(MASTER, Outgoing(1, bytes(28), 2))
        bench.piconet.send(1, Outgoing(BROADCAST, b"x", 3))
        bench.piconet.send(1, Outgoing(2, b"x", 4))
        bench.piconet.send(9, Outgoing(MASTER, b"x", 5))
        seen.append(len(bench.news))

    bench.kernel.at(777, ask)
    bench.run(1 * MS)
    assert seen == [0]
    assert bench.fates() == [
        (777, MASTER, 1, Outcome.NO_LINK),
        (777, MASTER, 2, Outcome.TOO_LONG),
        (777, 1, 3, Outcome.NO_LINK),
        (777, 1, 4, Outcome.NO_LINK),
        (777, 9, 5, Outcome.NO_LINK),
    ]


def test_a_broadcast_without_any_link_has_no_link() -> None:
    bench = Bench(size=0)
    bench.send(0, MASTER, BROADCAST, token=1)
    bench.run(1 * MS)
    assert bench.fates() == [(0, MASTER, 1, Outcome.NO_LINK)]


def test_flush_takes_what_has_not_been_on_the_air_and_leaves_the_rest() -> None:
    bench = Bench(size=2, first_due=4000)
    bench.outage(0, 5 * PAIR, (MASTER, 1))
    for token, destination in enumerate((1, 1, 2, BROADCAST)):
        bench.send(0, MASTER, destination, bytes([token]), token)
    bench.kernel.at(2 * PAIR + 1, lambda: bench.piconet.flush(MASTER, 1))
    bench.run(50 * MS)
    assert bench.fates()[0] == (2 * PAIR + 1, MASTER, 1, Outcome.FLUSHED)
    assert [(token, outcome) for _, _, token, outcome in bench.fates()[1:]] == [
        (0, Outcome.DELIVERED),
        (2, Outcome.DELIVERED),
        (3, Outcome.SENT),
    ]


def test_a_slave_flushes_its_own_queue() -> None:
    bench = Bench()
    bench.send(1, 1, MASTER, token=1)
    bench.kernel.at(2, lambda: bench.piconet.flush(1, MASTER))
    bench.run(50 * MS)
    assert bench.fates() == [(2, 1, 1, Outcome.FLUSHED)]
    assert bench.arrivals == []


# ---------------------------------------------------------------- supervision


def test_both_sides_lose_a_link_one_supervision_time_after_the_last_frame_they_received() -> None:
    bench = Bench(t_poll_slots=40, supervision=2 * S)
    bench.outage(60 * MS, 9 * S, (MASTER, 1), (1, MASTER))
    bench.send(1 * S, 1, MASTER, token=1)
    bench.run(5 * S)
    last_poll = 160 * TICK  # 50 ms
    slave_lost, master_lost = last_poll + 126 * US + 2 * S, last_poll + SLOT + 126 * US + 2 * S
    assert bench.lost() == [(slave_lost, 1, MASTER), (master_lost, MASTER, 1)]
    assert bench.fates() == [(slave_lost, 1, 1, Outcome.FLUSHED)]
    assert bench.piconet.members() == ()
    assert bench.piconet.free_lt_addr() == 1


def test_a_lost_link_takes_its_payloads_along_and_the_last_one_the_broadcasts() -> None:
    bench = Bench(size=2, supervision=2 * S, first_due=80)
    bench.outage(0, 9 * S, (1, MASTER), (2, MASTER))
    bench.send(0, MASTER, 1, b"1", 1)
    bench.send(0, MASTER, 2, b"2", 2)
    bench.send(0, MASTER, BROADCAST, b"3", 3)
    bench.run(5 * S)
    flushed = [(token, outcome) for _, address, token, outcome in bench.fates() if address == MASTER]
    assert sorted(flushed) == [(token, Outcome.FLUSHED) for token in (1, 2, 3)]
    assert [lost[1:] for lost in bench.lost() if lost[1] == MASTER] == [(MASTER, 1), (MASTER, 2)]


def test_each_side_loses_a_link_of_one_direction_in_its_own_time() -> None:
    bench = Bench(supervision=2 * S)
    bench.outage(0, 9 * S, (1, MASTER))
    bench.send(2 * S + 5 * MS, 1, MASTER, token=8)  # nobody polls it any more
    bench.run(5 * S)
    last_poll = (2 * S - 1) // (25 * MS) * 25 * MS
    slave_lost = last_poll + 126 * US + 2 * S
    assert bench.lost() == [(2 * S, MASTER, 1), (slave_lost, 1, MASTER)]  # the master heard last when the link came up
    assert bench.fates() == [(slave_lost, 1, 8, Outcome.FLUSHED)]


def test_a_side_that_is_down_sends_nothing_even_if_the_other_is_up() -> None:
    bench = Bench(size=2, supervision=2 * S)
    bench.outage(0, 9 * S, (1, MASTER))  # the master loses 1 at 2 s, 1 its master some 2 s later
    bench.send(2 * S + 1, MASTER, 1, token=1)
    bench.kernel.at(3 * S, lambda: bench.piconet.vanish(2))
    bench.send(3 * S + 1, 2, MASTER, token=2)
    bench.run(3 * S + 1 * MS)
    assert bench.fates() == [(2 * S + 1, MASTER, 1, Outcome.NO_LINK), (3 * S + 1, 2, 2, Outcome.NO_LINK)]


def test_a_new_link_starts_with_new_sequence_numbers() -> None:
    bench = Bench(supervision=2 * S)
    bench.outage(0, 9 * S, (MASTER, 1), (1, MASTER))
    bench.send(1 * S, MASTER, 1, b"old")
    bench.kernel.at(10 * S, lambda: bench.piconet.add_slave(1, 1, 40_000))
    bench.send(10 * S + 1, MASTER, 1, b"new")
    bench.run(11 * S)
    assert [data for _, _, data in bench.arrivals] == [b"new"]


def test_payloads_keep_a_link_as_polls_do() -> None:
    bench = Bench(supervision=2 * S, first_due=80_000, t_poll_slots=40_000, idle=False)
    for number in range(1, 61):
        bench.send(number * 50 * MS, 1, MASTER, bytes(3))
        bench.send(number * 50 * MS, MASTER, 1, bytes(3))
    bench.run(8 * S)
    heard = 3 * S  # the start of the last slot pair; no poll was due
    end = DM1.air_time(3)
    assert bench.lost() == [(heard + end + 2 * S, 1, MASTER), (heard + SLOT + end + 2 * S, MASTER, 1)]
    assert bench.on_air("POLL") == []


def test_broadcasts_keep_a_slave_that_its_master_has_lost() -> None:
    bench = Bench(size=2, supervision=2 * S)
    bench.outage(0, 9 * S, (1, MASTER))
    for second in (1, 2, 3, 4):
        bench.send(second * S + 10 * MS, MASTER, BROADCAST, bytes([second]))
    bench.run(8 * S)
    assert bench.lost() == [(2 * S, MASTER, 1), (6 * S + 10 * MS + DM1.air_time(1), 1, MASTER)]
    assert [data[0] for _, receiver, data in bench.arrivals if receiver == 1] == [1, 2, 3, 4]


def test_an_outage_shorter_than_the_supervision_time_loses_nothing() -> None:
    bench = Bench(supervision=2 * S)
    bench.outage(60 * MS, 2 * S + 40 * MS, (MASTER, 1), (1, MASTER))
    bench.run(10 * S)
    assert bench.lost() == []


# ---------------------------------------------------------------- pauses and ends


def test_a_suspended_piconet_sends_nothing_and_goes_on_with_what_is_overdue() -> None:
    bench = Bench(size=2, t_poll_slots=16)
    bench.kernel.at(20 * MS, bench.piconet.suspend)
    bench.send(30 * MS, MASTER, 1, b"late")
    bench.kernel.at(100 * MS + 1, bench.piconet.resume)
    bench.run(105 * MS)
    resumed = 324  # the first TX slot after 100 ms = tick 320
    assert [item for item in bench.on_air() if item[0] % 4 == 0] == [
        (resumed, "DM1", 1),  # link 1 is overdue, and the head of the queue is for it
        (resumed + 4, "POLL", 2),
    ]


def test_a_pause_waits_for_the_end_of_a_slot_pair_and_for_links_that_are_due() -> None:
    bench = Bench(size=2, t_poll_slots=40, first_due=8)
    answers: list[tuple[Time, Time | None]] = []

    def ask() -> None:
        answers.append((bench.kernel.now, bench.piconet.next_pause()))
        if answers[-1][1] is not None:
            bench.kernel.at(answers[-1][1], ask)

    bench.kernel.at(8 * TICK, ask)
    bench.run(20 * MS)
    assert answers == [(8 * TICK, 12 * TICK), (12 * TICK, 16 * TICK), (16 * TICK, None)]


def test_a_pause_waits_for_the_end_of_a_long_packet() -> None:
    bench = Bench()
    bench.send(0, MASTER, BROADCAST, bytes(339))  # five slots and an empty one
    answers: list[Time | None] = []
    bench.kernel.at(1, lambda: answers.append(bench.piconet.next_pause()))
    bench.kernel.at(12 * TICK, lambda: answers.append(bench.piconet.next_pause()))
    bench.run(10 * MS)
    assert answers == [12 * TICK, None]


def test_closing_a_link_tells_both_sides_and_frees_the_lt_addr() -> None:
    bench = Bench(size=2)
    bench.send(5, 1, MASTER, token=4)
    bench.kernel.at(10, lambda: bench.piconet.close(MASTER, 1))
    bench.run(1 * MS)
    assert bench.lost() == [(10, MASTER, 1), (10, 1, MASTER)]
    assert bench.fates() == [(10, 1, 4, Outcome.FLUSHED)]
    assert bench.piconet.members() == (2,)
    assert bench.piconet.free_lt_addr() == 1


def test_closing_a_link_that_is_not_there_does_nothing() -> None:
    bench = Bench(size=2)
    for side, peer in ((MASTER, 3), (3, MASTER), (1, 2), (2, 1)):
        bench.piconet.close(side, peer)
    bench.run(1 * MS)
    assert bench.lost() == []
    assert bench.piconet.members() == (1, 2)


def test_closing_a_link_out_of_reach_leaves_the_other_side_to_its_supervision() -> None:
    bench = Bench(supervision=2 * S)
    bench.outage(30 * MS, 9 * S, (1, MASTER))
    bench.kernel.at(40 * MS, lambda: bench.piconet.close(1, MASTER))
    bench.run(5 * S)
    assert bench.lost() == [(40 * MS, 1, MASTER), (25 * MS + SLOT + 126 * US + 2 * S, MASTER, 1)]


def test_a_slave_out_of_reach_is_not_told_that_its_master_has_closed_the_link() -> None:
    bench = Bench(supervision=2 * S)
    bench.outage(30 * MS, 9 * S, (MASTER, 1))
    bench.kernel.at(40 * MS, lambda: bench.piconet.close(MASTER, 1))
    bench.run(5 * S)
    assert bench.lost() == [(40 * MS, MASTER, 1), (25 * MS + 126 * US + 2 * S, 1, MASTER)]


def test_a_device_that_vanishes_is_not_told_and_its_peer_finds_out() -> None:
    bench = Bench(supervision=2 * S)
    bench.kernel.at(40 * MS, lambda: bench.piconet.vanish(1))
    bench.run(5 * S)
    assert bench.lost() == [(25 * MS + SLOT + 126 * US + 2 * S, MASTER, 1)]
    missed = [heard for frame, heard in bench.frames if frame.kind == "POLL" and frame.start > 40 * MS]
    assert set(missed) == {Heard.NOT_TUNED}


def test_data_for_a_device_that_has_vanished_is_repeated_in_vain_and_flushed() -> None:
    bench = Bench(supervision=2 * S)
    bench.kernel.at(40 * MS, lambda: bench.piconet.vanish(1))
    bench.send(1900 * MS, MASTER, 1, token=6)
    bench.run(5 * S)
    lost = 25 * MS + SLOT + 126 * US + 2 * S
    assert bench.arrivals == []
    assert bench.fates() == [(lost, MASTER, 6, Outcome.FLUSHED)]
    assert len(bench.on_air("DM1")) == len(range(1900 * MS, lost, PAIR))


def test_an_eighth_slave_has_no_lt_addr() -> None:
    bench = Bench(size=7)
    assert bench.piconet.free_lt_addr() is None
    with pytest.raises(LocalProtocolError, match="LT_ADDR 8"):
        bench.piconet.add_slave(8, 8, 80)
    with pytest.raises(LocalProtocolError, match="slave 8 is not free"):
        bench.piconet.add_slave(8, 3, 80)
