"""Floors from every source: what is solid, what is a wall, and that all of a floor can be reached."""

import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from pydantic import ValidationError

from cosim.errors import UserError
from cosim.geometry.grids import coverage_grid
from cosim.geometry.segments import sees
from cosim.world.floorplan import WALL_LOSS_DB, FloorplanSettings, load_floorplan
from cosim.world.offices import OfficeSettings, office_walls, thick_walls
from cosim.world.sight import wall_losses_db
from tests.checkout import ROOT

MAPS = ROOT.parent / "shared" / "maps"
HERE = Path()


def floor(folder=HERE, **settings):
    return load_floorplan(FloorplanSettings(**settings), folder)


def cells(plan, cell_m=0.4, radius_m=0.2):
    return coverage_grid(plan.bounds_m, cell_m, radius_m, plan.walls_m, plan.forbidden)


def test_inline_walls_are_closed_by_their_extent():
    plan = floor(map="walls", walls=[(0, 0, 4, 0), (2, 0, 2, 3)])
    assert plan.bounds_m == (0, 0, 4, 3)
    assert len(plan.walls_m) == 5  # the side y = 0 is a wall already
    assert not sees(plan.grid, [(1, 1), (1, 1)], [(3, 1), (1, 5)]).any()
    assert plan.forbidden(np.array([(1, 1), (-0.1, 1), (1, 3.1)])).tolist() == [False, True, True]


def test_the_inside_and_the_sides_of_a_polygon_are_solid():
    plan = floor(map="walls", bounds_m=(0, 0, 10, 10), polygons=[[(2, 2), (6, 2), (2, 6)]])
    points = np.array([(3, 3), (2, 4), (5, 5), (1, 1)])
    assert plan.forbidden(points).tolist() == [True, True, False, False]
    assert not sees(plan.grid, [(1, 3)], [(8, 3)])[0]


def test_walls_and_polygons_are_added_to_any_map():
    plain = floor()
    more = floor(walls=[(1, 1, 1, 2)], polygons=[[(2, 1), (3, 1), (3, 2)]])
    assert len(more.walls_m) == len(plain.walls_m) + 4
    assert more.bounds_m == plain.bounds_m == (0, 0, 20, 12)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"map": "walls"}, "needs walls, polygons or bounds_m"),
        ({"map": "walls", "bounds_m": (0, 0, 0, 1)}, "expected x_min < x_max"),
        ({"bounds_m": (0, 0, 1, 1)}, 'is for the map "walls" only'),
        ({"polygons": [[(0, 0), (1, 1)]]}, "polygon 0 has 2 vertices"),
        ({"polygons": [[(0, 0), (1, 1), (1, 0), (0, 1)]]}, "polygon 0 touches or crosses itself"),
        ({"walls": [(0, 0, math.inf, 1)]}, "finite number"),
        ({"resolution_m": 0}, "greater than 0"),
    ],
)
def test_settings_that_make_no_floor_are_refused(settings, message):
    with pytest.raises(ValidationError, match=message):
        FloorplanSettings(**settings)


