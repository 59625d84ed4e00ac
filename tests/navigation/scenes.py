"""Random floors for a point robot, and what shapely says of them: is the goal reachable, where is the robot inside."""

import math
from collections.abc import Iterator
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from cosim.geometry.boundary import Boundary, boundary, inflated

SIZE_M = 20.0
Loop = Any


class Scene(NamedTuple):
    """Obstacles and enclosures as vertices, start and goal, the local direction, and the obstacles' interior."""

    obstacles: list[Loop]
    enclosures: list[Loop]
    start: tuple[float, float]
    goal: tuple[float, float]
    left: bool
    solid: BaseGeometry
    family: str

    @property
    def loops(self) -> Boundary:
        return boundary(self.obstacles, self.enclosures, left=self.left)

    @property
    def reachable(self) -> bool:
        """Whether start and goal touch the same connected piece of free space."""
        free = shapely.box(-3 * SIZE_M, -3 * SIZE_M, 4 * SIZE_M, 4 * SIZE_M).difference(self.solid)
        start, goal = shapely.Point(self.start), shapely.Point(self.goal)
        return any(part.distance(start) < 1e-9 and part.distance(goal) < 1e-9 for part in shapely.get_parts(free))


def scenes(count: int, first: int = 0) -> Iterator[Scene]:
    """Yield *count* scenes of all families in turn; a number always gives the same scene."""
    families = (_stars, _walls, _lattice)
    for number in range(first, first + count):
        yield families[number % len(families)](np.random.default_rng((44, number)))


def _scene(rng: np.random.Generator, solid: BaseGeometry, points: Any, family: str) -> Scene:
    """Make a scene of what is solid inside of the floor and around it; the start is in free space."""
    outline: list[Loop] = []
    enclosures: list[Loop] = []
    for part in shapely.get_parts(solid):
        if part.is_empty:
            continue
        outline.append(np.asarray(part.exterior.coords)[:-1])
        enclosures += [np.asarray(ring.coords)[:-1] for ring in part.interiors]
    outline = [ring for ring in outline if np.abs(ring).max() < 2 * SIZE_M]  # but for the far side of the frame
    start = next(p for p in points if not solid.contains(shapely.Point(p)))
    goal = next(p for p in points if p != start)
    return Scene(outline, enclosures, start, goal, bool(rng.integers(2)), solid, family)


def _frame(inner: BaseGeometry) -> BaseGeometry:
    return shapely.box(-2 * SIZE_M, -2 * SIZE_M, 3 * SIZE_M, 3 * SIZE_M).difference(inner)


def _uniform(rng: np.random.Generator) -> Iterator[tuple[float, float]]:
    while True:
        x, y = rng.uniform(0.5, SIZE_M - 0.5, 2)
        yield float(x), float(y)


def star(rng: np.random.Generator, x: float, y: float, radius: float) -> BaseGeometry:
    """Return a star-shaped polygon with dents and spikes."""
    size = int(rng.integers(3, 12))
    angles = np.sort(rng.uniform(0, 2 * math.pi, size)) + np.linspace(0, 1e-3, size)
    reach = radius * rng.uniform(0.15, 1.0, size)
    return shapely.Polygon(np.stack((x + reach * np.cos(angles), y + reach * np.sin(angles)), axis=1)).buffer(0)


def comb(rng: np.random.Generator, x: float, y: float, radius: float) -> BaseGeometry:
    """Return a comb or a spiral, turned: dead ends for a robot that follows a wall."""
    teeth = int(rng.integers(2, 6))
    if rng.integers(2):
        lines = [[(i, 0.0), (i, rng.uniform(1.0, 3.0))] for i in range(teeth)]
        lines.append([(0.0, 0.0), (teeth - 1, 0.0)])
        bars = shapely.union_all([shapely.LineString(line).buffer(0.2, cap_style="square") for line in lines])
    else:
        turns = np.arange(0.0, 2.0 * teeth + 1)
        path = np.stack((turns * np.cos(turns * math.pi / 2), turns * np.sin(turns * math.pi / 2)), axis=1)
        bars = shapely.LineString(path).buffer(0.2, cap_style="flat", join_style="mitre")
    centred = shapely.affinity.translate(bars, -bars.centroid.x, -bars.centroid.y)
    wide = max(centred.bounds[2] - centred.bounds[0], centred.bounds[3] - centred.bounds[1])
    scaled = shapely.affinity.scale(centred, 2 * radius / wide, 2 * radius / wide, origin=(0, 0))
    turned = shapely.affinity.rotate(scaled, float(rng.uniform(0, 360)), origin=(0, 0))
    return shapely.affinity.translate(turned, x, y)


