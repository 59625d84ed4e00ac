"""piconet_interference: frames counted one by one against brute force, and the closed forms against both."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from cosim.channels.bluetooth.hopping import basic_channel
from cosim.experiment import load_experiment
from cosim.randomness import Streams
from cosim.report.sweep_report import report
from cosim.sweep import run_sweep
from cosim.units import SLOT, TICK, US
from experiments.piconet_interference import figures, links
from experiments.piconet_interference.survival import Parameters, closed_form, measure, survival, without_repeats
from tests.checkout import EXPERIMENTS

SWEEP = EXPERIMENTS / "piconet_interference" / "sweep.yaml"
AIR = {"one_slot": 366 * US, "full_slot": SLOT, "synchronised": 366 * US}
SECTIONS = ((0, 72 * US), (72 * US, 126 * US), (126 * US, None))
CLOCK = (1 << 28) * TICK

Array = np.ndarray[Any, np.dtype[Any]]


def frames(words: Array, phases: Array, count: int) -> tuple[Array, Array]:
    """Starts (ns) and channels, shape (piconets, count), of all slots from the first transmit slot after 0 on."""
    begun = -(-phases // TICK)  # the first tick that begins at or after time 0
    ticks = ((begun // 4 + 1) * 4)[:, None] + 2 * np.arange(count)
    channels = np.array([basic_channel(int(word), row) for word, row in zip(words, ticks, strict=True)])
    return ticks * TICK - phases[:, None], channels


def brute_force(words: Array, phases: Array, air: int, slots: int, neighbours: bool) -> int:
    """Count the frames of the slots in the middle of which no section is destroyed, comparing each with all others."""
    starts, channels = frames(words, phases, slots + 6)
    count = 0
    for p in range(len(words)):
        others = np.arange(len(words)) != p
        for n in range(3, slots + 3):
            near = np.abs(starts[others] - starts[p, n]) < 4 * SLOT
            other_starts, other_channels = starts[others][near], channels[others][near]
            apart = np.abs(other_channels - channels[p, n])
            tenths = np.select([apart == 0, apart == 1, apart == 2], [0.0, -1.1, -4.1], -5.1)
            weights = 10.0**tenths if neighbours else (apart == 0).astype(float)
            survives = True
            for begin, end in SECTIONS:
                since, until = starts[p, n] + begin, starts[p, n] + (air if end is None else end)
                overlaps = (other_starts < until) & (other_starts + air > since)
                survives &= math.fsum(weights[overlaps]) <= 10.0**-1.1 + 1e-15
            count += survives
    return count


def drawn(given: Parameters, seed: int) -> tuple[Array, Array]:
    """The addresses and clocks that a run draws."""
    stream = Streams(seed)("piconets")
    words = stream.integers(1 << 32, size=given.piconets)
    phases = stream.integers(CLOCK, size=given.piconets)
    return words, phases - phases % SLOT if given.traffic == "synchronised" else phases


@pytest.mark.slow
@pytest.mark.parametrize("interference", ["co_channel", "neighbouring"])
@pytest.mark.parametrize("traffic", ["one_slot", "full_slot", "synchronised"])
@pytest.mark.parametrize("piconets", [2, 3, 12])
def test_the_frames_that_survive_are_those_that_brute_force_finds(traffic: Any, interference: Any, piconets: int):
    given = Parameters(piconets=piconets, traffic=traffic, interference=interference, slots=60)
    for seed in (1, 2):
        words, phases = drawn(given, seed)
        expected = brute_force(words, phases, AIR[traffic], given.slots, interference == "neighbouring")
        assert round(survival(given, Streams(seed)) * piconets * given.slots, 6) == expected
        assert piconets < 12 or 0 < expected < piconets * given.slots


@pytest.mark.slow
@pytest.mark.parametrize("piconets", [2, 10])
@pytest.mark.parametrize("traffic", ["one_slot", "full_slot", "synchronised"])
def test_the_closed_forms_are_the_mean_over_frames_on_random_channels(traffic: Any, piconets: int):
    """No hop kernel: independent channels at random offsets, frame by frame."""
    rng = np.random.default_rng(8)
    cases, air = 400_000, AIR[traffic]
    offsets = rng.integers(SLOT, size=(cases, piconets - 1)) if traffic != "synchronised" else 0
    victim = rng.integers(79, size=(cases, 1))
    survives = np.ones(cases, dtype=bool)
    for slot in (-1, 0, 1):
        starts = np.broadcast_to(offsets + slot * SLOT, (cases, piconets - 1))
        hits = (starts < air) & (starts + air > 0) & (rng.integers(79, size=starts.shape) == victim)
        survives &= ~hits.any(axis=1)
    expected = closed_form(piconets, traffic, "co_channel")
    assert survives.mean() == pytest.approx(expected, abs=4 * math.sqrt(expected * (1 - expected) / cases))


def test_hops_of_successive_slots_are_never_equal():
    """The reason why a piconet's two frames are not independent; from one block of 64 slots to the next they may be."""
    rng = np.random.default_rng(1)
    equal = {"within": 0, "across": 0}
    for word in rng.integers(1 << 32, size=400):
        ticks = 128 * int(rng.integers(1 << 20)) + 2 * np.arange(640)
        channels = basic_channel(int(word), ticks)
        same = channels[1:] == channels[:-1]
        across = ticks[1:] % 128 == 0
        equal["within"] += int(same[~across].sum())
        equal["across"] += int(same[across].sum())
    assert equal["within"] == 0
    assert equal["across"] > 10  # of 3600, one in 79


