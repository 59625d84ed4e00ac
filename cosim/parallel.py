"""A run as PettingZoo's ``ParallelEnv``: made by :func:`cosim.env.parallel_env`.

Nothing of the run differs from another: the same bodies, channel, faults and clock. A step hands each machine its order
by the cable of its robot's console, has the simulation go on to a later tick of the world, and tells what the machines
have observed and heard by then. Orders are carried out from the next tick on, as all commands are; messages arrive when
the channel brings them.

All agents are there for the whole episode; a robot that a fault has killed is a flag in its observation. The episode is
truncated at the last tick before ``duration_s``, and terminated if the referee ends the run earlier.
"""

import math
from collections.abc import Callable, Sequence
from itertools import chain
from operator import index
from typing import Any, ClassVar, Final, NamedTuple, Protocol, TypeAlias, runtime_checkable

import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from pettingzoo import ParallelEnv

from cosim.arrays import Floats
from cosim.errors import UserError
from cosim.machine import Address, Drive
from cosim.observation import Observation, Sighting
from cosim.protocol import Referee
from cosim.randomness import Streams
from cosim.robots.body import BodySettings
from cosim.scenario import Scenario
from cosim.simulation import Simulation
from cosim.units import Time, from_seconds, to_seconds

Row: TypeAlias = npt.NDArray[np.float32]

MOVES: Final = {"stay": (0, 0), "ahead": (1, 0), "back": (-1, 0), "left": (0, 1), "right": (0, -1)}
"""The discrete motions, numbered in this order: shares of the greatest linear and angular velocity of the body."""
MOST_SIGHTINGS: Final = 8
"""How many others an observation has room for, unless it is said."""
GREATEST_SEED: Final = 1 << 62
OCTETS: Final = 256
NOBODY: Final = -1.0
"""The address in a row of an observation that nothing stands in."""


class Heard(Protocol):
    """A message that a robot has heard."""

    @property
    def source(self) -> Address:
        """Who has sent it."""

    @property
    def at(self) -> Time:
        """When it has arrived, by the receiver's clock."""

    @property
    def payload(self) -> bytes:
        """What it says."""


@runtime_checkable
class Ordered(Protocol):
    """What an environment needs of a machine beside :class:`cosim.machine.Machine`."""

    @property
    def observation(self) -> Observation | None:
        """What the robot has observed at the last tick; None before there was one."""

    @property
    def observed_at(self) -> Time:
        """When that was, by the robot's clock."""

    @property
    def heard(self) -> Any:
        """The latest messages, a deque of :class:`Heard` with a ``maxlen``, the last one last."""

    @property
    def message_octets(self) -> int:
        """Bytes of each message; 0 if there are none."""

    @property
    def connected(self) -> bool:
        """True if others can hear it now."""

    def order(self, command: Drive, message: bytes = b"") -> bytes:
        """Encode an order for the machine, as it takes it from its console."""


class Truth(NamedTuple):
    """The truth at a tick, for rewards."""

    time_s: float
    positions_m: Floats
    """Shape (robots, 2), in the world's frame."""
    alive: tuple[bool, ...]
    referee: Referee


class Terms(NamedTuple):
    """What an environment is to be: the arguments of :func:`cosim.env.parallel_env`."""

    reward: Callable[[Truth, Truth], Sequence[float]] | None
    motion: str
    ticks_per_step: int
    sightings: int | None
    setup_s: float

    def check(self) -> None:
        """Raise UserError for what cannot be."""
        if self.motion not in ("drive", "moves"):
            raise UserError(f"motion: {self.motion!r} is not drive or moves")
        if self.ticks_per_step < 1:
            raise UserError(f"ticks_per_step: {self.ticks_per_step} is not >= 1")
        if self.sightings is not None and self.sightings < 0:
            raise UserError(f"sightings: {self.sightings} is not >= 0")


