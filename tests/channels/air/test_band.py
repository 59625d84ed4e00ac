"""The laws of a band: what is told, forgotten and neglected, and who comes first."""

import numpy as np
import pytest

from cosim.channels.air.band import Band, Emission, Section
from cosim.channels.air.emissions import FAINT_MW, NOBODY, Tuning, Wanted
from cosim.channels.air.spectra import CLASSIC, DSSS, JAMMER, LE_1M, OFDM, OFFSETS
from cosim.errors import LocalProtocolError
from cosim.units import Time
from tests.channels.air.quiet import Quiet, band_of

EAR = Tuning(CLASSIC, 4804, 0)
HERE = Wanted(0, NOBODY)


def near(band: Band, gain_db: float = 0.0, now: Time = 0) -> Band:
    size = band.table.gains.shape[1]
    band.moved(np.full((size, size), gain_db), now)
    return band


def frame(
    start: Time, end: Time, sender: int = 1, tenant: int = 1, sent_mw: float = 1.0, centre: int = 4804
) -> Emission:
    return Emission(start, end, CLASSIC, centre, sender, tenant, sent_mw)


def test_nothing_is_one_section_of_nothing():
    assert near(band_of(2)).interference(EAR, 5, 9, HERE) == [Section(5, 9, 0.0)]


def test_sections_end_where_anything_begins_or_ends_and_what_touches_is_no_overlap():
    band = near(band_of(4))
    for emission in (frame(0, 10), frame(20, 30), frame(12, 15, 2, sent_mw=2.0), frame(14, 17, 3), frame(17, 18, 3)):
        band.tell(emission)
    assert band.interference(EAR, 10, 20, HERE) == [
        Section(10, 12, 0.0),
        Section(12, 14, 2.0),
        Section(14, 15, 3.0),
        Section(15, 18, 1.0),
        Section(18, 20, 0.0),
    ]
    assert [emission.start for emission in band.overlapped(EAR, 10, 20, HERE, 0.0)] == [12, 14, 17]


def test_the_order_of_telling_changes_no_bit_of_any_sum():
    random = np.random.default_rng(1)
    emissions = [
        Emission(int(start), int(start) + int(length), int(kind), 4804 + int(offset), int(sender), 1, float(power))
        for start, length, kind, offset, sender, power in zip(
            random.integers(0, 40, 30),
            random.integers(1, 40, 30),
            random.choice((DSSS, OFDM, CLASSIC, LE_1M, JAMMER), 30),
            random.integers(-20, 20, 30),
            random.integers(1, 5, 30),
            random.random(30),
            strict=True,
        )
    ]
    emissions += emissions[:3]  # twice the same, and the same but for the power
    emissions += [emission._replace(sent_mw=0.1) for emission in emissions[:3]]
    answers = set()
    for _ in range(200):
        band = near(band_of(5))
        for number in random.permutation(len(emissions)):
            band.tell(emissions[number])
        sections = tuple(band.interference(Tuning(LE_1M, 4804, 0), 0, 80, HERE))
        answers.add((sections, tuple(band.overlapped(EAR, 0, 80, HERE, 1e-3))))
    assert len(answers) == 1
    assert len(sections) > 20


def test_neither_the_wanted_sender_nor_the_own_radio_disturbs_but_those_of_other_channels_do():
    mine = frame(0, 10, 1, tenant=0), frame(0, 10, 0, tenant=0, sent_mw=100.0)
    mates = frame(0, 10, 0, tenant=1, sent_mw=100.0)  # the same robot's other radio, 20 dB weaker

    def level(wanted: Wanted, *emissions: Emission) -> float:
        band = near(band_of(3))
        for emission in emissions:
            band.tell(emission)
        (section,) = band.interference(EAR, 0, 10, wanted)
        return section.mw

    assert level(Wanted(0, 1), *mine) == 0
    assert level(Wanted(0, 2), *mine) == 1
    assert level(Wanted(1, 1), *mine) == pytest.approx(2, rel=1e-12)
    assert level(Wanted(0, 1), *mine, mates) == pytest.approx(1, rel=1e-12)


def test_what_is_on_the_air_keeps_the_gains_of_its_start():
    band = near(band_of(2))
    band.tell(frame(0, 100))
    near(band, -10.0, 50)
    band.tell(frame(50, 60))
    assert band.interference(EAR, 40, 70, HERE) == [Section(40, 50, 1.0), Section(50, 60, 1.1), Section(60, 70, 1.0)]


def test_gains_that_nothing_has_any_longer_are_replaced():
    quiet = Quiet()
    band = Band(2, 20.0)
    band.join(quiet)
    for number in range(100):
        near(band, -number, 10 * number)
        band.tell(frame(10 * number, 10 * number + 15, tenant=0))
        quiet.asks_from = 10 * number - 10
    assert len(band.table.gains) <= 4
    assert band.interference(Tuning(CLASSIC, 4804, 0), 990, 1000, Wanted(0, NOBODY))[0].mw > 0


