"""The experiments of goal reflection: their claims on rows made by hand, their sweeps, and their picture."""

import math
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import shapely
import yaml

from cosim.errors import UserError
from cosim.experiment import load_experiment
from cosim.report.claims import judge, published_claims
from cosim.report.sweep_report import Report, report
from cosim.simulation import simulate
from cosim.sweep import run_sweep
from cosim.world.floorplan import FloorplanSettings, load_floorplan
from experiments.reflection import choices, reflecting
from experiments.reflection_channels import figures as channels
from experiments.reflection_noise import figures as noise
from experiments.reflection_roles import figures as roles
from experiments.reflection_roles.roles import COLUMNS, measure
from experiments.reflection_scaling import figures as scaling
from experiments.reflection_tables import alternatives, figures, trajectories
from tests.checkout import EXPERIMENTS

NOTHING = pd.DataFrame()
MODULES = {
    "reflection_tables": figures,
    "reflection_noise": noise,
    "reflection_channels": channels,
    "reflection_roles": roles,
    "reflection_scaling": scaling,
}


def runs_of(steps: dict[tuple[Any, ...], list[float]], axes: tuple[str, ...], **more: float) -> pd.DataFrame:
    """Return runs with ten targets each: *steps* a target by the values of *axes*, one for each replicate."""
    rows = [
        dict(zip(axes, key, strict=True)) | {"replicate": replicate, "motion_steps": 10 * value, "targets": 10}
        for key, values in steps.items()
        for replicate, value in enumerate(values)
    ]
    return pd.DataFrame(rows).assign(targets_given_up=0.0, **more)


def tables_of(steps: dict[tuple[Any, ...], list[float]], **more: float) -> pd.DataFrame:
    return runs_of(steps, ("floor", "algorithm", "robots"), **more)


def answer(module: Any, test: str, runs: pd.DataFrame) -> bool | None:
    found: bool | None = getattr(module, test)(runs, NOTHING)[1]
    return found


# ---------------------------------------------------------------- claims


def test_each_robot_that_is_added_must_save_steps():
    falling = {("first", "visbug", size): [100.0 / size, 104.0 / size] for size in (1, 2, 3, 4)}
    assert answer(figures, "fewer_first_visbug", tables_of(falling)) is True
    assert answer(figures, "reduction_first_visbug", tables_of(falling)) is True
    useless = falling | {("first", "visbug", 3): [50.0, 52.5]}
    assert answer(figures, "fewer_first_visbug", tables_of(useless)) is False
    assert answer(figures, "reduction_first_visbug", tables_of(useless)) is True
    # the paper has no number for the potential field alone
    field = {("first", "potential_field", size): [90.0 - size, 91.0 - size] for size in (2, 3, 4)}
    assert answer(figures, "fewer_first_potential_field", tables_of(field | {("first", "potential_field", 1): [1, 1]}))


def test_algorithms_are_alike_within_the_factor_and_not_beyond():
    alike = {
        ("first", name, size): [level, level + 1]
        for size in (2, 3, 4)
        for name, level in zip(figures.ALGORITHMS, (100.0, 110.0, 200.0 if size == 2 else 120.0), strict=True)
    }
    assert answer(figures, "alike_3", tables_of(alike)) is True
    assert answer(figures, "closer", tables_of(alike)) is True
    apart = alike | {("first", "visbug", 3): [140.0, 141.0], ("first", "visbug", 4): [300.0, 301.0]}
    assert answer(figures, "alike_3", tables_of(apart)) is False
    assert answer(figures, "closer", tables_of(apart)) is False
    assert answer(figures, "alike_4", tables_of({key: values[:1] for key, values in alike.items()})) is None


def test_visbug_must_be_below_both_others():
    second = {("second", "visbug", 2): [50.0, 51.0], ("second", "avoid_past", 2): [90.0, 91.0]}
    field = ("second", "potential_field", 2)
    assert answer(figures, "visbug_lowest_2", tables_of(second | {field: [99.0, 98.0]})) is True
    assert answer(figures, "visbug_lowest_2", tables_of(second | {field: [49.0, 50.0]})) is False
    assert answer(figures, "visbug_lowest_2", tables_of(second)) is None


