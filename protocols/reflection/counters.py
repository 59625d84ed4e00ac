"""What a machine of goal reflection counts."""

from cosim.units import Time


class Counters:
    """Counts of one robot, from the start on."""

    def __init__(self) -> None:
        self.frames = 0
        """Frames sent."""
        self.payload_bytes = 0
        self.advice = 0
        """Promises for an own goal that came in from robots in sight."""
        self.unseen_advice = 0
        """Promises that came in from robots that were not in sight, or not any more."""
        self.outdated = 0
        """Of them, about a goal that the robot has no more."""
        self.late = 0
        """Of them, older than ``stale_s``."""
        self.stale = 0
        """Of them, one or the other."""
        self.promises = 0
        """Promises that were taken."""
        self.ghosts = 0
        """Ghosts that were reached without sight of the goal."""
        self.reached = 0
        """Goals that were reached, as the robot knows."""
        self.given_up = 0
        self.troubles = 0
        self.reflected = 0
        """Goals for which a promise was taken."""
        self.waited: Time = 0
        """From setting these goals until the first promise was taken, all together."""
        self.steps = [0, 0, 0, 0]
        """Motion steps by what they were headed for, see ``seeking.Target``."""

    def count_advice(self, outdated: bool, late: bool) -> None:
        """Count a promise for an own goal that came in."""
        self.advice += 1
        self.outdated += outdated
        self.late += late
        self.stale += outdated or late
