"""Page and page scan: the exchange to the half slot, what every lost frame leads to, and how long a page takes."""

import numpy as np
import pytest

from cosim.channels.bluetooth.hopping import basic_channel, inquiry_response_channel, page_scan_channel, train_phase
from cosim.channels.bluetooth.paging import Page, PageScanner, PageSettings
from cosim.channels.bluetooth.radio import Heard, Identity, Radio
from cosim.channels.bluetooth.scanning import ScanSettings
from cosim.channels.clock import NativeClock
from cosim.kernel import WAKE
from cosim.units import MS, TICK, US, S
from tests.channels.bluetooth.bluetooth_field import CLOCK_RANGE, Field, clock_in_block, random_clock
from tests.tiers import two_tiers

ID, FHS, POLL = 68 * US, 366 * US, 126 * US
CONTINUOUS = 0.01125
ZERO = NativeClock(0)
MASTER, SLAVE = 0, 1
MASTER_WORD, SLAVE_WORD = 0x6587CBA9, 0x2A96EF25
RECEIVED, LOST, NOT_TUNED = Heard.RECEIVED, Heard.OUT_OF_RANGE, Heard.NOT_TUNED


class PageField(Field):
    """A pager (address 0, clock 0 unless said otherwise), a scanner (address 1) and what they are told, with times."""

    def __init__(self, scanner_clock, clock=ZERO, interval_s=CONTINUOUS, offset=0, interlaced=False):
        super().__init__()
        self.clock = clock
        self.slave_connected = []
        self.connected = []
        self.failed = []
        self.scanner = PageScanner(
            Radio(self.kernel, self.air, Identity(SLAVE, SLAVE_WORD, scanner_clock)),
            ScanSettings(interval_s=interval_s, interlaced=interlaced),
            offset,
            lambda master, lt_addr: self.slave_connected.append((self.kernel.now, master, lt_addr)),
        )
        self.scanner.enable(0)

    def page(self, estimate=0, address=MASTER, clock=None, lt_addr=5, **settings):
        return Page(
            Radio(self.kernel, self.air, Identity(address, MASTER_WORD + address, clock or self.clock)),
            PageSettings(**settings),
            self.scanner,
            estimate,
            lt_addr,
            lambda tick: self.connected.append((self.kernel.now, address, tick)),
            lambda: self.failed.append((self.kernel.now, address)),
        )

    def lose(self, source, start, end):
        """Let nothing that *source* sends in [start, end), in microseconds, arrive."""
        self.outages.append((source, 1 - source, start * US, end * US))


def tuned_to(tick):
    """A clock that scans on the channel on which a pager of clock 0 and estimate 0 sends at *tick* on train A."""
    return clock_in_block(train_phase(tick, "A"))


def in_us(rows, begin=0):
    return [((start - begin) / US, kind, source, heard) for start, kind, source, heard in rows]


@pytest.mark.parametrize(("tick", "heard"), [(4, 0), (5, 312.5)])
def test_the_exchange_takes_place_at_the_instants_of_the_specification(tick, heard):
    """t = 0 at the start of the transmit slot that is heard."""
    field = PageField(tuned_to(tick))
    field.page()
    field.kernel.run(S)
    begin = 4 * TICK
    assert in_us(field.sent(), begin) == [
        (heard, "ID", MASTER, RECEIVED),
        (heard + 625, "ID", SLAVE, RECEIVED),
        (1250, "FHS", MASTER, RECEIVED),
        (1875, "ID", SLAVE, RECEIVED),
        (2500, "POLL", MASTER, RECEIVED),
        (3125, "NULL", SLAVE, RECEIVED),
    ]
    assert field.slave_connected == [(begin + 2500 * US + POLL, MASTER, 5)]
    assert field.connected == [(begin + 3125 * US + POLL, MASTER, 12)]
    assert not field.failed