def test_one_target_given_up_refutes_that_all_are_reached():
    runs = tables_of({("first", "potential_field", size): [10.0, 11.0] for size in (1, 2)})
    runs.loc[runs["robots"] == 1, "targets_given_up"] = [5.0, 6.0]
    assert answer(figures, "finishes_first_potential_field", runs) is True
    assert answer(figures, "alone_fails_first", runs) is True
    assert answer(figures, "rescues_first", runs) is True
    runs.loc[runs["robots"] == 2, "targets_given_up"] = [0.0, 1.0]
    assert answer(figures, "finishes_first_potential_field", runs) is False
    assert answer(figures, "rescues_first", runs) is True
    runs["targets_given_up"] = 5.0
    assert answer(figures, "rescues_first", runs) is False
    runs.loc[runs["robots"] == 2, "targets_given_up"] = [2.0, 8.0]  # shares whose difference is none but for rounding
    assert figures.rescues("first", runs, runs)[0] == "fewer given up than alone: 2 robots 0 points"


def test_the_printed_cells_stand_beside_ours_and_are_not_judged():
    printed = figures.cells()
    assert len(printed) == 22
    # the rows of Table 1, then of Table 2, added up from the paper: Avoid Past, VisBug, potential field
    sums = (1539.6, 1591.2, 1163.8, 3500.2, 1726.2, 3290.4)
    assert [
        round(sum(each.steps for each in printed if (each.floor, each.algorithm) == (floor, name)), 1)
        for floor in figures.FLOORS
        for name in figures.ALGORITHMS
    ] == list(sums)
    runs = tables_of({tuple(each.arm.values()): [each.steps, each.steps] for each in printed})
    claims = [each for each in published_claims(EXPERIMENTS / "reflection_tables") if each.id.startswith("cell_")]
    ours = [judge(claim, runs, NOTHING, figures) for claim in claims]
    assert {each.verdict for each in ours} == {"not comparable"}
    assert [each.ours.split()[0] for each in ours] == [f"{each.steps:.4g}" for each in printed]
    cells, reductions = figures.tables(runs, NOTHING).values()
    assert cells["published"].tolist() == pytest.approx([float(value) for value in cells["ours"]], rel=5e-4)
    assert reductions["published"].tolist() == [words.split(" (")[0] for words in reductions["ours"]]


def test_steps_must_grow_with_the_error_and_helpers_must_lose_their_use():
    axes = ("floor", "algorithm", "err_max")
    steps = {
        ("second", "visbug", error): [80.0 + 100 * float(error), 82 + 101 * float(error)] for error in noise.ERRORS
    }
    steps |= {("second", "visbug", "alone"): [105.0, 107.0]}
    runs = runs_of(steps, axes)
    assert answer(noise, "grows_second_visbug", runs) is True
    assert answer(noise, "useless_visbug", runs) is True  # 100 and 102.2 steps: 5 % saved at an error of 0.2
    assert answer(noise, "worse_than_alone", runs) is True
    useful = runs_of(steps | {("second", "visbug", error): [60.0, 61.0] for error in ("0.2", "0.4")}, axes)
    assert answer(noise, "grows_second_visbug", useful) is False
    assert answer(noise, "useless_visbug", useful) is False
    assert answer(noise, "worse_than_alone", useful) is False
    first = runs_of({("first", "visbug", "0.4"): [9.0, 8.9], ("first", "visbug", "alone"): [12.0, 12.0]}, axes)
    assert answer(noise, "better_than_alone_visbug", first) is True


def test_a_slow_link_may_cost_a_tenth():
    at_once, slow = ("first", "visbug", "at once, 0.1 s"), ("first", "visbug", "2 kbit/s, 1 s")
    good = links_of({at_once: [100.0, 90.0], slow: [103.0, 92.0]})
    bad = links_of({at_once: [100.0, 90.0], slow: [120.0, 92.0]})
    assert answer(channels, "minimal_first_visbug_2_kbit", good) is True
    assert answer(channels, "minimal_first_visbug_2_kbit", bad) is False
    assert answer(channels, "minimal_first_visbug_450_bit", good) is None


def test_a_link_helps_if_it_saves_steps_against_silence():
    silent, radio = ("second", "visbug", "no messages"), ("second", "visbug", "Bluetooth, walls, 1 s")
    test = "helps_second_visbug_bluetooth_walls"
    assert answer(channels, test, links_of({silent: [9.0, 8.8], radio: [7.0, 7.1]})) is True
    assert answer(channels, test, links_of({silent: [9.0, 8.8], radio: [9.0, 9.1]})) is False
    told = links_of({radio: [7, 7.1]}).assign(advice=[1.0, 0.0], advice_unseen=[3.0, 0.0])
    assert channels.unseen(told, NOTHING) == ("Bluetooth, walls, 1 s: 0.75", None)  # of the run that got any advice


