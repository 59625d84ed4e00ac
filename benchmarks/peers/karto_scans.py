"""OpenKarto's scan matcher on recorded scans, for ``benchmarks.recorded_scans``: karto-scanmatcher 1.0.0.

It reads one JSON object: the scanner's range, settings other than the package's defaults, and the scans, each a pose
(x, y, turn) by odometry and the ranges of a ring of beams; it writes the poses that the matcher finds. Each scan is
matched with those before it that were taken within the scanner's range of where odometry, from the last pose found,
puts it; and stays where it was found.
"""

import json
import math
import sys

from karto_scanmatcher import LaserScanConfig, LocalizedRangeScan, Pose2, ScanMatcherConfig, Wrapper

NOTHING_M = 1e3
"""A range of a beam that meets nothing."""


def carried(found, before, now):
    """Return the pose *found* moved as odometry has been from *before* to *now*."""
    cos, sin = math.cos(found[2] - before[2]), math.sin(found[2] - before[2])
    dx, dy = now[0] - before[0], now[1] - before[1]
    return found[0] + cos * dx - sin * dy, found[1] + sin * dx + cos * dy, found[2] + now[2] - before[2]


def scanner(beams, range_m):
    """Return a ring of *beams*, the first of which looks along the heading."""
    step = math.tau / beams
    return LaserScanConfig(0.0, math.tau - step, step, 0.0, range_m, range_m, "ring")


def matcher_of(settings):
    """Return a matcher with *settings*, by name, and else the package's defaults."""
    own = ScanMatcherConfig()
    for name, value in settings.items():
        setattr(own, name, value)
    return Wrapper(own)


def matched(scans, range_m, settings):
    """Yield the pose of each scan; the first is where odometry has it."""
    matcher, ring = matcher_of({"range_threshold": range_m, **settings}), scanner(len(scans[0][1]), range_m)
    taken, found, before = [], scans[0][0], scans[0][0]
    for number, (told, ranges_m) in enumerate(scans):
        found = carried(found, before, told)
        near = [scan for pose, scan in taken if math.dist(pose[:2], found[:2]) <= range_m]
        ranges = [each if each < range_m else NOTHING_M for each in ranges_m]
        scan = LocalizedRangeScan(ring, ranges, Pose2(*told), Pose2(*found), number, 0.0)
        if near:
            best = matcher.match_scan(scan, near, True, True).best_pose
            found = best.x, best.y, best.yaw
            scan.corrected_pose = best
        taken.append((found, scan))
        before = told
        yield found


if __name__ == "__main__":
    given = json.load(sys.stdin)
    json.dump(list(matched(given["scans"], given["range_m"], given["settings"])), sys.stdout)
