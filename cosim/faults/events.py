"""The rows of the table of events that faults cause; the robot is the row's source, -1 where there is none."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

from cosim.faults.settings import FaultSettings


@dataclass(frozen=True)
class Killed:
    """A fault has killed the robot."""


@dataclass(frozen=True)
class Crashed:
    """A fault has stopped the robot's host, which will boot again."""


@dataclass(frozen=True)
class Rebooted:
    """The robot's host has booted again."""


@dataclass(frozen=True)
class RadioOff:
    """A fault has switched the robot's radio, or one of its radios, off."""

    radio: int = field(default=-1, metadata={"unit": "", "meaning": "which of its radios; -1 for all"})


@dataclass(frozen=True)
class RadioOn:
    """The robot's radio, or one of its radios, is on again."""

    radio: int = field(default=-1, metadata={"unit": "", "meaning": "which of its radios; -1 for all"})


@dataclass(frozen=True)
class CameraOff:
    """A fault has switched the robot's camera off."""


@dataclass(frozen=True)
class CameraOn:
    """The robot's camera is on again."""


@dataclass(frozen=True)
class Frozen:
    """A fault keeps the robot from moving."""


@dataclass(frozen=True)
class Thawed:
    """The robot can move again."""


@dataclass(frozen=True)
class Carried:
    """The robot has been put elsewhere."""

    to_x_m: float = field(metadata={"unit": "m", "meaning": "where it stands now, world frame"})
    to_y_m: float = field(metadata={"unit": "m", "meaning": "where it stands now, world frame"})


@dataclass(frozen=True)
class NotCarried:
    """The robot was to be put elsewhere, but there is no room: it stays where it is."""


@dataclass(frozen=True)
class ClockStepped:
    """The robot's clock has jumped."""

    by_ns: int = field(metadata={"unit": "ns", "meaning": "by so much"})


@dataclass(frozen=True)
class BatteryEmpty:
    """The robot's battery is empty: it dies."""


@dataclass(frozen=True)
class WallUp:
    """A wall of loss is there."""

    fault: int = field(metadata={"unit": "", "meaning": "which of the scenario's faults, the first is 0"})


@dataclass(frozen=True)
class WallDown:
    """A wall of loss is gone."""

    fault: int = field(metadata={"unit": "", "meaning": "which of the scenario's faults, the first is 0"})


@dataclass(frozen=True)
class JammerOn:
    """A jammer begins."""

    fault: int = field(metadata={"unit": "", "meaning": "which of the scenario's faults, the first is 0"})


@dataclass(frozen=True)
class JammerOff:
    """A jammer ends."""

    fault: int = field(metadata={"unit": "", "meaning": "which of the scenario's faults, the first is 0"})


_OF_KIND: Final[dict[str, tuple[type, ...]]] = {
    "kill": (Killed,),
    "crash": (Crashed, Rebooted),
    "radio_off": (RadioOff, RadioOn),
    "camera_off": (CameraOff, CameraOn),
    "frozen": (Frozen, Thawed),
    "moved": (Carried, NotCarried),
    "clock_step": (ClockStepped,),
    "battery": (BatteryEmpty, Killed),
    "wall": (WallUp, WallDown),
    "jammer": (JammerOn, JammerOff),
}
EVENTS: Final = tuple(dict.fromkeys(event for events in _OF_KIND.values() for event in events))
"""All of them."""


def events_of(faults: Iterable[FaultSettings]) -> tuple[type, ...]:
    """Return the types of the events that *faults* can cause, each once: what a run has no fault for has no column."""
    return tuple(dict.fromkeys(event for fault in faults for event in _OF_KIND[fault.kind]))