def _stars(rng: np.random.Generator) -> Scene:
    """Stars, combs and spirals anywhere, also in each other's dents; sometimes inside a ragged room."""
    room = star(rng, SIZE_M / 2, SIZE_M / 2, 0.9 * SIZE_M).union(shapely.box(1, 1, SIZE_M - 1, SIZE_M - 1))
    solid = _frame(room) if rng.integers(2) else shapely.Polygon()
    for _ in range(int(rng.integers(1, 30))):
        x, y = rng.uniform(0, SIZE_M, 2)
        shape = (star, comb)[int(rng.integers(2))](rng, float(x), float(y), float(rng.uniform(0.5, 6.0)))
        if shape.geom_type == "Polygon" and shape.area > 1e-3 and not solid.distance(shape) <= 0.01:
            solid = solid.union(shape)
    return _scene(rng, solid, _uniform(rng), "stars")


def _walls(rng: np.random.Generator) -> Scene:
    """Walls of an office, mostly at right angles, grown by a robot's radius: rooms, some of them closed."""
    walls = [(0, 0, SIZE_M, 0), (SIZE_M, 0, SIZE_M, SIZE_M), (SIZE_M, SIZE_M, 0, SIZE_M), (0, SIZE_M, 0, 0)]
    for _ in range(int(rng.integers(3, 30))):
        x, y, length = *rng.integers(0, 21, 2), rng.integers(1, 10)
        angle = rng.integers(4) * math.pi / 2 if rng.integers(5) else rng.uniform(0, 2 * math.pi)
        walls.append((x, y, x + length * math.cos(angle), y + length * math.sin(angle)))
    closed = False
    if rng.integers(2):
        x, y, w = *rng.uniform(2, 12, 2), rng.uniform(1.5, 6)
        closed = bool(rng.integers(2))
        door = 0.0 if closed else rng.uniform(0.5, 1.5)
        walls += [(x, y, x + w, y), (x + w, y, x + w, y + w), (x + w, y + w, x, y + w), (x, y + w, x, y + door)]
    obstacles, enclosures = inflated(walls, float(rng.uniform(0.1, 0.4)), int(rng.integers(1, 6)))
    rings = [shapely.Polygon(loop) for loop in (*obstacles, *enclosures)]
    solid = reduce(shapely.symmetric_difference, rings)  # loops are nested or apart: solid is what an odd number holds
    start, goal = _free(rng, solid), _free(rng, solid) if rng.integers(8) else next(_uniform(rng))
    goal = (x + w / 2, y + w / 2) if closed else goal
    return Scene(obstacles, enclosures, start, goal, bool(rng.integers(2)), solid, "walls")


def _free(rng: np.random.Generator, solid: BaseGeometry) -> tuple[float, float]:
    return next(point for point in _uniform(rng) if not solid.intersects(shapely.Point(point)))


def _lattice(rng: np.random.Generator) -> Scene:
    """Unions of unit squares, start and goal on the same lattice: M-lines through corners and along edges."""
    n = 10
    cells = rng.random((n, n)) < rng.uniform(0.1, 0.5)
    while (fill := _diagonal(cells)) is not None:
        cells[fill] = True
    solid = shapely.union_all([shapely.box(i, j, i + 1, j + 1) for i, j in np.argwhere(cells)])
    if rng.integers(2):
        solid = solid.union(_frame(shapely.box(-1, -1, n + 1, n + 1)))
    half = 0.5 if rng.integers(2) else 1.0
    points = iter([tuple((half * rng.integers(0, 2 * n + 1, 2) % (n + 1)).tolist()) for _ in range(1000)])
    return _scene(rng, solid, points, "lattice")


def _diagonal(cells: Any) -> tuple[int, int] | None:
    """Return a cell to fill where two squares touch at a corner only."""
    a, b, c, d = cells[:-1, :-1], cells[1:, :-1], cells[:-1, 1:], cells[1:, 1:]
    for i, j in np.argwhere((a & d & ~b & ~c) | (b & c & ~a & ~d)):
        return (int(i) + 1, int(j)) if cells[i, j] else (int(i), int(j))
    return None


def spiral(turns: int, width: float) -> Loop:
    """Return a rectangular spiral corridor around the origin's square, *width* wide, open at its outer end."""
    path, x, y = [(0.0, 0.0)], 0.0, 0.0
    for turn in range(turns):
        length = width * (turn // 2 + 1)
        x, y = x + length * (1, 0, -1, 0)[turn % 4], y + length * (0, 1, 0, -1)[turn % 4]
        path.append((x, y))
    wall = shapely.LineString(path).buffer(0.1 * width, cap_style="flat", join_style="mitre")
    return np.asarray(wall.exterior.coords)[:-1]
