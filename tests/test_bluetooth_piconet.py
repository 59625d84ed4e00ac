"""A connected piconet: who is served in which slot, what is repeated, what is filtered, and when a link is lost.

The master's clock begins a TX slot at time 0, so that slot pair j starts at j * 1.25 ms unless a test says otherwise.
"""

from collections.abc import Iterable

import pytest

from cosim.channels.base import Arrival
from cosim.channels.bluetooth.clock import NativeClock
from cosim.channels.bluetooth.frames import FrameLog
from cosim.channels.bluetooth.hopping import basic_channel
from cosim.channels.bluetooth.packets import ACL, DH1, DM1
from cosim.channels.bluetooth.piconet import Piconet, PiconetSettings
from cosim.channels.bluetooth.radio import Air, Frame, Heard
from cosim.errors import LocalProtocolError
from cosim.kernel import WORLD, Kernel
from cosim.machine import BROADCAST, Address, Fate, LinkEvent, Lost, Outcome, Outgoing
from cosim.units import MS, SLOT, TICK, US, S, Time

PAIR = 2 * SLOT
MASTER = 0
WORD = 0x2A96EF25


class Bench:
    """A piconet of a master, 0, and slaves 1 to *size*, with LT_ADDR = address, and all that comes out of it."""

    def __init__(
        self,
        size: int = 1,
        clock: NativeClock | None = None,
        first_due: int = 80,
        idle: bool = True,
        **settings: object,
    ) -> None:
        self.kernel = Kernel()
        self.clock = clock or NativeClock(0)
        self.frames: list[tuple[Frame, Heard]] = []
        self.arrivals: list[tuple[Time, Address, bytes]] = []
        self.news: list[tuple[Time, Address, LinkEvent]] = []
        self.deliveries = 0
        self.deaf: set[tuple[Address, Address]] = set()
        air = Air(self.reach, lambda frame, heard: self.frames.append((frame, heard)))
        log = FrameLog(air, self.clock, WORD, wanted=True, idle_wanted=idle)
        self.piconet = Piconet(
            self.kernel,
            MASTER,
            self.clock,
            PiconetSettings(**settings),  # type: ignore[arg-type]
            self.reach,
            log,
            self.deliver,
        )
        for slave in range(1, size + 1):
            self.piconet.add_slave(slave, slave, first_due)

    def reach(self, transmitter: Address, receiver: Address, at: Time) -> bool:
        return (transmitter, receiver) not in self.deaf

    def outage(self, start: Time, end: Time, *ways: tuple[Address, Address]) -> None:
        """Nothing goes the *ways* (transmitter, receiver) from *start* until just before *end*."""
        self.kernel.at(start, lambda: self.change(self.deaf | set(ways)), WORLD)
        self.kernel.at(end, lambda: self.change(self.deaf - set(ways)), WORLD)

    def change(self, deaf: set[tuple[Address, Address]]) -> None:
        self.piconet.reach_changed(self.kernel.now)
        self.deaf = deaf

    def deliver(self, arrivals: Iterable[Arrival], news: Iterable[tuple[Address, LinkEvent]]) -> None:
        self.deliveries += 1
        self.arrivals += [(self.kernel.now, receiver, data) for receiver, data, _ in arrivals]
        self.news += [(self.kernel.now, address, event) for address, event in news]

    def send(
        self, at: Time, source: Address, destination: Address, payload: bytes = b"x", token: int | None = None
    ) -> None:
        self.kernel.at(at, lambda: self.piconet.send(source, Outgoing(destination, payload, token)))

    def run(self, until: Time) -> None:
        self.kernel.run(until)
        self.piconet.advance(until)
        self.frames.sort(key=lambda item: item[0].start)

    def on_air(self, *kinds: str) -> list[tuple[int, str, int]]:
        """Return (master's tick, type, LT_ADDR) of the frames of these types, or of all."""
        return [
            (self.clock.tick(frame.start), frame.kind, frame.lt_addr)
            for frame, _ in self.frames
            if not kinds or frame.kind in kinds
        ]

    def fates(self) -> list[tuple[Time, Address, int, Outcome]]:
        return [(time, address, e.token, e.outcome) for time, address, e in self.news if isinstance(e, Fate)]

    def lost(self) -> list[tuple[Time, Address, Address]]:
        return [(time, address, e.peer) for time, address, e in self.news if isinstance(e, Lost)]


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


def test_broadcasts_keep_a_slave_that_the_master_does_not_hear() -> None:
    bench = Bench(supervision=2 * S)
    bench.outage(0, 9 * S, (1, MASTER))
    bench.run(5 * S)
    assert bench.lost()[0] == (2 * S, MASTER, 1)  # heard last at time 0, when the link came up
    last_poll = (2 * S - 1) // (25 * MS) * 25 * MS
    assert bench.lost()[1] == (last_poll + 126 * US + 2 * S, 1, MASTER)


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


def test_closing_a_link_tells_both_sides_and_frees_the_lt_addr() -> None:
    bench = Bench(size=2)
    bench.send(5, 1, MASTER, token=4)
    bench.kernel.at(10, lambda: bench.piconet.close(MASTER, 1))
    bench.run(1 * MS)
    assert bench.lost() == [(10, MASTER, 1), (10, 1, MASTER)]
    assert bench.fates() == [(10, 1, 4, Outcome.FLUSHED)]
    assert bench.piconet.members() == (2,)
    assert bench.piconet.free_lt_addr() == 1


def test_closing_a_link_out_of_reach_leaves_the_other_side_to_its_supervision() -> None:
    bench = Bench(supervision=2 * S)
    bench.outage(30 * MS, 9 * S, (1, MASTER))
    bench.kernel.at(40 * MS, lambda: bench.piconet.close(1, MASTER))
    bench.run(5 * S)
    assert bench.lost() == [(40 * MS, 1, MASTER), (25 * MS + SLOT + 126 * US + 2 * S, MASTER, 1)]


def test_a_device_that_vanishes_is_not_told_and_its_peer_finds_out() -> None:
    bench = Bench(supervision=2 * S)
    bench.kernel.at(40 * MS, lambda: bench.piconet.vanish(1))
    bench.run(5 * S)
    assert bench.lost() == [(25 * MS + SLOT + 126 * US + 2 * S, MASTER, 1)]
    missed = [heard for frame, heard in bench.frames if frame.kind == "POLL" and frame.start > 40 * MS]
    assert set(missed) == {Heard.NOT_TUNED}


def test_an_eighth_slave_has_no_lt_addr() -> None:
    bench = Bench(size=7)
    assert bench.piconet.free_lt_addr() is None
    with pytest.raises(LocalProtocolError, match="LT_ADDR 8"):
        bench.piconet.add_slave(8, 8, 80)
    with pytest.raises(LocalProtocolError, match="slave 8 is not free"):
        bench.piconet.add_slave(8, 3, 80)


# ---------------------------------------------------------------- work


def test_only_slots_with_a_payload_are_events() -> None:
    bench = Bench(size=7, idle=False)
    before = _executed(bench.kernel, 10 * S)
    bench = Bench(size=7, idle=False)
    bench.send(1 * S + 15 * MS, MASTER, BROADCAST)
    bench.send(2 * S, 3, MASTER)
    after = _executed(bench.kernel, 10 * S)
    assert before == 0
    # two sends; the broadcast's slot and end; the poll that serves the slave, the data's end, the acknowledging poll
    assert after == 2 + 2 + 3


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