def test_each_frame_is_on_the_channel_of_its_table():
    field = PageField(tuned_to(5))
    field.page()
    field.kernel.run(S)
    # both freeze the phase at which they meet, answer at Y1 = 1 and step on by one in every slot pair
    x = train_phase(5, "A")
    table = [page_scan_channel(SLAVE_WORD, x << 12) for x in range(32)]
    answers = [inquiry_response_channel(x << 12, address=SLAVE_WORD) for x in range(32)]
    channels = [frame.channel for frame, _ in field.frames]
    assert channels[:4] == [table[x], answers[x], table[(x + 1) % 32], answers[(x + 1) % 32]]
    assert channels[4:] == [basic_channel(MASTER_WORD, 12), basic_channel(MASTER_WORD, 14)]
    assert [frame.lt_addr for frame, _ in field.frames] == [0, 0, 0, 0, 5, 5]


def test_a_lost_response_sends_the_pager_on_and_the_scanner_back_after_8_slots():
    field = PageField(tuned_to(4))
    field.lose(SLAVE, 0, 2000)
    field.page()
    field.kernel.run(S)
    assert in_us(field.sent())[:3] == [
        (1250, "ID", MASTER, RECEIVED),
        (1875, "ID", SLAVE, LOST),
        (11250, "ID", MASTER, RECEIVED),  # the same phase, 32 ticks on
    ]
    assert len(field.connected) == 1


@pytest.mark.parametrize(
    ("lost_from", "lost_to", "hit", "heard"),
    [
        (0, 2000, 22, 22),  # the response at tick 6, and 8 slots
        (0, 2000, 21, 53),
        (3000, 4000, 74, 74),  # the acknowledgement at tick 10, and 32 slots
        (3000, 4000, 73, 105),
    ],
)
def test_a_scanner_that_waits_for_its_pager_hears_another_exactly_when_its_time_is_over(lost_from, lost_to, hit, heard):
    """A second pager, whose ID could be heard at every 32nd tick through *hit*."""
    field = PageField(tuned_to(4))
    field.lose(SLAVE, lost_from, lost_to)
    field.lose(MASTER, lost_to, 10**6)
    field.page()
    field.page(address=2, clock=NativeClock((CLOCK_RANGE - hit + 4) * TICK))
    field.kernel.run(S)
    assert field.starts("ID", 2)[0] == heard * TICK
    assert [address for _, address, _ in field.connected] == [2]


@pytest.mark.parametrize("lost", [1, 2, 3])
def test_a_lost_fhs_is_repeated_in_the_next_slot_pair(lost):
    field = PageField(tuned_to(4))
    field.lose(MASTER, 2000, 2500 + 1250 * lost - 100)
    field.page()
    field.kernel.run(S)
    assert in_us(field.sent("FHS")) == [
        *((2500 + 1250 * n, "FHS", MASTER, LOST) for n in range(lost)),
        (2500 + 1250 * lost, "FHS", MASTER, RECEIVED),
    ]
    assert in_us(field.sent("POLL")) == [(2500 + 1250 * (lost + 1), "POLL", MASTER, RECEIVED)]


def test_after_four_lost_fhs_both_go_back():
    field = PageField(tuned_to(4))
    field.lose(MASTER, 2000, 7000)
    field.page()
    field.kernel.run(S)
    assert [heard for *_, heard in field.sent("FHS")] == [LOST] * 4 + [RECEIVED]
    assert in_us(field.sent())[6][:3] == (11250, "ID", MASTER)
    assert len(field.connected) == 1


def test_a_lost_acknowledgement_leaves_the_pager_repeating_to_a_slave_that_has_left():
    field = PageField(tuned_to(4))
    field.lose(SLAVE, 3000, 4000)
    field.page()
    field.kernel.run(S)
    assert in_us(field.sent())[2:8] == [
        (2500, "FHS", MASTER, RECEIVED),
        (3125, "ID", SLAVE, LOST),
        (3750, "FHS", MASTER, NOT_TUNED),
        (5000, "FHS", MASTER, NOT_TUNED),
        (6250, "FHS", MASTER, NOT_TUNED),
        (31250, "ID", MASTER, RECEIVED),  # the slave waits for a POLL until 3125 + 20000
    ]
    assert len(field.connected) == 1


