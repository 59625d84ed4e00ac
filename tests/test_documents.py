"""Documents as people, or their programs, may write them: what is read, what is refused, and in which words."""

import os
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from pydantic import Field, model_validator

from cosim.documents import MOST_VALUES, read_bytes, read_yaml, validated
from cosim.errors import UserError
from cosim.experiment import ExperimentSettings, base_scenario, is_experiment
from cosim.scenario import build, dump, load
from cosim.settings import Count, Seconds, Settings, error_at
from cosim.world.floorplan import FloorSettings
from protocols.deployment.planning.play import Play
from tests.checkout import ROOT


def complaint(path: Path, text: str) -> str:
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UserError) as raised:
        read_yaml(path)
    return str(raised.value).removeprefix(f"{path}: ")


# ---------------------------------------------------------------- files


def test_only_regular_files_are_read(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe")
    for path, what in ((tmp_path / "pipe", "a pipe or a device"), (Path("/dev/zero"), "a pipe or a device")):
        with pytest.raises(UserError, match=f"{path}: cannot be read, expected a file: is {what}$"):
            read_bytes(path)


def test_a_name_that_no_file_can_have_names_none():
    for name in ("x" * 5000, "a\0b"):
        with pytest.raises(UserError, match="cannot be read, expected a file"):
            read_bytes(Path(name))


def test_a_document_is_not_larger_than_it_may_be(tmp_path: Path):
    (tmp_path / "four").write_bytes(b"1234")
    assert read_bytes(tmp_path / "four", 4) == b"1234"
    with pytest.raises(UserError, match=r"four: is larger than .* MB, the most that is read"):
        read_bytes(tmp_path / "four", 3)


# ---------------------------------------------------------------- YAML


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ("!!timestamp x", "'x' is no timestamp"),
        ("!!timestamp 0001-13-01", "'0001-13-01' is no timestamp: month must be in 1..12"),
        ("!!int ''", "'' is no int"),
        ("!!float ''", "'' is no float"),
        ("!!bool x", "'x' is no bool"),
        ("!!int x", "'x' is no int: invalid literal"),
        ("1:" * 200 + "1.5", "'1:1:"),
        ('"\\ud800"', "'\\ud800' is no str: "),
        ("&a [*a]", "stands within itself"),
    ],
)
def test_a_value_that_its_tag_does_not_fit_is_told_with_its_line(tmp_path: Path, value: str, expected: str):
    assert complaint(tmp_path / "x.yaml", f"b: 1\na: {value}\n").startswith(f"line 2, column 4: {expected}")


@pytest.mark.parametrize("link", ["[{}]", "{{<<: [{}]}}"])
def test_aliases_that_unfold_to_too_much_are_refused_at_once(tmp_path: Path, link: str):
    lines = ["a0: &a0 {x: 1, y: 2}"]
    lines += [f"a{n}: &a{n} " + link.format(", ".join([f"*a{n - 1}"] * 9)) for n in range(1, 12)]
    said = complaint(tmp_path / "x.yaml", "\n".join(lines))
    assert said.endswith(f"holds more than {MOST_VALUES} values")


def test_aliases_that_say_the_same_a_few_times_are_fine(tmp_path: Path):
    (tmp_path / "x.yaml").write_text("a: &a {b: [1, 2]}\nc: [*a, *a]\nd: {<<: *a, e: 1}\n")
    assert read_yaml(tmp_path / "x.yaml")["d"] == {"b": [1, 2], "e": 1}


def test_a_document_of_too_many_values_is_refused_while_it_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("cosim.documents.MOST_VALUES", 100)
    assert complaint(tmp_path / "x.yaml", f"a: [{'1, ' * 101}]\nb: {{").endswith("holds more than 100 values")


# ---------------------------------------------------------------- errors


class Wheel(Settings):
    kind: Literal["wheel"] = "wheel"
    least_s: Seconds = Field(default=1.0, gt=0)
    most_s: Seconds = 2.0
    spokes: Count = 3

    @model_validator(mode="after")
    def _in_order(self) -> "Wheel":
        if self.least_s > self.most_s:
            raise error_at(("most_s",), self.most_s, f"is not >= {self.least_s}, least_s")
        if self.spokes == 13:
            raise ValueError("thirteen spokes are too many")
        return self


class Leg(Settings):
    kind: Literal["leg"] = "leg"
    toes: Count | tuple[Count, Count] | None = None
    gait: Literal["walk", "trot"] = "walk"


Limb = Annotated[Wheel | Leg, Field(discriminator="kind")]


class Body(Settings):
    name: str
    limbs: tuple[Limb, ...] = ()
    named: dict[str, Limb] = Field(default_factory=dict)
    spare: Limb | None = None
    sets: dict[str, tuple[Limb, ...]] = Field(default_factory=dict)


