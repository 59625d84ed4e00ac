"""The truth about a floor: its walls and what they cost a radio signal, its extent, and where no robot can be.

Every wall is of a kind, and a kind has a loss in dB at 2.45 GHz for a signal that crosses the wall. ``light`` (plaster
board, thinner than 10 cm) and ``heavy`` (brick, concrete) are those of COST 231 (final report, section 4.7.2: 3.4 and
6.9 dB at 1800 MHz), raised to what is measured at 2.45 GHz: 4 to 5 and 8 to 12 dB. Others take their name and loss from
``wall_loss_db``. What is solid (a polygon, the cells of a map image) shows a signal two sides where a drawn wall is one
line, so each side costs half: a wall costs the same however it is drawn, and however thick.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Final, NamedTuple, Self, TypeAlias

import numpy as np
import shapely
from pydantic import Field, field_validator, model_validator

from cosim.arrays import Bools, Floats
from cosim.documents import is_file, nearest, read_yaml, validated
from cosim.errors import UserError
from cosim.geometry.segments import PackedWalls, SegmentGrid, packed_walls, segment_grid
from cosim.settings import Decibels, Length, Metres, Settings, error_at
from cosim.world.maps import MOST_SIDES, OccupancyMap, read_movingai_map, read_ros_map
from cosim.world.offices import OfficeSettings, office_solids, office_walls

Point: TypeAlias = tuple[Metres, Metres]
Wall: TypeAlias = tuple[Metres, Metres, Metres, Metres]
Polygons: TypeAlias = tuple[tuple[Point, ...], ...]
WallsByKind: TypeAlias = dict[str, tuple[Wall, ...]]
Losses: TypeAlias = dict[str, Annotated[Decibels, Field(ge=0)]]

GENERATED: Final = "office"
INLINE: Final = "walls"

LIGHT: Final = "light"
HEAVY: Final = "heavy"
WALL_LOSS_DB: Final[Mapping[str, float]] = MappingProxyType({LIGHT: 4.5, HEAVY: 10.0})
"""Losses at 2.45 GHz, dB, of walls of the kinds that need no definition."""
_USUAL: Final = "else " + ", ".join(f"{kind} {loss:g}" for kind, loss in WALL_LOSS_DB.items())


def _solid(polygons: Polygons) -> Polygons:
    """Return *polygons*; raise ValueError for one that encloses nothing or crosses itself."""
    for number, ring in enumerate(polygons):
        if len(ring) < 3:
            raise ValueError(f"polygon {number} has {len(ring)} vertices, expected at least 3")
        if not shapely.Polygon(ring).is_valid:
            raise ValueError(f"polygon {number} touches or crosses itself")
    return polygons


def _ordered(bounds: Wall | None) -> Wall | None:
    if bounds is not None and not (bounds[0] < bounds[2] and bounds[1] < bounds[3]):
        raise ValueError("expected x_min < x_max and y_min < y_max")
    return bounds


class FloorSettings(Settings):
    """A floor drawn by hand: walls as segments, solid polygons; what a floor ``.yaml`` holds."""

    name: str = Field(default="", description="what people call the floor")
    bounds_m: Wall | None = Field(
        default=None, description="extent x_min, y_min, x_max, y_max; default: that of the walls and polygons"
    )
    walls: tuple[Wall, ...] = Field(default=(), description="wall segments x1, y1, x2, y2 in metres")
    polygons: Polygons = Field(default=(), description="solid polygons, vertices in metres")
    places: Mapping[str, tuple[Point, ...]] = Field(
        default={}, description="named points or lines, in metres, for protocols whose robots go somewhere"
    )
    wall_kind: str = Field(default=LIGHT, description="kind of these walls and polygons")
    walls_by_kind: WallsByKind = Field(default={}, description="further wall segments, by their kind")
    wall_loss_db: Losses = Field(default={}, description=f"dB, loss of a signal through a wall, by kind; {_USUAL}")

    _solid_polygons = field_validator("polygons")(_solid)
    _ordered_bounds = field_validator("bounds_m")(_ordered)

    @model_validator(mode="after")
    def _has_extent(self) -> Self:
        if self.bounds_m is None and not (self.walls or any(self.walls_by_kind.values()) or self.polygons):
            raise ValueError("a floor needs walls, polygons or bounds_m")
        return self


class FloorplanSettings(Settings):
    """Which floor a run takes place on."""

    map: str = Field(
        default=GENERATED,
        min_length=1,
        description='"office" (generated), "walls" (those given here), or the path of a ROS map .yaml, '
        "a MovingAI .map or a floor .yaml",
    )
    office: OfficeSettings = Field(default=OfficeSettings(), description="the generated office")
    walls: tuple[Wall, ...] = Field(default=(), description="wall segments x1, y1, x2, y2 in metres, for any map")
    polygons: Polygons = Field(default=(), description="solid polygons, vertices in metres, for any map")
    wall_kind: str = Field(
        default=LIGHT,
        description="kind of these walls and polygons, of those of the generated office and of a map image",
    )
    walls_by_kind: WallsByKind = Field(default={}, description="further wall segments, by their kind, for any map")
    wall_loss_db: Losses = Field(
        default={}, description=f"dB, loss of a signal through a wall, by kind; else what the floor says, {_USUAL}"
    )
    bounds_m: Wall | None = Field(
        default=None,
        description='extent x_min, y_min, x_max, y_max of the map "walls"; default: that of its walls and polygons',
    )
    resolution_m: Length = Field(default=1.0, gt=0, description="size of a cell of a MovingAI map")
    unknown_is_occupied: bool = Field(default=True, description="unknown cells of a ROS map are solid")

    _solid_polygons = field_validator("polygons")(_solid)
    _ordered_bounds = field_validator("bounds_m")(_ordered)

    @model_validator(mode="after")
    def _has_extent(self) -> Self:
        drawn = self.walls or any(self.walls_by_kind.values()) or self.polygons
        if self.map == INLINE and self.bounds_m is None and not drawn:
            raise ValueError('the map "walls" needs walls, polygons or bounds_m')
        if self.map != INLINE and self.bounds_m is not None:
            raise error_at(("bounds_m",), self.bounds_m, f'is for the map "walls" only, the map is {self.map!r}')
        return self


@dataclass(frozen=True, eq=False)
class Floorplan:
    """A floor. The sides of its extent are walls too: nothing leaves it."""

    name: str
    walls_m: Floats
    """Wall segments x1, y1, x2, y2, shape (n, 4)."""
    wall_loss_db: Floats
    """Loss of each wall to a signal that crosses it, dB, shape (n,)."""
    bounds_m: Wall
    """Extent x_min, y_min, x_max, y_max."""
    polygons_m: Polygons = ()
    """Solid polygons; their sides are among the walls."""
    occupancy: OccupancyMap | None = None
    """Map that the floor was read from; None if it was not."""
    unknown_is_occupied: bool = True
    places_m: Mapping[str, tuple[Point, ...]] = field(default_factory=dict)
    """Points that the floor names."""

    def forbidden(self, points_m: Floats) -> Bools:
        """Return at which of *points_m*, shape (n, 2), the floor is occupied, unknown (if that is solid) or ends."""
        points = np.asarray(points_m, dtype=np.float64).reshape(-1, 2)
        x, y = points[:, 0], points[:, 1]
        x_min, y_min, x_max, y_max = self.bounds_m
        mask: Bools = (x < x_min) | (x > x_max) | (y < y_min) | (y > y_max)
        if self.occupancy is not None:
            mask |= self.occupancy.solid_at(points, self.unknown_is_occupied)
        if self.polygons_m and len(points):
            self._mark_solid(x, y, mask)
        return mask

    def _mark_solid(self, x: Floats, y: Floats, mask: Bools) -> None:
        """Set *mask* where a point is in a polygon; each polygon is asked only about the points in its extent."""
        solids, (x_min, y_min, x_max, y_max) = self._solids
        near = (x_min <= x.max()) & (x_max >= x.min()) & (y_min <= y.max()) & (y_max >= y.min())
        order = np.argsort(y, kind="stable")  # in no time if they are in order, as the cells of a grid are
        first, end = np.searchsorted(y, y_min, "left", order), np.searchsorted(y, y_max, "right", order)
        for k in np.flatnonzero(near).tolist():
            asked = order[first[k] : end[k]]
            asked = asked[(x[asked] >= x_min[k]) & (x[asked] <= x_max[k])]
            mask[asked] |= shapely.intersects_xy(solids[k], x[asked], y[asked])

    @cached_property
    def grid(self) -> SegmentGrid:
        """The walls, sorted for the kernels of :mod:`cosim.geometry.segments`."""
        return segment_grid(self.walls_m)

    @cached_property
    def packed(self) -> PackedWalls:
        """The same for kernels that are called once a tick or more often."""
        return packed_walls(self.grid)

    @cached_property
    def geometry(self) -> shapely.MultiLineString:
        """The walls as one shapely geometry, for plots and for checking faster models."""
        return shapely.MultiLineString(list(self.walls_m.reshape(-1, 2, 2)))

    @cached_property
    def tree(self) -> shapely.STRtree:
        """The walls in shapely's spatial index, in the order of ``walls_m``."""
        return shapely.STRtree(list(self.geometry.geoms))

    @cached_property
    def _solids(self) -> tuple[list[shapely.Polygon], Floats]:
        """The polygons, and their extents: rows x_min, y_min, x_max, y_max."""
        polygons = [shapely.Polygon(ring) for ring in self.polygons_m]
        shapely.prepare(polygons)
        return polygons, shapely.bounds(polygons).T


