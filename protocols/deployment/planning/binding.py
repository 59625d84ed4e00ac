"""The parameters of a play and their values in one call of it."""

import difflib
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Final, NamedTuple, NoReturn, get_args

from pydantic import TypeAdapter, ValidationError

from cosim.errors import UserError
from cosim.machine import Address
from protocols.deployment.planning.play import (
    MOST_ROBOTS,
    Needs,
    NumberParameter,
    Parameter,
    PlaceParameter,
    PlacesParameter,
    Play,
    RobotParameter,
    RobotsParameter,
    StrategyParameter,
)
from protocols.deployment.tasks.constraints import BASE, PlaceName, Quantity
from protocols.deployment.tasks.crew import Ways
from protocols.deployment.tasks.plan import Place, Strategy

STRATEGIES: Final[tuple[Strategy, ...]] = get_args(Strategy)
_PLACE: Final[TypeAdapter[Place | str]] = TypeAdapter(PlaceName)


class MissingParametersError(UserError):
    """A call lacks parameters that its play needs."""

    def __init__(self, text: str, names: Sequence[str] = ()) -> None:
        """Take the line that the user sees, and the names of the parameters without a value."""
        super().__init__(text)
        self.names = tuple(names)


class Site(NamedTuple):
    """The floor on which plays take place."""

    ways: Ways
    base_m: Place
    places_m: Mapping[str, tuple[Place, ...]]
    """Places that the floor names."""
    radius_m: float
    """Radius of the largest body."""
    moved_m: Mapping[Place, Place] = MappingProxyType({})
    """Places, and the places that are taken instead of them."""
    apart_m: float = math.inf
    """Greatest distance between robots that gather."""


@dataclass(frozen=True)
class Role:
    """The part of one robot in a play, before the robot is chosen."""

    name: str
    """Name of the parameter, with a number if that stands for several robots, below the path of its play."""
    needs: tuple[Needs, ...]
    fixed: Address | None = None
    """Robot that the call has named."""


@dataclass
class Binding:
    """The values of the parameters of one play, by their names."""

    source: str
    """Path of the play, for errors."""
    site: Site
    places: dict[str, tuple[Place, ...]] = field(default_factory=dict)
    roles: dict[str, tuple[str, ...]] = field(default_factory=dict)
    numbers: dict[str, float] = field(default_factory=dict)
    strategies: dict[str, Strategy] = field(default_factory=dict)
    missing: dict[str, tuple[str, str]] = field(default_factory=dict)
    """Parameters without a value: which one to name, and what was expected of it. An error once a task needs one."""

    # ------------------------------------------------------------ looking up

    def places_of(self, names: Place | str | Sequence[Place | str]) -> tuple[Place, ...]:
        """Return the places that *names* stand for, in order; raise UserError for a name that is no place."""
        return tuple(self.site.moved_m.get(place, place) for place in self._places(names))

    def _places(self, names: Place | str | Sequence[Place | str]) -> tuple[Place, ...]:
        if isinstance(names, str):
            known = {BASE: (self.site.base_m,), **self.site.places_m, **self.places}
            return known[names] if names in known else self._fail(names, known, "a place")
        if len(names) == 2 and isinstance(names[0], float | int) and isinstance(names[1], float | int):
            return ((float(names[0]), float(names[1])),)
        return tuple(place for name in names if not isinstance(name, float) for place in self._places(name))

    def place_of(self, name: Place | str) -> Place:
        """Return the one place that *name* stands for."""
        places = self.places_of(name)
        if len(places) != 1:
            raise UserError(f"{self.source}: {name} is {len(places)} places, expected one")
        return places[0]

    def roles_of(self, names: Iterable[str]) -> tuple[str, ...]:
        """Return the roles that *names* stand for, in order."""
        found = list[str]()
        for name in names:
            found += self.roles[name] if name in self.roles else self._fail(name, self.roles, "a robot or robots")
        return tuple(found)

    def role_of(self, name: str) -> str:
        """Return the one role that *name* stands for."""
        roles = self.roles_of((name,))
        if len(roles) != 1:
            raise UserError(f"{self.source}: {name} is {len(roles)} robots, expected one")
        return roles[0]

    def number_of(self, quantity: float | str, least: float = -math.inf) -> float:
        """Return the number that *quantity* is or stands for; raise UserError if it is below *least*."""
        if isinstance(quantity, str) and quantity not in self.numbers:
            self._fail(quantity, self.numbers, "a number")
        number = self.numbers[quantity] if isinstance(quantity, str) else float(quantity)
        if number < least:
            raise UserError(f"{self.source}: {quantity} is {number:g}, expected >= {least:g}")
        return number

    def strategy_of(self, name: str) -> Strategy:
        """Return the strategy that *name* is or stands for."""
        known: dict[str, Strategy] = {each: each for each in STRATEGIES} | self.strategies
        return known[name] if name in known else self._fail(name, known, "a strategy")

    def want(self, names: Collection[str]) -> None:
        """Raise MissingParametersError, for all of them at once, if any of *names* are parameters without a value."""
        lacking = {
            blamed: expected
            for name, (blamed, expected) in self.missing.items()
            if name in names and name not in self.site.places_m
        }
        if lacking:
            told = ", ".join(f"{name} ({expected})" for name, expected in lacking.items())
            raise MissingParametersError(f"{self.source} wants to know more: {told}", tuple(lacking))

    def _fail(self, name: str, known: Iterable[str], kind: str) -> NoReturn:
        self.want((name,))
        raise UserError(f"{self.source}: {name!r} is not {kind}{near(name, known)}")


