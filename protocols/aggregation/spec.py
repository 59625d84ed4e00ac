"""The protocol aggregation as cosim needs it: the entry point ``aggregation`` names ``SPEC``."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from cosim.errors import UserError
from cosim.geometry.planning import Point
from cosim.geometry.polylines import middle
from cosim.machine import Address, Machine
from cosim.protocol import ProtocolSpec, Surroundings, check_cells
from cosim.randomness import Streams
from cosim.units import Time, from_seconds
from protocols.aggregation.events import EVENTS
from protocols.aggregation.frames import decode
from protocols.aggregation.ground import MOST_CORNERS, Ground, ground
from protocols.aggregation.host import Host
from protocols.aggregation.metrics import METRICS, SearchReferee, measure
from protocols.aggregation.parameters import Parameters
from protocols.aggregation.searcher import Searcher
from protocols.aggregation.setup import Setup
from protocols.aggregation.strategies import Strategy
from protocols.aggregation.subteam import Work
from protocols.aggregation.touring import Motion, RandomWalk
from protocols.aggregation.tours import regions
from protocols.aggregation.walking import Pedestrian, Walker
from protocols.localization.positioning import KnownMaps, Positioning, check_positioning, positioning_of
from protocols.localization.scan import Sensor
from protocols.transport.links import check_piconet

TEAM_LIMIT = 256
"""Addresses on the wire are single bytes."""
APART = 6.0
"""Distance between starting robots, in radii."""
MOST_STEPS = 1000
"""Largest distance of starting robots from the middle, in these steps."""
ATTEMPTS = 10_000
"""Number of random places that are tried for all targets together."""


def place(parameters: Parameters, surroundings: Surroundings, size: int, stream: np.random.Generator) -> list[Point]:
    """Place the robots at the floor's ``starts``, or close together around its place ``start``, or its middle."""
    named = surroundings.places_m.get("starts", ())
    if len(named) >= size:
        return list(named[:size])
    x_min, y_min, x_max, y_max = surroundings.bounds_m
    centre = surroundings.places_m.get("start", (((x_min + x_max) / 2.0, (y_min + y_max) / 2.0),))[0]
    floor = _ground(parameters, surroundings)
    step_m = APART * surroundings.radius_m
    far = math.ceil(max(x_max - x_min, y_max - y_min) / step_m)
    starts: list[Point] = []
    for point in _around(centre, step_m, min(far, MOST_STEPS)):
        inside = x_min < point[0] < x_max and y_min < point[1] < y_max
        if inside and floor.stands(point) == point and floor.length_m(centre, point) is not None:
            starts.append(point)
            if len(starts) == size:
                return starts
    raise UserError(f"team.starts: found places for {len(starts)} of {size} robots near {centre}; give starts")


def _around(centre: Point, step_m: float, reach: int) -> Iterator[Point]:
    """Yield the points of a square lattice around *centre*, *reach* steps to each side, the nearest first."""
    told_m, steps = -1.0, 0
    while steps < reach:
        steps = min(reach, 2 * steps + 8)
        offsets = [step_m * k for k in range(-steps, steps + 1)]
        lattice = [(centre[0] + dx, centre[1] + dy) for dx in offsets for dy in offsets]
        near = sorted((math.dist(point, centre), point) for point in lattice)
        whole_m = steps * step_m if steps < reach else math.inf  # farther out, points of the next square come before
        yield from (point for away_m, point in near if told_m < away_m <= whole_m)
        told_m = whole_m


def _ground(parameters: Parameters, surroundings: Surroundings) -> Ground:
    """Return the ground of the floor; raise UserError if there are too many cells, or none where a robot fits."""
    check_cells(surroundings, parameters.cell_m, "protocol.parameters.cell_m")
    try:
        return ground(
            surroundings.walls_m,
            surroundings.bounds_m,
            surroundings.places_m,
            surroundings.radius_m,
            parameters.least_camera_m,
            parameters.cell_m,
            surroundings.forbidden,
            MOST_CORNERS if parameters.planner == "roadmap" else 0,
        )
    except ValueError as error:
        raise UserError(f"protocol.parameters.cell_m: {error}") from None