def load_floorplan(settings: FloorplanSettings, folder: Path) -> Floorplan:
    """Return the floor that *settings* name; a relative path is looked for in *folder*, then in the working directory.

    The walls and polygons in the settings are added to any map. Raise UserError for a map that is missing or broken.
    """
    if settings.map == GENERATED:
        office = settings.office
        bounds, solids = (0.0, 0.0, office.width_m, office.depth_m), tuple(office_solids(office))
        walls = [_Walls(office_walls(office), settings.wall_kind)]
        walls += [_Walls(_sides(ring), settings.wall_kind, 0.5) for ring in solids]
        return _drawn(GENERATED, settings, bounds, walls, FloorSettings(bounds_m=bounds, polygons=solids))
    if settings.map == INLINE:
        return _drawn(INLINE, settings, settings.bounds_m, [])
    path = _find(settings.map, folder)
    if path.suffix == ".map":
        return _mapped(path.stem, settings, read_movingai_map(path, settings.resolution_m))
    if path.suffix not in (".yaml", ".yml"):
        raise UserError(f"{path}: a map ends in .yaml (ROS map or floor) or .map (MovingAI), not {path.suffix!r}")
    content = read_yaml(path)
    if "image" in content:
        return _mapped(path.stem, settings, read_ros_map(path))
    floor = validated(FloorSettings, content, str(path))
    return _drawn(floor.name or path.stem, settings, floor.bounds_m, _walls_of(floor), floor)