def near(name: str, known: Iterable[str]) -> str:
    """Return the end of a sentence with the known name that *name* may have been meant to be."""
    names = sorted(known)
    close = difflib.get_close_matches(name, names, n=1)
    if close:
        return f", did you mean {close[0]}?"
    return f", expected one of {', '.join(names)}" if names else ", and there is none"


# ---------------------------------------------------------------- binding


class Binder:
    """Binds the parameters of plays and collects the roles that they ask for."""

    def __init__(self, site: Site) -> None:
        self.site = site
        self.roles: dict[str, Role] = {}
        """Roles in the order of their first mention."""

    def bind(self, play: Play, source: str, given: Mapping[str, Any], outer: Binding | None, prefix: str) -> Binding:
        """Return *play*'s parameters with the values *given* by the *outer* play, or by a call if that is None.

        Raise UserError for a value that is not of its parameter's kind. *prefix* stands before the names of new roles.
        """
        for name in given:
            if name not in play.parameters:
                raise UserError(f"{source}: there is no parameter {name!r}{near(name, play.parameters)}")
        bound = Binding(source, self.site)
        counted = [name for name, each in play.parameters.items() if isinstance(each, RobotsParameter)]
        for name in [*(name for name in play.parameters if name not in counted), *counted]:
            try:
                self._bind(bound, name, play.parameters[name], given.get(name), outer, prefix)
            except (ValidationError, TypeError, ValueError) as error:
                if isinstance(error, UserError):
                    raise
                parameter = play.parameters[name]
                value = given[name] if name in given else getattr(parameter, "default", None)
                raise UserError(f"{source}: parameters.{name}: {value!r}, expected {_expected(parameter)}") from None
        return bound

    def _bind(
        self, bound: Binding, name: str, parameter: Parameter, value: Any, outer: Binding | None, prefix: str
    ) -> None:
        scope = outer or bound
        if isinstance(parameter, RobotParameter | RobotsParameter):
            self._cast(bound, name, parameter, value, outer, prefix)
            return
        value = parameter.default if value is None else value
        if value is None:
            bound.missing[name] = name, _expected(parameter)
            return
        match parameter:
            case PlaceParameter():
                bound.places[name] = (scope.place_of(_PLACE.validate_python(value)),)
            case PlacesParameter():
                if not isinstance(value, str | list | tuple) or len(value) > MOST_ROBOTS:
                    raise ValueError
                several = value if isinstance(value, str) else [_PLACE.validate_python(each) for each in value]
                bound.places[name] = scope.places_of(several)
            case NumberParameter(least=least, most=most):
                number = scope.number_of(TypeAdapter[float | str](Quantity).validate_python(value))
                if (least is not None and number < least) or (most is not None and number > most):
                    raise ValueError
                bound.numbers[name] = number
            case StrategyParameter():
                bound.strategies[name] = scope.strategy_of(str(value))

    def _cast(
        self,
        bound: Binding,
        name: str,
        parameter: RobotParameter | RobotsParameter,
        value: Any,
        outer: Binding | None,
        prefix: str,
    ) -> None:
        """Bind robots to roles of the outer play, or to new ones."""
        single = isinstance(parameter, RobotParameter)
        names = [value] if isinstance(value, str) else value
        if isinstance(names, list | tuple) and names and all(isinstance(each, str) for each in names):
            roles = (outer or bound).roles_of(names)
            if single and len(roles) != 1:
                raise ValueError
            for role in roles:
                self.need(role, parameter.needs)
            bound.roles[name] = roles
            return
        fixed = _addresses(value, single)
        count = _count(bound, parameter, value, fixed)
        if count is None:
            places = parameter.as_many_as if isinstance(parameter, RobotsParameter) else None
            bound.missing[name] = bound.missing.get(places or "", (name, _expected(parameter)))
            return
        title = prefix + name
        roles = (title,) if single else tuple(f"{title}-{number}" for number in range(1, count + 1))
        for number, role in enumerate(roles):
            self.roles[role] = Role(role, (parameter.needs,), fixed[number] if fixed else None)
        bound.roles[name] = roles

    def need(self, role: str, needs: Needs) -> None:
        """Add to the needs of *role*."""
        known = self.roles[role]
        if needs not in known.needs:
            self.roles[role] = Role(role, (*known.needs, needs), known.fixed)


