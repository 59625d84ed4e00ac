"""Exploring: one robot's part in the exploration protocol, inside a deployment (paper 004, sections 2 and 6).

The machine of :mod:`protocols.exploration` leads the robot while it is ordered to explore: it chooses the heading, and
DWA drives (:mod:`protocols.deployment.driving.exploring_mover`). Its pieces of the map are sent as status broadcasts of
the transport, each piece as a topic of its own, so that they travel over whatever channel there is, and over links too;
the protocol itself asks again for what was lost. Robots that do not explore receive the pieces and ask for what they
lack, so that all get the map, also after booting again; and they look about where they stand, since others do not see
the floor under them.

*A lower bound of the time.* A robot that has driven s metres has seen nothing farther than s + r from where it set out,
by any way that light can take, where r is the range of its scans. So the farthest place of the floor needs
(distance - r) / speed. A robot that drives one metre sees at most 2 r m2 more, so the area beyond r needs
area / (2 r * the sum of the speeds). The longer of the two is a true bound for a team that shares all it sees at once.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple

from cosim.arrays import Floats
from cosim.errors import UserError
from cosim.machine import Address, Event, Outgoing, Reception
from cosim.observation import Observation
from cosim.protocol import Belief, Surroundings
from cosim.units import S, Time, from_seconds
from protocols.deployment.driving.exploring_parameters import ExploringParameters
from protocols.deployment.driving.learned import LearnedFloor, MapLearned
from protocols.deployment.planning.planner import Refusal
from protocols.deployment.tasks.crew import Body, Crew
from protocols.deployment.tasks.plan import Explore, Place, Plan
from protocols.exploration.events import EVENTS as EXPLORATION_EVENTS
from protocols.exploration.explorer import Explorer
from protocols.exploration.parameters import Parameters
from protocols.exploration.setup import Setup, prepare
from protocols.motion.floor import Floor
from protocols.wire import BadBytes

FIRST_TOPIC: Final = 1
"""First topic of pieces of maps; those before it belong to deployments."""
TOPICS: Final = 100
"""Number of pieces that may wait for the radio; a later one takes the place of the one as many before it."""
_ELSEWHERE_M: Final = 0.1
"""Movement within which a robot counts as standing."""
_STANDS: Final = S
"""Time after which a standing robot looks about, if it does not explore."""
# A robot that yields goes at most 3 m ahead of the one that asked, and both bodies, and looks about there.
_ASIDE_M: Final = 5.0
"""Distance from an explorer at which others may see for it."""
_ROOM_CELLS: Final = 0.5 + math.sqrt(2.0)
"""Room beside its body that an explorer needs for a way: the slack of its plans, and a wall's cell."""
# The protocol demands that frontiers attract from farther than scans reach.
_BEYOND: Final = 1.25
"""Least reach of the frontiers' attraction, as a multiple of the range of scans."""

EVENTS: Final = (*EXPLORATION_EVENTS, MapLearned)
"""Events that exploring adds to the trace."""


class Ground(NamedTuple):
    """What all explorers know beforehand, or why no robot can explore."""

    parameters: Parameters
    known: Setup | None
    """The explorers' setup; None if no robot can explore."""
    why_not: str = ""
    """Why no robot can explore; empty if robots can."""


def ground_of(parameters: ExploringParameters, surroundings: Surroundings) -> Ground:
    """Return what explorers know of a floor: its extent and the range of scans."""
    own, range_m = parameters.protocol, surroundings.scan_range_m
    if not (surroundings.beams > 0 and math.isfinite(range_m)):
        return Ground(own, None, "nobody can explore: the robots have no range scanners")
    schemas = own.schemas.model_copy(update={"frontier_m": max(own.schemas.frontier_m, _BEYOND * range_m)})
    fitted = own.model_copy(update={"schemas": schemas})
    try:
        return Ground(fitted, prepare(fitted, surroundings))
    except UserError as error:
        return Ground(fitted, None, f"nobody can explore: {error}")


