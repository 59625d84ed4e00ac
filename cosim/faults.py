"""Faults: what goes wrong in a run, when, and to whom, as a scenario says it; carried out in the phase WORLD.

A fault of the instant of a world tick comes before the tick.

A killed robot's host neither takes nor answers anything from that instant on, its radio is off, and its body coasts:
it keeps its velocity until the next world tick (that way has been checked against walls and bodies), and from there on
brakes to rest under its acceleration limit, as if it were told to stand still. It rests there as an obstacle for ever.
(A body that stood at once, in the midst of a tick, could be run into by one that follows it.)
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field, ValidationInfo, field_validator

from cosim.channels.base import Channel
from cosim.channels.jamming import CONSTANT, PULSED, SWEEPING, Jammer
from cosim.errors import UserError
from cosim.kernel import WORLD, Kernel
from cosim.machine import Address, Death, Drive
from cosim.node import Node
from cosim.robots.motion import Fleet
from cosim.settings import Settings
from cosim.trace import Trace
from cosim.units import Time, from_seconds

LAST_CHANNEL: Final = 78
MODES: Final = {"constant": CONSTANT, "sweeping": SWEEPING, "pulsed": PULSED}

RfChannel: TypeAlias = Annotated[int, Field(ge=0, le=LAST_CHANNEL)]


# ---------------------------------------------------------------- what a scenario can say


class KillSettings(Settings):
    """A robot dies: host, radio and drive."""

    kind: Literal["kill"] = "kill"
    robot: int = Field(ge=0, description="number of the robot in the team")
    at_s: float = Field(ge=0, description="s, when it dies")


class RadioOffSettings(Settings):
    """A robot's radio is off for a while; its host knows nothing of it."""

    kind: Literal["radio_off"] = "radio_off"
    robot: int = Field(ge=0, description="number of the robot in the team")
    at_s: float = Field(ge=0, description="s, when it goes off")
    until_s: float | None = Field(default=None, description="s, when it is on again; never if not given")

    @field_validator("until_s")
    @classmethod
    def _is_later(cls, until_s: float | None, info: ValidationInfo) -> float | None:
        return _after(until_s, info)


class JammerSettings(Settings):
    """A transmitter that disturbs the radios; see :mod:`cosim.channels.jamming` for what its modes do."""

    kind: Literal["jammer"] = "jammer"
    x_m: float = Field(description="m, where it stands")
    y_m: float = Field(description="m, where it stands")
    power_dbm: float = Field(default=20.0, description="dBm, on each channel of 1 MHz that it is on")
    channels: tuple[RfChannel, ...] | None = Field(
        default=None, min_length=1, description="RF channels, in the order of a sweep; all 79 if not given"
    )
    mode: Literal["constant", "sweeping", "pulsed"] = Field(default="constant", description="when it is on which")
    dwell_s: float = Field(default=0.001, ge=1e-9, description="s, on each channel, if it is sweeping")
    on_s: float = Field(default=0.01, ge=1e-9, description="s, on the air in every period, if it is pulsed")
    period_s: float = Field(default=0.1, ge=1e-9, description="s, from pulse to pulse, if it is pulsed")
    at_s: float = Field(default=0.0, ge=0, description="s, when it begins")
    until_s: float | None = Field(default=None, description="s, when it ends; with the run if not given")

    @field_validator("channels")
    @classmethod
    def _none_stands_twice(cls, channels: tuple[int, ...] | None) -> tuple[int, ...] | None:
        if channels is not None and len(set(channels)) < len(channels):
            raise ValueError("names a channel twice")
        return channels

    @field_validator("period_s")
    @classmethod
    def _holds_a_pulse(cls, period_s: float, info: ValidationInfo) -> float:
        if period_s < info.data.get("on_s", 0.0):
            raise ValueError(f"is not >= {info.data['on_s']:g}, the length of a pulse")
        return period_s

    @field_validator("until_s")
    @classmethod
    def _is_later(cls, until_s: float | None, info: ValidationInfo) -> float | None:
        return _after(until_s, info)

    def jammer(self, run_end: Time) -> Jammer:
        """Return the transmitter itself, which is silent from *run_end* on."""
        return Jammer(
            self.x_m,
            self.y_m,
            self.power_dbm,
            tuple(range(LAST_CHANNEL + 1)) if self.channels is None else self.channels,
            MODES[self.mode],
            from_seconds(self.dwell_s),
            from_seconds(self.on_s),
            from_seconds(self.period_s),
            from_seconds(self.at_s),
            run_end if self.until_s is None else from_seconds(self.until_s),
        )