class Layout:
    """Where in an observation what stands: numbers of one row, whose names, columns and bounds are here."""

    def __init__(self, simulation: Simulation, robot: Address, machine: Ordered, sightings: int) -> None:
        """Lay out the observations of *robot*, which has that *machine*, and room for so many *sightings*."""
        scenario = simulation.scenario
        x_min, y_min, x_max, y_max = simulation.floorplan.bounds_m
        if scenario.team.senses.frames == "own":  # it began anywhere, turned by any angle
            x_max = y_max = math.hypot(x_max - x_min, y_max - y_min)
            x_min = y_min = -x_max
        self.sightings, self.octets = sightings, machine.message_octets
        self.inbox: int = machine.heard.maxlen if self.octets else 0
        self.columns: dict[str, slice] = {}
        """Which columns hold what; ``seen`` and ``heard`` have several for each of their entries."""
        self._bounds: list[tuple[float, float]] = []
        speed_mps, others = scenario.team.bodies[robot].speed_mps, (NOBODY, scenario.team.size - 1.0)
        place = (x_min, x_max), (y_min, y_max)
        self._enter("alive", (0.0, 1.0))
        self._enter("connected", (0.0, 1.0))
        self._enter("pose", *place, (-math.pi, math.pi))
        self._enter("speed", (-speed_mps, speed_mps))
        self._enter("blocked", (0.0, 1.0))
        self._enter("seen", *(others, *place) * sightings)
        message = (others, (0.0, scenario.duration_s), *[(0.0, OCTETS - 1.0)] * self.octets)
        self._enter("heard", *message * self.inbox)
        low, high = np.array(self._bounds).T
        self.space = spaces.Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)
        self._vacant = np.zeros(len(self._bounds), np.float32)
        """The row of a robot that knows nothing of itself, sees nobody and has heard nothing."""
        self._vacant[self.columns["seen"]][::3] = NOBODY
        self._vacant[self.columns["heard"]][:: 2 + self.octets] = NOBODY

    def _enter(self, name: str, *bounds: tuple[float, float]) -> None:
        begin = len(self._bounds)
        self._bounds += bounds
        self.columns[name] = slice(begin, len(self._bounds))

    def row(self, machine: Ordered, alive: bool) -> Row:
        """Return the observation of the robot that *machine* belongs to."""
        own = machine.observation
        if own is None:  # its host was dead at every tick
            own = Observation(0.0, 0.0, 0.0, 0.0, True, False)
        x_m, y_m, heading_rad, speed_mps, _, blocked, *_ = own
        row = self._vacant.copy()
        row[: self.columns["seen"].start] = alive, machine.connected, x_m, y_m, heading_rad, speed_mps, blocked
        if self.sightings:
            self._see(own, row[self.columns["seen"]])
        if self.inbox and machine.heard:
            self._hear(machine, row[self.columns["heard"]])
        clipped: Row = np.minimum(np.maximum(row, self.space.low), self.space.high)
        return clipped

    def _see(self, own: Observation, row: Row) -> None:
        """Write into *row* address and place of those in sight, in order; of the nearest if there are too many."""
        seen: Sequence[Sighting] = own.sightings
        if len(seen) > self.sightings:
            nearest = sorted(seen, key=lambda other: (other.x_m - own.x_m) ** 2 + (other.y_m - own.y_m) ** 2)
            seen = sorted(nearest[: self.sightings])
        row[: 3 * len(seen)] = [*chain.from_iterable(seen)]

    def _hear(self, machine: Ordered, row: Row) -> None:
        """Write into *row* source, age and octets of the latest messages, the last one first."""
        messages: Sequence[Heard] = [*reversed(machine.heard)]
        rows = row.reshape(self.inbox, -1)[: len(messages)]
        now = machine.observed_at
        rows[:, 0] = [message.source for message in messages]
        rows[:, 1] = [to_seconds(now - message.at) for message in messages]
        octets = np.frombuffer(b"".join([message.payload for message in messages]), np.uint8)
        rows[:, 2:] = octets.reshape(-1, self.octets)


