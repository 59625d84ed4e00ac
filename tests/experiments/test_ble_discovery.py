"""ble_discovery: its exact solutions against printed values and by hand, its runs, and its claims on made-up ones."""

from math import gcd
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from cosim.units import MS, US, S
from experiments.ble_discovery import figures
from experiments.ble_discovery.discovery import COLUMNS, Parameters, observe
from experiments.ble_discovery.discovery import one_channel as one_channel_s
from experiments.ble_discovery.exact import Timing, delayed, geometric, one_channel, overlapping

PDU = {"air": 376 * US, "spacing": 600 * US}
"""The PDU of the reference's table."""
TABLE = [  # ms: T_a, T_s, W; with advDelay: mean; found by event 1, 2, 3; one channel without: mean, most
    ((100, 30, 30), 2.80, (0.9825, 1.0), (1.6293, 100.376)),
    ((30, 60, 30), 21.92, (0.4937, 0.9097, 0.9987), None),
    ((500, 100, 10), 4501, (0.0962, 0.1461, 0.1957), None),
    ((1000, 2560, 320), 4981, (0.1249, 0.2497, 0.3746), (4447.422875, 17000.376)),
    ((318.75, 1280, 11.25), 27151, (0.0085, 0.0170, 0.0255), (39171.01465234375, 80325.376)),
    ((100, 1000, 300), None, (), (280.6768, 800.376)),
]


def timing(times_ms: tuple[float, float, float]) -> Timing:
    return Timing(*(round(time * MS) for time in times_ms), **PDU)


@pytest.mark.slow
@pytest.mark.parametrize(("times_ms", "mean_ms", "found", "alone"), TABLE)
def test_exact_solutions_are_the_printed_ones(times_ms, mean_ms, found, alone) -> None:
    told = one_channel(timing(times_ms))
    if alone is None:
        assert told.met < 1
    else:
        mean, most = alone
        assert told.mean / MS == pytest.approx(mean, abs=5e-5 if mean < 2 else 1e-9 * mean)
        assert (told.greatest / MS, told.met) == (most, 1.0)
    if found:
        computed = delayed(timing(times_ms))
        assert computed.mean / MS == pytest.approx(mean_ms, rel=0.002)
        assert computed.found[: len(found)] == pytest.approx(found, abs=5.1e-5)


