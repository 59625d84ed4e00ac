import math
import shutil
import sys
from datetime import date
from pathlib import Path
from typing import Any

import pytest
import yaml

from cosim.documents import read_yaml
from cosim.errors import UserError
from cosim.experiment import (
    Experiment,
    axis_titles,
    base_scenario,
    experiment_folders,
    find_beside,
    find_experiment,
    find_function,
    is_experiment,
    load_experiment,
)
from tests.checkout import DATA

SCENARIO = {"duration_s": 5, "protocol": {"use": "beacon:SPEC"}}
SWEEP: dict[str, Any] = {
    "scenario": SCENARIO,
    "sweep": {
        "team.size": [2, 4],
        "radio": {"path": "channel", "values": {"near": {"kind": "ideal"}, "far": {"kind": "ideal", "delay_s": 1}}},
    },
    "replicates": 3,
    "quick": {"replicates": 1, "sweep": {"size": [2], "radio": ["far"]}, "set": {"protocol.parameters.calls": 1}},
}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in a folder that holds a user's own protocol and functions."""
    for name in ("beacon.py", "delays.py"):
        shutil.copy(DATA / name, tmp_path)
    for name in ("beacon", "delays"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def written(plain: dict[str, object]) -> Path:
    path = Path("sweep.yaml")
    path.write_text(yaml.safe_dump(plain, sort_keys=False))
    return path


def complaint(plain: dict[str, object], *sets: str, quick: bool = False) -> str:
    with pytest.raises(UserError) as raised:
        load_experiment(written(plain), sets, quick)
    assert "\n" not in str(raised.value)
    return str(raised.value)


def test_arms_are_the_product_of_the_axes_in_order():
    experiment = load_experiment(written(SWEEP))
    assert [arm.labels for arm in experiment.arms] == [
        {"size": 2, "radio": "near"},
        {"size": 2, "radio": "far"},
        {"size": 4, "radio": "near"},
        {"size": 4, "radio": "far"},
    ]
    assert [arm.scenario.channel.delay_s for arm in experiment.arms if arm.scenario] == [1e-6, 1, 1e-6, 1]
    assert len({arm.configuration for arm in experiment.arms}) == 4
    assert (experiment.replicates, experiment.seed) == (3, 1)


def test_an_experiment_is_called_like_its_folder(folder: Path):
    assert load_experiment(written(SWEEP)).name == folder.name
    assert load_experiment(written(SWEEP | {"name": "calls"})).name == "calls"


def test_quick_cuts_axes_replicates_and_settings_down():
    experiment = load_experiment(written(SWEEP), quick=True)
    (arm,) = experiment.arms
    assert arm.labels == {"size": 2, "radio": "far"}
    assert arm.scenario is not None
    assert arm.scenario.channel.delay_s == 1
    assert arm.scenario.protocol.parameters.calls == 1
    assert experiment.replicates == 1


def test_a_value_on_the_command_line_is_all_that_is_left_of_its_axis():
    experiment = load_experiment(written(SWEEP), ["team.size=3", "duration_s=7"])
    assert [arm.labels["size"] for arm in experiment.arms] == [3, 3]
    assert {arm.scenario.duration_s for arm in experiment.arms if arm.scenario} == {7}


def test_an_axis_on_the_command_line_may_go_by_its_column():
    experiment = load_experiment(written(SWEEP), ["size=3", "radio=far"])
    (arm,) = experiment.arms
    assert arm.labels == {"size": 3, "radio": "far"}
    assert arm.scenario is not None
    assert (arm.scenario.team.size, arm.scenario.channel.delay_s) == (3, 1)
    assert base_scenario(Path("sweep.yaml"), ["size=3"]).team.size == 3
    assert complaint(SWEEP, "size=9").startswith("--set size=9: 9 is more than the 8 robots")


def test_a_setting_goes_before_an_axis_of_its_name():
    plain = SWEEP | {"sweep": {"name": {"path": "team.size", "values": [2, 4]}}}
    experiment = load_experiment(written(plain), ["name=three"])
    assert [(arm.labels["name"], arm.scenario.name) for arm in experiment.arms if arm.scenario] == [
        (2, "three"),
        (4, "three"),
    ]


def test_the_parameters_of_every_arm_are_validated_if_the_function_says_how(folder: Path):
    checked = "class Parameters(Settings):\n    size: int = Field(ge=2, le=8)\n"
    imports = "from delays import metrics\nfrom pydantic import Field\nfrom cosim.settings import Settings\n"
    (folder / "checked_delays.py").write_text(imports + checked)
    plain = {"run": "checked_delays:metrics", "parameters": {"size": 2}, "sweep": {"size": [2, 8]}}
    assert [arm.parameters for arm in load_experiment(written(plain)).arms] == [{"size": 2}, {"size": 8}]
    assert complaint(plain, "size=9") == "--set size=9: 9 is not <= 8"
    assert complaint(plain | {"sweep": {"size": [2, 9]}}) == "sweep.yaml: parameters with size=9: 9 is not <= 8"
    assert complaint(plain | {"parameters": {"size": 1}}) == "sweep.yaml: parameters: size: 1 is not >= 2"


def test_a_wrong_value_on_the_command_line_of_an_axis_is_told():
    assert complaint(SWEEP, "team.size=9").startswith("--set team.size=9: 9 is more than the 8 robots")


def test_a_scenario_may_stand_in_a_file_of_its_own():
    Path("scenarios").mkdir()
    Path("scenarios/base.yaml").write_text(yaml.safe_dump(SCENARIO))
    path = written(SWEEP | {"scenario": "scenarios/base.yaml"})
    arms = load_experiment(path).arms
    assert {arm.scenario.folder for arm in arms if arm.scenario} == {Path("scenarios")}
    assert base_scenario(path, ["team.size=2"]).team.size == 2


def test_a_function_runs_on_parameters():
    plain = {"run": "delays:metrics", "parameters": {"size": 1}, "sweep": {"size": [2, 3]}, "seed": 4}
    experiment = load_experiment(written(plain))
    assert [arm.parameters for arm in experiment.arms] == [{"size": 2}, {"size": 3}]
    assert experiment.seed == 4


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"parameters": {"size": math.nan}}, "sweep.yaml: parameters.size: nan is not a finite number"),
        (
            {"parameters": {"size": [2**64]}},
            "sweep.yaml: parameters.size[0]: 18446744073709551616 is not an integer of",
        ),
        (
            {"parameters": {"size": date(2024, 1, 1)}},
            "sweep.yaml: parameters.size: datetime.date(2024, 1, 1) is a date, exp",
        ),
        ({"sweep": {"size": [1, math.inf]}}, "sweep.yaml: sweep.size.values[1]: inf is not a finite number"),
        ({"quick": {"set": {"size": math.inf}}}, "sweep.yaml: quick.set.size: inf is not a finite number"),
    ],
)
def test_parameters_of_a_function_without_a_model_are_plain_data(change: dict[str, object], expected: str):
    assert complaint({"run": "delays:metrics", "parameters": {"size": 1}, **change}).startswith(expected)
    assert complaint({"run": "delays:metrics", "parameters": {"size": 1}}, "size=.nan") == (
        "--set size=.nan: nan is not a finite number"
    )


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (
            {"sweep": {"team.szie": [1]}},
            "sweep.yaml: scenario with team.szie=1: there is no team.szie, did you mean size?",
        ),
        ({"sweep": {"team.size": [4, 9]}}, "sweep.yaml: scenario with team.size=9: 9 is more than the 8 robots that "),
        ({"sweep": {"team.size": []}}, "sweep.yaml: sweep.team.size.values: [] is not a list of values, or a mapping"),
        (
            {"sweep": {"channel": [{"kind": "ideal"}]}},
            "sweep.yaml: sweep.channel.values: [{'kind': 'ideal'}] holds values",
        ),
        (
            {"sweep": {"s": {"path": "seed", "values": [1, 2]}}},
            "sweep.yaml: sweep.s.path: 'seed' is not the path of a setting that can be an axis",
        ),
        ({"scenario": SCENARIO | {"tick_s": -1}}, "sweep.yaml: scenario: tick_s: -1 is not > 0"),
        ({"scenario": None}, "sweep.yaml: "),
        (
            {"scenario": None, "run": "nowhere:f"},
            "sweep.yaml: run: 'nowhere:f' is not module:function: No module named",
        ),
        ({"replicates": 0}, "sweep.yaml: replicates: 0 is not >= 1"),
        (
            {"seed": 4},
            "sweep.yaml: seed: 4 is for a function that run names, expected in scenario: there is a scenario",
        ),
        (
            {"parameters": {"tick_s": 1}},
            "sweep.yaml: parameters: is for a function that run names, expected in scenario: there is a scenario",
        ),
        (
            {"replicate": 1},
            "sweep.yaml: replicate: 1 is not expected here: there is no such key, did you mean replicates?",
        ),
    ],
)
def test_a_wrong_experiment_is_told_in_one_line(change: dict[str, object], expected: str):
    assert complaint(SWEEP | change).startswith(expected)


