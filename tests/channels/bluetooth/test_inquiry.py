"""Inquiry and inquiry scan: who answers what and when, what becomes of the answers, and how soon devices are found."""

import numpy as np
import pytest

from cosim.channels.bluetooth.hopping import train_phase
from cosim.channels.bluetooth.inquiry import (
    Inquiry,
    InquiryScanner,
    InquiryScanSettings,
    InquirySettings,
    known_offset,
)
from cosim.channels.bluetooth.radio import Heard, Identity, Radio
from cosim.channels.clock import NativeClock
from cosim.errors import LocalProtocolError
from cosim.kernel import WAKE
from cosim.randomness import Draws
from cosim.units import MS, SLOT, TICK, US, S
from tests.channels.bluetooth.bluetooth_field import Field, clock_in_block, random_clock
from tests.tiers import soak_count

ID, FHS = 68 * US, 366 * US
CONTINUOUS = 0.01125
ZERO = NativeClock(0)
INQUIRER = 0


class FixedDraws(Draws):
    """Back-offs in the order given, then the last one again; the arguments of the draws are kept."""

    def __init__(self, *values):
        self.values = list(values)
        self.asked = []

    def below(self, bound, number, link=0, purpose=0):
        self.asked.append((bound, number, link, purpose))
        return self.values.pop(0) if len(self.values) > 1 else self.values[0]


class InquiryField(Field):
    """One inquirer (address 0, clock 0 unless said otherwise) and its scanners."""

    def __init__(self, clock=ZERO):
        super().__init__()
        self.clock = clock
        self.scanners = []
        self.found = {}
        self.completed = None

    def radio(self, address, clock):
        return Radio(self.kernel, self.air, Identity(address, 0, clock))

    def scanner(self, clock, draws=None, offset=0, enable=True, **settings):
        address = len(self.scanners) + 1
        settings = InquiryScanSettings(**({"version": "1.2", "interval_s": CONTINUOUS} | settings))
        draws = draws or Draws(1, address)
        scanner = InquiryScanner(self.radio(address, clock), settings, offset, draws)
        if enable:
            scanner.enable(0)
        self.scanners.append(scanner)
        return scanner

    def inquire(self, ticks=32768, enough=99, address=INQUIRER, **settings):
        def found(peer, estimate):
            self.found[peer] = (self.kernel.now, estimate)

        def complete(peers):
            assert self.completed is None
            self.completed = (self.kernel.now, peers)

        inquiry_settings = InquirySettings(**settings)
        return Inquiry(self.radio(address, self.clock), inquiry_settings, ticks, enough, self.scanners, found, complete)


def tuned_to(tick, train="A"):
    """A clock whose scan phase is that of a train, of the inquirer's clock 0, at *tick*."""
    return clock_in_block(train_phase(tick, train))


@pytest.mark.parametrize("tick", [0, 4, 9, 29])
def test_a_v12_scanner_answers_the_first_id_625_us_after_its_start(tick):
    field = InquiryField()
    field.scanner(tuned_to(tick), FixedDraws(1000))
    field.inquire(ticks=64)
    field.kernel.run(S)
    start = tick * TICK
    assert field.sent() == [
        (start, "ID", INQUIRER, Heard.RECEIVED),
        (start + SLOT, "FHS", 1, Heard.RECEIVED),
    ]
    assert field.found[1][0] == start + SLOT + FHS
    assert field.completed == (65 * TICK, (1,))


