"""Every sheet can be run: arms in which each value of each axis occurs are set up as a sweep does it, and begin."""

import math
from pathlib import Path

import pytest

from cosim.documents import read_yaml
from cosim.experiment import Arm, Experiment, is_experiment, load_experiment, named
from cosim.kernel import Kernel
from cosim.sweep import Execution
from cosim.units import Time
from tests.checkout import EXPERIMENTS, FLOORS
from tests.tiers import two_tiers

SHEETS = [
    path for path in sorted(EXPERIMENTS.glob("**/*.yaml")) if path.parent != FLOORS and is_experiment(read_yaml(path))
]
FEATURES = EXPERIMENTS / "exploration_localization/features/sweep.yaml"
CHOICES = EXPERIMENTS / "reflection_tables/alternatives.yaml"
FEW = [
    EXPERIMENTS / "reflection_roles/alternatives.yaml",
    FEATURES,
    EXPERIMENTS / "aggregation_laboratory/sweep.yaml",
    EXPERIMENTS / "pseudonet_coverage/sweep.yaml",
    EXPERIMENTS / "deployment_wean/sweep.yaml",
    EXPERIMENTS / "packet_throughput/sweep.yaml",
]
"""Sheets that CI tries: one of each paper, and one of a radio alone."""
OTHERS = [path for path in SHEETS if path not in FEW]


class Begun(BaseException):
    """The first instant of a run is over: no Exception, of which a sweep would make the run's error."""


@pytest.fixture(autouse=True)
def first_instant(monkeypatch: pytest.MonkeyPatch) -> None:
    """End every run after its first instant."""
    run = Kernel.run

    def first(kernel: Kernel, until: Time) -> None:
        run(kernel, kernel.now + 1)
        raise Begun

    monkeypatch.setattr(Kernel, "run", first)


def values(arm: Arm) -> set[tuple[str, object]]:
    """Return the values of the axes of *arm*, and what is run, as if that were one: there may be no axes."""
    return {("run", arm.run), *arm.labels.items()}


def faults(experiment: Experiment) -> list[str]:
    """Begin few arms, in which each value of each axis occurs, and return a sentence for what went wrong with each.

    A run without a kernel is made whole. An arm that answers nothing, as its choice does not concern it, does not
    stand for its values. Of a function that makes several runs, only the first one begins.
    """
    found, missing, left = [], set().union(*map(values, experiment.arms)), list(experiment.arms)
    while arms := [arm for arm in left if missing & values(arm)]:
        arm = max(arms, key=lambda each: len(missing & values(each)))
        left.remove(arm)
        try:
            made = Execution({0: arm}, experiment.seed)((0, 0))
            if made.error is not None:
                found.append(f"{experiment.source} with {named(arm.labels)}: {made.error}")
            elif not made.observations and all(map(math.isnan, made.metrics.values())):
                continue
        except Begun:
            pass
        missing -= values(arm)
    return found + [f"{experiment.source}: no run begins with {name}={value}" for name, value in missing]


def title(path: Path) -> str:
    return "-".join(path.relative_to(EXPERIMENTS).with_suffix("").parts)


@pytest.mark.slow
@pytest.mark.parametrize("path", [*FEW, *two_tiers(OTHERS, 0)], ids=title)
def test_each_value_of_each_axis_is_in_a_run_that_begins(path: Path) -> None:
    found = faults(load_experiment(path))
    assert not found, "\n".join(found)


@pytest.mark.slow
def test_arms_that_cannot_be_set_up_are_named() -> None:
    """Here frontiers attract from less far than the scanner sees, but for that value of the axis which sets both."""
    found = faults(load_experiment(FEATURES, ["scenario.team.senses.beam_range_m=8", "map=corridor"]))
    assert found
    for sentence in found:
        assert sentence.startswith(f"{FEATURES} with map=corridor, filter=")
        assert ", range=2.5 m, position=" in sentence
        assert "UserError: protocol.parameters.schemas.frontier_m: 5.0 is not > 8.0" in sentence


def test_a_value_that_only_arms_have_that_answer_nothing_is_named() -> None:
    """Here an algorithm that the choice does not concern."""
    found = faults(load_experiment(CHOICES, ["choice=Cr 15", "algorithm=visbug"]))
    assert f"{CHOICES}: no run begins with algorithm=visbug" in found