def links_of(steps: dict[tuple[str, str, str], list[float]]) -> pd.DataFrame:
    rows = [
        dict(zip(channels.AXES, key, strict=True)) | {"replicate": replicate, "steps": value}
        for key, values in steps.items()
        for replicate, value in enumerate(values)
    ]
    return pd.DataFrame(rows)


def test_dedicated_helpers_are_compared_at_equal_team_size():
    rows = {("visbug", 4, 0): 20.0, ("visbug", 3, 1): 15.0, ("visbug", 1, 3): 25.0, ("visbug", 3, 0): 18.0}
    runs = pd.DataFrame(
        [
            dict(zip(roles.AXES, key, strict=True)) | {"replicate": replicate, "steps": value + replicate}
            for key, value in rows.items()
            for replicate in (0, 1)
        ]
    )
    assert answer(roles, "dedicated_visbug_3", runs) is True
    assert answer(roles, "dedicated_visbug_1", runs) is False
    assert answer(roles, "several_visbug_3", runs) is True
    assert answer(roles, "dedicated_visbug_2", runs) is None


def test_bytes_are_bounded_by_what_the_paper_allows():
    # 9 + 2 bytes of header and CRC, 5 a bearing, 13 a term, 13 a pair: protocols/reflection/frames.py
    assert [scaling.most(size) for size in (1, 2, 50)] == [37, 68, 1556]
    rows = [
        {"task": task, "robots": size, "replicate": 0, "bytes_a_frame": 31.0 * size, "bytes_a_period": 31.0 * size**2}
        for task in (scaling.HALL, scaling.ROOMS)
        for size in (2, 4, 8)
    ]
    told, holds = scaling.meeting(pd.DataFrame(rows), NOTHING)
    assert holds is True
    assert told.endswith("from 4 to 8 robots M to the power of 1")
    told, holds = scaling.together(pd.DataFrame(rows), NOTHING)
    assert holds is True
    assert told.endswith("from 4 to 8 robots M to the power of 2")
    rows[-1] |= {"bytes_a_frame": 255.0, "bytes_a_period": 8 * 255.0}  # of 254
    assert answer(scaling, "meeting", pd.DataFrame(rows)) is False
    assert answer(scaling, "together", pd.DataFrame(rows)) is False


# ---------------------------------------------------------------- other choices


def of_choices(steps: dict[tuple[str, str, str], list[float]]) -> pd.DataFrame:
    """Return runs of the first floor: *steps* a target by choice, algorithm and team, one for each replicate."""
    rows = [
        dict(zip(("choice", "algorithm", "team"), key, strict=True)) | {"replicate": replicate, "steps": value}
        for key, values in steps.items()
        for replicate, value in enumerate(values)
    ]
    return pd.DataFrame(rows).assign(floor="first", given_up=0.25, targets=4)


def test_what_is_saved_stands_beside_what_the_paper_saves():
    usual, wide = choices.AS_IN_THE_TABLES, "doors twice as wide"
    runs = of_choices(
        {
            (usual, "visbug", "smallest"): [100.0, 100.0],
            (usual, "visbug", "whole"): [50.0, 60.0],
            (wide, "visbug", "smallest"): [100.0, 100.0],
            (wide, "visbug", "whole"): [100.0, 110.0],
        }
    )
    found = alternatives.savings(runs)
    assert found["saved"].tolist() == pytest.approx([45.0, -5.0])
    assert found["at_least"].tolist() == pytest.approx([45 - 5 * 6.3138, -5 - 5 * 6.3138], abs=1e-3)  # t, 0.95, 1
    assert found["published"].tolist() == pytest.approx([76.07, 76.07], abs=0.01)  # 840.6 and 201.2
    assert found["given_up_whole"].tolist() == [25.0, 25.0]
    (table,) = alternatives.tables(runs, NOTHING).values()
    assert table["visbug"].tolist() == ["76 %", "27 %", "45 % (>= 13); 25 > 25 %", "-5 % (>= -37); 25 > 25 %"]


