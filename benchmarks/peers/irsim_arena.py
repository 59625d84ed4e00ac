"""IR-SIM's part of arena.py: robots among boxes that drive from goal to goal, each with a ring of beams.

Runs in IR-SIM's environment. One line of JSON on stdout: what the run took, in seconds of processor time, and what was
driven.
"""

import argparse
import json
import math
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

import irsim
import numpy as np
import yaml

TICK_S = 0.1


def world(robots: int, beams: int, range_m: float) -> dict:
    """Return the description of a square with 0.25 robots a square metre, and a box of 0.3 m for every five robots."""
    side = max(math.sqrt(robots / 0.25), 6.3)
    low, high = [0.5, 0.5, -3.14], [side - 0.5, side - 0.5, 3.14]
    lidar = {
        "type": "lidar2d",
        "range_min": 0,
        "range_max": range_m,
        "angle_range": 6.28318,
        "number": beams,
        "noise": False,
    }
    team = {
        "number": robots,
        "distribution": {"name": "random", "range_low": low, "range_high": high},
        "kinematics": {"name": "diff"},
        "shape": {"name": "circle", "radius": 0.085},
        "vel_max": [0.3, 1.5],
        "vel_min": [-0.3, -1.5],
        "behavior": {"name": "dash", "wander": True, "range_low": low, "range_high": high},
        "goal_threshold": 0.2,
        "sensors": [lidar],
    }
    walls = {"shape": {"name": "linestring", "vertices": [[0, 0], [side, 0], [side, side], [0, side], [0, 0]]}}
    boxes = {
        "number": max(2, robots // 5),
        "distribution": {"name": "random", "range_low": [0.5, 0.5, 0], "range_high": [side - 0.5, side - 0.5, 0]},
        "shape": {"name": "rectangle", "length": 0.3, "width": 0.3},
    }
    return {
        "world": {
            "height": side,
            "width": side,
            "step_time": TICK_S,
            "sample_time": TICK_S,
            "control_mode": "auto",
            "collision_mode": "stop",
        },
        "robot": [team],
        "obstacle": [walls, boxes],
    }


def main() -> None:
    """Simulate an arena and tell what it took."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--robots", type=int, required=True)
    parser.add_argument("--beams", type=int, required=True)
    parser.add_argument("--range", type=float, required=True)
    parser.add_argument("--seconds", type=float, required=True)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    with TemporaryDirectory() as folder:
        file = Path(folder) / "arena.yaml"
        file.write_text(yaml.safe_dump(world(given.robots, given.beams, given.range)), encoding="utf-8")
        arena = irsim.make(str(file), headless=True, log_level="ERROR", seed=given.seed)
    driven = 0.0
    places = np.array([robot.state[:2, 0] for robot in arena.robot_list])
    seconds = 0.0
    for _ in range(round(given.seconds / TICK_S)):
        started = process_time()
        arena.step()
        seconds += process_time() - started
        places, before = np.array([robot.state[:2, 0] for robot in arena.robot_list]), places
        driven += float(np.hypot(*(places - before).T).sum())
    print(json.dumps({"seconds": seconds, "metres_per_robot": driven / given.robots}))


if __name__ == "__main__":
    main()
