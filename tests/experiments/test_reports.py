"""Reports of the shipped experiments, on folders that a user would naturally make."""

from pathlib import Path
from typing import NoReturn

import pandas as pd
import pytest

from cosim.experiment import experiment_folders, find_experiment, load_experiment
from cosim.report.claims import judge, published_claims
from cosim.report.sweep_report import Report, report
from cosim.sweep import run_sweep
from experiments.messaging_delay import figures as delay_figures
from experiments.pseudonet_coverage import figures as coverage_figures

COVERAGE = ["protocol.parameters.algorithm=random_walk", "team.size=2", "floorplan.map=office", "duration_s=30"]


def swept(name: str, sets: list[str], folder: Path) -> Report:
    run_sweep(load_experiment(find_experiment(name), sets, quick=True, replicates=1), folder, jobs=1)
    return report(folder)


def fail(*given: object) -> NoReturn:
    raise RuntimeError("no such luck")


def verdicts(made: Report) -> dict[str, tuple[str, str]]:
    return {verdict.id: (verdict.ours, verdict.verdict) for verdict in made.verdicts}


@pytest.mark.slow
def test_one_strategy_of_messaging_delay_is_reported(tmp_path: Path):
    made = swept("messaging_delay", ["strategy=broadcast"], tmp_path)
    assert made.failures == 0
    found = verdicts(made)
    assert found["exact"] == ("0", "holds")
    assert found["linear"] == found["constant"] == found["two"] == ("-", "no data")
    assert [path.name for path in made.figures] == ["slots.png"]


