"""Whom senders reach: rows as the matrix of gains has them, by cells or without, and what may be neglected."""

import gc
import math
import weakref
from functools import partial
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from cosim.channels.adhoc.channel import AdhocChannel
from cosim.channels.adhoc.reach import FAINT_MW, Reach
from cosim.channels.adhoc.settings import AdhocSettings
from cosim.channels.adhoc.state import REACHED, new_records
from cosim.channels.propagation import Barrier, Propagation, PropagationSettings
from cosim.elementary import exp10
from cosim.geometry.segments import segment_grid
from cosim.kernel import WORLD, Kernel
from cosim.machine import BROADCAST, Outgoing
from cosim.randomness import Draws, Streams
from cosim.trace import Trace
from cosim.units import MS

WALLS = [(20, -10, 20, 60), (-10, 35, 90, 30), (50, 50, 70, 70)]
BARRIERS = (Barrier(40, 0, 45, 80, 3.3), Barrier(0, 60, 80, 60, 7.1))


def fading(**settings: Any) -> Propagation:
    law = PropagationSettings(model="log_distance", exponent=3.0, **settings)
    return Propagation(law, segment_grid(WALLS), [4.5, 10.0, 2.25], Draws(3, "shadowing"))


def row(reach: Reach, source: int, size: int) -> tuple[list[int], list[float]]:
    rows = new_records(size, REACHED)
    rows = rows[: reach.write(source, source, rows)[source]]
    return rows["address"].tolist(), rows["mw"].tolist()


def scattered(count: int, side_m: float) -> np.ndarray:
    return np.random.default_rng(count).uniform(-side_m / 3, side_m, (count, 2))


@pytest.mark.parametrize("settings", [{}, {"walls": False}, {"shadowing_db": 6.0, "shadowing_cell_m": 3.0}])
@pytest.mark.parametrize("faintest_mw", [FAINT_MW, 1e-8, 3e-7])
def test_a_row_is_that_of_the_matrix_of_gains_where_it_is_above_the_faintest(settings, faintest_mw):
    propagation, positions = fading(**settings), scattered(60, 100.0)
    sent_mw = np.random.default_rng(1).uniform(1, 90, 60)
    reach = Reach(60, sent_mw, faintest_mw, propagation)
    reach.moved(positions)
    reach.power(7, False)
    for barriers in ((), BARRIERS):
        propagation.set_barriers(barriers)
        reach.changed()
        gains_db = propagation.gains_db(positions)
        for source in range(60):
            powers = [sent_mw[source] * exp10(gain / 10.0) for gain in gains_db[source].tolist()]
            expected = [other for other in range(60) if powers[other] > faintest_mw and 7 not in (source, other)]
            assert row(reach, source, 60) == (expected, [powers[other] for other in expected])