class _Walls(NamedTuple):
    """Walls of one kind."""

    rows: Floats
    """Shape (n, 4)."""
    kind: str
    share: float = 1.0
    """Share of the loss at a crossing: 1/2 for the sides of what is solid."""


def _walls_of(settings: FloorSettings | FloorplanSettings) -> list[_Walls]:
    """Return the walls that *settings* draw."""
    walls = [_Walls(_rows(settings.walls), settings.wall_kind)]
    walls += [_Walls(_rows(segments), kind) for kind, segments in settings.walls_by_kind.items()]
    return walls + [_Walls(_sides(ring), settings.wall_kind, 0.5) for ring in settings.polygons]


def _losses_db(name: str, walls: Sequence[_Walls], losses: Mapping[str, float]) -> Floats:
    """Return the loss of each of *walls*, shape (n,); raise UserError for an unknown kind, or one that no wall has."""
    known = {**WALL_LOSS_DB, **losses}
    used = {group.kind for group in walls}
    for kind in sorted(used - known.keys()):
        raise UserError(f"{name}: walls of the kind {kind!r} have no wall_loss_db{nearest(kind, known)}")
    for kind in sorted(losses.keys() - used - WALL_LOSS_DB.keys()):
        raise UserError(f"{name}: wall_loss_db: no wall is of the kind {kind!r}{nearest(kind, used)}")
    return np.concatenate([np.full(len(group.rows), group.share * known[group.kind]) for group in walls])