@pytest.mark.slow
def test_one_arm_of_pseudonet_coverage_is_reported(tmp_path: Path):
    made = swept("pseudonet_coverage", COVERAGE, tmp_path)
    assert made.failures == 0
    found = verdicts(made)
    assert found["complete"] == ("-", "no data")
    assert found["overhead"][0].startswith("random_walk ")
    assert found["timing"][0].startswith("M=2 ")
    assert found["timing"][0].endswith(" (ideal 1.875)")  # 3 slots of 0.625 ms
    names = {path.name for path in made.figures}
    assert "what_bluetooth_costs.png" in names
    assert "time_to_cover_s.png" not in names  # nothing was covered


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "sets", "broken"),
    [
        ("messaging_delay", ["n_bc=1"], "experiments.messaging_delay.delay.exchange_slots"),
        ("pseudonet_coverage", COVERAGE, "cosim.sweep.simulate"),
    ],
)
def test_a_folder_in_which_all_runs_failed_is_reported(
    name: str, sets: list[str], broken: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(broken, fail)
    made = swept(name, sets, tmp_path)
    assert made.failures > 0
    assert set(verdicts(made).values()) == {("-", "no data")}
    assert (made.tables, made.figures) == ({}, [])


@pytest.mark.parametrize("rows", [pd.DataFrame(), pd.DataFrame({"status": ["done"], "n_bc": [1]})])
def test_claims_about_columns_that_are_not_there_have_no_data(rows: pd.DataFrame):
    nothing = pd.DataFrame()
    for name, module in (("messaging_delay", delay_figures), ("pseudonet_coverage", coverage_figures)):
        claims = published_claims(experiment_folders()[name])
        assert {judge(claim, rows, nothing, module).verdict for claim in claims} == {"no data"}
    assert coverage_figures.tables(rows, nothing) == {}
    assert coverage_figures.draw(rows, nothing, Path()) == []


def test_broadcast_gains_from_a_team_on_that_depends_on_its_repetitions():
    sizes, repetitions = range(2, 9), (1, 3)
    rows = [
        {"strategy": strategy, "n_bc": n, "team_size": m, "slots": slots}
        for n in repetitions
        for m in sizes
        for strategy, slots in (
            ("broadcast", 2 * n * m + 2 * (m - 1)),
            ("unicast", 2 * m * (m - 1)),
            ("unicast_piggyback", 2 * (m - 1) ** 2),
        )
        if not (strategy == "unicast_piggyback" and m == 3)  # a run that failed
    ]
    # N_BC 3: 8M - 2 slots against 2M(M-1): 38 and 40 for M = 5; against 2(M-1)^2: 46 and 50 for M = 6
    assert delay_figures.smallest_team_that_gains(pd.DataFrame(rows), pd.DataFrame())[0] == (
        "N_BC 1: from M=3 on against unicast, from M=4 on against unicast_piggyback; "
        "N_BC 3: from M=5 on against unicast, from M=6 on against unicast_piggyback"
    )


@pytest.mark.parametrize(("sizes", "slots", "holds"), [([2, 4, 8], [2, 6, 14], True), ([2, 3, 4], [2, 4, 7], False)])
def test_growth_is_linear_if_every_robot_adds_the_same(sizes: list[int], slots: list[int], holds: bool):
    rows = pd.DataFrame({"strategy": "one_message_unicast", "n_bc": 1, "team_size": sizes, "slots": slots})
    assert delay_figures.grows_linearly(rows, pd.DataFrame())[1] is holds
    assert delay_figures.grows_linearly(rows[:2], pd.DataFrame())[1] is None  # two points are always on a line


def test_a_first_look_at_coverage_has_intervals_and_both_channels_in_a_panel():
    experiment = load_experiment(find_experiment("pseudonet_coverage"), quick=True)
    assert experiment.replicates == 3  # Student's t for two values is 12.7: no interval that tells anything
    assert {arm.labels["team_size"] for arm in experiment.arms} == {2, 4, 8}
    assert len({arm.labels["algorithm"] for arm in experiment.arms}) == 4
    assert experiment.settings.report.panel == "algorithm"


@pytest.mark.parametrize("name", ["messaging_delay", "pseudonet_coverage"])
def test_claims_speak_of_the_paper(name: str):
    for row in published_claims(experiment_folders()[name]):
        assert "issue" not in row.claim
        assert "report it" not in row.claim


def overlaps(of_four: list[float], of_eight: list[float], channel: str = "bluetooth") -> pd.DataFrame:
    """Return the overlap in replicates of teams of four and of eight on one floor."""
    return pd.DataFrame(
        [
            {"algorithm": "oscard", "channel": channel, "floor": "office", "team_size": size, "replicate": replicate}
            | {"overlap_ratio": overlap}
            for size, values in ((4, of_four), (8, of_eight))
            for replicate, overlap in enumerate(values)
        ]
    )


@pytest.mark.parametrize(
    ("of_four", "of_eight", "holds"),
    [
        ([0.05, 0.06, 0.04], [0.08, 0.085, 0.09], True),
        ([0.05, 0.06, 0.04], [0.30, 0.32, 0.31], False),
        ([0.05, 0.06, 0.04], [0.05, 0.20, 0.04], None),  # its mean is below a tenth, and is not shown to be
        ([0.05, 0.20, 0.04], [0.30, 0.32, 0.31], False),
        ([0.05], [0.30], None),  # a single replicate shows nothing
    ],
)
def test_overlap_is_near_zero_if_it_is_so_with_every_team(of_four: list[float], of_eight: list[float], holds: bool):
    nothing = pd.DataFrame()
    assert coverage_figures.near_zero("oscard", overlaps(of_four, of_eight), nothing)[1] is holds
    assert coverage_figures.near_zero("spanning_tree", overlaps(of_four, of_eight), nothing) == ("-", None)
    assert coverage_figures.near_zero("oscard", overlaps(of_four, of_eight, "ideal"), nothing) == ("-", None)


def test_what_each_inquiry_costs_is_told_beside_the_ideal_channel(tmp_path: Path):
    nothing = pd.DataFrame()
    setups = {"ideal": 0.0, "bluetooth": 2.0, "bluetooth v1.1": 3.5}
    runs = pd.DataFrame(
        [
            {"algorithm": "oscard", "channel": channel, "team_size": 4, "floor": "office", "replicate": replicate}
            | {"setup_s": setup_s + replicate, "radio_wait_s": 1.0, "steps": 10.0}
            for channel, setup_s in setups.items()
            for replicate in range(3)
        ]
    )
    (table,) = coverage_figures.tables(runs, nothing).values()
    assert dict(zip(table["channel"], table["setup_s"], strict=True)) == {
        "bluetooth": "+2 ± 0",
        "bluetooth v1.1": "+3.5 ± 0",
    }
    (alone,) = coverage_figures.tables(runs[runs["channel"] != "bluetooth"], nothing).values()
    assert alone["channel"].tolist() == ["bluetooth v1.1"]
    assert coverage_figures.tables(runs[runs["channel"] != "ideal"], nothing) == {}
    assert [path.name for path in coverage_figures.draw(runs, nothing, tmp_path)] == ["what_bluetooth_costs.png"]
    drawn = pd.read_csv(tmp_path / "what_bluetooth_costs.numbers.csv")
    assert set(drawn["series"]) >= {"inquiry of v1.2", "inquiry of v1.1, as in the paper"}


def test_both_inquiries_are_in_the_whole_sheet_and_one_in_a_first_look():
    whole, first = (load_experiment(find_experiment("pseudonet_coverage"), quick=quick) for quick in (False, True))
    versions = {
        arm.labels["channel"]: arm.scenario.channel.inquiry_scan.version  # type: ignore[attr-defined]
        for arm in whole.arms
        if arm.labels["channel"] != "ideal"
    }
    assert versions == {"bluetooth": "1.2", "bluetooth v1.1": "1.1"}
    assert {arm.labels["channel"] for arm in first.arms} == {"ideal", "bluetooth"}