def prepare(parameters: Parameters, surroundings: Surroundings) -> Setup:
    """Draw the targets, divide the floor, and fix SRP's integration time if finds are kept back for one.

    Raise UserError for a team or a floor that cannot be searched.
    """
    size = len(surroundings.starts_m)
    _check_team(parameters, size)
    _check_radios(parameters, surroundings.radios)
    if parameters.links is not None:
        check_piconet(surroundings, "protocol.parameters.links")
    check_positioning(parameters.positioning, surroundings)
    floor = _ground(parameters, surroundings)
    x_min, y_min, x_max, y_max = surroundings.bounds_m
    starts = surroundings.starts_m
    setup = Setup(
        size=size,
        hosts=parameters.hosts,
        tick=surroundings.tick,
        ground=floor,
        regions=regions(floor, parameters.hosts, middle(starts)),
        starts_m=tuple(starts),
        radii_m=surroundings.radii_m or (surroundings.radius_m,) * size,
        speeds_mps=surroundings.speeds_mps or (surroundings.speed_mps,) * size,
        targets_m=_targets(parameters, surroundings, floor),
        area_m2=(x_max - x_min) * (y_max - y_min),
        exit_m=surroundings.places_m.get("exit", (None,))[0],
        maps=KnownMaps(surroundings),
    )
    if parameters.strategy != "srp" or parameters.report != "appointed":
        return setup
    return replace(setup, integration_s=parameters.integrate_s or _integration_s(parameters, setup))


def _integration_s(parameters: Parameters, setup: Setup) -> float:
    """Return when the last searcher can be back from its first tour, s from the start.

    This is ``muster_s``, after which searchers set out, and the most over all searchers of

        (d(start, p_1) + d(p_1, p_2) + ... + d(p_(n-1), p_n) + d(p_n, rally)) / speed,

    p_1 ... p_n being the posts that its host gives it before the start, in this order, d the length of the shortest way
    (0 where there is none), rally its host's rally point, speed its own. Bodies that turn, brake and give way take
    longer.
    """
    rallies_m = {host: Strategy(parameters, setup, host).rally_m for host in range(setup.hosts)}
    longest_s = 0.0
    for host, rally_m in rallies_m.items():
        work = Work(setup, host, rallies_m.__getitem__, at_random=False)
        for searcher, posts in work.first(setup.searchers_of(host)).items():
            places = [setup.starts_m[searcher], *(setup.ground.posts_m[post] for post in posts), rally_m]
            way_m = math.fsum(setup.ground.length_m(a, b) or 0.0 for a, b in pairwise(places))
            longest_s = max(longest_s, way_m / setup.speeds_mps[searcher])
    return parameters.muster_s + longest_s


def _check_team(parameters: Parameters, size: int) -> None:
    if parameters.hosts >= size:
        raise UserError(f"protocol.parameters.hosts: {parameters.hosts} is not < {size}, the team's size")
    for name, robots, first in (("humans", parameters.humans, parameters.hosts), ("strays", parameters.strays, 0)):
        last = size - 1 if name == "humans" else parameters.hosts - 1
        for robot in robots:
            if not first <= robot <= last:
                raise UserError(f"protocol.parameters.{name}: {robot} is not one of {first} to {last}")


def _check_radios(parameters: Parameters, radios: Sequence[Sequence[int]]) -> None:
    """Raise UserError if there are several hosts, and one of them without the radio between them."""
    wanted = parameters.long_radio
    for host, carried in enumerate(radios[: parameters.hosts] if parameters.hosts > 1 else ()):
        if wanted not in carried:
            known = ", ".join(map(str, carried))
            raise UserError(f"protocol.parameters.long_radio: {wanted} is none of the radios of host {host}: {known}")


