"""Bodies that follow paths: where they are at ticks and between, in closed form; files, and what is wrong with them."""

import math
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim.errors import UserError
from cosim.geometry.segments import segment_grid
from cosim.machine import Drive, GoTo
from cosim.robots.body import BodySettings
from cosim.robots.motion import Fleet
from cosim.robots.trajectories import Paths, load_paths, read_csv, read_ns2
from cosim.scenario import Scenario, build, load
from cosim.simulation import Simulation
from cosim.units import MS, S

TICK = 100 * MS
HEAD = "robot,time_s,x_m,y_m\n"
CORNERS = "robot,time_s,x_m,y_m\n0,1,2,3\n0,1.05,2,3.5\n0,2.55,5,3.5\n\n0,4,5,3.5\n0,6,1,0.5\n"


def following(text: str, *, ns2: bool = False, walls: Any = (), others: int = 0) -> Fleet:
    """Return bodies that follow the paths of *text*, and behind them *others* at rest in a row at y = 10."""
    paths = Paths((read_ns2 if ns2 else read_csv)(text, "paths"))
    starts = [*paths.starts_m.values(), *((2.0 * other, 10.0) for other in range(others))]
    return Fleet([BodySettings()] * len(starts), starts, segment_grid(walls), TICK, paths=paths)


def ticks(fleet: Fleet, count: int) -> list[list[float]]:
    """Return x, y, heading, speed of body 0 at each tick, the first of them at the start."""
    seen = [fleet.observed[0, :4].tolist()]
    for _ in range(count):
        fleet.step()
        seen.append(fleet.observed[0, :4].tolist())
    return seen


def between(points: list[tuple[Any, Any, Any]], time: Fraction) -> tuple[Fraction, Fraction]:
    """Return where who goes from point to point (t, x, y) is at *time*."""
    exact = [tuple(map(Fraction, map(str, point))) for point in points]
    if time <= exact[0][0]:
        return exact[0][1:]
    for (t0, x0, y0), (t1, x1, y1) in pairwise(exact):
        if t0 <= time <= t1:
            part = (time - t0) / (t1 - t0)
            return x0 + part * (x1 - x0), y0 + part * (y1 - y0)
    return exact[-1][1:]


def near(point: tuple[Any, Any]) -> Any:
    return pytest.approx([float(number) for number in point], abs=1e-12)


# ---------------------------------------------------------------- where bodies are


def test_at_every_tick_a_body_is_where_its_path_says() -> None:
    points = [(1, 2, 3), (1.05, 2, 3.5), (2.55, 5, 3.5), (4, 5, 3.5), (6, 1, 0.5)]
    for tick, (x, y, *_) in enumerate(ticks(following(CORNERS), 80)):
        assert [x, y] == near(between(points, Fraction(tick, 10))), tick


def test_at_a_waypoint_on_a_tick_it_is_there_to_the_bit() -> None:
    seen = ticks(following("robot,time_s,x_m,y_m\n0,0,0.4,0.2\n0,0.3,0.1,1.3\n0,0.9,0.3,0.4\n"), 12)
    assert seen[0][:2] == [0.4, 0.2]
    assert seen[3][:2] == [0.1, 1.3]
    assert seen[9][:2] == seen[12][:2] == [0.3, 0.4]


def test_between_ticks_it_goes_straight_so_that_a_corner_there_is_cut() -> None:
    fleet = following(CORNERS)
    for _ in range(10):
        fleet.step()
    # from (2, 3) at 1 s by (2, 3.5) at 1.05 s, at 2 m/s, to (2.1, 3.5) at 1.1 s
    for part in (0.0, 0.25, 0.5, 1.0):
        x, y, heading = fleet.pose_at(0, S + round(part * TICK))
        assert [x, y] == near((2 + 0.1 * part, 3 + 0.5 * part))
    assert heading == pytest.approx(0.0, abs=1e-12)


def test_it_faces_the_way_that_it_goes_and_tells_its_speed() -> None:
    seen = ticks(following(CORNERS), 70)
    assert [seen[tick][2] for tick in (0, 5, 10)] == pytest.approx([math.pi / 2] * 3)  # as it will set out
    assert seen[20][2] == seen[30][2] == 0.0  # it stands as it has come
    assert seen[50][2] == pytest.approx(math.atan2(-3, -4))
    assert seen[20][3] == pytest.approx(2.0)  # m/s, more than its own drive could
    assert seen[35][3] == seen[65][3] == 0.0
    assert seen[50][3] == pytest.approx(2.5)


