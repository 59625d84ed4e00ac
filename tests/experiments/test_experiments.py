"""The sweeps of paper 002's searches: they load, a small arm of each runs, and arms differ in what their names say."""

import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from cosim.experiment import Arm, load_experiment
from cosim.geometry.planning import cost_to_go, wall_planning_grid
from cosim.report.by_choice import verdicts
from cosim.report.claims import published_claims
from cosim.scenario import Scenario
from cosim.simulation import simulate
from cosim.world.floorplan import FloorplanSettings, load_floorplan
from experiments.aggregation_laboratory import placing
from experiments.aggregation_scaling import floors, scaling
from tests.checkout import EXPERIMENTS

SWEEPS = sorted(EXPERIMENTS.glob("aggregation_*/*.yaml"))
TINY = {
    "aggregation_channels": (70, ["duration_s=70"]),  # jammed from 60 s on
    "aggregation_laboratory": (20, ["scenario.duration_s=20"]),
    "aggregation_scaling": (20, ["cap_s=20", "cap_s_per_m2=0"]),
    "aggregation_search": (20, ["duration_s=20", "case=normal"]),
}
"""By experiment: seconds, and what makes its runs last so long."""
DECLARED = {
    "aggregation_channels": ("loads",),
    "aggregation_laboratory": ("positions",),
    "aggregation_search": ("away", "joint"),
}
"""Sheets of variations, beside the alternatives."""


def title(path: Path) -> str:
    return f"{path.parent.name}-{path.stem}"


def arm(name: str, *sets: str, sheet: str = "sweep") -> Arm:
    """Return the only arm that *sets* leave of an experiment."""
    (found,) = load_experiment(EXPERIMENTS / name / f"{sheet}.yaml", sets).arms
    return found


def scenario_of(one: Arm, seed: int = 1) -> Scenario:
    """Return what an arm runs."""
    if one.scenario is not None:
        return one.scenario
    if str(one.run).startswith(placing.__name__):
        return placing.Parameters.model_validate(one.parameters).placed(seed)
    return scaling.Parameters.model_validate(one.parameters).scaled()


# ---------------------------------------------------------------- all of them


def test_there_are_four_experiments_with_a_sheet_of_alternatives_each():
    sheets = {name: {"alternatives", "sweep", *DECLARED.get(name, ())} for name in TINY}
    assert [title(path) for path in SWEEPS] == [f"{name}-{sheet}" for name in TINY for sheet in sorted(sheets[name])]


@pytest.mark.slow
@pytest.mark.parametrize("path", SWEEPS, ids=title)
def test_every_arm_is_a_run_that_can_be_set_up_and_the_quick_sweep_is_smaller(path: Path):
    whole, quick = load_experiment(path), load_experiment(path, quick=True)
    assert len({one.configuration for one in whole.arms}) == len(whole.arms)  # no two arms are the same run
    assert 1 < len(quick.arms) * quick.replicates < len(whole.arms) * whole.replicates


@pytest.mark.slow
@pytest.mark.parametrize("path", SWEEPS, ids=title)
def test_an_arm_runs_as_long_as_it_may(path: Path):
    seconds, sets = TINY[path.parent.name]
    one = load_experiment(path, [*sets, "strategy=srp"], quick=True).arms[-1]
    scenario = scenario_of(one, 3)
    found = simulate(scenario, 3).metrics
    assert found["simulated_s"] == seconds
    assert found["search_time_min"] <= seconds / 60
    assert 0 < found["distance_m"] <= seconds * sum(body.speed_mps for body in scenario.team.bodies)


@pytest.mark.slow
@pytest.mark.parametrize(("module", "name"), [(placing, "aggregation_laboratory"), (scaling, "aggregation_scaling")])
def test_a_function_returns_its_columns(module: Any, name: str):
    one = load_experiment(EXPERIMENTS / name / "sweep.yaml", TINY[name][1], quick=True).arms[0]
    assert set(module.measure(one.parameters, 3)) == {column.name for column in module.COLUMNS}


# ---------------------------------------------------------------- the laboratory


def laboratory(seed: int, strategy: str = "srp", distribution: int = 2, **more: Any) -> Any:
    one = arm("aggregation_laboratory", f"strategy={strategy}", f"distribution={distribution}")
    return placing.Parameters.model_validate({**one.parameters, **more}).placed(seed)


