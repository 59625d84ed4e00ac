"""The comparison on recorded scans: what is recorded, when Karto takes scans, how poses are carried on and judged."""

import importlib
import math
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from benchmarks.recorded_scans import (
    Floor,
    by_filter,
    by_karto,
    carried_on,
    compared,
    errors_m,
    keys,
    recorded,
    rows,
    sheet,
)
from cosim.geometry.segments import ray_casts
from cosim.navigation.slam import MapGrid, SlamParameters
from cosim.robots.senses import SenseSettings
from tests.navigation.slam_scene import ROOM, course

GRID = MapGrid((60, 60), (-1.0, -1.0), 0.1)
COURSE = np.array(course([(0.8, 1.1), (2.4, 1.1), (2.4, 1.6)], 0.05))
SENSES = {"beams": 60, "beam_range_m": 2.5}


def test_a_recording_has_the_true_poses_what_odometry_tells_and_ranges_along_the_beams_of_its_frame():
    exact = recorded(COURSE, ROOM, SenseSettings(**SENSES), 1)
    assert exact.told == pytest.approx(COURSE, abs=1e-12)
    erring = recorded(COURSE, ROOM, SenseSettings(**SENSES, odometry_slip=0.3, odometry_turn_rad=0.3), 1)
    assert 0.01 < errors_m(erring.told, COURSE)[1] < 0.5
    other = recorded(COURSE, ROOM, SenseSettings(**SENSES, odometry_slip=0.3, odometry_turn_rad=0.3), 2)
    assert not np.allclose(erring.told, other.told)
    beams = math.tau * np.arange(60) / 60 + COURSE[-1, 2] - erring.told[-1, 2]
    ranges = ray_casts(ROOM, np.tile(COURSE[-1, :2], (60, 1)), beams, 2.5)
    near = ranges < 2.5
    assert erring.ranges_m[-1][near] == pytest.approx(ranges[near], abs=1e-6)
    assert (erring.ranges_m[-1][~near] >= 2.5).all()


def test_a_filter_finds_its_way_on_a_recording():
    erring = SenseSettings(**SENSES, odometry_slip=0.3, odometry_turn_rad=0.1)
    recording = recorded(COURSE, ROOM, erring, 3)
    found = by_filter(recording, GRID, SlamParameters(odometry="senses", odometry_slip=0.3, odometry_turn_rad=0.1), 3)
    assert errors_m(found, COURSE)[0] < 0.7 * errors_m(recording.told, COURSE)[0]


def test_the_filter_is_compared_with_either_errors_of_odometry_whichever_the_sheet_has():
    senses = SenseSettings(**sheet()["team"]["senses"])
    recording = recorded(COURSE, ROOM, senses, 3)
    found = compared(COURSE, Floor(ROOM, GRID), senses.beam_range_m, 3, None)
    assert list(found) == ["odometry", "filter, alphas", "filter, senses"]
    for kind in ("alphas", "senses"):
        own = SlamParameters(odometry=kind, particles=30, power=0.03, range_m=2.5)
        assert found[f"filter, {kind}"] == errors_m(by_filter(recording, GRID, own, 3), COURSE)
    assert found["filter, alphas"] != found["filter, senses"]


def test_karto_takes_a_scan_after_a_fifth_of_a_metre_or_ten_degrees():
    told = np.array([[0.05 * k, 0.0, 0.0] for k in range(10)] + [[0.45, 0.0, math.radians(4.0) * k] for k in (1, 2, 3)])
    told[:, 2] += math.pi - 0.1  # so that it passes from pi to -pi
    assert keys(told) == [0, 4, 8, 12]


def test_what_is_found_is_carried_on_as_odometry_goes():
    told = np.array([[0.0, 0.0, 0.5], [1.0, 0.0, 0.5], [1.0, 2.0, 1.0], [2.0, 2.0, 1.0]])
    found = carried_on(told, [0, 2], [(0.0, 0.0, 0.0), (5.0, 5.0, math.pi / 2)])
    assert found[:2] == pytest.approx(told[:2])
    assert found[2:] == pytest.approx(np.array([[5.0, 5.0, 1.0 + math.pi / 2], [5.0, 6.0, 1.0 + math.pi / 2]]))


def test_errors_are_told_as_root_mean_square_and_greatest_and_summed_up_by_medians():
    assert errors_m(np.array([[3.0, 4.0, 9.0], [1.0, 1.0, 9.0]]), np.ones((2, 3)) * [1.0, 1.0, 0.0]) == pytest.approx(
        (math.sqrt(6.5), math.sqrt(13.0))
    )
    told = [{"odometry": (1.0, 2.0), "other": (rms, 5.0)} for rms in (0.4, 1.5, 0.2)]
    assert list(rows(2.5, told)) == [
        ("2.5 m", "odometry", "1.00 (1.00 to 1.00)", "2.00 (2.00 to 2.00)", ""),
        ("2.5 m", "other", "0.40 (0.20 to 1.50)", "5.00 (5.00 to 5.00)", "2 of 3"),
    ]


MATCHED = []


class Matcher:
    """In place of Karto's: it finds each scan 0.1 m left of where it is put, and notes in MATCHED with what."""

    def __init__(self, settings):
        self.settings = settings

    def match_scan(self, scan, near, penalize, refine):
        MATCHED.append((scan.num, [each.num for each in near]))
        pose = scan.corrected_pose
        return SimpleNamespace(best_pose=SimpleNamespace(x=pose.x, y=pose.y + 0.1, yaw=pose.yaw))


@pytest.fixture
def karto(monkeypatch):
    module = ModuleType("karto_scanmatcher")
    module.LaserScanConfig = lambda *numbers: numbers
    module.Pose2 = lambda x, y, yaw: SimpleNamespace(x=x, y=y, yaw=yaw)
    module.ScanMatcherConfig = SimpleNamespace
    module.Wrapper = Matcher
    module.LocalizedRangeScan = lambda ring, ranges, told, found, num, time: SimpleNamespace(
        num=num, ranges=ranges, corrected_pose=found
    )
    monkeypatch.setitem(sys.modules, "karto_scanmatcher", module)
    MATCHED.clear()
    yield importlib.import_module("benchmarks.peers.karto_scans")
    sys.modules.pop("benchmarks.peers.karto_scans", None)


def test_a_scan_is_matched_with_those_before_it_that_are_near_and_stays_where_it_was_found(karto):
    told = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (3.0, 0.0, 0.0), (1.5, 0.0, 0.0)]
    found = list(karto.matched([(pose, [1.0, math.inf]) for pose in told], 2.0, {"resolution": 0.01}))
    assert found == [pytest.approx(pose) for pose in [(0, 0, 0), (1, 0.1, 0), (3, 0.2, 0), (1.5, 0.3, 0)]]
    # the third is put at (3, 0.1): that is 2 m from the second only where it was found
    assert MATCHED == [(1, [0]), (2, [1]), (3, [0, 1, 2])]


def test_karto_recovers_exact_motion():
    pytest.importorskip("karto_scanmatcher", reason="karto-scanmatcher is not installed beside cosim")
    erring = SenseSettings(beams=180, beam_range_m=2.5, odometry_slip=0.3, odometry_turn_rad=0.1)
    recording = recorded(COURSE, ROOM, erring, 4)
    found = by_karto(recording, 2.5, {}, sys.executable)
    taken = keys(recording.told)
    assert errors_m(found[taken], COURSE[taken])[1] < 0.025 < 0.04 < errors_m(recording.told, COURSE)[1]
