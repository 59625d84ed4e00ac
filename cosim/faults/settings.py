"""Faults as a scenario describes them: what goes wrong, with which robot, at a given time or at random with a rate.

With a rate, a fault happens at the points of a Poisson process: the gaps are exponential, drawn from a stream of that
fault's own. Faults of one kind and one robot may overlap; what they have in common is over when the last of them is.
"""

from collections.abc import Sequence
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field, ValidationInfo, field_validator

from cosim.channels.jamming import CONSTANT, PULSED, SWEEPING, Jammer
from cosim.machine import Address
from cosim.settings import Angle, Count, Decibels, Energy, Metres, Rate, Seconds, Settings
from cosim.units import Time, from_seconds

LAST_CHANNEL: Final = 78
MOST_OFTEN_PER_S: Final = 1e3
"""Greatest rate: once a millisecond, so that a run gets on."""
LONGEST_STEP_S: Final = 1e9
"""Longest step, thirty years: the clock still reads an integer of 64 bits, in the tables too."""
MODES: Final = {"constant": CONSTANT, "sweeping": SWEEPING, "pulsed": PULSED}

RfChannel: TypeAlias = Annotated[int, Field(ge=0, le=LAST_CHANNEL)]


class TimedSettings(Settings):
    """Something that happens at an instant, or again and again."""

    at_s: Seconds = Field(ge=0, description="s, when it happens; with a rate, from when on it can")
    rate_per_s: float | None = Field(
        default=None, gt=0, le=MOST_OFTEN_PER_S, description="1/s, how often, at random; once, at at_s, if not given"
    )


class LastingSettings(TimedSettings):
    """Something that begins and, mostly, ends."""

    until_s: Seconds | None = Field(default=None, description="s, when it is over; if that or for_s is given")
    for_s: Seconds | None = Field(default=None, ge=1e-9, description="s, how long it lasts, each time")

    @field_validator("until_s")
    @classmethod
    def _is_later(cls, until_s: float | None, info: ValidationInfo) -> float | None:
        if until_s is not None and until_s <= info.data.get("at_s", -1.0):
            raise ValueError(f"is not > {info.data['at_s']:g}, its at_s")
        if until_s is not None and info.data.get("rate_per_s") is not None:
            raise ValueError("is given beside rate_per_s, with which only for_s says how long it lasts")
        return until_s

    @field_validator("for_s")
    @classmethod
    def _is_the_only_end(cls, for_s: float | None, info: ValidationInfo) -> float | None:
        if for_s is not None and info.data.get("until_s") is not None:
            raise ValueError("is given beside until_s")
        return for_s


class KillSettings(TimedSettings):
    """A robot dies: host, radio and drive. With a rate it dies at the first time."""

    kind: Literal["kill"] = "kill"
    robot: Count = Field(ge=0, description="number of the robot in the team")


class CrashSettings(LastingSettings):
    """A robot's host crashes, as if it were dead, and boots again: a new machine without memory."""

    kind: Literal["crash"] = "crash"
    robot: Count = Field(ge=0, description="number of the robot in the team")

    @field_validator("for_s")
    @classmethod
    def _comes_back(cls, for_s: float | None, info: ValidationInfo) -> float | None:
        if for_s is None and info.data.get("until_s", 0.0) is None:
            raise ValueError("is no end, nor is until_s given: say when it boots again, or have it killed (kind: kill)")
        return for_s


class RadioOffSettings(LastingSettings):
    """A robot's radio is off for a while, or for ever; its host knows nothing of it."""

    kind: Literal["radio_off"] = "radio_off"
    robot: Count = Field(ge=0, description="number of the robot in the team")
    radio: Count | None = Field(default=None, ge=0, description="which of its radios; all if not given")


class CameraOffSettings(LastingSettings):
    """A robot's camera is off for a while, or for ever: it sees no robot and no point. The range scanner goes on."""

    kind: Literal["camera_off"] = "camera_off"
    robot: Count = Field(ge=0, description="number of the robot in the team")


class FrozenSettings(LastingSettings):
    """A robot brakes and cannot move for a while, or for ever; then it carries out the last order it was given."""

    kind: Literal["frozen"] = "frozen"
    robot: Count = Field(ge=0, description="number of the robot in the team")


class MovedSettings(TimedSettings):
    """A robot is taken up and put elsewhere, at rest, at the first world tick after the start not before that time.

    Odometry does not notice: where a robot knows the world's frame without drift, it knows where it is now; else what
    it knows, its frame and the point that it drives to, go along with it.
    """

    kind: Literal["moved"] = "moved"
    robot: Count = Field(ge=0, description="number of the robot in the team")
    to_m: tuple[Metres, Metres] | None = Field(
        default=None, description="m, where it is put; anywhere on free floor if not given"
    )
    heading_deg: Angle | None = Field(default=None, description="degrees, its heading there; as before if not given")


class ClockStepSettings(TimedSettings):
    """A robot's clock jumps: all that its machine is told and says of time is by that clock, from 0 to 4e9 s."""

    kind: Literal["clock_step"] = "clock_step"
    robot: Count = Field(ge=0, description="number of the robot in the team")
    by_s: float = Field(
        ge=-LONGEST_STEP_S, le=LONGEST_STEP_S, description="s, by how much, to the nanosecond; negative is back"
    )

    @field_validator("by_s")
    @classmethod
    def _is_a_step(cls, by_s: float) -> float:
        if not from_seconds(by_s):
            raise ValueError("is not a step, of 1e-9 s at least")
        return by_s


