"""What a machine of goal reflection reports: events, as rows of the trace, and counters, for the metrics."""

from dataclasses import dataclass, field

from cosim.units import Time

_NUMBER = {"meaning": "which of the robot's goals, from 1"}
_REASON = {"meaning": "what is wrong, or why it ended"}
_HELPER = {"meaning": "the robot that has promised a way; the robot itself if it has seen its goal"}


@dataclass(frozen=True, slots=True)
class GoalSet:
    """A robot has turned to its next goal."""

    number: int = field(metadata=_NUMBER)


@dataclass(frozen=True, slots=True)
class GoalReached:
    """A robot is nearer to its goal than epsilon."""

    number: int = field(metadata=_NUMBER)


@dataclass(frozen=True, slots=True)
class GoalGivenUp:
    """A robot gives up a goal."""

    number: int = field(metadata=_NUMBER)
    reason: str = field(metadata=_REASON)


@dataclass(frozen=True, slots=True)
class PromiseTaken:
    """A robot begins to follow another robot's promise of a way to its goal."""

    helper: int = field(metadata=_HELPER)
    way_m: float = field(metadata={"unit": "m", "meaning": "length of the way to the goal that was promised"})


@dataclass(frozen=True, slots=True)
class GhostReached:
    """A robot is where its helper was when it made its promise, and does not see its goal from there."""

    helper: int = field(metadata=_HELPER)


@dataclass(frozen=True, slots=True)
class PromiseForgotten:
    """A robot no longer follows a promise, without having come to where its helper was."""

    helper: int = field(metadata=_HELPER)
    reason: str = field(metadata=_REASON)


@dataclass(frozen=True, slots=True)
class TroubleChanged:
    """A robot is in trouble, or has got out of it."""

    in_trouble: bool = field(metadata={"meaning": "the state bit Tr"})
    weight: int = field(metadata={"meaning": "Nt, one more than the times that the robot has got out of trouble"})


@dataclass(frozen=True, slots=True)
class MadeWay:
    """A robot has begun to yield to one that it stood in the way of."""

    seeker: int = field(metadata={"meaning": "the robot that way is made for"})


@dataclass(frozen=True, slots=True)
class Displaced:
    """A robot is farther from where it was a tick ago than it can drive: it was moved."""

    distance_m: float = field(metadata={"unit": "m", "meaning": "how far"})


@dataclass(frozen=True, slots=True)
class BadBytes:
    """A robot received bytes that are no frame."""

    reason: str = field(metadata=_REASON)


EVENTS = (
    GoalSet,
    GoalReached,
    GoalGivenUp,
    PromiseTaken,
    GhostReached,
    PromiseForgotten,
    TroubleChanged,
    MadeWay,
    Displaced,
    BadBytes,
)


class Counters:
    """Counts of one robot, from the start on."""

    def __init__(self) -> None:
        self.frames = 0
        """Frames sent."""
        self.payload_bytes = 0
        self.advice = 0
        """Promises for an own goal received from robots in sight."""
        self.unseen_advice = 0
        """Promises for an own goal received from robots that were not, or no longer, in sight."""
        self.outdated = 0
        """Advice about a goal that the robot no longer has."""
        self.late = 0
        """Advice older than ``stale_s``."""
        self.stale = 0
        """Advice that is outdated or late."""
        self.promises = 0
        """Promises that were taken."""
        self.ghosts = 0
        """Ghosts that were reached without sight of the goal."""
        self.reached = 0
        """Goals that were reached, as the robot knows."""
        self.given_up = 0
        """Goals that were given up."""
        self.troubles = 0
        """Times that the robot got into trouble."""
        self.reflected = 0
        """Goals for which a promise was taken."""
        self.waited: Time = 0
        """Total time from setting these goals until the first promise was taken."""
        self.steps = [0, 0, 0, 0]
        """Motion steps by what they headed for, see ``seeking.Target``."""

    def count_advice(self, outdated: bool, late: bool) -> None:
        """Count a promise for an own goal."""
        self.advice += 1
        self.outdated += outdated
        self.late += late
        self.stale += outdated or late