def test_what_is_over_is_forgotten_but_what_can_be_asked_for_is_not():
    quiet = Quiet()
    band = Band(2, 20.0)
    band.join(quiet)
    band.join(Quiet(1 << 60))
    near(band)
    for start in range(0, 100_000, 10):
        band.tell(frame(start, start + 10))
        quiet.asks_from = max(0, start - 1_000)
    assert len(band.table.rows) <= 512
    sections = band.interference(EAR, quiet.asks_from, 100_000, HERE)
    assert sections == [Section(quiet.asks_from, 100_000, 1.0)]
    quiet.asks_from = 0
    band = near(band_of(2))
    for start in range(0, 10_000, 10):
        band.tell(frame(start, start + 9))
    assert sum(section.mw > 0 for section in band.interference(EAR, 0, 10_000, HERE)) == 1_000


def test_power_is_neglected_up_to_the_bound_and_counts_above_it():
    for over, counts in ((1 - 1e-9, False), (1.0, False), (1 + 1e-9, True)):
        band = near(band_of(2))
        band.tell(frame(0, 10, sent_mw=FAINT_MW * over))
        (section,) = band.interference(EAR, 0, 10, HERE)
        assert (section.mw > 0) == counts
        assert bool(band.overlapped(EAR, 0, 10, HERE, 0.0)) == counts


def test_only_shares_of_the_wished_size_overlap():
    for centre, met in ((4804, True), (4805, True), (4803, True), (4806, False), (4804 + OFFSETS, False)):
        band = near(band_of(2))
        band.tell(frame(0, 10, centre=centre))
        assert bool(band.overlapped(EAR, 0, 10, HERE, 0.5)) == met
        assert not band.overlapped(EAR, 0, 10, HERE, 0.51) or centre == 4804


@pytest.mark.parametrize(
    "emission",
    [
        frame(10, 10),
        frame(11, 10),
        frame(0, 10)._replace(kind=6),
        frame(0, 10)._replace(kind=-1),
        frame(0, 10, sender=2),
        frame(0, 10, sender=-1),
        frame(0, 10, tenant=2),
        frame(0, 10, tenant=-1),
    ],
)
def test_what_cannot_be_is_not_told(emission: Emission):
    with pytest.raises(LocalProtocolError, match="Emission"):
        near(band_of(2)).tell(emission)


def test_nobody_tells_what_starts_when_it_has_told_all():
    band = near(band_of(2))
    band.interference(EAR, 0, 10, HERE)
    for tenant in (0, 1):
        band.tell(frame(10, 20, tenant=tenant))
        with pytest.raises(LocalProtocolError, match="starts before 10"):
            band.tell(frame(9, 20, tenant=tenant))


class Asker(Quiet):
    """A channel that asks for a time when it catches up."""

    def __init__(self, band: Band, late: Time) -> None:
        super().__init__()
        self.number = band.join(self)
        self._band, self._late = band, late

    def catch_up(self, until: Time) -> None:
        self._band.interference(EAR, 0, until + self._late, Wanted(self.number, NOBODY))


@pytest.mark.parametrize("late", [0, 1])
def test_who_catches_up_asks_for_earlier_times_only(late: Time):
    band = Band(2, 20.0)
    Asker(band, late)
    with pytest.raises(LocalProtocolError, match="catches up to 10"):
        band.settle(10)


def test_after_a_failure_the_band_answers_again():
    band = Band(2, 20.0)
    asker = Asker(band, 0)
    with pytest.raises(LocalProtocolError):
        band.settle(10)
    assert band.interference(EAR, 0, 100, Wanted(asker.number, NOBODY)) == [Section(0, 100, 0.0)]


class Late(Quiet):
    """A channel that tells what it sends when it catches up only."""

    def __init__(self, band: Band) -> None:
        super().__init__()
        self.number = band.join(self)
        self._band = band

    def catch_up(self, until: Time) -> None:
        self._band.tell(frame(0, until, tenant=self.number))


def test_whatever_is_asked_others_have_told_before_and_the_asker_is_not_called():
    def late() -> tuple[Band, Wanted]:
        band = near(Band(2, 20.0), now=-1)
        asker, _ = Late(band), Late(band)
        return band, Wanted(asker.number, NOBODY)

    band, wanted = late()
    assert band.interference(EAR, 0, 10, wanted) == [Section(0, 10, 1.0)]
    band, wanted = late()
    assert band.overlapped(EAR, 0, 10, wanted, 1.0) == [frame(0, 10, tenant=1)]
    band, wanted = late()
    near(band, -10.0, 10)  # both have told what they sent before, with the gains that held then
    assert band.interference(EAR, 0, 10, wanted) == [Section(0, 10, 2.0)]


def test_who_is_alone_is_never_asked_to_catch_up():
    class Alone(Quiet):
        def catch_up(self, until: Time) -> None:
            raise AssertionError

    band = Band(2, 20.0)
    number = band.join(Alone())
    assert band.interference(EAR, 0, 100, Wanted(number, NOBODY)) == [Section(0, 100, 0.0)]