class BatterySettings(Settings):
    """A robot has so much energy; when it is used up, to a world tick, the robot dies."""

    kind: Literal["battery"] = "battery"
    robot: Count = Field(ge=0, description="number of the robot in the team")
    capacity_j: Energy = Field(gt=0, description="J, what it holds in the beginning")
    idle_w: Energy = Field(default=0.0, ge=0, description="W, of the host, as long as that runs")
    radio_w: Energy = Field(default=0.0, ge=0, description="W, of the radio, as long as it, or one of them, is on")
    energy: Literal["constant", "states"] = Field(
        default="constant",
        description="what radios take: radio_w, or what they do takes by the part that channel.energy names",
    )
    drive_j_per_m: Rate = Field(default=0.0, ge=0, description="J, for each metre driven")

    @field_validator("energy")
    @classmethod
    def _counts_once(cls, energy: str, info: ValidationInfo) -> str:
        if energy == "states" and info.data.get("radio_w"):
            raise ValueError("is given beside radio_w, which is what radios take if it is constant")
        return energy

    @field_validator("drive_j_per_m")
    @classmethod
    def _is_used(cls, drive_j_per_m: float, info: ValidationInfo) -> float:
        if info.data.get("energy") == "states":
            return drive_j_per_m
        if not (drive_j_per_m or info.data.get("idle_w", 1.0) or info.data.get("radio_w", 1.0)):
            raise ValueError("is not > 0, nor is idle_w or radio_w: nothing uses the battery")
        return drive_j_per_m


class WallSettings(LastingSettings):
    """A stretch of line that costs radios dB while it is there; bodies and cameras do not notice it."""

    kind: Literal["wall"] = "wall"
    at_s: Seconds = Field(default=0.0, ge=0, description="s, when it is there; with a rate, from when on it can be")
    from_m: tuple[Metres, Metres] = Field(description="m, one end")
    to_m: tuple[Metres, Metres] = Field(description="m, the other end")
    loss_db: Decibels = Field(gt=0, description="dB, what it takes from a signal that crosses it")
    radio: Count | None = Field(
        default=None, ge=0, description="whose signals, of the robots' radios; all if not given"
    )

    @field_validator("to_m")
    @classmethod
    def _is_elsewhere(cls, to_m: tuple[float, float], info: ValidationInfo) -> tuple[float, float]:
        if to_m == info.data.get("from_m"):
            raise ValueError("is the other end as well: no line")
        return to_m


class JammerSettings(LastingSettings):
    """A transmitter that disturbs the radios; see :mod:`cosim.channels.jamming` for what its modes do."""

    kind: Literal["jammer"] = "jammer"
    x_m: Metres = Field(description="m, where it stands")
    y_m: Metres = Field(description="m, where it stands")
    power_dbm: Decibels = Field(default=20.0, description="dBm, on each channel of 1 MHz that it is on")
    channels: tuple[RfChannel, ...] | None = Field(
        default=None, min_length=1, description="RF channels, in the order of a sweep; all 79 if not given"
    )
    mode: Literal["constant", "sweeping", "pulsed"] = Field(default="constant", description="when it is on which")
    dwell_s: Seconds = Field(default=0.001, ge=1e-9, description="s, on each channel, if it is sweeping")
    on_s: Seconds = Field(default=0.01, ge=1e-9, description="s, on the air in every period, if it is pulsed")
    period_s: Seconds = Field(default=0.1, ge=1e-9, description="s, from pulse to pulse, if it is pulsed")
    at_s: Seconds = Field(default=0.0, ge=0, description="s, when it begins; with a rate, from when on it can")
    radio: Count | None = Field(default=None, ge=0, description="which of the robots' radios; all if not given")

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

    def jammer(self, start: Time, end: Time) -> Jammer:
        """Return the transmitter itself, which is silent before *start* and from *end* on."""
        return Jammer(
            self.x_m,
            self.y_m,
            self.power_dbm,
            tuple(range(LAST_CHANNEL + 1)) if self.channels is None else self.channels,
            MODES[self.mode],
            from_seconds(self.dwell_s),
            from_seconds(self.on_s),
            from_seconds(self.period_s),
            start,
            end,
        )


FaultSettings: TypeAlias = Annotated[
    KillSettings
    | CrashSettings
    | RadioOffSettings
    | CameraOffSettings
    | FrozenSettings
    | MovedSettings
    | ClockStepSettings
    | BatterySettings
    | WallSettings
    | JammerSettings,
    Field(discriminator="kind"),
]


def misplaced(faults: Sequence[FaultSettings], team: int, duration_s: float) -> tuple[int, str, str] | None:
    """Return (number, field, what is wrong) of the first of *faults* that cannot happen in a run, if there is one.

    A robot must be one of the *team*, a fault begin before the run ends, no robot die twice or have two batteries.
    """
    dead: set[Address] = set()
    supplied: set[Address] = set()
    for number, fault in enumerate(faults):
        if isinstance(fault, TimedSettings) and fault.at_s >= duration_s:
            return number, "at_s", f"is not < {duration_s:g}, the run's duration_s"
        if isinstance(fault, JammerSettings | WallSettings):
            continue
        if fault.robot >= team:
            return number, "robot", f"is not one of the robots 0 to {team - 1}"
        if isinstance(fault, KillSettings):
            if fault.robot in dead:
                return number, "robot", "dies twice"
            dead.add(fault.robot)
        if isinstance(fault, BatterySettings):
            if fault.robot in supplied:
                return number, "robot", "has a battery already"
            supplied.add(fault.robot)
    return None