class Orders:
    """What an action of one robot means.

    With octets an action has a flag behind its motion, and the message is sent only if that is positive; octets follow.
    """

    def __init__(self, motion: str, body: BodySettings, octets: int) -> None:
        """Move a robot that has *body*, and send messages of so many *octets*."""
        self._octets = octets
        self._moves: list[Drive] | None = None
        self.space: spaces.Space[Any]
        speed_mps, turn_radps = body.speed_mps, body.turn_radps
        if motion == "drive":
            high = np.array([speed_mps, turn_radps, *[1.0] * (octets > 0), *[OCTETS - 1.0] * octets], dtype=np.float32)
            low = np.array([-speed_mps, -turn_radps, *[-1.0] * (octets > 0), *[0.0] * octets], dtype=np.float32)
            self.space = spaces.Box(low, high, dtype=np.float32)
            return
        self._moves = [Drive(way * speed_mps, turn * turn_radps) for way, turn in MOVES.values()]
        moves = len(self._moves)
        self.space = spaces.MultiDiscrete([moves, 2, *[OCTETS] * octets]) if octets else spaces.Discrete(moves)

    def read(self, action: Any) -> tuple[Drive, bytes]:
        """Return what *action* has the robot do and say; raise ValueError for what is no action.

        Velocities beyond what the body can do are cut by the body, octets are rounded.
        """
        numbers = np.ravel(action).tolist()
        motions = 1 if self._moves else 2
        if len(numbers) != motions + (self._octets > 0) + self._octets or not all(map(math.isfinite, numbers)):
            raise ValueError("numbers")
        if self._moves is None:
            drive = Drive(float(numbers[0]), float(numbers[1]))
        elif numbers[0] in range(len(self._moves)):
            drive = self._moves[int(numbers[0])]
        else:
            raise ValueError("moves")
        says = self._octets > 0 and numbers[motions] > 0
        return drive, bytes(map(round, numbers[motions + 1 :])) if says else b""


