"""Indices of functions whose indices are known in closed form, from sweeps of them and from SALib's own samples."""

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from cosim.cli import commands
from cosim.errors import UserError
from cosim.experiment import load_experiment
from cosim.report import sweep_report
from cosim.report.drawing import draw
from cosim.report.sensitivity import design_of, design_rows, indices, sensitivity
from cosim.report.sweep_report import report
from cosim.results import RunStore
from cosim.statistics.designs import points
from cosim.sweep import run_sweep
from tests.tiers import soak_count

pytest.importorskip("SALib")

A, B = 7.0, 0.1
FUNCTION = f"""
import math
from cosim.experiment import experiment_function

@experiment_function
def ishigami(parameters, seed):
    x, y, z = (parameters[name] for name in "xyz")
    made = math.sin(x) + {A} * math.sin(y) ** 2 + {B} * z**4 * math.sin(x)
    return {{"height": made + 0.001 * seed, "flat": 3.0, "holes": math.nan if x > 2 else made}}
"""


def closed_form() -> dict[str, tuple[float, float]]:
    """First order and total indices of Ishigami's function (Ishigami and Homma, 1990), by axis."""
    alone_x = 0.5 * (1 + B * math.pi**4 / 5) ** 2
    alone_y = A**2 / 8
    both = 8 * B**2 * math.pi**8 / 225
    whole = alone_x + alone_y + both
    return {"x": (alone_x / whole, (alone_x + both) / whole), "y": (alone_y / whole,) * 2, "z": (0.0, both / whole)}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "ishi.py").write_text(FUNCTION)
    monkeypatch.delitem(sys.modules, "ishi", raising=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def swept(design: Any, replicates: int = 1, **axes: Any) -> Path:
    span = {"low": -math.pi, "high": math.pi}
    sweep = {name: {"path": name, **span} for name in "xyz"} | axes
    plain = {"run": "ishi:ishigami", "parameters": dict.fromkeys("xyz", 0.0), "sweep": sweep, "design": design}
    Path("sweep.yaml").write_text(
        yaml.safe_dump(plain | {"name": "ishigami", "replicates": replicates}, sort_keys=False)
    )
    run_sweep(load_experiment("sweep.yaml"), "r", jobs=1)
    return Path("r")


def worst(count: int, seed: int) -> float:
    """Return how far the indices by *count* base points are off the closed form, at worst."""
    rows = points("saltelli", count, 3, seed)
    x, y, z = (2 * rows - 1).T * math.pi
    values = np.sin(x) + A * np.sin(y) ** 2 + B * z**4 * np.sin(x)
    found = indices("saltelli", ["x", "y", "z"], [tuple(row) for row in rows.tolist()], values)
    true = closed_form()
    return max(
        abs(row[name] - true[row["axis"]][at]) for row in found for at, name in enumerate(("first_order", "total"))
    )


def test_sobols_indices_of_ishigamis_function_are_those_of_the_closed_form():
    assert closed_form()["x"] == pytest.approx((0.3139, 0.5576), abs=1e-4)  # as books print them
    assert closed_form()["y"][0] == pytest.approx(0.4424, abs=1e-4)
    assert worst(4096, 1) <= 0.05


@pytest.mark.soak
def test_sobols_indices_are_close_for_many_seeds():
    seeds = soak_count(20)
    found = {count: max(worst(count, seed) for seed in range(seeds)) for count in (256, 1024, 4096)}
    print(f"Ishigami, largest deviation of an index from the closed form, {seeds} seeds")
    for count, value in found.items():
        print(f"  {count:5d} base points ({5 * count} runs): {value:.3f}")
    assert found[4096] <= 0.05


def test_a_sweep_tells_which_axis_matters():
    found = sensitivity(swept({"kind": "saltelli", "points": 128}, replicates=2))
    assert (found.design, found.points) == ("saltelli", 640)
    assert found.table["metric"].unique().tolist() == ["height"]  # flat does not vary, holes has not all values
    assert found.notes == [next(note for note in found.notes if note.startswith("holes: "))]
    assert "points have no value, and the design needs all" in found.text()
    true = closed_form()
    for row in found.table.to_dict("records"):
        assert abs(row["first_order"] - true[row["axis"]][0]) <= row["first_half"] + 0.05
        assert abs(row["total"] - true[row["axis"]][1]) <= row["total_half"] + 0.05
    told = RunStore(Path("r")).description()
    assert len(design_rows(told)) == 640


def test_morriss_effects_are_those_of_the_steps():
    found = sensitivity(swept({"kind": "morris", "points": 20}))
    rows = found.table.set_index("axis")
    assert found.design == "morris"
    # on the levels -pi, -pi/3, pi/3, pi a step of y is between 0 and 7 * 0.75 of sin^2: always that, over two thirds
    assert rows.loc["y", "mu_star"] == pytest.approx(7 * 0.75 / (2 / 3), rel=1e-5)
    assert rows.loc["y", "mu_star_half"] == pytest.approx(0.0, abs=1e-9)
    assert rows.loc["z", "sigma"] > rows.loc["z", "mu"]  # it depends on x


def test_points_that_fall_together_are_one_arm_and_count_each_time():
    few = {"x": {"path": "x", "low": 0, "high": 1}, "y": {"path": "y", "values": {"low": 0.0, "high": 1.0}}}
    folder = swept({"kind": "saltelli", "points": 16}, **few, z={"path": "z", "values": [1.0]})
    told = RunStore(folder).description()
    assert len(told.configurations) < len(design_rows(told)) == 16 * 5
    found = sensitivity(folder).table.set_index(["metric", "axis"])
    assert found.loc[("height", "z"), "total"] == 0.0  # it has one value
    assert found.loc[("height", "y"), "total"] > 0.5


def test_designs_are_known_by_their_shape():
    def rows(kind: str, count: int, axes: int) -> list[tuple[float, ...]]:
        return [tuple(row) for row in points(kind, count, axes, 1).tolist()]

    assert design_of(rows("saltelli", 4, 3)) == "saltelli"
    assert design_of(rows("morris", 4, 3)) == "morris"
    assert design_of(rows("sobol", 16, 3)) is None
    assert design_of(rows("latin hypercube", 20, 3)) is None
    assert design_of(rows("saltelli", 4, 3)[1:]) is None
    assert design_of(rows("morris", 4, 1)) is None
    assert design_of([(0.0, 0.0), (1.0, 0.0), (0.5, 0.0)]) is None  # one axis moves twice
    assert design_of([]) is None


def test_another_design_has_no_indices():
    with pytest.raises(UserError, match=r"r: expected a sweep of two axes or more with the design saltelli or morris"):
        sensitivity(swept({"kind": "latin hypercube", "points": 12}))


def test_a_library_that_is_missing_is_told(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("cosim.report.sensitivity.NEEDS", ("no_such_library>=1",))
    with pytest.raises(UserError, match=r"sensitivities need what is not installed here: pip install"):
        sensitivity(Path("r"))


@pytest.mark.slow
def test_a_report_of_drawn_arms_has_one_line_of_points(monkeypatch: pytest.MonkeyPatch):
    told: list[Any] = []
    monkeypatch.setattr(sweep_report, "draw", lambda *given: told.append(given[1]) or draw(*given))
    made = report(swept({"kind": "latin hypercube", "points": 30}))
    assert made.figures[0].name == "height.png"
    assert told == [["x"]] * len(told)
    assert sum(len(table) for table in made.tables.values()) == 30


def test_the_command_prints_a_table_or_json():
    swept({"kind": "morris", "points": 4})
    ran = CliRunner().invoke(commands, ["sensitivity", "r"])
    assert "ishigami, morris, 16 points" in ran.output
    assert "mu_star" in ran.output
    assert '"design": "morris"' in CliRunner().invoke(commands, ["sensitivity", "r", "--json"]).output
