"""Faults in the course of a run, carried out in the phase FAULT: before a world tick of the same instant.

A killed robot's host neither takes nor answers anything from that instant on, its radio is off, and its body coasts: it
keeps its velocity until the next world tick (that way has been checked against walls and bodies), and from there on
brakes to rest under its acceleration limit, as if it were ordered to stand still. It rests there as an obstacle for
ever. (A body that stood at once, in the midst of a tick, could be run into by one that follows it.)

A crashed robot is the same until it boots: then a new machine, with what all machines know beforehand and a stream of
its own, has the radio and the body; the clock has gone on. The referee hears of no death, for that body does not rest
for ever, and the run waits for it. A frozen body brakes likewise; once it thaws it carries out its last order.

A battery is an amount of energy that host, radio and drive use up, from world tick to world tick. The law is linear:
constant power of the host and of the radio while they are on, and a constant energy for each metre driven. A radio uses
most of its energy for listening (Feeney and Nilsson, "Investigating the energy consumption of a wireless network
interface in an ad hoc networking environment", INFOCOM 2001), so frames are not counted, unless a battery asks for what
radios take by their states; neither is braking, nor what standing costs beyond the host.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from cosim.channels.base import Channel
from cosim.errors import UserError
from cosim.faults.air import AirFaults
from cosim.faults.events import (
    BatteryEmpty,
    CameraOff,
    CameraOn,
    Carried,
    ClockStepped,
    Crashed,
    Frozen,
    Killed,
    NotCarried,
    RadioOff,
    RadioOn,
    Rebooted,
    Thawed,
)
from cosim.faults.instants import Agenda, Happening, Span, lasting, spans
from cosim.faults.settings import (
    BatterySettings,
    CameraOffSettings,
    ClockStepSettings,
    CrashSettings,
    FaultSettings,
    FrozenSettings,
    JammerSettings,
    KillSettings,
    MovedSettings,
    RadioOffSettings,
    WallSettings,
)
from cosim.intervals import HOST, Interval, Intervals
from cosim.kernel import WORLD, Kernel
from cosim.machine import Address, Drive, Machine, Scan
from cosim.node import Node
from cosim.protocol import Death, Metric
from cosim.randomness import Streams
from cosim.robots.motion import Carry, Fleet
from cosim.robots.placement import Point, misfit
from cosim.robots.senses import Senses
from cosim.trace import Trace
from cosim.units import Time, from_seconds, to_seconds
from cosim.world.floorplan import Floorplan

Boot: TypeAlias = Callable[[Address, int, Time], Machine]
"""(robot, how often it has booted again, its clock) -> its new machine."""

ENERGY_METRICS: Final = (
    Metric("drive_j", "J", "that the robots' batteries have spent on driving"),
    Metric("host_j", "J", "that the robots' batteries have spent on hosts"),
)
"""What a run counts that has a battery with ``energy: states``, of all batteries together."""
TRIES: Final = 1000
"""Number of places that are drawn before the floor counts as full."""
_ROUNDING: Final = 1e-9
"""Share of a battery's capacity that counts as empty, so that rounding costs no tick."""


class Victims(NamedTuple):
    """What faults act on."""

    nodes: Sequence[Node]
    channel: Channel
    fleet: Fleet
    senses: Senses | None
    floorplan: Floorplan
    boot: Boot


