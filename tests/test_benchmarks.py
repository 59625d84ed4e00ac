"""The figures about explorers that ``make bench`` prints: bounds, and what is replayed to measure them."""

import subprocess

import numpy as np
import pytest

from benchmarks import __main__ as benchmark
from benchmarks import exploration, start
from benchmarks.__main__ import FIGURES, Figure, measured, seconds_each, told
from cosim.units import S
from protocols.mapping.belief import Belief


def test_a_figure_beyond_its_bound_is_marked():
    assert told(40, 40.1) == "  at most 40 EXCEEDED"
    assert told(40, 40.0) == "  at most 40"
    assert told(None, 1e9) == ""


def test_what_figures_were_meant_to_cost_at_most_stands_beside_what_they_cost():
    bounds = [figure.bound for figure in FIGURES if figure.bound is not None]
    piconets, le, inquiry, message, crowd = [90e3, 1.2e6], [90e3, 1.2e6, 1000], 1200, 40, 2.5e6
    shared_air = [1.1, 2.0]  # against apart, and against both alone
    assert bounds == [*piconets, *le, inquiry, message, *shared_air, crowd, 40, 20, 10_000]  # marking, a step, A*


def test_what_a_user_waits_for_at_most_stands_there_in_seconds():
    bounds = [figure.bound_s for figure in FIGURES if figure.bound_s is not None]
    assert bounds == [0.2, 1.0, 1.7, 14.0, 14.0, 83e-6, 200e-6, 0.5, 3.0]  # commands, agent-steps, set-ups
    assert told(1.7, 1.71, " s") == "  at most 1.7 s EXCEEDED"


@pytest.mark.slow
@pytest.mark.parametrize("figure", [figure for figure in FIGURES if figure.prepare], ids=lambda figure: figure.name)
def test_what_is_measured_can_be_set_up(figure: Figure):
    assert figure.prepare is not None
    assert callable(figure.prepare(1))


def test_only_figures_that_are_asked_for_are_measured(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    figures = [Figure(name, seconds=lambda seed: 1.0) for name in ("the unit", "a scan", "a search", "another scan")]
    monkeypatch.setattr(benchmark, "FIGURES", figures)
    benchmark.main(["scan"])
    assert [line.partition("  ")[0] for line in capsys.readouterr().out.splitlines()[1:]] == ["a scan", "another scan"]
    for words, said in ((["--help"], "words"), (["flight"], "no figure's name holds 'flight'")):
        with pytest.raises(SystemExit):
            benchmark.main(words)
        assert said in "".join(capsys.readouterr())


def test_a_command_is_measured_in_a_process_of_its_own_and_must_succeed():
    assert start.command("list", "--help")(1) > 0
    with pytest.raises(subprocess.CalledProcessError):
        start.command("--nonsense")(1)


def test_a_figure_that_measures_itself_is_asked_with_the_seed_of_the_round():
    assert seconds_each(Figure("", seconds=lambda seed: seed / 4), 3) == 0.75


def test_a_figure_is_told_in_multiples_of_the_unit_before_and_after_it(monkeypatch):
    units = iter((1.0, 3.0))
    monkeypatch.setattr(benchmark, "FIGURES", (Figure("unit", seconds=lambda seed: next(units)),))
    assert measured(Figure("", seconds=lambda seed: 8.0), 1) == (8.0, 4.0)


@pytest.fixture
def short(monkeypatch):
    """Let recordings be short, and forget them afterwards."""
    kept = exploration._recorded, exploration._planned
    for each in kept:
        each.cache_clear()
    monkeypatch.setattr(exploration, "RECORDED", 40 * S)
    yield exploration._recorded(1)
    for each in kept:
        each.cache_clear()


@pytest.mark.slow
def test_a_replay_leads_to_the_map_of_the_recording(short, monkeypatch):
    machines, make = [], exploration._machine
    monkeypatch.setattr(exploration, "_machine", lambda run: machines.append(make(run)) or machines[-1])
    assert exploration.explorer_steps(1)() == len(short.seen) == 400
    (replayed,) = machines
    assert (short.belief.evidence < 0).sum() > 1000
    np.testing.assert_array_equal(replayed.belief.evidence, short.belief.evidence)


@pytest.mark.slow
def test_marked_scans_are_those_of_the_recording(short, monkeypatch):
    beliefs = []

    def make(*arguments):
        beliefs.append(Belief(*arguments))
        return beliefs[-1]

    monkeypatch.setattr(exploration, "Belief", make)
    assert exploration.marked_scans(1)() == 400
    (marked,) = beliefs
    np.testing.assert_array_equal(marked.evidence, short.belief.evidence)


@pytest.mark.slow
def test_steps_are_measured_without_those_that_plan(short, monkeypatch):
    clock = iter(range(10**9))
    monkeypatch.setattr(exploration, "process_time", lambda: float(next(clock)))
    monkeypatch.setattr(exploration, "_planned", lambda seed: frozenset({5, 6}))
    # a reading a call: one passes while scans are marked; from the start of the steps to their end five do, two of
    # them from before to after a planning
    assert exploration.schema_steps(1) == (5 - 2) / 398 - 1 / 400


@pytest.mark.slow
def test_searches_lead_over_the_whole_office_floor():
    explored = exploration._explored()
    assert explored.passable.shape == (402, 402)
    rows, columns = np.nonzero(explored.passable)
    assert max(rows.min(), columns.min()) < 10
    assert min(rows.max(), columns.max()) > 390
    found = [search() for search in exploration._searches(1)]
    assert len(found) == exploration.PAIRS
    assert all(way is not None for way in found)  # all places are joined
