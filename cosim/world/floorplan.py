"""The truth about a floor: its walls, its extent, and where no robot can be."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final, Self, TypeAlias

import numpy as np
import shapely
from pydantic import Field, field_validator, model_validator

from cosim.documents import read_yaml, validated
from cosim.errors import UserError
from cosim.geometry.segments import SegmentGrid, segment_grid
from cosim.settings import Settings
from cosim.world.maps import OccupancyMap, read_movingai_map, read_ros_map
from cosim.world.offices import OfficeSettings, office_walls

Floats: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]
Bools: TypeAlias = np.ndarray[Any, np.dtype[np.bool_]]
Point: TypeAlias = tuple[float, float]
Wall: TypeAlias = tuple[float, float, float, float]
Polygons: TypeAlias = tuple[tuple[Point, ...], ...]

GENERATED: Final = "office"
INLINE: Final = "walls"


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

    _solid_polygons = field_validator("polygons")(_solid)
    _ordered_bounds = field_validator("bounds_m")(_ordered)

    @model_validator(mode="after")
    def _has_extent(self) -> Self:
        if self.bounds_m is None and not (self.walls or self.polygons):
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
    bounds_m: Wall | None = Field(
        default=None,
        description='extent x_min, y_min, x_max, y_max of the map "walls"; default: that of its walls and polygons',
    )
    resolution_m: float = Field(default=1.0, gt=0, description="size of a cell of a MovingAI map")
    unknown_is_occupied: bool = Field(default=True, description="unknown cells of a ROS map are solid")

    _solid_polygons = field_validator("polygons")(_solid)
    _ordered_bounds = field_validator("bounds_m")(_ordered)

    @model_validator(mode="after")
    def _has_extent(self) -> Self:
        if self.map == INLINE and self.bounds_m is None and not (self.walls or self.polygons):
            raise ValueError('the map "walls" needs walls, polygons or bounds_m')
        if self.map != INLINE and self.bounds_m is not None:
            raise ValueError(f'bounds_m is for the map "walls" only, the map is {self.map!r}')
        return self


@dataclass(frozen=True, eq=False)
class Floorplan:
    """A floor. The sides of its extent are walls too: nothing leaves it."""

    name: str
    walls_m: Floats
    """Wall segments x1, y1, x2, y2, shape (n, 4)."""
    bounds_m: Wall
    """Extent x_min, y_min, x_max, y_max."""
    polygons_m: Polygons = ()
    """Solid polygons; their sides are among the walls."""
    occupancy: OccupancyMap | None = None
    """The map that the floor was read from, if it was."""
    unknown_is_occupied: bool = True

    def forbidden(self, points_m: Floats) -> Bools:
        """Return at which of *points_m*, shape (n, 2), the floor is occupied, unknown (if that is solid) or ends."""
        points = np.asarray(points_m, dtype=np.float64).reshape(-1, 2)
        x, y = points[:, 0], points[:, 1]
        x_min, y_min, x_max, y_max = self.bounds_m
        mask: Bools = (x < x_min) | (x > x_max) | (y < y_min) | (y > y_max)
        if self.occupancy is not None:
            mask |= self.occupancy.look_up(self.occupancy.solid(self.unknown_is_occupied), points, outside=True)
        for polygon in self._solids:
            mask |= shapely.intersects_xy(polygon, x, y)
        return mask

    @cached_property
    def grid(self) -> SegmentGrid:
        """The walls, sorted for the kernels of :mod:`cosim.geometry.segments`."""
        return segment_grid(self.walls_m)

    @cached_property
    def geometry(self) -> shapely.MultiLineString:
        """The walls as one shapely geometry, for plots and for checking faster models."""
        return shapely.MultiLineString(list(self.walls_m.reshape(-1, 2, 2)))

    @cached_property
    def tree(self) -> shapely.STRtree:
        """The walls in shapely's spatial index, in the order of ``walls_m``."""
        return shapely.STRtree(list(self.geometry.geoms))

    @cached_property
    def _solids(self) -> list[shapely.Polygon]:
        polygons = [shapely.Polygon(ring) for ring in self.polygons_m]
        shapely.prepare(polygons)
        return polygons