def explorable(found: Plan | Refusal, ground: Ground, crew: Crew) -> Plan | Refusal:
    """Return what the planner has found, or a refusal if it is a plan to explore with robots that cannot.

    A sonar has few beams: what is between the walls that they show would be taken for free.
    """
    if isinstance(found, Refusal):
        return found
    acts = [task.act for task in found.root.walk()]
    robots = sorted({robot for act in acts if isinstance(act, Explore) for robot in act.robots})
    deaf = tuple(f"robot {robot} has sonar, and cannot explore" for robot in robots if not scans(crew.bodies[robot]))
    if robots and ground.why_not:
        return Refusal(play=found.play, conflicts=(ground.why_not,))
    if not deaf:
        return found
    others = [robot for robot in crew.robots if scans(crew.bodies[robot])]
    return Refusal(
        play=found.play, conflicts=deaf, mend=(f"exploring by some of the robots {others}",) if others else ()
    )


class Outlook:
    """How long it takes to explore a floor of which no robot has seen anything yet."""

    def __init__(
        self,
        parameters: ExploringParameters,
        ground: Ground,
        floor: Floor,
        named_m: Mapping[str, Sequence[Place]],
        least_share: float,
    ) -> None:
        """Measure on the planner's *floor*; the true length of its ways is at least *least_share* of theirs.

        On a floor that is to be learned only places with names, *named_m*, are known to exist; its extent may be empty.
        """
        self._own, self._ground, self._floor, self._share = parameters, ground, floor, least_share
        learned = isinstance(floor, LearnedFloor)
        self._named = [place for places in named_m.values() for place in places] if learned else []
        self._asked: dict[tuple[float, tuple[Place, ...], tuple[Place, ...]], Floats] = {}

    def least_s(self, explorers: Mapping[Address, Body], places_m: Mapping[Address, Place]) -> float:
        """Return the least time (s) that *explorers* take, with all robots at *places_m* at first; 0 if unknown."""
        known = self._ground.known
        if known is None:
            return 0.0
        reach_m = known.range_m + math.sqrt(2.0) * known.frame.cell_m + _ASIDE_M
        beyond_m = self._away_m(explorers, places_m, known.frame.cell_m) - reach_m
        to_cells_m = beyond_m[beyond_m > 0.0]
        to_named_m = (min(math.dist(place, at) for at in places_m.values()) - reach_m for place in self._named)
        farthest_m = max(to_cells_m.max(initial=0.0), *to_named_m, 0.0)
        area_m2 = len(to_cells_m) * self._floor.parameters.cell_m * self._floor.parameters.cell_m
        speeds_mps = [min(body.speed_mps, self._own.protocol.steering.speed_mps) for body in explorers.values()]
        least_s = max(farthest_m / max(speeds_mps), area_m2 / (2.0 * reach_m * math.fsum(speeds_mps)))
        return float(min(least_s, self._own.most_s))

    def _away_m(self, explorers: Mapping[Address, Body], places_m: Mapping[Address, Place], cell_m: float) -> Floats:
        """Return the least distance of the nearest robot from each cell that all explorers can reach, shape (n,)."""
        radius_m = max(body.radius_m for body in explorers.values()) + _ROOM_CELLS * cell_m
        radius_m -= self._floor.parameters.margin_m  # the floor adds it
        mine = tuple(places_m[robot] for robot in explorers)
        others = tuple(place for robot, place in places_m.items() if robot not in explorers)
        key = radius_m, mine, others
        if key not in self._asked:
            self._asked = {key: self._share * self._floor.afar_m(*key)}
        return self._asked[key]


def scans(body: Body) -> bool:
    """Return whether a robot has a laser scanner."""
    return body.sensor == "laser"