FaultSettings: TypeAlias = Annotated[KillSettings | RadioOffSettings | JammerSettings, Field(discriminator="kind")]


def _after(until_s: float | None, info: ValidationInfo) -> float | None:
    if until_s is not None and until_s <= info.data.get("at_s", -1.0):
        raise ValueError(f"is not > {info.data['at_s']:g}, its at_s")
    return until_s


def misplaced(faults: Sequence[FaultSettings], team: int, duration_s: float) -> tuple[int, str, str] | None:
    """Return (number, field, what is wrong) of the first of *faults* that cannot happen in a run, if there is one.

    A robot must be one of the *team*, a fault begin before the run ends, and nobody die twice.
    """
    dead: set[Address] = set()
    for number, fault in enumerate(faults):
        if fault.at_s >= duration_s:
            return number, "at_s", f"is not < {duration_s:g}, the run's duration_s"
        if isinstance(fault, JammerSettings):
            continue
        if fault.robot >= team:
            return number, "robot", f"is not one of the robots 0 to {team - 1}"
        if isinstance(fault, KillSettings):
            if fault.robot in dead:
                return number, "robot", "dies twice"
            dead.add(fault.robot)
    return None


# ---------------------------------------------------------------- what happens


@dataclass(frozen=True)
class Killed:
    """A fault has killed the robot."""


@dataclass(frozen=True)
class RadioOff:
    """A fault has switched the robot's radio off."""


@dataclass(frozen=True)
class RadioOn:
    """The robot's radio is on again."""


EVENTS: Final = (Killed, RadioOff, RadioOn)
"""Rows of the table of events that faults cause."""


class Faults:
    """The faults of one run."""

    def __init__(
        self,
        settings: Sequence[FaultSettings],
        kernel: Kernel,
        nodes: Sequence[Node],
        channel: Channel,
        fleet: Fleet,
        trace: Trace,
    ) -> None:
        self.killed = 0
        """Robots that have died."""
        self._settings = settings
        self._kernel = kernel
        self._nodes = nodes
        self._channel = channel
        self._fleet = fleet
        self._trace = trace
        self._outages = [0] * len(nodes)
        self._coasting: dict[Address, Time] = {}

    def schedule(self, run_end: Time) -> None:
        """Enter all faults into the kernel, before anything else of the instants at which they happen.

        Raise UserError for a jammer on a channel that has no radio.
        """
        for number, fault in enumerate(self._settings):
            match fault:
                case KillSettings():
                    self._at(fault.at_s, partial(self._kill, fault.robot))
                case RadioOffSettings():
                    self._at(fault.at_s, partial(self._radio, fault.robot, 1))
                    if fault.until_s is not None and from_seconds(fault.until_s) < run_end:
                        self._at(fault.until_s, partial(self._radio, fault.robot, -1))
                case JammerSettings():
                    jam = getattr(self._channel, "jam", None)
                    if jam is None:
                        raise UserError(f"faults[{number}]: there is no radio to jam on this channel")
                    jam(fault.jammer(run_end))

    def deaths(self, run_is_over: bool = False) -> list[Death]:
        """Return those of the dead whose bodies have come to rest, each once; all that are left if *run_is_over*."""
        if not self._coasting:
            return []
        rested = [robot for robot in sorted(self._coasting) if run_is_over or self._fleet.rests(robot)]
        return [self._death(robot, self._coasting.pop(robot)) for robot in rested]

    def _death(self, robot: Address, at: Time) -> Death:
        x_m, y_m = self._fleet.positions_m[robot].tolist()
        return Death(robot, at, x_m, y_m, float(self._fleet.radii_m[robot]))

    def _at(self, at_s: float, act: "partial[None]") -> None:
        self._kernel.at(from_seconds(at_s), act, WORLD)

    def _kill(self, robot: Address) -> None:
        node, now = self._nodes[robot], self._kernel.now
        self.killed += 1
        self._trace.event(now, robot, Killed())
        node.kill()
        self._channel.power(robot, False)
        self._fleet.apply([(robot, Drive(0.0, 0.0))])
        self._coasting[robot] = now

    def _radio(self, robot: Address, change: int) -> None:
        """Count one outage of the robot's radio more, or less; it is on while there is none."""
        self._outages[robot] += change
        if not self._nodes[robot].alive:
            return
        if change > 0 and self._outages[robot] == 1:
            self._trace.event(self._kernel.now, robot, RadioOff())
            self._channel.power(robot, False)
        elif not self._outages[robot]:
            self._trace.event(self._kernel.now, robot, RadioOn())
            self._channel.power(robot, True)
