"""Temporal constraints as people write them, in a play or when they tailor one, and as they stand in a plan.

Paper 004, section 5: a task "can be constrained to precede another, ... to start 10 seconds after another, or to
terminate whenever another task completes". The last is no bound on times: a play and a plan have it as ``ends_with`` of
a task, a call as :class:`EndsWith`. Tasks are named by their labels below the play, as in ``leap/stage-2``; the empty
name is the play itself.
"""

from typing import Annotated, Any, Final, Literal, Self, TypeAlias

from pydantic import BeforeValidator, Field, model_validator

from cosim.settings import Bounded, Settings, error_at
from protocols.deployment.tasks.plan import MOST, Between, Edge, Instant, Place

BASE: Final = "base"
"""Name of the place to which robots return."""


def _finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= MOST


def _place(value: Any) -> Any:
    if isinstance(value, str) and value:
        return value
    if isinstance(value, list | tuple) and len(value) == 2 and all(_finite(each) for each in value):
        return tuple(value)
    raise ValueError("is not a place, expected [x, y] in metres, or a name")


def _number(value: Any) -> Any:
    if _finite(value) or (isinstance(value, str) and value):
        return value
    raise ValueError("is not a number, or the name of a parameter that is one")


PlaceName: TypeAlias = Annotated[Place | str, BeforeValidator(_place)]
"""A place in metres, or a name: of a parameter, of a place on the floor, or ``base``."""
Number: TypeAlias = Annotated[float, Bounded(-MOST, MOST)]
Quantity: TypeAlias = Annotated[Number | str, BeforeValidator(_number)]
"""A number, or the name of a parameter."""


class Before(Settings):
    """One task, with all its subtasks, ends before another starts."""

    kind: Literal["before"] = "before"
    first: str = Field(description="label of the task that ends")
    then: str = Field(description="label of the task that starts")
    at_least_s: Quantity = Field(default=0.0, description="s between them")


class After(Settings):
    """The start or end of a task comes a given time after the start or end of another."""

    kind: Literal["after"] = "after"
    task: str = Field(description="label of the task that is constrained")
    edge: Edge = Field(default="start", description="which of its instants")
    of: str = Field(description="label of the other task")
    of_edge: Edge = Field(default="end", description="which instant of the other")
    at_least_s: Quantity = Field(default=0.0, description="s from the other's instant to this one's")
    at_most_s: Quantity | None = Field(default=None, description="s, at most so long; without limit if not given")

    @model_validator(mode="after")
    def _some_time_is_left(self) -> Self:
        least, most = self.at_least_s, self.at_most_s
        if isinstance(least, float) and isinstance(most, float) and most < least:
            raise error_at(("at_most_s",), most, f"is not >= {in_seconds(least)}, at_least_s")
        return self


class Within(Settings):
    """A task takes no longer than a given time."""

    kind: Literal["within"] = "within"
    task: str = Field(default="", description="label of the task; the whole play if empty")
    seconds: Quantity = Field(description="s, from its start to its end")


class Deadline(Settings):
    """A task has ended a given time after the plan begins."""

    kind: Literal["deadline"] = "deadline"
    task: str = Field(default="", description="label of the task; the whole play if empty")
    seconds: Quantity = Field(description="s after the plan begins, by which it has ended")


Constraint: TypeAlias = Annotated[Before | After | Within | Deadline, Field(discriminator="kind")]


class EndsWith(Settings):
    """A task is terminated, if it has not ended by itself, when another ends, however that ends."""

    kind: Literal["ends_with"] = "ends_with"
    task: str = Field(description="label of the task that is terminated")
    of: str = Field(description="label of the task whose end terminates it")


Tailored: TypeAlias = Annotated[Before | After | Within | Deadline | EndsWith, Field(discriminator="kind")]
"""What a call can add to a play."""


def limited(constraint: Constraint, least_s: float, most_s: float | None) -> Constraint:
    """Return *constraint* with other limits."""
    match constraint:
        case Before():
            return constraint.model_copy(update={"at_least_s": least_s})
        case After():
            return constraint.model_copy(update={"at_least_s": least_s, "at_most_s": most_s})
        case _:
            return constraint.model_copy(update={"seconds": most_s})


def named_by(constraint: Constraint) -> dict[str, str]:
    """Return the tasks that *constraint* names, by the field that names them."""
    match constraint:
        case Before(first=first, then=then):
            return {"first": first, "then": then}
        case After(task=task, of=of):
            return {"task": task, "of": of}
        case Within(task=task) | Deadline(task=task):
            return {"task": task}


def quantities_of(constraint: Constraint) -> dict[str, Quantity]:
    """Return the quantities of *constraint* that are given, by their fields."""
    match constraint:
        case Before(at_least_s=least):
            return {"at_least_s": least}
        case After(at_least_s=least, at_most_s=most):
            return {"at_least_s": least} | ({} if most is None else {"at_most_s": most})
        case Within(seconds=seconds) | Deadline(seconds=seconds):
            return {"seconds": seconds}


def between(constraint: Constraint, prefix: str, quantities: dict[str, float], who: str) -> Between:
    """Return *constraint* as it stands in a plan.

    *prefix*: name of the task to which its names are relative; *quantities*: its numbers, looked up; *who*: the author.
    """

    def at(task: str, edge: Edge) -> Instant:
        return Instant(task=f"{prefix}/{task}" if task else prefix, edge=edge)

    match constraint:
        case Before(first=first, then=then):
            earlier, later = at(first, "end"), at(then, "start")
            least, most = quantities["at_least_s"], None
        case After(task=task, edge=edge, of=of, of_edge=of_edge):
            earlier, later = at(of, of_edge), at(task, edge)
            least, most = quantities["at_least_s"], quantities.get("at_most_s")
        case Within(task=task):
            earlier, later, least, most = at(task, "start"), at(task, "end"), 0.0, quantities["seconds"]
        case Deadline(task=task):
            earlier, later, least, most = Instant(), at(task, "end"), 0.0, quantities["seconds"]
    why = f"{who}: {sentence(earlier, later, least, most)}"
    return Between(earlier=earlier, later=later, at_least_s=least, at_most_s=most, why=why)


def sentence(earlier: Instant, later: Instant, least_s: float, most_s: float | None) -> str:
    """Return a temporal constraint in words."""
    if most_s is None:
        span = f"at least {in_seconds(least_s)} s" if least_s else "any time"
    elif least_s:
        span = f"{in_seconds(least_s)} to {in_seconds(most_s)} s"
    else:
        span = f"at most {in_seconds(most_s)} s"
    return f"{later.task} {later.edge}s {span} after {_instant(earlier)}"


def in_seconds(number: float) -> str:
    """Return *number* so that a person can enter it again: its tenths are kept, however great it is."""
    return f"{number:.12g}"


def _instant(instant: Instant) -> str:
    return f"{instant.task} {instant.edge}s" if instant.task else "the plan begins"