def test_given_headings_turn_the_shorter_way() -> None:
    fleet = following("heading_rad,robot,time_s,x_m,y_m\n3,0,0,0,0\n-3,0,1,0,0\n")
    turn = 2 * math.pi - 6
    for tick, (_, _, heading, _) in enumerate(ticks(fleet, 15)):
        expected = 3 + turn * min(tick, 10) / 10
        assert math.remainder(heading - expected, 2 * math.pi) == pytest.approx(0.0, abs=1e-12)
        assert abs(heading) <= math.pi
    fleet = following("heading_rad,robot,time_s,x_m,y_m\n3,0,0,0,0\n-3,0,1,0,0\n")
    assert fleet.pose_at(0, 50 * MS)[2] == pytest.approx(3 + turn / 20)


MOVEMENTS = """
# setdest's own head
set opt(x) 100
$node_(0) set X_ 10.0
$node_(0) set Y_ 5.0
$node_(0) set Z_ 0.0
$god_ set-dist 0 1 2
$node_(1) set X_ 1
$node_(1) set Y_ 2
$ns_ at 8.0 "$node_(0) setdest 10 8 0.5"
$ns_ at 2.5 "$node_(0) setdest 20.0 5.0 1.5"
$ns_ at 4.5 "$node_(0) setdest 13.0 9.0 2.0"
$ns_ at 9.0 "$god_ set-dist 0 1 1"
$ns_ at 12.0 "$node_(0) setdest 0 0 0"
"""


def test_nodes_of_ns2_go_to_each_destination_until_the_next_is_told() -> None:
    fleet = following(MOVEMENTS, ns2=True)
    # 3 m of ten until 4.5 s; then 4 m at 2 m/s until 6.5 s; from 8 s to (10, 8), 10**0.5 m at 0.5 m/s, 4 s of them
    stop = 8 + 2 * math.sqrt(10)
    way = 2 / math.sqrt(10)
    end = 13 - 3 * way, 9 - way
    points = [(0, 10, 5), (2.5, 10, 5), (4.5, 13, 5), (6.5, 13, 9), (8, 13, 9), (12, *end)]
    assert stop > 12
    for tick, (x, y, *_) in enumerate(ticks(fleet, 140)):
        assert [x, y] == pytest.approx([*map(float, between(points, Fraction(tick, 10)))], abs=1e-9), tick
    assert fleet.positions_m[1].tolist() == [1.0, 2.0]


# ---------------------------------------------------------------- others, walls, commands


@pytest.mark.parametrize("others", [1, 40])
def test_nothing_keeps_who_follows_a_path_and_no_command_moves_it(others: int) -> None:
    walls = [(3.0, 0.0, 3.0, 20.0)]
    text = "robot,time_s,x_m,y_m\n0,0,-1,10.2\n0,11,10,10.2\n"  # through a wall and others
    fleet = following(text, walls=walls, others=others)
    fleet.apply([(0, Drive(-1.0, 2.0))])
    for tick in range(1, 60):
        fleet.step()
        assert fleet.positions_m[0].tolist() == near((tick / 10 - 1, 10.2))
        assert not fleet.observed[0, 5], "it was not blocked"
        if tick == 20:
            fleet.apply([(0, GoTo(2.504, 10.2))])  # which it will pass
    assert not fleet.observed[0, 4], "it has not gone where it was sent"


def test_who_passes_by_where_it_was_sent_has_not_arrived() -> None:
    fleet = following(HEAD + "0,0,0,0\n0,20,1,0\n")  # 5 mm a tick
    fleet.apply([(0, GoTo(0.503, 0.0))])
    for _ in range(150):
        fleet.step()
        assert not fleet.observed[0, 4]