@pytest.mark.slow
def test_claims_are_judged_choice_by_choice_with_the_usual_runs_where_a_choice_makes_no_difference():
    nan = math.nan
    runs = of_choices(
        {
            (choices.AS_IN_THE_TABLES, "visbug", "smallest"): [100.0, 101.0],
            (choices.AS_IN_THE_TABLES, "visbug", "whole"): [50.0, 51.0],
            (choices.AS_IN_THE_TABLES, "potential_field", "smallest"): [100.0, 101.0],
            (choices.AS_IN_THE_TABLES, "potential_field", "whole"): [50.0, 51.0],
            ("Cr 15", "visbug", "smallest"): [nan, nan],
            ("Cr 15", "visbug", "whole"): [nan, nan],
            ("Cr 15", "potential_field", "smallest"): [100.0, 101.0],
            ("Cr 15", "potential_field", "whole"): [100.0, 102.0],
        }
    )
    found = alternatives.verdicts(runs, "reflection_tables")
    assert found.loc["reduction_first_potential_field"].tolist() == ["holds", "fails"]
    assert found.loc["reduction_first_visbug"].tolist() == ["holds", "holds"]
    assert found.loc["finishes_first_visbug"].tolist() == ["fails", "fails"]  # a quarter is given up
    assert not [name for name in found.index if name.startswith("fewer")]
    wide = runs[runs["choice"] == "Cr 15"].assign(choice="doors twice as wide, Cr 15")
    doors = runs[runs["algorithm"] == "visbug"].assign(choice="doors twice as wide", steps=[7.0, 7, 5, 5] * 2)
    assert set(
        choices.of_choice(pd.concat([runs, doors, wide]), "doors twice as wide, Cr 15", "finishes")["steps"]
    ) == {
        5.0,
        7.0,
        100.0,
        101.0,
        102.0,
    }
    ours = choices.of_choice(runs, choices.AS_IN_THE_TABLES, "cell_first_visbug_1")
    assert (ours["motion_steps"] / ours["targets"]).tolist() == ours["steps"].tolist()  # as the printed cells ask
    assert set(alternatives.savings(runs)["choice"][2:]) == {"Cr 15"}
    assert len(alternatives.savings(runs)) == 3


def test_a_choice_sets_what_it_names_and_nothing_else():
    sets = ["algorithm=potential_field", "floor=second"]
    usual, changed = (
        reflecting.Parameters.model_validate(
            load_experiment(EXPERIMENTS / "reflection_tables" / "alternatives.yaml", [*sets, *more]).arms[0].parameters
        ).chosen()
        for more in (
            ["choice=as in the tables", "team=whole"],
            ["choice='doors twice as wide, Cr 15'", "team=smallest"],
        )
    )
    assert usual.floorplan.map == "../floors/nested.yaml"
    assert changed.floorplan.map == "../floors/nested_wide.yaml"
    assert (usual.team.size, changed.team.size) == (4, 2)  # of the potential field
    plain: Any = changed.protocol.parameters
    assert plain.trouble_limit == 15
    assert plain.model_copy(update={"trouble_limit": 30}) == usual.protocol.parameters


def test_no_run_is_made_of_an_algorithm_that_a_choice_does_not_concern():
    base = load_experiment(EXPERIMENTS / "reflection_tables" / "alternatives.yaml").base
    told = reflecting.measure(base | {"concerns": ["visbug"]}, 1)  # the base is the potential field's
    assert set(told) == {column.name for column in reflecting.COLUMNS}
    assert all(math.isnan(value) for value in told.values())


@pytest.mark.slow
def test_a_run_with_nothing_chosen_is_the_run_of_the_scenario():
    sets = ["targets=2", "algorithm=visbug"]
    base = load_experiment(EXPERIMENTS / "reflection_tables" / "alternatives.yaml", sets).arms[0].parameters
    told = reflecting.measure(base | {"team": "whole"}, 1)
    sets = ["floor=first", "robots=4", "algorithm=visbug", "targets=2"]
    arm = load_experiment(EXPERIMENTS / "reflection_tables" / "sweep.yaml", sets).arms[0]
    assert arm.scenario is not None
    metrics = simulate(arm.scenario, 1).metrics
    assert told["steps"] == metrics["motion_steps"] / 2
    assert told["given_up"] == metrics["targets_given_up"] / 2
    assert told["promise_share"] == pytest.approx(metrics["steps_to_promise"] / metrics["motion_steps"])
    assert told["robot_steps"] == pytest.approx(40 * metrics["simulated_s"])