def test_a_path_is_looked_for_beside_the_scenario_then_in_the_working_directory(tmp_path, monkeypatch):
    near, far = tmp_path / "near", tmp_path / "far"
    for folder, name in ((near, "near"), (far, "far")):
        folder.mkdir()
        (folder / "f.yaml").write_text(f"name: {name}\nbounds_m: [0, 0, 1, 1]\n")
    monkeypatch.chdir(far)
    assert floor(near, map="f.yaml").name == "near"
    (near / "f.yaml").unlink()
    assert floor(near, map="f.yaml").name == "far"
    assert floor(near, map=str(far / "f.yaml")).name == "far"


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("f.yaml", None, "floorplan.map: 'f.yaml' is neither 'office' nor 'walls' nor a file in"),
        ("f.txt", "", "f.txt: a map ends in .yaml (ROS map or floor) or .map (MovingAI), not '.txt'"),
        ("f.yaml", "- 1", "f.yaml: holds [1], expected a mapping of settings"),
        ("f.yaml", "walls: [[0, 0, 1]]", "f.yaml: walls[0][3]: is missing"),
        ("f.yaml", "walls: [[0, 0, 1, x]]", "f.yaml: walls[0][3]: 'x' is not a valid number"),
        ("f.yaml", "wals: []", "f.yaml: wals: [] is not expected here: there is no such key, did you mean walls?"),
        ("f.yaml", "polygons: [[[0, 0], [1, 1]]]", "f.yaml: polygons: [[[0, 0], [1, 1]]] polygon 0 has 2 vertices"),
        ("f.yaml", "name: f", "a floor needs walls, polygons or bounds_m"),
        ("f.yaml", "walls: [[0, 0, 1, 0]]", "f: walls: they enclose no area"),
        ("f.yaml", "walls: [", "f.yaml: line 1, column 9: "),
        ("f.yaml", "name: \x01", "f.yaml: is not YAML"),
    ],
)
def test_a_map_that_cannot_be_used_is_named(tmp_path, name, text, message):
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(UserError) as error:
        floor(tmp_path, map=name)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_unknown_cells_are_solid_unless_the_scenario_says_otherwise(tmp_path):
    (tmp_path / "m.pgm").write_bytes(b"P5 3 1 255\n\xfe\x80\x00")
    (tmp_path / "m.yaml").write_text(
        "image: m.pgm\nresolution: 1\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    where = np.array([(0.5, 0.5), (1.5, 0.5), (2.5, 0.5), (3.5, 0.5)])
    solid, open_ = floor(tmp_path, map="m.yaml"), floor(tmp_path, map="m.yaml", unknown_is_occupied=False)
    assert solid.forbidden(where).tolist() == [False, True, True, True]
    assert open_.forbidden(where).tolist() == [False, False, True, True]
    assert [1.0, 0.0, 1.0, 1.0] in solid.walls_m.tolist()
    assert [2.0, 0.0, 2.0, 1.0] in open_.walls_m.tolist()


@pytest.mark.parametrize("rooms", [1, 2, 7, 10, 16])
@pytest.mark.parametrize("seed", range(4))
def test_every_room_of_an_office_can_be_reached_from_the_corridor(rooms, seed):
    settings = OfficeSettings(width_m=24.0, rooms=rooms, seed=seed)
    plan = floor(office=settings)
    # with its doors shut the floor falls apart into the rooms and the corridor
    shut = [*plan.geometry.geoms, *gaps(plan.walls_m)]
    faces = shapely.polygonize([shapely.union_all(shut)]).geoms
    assert len(faces) == rooms + 1
    grid = cells(plan)
    assert (grid.reachable == grid.free).all()
    reached = shapely.multipoints(grid.centres_m()[grid.reachable])
    assert all(face.intersects(reached) for face in faces)


def gaps(walls):
    """The doors: what lies between two pieces of wall on one line, one metre apart."""
    found = []
    for a in walls.tolist():
        for b in walls.tolist():
            if a[1] == a[3] == b[1] == b[3] and math.isclose(b[0] - a[2], 1.0):
                found.append(shapely.LineString([(a[2], a[1]), (b[0], b[1])]))
            if a[0] == a[2] == b[0] == b[2] and math.isclose(b[1] - a[3], 1.0):
                found.append(shapely.LineString([(a[0], a[3]), (b[0], b[1])]))
    return found


def test_an_office_depends_on_its_seed_only():
    assert office_walls(OfficeSettings(seed=5)).tolist() == office_walls(OfficeSettings(seed=5)).tolist()
    assert office_walls(OfficeSettings(seed=5)).tolist() != office_walls(OfficeSettings(seed=6)).tolist()


@pytest.mark.parametrize("seed", range(4))
def test_thick_walls_of_an_office_stand_astride_the_lines_of_thin_ones(seed):
    office = {"width_m": 24.0, "rooms": 7, "seed": seed}
    thin, thick = floor(office=office), floor(office={**office, "wall_m": 0.3})
    inner = [line for line in thin.geometry.geoms if not touches_edge(line, thin.bounds_m)]
    points = np.random.default_rng(seed).uniform((0, 0), (24, 12), (4000, 2))
    points = np.concatenate((points, np.linspace((0, 5.1), (24, 5.1), 500), np.linspace((0, 4.9), (24, 4.9), 500)))
    near = np.zeros(len(points), bool)
    for line in inner:  # within half of the thickness, beside the wall and not beyond its ends
        (ax, ay), (bx, by) = line.coords
        along = ((points - (ax, ay)) @ (bx - ax, by - ay)) / line.length
        near |= (shapely.distance(line, shapely.points(points)) < 0.15) & (along >= 0) & (along <= line.length)
    assert near.sum() > 300
    assert thick.forbidden(points).tolist() == near.tolist()
    grid = cells(thick, 0.1, 0.3)
    assert (grid.reachable == grid.free).all()


def touches_edge(line, bounds):
    return line.within(shapely.box(*bounds).exterior)


def test_a_signal_loses_as_much_in_a_thick_wall_of_an_office_as_in_a_thin_one():
    for wall_m in (0.0, 0.2):
        plan = floor(office={"seed": 1, "wall_m": wall_m}, wall_kind="heavy")
        (x, y, far_x, _), *_ = [wall for wall in office_walls(OfficeSettings()).tolist() if wall[1] == wall[3] == 7.0]
        middle = (x + far_x) / 2
        loss = wall_losses_db(plan.grid, plan.wall_loss_db, [(middle, y - 0.5), (middle, y + 0.5)])
        assert loss[0, 1] == pytest.approx(WALL_LOSS_DB["heavy"])


def test_corners_of_thick_walls_are_whole_and_what_is_shut_in_is_refused():
    (corner,) = thick_walls(np.array([(0.0, 0, 4, 0), (4, 0, 4, 3)]), 0.2)
    assert set(corner) == {(0, -0.1), (4.1, -0.1), (4.1, 3), (3.9, 3), (3.9, 0.1), (0, 0.1)}
    with pytest.raises(ValueError, match="expected a door to everywhere"):
        thick_walls(np.array([(0.0, 0, 4, 0), (4, 0, 4, 3), (4, 3, 0, 0)]), 0.2)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"wall_m": 0.4}, "less than 0.4"),
        ({"wall_m": 0.3, "corridor_m": 0.25}, "is not < 0.25, corridor_m"),
        ({"rooms": 40}, "is too many: with doors of 1.0 m, 28 fit into width_m"),
        ({"corridor_m": 11.0}, "leaves rooms a depth of 0.5 m beside corridor_m, expected 1.4 m"),
        ({"door_m": -1}, "greater than 0"),
    ],
)
def test_an_office_that_does_not_fit_is_refused(settings, message):
    with pytest.raises(ValidationError, match=message):
        OfficeSettings(**settings)


