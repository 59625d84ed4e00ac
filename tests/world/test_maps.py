"""Maps from files: every rule of map_server on single pixels, orientation, and what is said of broken files."""

import math
import tracemalloc

import numpy as np
import pytest
from PIL import Image

from cosim.errors import UserError
from cosim.world import maps
from cosim.world.floorplan import FloorplanSettings, load_floorplan
from cosim.world.maps import RosMapSettings, occupancy_percent, outline, read_movingai_map, read_percent, read_ros_map

KEYS = {"image": "m.pgm", "resolution": 0.5, "origin": [0.0, 0.0, 0.0], "negate": 0}
KEYS |= {"occupied_thresh": 0.65, "free_thresh": 0.25}


def percent(levels, **keys):
    """Occupancy of pixels with channels of 0 to 255."""
    pixels = np.array([[level if isinstance(level, tuple) else (level,) for level in levels]]) / 255
    return occupancy_percent(pixels, RosMapSettings(**KEYS | keys)).ravel().tolist()


def write(folder, content=b"P5 2 2 255\n\x00\xfe\xcd\xfe", name="m.pgm", **keys):
    (folder / name).write_bytes(content)
    lines = [f"{key}: {value}" for key, value in (KEYS | {"image": name} | keys).items() if value is not None]
    path = folder / "m.yaml"
    path.write_text("\n".join(lines))
    return path


def test_trinary_knows_occupied_free_and_unknown():
    # map_saver writes 0, 254 and 205; p > 0.65 means level < 89.25, p < 0.25 level > 191.25
    assert percent([0, 89, 90, 191, 192, 254, 205]) == [100, 100, -1, -1, 0, 0, 0]
    assert percent([205], free_thresh=0.196) == [-1]  # p = 0.19608


def test_the_thresholds_themselves_are_unknown():
    assert percent([127.5, 191.25], occupied_thresh=0.5, free_thresh=0.25) == [-1, -1]


def test_negate_swaps_black_and_white():
    assert percent([255, 0, 128], negate=1) == [100, 0, -1]


def test_scale_spreads_what_lies_between_the_thresholds():
    # p = 0.25 + k * 0.4 / 100 gives k
    levels = [255 * (1 - 0.25 - k * 0.004) for k in (1.0, 25.0, 99.2)]
    assert percent([*levels, 0, 255], mode="scale") == [1, 25, 99, 100, 0]


def test_a_pixel_that_is_not_opaque_is_unknown_in_scale_and_lighter_or_darker_in_trinary():
    assert percent([(0, 0, 0, 254), (0, 0, 0, 255)], mode="scale") == [-1, 100]
    # trinary: the mean of four channels, 255 / 4 and 0, is p = 0.75 and 1
    assert percent([(0, 0, 0, 255), (0, 0, 0, 0)], occupied_thresh=0.76) == [-1, 100]
    assert percent([(0, 255), (128, 255)], occupied_thresh=0.7) == [100, -1]  # grey is three equal colours


def test_colours_are_averaged():
    assert percent([(255, 0, 0), (255, 255, 0), (255, 255, 200)]) == [100, -1, 0]


def test_raw_is_the_level_itself():
    assert percent([0, 1, 100, 101, 255], mode="raw", negate=1) == [0, 1, 100, -1, -1]


def test_raw_occupancy_is_thresholded_for_the_floor(tmp_path):
    map_ = read_ros_map(write(tmp_path, bytes(b"P5 5 1 255\n" + bytes([0, 25, 66, 100, 255])), mode="raw"))
    assert map_.occupied[0].tolist() == [False, False, True, True, False]
    assert map_.unknown[0].tolist() == [False, True, False, False, True]


def test_row_0_of_the_image_is_the_top(tmp_path):
    map_ = read_ros_map(write(tmp_path, free_thresh=0.1))
    assert map_.occupied.tolist() == [[False, False], [True, False]]
    assert map_.unknown.tolist() == [[True, False], [False, False]]
    assert map_.solid(True).tolist() == [[True, False], [True, False]]
    assert map_.solid(False).tolist() == map_.occupied.tolist()


