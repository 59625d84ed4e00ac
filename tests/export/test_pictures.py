"""Figures and films: what they draw is what the tables hold; the same run gives the same picture."""

import csv
import os
import re
import stat
from collections import Counter
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_rgb
from matplotlib.patches import Rectangle
from PIL import Image
from shapely.geometry import LineString, Point

from cosim.errors import UserError
from cosim.export.lanes import lanes
from cosim.export.recording import Recording
from cosim.picture import film, moment
from cosim.picture.colours import LOOKS, look, state_fill
from cosim.picture.film import write_film
from cosim.picture.moment import View, draw_moment, save_moment
from cosim.picture.seen import CELL_M, seen_floor
from cosim.picture.window import boxes
from cosim.units import MS, S
from tests.export.recordings import sendings, silences

Whole = tuple[Recording, dict[str, pd.DataFrame], Path]


def rows_within(table: Any, begin: int, end: int) -> Any:
    return table[(table["time_ns"] < end) & (table["time_ns"] + table["duration_ns"] > begin)]


@pytest.mark.slow
@pytest.mark.parametrize("which", ["piconet", "walls"])
def test_the_boxes_of_random_windows_are_the_rows_of_the_tables(which: str, request: pytest.FixtureRequest) -> None:
    recording, tables, _ = request.getfixturevalue(which)
    found, draws = lanes(recording), np.random.default_rng(5)
    frames, sent = tables["frames"], sendings(tables)
    seen = 0
    for _ in range(20):
        begin = int(draws.integers(0, recording.end))
        end = begin + int(draws.integers(1, 300 * MS))
        got = boxes(recording, found, begin, end)
        rows = rows_within(frames, begin, end)
        lost = [column if column else "" for column in rows["part"]]
        expected = sorted(
            zip(rows["time_ns"], rows["time_ns"] + rows["duration_ns"], rows["destination"], rows["source"],
                rows["kind"], rows["channel"], rows["outcome"], lost, strict=True)
        )  # fmt: skip
        assert expected == sorted(
            (box.start, box.end, box.robot, box.peer, box.kind, box.channel, box.outcome, box.part)
            for box in got
            if box.what == "received"
        )
        rows = rows_within(sent, begin, end)
        assert sorted((box.start, box.robot, box.kind) for box in got if box.what == "sent") == sorted(
            zip(rows["time_ns"], rows["source"], rows["kind"], strict=True)
        )
        sensed = [
            (*span, robot, radio, what)
            for (robot, radio, what), each in silences(recording, tables).items()
            for span in each
            if span[0] < end and span[1] > begin
        ]
        assert sorted(box[:5] for box in got if box.what in ("busy", "NAV")) == sorted(sensed)
        seen += len(got)
    assert seen > 100


def test_what_is_busy_or_reserved_has_strips_of_its_own_below_the_other_states(line: Any) -> None:
    recording, tables = line
    begin = int(tables["transmissions"]["time_ns"].iloc[55])
    figure, seen = draw_moment(recording, View(begin, begin - 5 * MS, begin + 5 * MS))
    [slots] = [each for each in figure.axes if each.get_xlabel().startswith("time")]
    drawn = [each for each in slots.patches if isinstance(each, Rectangle) and each.get_fill()]
    assert len(drawn) == len(seen)
    heights = {}
    for what in ("states", "busy", "NAV"):
        fills = {to_rgb(state_fill(box.kind)) for box in seen if box.what == what}
        mine = [each for each in drawn if each.get_facecolor()[:3] in fills]
        assert len(mine) == sum(box.what == what for box in seen) >= 3
        heights[what] = {round(each.get_y() + 0.3, 6) for each in mine}
    everywhere = [each for found in heights.values() for each in found]
    assert len(everywhere) == len(set(everywhere))
    legend = [each.get_text() for each in figure.legends[0].texts]
    assert {"busy", "NAV", "DATA"} < set(legend)
    peers = {box.peer for box in seen if box.what == "busy" and box.robot == 0}
    assert peers == {0, 1}  # who is on the air then: nobody hears robot 2