class TeamEnv(ParallelEnv):  # type: ignore[misc]  # its libraries are an extra
    """A scenario's robots as agents; equal seeds and actions, equal episodes.

    An episode has the seed that ``infos`` tell: with it ``cosim run`` makes the same world. The episode after
    ``reset(seed=s)`` has the seed s; each ``reset()`` goes on with another seed, drawn from s.
    """

    metadata: ClassVar[dict[str, Any]] = {"name": "cosim", "render_modes": [], "is_parallelizable": True}
    render_mode = None

    def __init__(self, scenario: Scenario, terms: Terms) -> None:
        """Make an environment; ``reset`` begins its first episode."""
        terms.check()
        self.scenario = scenario
        self.simulation = Simulation(scenario, scenario.seed)
        """The run of the present episode."""
        machines = [machine for machine in self.simulation.machines if isinstance(machine, Ordered)]
        if len(machines) < scenario.team.size:
            raise UserError(f"protocol.use: {scenario.protocol.use} takes no orders, expected one as agents does")
        self.possible_agents = [f"robot_{robot}" for robot in range(scenario.team.size)]
        self.agents = self.possible_agents[:]
        others = scenario.team.size - 1
        sightings = min(others, MOST_SIGHTINGS if terms.sightings is None else terms.sightings)
        robots = range(scenario.team.size)
        self.layouts = [Layout(self.simulation, robot, machines[robot], sightings) for robot in robots]
        """Where in each robot's observation what stands."""
        bodies = scenario.team.bodies
        self._orders = [Orders(terms.motion, bodies[robot], self.layouts[robot].octets) for robot in robots]
        self._numbers = {agent: robot for robot, agent in enumerate(self.possible_agents)}
        self._terms = terms
        self._last_tick = (scenario.duration - 1) // scenario.tick
        self._tick = 0
        self._seed = scenario.seed
        self._first_seed: int | None = None
        self._episode = 0
        self.truth = self._truth()
        """The truth at the end of the last step, or at ``reset``."""

    def observation_space(self, agent: str) -> spaces.Box:
        """Return the space of observations: rows as :class:`Layout` has them."""
        return self.layouts[self._numbers[agent]].space

    def action_space(self, agent: str) -> "spaces.Space[Any]":
        """Return the space of actions: motion, and with messages a flag and octets."""
        return self._orders[self._numbers[agent]].space

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Row], dict[str, dict[str, Any]]]:
        """Begin an episode, and return what the agents observe at its first tick, or at the first with links.

        Raise UserError for a seed out of range, and if the run ends before it has links.
        """
        self._seed = self._next_seed(seed)
        self.simulation = Simulation(self.scenario, self._seed)
        self.agents = self.possible_agents[:]
        self._tick = 0
        self.simulation.begin()
        over = self._advance(0)
        patience = from_seconds(self._terms.setup_s) // self.scenario.tick
        while not over and self._tick < min(patience, self._last_tick) and not self._connected():
            over = self._advance(1)
        if over or self._tick >= self._last_tick:
            raise UserError(f"duration_s: {self.scenario.duration_s:g} s are over before the first step")
        self.truth = self._truth()
        return self._observations(), self._infos()

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[dict[str, Row], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Have the robots do what *actions* say until the next step; who is not named goes on as before.

        Return observations, rewards, terminations, truncations and infos. Raise UserError for what is no action.
        """
        if not self.agents:
            return {}, {}, {}, {}, {}
        for agent, action in actions.items():
            self._hand(agent, action)
        over = self._advance(self._terms.ticks_per_step)
        terminated = over and self.simulation.kernel.now < self.scenario.duration
        truncated = self._tick >= self._last_tick and not terminated
        before, self.truth = self.truth, self._truth()
        reward = self._terms.reward
        rewards = [0.0] * len(self.agents) if reward is None else list(map(float, reward(before, self.truth)))
        told = self._observations(), dict(zip(self.agents, rewards, strict=True))
        terminations = dict.fromkeys(self.agents, terminated)
        truncations = dict.fromkeys(self.agents, truncated)
        infos = self._infos()
        if terminated or truncated:
            self.agents = []
        return *told, terminations, truncations, infos

    def _next_seed(self, seed: int | None) -> int:
        """Return the seed of the next episode; after the first one it is drawn from that of the first."""
        if seed is None and self._first_seed is not None:
            self._episode += 1
            return Streams(self._first_seed).draws("episode").below(GREATEST_SEED, self._episode)
        first = self.scenario.seed if seed is None else index(seed)
        if not 0 <= first <= GREATEST_SEED:
            raise UserError(f"seed: {first} is not >= 0 and <= {GREATEST_SEED}")
        self._first_seed, self._episode = first, 0
        return first

    def _hand(self, agent: str, action: Any) -> None:
        """Hand a robot its order; a dead host does not take it."""
        robot = self._numbers[agent]
        orders, machine = self._orders[robot], self.simulation.machines[robot]
        try:
            order = machine.order(*orders.read(action))  # type: ignore[attr-defined]
        except (ValueError, TypeError):
            raise UserError(f"{agent}: the action {action} is none of {orders.space}") from None
        self.simulation.operate(robot, order)

    def _advance(self, ticks: int) -> bool:
        """Go on to a later tick, all of that instant included; return whether the run is over."""
        self._tick = min(self._tick + ticks, self._last_tick)
        return self.simulation.advance(self._tick * self.scenario.tick + 1)

    def _connected(self) -> bool:
        simulation = self.simulation
        living = (each for node, each in zip(simulation.nodes, simulation.machines, strict=True) if node.alive)
        return all(machine.connected for machine in living)  # type: ignore[attr-defined]

    def _truth(self) -> Truth:
        simulation = self.simulation
        alive = tuple(node.alive for node in simulation.nodes)
        time_s = to_seconds(simulation.kernel.now // self.scenario.tick * self.scenario.tick)
        return Truth(time_s, simulation.fleet.positions_m.copy(), alive, simulation.referee)

    def _observations(self) -> dict[str, Row]:
        simulation = self.simulation
        parts = zip(self.possible_agents, self.layouts, simulation.machines, simulation.nodes, strict=True)
        return {agent: layout.row(machine, node.alive) for agent, layout, machine, node in parts}  # type: ignore[arg-type]

    def _infos(self) -> dict[str, dict[str, Any]]:
        told = {"time_s": self.truth.time_s, "seed": self._seed}
        return {agent: dict(told) for agent in self.agents}