@pytest.mark.parametrize("count", [1, 2, 300])
@pytest.mark.parametrize("faintest_mw", [1e-8, 1e-7, 1e-5])
def test_cells_leave_out_nobody_who_is_reached(count, faintest_mw, monkeypatch):
    positions = scattered(count, 300.0)
    positions[: count // 2] = positions[: count // 2].round(-1)  # on the sides of cells, and in one place
    strength = np.random.default_rng(2).uniform(1, 90, count)

    def rows(law: Propagation | None, strength: np.ndarray) -> list[Any]:
        reach = Reach(count, strength, faintest_mw, law)
        reach.moved(positions)
        return [row(reach, source, count) for source in range(count)]

    laws = (fading(), strength), (fading(shadowing_db=1.0), strength), (None, strength)
    by_cells = [rows(*law) for law in laws]
    monkeypatch.setattr("cosim.channels.adhoc.reach.CELLS", 1e-9)  # one cell: everybody is asked
    assert by_cells == [rows(*law) for law in laws]
    assert count < 300 or 0 < sum(len(addresses) for addresses, _ in by_cells[0]) < 0.9 * count * (count - 1)


@pytest.mark.parametrize("law", [None, fading()])
def test_rows_that_are_written_together_are_those_of_each_alone(law):
    count = 20
    reach = Reach(count, np.linspace(20.0, 60.0, count), 1e-8, law)
    reach.moved(scattered(count, 60.0))
    reach.power(3, False)
    rows = new_records(count * count, REACHED)
    ends = reach.write(2, count - 1, rows)[2:].tolist()
    for source, begin, end in zip(range(2, count), [0, *ends], ends, strict=False):
        assert (rows["address"][begin:end].tolist(), rows["mw"][begin:end].tolist()) == row(reach, source, count)


def test_what_stations_do_does_not_depend_on_whether_they_are_few(monkeypatch):
    def received() -> list[Any]:
        settings = AdhocSettings.model_validate({"propagation": {"model": "log_distance", "exponent": 3.0}})
        kernel = Kernel()
        channel, told = AdhocChannel(settings, kernel, Trace(()), 12, Streams(1)), []
        monkeypatch.setattr(channel, "received", lambda *heard: told.append((kernel.now, heard[0], heard[1], heard[3])))
        for tick in range(30):  # frames are under way when robots move
            kernel.at(tick * MS, lambda: channel.moved(scattered(12, 200.0) + kernel.now / MS), WORLD)
            kernel.at(tick * MS, partial(channel.send, tick % 12, Outgoing(BROADCAST, bytes(200))))
        kernel.run(60 * MS)
        return told

    few = received()
    monkeypatch.setattr("cosim.channels.adhoc.reach.FEW", 0)
    monkeypatch.setattr("cosim.channels.adhoc.stations.FEW", 0)
    assert few == received()
    assert len({len(heard) for _, heard, _, _ in few}) > 2


def test_who_is_just_within_reach_is_found_at_the_edge_of_the_next_cell():
    reach = Reach(40, np.full(40, 40.0), FAINT_MW, None)  # cells are 10 m wide
    places = np.array([(40.0 * (robot % 2), 10.0 * (robot // 2 % 5)) for robot in range(40)])
    reach.moved(places)
    for source in range(40):
        apart = np.hypot(*(places - places[source]).T)
        assert row(reach, source, 40)[0] == [other for other in range(40) if apart[other] <= 40.0 and other != source]


def test_where_radios_were_is_forgotten():
    reach = Reach(60, np.full(60, 40.0), FAINT_MW, fading())
    reach.moved(scattered(60, 100.0))
    row(reach, 0, 60)
    assert reach._places is not None
    before = weakref.ref(reach._places.member_m)
    reach.moved(scattered(60, 90.0))
    row(reach, 0, 60)
    gc.collect()
    assert before() is None


def test_nobody_holds_what_a_channel_has_known_when_it_is_gone():
    kernel = Kernel()
    channel = AdhocChannel(AdhocSettings(range_m=50.0), kernel, Trace(()), 2, Streams(1))
    channel.moved(np.array([(0.0, 0.0), (60.0, 0.0)]))
    channel.send(0, Outgoing(BROADCAST, b"x"))
    kernel.run(100 * MS)
    assert channel.summary()["frames_sent"] == 1.0
    network = channel._stations._network
    held = [weakref.ref(array) for array in network]
    del channel, kernel, network
    gc.collect()
    assert [array() for array in held] == [None] * len(held)


def test_a_disc_ends_at_the_range_of_the_sender():
    reach = Reach(3, np.array([5.0, 4.9, math.inf]), FAINT_MW, None)
    reach.moved(np.array([(0.0, 0.0), (3.0, 4.0), (900.0, 0.0)]))
    assert [row(reach, source, 3) for source in range(3)] == [([1], [1.0]), ([], []), ([0, 1], [1.0, 1.0])]


def level(neglect_db: float | None, places: list[tuple[float, float]]) -> float:
    """Return the ratio of signal to all else of a frame of robot 0 at robot 1 while all but these two send as well."""
    propagation = {"model": "log_distance", "exponent": 3.0}
    settings = AdhocSettings.model_validate({"propagation": propagation, "neglect_db": neglect_db})
    kernel = Kernel()
    channel = AdhocChannel(settings, kernel, Trace(()), len(places), Streams(1))
    channel.moved(np.array(places))
    for source in (0, *range(2, len(places))):
        channel.send(source, Outgoing(BROADCAST, bytes(1000)))
    kernel.run(2 * MS)
    ratio: float = channel._stations._network.stations[1]["level"]
    return ratio


@pytest.mark.parametrize("neglect_db", [10.0, 20.0])
@pytest.mark.parametrize("others", [1, 3, 8])
def test_what_is_neglected_improves_a_ratio_by_less_than_the_bound(neglect_db, others):
    noise_dbm = -174.0 + 10 * math.log10(22e6) + AdhocSettings().noise_figure_db
    apart_m = 10 ** ((15.0 - 40.2 - noise_dbm + neglect_db + 0.05) / 30.0)  # 0.05 dB below what is kept
    turns = [2 * math.pi * number / others for number in range(others)]
    places = [(5.0, 0.0), (0.0, 0.0), *((apart_m * math.cos(turn), apart_m * math.sin(turn)) for turn in turns)]
    better_db = 10 * math.log10(level(neglect_db, places) / level(None, places))
    bound_db = 10 * math.log10(1 + others * 10 ** (-neglect_db / 10))
    assert 0.9 * bound_db < better_db < bound_db


def test_what_is_neglected_must_fade_and_be_too_weak_to_receive():
    with pytest.raises(ValidationError, match="there is no propagation"):
        AdhocSettings.model_validate({"neglect_db": 10.0})
    with pytest.raises(ValidationError, match="above detection_dbm"):
        AdhocSettings.model_validate({"neglect_db": 1.0, "propagation": {}, "detection_dbm": -110.0})
