"""Maps from files: every rule of map_server on single pixels, orientation, and what is said of broken files."""

import math

import numpy as np
import pytest
from PIL import Image

from cosim.errors import UserError
from cosim.world.maps import RosMapSettings, occupancy_percent, read_image, read_movingai_map, read_ros_map

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
    np.testing.assert_allclose(
        read_image(tmp_path / "m.pgm")[:, :, 0], np.array([[0, 254], [205, 254]]) / 255, atol=1e-4
    )


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
        (b"P5 2 x 255\n\x00", "b'x' is not a whole number"),
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
        ("width 4\n", "", "m.map: width: None is not a whole number > 0"),
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
    with pytest.raises(UserError, match="byte 4 is not UTF-8 text"):
        read_movingai_map(tmp_path / "m.map", 1.0)