@pytest.mark.parametrize("lost", [1, 15])
def test_a_lost_poll_is_repeated_up_to_16_times(lost):
    field = PageField(tuned_to(4))
    field.lose(MASTER, 3000, 3750 + 1250 * lost - 100)
    field.page()
    field.kernel.run(S)
    assert [heard for *_, heard in field.sent("POLL")] == [LOST] * lost + [RECEIVED]
    assert field.slave_connected == [((3750 + 1250 * lost) * US + POLL, MASTER, 5)]
    assert len(field.connected) == 1


def test_after_16_lost_polls_both_go_back():
    field = PageField(tuned_to(4))
    field.lose(MASTER, 3000, 3750 + 1250 * 16 - 100)
    field.page()
    field.kernel.run(S)
    assert [heard for *_, heard in field.sent("POLL")] == [LOST] * 16 + [RECEIVED]
    resumed = in_us(field.sent("ID", MASTER))[1]
    assert resumed == (31250, "ID", MASTER, RECEIVED)
    assert len(field.connected) == 1


def test_a_lost_null_is_polled_for_again_and_the_slave_is_a_slave_once():
    field = PageField(tuned_to(4))
    field.lose(SLAVE, 4000, 5000)
    field.page()
    field.kernel.run(S)
    assert in_us(field.sent())[4:] == [
        (3750, "POLL", MASTER, RECEIVED),
        (4375, "NULL", SLAVE, LOST),
        (5000, "POLL", MASTER, RECEIVED),
        (5625, "NULL", SLAVE, RECEIVED),
    ]
    assert len(field.slave_connected) == 1
    assert field.connected == [(5625 * US + POLL, MASTER, 16)]


def test_a_page_whose_nulls_are_all_lost_fails_in_time_while_the_slave_believes_in_the_link():
    field = PageField(tuned_to(4))
    field.lose(SLAVE, 4000, 10**7)
    field.page()
    field.kernel.run(6 * S)
    assert len(field.sent("NULL")) == 16
    assert field.failed == [(16384 * TICK, MASTER)]
    assert len(field.slave_connected) == 1
    assert not field.connected
    assert not field.scanner.enabled


def test_a_page_that_nobody_hears_fails_after_its_timeout():
    field = PageField(tuned_to(4))
    field.scanner.disable()
    field.page()
    field.page(address=2, timeout_slots=100, clock=NativeClock(TICK))
    field.kernel.run(6 * S)
    assert field.failed == [((3 + 200) * TICK, 2), (16384 * TICK, MASTER)]
    assert not field.frames


def test_the_exchange_under_way_at_the_timeout_is_finished_first():
    def page(*outage):
        field = PageField(tuned_to(4))
        if outage:
            field.lose(*outage)
        field.page(timeout_slots=4)  # no ID at or after tick 8, 2500 us
        field.kernel.run(S)
        return field

    assert page().connected == [(4375 * US + POLL, MASTER, 12)]
    assert page(MASTER, 2000, 10**6).failed == [(24 * TICK, MASTER)]  # the slot pair after the fourth FHS
    assert page(MASTER, 3000, 10**6).failed == [(76 * TICK, MASTER)]  # ...after the sixteenth POLL
    assert page(SLAVE, 0, 2000).failed == [(8 * TICK, MASTER)]


def test_a_scanner_that_stops_in_the_exchange_sends_nothing_more_and_can_be_paged_again():
    field = PageField(tuned_to(4))
    field.page()
    field.kernel.at(2500 * US + 1, field.scanner.disable)
    field.kernel.at(20 * MS, lambda: field.scanner.enable(field.kernel.now), WAKE)
    field.kernel.run(S)
    assert in_us(field.sent())[3:7] == [
        (3750, "FHS", MASTER, NOT_TUNED),
        (5000, "FHS", MASTER, NOT_TUNED),
        (6250, "FHS", MASTER, NOT_TUNED),
        (21250, "ID", MASTER, RECEIVED),
    ]
    assert len(field.connected) == 1