def test_a_v12_scanner_backs_off_after_its_answer_and_moves_on_in_its_hop_sequence():
    draws = FixedDraws(0, 10, 1023)
    field = InquiryField()
    scanner = field.scanner(tuned_to(4), draws)
    field.inquire(ticks=4096)
    field.kernel.run(100 * MS)
    # the phase after n answers is met 0, 2, 4... ticks of the train's steps later: 4, 5, 8, 9...
    first, second, third = (start // TICK for start in field.starts("ID"))
    assert (first, second % 32, third % 32) == (4, 5, 8)
    assert second == 37  # the back-off of 0 slots ends with the FHS, past tick 5
    assert third >= 37 + 4 + 20
    assert scanner.n == 3
    assert draws.asked[0] == (128, scanner.clock.tick(4 * TICK), 0, 1)
    assert [asked[1] - scanner.clock.tick(0) for asked in draws.asked] == [first, second, third]


@pytest.mark.parametrize(("interval_s", "bound"), [(1.28, 1024), (2.56, 1024), (0.64, 128), (1.27875, 128)])
def test_the_v12_back_off_is_short_when_the_scan_interval_is(interval_s, bound):
    draws = FixedDraws(5)
    field = InquiryField()
    clock = tuned_to(4)
    field.scanner(clock, draws, offset=clock.tick(0) % round(interval_s / 312.5e-6), interval_s=interval_s)
    field.inquire(ticks=64)
    field.kernel.run(S)
    assert [asked[0] for asked in draws.asked] == [bound]


def test_a_v11_scanner_backs_off_first_and_answers_the_second_id():
    draws = FixedDraws(7)
    field = InquiryField()
    scanner = field.scanner(tuned_to(4), draws, version="1.1")
    field.inquire(ticks=64)
    field.kernel.run(S)
    # the back-off ends 14 ticks after tick 4; the phase comes again 32 ticks after it
    assert field.sent() == [
        (4 * TICK, "ID", INQUIRER, Heard.RECEIVED),
        (36 * TICK, "ID", INQUIRER, Heard.RECEIVED),
        (36 * TICK + SLOT, "FHS", 1, Heard.RECEIVED),
    ]
    assert scanner.n == 1
    assert draws.asked == [(1024, scanner.clock.tick(4 * TICK), 0, 1)]


@pytest.mark.parametrize(("slots", "second"), [(16, 36), (17, 68)])
def test_a_v11_back_off_of_exactly_the_distance_to_an_id_hears_it(slots, second):
    field = InquiryField()
    field.scanner(tuned_to(4), FixedDraws(slots), version="1.1")
    field.inquire(ticks=96)
    field.kernel.run(S)
    assert field.starts("ID")[:2] == [4 * TICK, second * TICK]


def test_a_v11_scanner_that_hears_no_second_id_for_128_slots_scans_again_with_the_same_n():
    field = InquiryField()
    scanner = field.scanner(tuned_to(4), FixedDraws(0, 0), version="1.1")
    field.outages = [(INQUIRER, 1, 5 * TICK, (4 + 256) * TICK)]
    field.inquire(ticks=4096)
    field.kernel.run(100 * MS)
    # the ID of tick 260 begins with the end of the response state: it is the first one of a new scan
    assert [start // TICK for start in field.starts("ID")] == [4, 260, 292]
    assert scanner.n == 1


def test_in_response_a_v11_scanner_needs_no_window():
    field = InquiryField()
    clock = tuned_to(4)
    field.scanner(clock, FixedDraws(200), version="1.1", offset=1000, interval_s=1.28)
    field.inquire(ticks=4096)
    field.kernel.run(S)
    first, second = (start // TICK for start in field.starts("ID"))
    assert first == 4
    assert clock.tick(second * TICK) - 1000 > 400


def test_answers_to_one_id_destroy_each_other_and_a_random_back_off_separates_them():
    field = InquiryField()
    for version in ("1.2", "1.2"):
        field.scanner(tuned_to(4), FixedDraws(20, 1000), version=version)
    field.inquire(ticks=40)
    field.kernel.run(S)
    assert field.starts("FHS", heard=Heard.COLLIDED) == [4 * TICK + SLOT] * 2
    assert not field.found

    field = InquiryField()
    for slots in (0, 20):
        field.scanner(tuned_to(4), FixedDraws(slots), version="1.1")
    field.inquire(ticks=96)
    field.kernel.run(S)
    assert field.starts("FHS") == [36 * TICK + SLOT, 68 * TICK + SLOT]
    assert sorted(field.found) == [1, 2]


def test_an_answer_that_is_out_of_reach_of_the_inquirer_harms_nobody():
    field = InquiryField()
    field.scanner(tuned_to(4), FixedDraws(1000))
    field.scanner(tuned_to(4), FixedDraws(1000))
    field.outages = [(2, INQUIRER, 0, S)]
    field.inquire(ticks=40)
    field.kernel.run(S)
    assert [outcome for *_, outcome in field.sent("FHS", 1)] == [Heard.RECEIVED]
    assert [outcome for *_, outcome in field.sent("FHS", 2)] == [Heard.OUT_OF_RANGE]


@pytest.mark.parametrize(("silent", "heard"), [(False, 40), (True, 8)])
def test_while_it_receives_an_answer_the_inquirer_sends_nothing(silent, heard):
    """The answer to tick 5 covers the start of tick 8."""
    field = InquiryField()
    field.scanner(tuned_to(5), FixedDraws(1000))
    field.scanner(tuned_to(8), FixedDraws(1000))
    if silent:
        field.outages = [(1, INQUIRER, 0, S)]
    field.inquire(ticks=64)
    field.kernel.run(S)
    assert [frame.start // TICK for frame, _ in field.frames if frame.destination == 2] == [heard]


def test_an_answer_that_starts_while_another_is_received_is_missed():
    field = InquiryField()
    field.scanner(tuned_to(4), FixedDraws(1000))
    field.scanner(tuned_to(5), FixedDraws(1000))
    field.inquire(ticks=32)
    field.kernel.run(S)
    assert field.sent("FHS") == [
        (6 * TICK, "FHS", 1, Heard.RECEIVED),
        (7 * TICK, "FHS", 2, Heard.BUSY),
    ]


def test_an_answer_on_a_channel_that_the_inquirer_has_left_is_not_tuned():
    field = InquiryField()
    # the scanner's clock enters its next block between the ID and its answer
    x = train_phase(4, "A")
    field.scanner(clock_in_block(x, 4096 - 5), FixedDraws(1000))
    field.inquire(ticks=32)
    field.kernel.run(S)
    assert field.sent("FHS") == [(6 * TICK, "FHS", 1, Heard.NOT_TUNED)]


def test_enough_ends_the_inquiry_with_the_fhs_and_later_answers_are_lost():
    field = InquiryField()
    field.scanner(tuned_to(4), FixedDraws(1000))
    field.scanner(tuned_to(5), FixedDraws(1000))
    field.scanner(tuned_to(8), FixedDraws(1000))
    field.inquire(enough=1)
    field.kernel.run(11 * S)
    assert field.completed == (6 * TICK + FHS, (1,))
    assert field.sent() == [
        (4 * TICK, "ID", INQUIRER, Heard.RECEIVED),
        (5 * TICK, "ID", INQUIRER, Heard.RECEIVED),
        (6 * TICK, "FHS", 1, Heard.RECEIVED),
        (7 * TICK, "FHS", 2, Heard.NOT_TUNED),
    ]


def test_a_device_is_reported_once_however_often_it_answers():
    field = InquiryField()
    scanner = field.scanner(tuned_to(4), FixedDraws(*[0] * 200))
    inquiry = field.inquire(ticks=4096)
    field.kernel.run(2 * S)
    assert scanner.n > 10
    assert inquiry.found == [1]
    assert field.completed == (4097 * TICK, (1,))


def test_the_last_id_may_be_answered_and_none_is_sent_after_it():
    for tick, received in ((29, True), (32, False)):
        field = InquiryField()
        field.scanner(tuned_to(tick), FixedDraws(1000))
        field.outages = [(INQUIRER, 1, 0, tick * TICK)]
        field.inquire(ticks=32)
        field.kernel.run(S)
        assert bool(field.found) == received


def test_reach_is_looked_at_again_with_every_id_that_might_be_heard():
    field = InquiryField()
    field.scanner(tuned_to(4), FixedDraws(1000))
    field.outages = [(INQUIRER, 1, 0, 100 * TICK)]
    field.inquire(ticks=4096)
    field.kernel.run(S)
    assert field.starts("ID")[0] == 100 * TICK


def test_a_scanner_that_stops_sends_no_answer_and_one_that_starts_uses_the_rest_of_its_window():
    field = InquiryField()
    scanner = field.scanner(tuned_to(4), FixedDraws(1000, 1000), offset=1000, interval_s=1.28)
    field.inquire(ticks=4096)
    field.kernel.at(5 * TICK, scanner.disable)
    field.kernel.run(6 * TICK + 1)
    assert (scanner.n, field.sent("FHS")) == (0, [])
    field.outages = [(INQUIRER, 1, 0, 33 * TICK)]
    field.kernel.at(35 * TICK, lambda: scanner.enable(field.kernel.now))
    field.kernel.run(S)
    assert field.starts("ID") == [4 * TICK]  # tick 36 would end after the window's 36 ticks

    field = InquiryField()
    scanner = field.scanner(clock_in_block(train_phase(4, "A"), 980), FixedDraws(1000), 980, False, interval_s=1.28)
    field.inquire(ticks=4096)
    field.kernel.at(4 * TICK, lambda: scanner.enable(field.kernel.now), WAKE)
    field.kernel.run(S)
    assert field.starts("ID") == [4 * TICK]


def test_a_cancelled_inquiry_reports_nothing_and_the_scanners_keep_n():
    field = InquiryField()
    scanner = field.scanner(tuned_to(4), FixedDraws(0, 0))
    inquiry = field.inquire(ticks=16)
    field.kernel.at(6 * TICK + 1, inquiry.cancel)
    field.kernel.run(10 * MS)
    assert field.sent("FHS") == [(6 * TICK, "FHS", 1, Heard.NOT_TUNED)]
    assert (field.found, field.completed, scanner.n) == ({}, None, 1)
    field.inquire()
    field.kernel.run(100 * MS)
    second = field.starts("ID")[1] // TICK
    assert second % 32 == 5  # the phase one step on


def test_an_answer_being_received_when_the_inquiry_is_cancelled_is_lost():
    field = InquiryField()
    field.scanner(tuned_to(5), FixedDraws(1000))
    field.scanner(tuned_to(8), FixedDraws(1000))  # makes the inquirer look whether it may send at tick 8
    inquiry = field.inquire()
    field.kernel.at(8 * TICK + 10 * US, inquiry.cancel)
    field.kernel.run(S)
    assert field.sent("FHS") == [(7 * TICK, "FHS", 1, Heard.NOT_TUNED)]
    assert not field.found


def test_a_scanner_answers_half_a_cycle_ahead_what_it_hears_in_its_second_interlaced_window():
    x = (train_phase(44, "A") - 16) % 32
    field = InquiryField()
    field.scanner(clock_in_block(x), FixedDraws(1000), offset=1000, interval_s=0.64, interlaced=True)
    field.inquire(ticks=72)
    field.kernel.run(S)
    assert field.sent() == [
        (44 * TICK, "ID", INQUIRER, Heard.RECEIVED),
        (46 * TICK, "FHS", 1, Heard.RECEIVED),
    ]


def test_two_inquiries_at_once_find_the_same_scanner():
    field = InquiryField()
    field.scanner(tuned_to(4), FixedDraws(*[20] * 50))
    field.inquire(ticks=4096)
    found = []
    clock = NativeClock(40 * TICK + 1234)
    Inquiry(field.radio(9, clock), InquirySettings(), 4096, 99, field.scanners,
            lambda peer, estimate: found.append(peer), lambda peers: found.append(peers))  # fmt: skip
    field.kernel.run(2 * S)
    assert field.completed[1] == (1,)
    assert found == [1, (1,)]


def test_the_reported_estimate_is_the_scanners_clock_to_four_ticks():
    for case in range(30):
        rng = np.random.default_rng([3, case])
        field = InquiryField(random_clock(rng))
        clock = random_clock(rng)
        field.scanner(clock)
        field.inquire(ticks=16384)
        field.kernel.run(6 * S)
        time, estimate = field.found[1]
        assert estimate % 4 == 0
        assert 0 <= estimate < 1 << 28
        error = (field.clock.tick(time) + estimate - clock.tick(time) + (1 << 27)) % (1 << 28) - (1 << 27)
        assert abs(error) <= 4


def test_what_an_inquiry_would_have_reported_is_what_one_reports():
    for case in range(30):
        rng = np.random.default_rng([4, case])
        field = InquiryField(random_clock(rng))
        clock = random_clock(rng)
        field.scanner(clock)
        field.inquire(ticks=16384)
        field.kernel.run(6 * S)
        time, estimate = field.found[1]
        known = known_offset(field.clock, clock, time)
        assert known % 4 == 0
        assert 0 <= known < 1 << 28
        assert (known - estimate) % (1 << 28) in (0, 4, (1 << 28) - 4)  # bits 27-2 of each clock, at other instants


@pytest.mark.parametrize("ticks", [0, -4, 30])
def test_a_duration_that_is_no_number_of_slot_pairs_is_refused(ticks):
    with pytest.raises(LocalProtocolError, match="duration_ticks"):
        InquiryField().inquire(ticks=ticks)


def test_settings_know_the_versions():
    assert InquiryScanSettings(version=1.2).version == "1.2"
    with pytest.raises(ValueError, match="interlaced"):
        InquiryScanSettings(version="1.1", interlaced=True)
    with pytest.raises(ValueError, match="version"):
        InquiryScanSettings(version="1.3")


def discovery_times(scanners, ppm, count, seed, **settings):
    """Seconds from the first ID to the end of the FHS, for *count* devices, *scanners* at a time; inf if not found."""
    times = []
    for case in range(-(-count // scanners)):
        rng = np.random.default_rng([seed, case])
        field = InquiryField(random_clock(rng, ppm))
        for address in range(1, scanners + 1):
            scanner = field.scanner(
                random_clock(rng, ppm), Draws(seed, case, address), int(rng.integers(4096)), interval_s=1.28, **settings
            )
            assert scanner.address == address
        inquiry = field.inquire(16384, scanners, first_train="AB"[rng.integers(2)])
        field.kernel.run(6 * S)
        begin = field.clock.time_of(inquiry.ids.first)
        times += [
            (field.found[address][0] - begin) / S if address in field.found else np.inf
            for address in range(1, scanners + 1)
        ]
    return np.array(times[:count])


PUBLISHED = [
    (settings, within_s, share, scanners, ppm)
    for settings, within_s, share in (
        ({"version": "1.1"}, 5.12, 0.985),
        ({"version": "1.2"}, 3.84, 0.99),
        ({"version": "1.2", "interlaced": True}, 1.28, 0.99),
    )
    for scanners, ppm in ((1, 0), (1, 20), (7, 250))
]
CAMPAIGNS = [
    pytest.param(*case, 4_000, marks=pytest.mark.slow) for case in PUBLISHED[::4]
]  # each procedure, each crowd
if soak_count(100) == 100:  # a part of the long campaign would be the short one again
    CAMPAIGNS += [pytest.param(*case, 20_000, marks=pytest.mark.soak) for case in PUBLISHED]


@pytest.mark.parametrize(("settings", "within_s", "share", "scanners", "ppm", "count"), CAMPAIGNS)
def test_devices_are_found_as_soon_as_published(settings, within_s, share, scanners, ppm, count):
    """Peterson, Baldwin, Kharoufeh, IEEE TMC 5(9), 2006; independent models give 98.9, 99.96 and 99.9 %."""
    times = discovery_times(scanners, ppm, count, 11, **settings)
    print(f"{settings} {scanners} scanners, {ppm} ppm: {np.mean(times <= within_s):.4f} within {within_s} s")
    assert np.mean(times <= within_s) >= share
