import json
import math
import shutil
import sys
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import yaml
from click.testing import CliRunner
from scipy import stats

from cosim.cli import commands
from cosim.errors import UserError
from cosim.experiment import load_experiment
from cosim.report.differences import Comparison, compare
from cosim.results import RunStore
from cosim.sweep import run_sweep

FUNCTION = """
from cosim.experiment import experiment_function

def noise(seed):
    return ((seed * 7919) % 101) / 101

@experiment_function
def made(parameters, seed):
    fast, size = parameters["fast"], parameters["size"]
    return {"delay_s": size + noise(seed) + (0.5 + 0.1 * noise(seed + 50) if fast == "no" else 0.0), "rounds": size}

@experiment_function
def seen(parameters, seed):
    factor = 2 if parameters["fast"] == "no" else 1
    return [{"robot": robot, "slots": robot + noise(seed) * factor} for robot in (0, 1)]
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "making.py").write_text(FUNCTION)
    monkeypatch.delitem(sys.modules, "making", raising=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def swept(name: str, **changes: Any) -> Path:
    plain: dict[str, Any] = {"run": "making:made", "parameters": {"size": 2, "fast": "yes"}, "replicates": 6}
    plain |= {"name": "made", "sweep": {"size": [2, 4]}} | changes
    Path(f"{name}.yaml").write_text(yaml.safe_dump(plain))
    run_sweep(load_experiment(f"{name}.yaml"), name, jobs=1)
    return Path(name)


def test_a_folder_does_not_differ_from_itself_nor_from_the_same_sweep_elsewhere():
    one, other = swept("one"), swept("other")
    for second in (one, other, Path(shutil.copytree(one, "third"))):
        found = compare(one, second)
        assert (found.effects, found.settings, found.code, found.notes) == ([], {}, {}, [])
        assert found.compared == 4
        told = (
            "nothing differs in 4 means: every value of a common seed is the same; settings and code are the same too"
        )
        assert told in found.text()


def test_the_difference_is_paired_seed_by_seed():
    one, other = swept("one"), swept("other", parameters={"size": 2, "fast": "no"})
    found = compare(one, other)
    rows = [RunStore(each).present() for each in (one, other)]
    assert [(effect.arm, effect.metric) for effect in found.effects] == [("size=2", "delay_s"), ("size=4", "delay_s")]
    for effect, size in zip(found.effects, (2, 4), strict=True):
        first, second = (each[each["size"] == size].sort_values("seed")["delay_s"] for each in rows)
        interval = stats.ttest_rel(second, first).confidence_interval()
        assert (effect.effect.low, effect.effect.high) == pytest.approx((interval.low, interval.high), rel=1e-9)
        assert effect.correlation == pytest.approx(stats.pearsonr(first, second).statistic)
        assert (effect.seeds, effect.is_apart) == (6, True)
        assert effect.effect.half < 0.2 * first.std()  # two intervals side by side would overlap
    back = compare(other, one)
    assert [(effect.effect.mean, effect.is_apart) for effect in back.effects] == [
        (pytest.approx(-effect.effect.mean), True) for effect in found.effects
    ]
    assert found.settings == {"fast": ("yes", "no")}
    assert "of 4 means 2 differ; the interval (*) of 2 leaves 0 out, which chance alone does in 0.1" in found.text()
    assert "fast: yes | no" in found.text()


def test_other_seeds_are_compared_as_independent_samples():
    one, other = swept("one"), swept("other", seed=100)
    found = compare(one, other)
    effect = found.effects[0]
    rows = [RunStore(each).present().query("size == 2")["delay_s"] for each in (one, other)]
    interval = stats.ttest_ind(rows[1], rows[0], equal_var=False).confidence_interval()
    assert (effect.effect.low, effect.effect.high) == pytest.approx((interval.low, interval.high), rel=1e-9)
    assert effect.seeds == 0
    assert math.isnan(effect.correlation)
    assert "not paired" in found.text()


def test_only_common_seeds_are_paired():
    one, other = swept("one"), swept("other", replicates=4, parameters={"size": 2, "fast": "no"})
    assert {effect.seeds for effect in compare(one, other).effects} == {4}
    more = compare(one, swept("more", replicates=9))  # the same values, and more of them
    assert more.effects == []
    assert more.notes == ["A has 6 seeds, B 9; 6 of them are common"]


def test_two_arms_of_one_folder_are_compared():
    whole = swept("whole", sweep={"size": [2, 4], "fast": ["yes", "no"]})
    found = compare(whole, arms=["fast=yes", "fast=no"])
    assert [effect.arm for effect in found.effects] == ["size=2", "size=4"]
    assert found.settings == {"fast": ("yes", "no")}
    single = compare(whole, arms=["size=2,fast=yes", "size=4,fast=yes"])
    assert [(effect.arm, effect.metric, effect.effect.mean) for effect in single.effects] == [
        ("", "delay_s", pytest.approx(2.0)),
        ("", "rounds", 2.0),
    ]
    same = compare(whole, arms=["size=2", "size=2"])
    assert same.effects == []


def test_what_a_run_counts_more_than_once_counts_with_its_mean():
    one = swept("one", run="making:seen")
    other = swept("other", run="making:seen", parameters={"size": 2, "fast": "no"})
    found = compare(one, other)
    assert {effect.metric for effect in found.effects} == {"slots"}
    assert [effect.seeds for effect in found.effects] == [6, 6]


def test_other_code_and_other_axes_are_told(monkeypatch: pytest.MonkeyPatch):
    one = swept("one", sweep={"size": [2, 4], "fast": ["yes"]})
    Path("making.py").write_text(FUNCTION + "\nversion = 2\n")
    monkeypatch.delitem(sys.modules, "making")  # as in a new process
    other = swept("other", sweep={"size": [4, 8]})
    found = compare(one, other)
    assert list(found.code) == ["digest of the sources"]
    assert found.settings == {"sweep.fast": ("yes", "-")}
    assert found.notes == ["only one of them has runs of size=2; size=8"]
    assert "code and libraries that differ, A | B" in found.text()


def test_a_bootstrap_gives_other_intervals_about_the_same_mean():
    one, other = swept("one", replicates=12), swept("other", replicates=12, parameters={"size": 2, "fast": "no"})
    ours, theirs = (compare(one, other, bootstrap=each).effects[0].effect for each in (False, True))
    assert ours.mean == pytest.approx(theirs.mean)
    assert ours.low != theirs.low
    assert theirs.low == pytest.approx(ours.low, abs=ours.half)


@pytest.mark.parametrize(
    ("arms", "told"),
    [
        (["size=2"], "one: expected another folder to compare with, or two --arm axis=value"),
        ([], "one: expected another folder to compare with, or two --arm axis=value"),
        (["size=2", "sizes=4"], "--arm sizes=4: there is no axis sizes, did you mean size"),
        (["size=2", "size=3"], "--arm size=3: one has no runs of it"),
    ],
)
def test_what_cannot_be_compared_is_told(arms: list[str], told: str):
    swept("one")
    with pytest.raises(UserError) as raised:
        compare(Path("one"), arms=arms)
    assert told in str(raised.value)


def test_two_folders_and_arms_are_too_much_and_nothing_in_common_too_little():
    one, other = swept("one"), swept("other", run="making:seen")
    with pytest.raises(UserError, match="--arm is for two arms of one folder"):
        compare(one, other, ["size=2", "size=4"])
    with pytest.raises(UserError, match="one and other have no arm and metric in common"):
        compare(one, other)


def test_the_command_prints_a_table_or_json():
    swept("one"), swept("other", parameters={"size": 2, "fast": "no"})
    assert "B - A" in CliRunner().invoke(commands, ["compare", "one", "other"]).output
    made = json.loads(CliRunner().invoke(commands, ["compare", "one", "other", "--json"]).output)
    assert [each["metric"] for each in made["effects"]] == ["delay_s", "delay_s"]
    assert made["settings"] == {"fast": ["yes", "no"]}
    assert pd.DataFrame(made["effects"])["is_apart"].all()
    assert isinstance(compare(Path("one"), Path("one")), Comparison)
