"""How often the intervals cover what is true: sweeps whose truth is known, drawn many times.

The soak prints a table (-rP). The bounds of the ordinary run are those of the full one less three standard deviations
of so few sweeps.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy import stats

from cosim.arrays import Floats
from cosim.randomness import Streams
from cosim.statistics.equivalence import place
from cosim.statistics.intervals import Estimate, bootstrapped, cautious, estimate, paired, share
from cosim.statistics.stopping import FIRST, decide, looks
from tests.tiers import soak_count

SEEDS = 20
FEW, MANY = 60, 1000
CHANCE = 0.7

KINDS: dict[str, Callable[[Any, int], Floats]] = {
    "normal": lambda rng, size: rng.normal(1.0, 0.5, size),
    "exponential": lambda rng, size: rng.exponential(1.0, size),
    "0/1": lambda rng, size: (rng.random(size) < CHANCE).astype(float),
}
TRUE = {"normal": 1.0, "exponential": 1.0, "0/1": CHANCE}


def covers(found: Estimate, true: float) -> bool:
    return found.low - 1e-12 <= true <= found.high + 1e-12


def difference(kind: str, rng: Any) -> bool:
    """Two arms that share half of what is random: the second has 1.5 times as much, or twice the ones of chance."""
    if kind == "0/1":
        draws = rng.random(SEEDS)
        one, other, true = draws < 0.3, (draws + rng.random(SEEDS)) < 1.0, 0.5 - 0.3
    else:
        common = KINDS[kind](rng, SEEDS)
        one, other = common + KINDS[kind](rng, SEEDS), 2.0 * common + KINDS[kind](rng, SEEDS)
        true = TRUE[kind]
    return covers(paired(one, other).mean, true)


def clustered(kind: str, rng: Any) -> bool:
    """Ten values a seed, which take their chance (0/1) or their mean from the seed: a mean or share of 200 values."""
    seeds = np.repeat(np.arange(SEEDS), 10)
    if kind == "0/1":
        values = (rng.random(10 * SEEDS) < np.repeat(rng.beta(2.1, 0.9, SEEDS), 10)).astype(float)
        return covers(share(values, seeds), 0.7)
    return covers(estimate(np.repeat(KINDS[kind](rng, SEEDS), 10) + rng.normal(size=10 * SEEDS), seeds), TRUE[kind])


INTERVALS: dict[str, Callable[[str, Any], bool]] = {
    "mean": lambda kind, rng: covers(estimate(KINDS[kind](rng, SEEDS)), TRUE[kind]),
    "paired difference": difference,
    "ten values a seed": clustered,
    "mean, cautious": lambda kind, rng: covers(cautious(KINDS[kind](rng, SEEDS)), TRUE[kind]),
    "BCa bootstrap": lambda kind, rng: covers(bootstrapped(KINDS[kind](rng, SEEDS)), TRUE[kind]),
}
SHARES: dict[str, Callable[[Any], bool]] = {
    f"share of {chance:g}": lambda rng, chance=chance: covers(share(rng.random(SEEDS) < chance), chance)
    for chance in (0.05, 0.5, 0.7, 0.95)
}


def coverage(trials: int) -> dict[tuple[str, str], float]:
    found = {}
    for name, drawn in INTERVALS.items():
        for kind in KINDS:
            rng = Streams(1)("coverage", name, kind)
            found[name, kind] = sum(drawn(kind, rng) for _ in range(trials)) / trials
    for name, alone in SHARES.items():
        rng = Streams(1)("coverage", name)
        found[name, "0/1"] = sum(alone(rng) for _ in range(trials)) / trials
    return found


def least(trials: int) -> float:
    """0.9, less three standard deviations if there are fewer sweeps than a thousand."""
    return 0.9 - (3 * math.sqrt(0.9 * 0.1 / trials) if trials < MANY else 0.0)


def printed(found: dict[tuple[str, str], float], trials: int) -> None:
    print(f"coverage of 95 % intervals, {trials} sweeps of {SEEDS} seeds")
    for (name, kind), value in found.items():
        print(f"  {name:20s} {kind:12s} {100 * value:5.1f} %")


def test_intervals_cover_what_is_true_in_a_few_sweeps(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("cosim.statistics.intervals.RESAMPLES", 999)
    found = coverage(FEW)
    assert len(found) == 19
    assert min(found.values()) >= least(FEW), found


@pytest.mark.soak
def test_intervals_cover_what_is_true():
    trials = max(soak_count(MANY), 20)
    found = coverage(trials)
    printed(found, trials)
    assert min(found.values()) >= least(trials), found


# ---------------------------------------------------------------- stopping

RULES: dict[str, tuple[Callable[[Any, int], Floats], float, float, int, float]] = {
    "normal, cv 0.2": (lambda rng, size: rng.normal(1.0, 0.2, size), 1.0, 0.15, 100, 94.7),
    "normal, cv 0.2, close": (lambda rng, size: rng.normal(1.0, 0.2, size), 1.0, 0.05, 300, 94.9),
    "exponential": (lambda rng, size: rng.exponential(1.0, size), 1.0, 0.5, 300, 91.6),
    "exponential, close": (lambda rng, size: rng.exponential(1.0, size), 1.0, 0.2, 600, 93.8),
    "lognormal": (lambda rng, size: rng.lognormal(0.0, 1.0, size), math.exp(0.5), 0.2, 1500, 90.7),
}
"""How values are drawn, their mean, g, the most replicates, and the coverage in % that was measured once.