@pytest.fixture(scope="module")
def jammed(piconet: Whole) -> tuple[Any, list[Any], int]:
    """Return a figure about a frame that was lost, its boxes, and when that began."""
    recording, tables, _ = piconet
    lost = tables["frames"][tables["frames"]["outcome"] != "received"].iloc[0]
    at = int(lost["time_ns"] + lost["duration_ns"] // 2)
    return *draw_moment(recording, View(at, at - 5 * MS, at + 5 * MS, channels=True)), int(lost["time_ns"])


@pytest.mark.slow
def test_a_figure_has_a_rectangle_for_each_box_and_a_pattern_for_each_lost_one(jammed: Any) -> None:
    figure, seen, _ = jammed
    [slots] = [each for each in figure.axes if each.get_xlabel().startswith("time")]
    [channels] = [each for each in figure.axes if each.get_ylabel() == "RF channel"]
    drawn = [each for each in slots.patches if isinstance(each, Rectangle) and each.get_fill() and each.get_width() > 0]
    assert len(drawn) == len(seen) > 8
    hatched = [each for each in drawn if each.get_hatch()]
    lost = [box for box in seen if box.outcome not in ("", "received")]
    assert len(hatched) == len(lost) >= 1
    origin = float(re.findall(r"after ([\d.]+) s", slots.get_xlabel())[0]) * S
    lefts = sorted(round(each.get_x() * MS + origin) for each in drawn)
    begin = round(slots.get_xlim()[0] * MS + origin)
    assert lefts == sorted(max(box.start, begin) for box in seen)
    assert len(channels.collections[0].get_paths()) == sum(box.what == "received" for box in seen)


@pytest.mark.slow
def test_an_svg_has_its_texts_as_text_and_is_the_same_each_time(jammed: Any, tmp_path: Path) -> None:
    figure, seen, _ = jammed
    for name in ("one.svg", "two.svg", "one.pdf", "one.png"):
        save_moment(figure, tmp_path / "new" / name)
    one, two = ((tmp_path / "new" / name).read_text() for name in ("one.svg", "two.svg"))
    assert one == two
    assert "<pattern" in one
    for text in ("robot 0", "RF channel", "lost", *{box.kind for box in seen}):
        assert f">{text}<" in one
    assert (tmp_path / "new" / "one.pdf").read_bytes().startswith(b"%PDF")
    with Image.open(tmp_path / "new" / "one.png") as picture:
        assert picture.width > 1000


def luminance(colour: str) -> float:
    red, green, blue = (each / 12.92 if each <= 0.04045 else ((each + 0.055) / 1.055) ** 2.4 for each in to_rgb(colour))
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def test_texts_stand_out_and_kinds_of_one_exchange_differ_in_grey() -> None:
    for fill, ink in LOOKS.values():
        light, dark = sorted((luminance(fill), luminance(ink)), reverse=True)
        assert (light + 0.05) / (dark + 0.05) >= 4.5  # WCAG 1.4.3
    for one, other in (("ID", "FHS"), ("POLL", "NULL"), ("POLL", "DM1"), ("DM1", "DH1"), ("RTS", "CTS"), ("CTS", "ACK"),
                       ("DATA", "ACK"), ("DATA", "RREQ")):  # fmt: skip
        light, dark = sorted((luminance(look(one).fill), luminance(look(other).fill)), reverse=True)
        assert one == "DATA" or (light + 0.05) / (dark + 0.05) > 1.25, (one, other)


@pytest.mark.slow
def test_more_boxes_than_anybody_sees_are_refused(piconet: Whole, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(moment, "MOST_BOXES", 100)
    with pytest.raises(UserError, match=r"^--from, --to: \d{3,} boxes from 0 to 14 s, a figure shows 100 at most$"):
        draw_moment(piconet[0], View(S, 0, 14 * S))


# ---------------------------------------------------------------- films


@pytest.mark.slow
def test_a_film_has_its_pictures_in_order_and_all_of_one_size(piconet: Whole, tmp_path: Path) -> None:
    told = []
    count = write_film(
        piconet[0], tmp_path / "run.webp", (8 * S, 8 * S + 40 * MS), 0.1, lambda *done: told.append(done)
    )
    assert count == 4
    assert told == [(1, 4), (2, 4), (3, 4), (4, 4)]
    with Image.open(tmp_path / "run.webp") as picture:
        assert picture.n_frames == 4
        frames = []
        for number in range(4):
            picture.seek(number)
            frames.append(np.asarray(picture.convert("L"), dtype=int))
    assert all((one != two).any() for one, two in pairwise(frames))


ENCODER = """#!{python}
import sys
data = sys.stdin.buffer.read()
if "{says}":
    sys.exit("{says}")
open(sys.argv[-1], "w").write(" ".join([str(len(data)), *sys.argv[1:]]))
"""


@pytest.fixture
def encoder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Put a program called ffmpeg first on the path, which writes how much it was given, or *says* why it fails."""

    def put(says: str = "") -> None:
        import sys

        program = tmp_path / "bin" / "ffmpeg"
        program.parent.mkdir(exist_ok=True)
        program.write_text(ENCODER.format(python=sys.executable, says=says))
        program.chmod(program.stat().st_mode | stat.S_IXUSR)
        monkeypatch.setenv("PATH", f"{program.parent}{os.pathsep}{os.environ['PATH']}")

    return put


@pytest.mark.slow
def test_an_encoder_is_given_every_picture_whole(piconet: Whole, tmp_path: Path, encoder: Any) -> None:
    encoder()
    assert write_film(piconet[0], tmp_path / "run.mp4", (8 * S, 8 * S + 12 * MS), 0.1) == 3
    size, *arguments = (tmp_path / "run.mp4").read_text().split()
    width, height = map(int, arguments[arguments.index("-s") + 1].split("x"))
    assert int(size) == 3 * 3 * width * height
    assert width % 2 == height % 2 == 0  # what H.264 asks for
    encoder("there is no such codec")
    with pytest.raises(UserError, match=r"ffmpeg: there is no such codec$"):
        write_film(piconet[0], tmp_path / "other.mp4", (8 * S, 8 * S + 12 * MS), 0.1)
    assert not (tmp_path / "other.mp4").exists()


def test_without_an_encoder_one_line_says_what_to_install(
    cosim: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(film.shutil, "which", lambda name: None)
    monkeypatch.setattr(film, "find_spec", lambda name: None)
    found = cosim("picture", "examples/2_bluetooth.yaml", "-o", str(tmp_path / "run.mp4"))
    assert (found.code, found.out) == (2, "")
    assert found.err == (
        "an .mp4 needs an encoder: install ffmpeg, or pip install imageio-ffmpeg; .webp does without\n"
    )


# ---------------------------------------------------------------- the commands


@pytest.mark.slow
def test_a_figure_of_a_trace_and_the_table_of_its_boxes(cosim: Any, piconet: Whole, tmp_path: Path) -> None:
    _, tables, folder = piconet
    at = int(tables["frames"]["time_ns"].iloc[2000])
    asked = ("picture", str(folder), "-o", str(tmp_path / "a.svg"), "--at", str(at / S))
    found = cosim(*asked, "--boxes", str(tmp_path / "a.csv"))
    assert found.code == 0
    assert not found.err
    with (tmp_path / "a.csv").open(newline="") as file:
        listed = list(csv.DictReader(file))
    assert found.out == f"{len(listed)} boxes in {tmp_path / 'a.svg'}\n"
    rows = rows_within(tables["frames"], at - 10 * MS, at + 10 * MS)
    assert sorted(
        (int(each["start"]), each["kind"], each["outcome"]) for each in listed if each["what"] == "received"
    ) == (sorted(zip(rows["time_ns"], rows["kind"], rows["outcome"], strict=True)))
    assert (tmp_path / "a.svg").stat().st_size > 10_000


@pytest.mark.slow
def test_exports_of_a_trace_are_those_of_its_run(cosim: Any, walls: Whole, tmp_path: Path) -> None:
    from cosim.export.perfetto import write_perfetto

    write_perfetto(walls[0], tmp_path / "run.json")
    found = cosim("export", str(walls[2]), str(tmp_path / "trace.json"))
    assert found.code == 0
    assert (tmp_path / "run.json").read_text() == (tmp_path / "trace.json").read_text()
    assert re.fullmatch(rf"\d+ slices in {re.escape(str(tmp_path / 'trace.json'))}, [\d.]+ MB\n", found.out)


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("run", "depot.yaml", "--perfetto", "a.txt"),
         "--perfetto a.txt: expected a file that ends in .json or .json.gz"),
        (("run", "depot.yaml", "--mcap", "a.txt"), "--mcap a.txt: expected a file that ends in .mcap"),
        (("picture", "depot.yaml", "-o", "a.txt"), "--output a.txt: expected a file that ends in one of "
         ".svg, .pdf, .png, .mp4, .webp, .gif, .html"),
        (("picture", ".", "-o", "a.svg"), ".: holds no scene.json: cosim run SCENARIO --trace . writes it"),
        (("export", ".", "a.json"), ".: holds no scene.json: cosim run SCENARIO --trace . writes it"),
    ],
)  # fmt: skip
def test_what_cannot_be_written_is_one_line(
    cosim: Any, arguments: tuple[str, ...], line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    found = cosim(*arguments)
    assert (found.code, found.out, found.err) == (2, "", line + "\n")
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "line"),
    [
        (("--at", "99"), "--at 99: is not from 0 to 14 s, the end of the run"),
        (("--from", "3", "--to", "2"), "--to: 2 s is not after 3 s, where it begins"),
        (("--seed", "3"), "{folder}: is a recorded run: its seed and settings are what they were"),
    ],
)
def test_times_that_a_run_does_not_have_are_refused(
    cosim: Any, piconet: Whole, tmp_path: Path, options: tuple[str, ...], line: str
) -> None:
    found = cosim("picture", str(piconet[2]), "-o", str(tmp_path / "a.svg"), *options)
    assert (found.code, found.err) == (2, line.format(folder=piconet[2]) + "\n")


def test_mcap_without_its_library_is_one_line(cosim: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    from cosim import installed

    monkeypatch.setattr(installed, "find_spec", lambda name: None)
    found = cosim("run", "examples/1_coverage.yaml", "--mcap", "a.mcap")
    assert (found.code, found.err) == (2, "MCAP files need what is not installed here: pip install 'mcap>=1.2'\n")


# ---------------------------------------------------------------- what robots have seen


@pytest.mark.slow
def test_what_was_seen_is_what_is_in_range_and_in_sight(walls: Whole) -> None:
    recording = walls[0]
    range_m, now = 6.0, 5 * S
    seen = seen_floor(recording, now, range_m)
    stones = [LineString([(a, b), (c, d)]) for a, b, c, d in recording.scene["walls_m"]]
    ticks, poses = recording.poses()
    robots = [Point(*place[:2]) for place in poses[ticks == 0][0]]  # nobody moves in this run
    draws = np.random.default_rng(3)
    told = Counter[bool]()
    for _ in range(600):
        row, column = (int(draws.integers(0, size)) for size in seen.shape)
        spot = Point((column + 0.5) * CELL_M, (row + 0.5) * CELL_M)
        if min(stone.distance(spot) for stone in stones) < 3 * CELL_M:
            continue
        near = [robot for robot in robots if abs(robot.distance(spot) - range_m) < 2 * CELL_M]
        ways = [LineString([robot, spot]) for robot in robots if robot.distance(spot) < range_m]
        ends = [Point(end) for stone in stones for end in stone.coords]
        if near or any(way.distance(end) < 3 * CELL_M for way in ways for end in ends):
            continue  # at the edge of the range or of a shadow
        visible = any(not any(way.intersects(stone) for stone in stones) for way in ways)
        assert bool(seen[row, column]) == visible
        told[visible] += 1
    assert min(told[True], told[False]) > 20