def _targets(parameters: Parameters, surroundings: Surroundings, floor: Ground) -> tuple[Point, ...]:
    """Return the places of the targets: as given, as the floor names them, or drawn in its rooms."""
    if parameters.targets is not None:
        return parameters.targets
    if parameters.target_place is not None:
        places = surroundings.places_m.get(parameters.target_place)
        if places is None:
            raise UserError(f"protocol.parameters.target_place: the floor names no {parameters.target_place}")
        return tuple(places)
    stream = Streams(surroundings.seed)("targets")
    rooms = _rooms(surroundings)
    targets: list[Point] = []
    for _ in range(ATTEMPTS):
        x_min, y_min, x_max, y_max = rooms[int(stream.integers(len(rooms)))]
        point = float(stream.uniform(x_min, x_max)), float(stream.uniform(y_min, y_max))
        if floor.stands(point) == point:
            targets.append(point)
            if len(targets) == parameters.target_count:
                return tuple(targets)
    raise UserError(f"protocol.parameters.target_count: found places for {len(targets)} of {parameters.target_count}")


def _rooms(surroundings: Surroundings) -> Sequence[tuple[float, float, float, float]]:
    """Return the rectangles in which targets may be: those of the floor's rooms, or all of it."""
    corners = surroundings.places_m.get("room_corners", ())
    rooms = [(*low, *high) for low, high in zip(corners[::2], corners[1::2], strict=True)]
    return rooms or [surroundings.bounds_m]


def make(parameters: Parameters, setup: Setup, me: Address, stream: np.random.Generator, start: Time) -> Machine:
    """Return the machine of robot *me*; one that is made after the start has been rebooted."""
    rebooted = start > 0
    body = setup.ground, setup.radii_m[me], setup.speeds_mps[me], setup.tick, parameters.walking
    own = parameters.of(me)
    if me >= setup.hosts:
        human = me in parameters.humans
        mover = Pedestrian(*body) if human else Walker(*body)
        length_m = math.dist if human else setup.ground.length_m  # a person has no planner
        random_walk = RandomWalk(setup.ground, parameters.walking, setup.tick, stream)
        motion = Motion(setup.ground, mover, random_walk, length_m, stream, parameters.strategy == "random")
        return Searcher(own, setup, me, _positioning(own, setup, me, stream), motion, start, rebooted)
    phase = from_seconds(float(stream.uniform(0.0, 0.5 * parameters.heartbeat_s)))
    return Host(own, setup, me, _positioning(own, setup, me, stream), Walker(*body), phase, start, rebooted)


def _positioning(own: Parameters, setup: Setup, me: Address, stream: np.random.Generator) -> Positioning:
    """Return what locates robot *me*, of which these are the *own* parameters."""
    sensor = Sensor(setup.maps.surroundings.beams)
    return positioning_of(own.positioning, setup.maps, me, own.cell_m, sensor, stream)


def succeed(before: Host | Searcher, after: Host | Searcher, now: Time) -> None:
    """Hand over to a machine that boots again the shift of its frame, which its disk has kept, and the counters."""
    after.positioning.resume(before.positioning.shift)
    after.counters.follow(before.counters, now)


def referee(parameters: Parameters, setup: Setup, surroundings: Surroundings) -> SearchReferee:
    """Return the judge of the search."""
    return SearchReferee(setup)


SPEC = ProtocolSpec(
    name="aggregation",
    about="Hosts lead sub-teams of searchers to targets, meet them at rally points, and replace whoever fails.",
    parameters=Parameters,
    place=place,
    prepare=prepare,
    make=make,
    referee=referee,
    metrics=METRICS,
    measure=measure,
    over_time=("hosts_alive",),
    events=EVENTS,
    decode=lambda parameters, size, data: dict(zip(("sender", "message"), decode(data), strict=True)),
    team_limit=TEAM_LIMIT,
    succeed=succeed,
    believes=lambda machine: machine.believed(),
    needs_sight=True,
    needs_view=True,
)