@pytest.mark.parametrize("name", MODULES)
def test_claims_name_tests_that_are_there_and_have_no_data_without_runs(name: str):
    claims = published_claims(EXPERIMENTS / name)
    assert len({claim.id for claim in claims}) == len(claims) > 2
    module: Any = MODULES[name]
    for rows in (NOTHING, pd.DataFrame({"status": ["done"], "replicate": [0]})):
        verdicts = [judge(claim, rows, NOTHING, module) for claim in claims]
        assert {each.ours for each in verdicts} == {"-"}
        judged = {each.verdict for each in verdicts if not each.test.startswith("not comparable")}
        assert judged == {"no data"}
        assert module.draw(rows, NOTHING, Path()) == []
    for claim in claims:
        assert claim.test.startswith("not comparable: ") or callable(getattr(module, claim.test))


# ---------------------------------------------------------------- sweeps


@pytest.mark.parametrize(
    ("name", "arms", "quick"),
    [
        ("reflection_tables/sweep", 24, 18),
        ("reflection_tables/alternatives", 384, 24),
        ("reflection_tables/radius", 168, 12),
        ("reflection_tables/floors", 36, 27),
        ("reflection_tables/joint", 96, 36),
        ("reflection_noise/sweep", 36, 18),
        ("reflection_noise/alternatives", 72, 6),
        ("reflection_channels/sweep", 60, 10),
        ("reflection_channels/alternatives", 192, 8),
        ("reflection_roles/sweep", 48, 6),
        ("reflection_roles/alternatives", 96, 4),
        ("reflection_scaling/sweep", 18, 12),
    ],
)
def test_every_arm_is_valid(name: str, arms: int, quick: int):
    path = EXPERIMENTS / f"{name}.yaml"
    assert len(load_experiment(path).arms) == arms
    assert len(load_experiment(path, quick=True).arms) == quick


def test_over_bluetooth_robots_make_links():
    arms = load_experiment(EXPERIMENTS / "reflection_channels" / "sweep.yaml", ["floor=first"]).arms
    chosen = {arm.labels["link"]: reflecting.Parameters.model_validate(arm.parameters).chosen() for arm in arms}
    for link, scenario in chosen.items():
        parameters: Any = scenario.protocol.parameters
        assert parameters.links is (scenario.channel.kind == "bluetooth") is str(link).startswith("Bluetooth")
    walls: Any = chosen["Bluetooth, walls, 1 s"].channel
    assert walls.propagation.walls


@pytest.mark.parametrize("name", ["corridor", "nested"])
@pytest.mark.parametrize("doors", ["middle", "wide"])
def test_floors_with_other_doors_are_the_same_but_for_their_doors(name: str, doors: str):
    usual, other = (
        yaml.safe_load((EXPERIMENTS / "floors" / f"{stem}.yaml").read_text(encoding="utf-8"))
        for stem in (name, f"{name}_{doors}")
    )
    assert usual["bounds_m"] == other["bounds_m"]
    assert usual["places"] == other["places"]
    length, wider = (sum(math.dist(wall[:2], wall[2:]) for wall in floor["walls"]) for floor in (usual, other))
    count, width = {"corridor": (11, 1.1), "nested": (16, 0.9)}[name]
    assert length - wider == pytest.approx(count * width if doors == "wide" else 0.0)


@pytest.mark.parametrize(("name", "rooms"), [("corner", 13), ("branch", 13), ("bridge", 16)])
def test_on_floors_drawn_from_the_text_every_helper_passes_every_room_s_door(name: str, rooms: int) -> None:
    """Each has a door of its own, 1.1 m wide, onto a corridor; a helper fits where it patrols."""
    plan = load_floorplan(FloorplanSettings(map=f"{name}.yaml"), EXPERIMENTS / "floors")
    plain = yaml.safe_load((EXPERIMENTS / "floors" / f"{name}.yaml").read_text(encoding="utf-8"))
    walls = sorted(plain["walls"])
    ends = [(one[2:], other[:2]) for one in walls for other in walls]
    gaps = [(a, b) for a, b in ends if math.dist(a, b) == pytest.approx(1.1) and (a[0] == b[0] or a[1] == b[1])]
    doors = {((a[0] + b[0]) / 2, (a[1] + b[1]) / 2) for a, b in gaps}
    assert len(doors) == len(plan.places_m["rooms"]) == rooms
    solid = shapely.MultiLineString([[wall[:2], wall[2:]] for wall in plan.walls_m.tolist()])
    for number in (1, 2, 3):
        way = shapely.LineString(plan.places_m[f"patrol_{number}"])
        assert way.distance(solid) >= 0.45
        assert max(way.distance(shapely.Point(door)) for door in doors) < 1.6