def test_closed_forms_at_some_numbers_of_piconets():
    assert closed_form(2, "full_slot", "co_channel") == pytest.approx(1 - 0.0252, abs=5e-5)  # El-Hoiydi's bound
    assert closed_form(20, "full_slot", "co_channel") == pytest.approx(1 - 0.3837, abs=5e-5)
    assert closed_form(10, "synchronised", "co_channel") == pytest.approx(1 - 0.1083, abs=5e-5)
    assert closed_form(2, "one_slot", "co_channel") == pytest.approx(78 / 79 * (1 - 0.1712 / 79))
    assert [closed_form(1, traffic, "co_channel") for traffic in ("one_slot", "full_slot", "synchronised")] == [1, 1, 1]
    assert math.isnan(closed_form(2, "one_slot", "neighbouring"))
    assert math.isnan(closed_form(2, "links", "co_channel"))
    assert without_repeats(40, "full_slot", "co_channel") == pytest.approx((77 / 79) ** 39)
    assert without_repeats(2, "one_slot", "co_channel") == pytest.approx(1 - 1.1712 / 79)


@pytest.mark.slow
def test_survival_is_that_of_hops_without_repeats_on_average():
    """Three intervals of 99.9 %, between draws of all addresses."""
    for traffic, piconets in (("one_slot", 5), ("full_slot", 30), ("synchronised", 15)):
        shares = np.array(
            [
                survival(Parameters(piconets=piconets, traffic=traffic, slots=200), Streams(seed))  # type: ignore[arg-type]
                for seed in range(100, 160)
            ]
        )
        error = shares.std(ddof=1) / math.sqrt(len(shares))
        expected = without_repeats(piconets, traffic, "co_channel")  # type: ignore[arg-type]
        assert shares.mean() == pytest.approx(expected, abs=3.5 * error)
        assert error < 0.005


@pytest.mark.slow
def test_one_real_link_loses_nothing_and_is_fully_loaded():
    assert links.survival(1, "co_channel", 40, 1) == {"survival": 1.0, "load": 1.0}


@pytest.mark.slow
def test_real_links_send_less_where_much_is_lost():
    found = links.survival(25, "co_channel", 60, 3)
    assert closed_form(25, "one_slot", "co_channel") < found["survival"] < 0.9
    assert 0.75 < found["load"] < 0.97
    assert measure({"piconets": 2, "traffic": "links", "link_slots": 20}, 1)["load"] > 0.7


@pytest.mark.slow
def test_some_arms_of_piconet_interference_are_reported(tmp_path: Path):
    experiment = load_experiment(SWEEP, ["slots=40", "traffic=one_slot"], quick=True, replicates=3)
    assert run_sweep(experiment, tmp_path, jobs=1).failures == ()
    made = report(tmp_path)
    found = {verdict.id: verdict for verdict in made.verdicts}
    assert found["full_slot"].verdict == found["links"].verdict == "no data"
    assert found["neighbouring"].ours.startswith("N=2 ")
    assert {path.name for path in made.figures} == {"survival.png", "survival_of_frames.png"}


def runs(means: dict[int, float], spread: float) -> pd.DataFrame:
    """Ten runs for each number of piconets, around these means."""
    rows = [
        {"traffic": "one_slot", "interference": "co_channel", "piconets": n, "survival": mean + sign * spread}
        | {"closed_form": 0.9, "without_repeats": 0.8, "load": 1.0}
        for n, mean in means.items()
        for sign in (-1, 1) * 5
    ]
    return pd.DataFrame(rows)


@pytest.mark.parametrize(
    ("means", "holds", "outside"),
    [
        # half of an interval: t(0.975, 9) = 2.262 times 0.01 sqrt(10 / 9) / sqrt(10) is 0.00754; of two at once 0.00895
        ({2: 0.907, 3: 0.894}, True, "none"),
        ({2: 0.908, 3: 0.894}, True, "N=2"),
        ({2: 0.910, 3: 0.891}, False, "N=2, N=3"),
    ],
)
def test_a_closed_form_holds_if_all_intervals_meet_it_at_once(means: dict[int, float], holds: bool, outside: str):
    told, verdict = figures.one_slot(runs(means, 0.01), pd.DataFrame())
    assert verdict is holds
    assert told.endswith(f"outside of single 95 % intervals: {outside}")
    assert figures.one_slot_exact(runs(means, 0.01), pd.DataFrame())[1] is False
    assert figures.one_slot(runs(means, 0.01).drop_duplicates("piconets"), pd.DataFrame())[1] is None


@pytest.mark.parametrize("rows", [pd.DataFrame(), pd.DataFrame({"traffic": ["links"], "piconets": [2]})])
def test_figures_without_data_answer_that_there_is_none(rows: pd.DataFrame):
    names = ("one_slot", "full_slot", "synchronised", "one_slot_exact", "full_slot_exact")
    names += ("spread_of_pairs", "neighbouring", "real_links")
    assert {getattr(figures, name)(rows, rows) for name in names} == {("-", None)}
    assert figures.draw(rows, rows, Path()) == []
