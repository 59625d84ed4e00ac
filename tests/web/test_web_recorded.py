"""A recorded run: the tables of a real run are read back, and at any time show what the run was then."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim.errors import UserError
from cosim.scenario import Scenario
from cosim.simulation import Simulation
from cosim.trace import FRAMES, TABLES, StoredTable, Trace
from cosim.units import MS, S
from cosim.web.history import Cursor
from cosim.web.messages import Operate, Pause, Plain, Play, Seek, Speed, Step
from cosim.web.recorded import Recorded, is_trace
from cosim.web.scenes import scene_of, write_scene
from tests.web.console import PLAIN

KILL = {"kind": "kill", "robot": 2, "at_s": 2.0}


class Wall:
    """A wall clock that a test moves."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture(scope="module")
def run() -> Simulation:
    plain = PLAIN | {"faults": [KILL], "protocol": {"use": "tests.web.console:SPEC", "parameters": {"calls": 5}}}
    simulation = Simulation(Scenario.model_validate(plain), 1, tuple(TABLES.values()))
    simulation.begin()
    simulation.operate(0, b'{"go": [6.0, 3.0]}')
    simulation.advance(20 * S)
    return simulation


@pytest.fixture(scope="module")
def folder(run: Simulation, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("trace")
    run.trace.write(folder, {"digest": "x"})
    write_scene(scene_of(run.scenario, run.floorplan, 1), folder)
    return folder


@pytest.fixture
def wall() -> Wall:
    return Wall()


@pytest.fixture
def recorded(folder: Path, wall: Wall) -> Recorded:
    return Recorded(folder, wall)


def told(session: Recorded, cursor: Cursor | None = None) -> tuple[Plain, Cursor]:
    [message], new = session.look(cursor)
    return message, new


def test_the_scene_is_that_of_the_run(recorded: Recorded, run: Simulation):
    assert recorded.scene["live"] is False
    assert recorded.scene["bounds_m"] == [0, 0, 12, 8]
    assert [0, 4, 8, 4] in recorded.scene["walls_m"]
    assert recorded.scene["radii_m"] == [0.2] * 3
    assert recorded.scene["duration_s"] == pytest.approx(5.1, abs=0.11)


def test_at_each_tick_the_robots_are_where_the_table_says(recorded: Recorded, run: Simulation, wall: Wall):
    poses = run.trace.columns("poses")
    recorded.wish(Pause(say="pause"))
    for row in range(0, len(poses["time_ns"]), 7):
        recorded.wish(Seek(say="seek", time_s=poses["time_ns"][row] / S))
        x, y, heading, _ = told(recorded)[0]["robots"][poses["source"][row]]
        assert (x, y, heading) == pytest.approx([poses[name][row] for name in ("x_m", "y_m", "heading_rad")], abs=1e-4)


def test_between_two_ticks_they_are_on_the_straight_way(recorded: Recorded, run: Simulation):
    columns = run.trace.columns("poses")
    xs = np.array(columns["x_m"])[np.array(columns["source"]) == 0]
    recorded.wish(Seek(say="seek", time_s=2.125))
    assert told(recorded)[0]["robots"][0][0] == pytest.approx(0.75 * xs[21] + 0.25 * xs[22], abs=2e-4)


def test_a_page_is_told_every_frame_and_event_once(recorded: Recorded, run: Simulation, wall: Wall):
    message, cursor = told(recorded)
    events, frames = list(message["events"]), []
    for _ in range(120):
        wall.now_s += 0.05
        for message in recorded.look(cursor)[0]:
            events += message["events"]
            frames += message["frames"]
        cursor = recorded.look(cursor)[1]
    columns = run.trace.columns("events")
    by_time = sorted(zip(columns["time_ns"], columns["source"], columns["event"], strict=True), key=lambda row: row[0])
    assert [(time_s, source, name) for _, time_s, source, name, _ in events] == [
        (pytest.approx(at / S), source, name) for at, source, name in by_time
    ]
    assert [row[0] for row in events] == list(range(len(events)))
    assert len(frames) == run.trace.count("frames") > 5
    assert message["state"] == "ended"


def test_an_event_has_its_own_fields_only(recorded: Recorded):
    recorded.wish(Seek(say="seek", time_s=5.0))
    events = told(recorded)[0]["events"]
    fields = {name: set(fields) for _, _, _, name, fields in events}
    assert fields == {"Marked": {"x_m", "y_m", "number"}, "Answered": {"said"}, "Killed": set()}


def test_a_killed_robot_is_down_from_then_on(recorded: Recorded):
    downs = []
    for time_s in (1.9, 2.1, 5.0, 1.0):
        recorded.wish(Seek(say="seek", time_s=time_s))
        downs.append([robot[3] for robot in told(recorded)[0]["robots"]])
    assert downs == [[False] * 3, [False, False, True], [False, False, True], [False] * 3]


def test_after_a_jump_a_page_is_told_anew(recorded: Recorded):
    _, cursor = told(recorded)
    recorded.wish(Seek(say="seek", time_s=4.5))
    message, cursor = told(recorded, cursor)
    assert message["fresh"]
    assert len(message["trails"]) == 46
    assert len(message["events"]) > 3
    recorded.wish(Seek(say="seek", time_s=0.5))
    message, _ = told(recorded, cursor)
    assert message["fresh"]
    assert [row[3] for row in message["events"]] == ["Answered"]


def test_steps_go_both_ways_and_stop_at_the_ends(recorded: Recorded):
    recorded.wish(Seek(say="seek", time_s=1.0))
    recorded.wish(Step(say="step", ticks=3))
    message, cursor = told(recorded)
    assert (message["time_s"], message["state"]) == (pytest.approx(1.3), "paused")
    recorded.wish(Step(say="step", ticks=1))
    message, cursor = told(recorded, cursor)
    assert "fresh" not in message
    recorded.wish(Step(say="step", ticks=-2))
    message, cursor = told(recorded, cursor)
    assert (message["time_s"], message["fresh"]) == (pytest.approx(1.2), True)
    recorded.wish(Step(say="step", ticks=-1000))
    assert told(recorded)[0]["time_s"] == 0
    recorded.wish(Step(say="step", ticks=1000))
    assert told(recorded)[0]["state"] == "ended"


def test_play_at_the_end_begins_anew(recorded: Recorded, wall: Wall):
    wall.now_s += 100
    assert told(recorded)[0]["state"] == "ended"
    recorded.wish(Play(say="play"))
    wall.now_s += 0.5
    message, _ = told(recorded)
    assert (message["state"], message["time_s"]) == ("playing", pytest.approx(0.5))


def test_speed_is_kept(recorded: Recorded, wall: Wall):
    recorded.wish(Speed(say="speed", speed=4.0))
    wall.now_s += 0.5
    message, _ = told(recorded)
    assert (message["speed"], message["time_s"]) == (4.0, pytest.approx(2.0))


def test_nothing_is_told_while_nothing_changes(recorded: Recorded, wall: Wall):
    recorded.wish(Pause(say="pause"))
    _, cursor = told(recorded)
    wall.now_s += 10
    assert recorded.look(cursor) == ([], cursor)


def test_nobody_hears_an_operator(recorded: Recorded):
    with pytest.raises(UserError, match="recorded"):
        recorded.wish(Operate(say="operator", robot=0, data={}))


def test_a_trace_without_a_scene_shows_what_the_poses_tell(folder: Path, tmp_path: Path, wall: Wall):
    (tmp_path / "poses.parquet").write_bytes((folder / "poses.parquet").read_bytes())
    bare = Recorded(tmp_path, wall)
    x_min, y_min, x_max, y_max = bare.scene["bounds_m"]
    for x, y, *_ in told(bare)[0]["robots"]:
        assert x_min < x < x_max
        assert y_min < y < y_max
    wall.now_s += 3
    assert told(bare)[0]["events"] == []


@pytest.mark.parametrize(
    ("broken", "expected"),
    [
        ({"poses.parquet": b"x"}, "poses.parquet: cannot be read as Parquet"),
        ({"poses.parquet": None}, "holds no poses.parquet"),
        ({"scene.json": b"{"}, "scene.json: is no JSON"),
        ({"scene.json": b"[]"}, "scene.json: is no scene"),
        ({"events.parquet": b""}, "events.parquet: cannot be read as Parquet"),
    ],
)
def test_a_broken_trace_is_told_in_one_line(folder: Path, tmp_path: Path, broken: dict[str, Any], expected: str):
    for path in filter(Path.is_file, folder.iterdir()):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    for name, content in broken.items():
        (tmp_path / name).unlink()
        if content is not None:
            (tmp_path / name).write_bytes(content)
    with pytest.raises(UserError, match=expected):
        Recorded(tmp_path)


def test_only_a_folder_with_tables_is_a_trace(folder: Path, tmp_path: Path):
    assert is_trace(folder)
    assert not is_trace(tmp_path)
    assert not is_trace(folder / "poses.parquet")


def test_rows_that_were_written_late_are_read_in_the_order_of_time(tmp_path: Path):
    """Frames are, as a row is about the start of a frame and written at its end; those of one instant keep theirs."""
    trace = Trace([FRAMES])
    starts = [50, 20, 50, 10, 20, 50]
    for number, start in enumerate(starts):
        trace.row(FRAMES, start, 0, 1, 5, "DM1", 0, 0, number, "received", "")
    trace.write(tmp_path)
    table = StoredTable(tmp_path / "frames.parquet")
    assert [(row["time_ns"], row["length"]) for row in table.rows(0, 9)] == sorted(
        (start, number) for number, start in enumerate(starts)
    )
    assert [row["length"] for row in table.rows(1, 3)] == [1, 4]


def test_the_tick_of_the_scene_is_a_step(recorded: Recorded):
    recorded.wish(Seek(say="seek", time_s=0))
    recorded.wish(Step(say="step", ticks=1))
    assert told(recorded)[0]["time_s"] == pytest.approx(100 * MS / S)