That was with 10 or 20 replicates before the first look (the lower of the two, of 2,500 to 6,000 trials each), a look
at every replicate, and not by this program.
"""


def stopped(draw: Callable[[Any, int], Floats], true: float, error: float, most: int, rng: Any) -> tuple[bool, int]:
    values = draw(rng, most)
    known: dict[str, dict[int, float]] = {"a": dict(enumerate(values.tolist()))}
    count = decide(known, {"a": error}, most).replicates
    return covers(estimate(values[:count]), true), count


def stopped_at_once(draw: Callable[[Any, int], Floats], true: float, error: float, most: int, rng: Any) -> bool:
    """Look after every replicate from the tenth on, by the formula as it stands in textbooks."""
    values = draw(rng, most)
    counts = np.arange(10, most + 1)
    means = np.cumsum(values)[9:] / counts
    squares = np.cumsum(values**2)[9:] - counts * means**2
    halves = stats.t.ppf(0.975, counts - 1) * np.sqrt(squares / (counts - 1) / counts)
    precise = halves / means <= error / (1 + error)
    at = int(np.argmax(precise)) if precise.any() else -1
    return bool(abs(means[at] - true) <= halves[at])


def stopping(trials: int) -> dict[str, tuple[float, float, float]]:
    """Return coverage in %, mean number of replicates, and coverage with a look at every replicate, by rule."""
    found = {}
    for name, (draw, true, error, most, _) in RULES.items():
        rng = Streams(1)("stopping", name)
        made = [stopped(draw, true, error, most, rng) for _ in range(trials)]
        rng = Streams(1)("stopping", name)  # the same values
        other = [stopped_at_once(draw, true, error, most, rng) for _ in range(trials)]
        ours, theirs = (100 * sum(each) / trials for each in ([covered for covered, _ in made], other))
        found[name] = ours, sum(count for _, count in made) / trials, theirs
    return found


def test_the_stopping_rule_covers_in_a_few_sweeps():
    for name, (found, count, _) in stopping(FEW).items():
        assert found >= RULES[name][-1] - 1.0 - 300 * math.sqrt(0.95 * 0.05 / FEW), name
        assert FIRST <= count < RULES[name][3]


@pytest.mark.soak
def test_the_stopping_rule_covers_as_it_is_known_to():
    trials = soak_count(4000)
    print(f"coverage at the stop, {trials} sweeps")
    few = 0.0 if trials >= 4000 else 300 * math.sqrt(0.95 * 0.05 / trials)
    for name, (found, count, often) in stopping(trials).items():
        _, _, error, _, told = RULES[name]
        print(
            f"  {name:22s} g = {error:4g}  {found:5.1f} % at {count:5.1f} replicates; "
            f"{often:.1f} % with a look at each, measured once {told} %"
        )
        assert found >= often - 1.0 - few, name
        assert found >= told - 1.0 - few, name


def test_there_are_few_looks():
    assert len(list(looks(FIRST, 100_000))) < 60


# ---------------------------------------------------------------- equivalence


MARGINS = {"normal": 0.5, "exponential": 0.8, "0/1": 0.5}
"""Half widths of ranges that twenty seeds can show a mean to lie in."""


def false_equivalence(trials: int) -> dict[tuple[str, float], float]:
    """Return how often the mean is found in a range on whose bound it lies, by kind and mean over the published one."""
    found = {}
    for kind, margin in MARGINS.items():
        for ratio in (1 - margin, 1 + margin):
            rng = Streams(1)("equivalence", kind, str(ratio))
            published = TRUE[kind] / ratio
            wrong = 0
            for _ in range(trials):
                values = KINDS[kind](rng, SEEDS)
                made = share(values) if kind == "0/1" else cautious(values)
                wrong += place(made, (1 - margin) * published, (1 + margin) * published, SEEDS).within is True
            found[kind, ratio] = wrong / trials
    return found


def test_means_on_the_bound_are_seldom_taken_for_equivalent():
    assert max(false_equivalence(FEW).values()) <= 0.05 + 3 * math.sqrt(0.05 * 0.95 / FEW)


@pytest.mark.soak
def test_false_equivalence_is_rare():
    trials = soak_count(4 * MANY)
    found = false_equivalence(trials)
    print(f"within N % holds of a mean on the bound, {trials} sweeps of {SEEDS} seeds")
    for (kind, ratio), value in found.items():
        print(f"  {kind:12s} within {100 * MARGINS[kind]:g} %, the mean {ratio:.1f} of it: {100 * value:.1f} %")
    assert max(found.values()) > 0.01  # the intervals are narrow enough to hold
    assert max(found.values()) <= 0.05 + (3 * math.sqrt(0.05 * 0.95 / trials) if trials < MANY else 0.0)