@pytest.mark.parametrize("times", [(30, 60, 30), (500, 100, 10), (7, 10, 4), (6, 10, 3), (9, 4, 2), (4, 4, 3)])
def test_one_channel_is_what_each_phase_by_itself_gives(times: tuple[int, int, int]) -> None:
    interval, cycle, window = times
    latencies = []
    for phase in np.arange(0.5, cycle):
        begins = [k for k in range(cycle // gcd(interval, cycle)) if (phase + k * interval) % cycle + 1 <= window]
        latencies += [1 + begins[0] * interval] if begins else []
    told = one_channel(Timing(interval, cycle, window, 1))
    assert told.met == pytest.approx(len(latencies) / cycle)
    assert (told.mean, told.greatest) == pytest.approx((np.mean(latencies), max(latencies)))


def test_independent_events_and_overlaps_are_closed_forms() -> None:
    assert geometric(timing((1000, 2560, 320))) / MS == pytest.approx(1005 * (2560 / 319.624 - 1), rel=1e-3)
    crowd = timing((100, 30, 30))
    assert [overlapping(crowd, size) for size in (10, 50, 100)] == pytest.approx([0.0626, 0.2969, 0.5091], abs=5e-5)
    assert overlapping(crowd, 1) == 0


# ---------------------------------------------------------------- runs


def observed(**given: float) -> pd.DataFrame:
    return pd.DataFrame(observe({"draws": 40, **given}, 3)).assign(set="30-60-30")


@pytest.mark.slow
def test_a_run_has_a_latency_of_each_procedure_a_draw() -> None:
    rows = observed(advertise_s=0.03, scan_s=0.06, window_s=0.03)
    assert (len(rows), set(rows)) == (40, {*(column.name for column in COLUMNS), "set"})
    assert rows["lost"].isna().all()
    of_set = figures.timing("30-60-30", True)
    assert rows["devices_s"].between(0.224e-3, 0.2).all()
    assert rows["devices_s"].mean() * S == pytest.approx(delayed(of_set).mean, rel=0.5)
    assert rows["three_channels_s"].mean() * S == pytest.approx(
        delayed(figures.timing("30-60-30", False)).mean, rel=0.5
    )
    assert set(rows["one_channel_s"].dropna().round(9)) == {0.000376, 0.030376}


@pytest.mark.slow
def test_runs_of_seeds_in_a_row_share_out_even_phases() -> None:
    given = Parameters(advertise_s=0.03, scan_s=0.06, window_s=0.02, draws=30)
    latencies = np.concatenate([list(one_channel_s(given, seed)) for seed in range(5, 25)])
    told = figures.one_channel(figures.timing("30-60-20", False))
    assert len(latencies) == 600
    assert 1 - np.isnan(latencies).mean() == pytest.approx(told.met, abs=4 / 600)
    assert np.nanmean(latencies) * S == pytest.approx(told.mean, rel=0.01)


@pytest.mark.slow
def test_a_crowd_loses_what_overlaps() -> None:
    rows = pd.DataFrame(observe({"crowd": 60, "draws": 240}, 2))
    assert rows["devices_s"].isna().all()
    assert set(rows["lost"]) == {0.0, 1.0}
    assert rows["lost"].mean() == pytest.approx(overlapping(figures.crowd_timing(60), 60), abs=0.12)
    assert figures.air_time(1) == 224 * US
    assert figures.air_time(10) == 232 * US


# ---------------------------------------------------------------- claims


def made(name: str, count: int = 10_000, **columns: object) -> pd.DataFrame:
    empty = dict.fromkeys((column.name for column in COLUMNS), np.nan)
    return pd.DataFrame({**empty, **columns, "set": name}, index=range(count))


def test_claims_about_one_channel_hold_and_fail() -> None:
    exact = np.array([376e-6, 0.030376])
    told = figures.one_channel(figures.timing("30-60-30", False))
    phases = np.full(10_000, np.nan)
    met = round(10_000 * told.met)
    phases[:met] = np.resize(exact, met)
    rows = made("30-60-30", one_channel_s=phases)
    assert figures.never_met(rows, rows) == ("1 of 1 sets, of which 1 lock", True)
    assert figures.exact_maxima(rows, rows) == ("1 of 1 sets", True)
    off = made("30-60-30", one_channel_s=np.where(np.isnan(phases), np.nan, phases * 1.01))
    assert figures.exact_means(rows, rows)[1] is True
    assert [claim(off, off)[1] for claim in (figures.exact_means, figures.exact_maxima)] == [False, False]
    whole = made("30-60-30", one_channel_s=np.resize(exact, 10_000))
    assert figures.never_met(whole, whole) == ("0 of 1 sets, of which 0 lock", False)
    few = rows.iloc[:100]
    assert figures.exact_means(few, few) == ("-", None)


def test_claims_of_the_table_hold_and_fail() -> None:
    stream = np.random.default_rng(1)
    found = stream.random(10_000) < 0.9825
    steps, later = stream.choice([0.376, 0.976, 1.576], 10_000), stream.uniform(100.3, 110.3, 10_000)
    right = made("100-30-30", three_channels_s=np.where(found, steps, later) / 1e3)
    claims = (figures.table_means, figures.table_quantiles, figures.table_events)
    assert [claim(right, right) for claim in claims] == [
        ("1 of 1 means", True),
        ("3 of 3 quantiles", True),
        ("2 of 2 shares", True),
    ]
    late = right.assign(three_channels_s=np.where(stream.random(10_000) < 0.96, steps, 120.0) / 1e3)
    assert [claim(late, late) for claim in claims] == [
        ("0 of 1 means", False),
        ("2 of 3 quantiles", False),
        ("1 of 2 shares", False),
    ]


def test_claims_about_devices_hold_and_fail() -> None:
    of_set = figures.timing("1000-2560-320", True)
    chance, mean = (of_set.window - of_set.air) / of_set.scan_interval, delayed(of_set).mean / S
    first = np.arange(10_000) < round(10_000 * chance)
    later = (mean - chance * 0.001) / (1 - chance)
    right = made("1000-2560-320", devices_s=np.where(first, 0.001, later))
    assert figures.devices(right, right)[1] is True
    assert figures.first_event(right, right) == ("1 of 1 sets", True)
    assert figures.always_found(right, right) == ("10000 of 10000 devices", True)
    assert figures.independent(right, right) == ("0 of 1 sets, 0.71 to 0.71 times", False)
    wrong = made("1000-2560-320", devices_s=np.where(first[::-1] & (np.arange(10_000) % 2 == 0), 0.001, 2 * later))
    assert [claim(wrong, wrong)[1] for claim in (figures.devices, figures.first_event)] == [False, False]
    wrong.loc[3, "devices_s"] = np.nan
    assert figures.always_found(wrong, wrong) == ("9999 of 10000 devices", False)
    alike = made("1000-2560-320", devices_s=geometric(of_set) / S)
    assert figures.independent(alike, alike)[1] is True


def test_what_crowds_lose_is_compared_with_the_closed_form() -> None:
    expected = overlapping(figures.crowd_timing(50), 50)
    right = made("crowd of 50", lost=(np.arange(10_000) < 10_000 * expected).astype(float))
    assert figures.overlaps(right, right) == (f"50: {expected:.4f} ({expected:.4f})", True)
    wrong = made("crowd of 50", lost=(np.arange(10_000) < 13_000 * expected).astype(float))
    assert figures.overlaps(wrong, wrong)[1] is False


def test_without_rows_nothing_is_claimed_and_nothing_drawn(tmp_path: Path) -> None:
    nothing = pd.DataFrame()
    names = ("exact_means", "exact_maxima", "never_met", "table_means", "table_quantiles", "table_events")
    for name in (*names, "devices", "first_event", "always_found", "independent", "overlaps"):
        assert getattr(figures, name)(nothing, nothing) == ("-", None)
    assert figures.draw(nothing, nothing, tmp_path) == []