def test_the_origin_is_the_pose_of_the_lower_left_corner(tmp_path):
    map_ = read_ros_map(write(tmp_path, origin=[10.0, 20.0, math.pi / 2], resolution=1.0))
    # turned a quarter to the left: image right is world up, image up is world left
    np.testing.assert_allclose(map_.bounds_m(), (8, 20, 10, 22))
    where = np.array([(8.5, 20.5), (8.5, 21.5), (9.5, 20.5), (9.5, 21.5), (10.5, 20.5)])
    assert map_.look_up(map_.occupied, where, outside=True).tolist() == [True, False, False, False, True]
    walls = np.sort(map_.walls_m(map_.occupied).reshape(-1, 2, 2).mean(axis=1).round(6), axis=0)
    assert walls[:, 0].min() == 8
    assert len(map_.walls_m(map_.occupied)) == 6  # an L of three free cells


@pytest.mark.parametrize(
    "image",
    [
        b"P5\n# a comment\n2 # width\n 2\n255\n\x00\xfe\xcd\xfe",
        b"P2\n# a comment\n2 2\n255\n0 254 # black, white\n205 254\n",
        b"P5 2 2 65535\n\x00\x00\xfe\xfd\xcd\xce\xfe\xfd",
        b"P2 2 2 510 0 508 410 508",
    ],
)
def test_all_kinds_of_pgm_are_read(tmp_path, image):
    (tmp_path / "m.pgm").write_bytes(image)
    scaled = RosMapSettings(**KEYS | {"mode": "scale", "occupied_thresh": 1, "free_thresh": 0})
    assert read_percent(tmp_path / "m.pgm", scaled).tolist() == [[100, 0], [20, 0]]


@pytest.mark.parametrize(("block", "tile"), [(1, 1), (3, 2), (10, 3), (1 << 20, 512)])
def test_an_image_is_the_same_in_pieces_of_any_size(tmp_path, monkeypatch, block, tile):
    monkeypatch.setattr(maps, "_BLOCK", block)
    monkeypatch.setattr(maps, "_TILE", tile)
    levels = np.arange(35).reshape(5, 7)
    words = " ".join(f"{level}#12\r" if level % 4 == 3 else f"{level}" for level in levels.ravel())
    (tmp_path / "m.pgm").write_text(f"P2 7 5 100 # 3 4 5\n{words} 9 x")
    raw = RosMapSettings(**KEYS | {"mode": "raw"})
    expected = np.floor(255 * levels / 100 + 0.5)
    assert read_percent(tmp_path / "m.pgm", raw).tolist() == np.where(expected <= 100, expected, -1).tolist()
    colours = np.stack((levels, levels, levels * 0, levels * 0 + 255), axis=2).astype(np.uint8)
    Image.fromarray(colours).save(tmp_path / "m.png")
    assert read_percent(tmp_path / "m.png", raw).tolist() == np.floor(2 * levels / 3 + 0.5).tolist()


