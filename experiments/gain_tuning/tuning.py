"""Gains by search "as opposed to informed trial and error" (paper 001, section 5.1), and what they are worth elsewhere.

A search is scipy's differential evolution (Storn and Price, J. Global Optimization 11, 1997), which like the genetic
algorithms that the paper names breeds a population. A candidate explores a few small offices, always the same ones;
what it costs is the time until 95 % have been seen and a fine for every tick in which a wall or a body holds a robot
up, since nothing but the schemas keeps it away. Then the best candidate, and the gains of the informed trial (the
defaults), explore other offices, which no search has seen.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
from pydantic import Field, model_validator
from scipy.optimize import Bounds, differential_evolution

from cosim.errors import UserError
from cosim.experiment import experiment_function
from cosim.randomness import Streams
from cosim.scenario import Scenario, changed
from cosim.settings import Count, Gain, Seconds, Settings, error_at
from cosim.simulation import simulate
from cosim.trace import Field as Column

SEARCH, EVALUATION = "search", "evaluation"
TRIAL, TUNED, CANDIDATE = "informed trial", "tuned", "candidate"
FIRST_OFFICE: Final = {SEARCH: 1_000, EVALUATION: 1_000_000}
"""First seeds of offices, by stage; they differ from search to search."""
MOST_OFFICES: Final = 100
GAINS: Final = ("frontier_m", "obstacle_m", "obstacle_gain", "robot_range_scale", "robot_gain_scale")
"""Settings of the schemas that are searched for. Of frontiers' and obstacles' gains only the quotient counts."""
COLUMNS: Final = (
    Column("stage", "str", "", "search, or evaluation on other offices"),
    Column("gains", "str", "", "whose gains: a candidate's, the tuned ones, or those of the informed trial"),
    Column("number", "int", "1", "of the candidate, or of the office"),
    *(Column(name, "float", "m" if name.endswith("_m") else "1", "as in the schemas' parameters") for name in GAINS),
    Column("cost_s", "float", "s", "what the search makes small, the mean over the offices"),
    Column("until_95_s", "float", "s", "until 95 % had been seen, the longest run if it never was; the mean"),
    Column("reached", "float", "1", "share of the offices in which it was"),
    Column("coverage", "float", "1", "share of the cells that can be seen that were; the mean"),
    Column("blocked_ticks", "float", "1", "ticks in which a wall or a body held a robot up; the mean"),
)
Row: TypeAlias = dict[str, Any]


class Range(Settings):
    """Between what a setting is searched for."""

    low: Gain = Field(description="least value")
    high: Gain = Field(description="greatest value")
    log: bool = Field(default=False, description="its logarithm is what is varied evenly")

    @model_validator(mode="after")
    def _ascends(self) -> "Range":
        if not self.low < self.high or (self.log and not self.low > 0):
            expected = f"is not < {self.high}, high, or not > 0 where logarithms are varied"
            raise error_at(("low",), self.low, expected)
        return self

    def value(self, share: float) -> float:
        """Return the value at a *share* of the way from the least to the greatest."""
        if self.log:
            return float(self.low * (self.high / self.low) ** share)
        return self.low + share * (self.high - self.low)

    def share(self, value: float) -> float:
        """Return where a value is on that way, within its ends."""
        low, high, at = (math.log(each) if self.log else each for each in (self.low, self.high, max(value, self.low)))
        return min((at - low) / (high - low), 1.0)


class Parameters(Settings):
    """A search, and what is asked of its result."""

    scenario: Scenario = Field(description="an exploration of a generated office; its seed and the gains are set")
    ranges: dict[str, Range] = Field(description="what is searched for, of the schemas' settings")
    training: int = Field(default=3, ge=1, le=MOST_OFFICES, description="offices that each candidate explores")
    evaluation: int = Field(default=10, ge=1, le=MOST_OFFICES, description="other offices that the result explores")
    evaluation_s: Seconds = Field(default=600.0, gt=0, description="s, the longest run there")
    popsize: Count = Field(default=5, ge=1, description="candidates of a generation, for each setting searched for")
    generations: Count = Field(default=7, ge=0, description="after the first one")
    contact_s: Seconds = Field(default=0.5, ge=0, description="s, the fine for a tick in which a robot is held up")
    constrained: bool = Field(
        default=False,
        description="gains that have robots held up in more ticks than the informed trial's do in the same offices "
        "cost more than any that do not, and the more the more ticks there are",
    )

    @model_validator(mode="after")
    def _searches_for_gains(self) -> "Parameters":
        if not self.ranges or not set(self.ranges) <= set(GAINS):
            raise error_at(("ranges",), [*self.ranges], f"are not some of {', '.join(GAINS)}")
        for end in (0.0, 1.0):
            try:
                self.with_gains({name: each.value(end) for name, each in self.ranges.items()}, 0)
            except UserError as error:
                raise ValueError(str(error)) from None
        return self

    def trial(self) -> dict[str, float]:
        """Return the gains that the scenario has: those of the informed trial."""
        schemas = getattr(self.scenario.protocol.parameters, "schemas", None)
        return {name: float(getattr(schemas, name)) for name in GAINS}

    def with_gains(self, gains: Mapping[str, float], office: int, longest_s: float | None = None) -> Scenario:
        """Return the scenario with these gains in the office of a seed; it may last as long as it says by itself."""
        settings = {f"protocol.parameters.schemas.{name}": value for name, value in gains.items()}
        longest = self.scenario.duration_s if longest_s is None else longest_s
        changes = settings | {"floorplan.office.seed": office, "duration_s": longest}
        return changed(self.scenario, changes, "gains", Path(__file__).parent)


@experiment_function
def measure(parameters: Mapping[str, Any], seed: int) -> list[Row]:
    """Search, and return ``COLUMNS``: a row a candidate in the order of the search, then a row an office and gains."""
    given = Parameters.model_validate(parameters)
    rows = search(given, seed)
    best = min(rows, key=lambda row: float(row["cost_s"]))
    for gains, of in ((TRIAL, given.trial()), (TUNED, {name: best[name] for name in GAINS})):
        for number, office in enumerate(offices(EVALUATION, seed, given.evaluation)):
            row = {"stage": EVALUATION, "gains": gains, "number": number}
            rows.append(row | of | explore(given, of, [office], seed, given.evaluation_s))
    return rows


def offices(stage: str, seed: int, count: int) -> list[int]:
    """Return the seeds of the offices of a stage of a search: no two searches, and no two stages, have any in common.

    Raise UserError for a seed of more than 9000: its training offices would be those of an evaluation.
    """
    first = FIRST_OFFICE[stage] + MOST_OFFICES * seed
    if stage == SEARCH and first + MOST_OFFICES > FIRST_OFFICE[EVALUATION]:
        raise UserError(f"seed: {seed}, at most 9000")
    return list(range(first, first + count))


def search(given: Parameters, seed: int) -> list[Row]:
    """Return what each candidate was, and what it cost; the gains of the informed trial are the first one."""
    rows: list[Row] = []
    training, trial = offices(SEARCH, seed, given.training), given.trial()

    def cost(shares: Any) -> float:
        named = zip(given.ranges.items(), shares, strict=True)
        gains = trial | {name: each.value(float(share)) for (name, each), share in named}
        found = explore(given, gains, training, seed, given.scenario.duration_s)
        if given.constrained and rows:
            found["cost_s"] = constrained(found, rows[0]["blocked_ticks"], given.scenario.duration_s)
        rows.append({"stage": SEARCH, "gains": CANDIDATE, "number": len(rows)} | gains | found)
        return found["cost_s"]

    differential_evolution(
        cost,
        Bounds(np.zeros(len(given.ranges)), np.ones(len(given.ranges))),
        x0=[each.share(trial[name]) for name, each in given.ranges.items()],
        popsize=given.popsize,
        maxiter=given.generations,
        rng=Streams(seed)("gains"),
        tol=0.0,
        polish=False,
        updating="deferred",
    )
    return rows


def constrained(found: Mapping[str, float], most_ticks: float, longest_s: float) -> float:
    """Return the cost of what was *found* if robots may be held up in *most_ticks* an office, the mean, and no more.

    Of two that break that, the one that does by less costs less (Deb, Computer Methods in Applied Mechanics and
    Engineering 186, 2000): more than any exploration of *longest_s*, which costs twice that at most.
    """
    excess = found["blocked_ticks"] - most_ticks
    return found["cost_s"] if excess <= 0.0 else 2.0 * longest_s + excess


def explore(
    given: Parameters, gains: Mapping[str, float], offices: list[int], seed: int, longest_s: float
) -> dict[str, float]:
    """Return the mean of what it costs to explore *offices* with these gains, and of what that is made of."""
    found = []
    for office in offices:
        metrics = simulate(given.with_gains(gains, office, longest_s), seed).metrics
        reached = not math.isnan(metrics["time_95_s"])
        until = metrics["time_95_s"] if reached else longest_s
        slow = until if reached else longest_s * (2.0 - metrics["coverage"])
        blocked = metrics["blocked_ticks"]
        found.append((slow + given.contact_s * blocked, until, reached, metrics["coverage"], blocked))
    names = ("cost_s", "until_95_s", "reached", "coverage", "blocked_ticks")
    return dict(zip(names, np.mean(found, axis=0).tolist(), strict=True))