def test_each_run_of_the_laboratory_has_starts_of_its_own_and_all_its_arms_have_these():
    named = placing.Parameters.model_validate(arm("aggregation_laboratory", "strategy=mi", "distribution=1").parameters)
    first, second = laboratory(1).team.starts, laboratory(2).team.starts
    assert first != second
    assert laboratory(1, "mi", 4).team.starts == first
    places = np.array(named.scenario.team.starts)
    off = np.abs(np.array([laboratory(seed).team.starts for seed in range(20)]) - places)
    assert 0.04 < off.max() <= named.placing_m == 0.05


def test_all_robots_of_the_laboratory_are_in_contact_at_the_start():
    for seed in range(20):
        host, *searchers = laboratory(seed).team.starts
        assert all(0.5 < math.dist(host, each) < 1.0 for each in searchers)  # no bodies overlap, radios reach 1 m


def test_a_distribution_is_a_number_behind_the_name_of_the_places():
    assert laboratory(1, distribution=3).protocol.parameters.target_place == "targets_3"
    other = scenario_of(
        arm(
            "aggregation_laboratory",
            "choice=one target moves away",
            "strategy=srp",
            "distribution=3",
            sheet="alternatives",
        )
    )
    assert other.protocol.parameters.target_place == "targets_b_3"


# ---------------------------------------------------------------- scaling


@pytest.mark.parametrize("side_m", floors.SIDES_M)
def test_the_floors_are_those_that_are_written(side_m: int):
    path = EXPERIMENTS / "floors" / f"rooms_{side_m}.yaml"
    assert path.read_text(encoding="utf-8") == floors.text(side_m)


@pytest.mark.slow
@pytest.mark.parametrize("side_m", floors.SIDES_M)
def test_all_rooms_of_a_floor_are_alike_and_can_be_reached(side_m: int):
    plan = load_floorplan(FloorplanSettings(map=f"rooms_{side_m}.yaml"), EXPERIMENTS / "floors")
    count = side_m // 25
    corners = np.array(plan.places_m["room_corners"]).reshape(-1, 2, 2)
    assert len(plan.places_m["rooms"]) == len({tuple(low) for low in corners[:, 0].tolist()}) == count * count
    assert (corners[:, 1] - corners[:, 0] == 25.0).all()
    grid = wall_planning_grid(plan.bounds_m, 0.25, 0.25, plan.walls_m, plan.forbidden)
    start = plan.places_m["start"][0]
    costs = cost_to_go(grid.free, [grid.cell_at(*start)])
    assert np.isfinite([costs.flat[grid.cell_at(*room)] for room in plan.places_m["rooms"]]).all()
    assert math.dist(start, (side_m / 2, side_m / 2)) < 25.0


def test_a_floor_has_an_even_number_of_rooms_along_a_side():
    for side_m in (75, 60):
        with pytest.raises(ValueError, match="no even number"):
            floors.floor(side_m)


def scaled(*sets: str, **more: Any) -> Any:
    one = arm("aggregation_scaling", "strategy=mrp", "side_m=150", "sub_teams=2", *sets)
    return scaling.Parameters.model_validate({**one.parameters, **more}).scaled()


def test_what_grows_with_the_area_is_that_of_aggregation_search_where_the_area_is():
    found: Any = scaled(sub_teams=3)
    usual: Any = scenario_of(arm("aggregation_search", "strategy=mrp", "case=normal"))
    for name in ("reconvene_s", "sync_s", "lost_s", "hosts", "camera_m"):
        assert getattr(found.protocol.parameters, name) == getattr(usual.protocol.parameters, name)
    assert [group.size for group in found.team.groups] == [group.size for group in usual.team.groups]
    assert found.channel == usual.channel


def test_runs_get_longer_with_the_area():
    runs = [scaled(side_m=side_m) for side_m in floors.SIDES_M]
    assert all(a.duration_s < b.duration_s for a, b in pairwise(runs))
    assert [run.protocol.parameters.reconvene_s for run in runs] == [30, 100, 225, 400]  # 0.02 s/m2, from 30 s on


