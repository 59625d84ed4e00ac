"""Every number that a scenario can say has bounds."""

import importlib
import pkgutil
import sys
import types
from collections.abc import Iterator
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import annotated_types
import pytest
from pydantic import Field, JsonValue, ValidationError
from pydantic.fields import FieldInfo

import cosim
import experiments
import protocols
from cosim.settings import Bounded, Count, FreeSettings, Metres, PlainData, Seconds, Settings


def all_settings() -> list[type[Settings]]:
    """Return the settings that cosim, the protocols and the experiments define."""
    for package in (cosim, protocols, experiments):
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if not module.name.endswith("__main__"):
                importlib.import_module(module.name)
    found, waiting = [], [Settings]
    while waiting:
        model = waiting.pop()
        waiting += model.__subclasses__()
        if model.__module__.split(".")[0] in ("cosim", "protocols", "experiments") and model not in found:
            found.append(model)
    return found


def loose(annotation: Any, bounds: tuple[Any, ...], module: str) -> Iterator[str]:
    """Yield what of *annotation*, to which *bounds* apply, is a number without two bounds, or anything at all."""
    if isinstance(annotation, str):
        annotation = getattr(sys.modules[module], annotation)
    origin, parts = get_origin(annotation), get_args(annotation)
    if annotation in (int, float):
        if not (low(bounds) and high(bounds)):
            yield annotation.__name__
    elif annotation is Any:
        if not any(each is get_args(PlainData)[1] for each in bounds):
            yield "Any"
    elif origin is Annotated:
        inner = [each for part in parts[1:] for each in (part.metadata if isinstance(part, FieldInfo) else [part])]
        yield from loose(parts[0], (*bounds, *inner), module)
    elif origin in (Union, types.UnionType):
        for part in parts:
            yield from loose(part, bounds, module)
    elif origin not in (None, Literal) and annotation is not JsonValue:
        for part in parts:
            if part is not Ellipsis:
                yield from loose(part, (), module)


def low(bounds: tuple[Any, ...]) -> bool:
    return any(isinstance(each, Bounded | annotated_types.Ge | annotated_types.Gt) for each in bounds)


def high(bounds: tuple[Any, ...]) -> bool:
    return any(isinstance(each, Bounded | annotated_types.Le | annotated_types.Lt) for each in bounds)


@pytest.mark.slow  # it imports all there is
def test_every_number_has_two_bounds():
    models = all_settings()
    assert len(models) > 100
    wrong = [
        f"{model.__module__}.{model.__name__}.{name}: {what}"
        for model in models
        for name, field in model.model_fields.items()
        for what in loose(field.annotation, tuple(field.metadata), model.__module__)
    ]
    assert sorted(set(wrong)) == []


class Sample(Settings):
    at_s: Seconds = Field(default=1.0, gt=0)
    until_s: Seconds | None = Field(default=None, gt=0)
    robots: Count = Field(default=3, ge=2, le=7)
    way_m: tuple[Metres, ...] = ()
    free: PlainData = None


@pytest.mark.parametrize(
    ("values", "place", "expected"),
    [
        ({"at_s": -1e300}, ("at_s",), "greater than 0"),
        ({"at_s": 1.1e9}, ("at_s",), "less than or equal to 1000000000"),
        ({"until_s": 0}, ("until_s",), "greater than 0"),
        ({"until_s": 1e308}, ("until_s",), "less than or equal to 1000000000"),
        ({"robots": 1}, ("robots",), "greater than or equal to 2"),
        ({"robots": 8}, ("robots",), "less than or equal to 7"),
        ({"way_m": [0, -1.1e6]}, ("way_m", 1), "greater than or equal to -1000000"),
        ({"free": {"a": [1, {"b": float("nan")}]}}, ("free", "a", 1, "b"), "is not a finite number"),
        ({"free": [2**63]}, ("free", 0), "is not an integer of 64 bits"),
        ({"free": {"a": b"x"}}, ("free", "a"), "is a bytes, expected text"),
    ],
)
def test_a_type_bounds_a_number_beside_what_its_field_says(values: dict[str, Any], place: Any, expected: str):
    with pytest.raises(ValidationError) as raised:
        Sample(**values)
    (error,) = raised.value.errors()
    assert error["loc"] == place
    assert expected in error["msg"]


def test_settings_without_a_model_are_finite():
    assert FreeSettings.model_validate({"a": [1, "x", None]}).model_dump() == {"a": [1, "x", None]}
    with pytest.raises(ValidationError, match="not a finite number"):
        FreeSettings.model_validate({"a": [float("inf")]})