@pytest.mark.parametrize("mode", ["L", "RGB", "RGBA", "LA", "P", "1", "I;16"])
def test_all_kinds_of_png_are_read(tmp_path, mode):
    if mode == "I;16":
        Image.fromarray(np.array([[0, 65535], [65535, 65535]], np.uint16)).save(tmp_path / "m.png")
    else:
        Image.fromarray(np.array([[0, 255], [255, 255]], np.uint8)).convert(mode).save(tmp_path / "m.png")
    map_ = read_ros_map(write(tmp_path, (tmp_path / "m.png").read_bytes(), "m.png"))
    assert map_.occupied.tolist() == [[False, False], [True, False]]
    assert not map_.unknown.any()


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"resolution": -1}, "m.yaml: resolution: -1 is not > 0"),
        ({"resolution": None}, "m.yaml: resolution: is missing"),
        ({"origin": "[0, 0]"}, "m.yaml: origin[2]: is missing"),
        ({"origin": "[0, .nan, 0]"}, "m.yaml: origin[1]: nan is not a finite number"),
        ({"mode": "binary"}, "m.yaml: mode: 'binary' is not 'trinary', 'scale' or 'raw'"),
        ({"free_thresh": 0.7}, "free_thresh: 0.7 is not < 0.65, occupied_thresh"),
        ({"image": "no.pgm"}, "m.yaml: image: 'no.pgm': there is no such file beside the map"),
        ({"image": "[1"}, "m.yaml: line "),
        ({"image": "a" * 5000}, "there is no such file beside the map"),
        ({"origin": "[0, 0, 90]"}, "m.yaml: origin: [0, 0, 90] is turned by 90 rad, expected -2 pi to 2 pi"),
        ({"origin": "[0, 0, 1.0e+19]"}, "m.yaml: origin[2]: 1e+19 is not <= "),
        ({"origin": "[0, -2.0e+6, 0]"}, "m.yaml: origin[1]: -2000000.0 is not >= -1e+06"),
        ({"resolution": "1.0e+6"}, "m.yaml: resolution: 1e+06 m is no size of a cell of a map of 2 x 2, expected "),
        ({"resolution": "1.0e+300"}, "m.yaml: resolution: 1e+300 is not <= 1e+06"),
        ({"resolution": "1.0e-300"}, "m.yaml: resolution: 1e-300 m is no size of a cell"),
    ],
)
def test_bad_keys_are_named(tmp_path, keys, message):
    with pytest.raises(UserError) as error:
        read_ros_map(write(tmp_path, **keys))
    assert message in str(error.value)
    assert "\n" not in str(error.value)
    assert str(tmp_path) in str(error.value)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (b"hello", "not an image"),
        (b"", "not an image"),
        (b"\x89PNG\r\n\x1a\n broken", "not an image"),
        (b"P5 2 2 255\n\x00", "pixels: 1 found, expected 2 x 2"),
        (b"P5 2 x 255\n\x00", "header: height: 'x' is not a whole number"),
        (b"P5 2 \xb2 255\n\x00", "header: height: '²' is not a whole number"),
        (b"P5 2 0 255\n\x00", "header: height: '0' is not a whole number"),
        (b"P5 " + b"9" * 5000 + b" 2 255\n\x00", "header: width: a number of 5000 digits is not <= 100000000"),
        (b"P5 10001 10000 255\n\x00", "header: 10001 x 10000 are 100010000 cells, expected at most 100000000"),
        (b"P5 99999999 99999999 255\n\x00", "expected at most 100000000"),
        (b"P2 1 1 255 " + b"9" * 5000, "9223372036854775807 is not <= 65535"),
        (b"P5 2", "is not a whole number"),
        (b"P5 2 2 70000\n", "maxval 70000"),
        (b"P2 1 1 7 9", "9 is not <= maxval 7"),
        (b"P2 1 1 7 a", "not all of them are whole numbers"),
    ],
)
def test_what_is_not_an_image_is_named(tmp_path, image, message):
    with pytest.raises(UserError, match=message) as error:
        read_ros_map(write(tmp_path, image))
    assert "m.pgm: " in str(error.value)
    assert "\n" not in str(error.value)


MOVINGAI = "type octile\nheight 2\nwidth 4\nmap\n.G@T\nS.OW\n"