def test_who_drives_stops_before_who_follows_a_path() -> None:
    fleet = following("robot,time_s,x_m,y_m\n0,0,3,10\n0,9,3,10\n0,10,3,12\n", others=1)  # body 1 is at (0, 10)
    fleet.apply([(1, GoTo(6.0, 10.0))])
    for _ in range(90):
        fleet.step()
        assert fleet.positions_m[1, 0] <= 2.6 + 1e-9
    assert fleet.observed[1, 5]
    for _ in range(150):
        fleet.step()
    assert fleet.positions_m[1].tolist() == [6.0, 10.0]


# ---------------------------------------------------------------- files


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (HEAD + "0,0,1,1\n0,x,2,2\n", "line 3: time_s: 'x' is not a number"),
        (HEAD + "0,0,1,1\n0,0.0,2,2\n", "line 3: time_s: 0.0 is not > that of the robot's row before, line 2"),
        (HEAD + "0,-1,1,1\n", "line 2: time_s: -1 is not >= 0 and <= 1e\\+09"),
        (HEAD + "0,1,nan,1\n", "line 2: x_m: nan is not >= -1e\\+06 and <= 1e\\+06"),
        (HEAD + "0,1,1\n", "line 2: 3 values for 4 columns"),
        (HEAD + "0,1,1,21\n", r"line 2: \(1, 21\) is outside of the floor, expected 0..20 by 0..20 m"),
        (HEAD + "0,1,1,1\n3,1,1,1\n", "line 3: there is no robot 3 in the team, expected 0 to 2"),
        (HEAD + "-1,1,1,1\n", "line 2: robot: '-1' is not the number of a robot"),
        (HEAD, "holds no point of any path"),
        ("", "line 1: the column robot is missing"),
        ("robot,time_s,x_m,z_m\n", "line 1: the column 'z_m' is not expected, or stands twice"),
        ("robot,time_s,x_m,x_m\n", "line 1: the column 'x_m' is not expected, or stands twice"),
        ("robot,time_s,x_m\n", "line 1: the column y_m is missing"),
        ("robot,time_s,x_m,y_m,heading_rad\n0,0,1,1,\n", "line 2: heading_rad: '' is not a number"),
    ],
)
def test_what_is_wrong_with_a_csv_is_told_with_its_line(text: str, told: str, tmp_path: Path) -> None:
    (tmp_path / "walk.csv").write_text(text)
    with pytest.raises(UserError, match=rf"^{tmp_path}/walk.csv: {told}"):
        load_paths("walk.csv", tmp_path, range(3), (0.0, 0.0, 20.0, 20.0))


NODE = "$node_(0) set X_ 1\n$node_(0) set Y_ 1\n"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (NODE + "$ns_ at 1 '$node_(0) setdest 1 2 3'", r"line 3: .* is not one of \$node_\(0\) set X_ 1, "),
        (NODE + '$ns_ at 1 "$node_(0) setdest 1 2"', "line 3: .* is not one of "),
        (NODE + '$ns_ at 1 "$node_(0) set X_ 2"', "line 3: .* is not one of "),
        (NODE + '$ns_ at 1 "$node_(0) setdest 1 2 -3"', "line 3: speed: -3 is not >= 0"),
        (NODE + '$ns_ at 1 "$node_(0) setdest 1 2 1e-12"', "line 3: speed: 1e-12 is too little: it takes 1e\\+12 s"),
        (NODE + '$ns_ at then "$node_(0) setdest 1 2 3"', "line 3: at: 'then' is not a number"),
        (NODE + '\n$ns_ at 1 "$node_(0) setdest 1 30 3"', r"line 4: \(1, 30\) is outside of the floor"),
        ('$node_(1) set X_ 3\n$ns_ at 1 "$node_(1) setdest 1 2 3"', r"\$node_\(1\) has no Y_: where does it start"),
        (NODE.replace("(0)", "(7)"), "line 1: there is no robot 7 in the team"),
    ],
)
def test_what_is_wrong_with_movements_is_told_with_its_line(text: str, told: str, tmp_path: Path) -> None:
    (tmp_path / "walk.tcl").write_text(text)
    with pytest.raises(UserError, match=rf"^{tmp_path}/walk.tcl: {told}"):
        load_paths("walk.tcl", tmp_path, range(3), (0.0, 0.0, 20.0, 20.0))