def load_floorplan(settings: FloorplanSettings, folder: Path) -> Floorplan:
    """Return the floor that *settings* name; a relative path is looked for in *folder*, then in the working directory.

    The walls and polygons in the settings are added to any map. Raise UserError for a map that is missing or broken.
    """
    if settings.map == GENERATED:
        office = settings.office
        bounds = (0.0, 0.0, office.width_m, office.depth_m)
        return _drawn(GENERATED, settings, bounds, office_walls(office))
    if settings.map == INLINE:
        return _drawn(INLINE, settings, settings.bounds_m, np.zeros((0, 4)))
    path = _find(settings.map, folder)
    if path.suffix == ".map":
        return _mapped(path.stem, settings, read_movingai_map(path, settings.resolution_m))
    if path.suffix not in (".yaml", ".yml"):
        raise UserError(f"{path}: a map ends in .yaml (ROS map or floor) or .map (MovingAI), not {path.suffix!r}")
    content = read_yaml(path)
    if "image" in content:
        return _mapped(path.stem, settings, read_ros_map(path))
    floor = validated(FloorSettings, content, str(path))
    return _drawn(floor.name or path.stem, settings, floor.bounds_m, _rows(floor.walls), floor.polygons)


def _find(name: str, folder: Path) -> Path:
    """Return the file *name*, given absolutely or relative to *folder* or the working directory."""
    for path in (folder / name, Path(name)):
        if path.is_file():
            return path
    raise UserError(
        f"floorplan.map: {name!r} is neither {GENERATED!r} nor {INLINE!r} "
        f"nor a file in {folder} or in the working directory"
    )


def _drawn(
    name: str, settings: FloorplanSettings, bounds: Wall | None, walls: Floats, polygons: Polygons = ()
) -> Floorplan:
    polygons = (*polygons, *settings.polygons)
    rows = np.concatenate((walls, _rows(settings.walls), *map(_sides, polygons)))
    if bounds is None:
        points = rows.reshape(-1, 2)
        (x_min, y_min), (x_max, y_max) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
        if not (x_min < x_max and y_min < y_max):
            raise UserError(f"{name}: walls: they enclose no area, expected bounds_m or walls that span a floor")
        bounds = x_min, y_min, x_max, y_max
    return Floorplan(name, _with_edges(rows, bounds), bounds, polygons)


def _mapped(name: str, settings: FloorplanSettings, occupancy: OccupancyMap) -> Floorplan:
    walls = occupancy.walls_m(occupancy.solid(settings.unknown_is_occupied))
    rows = np.concatenate((walls, _rows(settings.walls), *map(_sides, settings.polygons)))
    return Floorplan(name, rows, occupancy.bounds_m(), settings.polygons, occupancy, settings.unknown_is_occupied)


def _rows(walls: tuple[Wall, ...]) -> Floats:
    return np.array(walls, dtype=np.float64).reshape(-1, 4)


def _sides(ring: tuple[Point, ...]) -> Floats:
    """Return the sides of a polygon as wall segments."""
    vertices = np.array(ring, dtype=np.float64)
    return np.concatenate((vertices, np.roll(vertices, -1, axis=0)), axis=1)


def _with_edges(rows: Floats, bounds: Wall) -> Floats:
    """Append the sides of the extent that no wall covers wholly."""
    x_min, y_min, x_max, y_max = bounds
    corners = ((x_min, y_min), (x_max, y_min), (x_max, y_max), (x_min, y_max))
    present = {frozenset(((a, b), (c, d))) for a, b, c, d in rows.tolist()}
    edges = [
        (*a, *b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True) if frozenset((a, b)) not in present
    ]
    return np.concatenate((rows, _rows(tuple(edges))))