def test_movingai_letters_and_rows(tmp_path):
    path = tmp_path / "m.map"
    path.write_text(MOVINGAI)
    map_ = read_movingai_map(path, 2.0)
    assert map_.occupied.tolist() == [[False, False, True, True], [False, False, True, True]]
    assert map_.bounds_m() == (0, 0, 8, 4)
    path.write_text(MOVINGAI.replace(".G@T", "@G@T"))
    assert read_movingai_map(path, 2.0).occupied[:, 0].tolist() == [False, True]  # row 0 of the file is the top


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("octile", "tile", "m.map: type: 'tile' is not 'octile'"),
        ("height 2", "height 3", "m.map: map: 2 rows found, expected 3"),
        ("width 4", "width x", "m.map: width: 'x' is not a whole number > 0"),
        ("width 4\n", "", "m.map: width: '' is not a whole number > 0"),
        ("width 4", "width ²", "m.map: width: '²' is not a whole number > 0"),
        ("width 4", "width " + "9" * 5000, "m.map: width: a number of 5000 digits is not <= 100000000"),
        ("width 4", "width 50000001", "m.map: header: 50000001 x 2 are 100000002 cells, expected at most 100000000"),
        ("S.OW", "S.OWW", "m.map: line 6: 5 cells found, expected 4"),
        (".G@T", ".G@", "m.map: line 5: 3 cells found, expected 4"),
        ("S.OW", "S.\u20acW", "m.map: line 6: '\u20ac' is not one of"),
        ("\nmap", "", "m.map: header: no line 'map' found"),
        ("S.OW", "S.O", "m.map: line 6: 3 cells found, expected 4"),
        ("S.OW", "S.O?", "m.map: line 6: '?' is not one of"),
    ],
)
def test_a_broken_movingai_map_is_named(tmp_path, old, new, message):
    path = tmp_path / "m.map"
    path.write_text(MOVINGAI.replace(old, new))
    with pytest.raises(UserError) as error:
        read_movingai_map(path, 1.0)
    assert message in str(error.value)


def test_a_map_that_is_not_text_is_named(tmp_path):
    (tmp_path / "m.map").write_bytes(b"type\xff")
    with pytest.raises(UserError, match="header: no line 'map' found"):
        read_movingai_map(tmp_path / "m.map", 1.0)


@pytest.mark.parametrize("ends", ["\r\n", "\r"])
def test_a_movingai_map_may_end_its_lines_as_other_systems_do(tmp_path, ends):
    (tmp_path / "m.map").write_bytes(MOVINGAI.rstrip().replace("\n", ends).encode())
    assert read_movingai_map(tmp_path / "m.map", 1.0).occupied.tolist() == [[False, False, True, True]] * 2


@pytest.mark.parametrize("cell_m", [1e6, 3e5])
def test_cells_that_make_no_floor_are_refused(tmp_path, cell_m):
    (tmp_path / "m.map").write_text(MOVINGAI)
    with pytest.raises(UserError, match=r"^floorplan.resolution_m: \S+ m is no size of a cell of a map of 4 x 2"):
        load_floorplan(FloorplanSettings(map="m.map", resolution_m=cell_m), tmp_path)


def test_the_outline_is_the_same_in_bands_of_any_height(monkeypatch):
    cells = np.random.default_rng(1).random((9, 13)) < 0.5
    at_once = outline(cells).tolist()
    for band in (1, 30, 50):
        monkeypatch.setattr(maps, "_BAND", band)
        assert outline(cells).tolist() == at_once
    assert len(outline(cells, len(at_once))) == len(at_once)
    with pytest.raises(ValueError, match="more segments than it may have"):
        outline(cells, len(at_once) - 1)


def test_a_map_of_too_many_walls_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(maps, "MOST_SIDES", 5)
    write(tmp_path)
    with pytest.raises(UserError, match=r"^floorplan\.map: 'm\.yaml': its solid cells have more than "):
        load_floorplan(FloorplanSettings(map="m.yaml"), tmp_path)


def test_a_large_map_takes_at_most_four_bytes_a_cell_beside_its_file(tmp_path):
    pixels = np.full((1000, 1000), 254, np.uint8)
    pixels[::50] = 0
    letters = np.where(pixels, ord("."), ord("@")).astype(np.uint8)
    rows = b"\n".join(row.tobytes() for row in letters)
    (tmp_path / "m.map").write_bytes(b"type octile\nheight 1000\nwidth 1000\nmap\n" + rows)
    path = write(tmp_path, b"P5 1000 1000 255\n" + pixels.tobytes())
    Image.fromarray(pixels).convert("RGB").save(tmp_path / "m.png")
    scaled = RosMapSettings(**KEYS | {"mode": "scale"})
    for read in (
        lambda: read_ros_map(path),
        lambda: read_percent(tmp_path / "m.png", scaled),
        lambda: read_movingai_map(tmp_path / "m.map", 0.1),
    ):
        tracemalloc.start()
        try:
            read()
            assert tracemalloc.get_traced_memory()[1] < 5e6  # the file and at most four bytes a cell
        finally:
            tracemalloc.stop()