def test_a_scanner_switched_on_during_a_page_is_heard_of_from_then_on():
    field = PageField(tuned_to(4))
    field.scanner.disable()
    field.page()
    field.kernel.at(36 * TICK, lambda: field.scanner.enable(field.kernel.now), WAKE)
    field.kernel.run(S)
    assert field.starts("ID", MASTER) == [36 * TICK]


def test_of_two_pagers_one_gets_the_device_and_the_other_fails():
    field = PageField(tuned_to(4))
    field.page()
    field.page(address=2, clock=NativeClock(-8 * TICK % (CLOCK_RANGE * TICK)), estimate=8, timeout_slots=400)
    field.kernel.run(6 * S)
    assert [address for _, address, _ in field.connected] == [MASTER]
    assert [address for _, address in field.failed] == [2]
    assert len(field.slave_connected) == 1


def test_a_cancelled_page_reports_nothing_and_the_scanner_scans_again():
    field = PageField(tuned_to(4))
    page = field.page()
    field.kernel.at(2600 * US, page.cancel)
    field.kernel.run(4 * MS)
    field.page(address=2)
    field.kernel.run(S)
    assert [address for _, address, _ in field.connected] == [2]
    assert not field.failed
    assert in_us(field.sent("ID", 2))[0][0] == 11250  # not before the response time-out at 6875


def test_reach_is_looked_at_again_with_every_id_that_might_be_heard():
    field = PageField(tuned_to(4))
    field.lose(MASTER, 0, 1_000_000)
    field.page()
    field.kernel.run(2 * S)
    assert field.sent()[0][0] >= S
    assert len(field.connected) == 1


def test_a_device_that_hears_the_page_in_its_second_interlaced_window_answers_half_a_cycle_ahead():
    """The pager's estimate is 16 blocks off, so only the second window can match it."""
    clock = clock_in_block(0)
    field = PageField(clock, interval_s=0.64, offset=1000, interlaced=True)
    field.page(estimate=((16 << 12) + 1000) & ~3)
    field.kernel.run(S)
    first = field.starts("ID", MASTER)[0]
    assert 36 <= clock.tick(first) - 1000 < 72
    assert len(field.connected) == 1


@pytest.mark.parametrize(("mode", "n_page"), [("R0", 1), ("R1", 128), ("R2", 256)])
def test_the_mode_says_how_often_a_train_is_repeated(mode, n_page):
    assert PageSettings(mode=mode).n_page == n_page


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mode", "interval_s", "exact", "published_s"),
    two_tiers(
        [
            ("R0", CONTINUOUS, True, 0.0052),
            ("R0", CONTINUOUS, False, 0.0102),
            ("R1", 1.28, False, 1.280),
            ("R1", 1.28, True, 0.641),
            ("R2", 2.56, True, 1.277),
            ("R2", 2.56, False, 2.560),
        ],
        2,
    ),
)
def test_mean_page_times_are_the_published_ones(mode, interval_s, exact, published_s):
    """From the pager's first transmit slot to the start of the response, random phases, no drift, ideal channel."""
    times = []
    for case in range(4000):
        rng = np.random.default_rng([21, case])
        clock = random_clock(rng)
        offset = int(rng.integers(round(interval_s / 312.5e-6)))
        field = PageField(random_clock(rng), clock, interval_s, offset)
        first = (clock.tick(-1) + 4) // 4 * 4
        true = field.scanner.clock.tick(clock.time_of(first)) - first
        field.page(true & ~3 if exact else int(rng.integers(CLOCK_RANGE)) & ~3, mode=mode)
        field.kernel.run(6 * S)
        times += [(start - clock.time_of(first)) / S for start in field.starts("ID", SLAVE)[:1]]
    print(f"{mode} {'exact' if exact else 'random'}: mean {np.mean(times):.5f} s of {len(times)}")
    assert len(times) >= 3980
    assert np.mean(times) == pytest.approx(published_s, rel=0.03)