@pytest.mark.parametrize("name", ["corner", "branch", "bridge"])
def test_on_floors_drawn_from_the_text_targets_are_in_the_middle_of_rooms(name: str) -> None:
    """As far from the wall to the left as from that to the right, and so above and below, but for doors."""
    plan = load_floorplan(FloorplanSettings(map=f"{name}.yaml"), EXPERIMENTS / "floors")
    walls = [shapely.LineString([wall[:2], wall[2:]]).buffer(0.6, cap_style="square") for wall in plan.walls_m.tolist()]
    closed = shapely.union_all(walls)  # doors are shut
    for x, y in plan.places_m["rooms"]:
        (room,) = [
            part
            for part in shapely.get_parts(shapely.box(*plan.bounds_m).difference(closed))
            if part.contains(shapely.Point(x, y))
        ]
        assert room.equals(shapely.box(*room.bounds))
        assert (room.centroid.x, room.centroid.y) == pytest.approx((x, y))


def test_a_misspelt_setting_of_reflection_roles_is_refused():
    with pytest.raises(UserError, match="scenario"):
        load_experiment(EXPERIMENTS / "reflection_roles" / "sweep.yaml", ["scenario.teem=3"])


def swept(name: str, sets: list[str], folder: Path) -> Report:
    experiment = load_experiment(EXPERIMENTS / name / "sweep.yaml", sets, quick=True, replicates=2)
    assert run_sweep(experiment, folder, jobs=1).failures == ()
    return report(folder)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "sets", "decided"),
    [
        ("reflection_tables", ["floor=first", "algorithm=visbug", "targets=2"], "reduction_first_visbug"),
        ("reflection_noise", ["floor=first", "algorithm=visbug", "targets=2"], "better_than_alone_visbug"),
        (
            "reflection_channels",
            ["floor=first", "algorithm=avoid_past", "targets=2", "scenario.protocol.parameters.give_up_s=20"],
            "minimal_first_avoid_past_2_kbit",
        ),
        ("reflection_roles", ["algorithm=visbug", "explorers=2", "targets=4"], "several_visbug_2"),
        ("reflection_scaling", ["scenario.duration_s=20", "task=all explore a hall"], "meeting"),
    ],
)
def test_the_quick_sweeps_are_reported(name: str, sets: list[str], decided: str, tmp_path: Path):
    made = swept(name, sets, tmp_path)
    assert made.failures == 0
    assert {verdict.id: verdict.verdict for verdict in made.verdicts}[decided] in ("holds", "fails")
    assert all(path.stat().st_size > 5_000 for path in made.figures)
    assert len(made.figures) >= 2


@pytest.mark.slow
def test_explorers_share_out_the_targets():
    scenario = load_experiment(EXPERIMENTS / "reflection_roles" / "sweep.yaml").base["scenario"]
    told = measure({"scenario": scenario, "explorers": 2, "helpers": 1, "targets": 4}, 1)
    assert set(told) == {column.name for column in COLUMNS}
    assert told["given_up"] in (0.0, 0.25, 0.5, 0.75, 1.0)
    assert 0 < 4 * told["steps"] <= 2 * 10 * told["done_s"]  # ten motion steps a second, of two explorers


def test_roles_that_cannot_be_set_up_are_named():
    base = load_experiment(EXPERIMENTS / "reflection_roles" / "sweep.yaml").base
    with pytest.raises(UserError, match=r"^roles: protocol\.parameters\.target_count: 0 is not > 0$"):
        measure(base | {"explorers": 2, "targets": 1}, 1)


@pytest.mark.slow
def test_the_picture_shows_a_run_with_its_ghosts(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    path = tmp_path / "run.png"
    trajectories.main([str(path), "--set", "algorithm=visbug", "--set", "protocol.parameters.target_count=2"])
    assert path.stat().st_size > 20_000
    assert capsys.readouterr().out.strip() == str(path)