def test_what_is_chosen_grows_with_the_area_as_the_usual_does():
    """Periods twice as long are so on every area, but never below 30 s; a host waits for slow searchers longer."""
    for side_m in floors.SIDES_M:
        usual, slow = scaled(side_m=side_m), scaled("scenario.team.groups[1].body.speed_mps=0.5", side_m=side_m)
        later = scaled("scenario.protocol.parameters.reconvene_s=300", side_m=side_m)
        reconvene_s, lost_s = 0.02 * side_m**2 / 2, 0.12 * side_m**2 / 2
        assert usual.protocol.parameters.reconvene_s == pytest.approx(max(30.0, reconvene_s))
        assert later.protocol.parameters.reconvene_s == pytest.approx(max(30.0, 2 * reconvene_s))
        assert later.protocol.parameters.lost_s == pytest.approx(lost_s)
        assert (usual.protocol.parameters.sync_s, slow.protocol.parameters.sync_s) == (side_m, 2 * side_m)
        assert [body.speed_mps for body in slow.team.bodies] == [0.5] * 6  # two hosts, four searchers


# ---------------------------------------------------------------- channels


def network(name: str) -> Any:
    return scenario_of(arm("aggregation_channels", "strategy=mi", f"network={name}"))


def test_networks_differ_in_their_radios_and_jammers_only():
    ideal, adhoc, jammed = map(network, ("ideal", "adhoc", "jammed"))
    assert [radio.kind for radio in ideal.channel.radios] == ["ideal", "ideal"]
    assert [radio.range_m for radio in ideal.channel.radios] == [radio.range_m for radio in adhoc.channel.radios]
    assert ideal.model_copy(update={"channel": adhoc.channel}) == adhoc
    assert jammed.model_copy(update={"faults": ()}) == adhoc.model_copy(update={"faults": ()})
    assert not adhoc.faults


def test_jammers_reach_every_place_where_hosts_may_be_and_only_the_short_radio_after_a_minute():
    jammers, channel = network("jammed").faults, network("jammed").channel
    reach_m = channel.radios[0].range_m
    places = np.array([(jammer.x_m, jammer.y_m) for jammer in jammers])
    middle = np.stack(np.meshgrid(np.arange(25.0, 125.5), np.arange(25.0, 125.5)), axis=-1).reshape(-1, 1, 2)
    assert np.linalg.norm(middle - places, axis=-1).min(axis=1).max() <= reach_m
    for jammer in jammers:
        assert (jammer.radio, jammer.at_s, jammer.on_s, jammer.period_s) == (0, 60, 60, 180)
        assert {2402 + k for k in jammer.channels} == set(range(2402, 2423))  # channel 1: 2412 MHz, 22 MHz wide
    assert [radio.channel for radio in channel.radios] == [1, 13]


def test_without_a_load_the_runs_are_those_of_the_sweep_but_for_queues_and_else_searchers_send_that_much():
    sheets = (load_experiment(EXPERIMENTS / "aggregation_channels" / f"{name}.yaml") for name in ("loads", "sweep"))
    chosen, usual = ({tuple(one.labels.values()): one.scenario for one in each.arms} for each in sheets)
    loads = {"status": 0, "map": 18_000, "picture": 35_000, "video": 120_000}
    assert len(chosen) == len(loads) * 4 * 3
    for (choice, strategy, network), scenario in chosen.items():
        like = usual[strategy, network.removesuffix(" at 11 Mb/s")]
        found, plain = (one.model_dump(exclude={"name"}) for one in (scenario, like))
        assert found["protocol"]["parameters"].pop("stream_bytes_per_s") == loads[choice]
        assert plain["protocol"]["parameters"].pop("stream_bytes_per_s") == 0
        for radio in found["channel"]["radios"]:
            assert radio.pop("queue_payloads", None) == (None if network == "ideal" else 1000)
        short = found["channel"]["radios"][0]
        if network == "adhoc at 11 Mb/s":
            assert short["rate_mbps"] == 11
            short["rate_mbps"] = None
        for radio in plain["channel"]["radios"]:
            radio.pop("queue_payloads", None)
        assert found == plain


def test_tether_camera_and_rooms_are_varied_together_and_nothing_else_is():
    sheets = (load_experiment(EXPERIMENTS / "aggregation_search" / f"{name}.yaml") for name in ("joint", "sweep"))
    chosen, usual = ({tuple(one.labels.values()): one.scenario for one in each.arms} for each in sheets)
    assert len(chosen) == 8 * 4 * 3
    kinds = set()
    for (_, *labels), scenario in chosen.items():
        found, plain = (one.model_dump(exclude={"name"}) for one in (scenario, usual[tuple(labels)]))
        own, radio = found["protocol"]["parameters"], found["channel"]["radios"][1]
        assert own["long_m"] == radio["range_m"]
        kinds.add((found["floorplan"].pop("map"), own.pop("camera_m"), own.pop("long_m"), radio.pop("range_m")))
        del plain["floorplan"]["map"], plain["channel"]["radios"][1]["range_m"]
        del plain["protocol"]["parameters"]["camera_m"], plain["protocol"]["parameters"]["long_m"]
        assert found == plain
    assert len(kinds) == 8