@pytest.mark.parametrize("cell_m", [0.4, 0.5, 0.6])
def test_all_of_the_storey_can_be_reached_with_the_usual_body(cell_m):
    grid = cells(floor(ROOT, map="experiments/floors/storey.yaml"), cell_m)
    assert (grid.reachable == grid.free).all()
    assert grid.free.sum() * cell_m**2 > 0.85 * 30 * 18


def test_the_geometry_for_plots_holds_the_walls():
    plan = floor()
    assert len(plan.geometry.geoms) == len(plan.walls_m) == len(plan.tree.geometries)
    assert plan.tree.query(shapely.Point(0, 0)).size


@pytest.mark.parametrize(
    ("name", "bounds"),
    [
        ("depot.yaml", (0, 0, 30.2, 15.35)),
        pytest.param("willow.yaml", (0, 0, 54, 58.7), marks=pytest.mark.slow),
        ("room-32-32-4.map", (0, 0, 32, 32)),
        ("room-64-64-16.map", (0, 0, 64, 64)),
    ],
)
def test_real_maps_give_floors(name, bounds):
    if not (MAPS / name).is_file():
        pytest.skip("the real maps lie beside the checkout, in ../shared/maps; they are not there")
    plan = floor(map=str(MAPS / name))
    assert plan.bounds_m == pytest.approx(bounds)
    grid = cells(plan)
    centres = grid.centres_m()[grid.free]
    assert (shapely.distance(shapely.points(centres[::7]), plan.geometry) >= 0.2 - 1e-9).all()
    assert grid.reachable.sum() > 0.9 * grid.free.sum() > 0.3 * grid.nx * grid.ny


# ---------------------------------------------------------------- what walls cost


def losses(plan):
    """The loss of every wall, by its ends."""
    assert plan.wall_loss_db.shape == (len(plan.walls_m),)
    return dict(zip(map(tuple, plan.walls_m.tolist()), plan.wall_loss_db.tolist(), strict=True))