class Faults:
    """The faults of one run."""

    def __init__(
        self, settings: Sequence[FaultSettings], kernel: Kernel, victims: Victims, trace: Trace, streams: Streams
    ) -> None:
        """Raise UserError for a place to which a robot is to be moved where it does not fit."""
        check_places(settings, victims.fleet.radii_m.tolist(), victims.floorplan)
        self.killed = 0
        """Robots that have died."""
        self.blind: set[Address] = set()
        """Robots whose cameras are off."""
        self._intervals = Intervals(trace, HOST)
        self._settings = settings
        self._kernel = kernel
        self._trace = trace
        self._streams = streams
        self._nodes, self._channel, self._fleet, self._senses, self._floorplan, self._boot = victims
        self._lasting: dict[tuple[str, Address, int | None], int] = {}
        """Number of faults of a kind that a robot has just now, those of one of its radios by its number."""
        self._down: set[Address] = set()
        """Robots that have crashed and will boot again, or would if the run were longer."""
        self._boots = [0] * len(self._nodes)
        self._to_scan: set[tuple[Address, int]] = set()
        """Robots that have booted, with those of their radios that have not been on since."""
        self._batteries: dict[Address, Battery] = {}
        self._dead: set[Address] = set()
        self._coasting: dict[Address, Time] = {}

    def schedule(self, run_end: Time) -> None:
        """Have all faults happen, before anything else of their instants.

        Raise UserError for a jammer or a wall on a channel that has no radio, or a battery that counts states of radios
        whose energy is not known.
        """
        agenda = Agenda(self._kernel)
        air = AirFaults(self._kernel, agenda, self._channel, self._trace, self._intervals)
        for number, fault in enumerate(self._settings):
            if isinstance(fault, BatterySettings):
                self._supply(number, fault)
                continue
            happening = spans(fault, self._streams("fault", number), run_end)
            try:
                match fault:
                    case JammerSettings():
                        air.jam(number, fault, happening, run_end)
                    case WallSettings():
                        air.obstruct(number, fault, happening)
                    case _:
                        agenda.enter(number, map(partial(self._happening, number, fault), happening))
            except UserError as error:
                raise UserError(f"faults[{number}]: {error}") from None
        agenda.begin()

    def _happening(self, number: int, fault: FaultSettings, span: Span) -> Happening:
        start = span[0]
        match fault:
            case KillSettings(robot=robot):
                return ((start, partial(self.kill, robot)),)
            case ClockStepSettings(robot=robot):
                return ((start, partial(self._step_clock, robot, from_seconds(fault.by_s))),)
            case MovedSettings():
                tick = self._fleet.tick
                carry = partial(self._carry, fault, ("fault", number, "place", start))
                return ((max(1, -(-start // tick)) * tick, carry),)
            case CrashSettings() | RadioOffSettings() | CameraOffSettings() | FrozenSettings():
                radio = fault.radio if isinstance(fault, RadioOffSettings) else None
                begin, end = (partial(self._count, fault.kind, fault.robot, radio, change) for change in (1, -1))
                return lasting(span, begin, end)
        raise AssertionError(f"{fault.kind} does not happen at instants")

    def deaths(self, run_is_over: bool = False) -> list[Death]:
        """Return those of the dead whose bodies have come to rest, each once; all that are left if *run_is_over*."""
        if not self._coasting:
            return []
        rested = [robot for robot in sorted(self._coasting) if run_is_over or self._fleet.rests(robot)]
        return [self._death(robot, self._coasting.pop(robot)) for robot in rested]

    def under_way(self, now: Time) -> list[Interval]:
        """Return what faults are doing to robots, and on the air, *now*: for who watches a run."""
        return self._intervals.under_way(now)

    def close(self, now: Time) -> None:
        """Write the intervals that are not over: the run is."""
        self._intervals.close(now)

    @property
    def reboots_pending(self) -> bool:
        """Whether a host is down that will boot again."""
        return bool(self._down)

    def _death(self, robot: Address, at: Time) -> Death:
        x_m, y_m = self._fleet.positions_m[robot].tolist()
        return Death(robot, at, x_m, y_m, float(self._fleet.radii_m[robot]))

    def _note(self, robot: Address, event: object) -> None:
        self._trace.event(self._kernel.now, robot, event)

    def _note_interval(self, robot: Address, state: str, begins: bool, detail: str = "") -> None:
        (self._intervals.begin if begins else self._intervals.end)(robot, state, self._kernel.now, detail)

    # ------------------------------------------------------------ hosts

    def kill(self, robot: Address) -> None:
        """Have *robot* die now, for ever."""
        if robot in self._dead:
            return
        self.killed += 1
        self._note(robot, Killed())
        self._dead.add(robot)
        self._intervals.end_all(robot, self._kernel.now)
        self._note_interval(robot, "killed", True)
        self._down.discard(robot)
        self._stop(robot)
        self._coasting[robot] = self._kernel.now

    def _stop(self, robot: Address) -> None:
        self._nodes[robot].kill()
        self._channel.power(robot, False)
        self._fleet.apply([(robot, Drive(0.0, 0.0))])

    def _crash(self, robot: Address, down: bool) -> None:
        self._note(robot, Crashed() if down else Rebooted())
        self._note_interval(robot, "crashed", down)
        if down:
            self._down.add(robot)
            self._stop(robot)
            return
        self._down.remove(robot)
        self._boots[robot] += 1
        carried = self._channel.carried(robot)
        self._to_scan.update((robot, radio) for radio in carried)
        self._radios_on(robot, carried)
        node, now = self._nodes[robot], self._kernel.now
        node.reboot(self._boot(robot, self._boots[robot], now + node.clock_offset), now)

    def _step_clock(self, robot: Address, by: Time) -> None:
        if robot in self._dead:
            return
        node = self._nodes[robot]
        self._note_interval(robot, "clock_stepped", False, f"by_ns={node.clock_offset}")
        self._note(robot, ClockStepped(node.step_clock(by, self._kernel.now)))
        if node.clock_offset:
            self._note_interval(robot, "clock_stepped", True, f"by_ns={node.clock_offset}")

    # ------------------------------------------------------------ what begins and ends

    def _count(self, kind: str, robot: Address, radio: int | None, change: int) -> None:
        """Count one fault of this *kind* more, or less: the first that is on begins it, the last that ends ends it."""
        self._account(robot)
        self._lasting[kind, robot, radio] = count = self._lasting.get((kind, robot, radio), 0) + change
        if robot in self._dead or not (count == 0 or count == change):
            return
        begins = change > 0
        match kind:
            case "crash":
                self._crash(robot, begins)
            case "radio_off":
                self._radio(robot, radio, begins)
            case "camera_off":
                self._camera(robot, begins)
            case "frozen":
                self._note(robot, Frozen() if begins else Thawed())
                self._note_interval(robot, "frozen", begins)
                self._fleet.freeze(robot, begins)

    def _radio(self, robot: Address, radio: int | None, off: bool) -> None:
        named = -1 if radio is None else radio
        self._note(robot, RadioOff(named) if off else RadioOn(named))
        if robot in self._down:
            return
        carried = self._channel.carried(robot)
        concerned = carried if radio is None else (radio,)
        if off:
            for each in concerned:
                self._channel.parts[each].power(robot, False)
        else:
            self._radios_on(robot, concerned)

    def _is_off(self, robot: Address, radio: int) -> bool:
        return any(self._lasting.get(("radio_off", robot, each)) for each in (None, radio))

    def _radios_on(self, robot: Address, radios: Sequence[int]) -> None:
        """Switch *radios* on, but those that a fault keeps off; after a boot they scan, as all do in the beginning."""
        on = [radio for radio in radios if not self._is_off(robot, radio)]
        for radio in on:
            self._channel.parts[radio].power(robot, True)
        for radio in on:
            if (robot, radio) in self._to_scan:
                self._to_scan.remove((robot, radio))
                self._channel.command(robot, Scan(True, radio))

    def _camera(self, robot: Address, off: bool) -> None:
        self._note(robot, CameraOff() if off else CameraOn())
        self._note_interval(robot, "camera_off", off)
        (self.blind.add if off else self.blind.remove)(robot)
        if self._senses is not None:
            self._senses.blind(robot, off)

    # ------------------------------------------------------------ bodies

    def _carry(self, fault: MovedSettings, stream: tuple[str | int, ...]) -> None:
        """Put a robot elsewhere, at this tick; if there is no room, it stays where it is."""
        robot = fault.robot
        if robot in self._dead:
            return
        before = self._fleet.pose_at(robot, self._kernel.now)
        heading = before[2] if fault.heading_deg is None else math.radians(fault.heading_deg)
        radius_m = float(self._fleet.radii_m[robot])
        given = fault.to_m
        unaware = self._senses is not None and not self._senses.aware
        for x, y in drawn_places(radius_m, self._floorplan, self._streams(*stream)) if given is None else (given,):
            carried = Carry(before, (x, y, heading))
            if self._fleet.carry(robot, carried, unaware):
                if self._senses is not None:
                    self._senses.carry(robot, carried)
                self._note(robot, Carried(x, y))
                return
        self._note(robot, NotCarried())

    # ------------------------------------------------------------ batteries

    def energy_j(self) -> dict[Address, float]:
        """Return what is left in the battery of each robot that has one, as of the last tick."""
        return {robot: max(0.0, battery.left_j) for robot, battery in sorted(self._batteries.items())}

    def used_j(self) -> dict[Address, dict[str, float]]:
        """Return what host and drive of each robot that has a battery have used, as of the last tick."""
        return {robot: {"host": each.host_j, "drive": each.drive_j} for robot, each in self._batteries.items()}

    @property
    def columns(self) -> tuple[Metric, ...]:
        """The metrics that ``summary`` returns: no outcome of a run."""
        return ENERGY_METRICS if any(battery.counts_states for battery in self._batteries.values()) else ()

    def summary(self) -> dict[str, float]:
        """Return what drive and host of all robots with a battery have used, if one of these counts states."""
        used = self.used_j().values()
        drive_j, host_j = (math.fsum(each[part] for each in used) for part in ("drive", "host"))
        return {"drive_j": drive_j, "host_j": host_j} if self.columns else {}

    def _supply(self, number: int, fault: BatterySettings) -> None:
        """Have a battery looked at whenever a tick comes."""
        if fault.energy == "states":
            for radio in self._channel.carried(fault.robot):
                accounts = self._channel.parts[radio].accounts
                if accounts is None or not accounts.priced:
                    raise UserError(f"faults[{number}].energy: states needs a part that channel.energy names")
        self._batteries[fault.robot] = Battery(fault)
        self._kernel.every(self._fleet.tick, partial(self._drain, fault.robot), WORLD)

    def _account(self, robot: Address) -> None:
        """Have the robot's battery pay for the time up to now, in which host and radio were as they are."""
        battery = self._batteries.get(robot)
        if battery is not None:
            host_on = self._nodes[robot].alive
            radio_on = any(not self._is_off(robot, radio) for radio in self._channel.carried(robot))
            battery.last(self._kernel.now, host_on, host_on and radio_on)
            if battery.counts_states:
                battery.radios(self._radios_j(robot))

    def _radios_j(self, robot: Address) -> float:
        """Return what the radios of *robot*, whose parts are known, have used up to now."""
        accounts = (self._channel.parts[radio].accounts for radio in self._channel.carried(robot))
        return math.fsum(each.energy_j(robot, self._kernel.now) for each in accounts if each is not None)

    def _drain(self, robot: Address) -> None:
        self._account(robot)
        battery = self._batteries[robot]
        battery.drive(self._fleet.way_m(robot))
        if battery.empty and robot not in self._dead:
            self._note(robot, BatteryEmpty())
            self.kill(robot)


class Battery:
    """What is left of the energy of one robot."""

    def __init__(self, settings: BatterySettings) -> None:
        self.left_j = settings.capacity_j
        self.host_j = self.drive_j = 0.0
        """What host and drive have used."""
        self.counts_states = settings.energy == "states"
        """True if what radios take goes by what they do."""
        self._settings = settings
        self._since: Time = 0
        self._radios_j = 0.0

    def last(self, now: Time, host_on: bool, radio_on: bool) -> None:
        """Take what the time since the last call has cost, in which host and radio were on or off."""
        power_w = self._settings.idle_w * host_on + self._settings.radio_w * radio_on
        self.left_j -= power_w * to_seconds(now - self._since)
        self.host_j += self._settings.idle_w * host_on * to_seconds(now - self._since)
        self._since = now

    def radios(self, used_j: float) -> None:
        """Take what radios have used since the last call; up to now it is *used_j* in all."""
        self.left_j -= used_j - self._radios_j
        self._radios_j = used_j

    def drive(self, way_m: float) -> None:
        """Take what a way has cost."""
        self.left_j -= self._settings.drive_j_per_m * way_m
        self.drive_j += self._settings.drive_j_per_m * way_m

    @property
    def empty(self) -> bool:
        """Whether nothing is left."""
        return self.left_j <= _ROUNDING * self._settings.capacity_j


# ---------------------------------------------------------------- places


def check_places(faults: Sequence[FaultSettings], radii_m: Sequence[float], floorplan: Floorplan) -> None:
    """Raise UserError for a place to which a robot is to be moved where its body would not fit."""
    for number, fault in enumerate(faults):
        if isinstance(fault, MovedSettings) and fault.to_m is not None:
            wrong = misfit(fault.to_m, float(radii_m[fault.robot]), floorplan)
            if wrong is not None:
                x, y = fault.to_m
                raise UserError(f"faults[{number}].to_m: ({x:g}, {y:g}) {wrong}")


def drawn_places(radius_m: float, floorplan: Floorplan, stream: np.random.Generator) -> Iterator[Point]:
    """Yield places on the floor where a body of *radius_m* fits, drawn evenly from *stream*; none if it is full.

    Whether a way leads out of them is not checked.
    """
    x_min, y_min, x_max, y_max = floorplan.bounds_m
    for _ in range(TRIES):
        place = float(stream.uniform(x_min, x_max)), float(stream.uniform(y_min, y_max))
        if misfit(place, radius_m, floorplan) is None:
            yield place