@pytest.mark.parametrize(
    ("plain", "expected"),
    [
        ({"limbs": [{"kind": "wheel", "spokes": -1}]}, "limbs[0].spokes: -1 is not >= 0"),
        ({"named": {"r": {"kind": "wheel", "spokes": 2**40}}}, "named.r.spokes: 1099511627776 is not <= 2147483647"),
        ({"named": {"wheel": {"kind": "leg", "gait": "run"}}}, "named.wheel.gait: 'run' is not 'walk' or 'trot'"),
        ({"named": {"kind": {"kind": "hand"}}}, "named.kind.kind: 'hand' is not one of 'wheel', 'leg'"),
        ({"named": {"r": {}}}, "named.r.kind: is missing, in {}"),
        ({"named": {3: {"kind": "leg"}}}, "named[3]: 3 is not a valid string"),
        (
            {"spare": {"kind": "leg", "tose": 3}},
            "spare.tose: 3 is not expected here: there is no such key, did you mean",
        ),
        (
            {"spare": {"kind": "leg", "x": 3}},
            "spare.x: 3 is not expected here: there is no such key, expected one of gait, kind, toes",
        ),
        ({"sets": {"a": [{"kind": "leg", "toes": [1, -1]}]}}, "sets.a[0].toes: [1, -1] is not a valid integer"),
        ({"limbs": [{"kind": "wheel", "most_s": 0.5}]}, "limbs[0].most_s: 0.5 is not >= 1.0, least_s"),
        ({"spare": {"kind": "wheel", "spokes": 13}}, "spare: thirteen spokes are too many"),
        ({"spare": {"kind": "wheel", "least_s": "x" * 9999}}, "spare.least_s: 'xxxx"),
    ],
)
def test_an_error_has_the_path_to_its_field_and_no_more(plain: dict[str, Any], expected: str):
    with pytest.raises(UserError) as raised:
        validated(Body, {"name": "b"} | plain, "b.yaml")
    assert str(raised.value).startswith(f"b.yaml: {expected}")
    assert len(str(raised.value)) <= 300


class Reading(Settings):
    count: int = 1
    share: float = 1.0
    asks: bool = False


@pytest.mark.parametrize(
    ("plain", "expected"),
    [
        ({"count": "many"}, "count: 'many' is not a valid integer"),
        ({"count": 1.5}, "count: 1.5 is not a valid integer, got a number with a fractional part"),
        ({"share": "half"}, "share: 'half' is not a valid number"),
        ({"asks": "yes please"}, "asks: 'yes please' is not true or false"),
        ({"asks": None}, "asks: None is not true or false"),
    ],
)
def test_what_cannot_be_read_is_told_in_words_of_the_document(plain: dict[str, Any], expected: str):
    with pytest.raises(UserError) as raised:
        validated(Reading, plain, "r.yaml")
    assert str(raised.value) == f"r.yaml: {expected}"


def test_all_places_that_are_wrong_are_named():
    with pytest.raises(UserError) as raised:
        validated(
            Body, {"limbs": [{"kind": "wheel", "spokes": -1, "least_s": 0}, {"kind": "leg", "gait": 1}]}, "b.yaml"
        )
    assert str(raised.value) == (
        "b.yaml: name: is missing (and 3 more: limbs[0].least_s, limbs[0].spokes, limbs[1].gait)"
    )
    with pytest.raises(UserError) as raised:
        validated(Body, {"limbs": [{"kind": "wheel", "spokes": -1}] * 100}, "b.yaml")
    assert "(and 100 more: limbs[0].spokes, " in str(raised.value)
    assert str(raised.value).endswith("...)")


# ---------------------------------------------------------------- what validates


@pytest.mark.slow
def test_the_dump_of_every_document_of_ours_validates_to_itself():
    kinds = dict.fromkeys(("scenario", "experiment", "floor", "play"), 0)
    for path in sorted([*ROOT.glob("experiments/*/*.yaml"), *ROOT.glob("protocols/**/*.yaml")]):
        plain = read_yaml(path)
        if is_experiment(plain):
            kinds["experiment"] += 1
            again(ExperimentSettings, plain)
            scenario = base_scenario(path) if "scenario" in plain else None
        else:
            scenario = load(str(path)) if "protocol" in plain else None
        if scenario is not None:
            kinds["scenario"] += 1
            assert dump(build(dump(scenario), "dump", path.parent)) == dump(scenario)
        elif {"tasks", "plays"} & plain.keys():
            kinds["play"] += 1
            again(Play, plain)
        elif "walls" in plain or "walls_by_kind" in plain:
            kinds["floor"] += 1
            again(FloorSettings, plain)
    assert all(kinds.values()), kinds


def again(model: type[Settings], plain: dict[str, Any]) -> None:
    first = dump(validated(model, plain, "document"))
    assert dump(validated(model, first, "dump")) == first