@pytest.mark.parametrize(
    ("run", "expected"),
    [
        ("subprocess:Popen", "is of Python's own library, expected a function of an experiment"),
        ("os.path:join", "is of Python's own library, expected a function of an experiment"),
        ("yaml:safe_load", "is not marked with @experiment_function of cosim.experiment"),
        ("delays:time", "is not marked with @experiment_function of cosim.experiment"),
        ("unmarked:anything", "is not marked with @experiment_function of cosim.experiment"),
        ("delays", "is not module:function"),
        ("delays:", "is not module:function"),
        ("..delays:metrics", "is not module:function"),
        ("delays:metrics.__call__", "is not module:function"),
        ("delays:nothing", "is not module:function: module 'delays' has no attribute 'nothing'"),
    ],
)
def test_a_document_has_no_function_called_that_is_not_marked(folder: Path, run: str, expected: str):
    (folder / "unmarked.py").write_text(
        "def __getattr__(name):\n    return __import__('unittest.mock').mock.MagicMock()\n"
    )
    assert complaint({"run": run}) == f"sweep.yaml: run: {run!r} {expected}"


def test_a_function_of_pythons_own_library_is_refused_without_importing_it(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("cosim.experiment.import_module", lambda name: pytest.fail(f"{name} was imported"))
    assert complaint({"run": "antigravity:fly"}).startswith("sweep.yaml: run: 'antigravity:fly' is of Python's own")


@pytest.mark.slow
def test_the_functions_of_our_experiments_are_marked():
    documents = sorted(path for folder in experiment_folders().values() for path in folder.glob("*.yaml"))
    runs = [plain["run"] for plain in map(read_yaml, documents) if is_experiment(plain) and "run" in plain]
    assert len(runs) > 20
    for run in runs:
        assert find_function(run, "").__module__ == run.partition(":")[0]


def test_a_quick_axis_that_is_none_is_told():
    quick = {"sweep": {"team": [2]}}
    assert complaint(SWEEP | {"quick": quick}, quick=True).startswith(
        "sweep.yaml: quick.sweep.team: there is no such axis"
    )


@pytest.mark.parametrize("key", ["x", "panel"])
def test_an_axis_of_the_report_that_is_none_is_told_before_anything_runs(key: str):
    told = f"sweep.yaml: report.{key}: sise: there is no such axis, did you mean size?"
    assert complaint(SWEEP | {"report": {key: "sise"}}) == told


def test_columns_have_names_of_their_own():
    plain = SWEEP | {"sweep": {"team.size": [2], "floorplan.office.seed": [1, 2]}}
    assert [axis.name for axis in load_experiment(written(plain)).axes] == ["size", "office_seed"]
    plain = {
        "run": "delays:metrics",
        "parameters": {"seed": 1},
        "sweep": {"seed": {"path": "parameters", "values": [1]}},
    }
    assert complaint(plain).startswith("sweep.yaml: sweep.seed: the column seed is taken, expected another name")


def test_installed_experiments_are_found_by_name():
    assert find_experiment("pseudonet_coverage") == experiment_folders()["pseudonet_coverage"] / "sweep.yaml"


def test_a_file_beside_an_experiment_is_found_by_its_name_if_there_is_one():
    folders = experiment_folders()
    wean = folders["deployment_wean"]
    for name in ("deployment_wean", str(wean)):
        assert find_beside(name, "playbook.yaml") == wean / "playbook.yaml"
        assert find_beside(name, None) == wean / "sweep.yaml"
    assert find_beside(str(wean / "sweep.yaml"), "playbook.yaml") == wean / "sweep.yaml"  # who names a file means it
    assert find_beside("deployment_channels", "playbook.yaml") == folders["deployment_channels"] / "sweep.yaml"
    with pytest.raises(
        UserError, match=r"^pseudonet_covrage: is neither .*, did you mean pseudonet_coverage( or .*)?\?$"
    ):
        find_experiment("pseudonet_covrage")


@pytest.mark.slow
def test_the_coverage_experiment_is_valid_as_it_stands():
    experiment = load_experiment(find_experiment("pseudonet_coverage"))
    assert [axis.name for axis in experiment.axes] == ["algorithm", "team_size", "channel", "floor"]
    assert experiment.replicates == 10
    assert len(load_experiment(find_experiment("pseudonet_coverage"), quick=True).arms) < len(experiment.arms)


# ---------------------------------------------------------------- axes of several settings

SEVERAL = {
    "scenario": SCENARIO,
    "sweep": {
        "team.size": [2, 4],
        "radio": {"values": {"usual": {}, "far": {"channel.delay_s": 1, "protocol.parameters.calls": 7}}},
    },
    "quick": {"sweep": {"radio": ["far"]}},
}


def radios(experiment: Experiment) -> list[tuple[object, ...]]:
    """Return the size, the radio, its delay and the calls of each arm."""
    scenarios: list[Any] = [arm.scenario for arm in experiment.arms]
    return [
        (*arm.labels.values(), scenario.channel.delay_s, scenario.protocol.parameters.calls)
        for arm, scenario in zip(experiment.arms, scenarios, strict=True)
    ]


def test_an_axis_without_a_path_changes_several_settings():
    calls = base_scenario(written(SEVERAL)).protocol.parameters.calls  # type: ignore[attr-defined]
    usual = [(size, "usual", 1e-6, calls) for size in (2, 4)]
    far = [(size, "far", 1, 7) for size in (2, 4)]
    assert radios(load_experiment(written(SEVERAL))) == [usual[0], far[0], usual[1], far[1]]
    assert radios(load_experiment(written(SEVERAL), quick=True)) == far


def test_such_an_axis_is_given_on_the_command_line_by_the_name_of_a_value_or_by_settings():
    path = written(SEVERAL)
    assert radios(load_experiment(path, ["radio=far", "size=2"])) == [(2, "far", 1, 7)]
    ((_, label, delay_s, _),) = radios(load_experiment(path, ["radio={channel.delay_s: 3}", "size=2"]))
    assert (label, delay_s) == ("{'channel.delay_s': 3}", 3)
    assert base_scenario(path, ["radio=far"]).channel.delay_s == 1  # type: ignore[union-attr]
    for value in ("near", "{1: 2}"):
        message = complaint(SEVERAL, f"radio={value}")
        assert message == f"--set radio={value}: expected one of usual, far, or settings by their paths"


@pytest.mark.parametrize(
    ("axis", "expected"),
    [
        ({"values": [1, 2]}, "sweep.yaml: sweep.radio.values: "),
        ({"values": {"far": 3}}, "sweep.yaml: sweep.radio.values: "),
        ({"values": {"far": {"": 3}}}, "sweep.yaml: sweep.radio.values: "),
        ({"values": {"far": {"channel.delay": 3}}}, "sweep.yaml: scenario with radio=far: there is no channel.delay"),
    ],
)
def test_a_value_of_such_an_axis_that_is_no_settings_is_told(axis: dict[str, object], expected: str):
    assert complaint(SEVERAL | {"sweep": {"radio": axis}, "quick": {}}).startswith(expected)


def test_a_quick_value_that_such_an_axis_does_not_name_is_told():
    message = complaint(SEVERAL | {"quick": {"sweep": {"radio": ["near"]}}}, quick=True)
    assert message.startswith("sweep.yaml: quick.sweep.radio: expected, by name, mappings")


def test_parameters_of_a_function_have_their_defaults_so_that_axes_may_name_them(folder: Path):
    model = "\n\nclass Parameters(Settings):\n    scenario: Scenario\n    times: int = 2\n"
    imports = "from cosim.scenario import Scenario\nfrom cosim.settings import Settings\n"
    (folder / "delays.py").write_text(imports + (folder / "delays.py").read_text() + model)
    far = {"scenario.channel.kind": "adhoc", "scenario.channel.range_m": 5, "times": 3}
    plain = {
        "run": "delays:metrics",
        "parameters": {"scenario": SCENARIO},
        "sweep": {"radio": {"values": {"usual": {}, "far": far}}},
    }
    usual, other = (arm.parameters for arm in load_experiment(written(plain)).arms)
    assert (usual["times"], usual["scenario"]["channel"]["kind"]) == (2, "ideal")
    assert (other["times"], other["scenario"]["channel"]["kind"], other["scenario"]["channel"]["range_m"]) == (
        3,
        "adhoc",
        5,
    )


def test_figures_call_the_values_of_an_axis_by_their_titles(folder: Path):
    size = {"path": "team.size", "values": [2, 4], "titles": {4: "four"}}
    titled = SWEEP["sweep"]["radio"] | {"titles": {"far": "far off"}}
    plain = load_experiment(written(SWEEP))
    named = load_experiment(written(SWEEP | {"sweep": {"size": size, "radio": titled}}))
    assert axis_titles(folder) == {"size": {2: "2", 4: "four"}, "radio": {"near": "near", "far": "far off"}}
    assert [arm.configuration for arm in named.arms] == [arm.configuration for arm in plain.arms]  # the same runs


@pytest.mark.parametrize(
    ("axis", "expected"),
    [
        (
            SWEEP["sweep"]["radio"] | {"titles": {"fra": "far off"}},
            "sweep.axis.titles: 'far off' is the title of fra, which is no value, did you mean far?",
        ),
        (
            {"path": "team.size", "values": [2, 4], "titles": {3: "three"}},
            "sweep.axis.titles: 'three' is the title of 3, which is no value, expected one of 2, 4",
        ),
        (
            {"path": "team.size", "low": 2, "high": 4, "titles": {2: "two"}},
            "sweep.axis.titles: 'two' is the title of 2, which is no value, nothing is expected there",
        ),
    ],
)
def test_a_title_of_what_is_no_value_of_its_axis_is_told(axis: dict[str, Any], expected: str):
    assert expected in complaint(SWEEP | {"sweep": {"axis": axis}})


@pytest.mark.parametrize("titles", [{4: 5}, ["four"], "four"])
def test_titles_that_are_no_texts_by_value_are_refused(folder: Path, titles: Any):
    size = {"path": "team.size", "values": [2, 4], "titles": titles}
    with pytest.raises(UserError, match=r"sweep\.size\.titles: .*is not a mapping of values"):
        load_experiment(written(SWEEP | {"sweep": {"size": size}}))


# ---------------------------------------------------------------- designs

DRAWN: dict[str, Any] = {
    "scenario": SCENARIO,
    "sweep": {
        "team.size": {"path": "team.size", "low": 2, "high": 8},
        "delay_s": {"path": "channel.delay_s", "low": 0.001, "high": 1, "log": True},
        "calls": {"path": "protocol.parameters.calls", "values": [1, 2]},
    },
    "design": {"kind": "sobol", "points": 16},
    "quick": {"points": 4, "replicates": 1},
}


@pytest.mark.parametrize(("kind", "count"), [("sobol", 16), ("latin hypercube", 16), ("saltelli", 80), ("morris", 64)])
def test_drawn_points_are_arms(kind: str, count: int):
    experiment = load_experiment(written(DRAWN | {"design": {"kind": kind, "points": 16}}))
    labels = [arm.labels for arm in experiment.arms]
    assert len({tuple(each.values()) for each in labels}) == len(labels) <= count
    rows = list(zip(*(axis.values for axis in experiment.axes), strict=True))
    assert len(rows) == count  # the axes keep the design: points that fell together are one arm
    assert {tuple(label for label, _ in row) for row in rows} == {tuple(each.values()) for each in labels}
    for arm in experiment.arms:
        assert arm.scenario is not None
        assert arm.scenario.team.size == arm.labels["size"]
        assert arm.scenario.channel.delay_s == arm.labels["delay_s"]
    assert {type(each["size"]) for each in labels} == {int}
    assert {each["size"] for each in labels} <= set(range(2, 9))
    assert {each["calls"] for each in labels} == {1, 2}
    assert min(each["delay_s"] for each in labels) < 0.03  # half of them, evenly by the logarithm
    assert max(each["delay_s"] for each in labels) <= 1


def test_the_same_points_are_drawn_again_and_others_for_another_seed():
    labels = [arm.labels for arm in load_experiment(written(DRAWN)).arms]
    assert labels == [arm.labels for arm in load_experiment(written(DRAWN)).arms]
    assert labels != [arm.labels for arm in load_experiment(written(DRAWN), ["seed=2"]).arms]


def test_quick_draws_fewer_points_and_a_set_fixes_an_axis():
    assert len(load_experiment(written(DRAWN), quick=True).arms) == 4
    experiment = load_experiment(written(DRAWN), ["size=3"])
    assert {arm.labels["size"] for arm in experiment.arms} == {3}
    assert len(experiment.arms) == 16


def test_a_whole_number_is_drawn_only_where_the_setting_is_one():
    sweep = {"duration": {"path": "duration_s", "low": 1, "high": 9}}
    experiment = load_experiment(written({"scenario": SCENARIO, "sweep": sweep, "design": DRAWN["design"]}))
    assert len({arm.labels["duration"] for arm in experiment.arms}) == 16


@pytest.mark.parametrize(("low", "high", "kind"), [(1, 3, int), (1.0, 3.0, float), (1, 3.5, float)])
def test_what_has_no_model_is_whole_if_its_bounds_are(low: float, high: float, kind: type):
    sweep = {"size": {"path": "size", "low": low, "high": high}}
    plain = {"run": "delays:metrics", "parameters": {"size": 2}, "sweep": sweep, "design": DRAWN["design"]}
    assert {type(arm.labels["size"]) for arm in load_experiment(written(plain)).arms} == {kind}


def test_one_at_a_time_varies_each_axis_beside_the_first_values():
    sweep = SWEEP["sweep"] | {"protocol.parameters.calls": [1, 2, 3]}
    experiment = load_experiment(written(SWEEP | {"sweep": sweep, "design": "one at a time"}))
    assert [tuple(arm.labels.values()) for arm in experiment.arms] == [
        (2, "near", 1),
        (4, "near", 1),
        (2, "far", 1),
        (2, "near", 2),
        (2, "near", 3),
    ]


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (
            {"design": {"kind": "sobol", "points": 48}},
            "design.points: 48 is not a power of two, and sobol loses its balance: expected 32 or 64",
        ),
        ({"design": {"kind": "saltelli", "points": 3}}, "expected 2 or 4"),
        ({"design": "sobol"}, "sobol: expected points, how many to draw"),
        ({"design": {"kind": "product", "points": 3}}, "design.points: 3 is not for product, which takes all values"),
        ({"design": "hypercube"}, "design.kind: 'hypercube'"),
        ({"design": "product"}, "sweep.size: low and high are for a design that draws, not product"),
        ({"sweep": {}}, "design: 'sobol' expected a sweep, of axes to draw from"),
        ({"sweep": {"team.size": {"path": "team.size", "low": 2}}}, "expected either values, or low and high"),
        ({"sweep": {"team.size": {"path": "team.size"}}}, "expected either values, or low and high"),
        (
            {"sweep": {"team.size": {"path": "team.size", "values": [2, 4], "log": True}}},
            "log: True is for low and high",
        ),
        (
            {"sweep": {"team.size": {"path": "team.size", "low": 2, "high": 3, "values": [2]}}},
            "expected either values, or low and high",
        ),
        ({"sweep": {"team.size": {"path": "team.size", "low": 4, "high": 2}}}, "high: 2 is not > 4, which is low"),
        (
            {"sweep": {"team.size": {"path": "team.size", "low": 0, "high": 2, "log": True}}},
            "low: 0 is not > 0, and has no logarithm",
        ),
        ({"sweep": {"team.size": {"low": 2, "high": 4}}}, "path, of one setting"),
        ({"quick": {"points": 3}}, ""),
    ],
)
def test_what_is_wrong_with_a_design_is_told(changes: dict[str, Any], told: str):
    if told:
        assert told in complaint(DRAWN | changes)
    else:
        assert "quick: points: 3 is not a power of two" in complaint(DRAWN | changes, quick=True)


def test_a_drawn_arm_that_no_run_could_have_is_told():
    sweep = DRAWN["sweep"] | {"delay_s": {"path": "channel.delay_s", "low": -1.0, "high": 1.0}}
    assert "with channel.delay_s=-" in complaint(DRAWN | {"sweep": sweep})