def test_a_file_that_is_not_there_is_told_with_where_it_was_looked_for(tmp_path: Path) -> None:
    told = rf"^team.trajectories: 'walk.csv' is no file in {tmp_path} or in the working directory"
    with pytest.raises(UserError, match=told):
        load_paths("walk.csv", tmp_path, range(3), (0.0, 0.0, 20.0, 20.0))


# ---------------------------------------------------------------- whole runs


def scenario(folder: Path, **settings: Any) -> Scenario:
    plain: dict[str, Any] = {
        "duration_s": 8,
        "floorplan": {"map": "walls", "bounds_m": [0, 0, 20, 20]},
        "team": {"size": 3, "trajectories": "walk.csv"},
        "protocol": {"use": "monitoring"},
    }
    return build(plain | settings, "test", folder)


@pytest.fixture
def walk(tmp_path: Path) -> Path:
    (tmp_path / "walk.csv").write_text(HEAD + "1,0,4,4\n1,8,12,4\n2,2,4,4\n2,6,4,12\n")
    return tmp_path


def test_a_run_has_the_robots_of_the_file_on_their_paths(walk: Path) -> None:
    simulation = Simulation(scenario(walk), 1)
    simulation.begin()
    for tick in range(80):
        simulation.advance(tick * TICK + 1)
        where = simulation.fleet.positions_m.tolist()
        assert where[1] == near((4 + tick / 10, 4))
        assert where[2] == near((4, 4 + 2 * min(max(tick / 10 - 2, 0), 4)))
    assert simulation.outcome().metrics["distance_m"] == pytest.approx(7.9 + 8.0)


def test_a_robot_that_dies_goes_on_and_its_death_is_told(walk: Path) -> None:
    faults = [{"kind": "kill", "robot": 1, "at_s": 2}]
    simulation = Simulation(scenario(walk, faults=faults), 1)
    simulation.begin()
    simulation.advance(3 * S)
    assert simulation.referee.verdict(3 * S)["died_at_s"] == 2.0, "nobody waits until it rests"
    simulation.advance(8 * S)
    outcome = simulation.outcome()
    assert outcome.metrics["robots_killed"] == 1.0
    assert simulation.fleet.positions_m[1].tolist() == near((11.9, 4))


@pytest.mark.parametrize("kind", ["frozen", "moved"])
def test_who_follows_a_path_is_neither_frozen_nor_moved(kind: str, walk: Path) -> None:
    fault = {"kind": kind, "robot": 2, "at_s": 1}
    if kind == "moved":
        fault |= {"to_m": [1, 1]}
    with pytest.raises(UserError, match=rf"^faults\[0\].robot: 2 follows a path, and is never {kind}$"):
        Simulation(scenario(walk, faults=[fault]), 1)


def test_another_content_of_the_file_is_another_scenario(walk: Path) -> None:
    before = scenario(walk).map_digests()
    assert len(before) == 1
    (walk / "walk.csv").write_text(HEAD + "1,0,4,4\n")
    other = scenario(walk).map_digests()
    assert other != before
    (walk / "room.map").write_text("type octile\nheight 2\nwidth 2\nmap\n..\n..\n")
    assert scenario(walk, floorplan={"map": "room.map"}).map_digests()[1:] == other
    assert scenario(walk, team={"size": 3}).map_digests() == []


def test_a_path_of_the_command_line_is_relative_to_where_one_stands(
    walk: Path, monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> None:
    other = tmp_path_factory.mktemp("other")
    (other / "alone.yaml").write_text("duration_s: 1\nteam: {size: 3}\nprotocol: {use: monitoring}\n")
    monkeypatch.chdir(walk)
    given = load(other / "alone.yaml", ["team.trajectories=walk.csv"])
    assert given.team.trajectories == str(walk / "walk.csv")


def test_random_paths_are_followed_as_an_exact_oracle_says() -> None:
    draw = np.random.default_rng(5)
    for _ in range(20):
        times = np.cumsum(draw.integers(1, 30, 8)) / 20
        points = [(time, *draw.integers(0, 100, 2) / 4) for time in times.tolist()]
        text = HEAD + "".join(f"0,{time},{x},{y}\n" for time, x, y in points)
        for tick, (x, y, *_) in enumerate(ticks(following(text), 130)):
            assert [x, y] == near(between(points, Fraction(tick, 10)))
