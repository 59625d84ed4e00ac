"""The base of everything that a scenario can say: frozen, strict about unknown keys, with numbers that have bounds.

A number of the settings has one of the types below, or bounds of its own: what validates can be computed with. The
types are as wide as arithmetic allows; a field narrows them (``Seconds = Field(gt=0)``). A bound keeps intermediate
results finite and instants within 64 bits, also where a few of them are added up.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Any, Final, TypeAlias

from pydantic import AfterValidator, BaseModel, ConfigDict, GetCoreSchemaHandler, ValidationError
from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError, core_schema

LONGEST_S: Final = 1e9
"""Thirty years: nine times that is an int64 of nanoseconds."""
FARTHEST_M: Final = 1e6
LARGEST_INT: Final = 2**63 - 1


class Settings(BaseModel):
    """Frozen settings with every default in one place; an unknown key is an error, and so is a NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, validate_default=True)

    @classmethod
    def kinds_with(cls, name: str) -> list[str]:
        """Return the other kinds of such settings that have one called *name*: it may be meant for them."""
        return []


@dataclass(frozen=True)
class Bounded:
    """The bounds of an int or a float, both inclusive; they hold beside those of the field that has the type.

    (pydantic's own ``Field(ge=..., le=...)`` in a type would take the place of the same bounds in the field.)
    """

    low: float
    high: float

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        bounded = (
            core_schema.int_schema(ge=int(self.low), le=int(self.high))
            if source is int
            else core_schema.float_schema(ge=self.low, le=self.high)
        )
        return core_schema.chain_schema([handler(source), bounded])


Seconds: TypeAlias = Annotated[float, Bounded(-LONGEST_S, LONGEST_S)]
Metres: TypeAlias = Annotated[float, Bounded(-FARTHEST_M, FARTHEST_M)]
Length: TypeAlias = Annotated[float, Bounded(1e-3, FARTHEST_M)]
"""Metres of something that others are counted in: a body, a cell of a grid."""
Period: TypeAlias = Annotated[float, Bounded(1e-3, LONGEST_S)]
"""Seconds from one event to the next for as long as a run lasts."""
Angle: TypeAlias = Annotated[float, Bounded(-1e6, 1e6)]
"""Radians or degrees."""
Rate: TypeAlias = Annotated[float, Bounded(-1e6, 1e6)]
"""Something per second, per metre ...: velocities, accelerations, prices."""
Gain: TypeAlias = Annotated[float, Bounded(-1e6, 1e6)]
"""A number without a unit: gains, weights, factors, thresholds."""
Decibels: TypeAlias = Annotated[float, Bounded(-1e3, 1e3)]
"""dB and dBm: as a ratio, and as a few of them multiplied, still finite."""
Energy: TypeAlias = Annotated[float, Bounded(-1e12, 1e12)]
"""Joules, or watts."""
Count: TypeAlias = Annotated[int, Bounded(0, 2**31 - 1)]
"""How many, or the number of one of many."""
BitRate: TypeAlias = Annotated[int, Bounded(0, 10**12)]
"""Bits a second."""
Seed: TypeAlias = Annotated[int, Bounded(0, 2**62)]
"""A seed; those of the replicates, which count up from it, are columns of 64 bits."""
Int64: TypeAlias = Annotated[int, Bounded(-LARGEST_INT, LARGEST_INT)]
"""An instant in nanoseconds, or a number that others chose."""


def error_at(place: tuple[str | int, ...], value: Any, expected: str) -> ValidationError:
    """Return the error of a model's validator that blames *value*, at *place* below the model.

    A ValueError would blame the model as a whole, and so the error would repeat all of it.
    """
    kind = PydanticCustomError("value_error", "{error}", {"error": expected})
    return ValidationError.from_exception_data("Settings", [InitErrorDetails(type=kind, loc=place, input=value)])


def _plain(value: Any, place: tuple[str | int, ...] = ()) -> Any:
    if isinstance(value, dict):
        for key, inner in value.items():
            _plain(key, place)
            _plain(inner, (*place, str(key)))
    elif isinstance(value, list):
        for number, inner in enumerate(value):
            _plain(inner, (*place, number))
    elif isinstance(value, float) and not math.isfinite(value):
        raise error_at(place, value, "is not a finite number")
    elif isinstance(value, int) and not -LARGEST_INT <= value <= LARGEST_INT:
        raise error_at(place, value, "is not an integer of 64 bits")
    elif not isinstance(value, str | int | float | None):
        raise error_at(place, value, f"is a {type(value).__name__}, expected text, a number, a list or a mapping")
    return value


PlainData: TypeAlias = Annotated[Any, AfterValidator(_plain)]
"""Anything that JSON can write: text, finite numbers, integers of 64 bits, lists, mappings. For what has no model."""


class FreeSettings(Settings):
    """Settings of what has no model of its own."""

    model_config = ConfigDict(extra="allow")

    __pydantic_extra__: dict[str, PlainData]
