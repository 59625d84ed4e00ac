"""What a robot's range scanner reads at an instant: computed anew from where all robots are, as the robot's own was.

The walls, the scanner's settings and the seed are in the scene, and its noise is drawn by seed, tick, robot and beam:
so it is the scan that the robot had, or would have had if it did not ask for one.
"""

import math
import threading
from typing import Final

import numpy as np

from cosim.arrays import Floats
from cosim.errors import UserError
from cosim.geometry.segments import packed_walls, segment_grid
from cosim.randomness import Streams
from cosim.robots.senses import WORLD_FRAME, Senses, SenseSettings
from cosim.units import Time, from_seconds, to_seconds
from cosim.web.beliefs import check_robot
from cosim.web.messages import Plain

_DIGITS: Final = 4


class Scanner:
    """The range scanners of the robots of a scene."""

    def __init__(self, scene: Plain) -> None:
        """Raise UserError if the robots have none, or if the scene does not tell of it."""
        about = scene.get("scanner")
        if about is None:
            raise UserError("the robots of this run have no range scanner")
        self._scene = scene
        self._lock = threading.Lock()
        """Held by who scans: pages ask in threads."""
        self._tick = from_seconds(scene["tick_s"])
        self._range_m = about["senses"]["beam_range_m"]
        self.turns_rad: Floats = np.array(about["turns_rad"])
        """By how much the own frame of each robot was turned against the world's in the beginning."""
        walls = packed_walls(segment_grid(np.array(scene["walls_m"], dtype=np.float64).reshape(-1, 4)))
        settings, radii_m = SenseSettings.model_validate(about["senses"]), scene["radii_m"]
        frames = [WORLD_FRAME] * len(radii_m)
        self._senses = Senses(settings, walls, radii_m, frames, math.inf, self._tick, Streams(scene["seed"]))

    @property
    def aware(self) -> bool:
        """True if the robots know how they head."""
        return self._senses.aware

    def scan(self, robot: int, poses: Floats, turned_rad: Floats, tick: Time) -> Plain:
        """Return the message ``scan``: what *robot* reads at a *tick* of the world.

        All robots are at *poses* (n, 3) then, and the frame of each one's odometry is turned by *turned_rad* (n,).
        Beam k of ``ranges_m`` looks along ``turned_rad`` + 2 pi k / n; None stands for a beam that meets nothing.
        Raise UserError for a robot that there is not.
        """
        check_robot(self._scene, robot)
        with self._lock:
            ranges_m = self._senses.ranges_from(robot, poses, turned_rad, tick // self._tick)
        return {
            "say": "scan",
            "robot": robot,
            "time_s": to_seconds(tick),
            "place_m": poses[robot, :2].tolist(),
            "turned_rad": math.remainder(float(turned_rad[robot]), math.tau),
            "range_m": self._range_m,
            "ranges_m": [None if math.isinf(far_m) else round(far_m, _DIGITS) for far_m in ranges_m.tolist()],
        }