def test_where_robots_take_themselves_to_be_is_all_that_is_varied_and_true_positions_are_the_sweep():
    sheets = (
        load_experiment(EXPERIMENTS / "aggregation_laboratory" / f"{name}.yaml") for name in ("positions", "sweep")
    )
    chosen, usual = ({tuple(one.labels.values()): scenario_of(one) for one in each.arms} for each in sheets)
    assert len(chosen) == 3 * 4 * 4
    drift = {"odometry_slip": 0.03, "odometry_turn_rad": 0.03, "range_noise_m": 0.02}
    for (choice, *labels), scenario in chosen.items():
        found, plain = (one.model_dump(exclude={"name"}) for one in (scenario, usual[tuple(labels)]))
        assert found["protocol"]["parameters"]["positioning"].pop("kind") == ("mcl" if choice == "mcl" else "given")
        assert plain["protocol"]["parameters"]["positioning"].pop("kind") == "given"
        if choice != "true":
            plain["team"]["senses"] |= drift
        assert found == plain


# ---------------------------------------------------------------- alternatives


@pytest.mark.parametrize("name", TINY)
def test_alternatives_are_of_the_runs_that_the_sweep_makes(name: str):
    sheets = [load_experiment(EXPERIMENTS / name / f"{sheet}.yaml") for sheet in ("sweep", "alternatives")]
    usual, other = (sheet.base for sheet in sheets)
    named = [base.get("scenario", base) for base in (usual, other)]
    assert named[0].pop("name") != named[1].pop("name")
    assert other == usual
    known, chosen = ({axis.name: dict(axis.values) for axis in sheet.axes} for sheet in sheets)
    assert set(chosen) == {"choice", *known}
    for axis, values in known.items():
        assert chosen[axis] == {label: values[label] for label in chosen[axis]}


@pytest.mark.parametrize("name", TINY)
def test_no_choice_is_what_the_sweep_has(name: str):
    """Each arm of each choice is a run that the sweep has not, but for AODV: the ideal channel has no routing."""
    path = EXPERIMENTS / name / "alternatives.yaml"
    usual = [scenario_of(one) for one in load_experiment(path, ["choice={}"]).arms]
    arms = load_experiment(path).arms
    assert len({one.labels["choice"] for one in arms}) >= 2
    same = [one.labels for one in arms if scenario_of(one) in usual]
    ideal = [one.labels for one in arms if {"sub-teams by AODV", "ideal"} <= set(one.labels.values())]
    assert same == ideal


@pytest.mark.parametrize("name", ["aggregation_channels", "aggregation_scaling"])
def test_alternatives_have_the_arms_of_every_claim(name: str):
    stream, arms = np.random.default_rng(1), load_experiment(EXPERIMENTS / name / "alternatives.yaml").arms
    metrics = ["search_time_min", "completed", "distance_m", "distance_after_m", "payload_bytes", "frames", "energy_j"]
    metrics.append("simulated_s")
    runs = pd.DataFrame(
        {**one.labels, "replicate": at, **dict.fromkeys(metrics, stream.integers(1, 3))}
        for one in arms
        for at in range(2)
    ).assign(completed=1.0)
    found = verdicts(runs, EXPERIMENTS / name)
    assert list(found.index) == [claim.id for claim in published_claims(EXPERIMENTS / name)]
    assert "no data" not in set(found.to_numpy().ravel())


def test_claims_are_judged_for_each_choice_alone():
    minutes = {("open", "srp"): 9, ("open", "mrp"): 8, ("open", "mi"): 7, ("nested", "srp"): 6}
    minutes |= {("nested", "mrp"): 5, ("nested", "mi"): 7}
    runs = pd.DataFrame(
        {"choice": choice, "strategy": strategy, "case": "normal", "replicate": at, "search_time_min": value + at / 10}
        for (choice, strategy), value in minutes.items()
        for at in range(5)
    )
    found = verdicts(runs, EXPERIMENTS / "aggregation_search")
    assert found.loc["fastest_normal"].to_dict() == {"open": "holds", "nested": "fails"}
    assert "fastest_failed" not in found.index  # no such runs