def _find(name: str, folder: Path) -> Path:
    """Return the file *name*, given absolutely or relative to *folder* or the working directory."""
    for path in (folder / name, Path(name)):
        if is_file(path):
            return path
    raise UserError(
        f"floorplan.map: {name!r} is neither {GENERATED!r} nor {INLINE!r} "
        f"nor a file in {folder} or in the working directory"
    )


def _drawn(
    name: str,
    settings: FloorplanSettings,
    bounds: Wall | None,
    walls: list[_Walls],
    floor: FloorSettings | None = None,
) -> Floorplan:
    """Return the floor of *walls*, which *floor* draws or a program, and of those in *settings*."""
    walls = walls + _walls_of(settings)
    rows = np.concatenate([group.rows for group in walls])
    if bounds is None:
        points = rows.reshape(-1, 2)
        (x_min, y_min), (x_max, y_max) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
        if not (x_min < x_max and y_min < y_max):
            raise UserError(f"{name}: walls: they enclose no area, expected bounds_m or walls that span a floor")
        bounds = x_min, y_min, x_max, y_max
    walls.append(_Walls(_open_edges(rows, bounds), HEAVY))
    rows = np.concatenate((rows, walls[-1].rows))
    floor = floor or FloorSettings(bounds_m=bounds)
    losses_db = _losses_db(name, walls, {**floor.wall_loss_db, **settings.wall_loss_db})
    polygons = (*floor.polygons, *settings.polygons)
    return Floorplan(name, rows, losses_db, bounds, polygons, places_m=floor.places)


def _mapped(name: str, settings: FloorplanSettings, occupancy: OccupancyMap) -> Floorplan:
    try:
        outline = occupancy.walls_m(occupancy.solid(settings.unknown_is_occupied))
    except ValueError:
        raise UserError(
            f"floorplan.map: {settings.map[:60]!r}: its solid cells have more than {MOST_SIDES} sides"
        ) from None
    walls = [_Walls(outline, settings.wall_kind, 0.5), *_walls_of(settings)]
    return Floorplan(
        name,
        np.concatenate([group.rows for group in walls]),
        _losses_db(name, walls, settings.wall_loss_db),
        occupancy.bounds_m(),
        settings.polygons,
        occupancy,
        settings.unknown_is_occupied,
    )


def _rows(walls: tuple[Wall, ...]) -> Floats:
    return np.array(walls, dtype=np.float64).reshape(-1, 4)


def _sides(ring: tuple[Point, ...]) -> Floats:
    """Return the sides of a polygon as wall segments."""
    vertices = np.array(ring, dtype=np.float64)
    return np.concatenate((vertices, np.roll(vertices, -1, axis=0)), axis=1)


def _open_edges(rows: Floats, bounds: Wall) -> Floats:
    """Return the sides of the extent that no wall covers wholly."""
    x_min, y_min, x_max, y_max = bounds
    corners = ((x_min, y_min), (x_max, y_min), (x_max, y_max), (x_min, y_max))
    present = {frozenset(((a, b), (c, d))) for a, b, c, d in rows.tolist()}
    edges = [
        (*a, *b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True) if frozenset((a, b)) not in present
    ]
    return _rows(tuple(edges))