class Exploring:
    """One robot's part in an exploration."""

    def __init__(
        self,
        parameters: ExploringParameters,
        ground: Ground,
        me: Address,
        octets: int,
        floor: Floor,
        scans: bool,
        note: Callable[[Event], None],
    ) -> None:
        """Share the map in frames of at most *octets*. A *floor* that is learned becomes what is known of it.

        A robot that does not *scan*, without a laser scanner, only receives.
        """
        self.on = False
        """True if it leads the robot."""
        self.over: str | None = None
        """Why the robot has explored enough, in words (empty: nothing is left to see); None before."""
        self._own, self._ground, self._me = parameters, ground, me
        sharing = ground.parameters.sharing
        fitted = sharing.model_copy(update={"octets": min(sharing.octets, octets)})
        self._parameters = ground.parameters.model_copy(update={"sharing": fitted})
        self._floor = floor if isinstance(floor, LearnedFloor) else None
        self._scans, self._note = scans, note
        self._explorer: Explorer | None = None
        """Made when it is first needed."""
        self._since: Time = 0
        self._place_m: Place | None = None
        """Where it looked about last, or may do so next."""
        self._stood: Time | None = None
        """Since when it has stood there; None if it has looked about."""
        self._looked: Time | None = None
        """When it last took over what was learned."""
        self._version = 0
        self._count = 0
        self._frames: list[tuple[int, bytes]] = []

    @property
    def why_not(self) -> str:
        """Why no robot can explore; empty if robots can."""
        return self._ground.why_not

    def believed(self) -> Belief:
        """Return what an explorer believes, for who looks on; it knows nothing before it explores, or is told."""
        return Belief() if self._explorer is None else self._explorer.believed()

    @property
    def begun(self) -> bool:
        """True if any robot has explored, as far as this one knows."""
        return self._explorer is not None

    @property
    def speed_mps(self) -> float:
        """Greatest speed of explorers."""
        return self._own.protocol.steering.speed_mps

    # ------------------------------------------------------------ being led

    def begin(self, now: Time) -> None:
        """Lead the robot from now on. Raise LookupError where no robot can explore."""
        if not self.on:
            self.on, self._since = True, now
        self.over = None
        self._made(now)

    def halt(self) -> None:
        """Stop leading the robot."""
        self.on = False

    def step(self, observation: Observation, now: Time) -> float | None:
        """Mark what is seen and share it; return the heading to go, rad; None to stand. Stop when nothing is left."""
        explorer = self._made(now)
        wish_rad = explorer.wish(observation, now).heading_rad
        self._collect()
        if explorer.finished or now - self._since >= from_seconds(self._own.most_s):
            self._end("" if explorer.finished else f"stopped after {self._own.most_s:g} s", now)
            return None
        self._renew(now)
        return wish_rad

    def listen(self, observation: Observation, now: Time) -> None:
        """Send others what is known, and ask for what is lacking, once any robot has explored."""
        if self._explorer is None or self.on:
            return
        here = observation.x_m, observation.y_m
        if self._place_m is None or math.dist(here, self._place_m) > _ELSEWHERE_M:
            self._place_m, self._stood = here, now
        elif self._scans and self._stood is not None and now - self._stood >= _STANDS:
            self._stood = None  # it looks once from each place
            self._explorer.look_about(observation, now)
        self._explorer.share(observation, now)
        self._collect()
        self._renew(now)

    # ------------------------------------------------------------ messages

    def receive(self, source: Address, payload: bytes, now: Time) -> None:
        """Take a piece of another robot's map, or a summary."""
        if self._ground.known is None:
            self._note(BadBytes(source, len(payload)))
            return
        self._made(now).receive(payload, Reception(source, True), now)
        self._collect()

    def frames(self) -> list[tuple[int, bytes]]:
        """Drain what is to be broadcast: topics and payloads."""
        frames, self._frames = self._frames, []
        return frames

    def _collect(self) -> None:
        """Take over the explorer's messages and events."""
        assert self._explorer is not None
        for sent in self._explorer.outbox():
            assert isinstance(sent, Outgoing)
            self._frames.append((FIRST_TOPIC + self._count % TOPICS, sent.payload))
            self._count += 1
        for event in self._explorer.events():
            self._note(event)

    # ------------------------------------------------------------ what is learned

    def _renew(self, now: Time) -> None:
        """Take over what was learned, if the last time was a while ago; clocks may have been set back."""
        if self._looked is None or not 0 <= now - self._looked < from_seconds(self._own.renew_s):
            self._learn(now)

    def _learn(self, now: Time) -> None:
        assert self._explorer is not None
        belief, self._looked = self._explorer.belief, now
        if self._floor is not None and belief.version != self._version:
            self._version = belief.version
            self._floor.learn(belief.evidence, belief.frame.origin_m, belief.frame.cell_m)

    def _end(self, why: str, now: Time) -> None:
        """End exploring, and report what was learned."""
        self.on, self.over = False, why
        self._learn(now)
        assert self._explorer is not None
        evidence = self._explorer.belief.evidence
        self._note(MapLearned(int((evidence < 0).sum()), int((evidence > 0).sum())))

    # ------------------------------------------------------------ making it

    def _made(self, now: Time) -> Explorer:
        if self._explorer is None:
            known = self._ground.known
            if known is None:
                raise LookupError(self._ground.why_not)
            self._explorer = Explorer(self._parameters, known, self._me, None, now)
        return self._explorer