def test_walls_are_light_unless_their_kind_is_told():
    plan = floor(map="walls", bounds_m=(0, 0, 9, 9), walls=[(1, 1, 1, 2)], walls_by_kind={"heavy": [(2, 1, 2, 2)]})
    cost = losses(plan)
    assert cost[1, 1, 1, 2] == 4.5
    assert cost[2, 1, 2, 2] == 10.0
    assert cost[0, 0, 9, 0] == 10.0  # the sides of the extent
    assert set(losses(floor()).values()) == {4.5}


def test_a_kind_may_be_given_another_loss_or_be_invented():
    plan = floor(
        walls=[(1, 1, 1, 2)],
        walls_by_kind={"glass": [(2, 1, 2, 2)], "heavy": [(3, 1, 3, 2)]},
        wall_loss_db={"glass": 2, "heavy": 12},
    )
    cost = losses(plan)
    assert (cost[1, 1, 1, 2], cost[2, 1, 2, 2], cost[3, 1, 3, 2]) == (4.5, 2.0, 12.0)


def test_what_walls_without_a_kind_are_can_be_chosen():
    assert set(losses(floor(wall_kind="heavy", polygons=[[(2, 1), (3, 1), (3, 2)]])).values()) == {10.0, 5.0}


def test_the_sides_of_what_is_solid_cost_half(tmp_path):
    (tmp_path / "m.map").write_text("type octile\nheight 1\nwidth 3\nmap\n.@.\n")
    plan = floor(tmp_path, map="m.map", walls=[(0.5, 0, 0.5, 1)], polygons=[[(2.2, 0.2), (2.6, 0.2), (2.4, 0.8)]])
    cost = losses(plan)
    assert cost[1, 0, 1, 1] == cost[2, 0, 2, 1] == cost[2.2, 0.2, 2.6, 0.2] == 2.25
    assert cost[0.5, 0, 0.5, 1] == 4.5
    through = wall_losses_db(plan.grid, plan.wall_loss_db, [(0.1, 0.5), (0.7, 0.5), (2.1, 0.5), (2.9, 0.5)])
    assert through[0].tolist() == [0.0, 4.5, 9.0, 13.5]


def test_a_floor_file_tells_its_kinds_and_the_scenario_may_overrule_it(tmp_path):
    (tmp_path / "f.yaml").write_text(
        "wall_kind: heavy\nwalls: [[0, 0, 4, 0]]\nwalls_by_kind: {glass: [[1, 0, 1, 3]], light: [[2, 0, 2, 3]]}\n"
        "wall_loss_db: {glass: 2, light: 4}\n"
    )
    cost = losses(floor(tmp_path, map="f.yaml", walls=[(3, 0, 3, 3)]))
    assert [cost[wall] for wall in ((0, 0, 4, 0), (1, 0, 1, 3), (2, 0, 2, 3), (3, 0, 3, 3))] == [10, 2, 4, 4]
    cost = losses(floor(tmp_path, map="f.yaml", wall_loss_db={"glass": 3}))
    assert (cost[1, 0, 1, 3], cost[2, 0, 2, 3]) == (3, 4)


def test_walls_by_kind_make_a_floor_alone():
    assert floor(map="walls", walls_by_kind={"light": [(0, 0, 4, 3)]}).bounds_m == (0, 0, 4, 3)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"wall_kind": "hevy"}, "office: walls of the kind 'hevy' have no wall_loss_db, did you mean heavy?"),
        ({"walls_by_kind": {"glass": [(1, 1, 1, 2)]}}, "'glass' have no wall_loss_db, expected one of heavy, light"),
        ({"wall_loss_db": {"haevy": 12}}, "office: wall_loss_db: no wall is of the kind 'haevy', did you mean heavy?"),
    ],
)
def test_a_kind_without_a_loss_and_a_loss_without_a_wall_are_refused(settings, message):
    with pytest.raises(UserError) as error:
        floor(**settings)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"wall_loss_db": {"light": -1}}, "greater than or equal to 0"),
        ({"wall_loss_db": {"light": math.inf}}, "finite number"),
        ({"map": "walls", "walls_by_kind": {"light": []}}, "needs walls, polygons or bounds_m"),
    ],
)
def test_losses_that_make_no_sense_are_refused(settings, message):
    with pytest.raises(ValidationError, match=message):
        FloorplanSettings(**settings)