def _addresses(value: Any, single: bool) -> list[Address]:
    """Return the robots that a call names; an empty list if it names none."""
    if single:
        value = [] if value is None else [value]
    if not isinstance(value, list | tuple):
        return []
    if any(isinstance(each, bool) or not isinstance(each, int) or each < 0 for each in value):
        raise ValueError
    return list(value)


def _count(
    bound: Binding, parameter: RobotParameter | RobotsParameter, value: Any, fixed: Sequence[Address]
) -> int | None:
    """Return the number of robots that a parameter stands for; None if it is not known."""
    if isinstance(parameter, RobotParameter):
        return 1
    if value is None:
        if parameter.as_many_as is not None:
            places = bound.places.get(parameter.as_many_as)
            return None if places is None else len(places)
        return parameter.default
    if isinstance(value, bool) or not isinstance(value, int | list | tuple) or value in (0, [], ()):
        raise ValueError
    if isinstance(value, int) and not 0 < value <= MOST_ROBOTS:
        raise ValueError
    return value if isinstance(value, int) else len(fixed)


def _expected(parameter: Parameter) -> str:
    match parameter:
        case RobotParameter():
            return "the address of a robot"
        case RobotsParameter():
            return "a number of robots, or their addresses"
        case PlaceParameter():
            return "a place: [x, y] in metres, or a name"
        case PlacesParameter():
            return "places: [[x, y], ...] in metres, or names"
        case NumberParameter(least=least, most=most):
            limits = [f"{sign} {limit:g}" for sign, limit in ((">=", least), ("<=", most)) if limit is not None]
            return " ".join(["a number", *limits])
        case StrategyParameter():
            return f"one of {', '.join(STRATEGIES)}"
