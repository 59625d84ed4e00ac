"""Exploring: one robot's part in the exploration protocol, inside of a deployment (paper 004, sections 2 and 6).

The machine of :mod:`protocols.exploration` leads the robot while it is ordered to explore. What it tells others of its
map goes as news of the courier, each piece as a topic of its own, so that it comes over whatever channel there is, and
over links too; what is lost on the way is asked for again by the protocol itself. Who does not explore hears the pieces
and asks for what it lacks, so that all come to have the map, also who boots again.
"""

import math
from collections.abc import Callable
from typing import Final, NamedTuple

from cosim.errors import UserError
from cosim.geometry.marking import CERTAIN, DOUBTFUL
from cosim.machine import Address, Drive, Event, Outgoing, Reception
from cosim.observation import Observation
from cosim.protocol import Surroundings
from cosim.units import Time, from_seconds
from protocols.deployment.exploring_parameters import ExploringParameters
from protocols.deployment.journal import BadBytes
from protocols.deployment.learned import LearnedFloor, MapLearned
from protocols.exploration import journal as explored_journal
from protocols.exploration import spec as exploration
from protocols.exploration.behaviour import Behaviour
from protocols.exploration.belief import Belief
from protocols.exploration.explorer import Explorer, Leader
from protocols.exploration.knowledge import Knowledge
from protocols.exploration.parameters import Parameters
from protocols.exploration.records import Records
from protocols.exploration.rivals import Rival
from protocols.exploration.sharing import Sharing
from protocols.exploration.targets import Targets
from protocols.exploration.terrain import Terrain

FIRST_TOPIC: Final = 1
"""Of news about maps; before it are those of deployments."""
TOPICS: Final = 100
"""So many pieces may wait for the radio at a time; a later one takes the place of the one so many before it."""
_BEYOND: Final = 1.25
"""Frontiers attract from so many times as far as scans reach, if a scenario says no more: the protocol wants more."""

EVENTS: Final = (
    explored_journal.Stalled,
    explored_journal.PathLaid,
    explored_journal.PathLeft,
    explored_journal.FrontierGivenUp,
    explored_journal.Explored,
    MapLearned,
)
"""What exploring adds to the trace."""


class Ground(NamedTuple):
    """What all who explore know beforehand; or why nobody can."""

    parameters: Parameters
    known: Knowledge | None
    why_not: str = ""


def ground_of(parameters: ExploringParameters, surroundings: Surroundings) -> Ground:
    """Return what explorers know of a floor: its extent, and how far scans reach."""
    own, range_m = parameters.protocol, surroundings.scan_range_m
    if not (surroundings.beams > 0 and math.isfinite(range_m)):
        return Ground(own, None, "nobody can explore: the robots have no range scanners")
    schemas = own.schemas.model_copy(update={"frontier_m": max(own.schemas.frontier_m, _BEYOND * range_m)})
    fitted = own.model_copy(update={"schemas": schemas})
    try:
        return Ground(fitted, exploration.prepare(fitted, surroundings))
    except UserError as error:
        return Ground(fitted, None, f"nobody can explore: {error}")


class _Room(NamedTuple):
    """What explores; made when it is first needed."""

    explorer: Explorer
    sharing: Sharing
    belief: Belief


class Exploring:
    """One robot's part in it."""

    def __init__(
        self,
        parameters: ExploringParameters,
        ground: Ground,
        me: Address,
        octets: int,
        floor: LearnedFloor | None,
        note: Callable[[Event], None],
    ) -> None:
        """Tell of the map in pieces of so many *octets*; *floor* is to be what was learned, if ways are planned by it."""
        self.on = False
        """Whether it leads the robot."""
        self.over: str | None = None
        """Why the robot has explored enough, in words (empty: nothing is left to see); None while it has not."""
        self._own, self._ground, self._me, self._octets = parameters, ground, me, octets
        self._floor, self._note = floor, note
        self._room: _Room | None = None
        self._since: Time = 0
        self._looked: Time | None = None
        """When what was learned was looked at last."""
        self._version = 0
        self._count = 0
        self._frames: list[tuple[int, bytes]] = []

    @property
    def why_not(self) -> str:
        """Why nobody can explore; empty if robots can."""
        return self._ground.why_not

    # ------------------------------------------------------------ being led

    def begin(self, now: Time) -> None:
        """Lead the robot from now on, or on. Raise LookupError where nobody can explore."""
        if not self.on:
            self.on, self._since = True, now
        self.over = None
        self._made(now)

    def halt(self) -> None:
        """Lead it no more."""
        self.on = False

    def step(self, observation: Observation, now: Time) -> Drive | None:
        """Look, mark, tell, and return what to drive from the next tick on; None if it is no other than before."""
        explorer = self._made(now).explorer
        explorer.observe(observation, now)
        drives = [command for command in explorer.commands() if isinstance(command, Drive)]
        self._collect()
        late = now - self._since >= from_seconds(self._own.most_s)
        if explorer.finished or late:
            self._end("" if explorer.finished else f"stopped after {self._own.most_s:g} s", now)
            return Drive(0.0, 0.0)
        self._renew(now)
        return drives[-1] if drives else None

    def listen(self, observation: Observation, now: Time) -> None:
        """Tell others what is known, and ask for what is lacking, once anybody has explored at all."""
        if self._room is None or self.on:
            return
        here = observation.x_m, observation.y_m
        self._room.sharing.tick(*here, now, observation.sightings)
        self._collect()
        self._renew(now)

    # ------------------------------------------------------------ what is told

    def receive(self, source: Address, payload: bytes, now: Time) -> None:
        """Take what another tells of its map."""
        if self._ground.known is None:
            self._note(BadBytes(source, len(payload)))
            return
        self._made(now).explorer.receive(payload, Reception(source, True), now)
        self._collect()

    def frames(self) -> list[tuple[int, bytes]]:
        """Drain what is to be told to all: topics and payloads."""
        frames, self._frames = self._frames, []
        return frames

    def _collect(self) -> None:
        """Take over what the explorer wants to say, and what has happened to it."""
        assert self._room is not None
        for sent in self._room.explorer.outbox():
            assert isinstance(sent, Outgoing)
            self._frames.append((FIRST_TOPIC + self._count % TOPICS, sent.payload))
            self._count += 1
        for event in self._room.explorer.events():
            if isinstance(event, explored_journal.BadBytes):
                event = BadBytes(event.sender, event.length)
            self._note(event)

    # ------------------------------------------------------------ what is learned

    def _renew(self, now: Time) -> None:
        """Look at what was learned, if that was a while ago; clocks may have been set back."""
        if self._looked is None or not 0 <= now - self._looked < from_seconds(self._own.renew_s):
            self._learn(now)

    def _learn(self, now: Time) -> None:
        assert self._room is not None
        belief, self._looked = self._room.belief, now
        if self._floor is not None and belief.version != self._version:
            self._version = belief.version
            self._floor.learn(belief.evidence, belief.frame.origin_m, belief.frame.cell_m)

    def _end(self, why: str, now: Time) -> None:
        """Have explored enough."""
        self.on, self.over = False, why
        self._learn(now)
        assert self._room is not None
        evidence = self._room.belief.evidence
        self._note(MapLearned(int((evidence < 0).sum()), int((evidence > 0).sum())))

    # ------------------------------------------------------------ making it

    def _made(self, now: Time) -> _Room:
        if self._room is None:
            known = self._ground.known
            if known is None:
                raise LookupError(self._ground.why_not)
            self._room = _room(self._ground.parameters, known, self._me, self._octets, now)
        return self._room


def _room(parameters: Parameters, known: Knowledge, me: Address, octets: int, now: Time) -> _Room:
    """Return an explorer with a map of its own, which begins *now* to tell of it in frames of *octets* at most."""
    own, weights = parameters.sharing, DOUBTFUL if parameters.counted else CERTAIN
    records, events = Records(), list[Event]()
    cells, period = known.frame.nx * known.frame.ny, from_seconds(own.period_s)
    most = min(own.octets, octets)
    sharing = Sharing(me, known.size, cells, period, most, own.again, records, now, not parameters.counted)
    belief = Belief(known.frame, weights, known.range_m)
    leader = _leader(parameters, known, me, belief, sharing, records, events)
    return _Room(Explorer(parameters, known, me, belief, leader, sharing, records, events), sharing, belief)


def _leader(
    parameters: Parameters,
    known: Knowledge,
    me: Address,
    belief: Belief,
    sharing: Sharing,
    records: Records,
    events: list[Event],
) -> Leader:
    """Return what decides where a robot goes that has its own map."""
    terrain, radius_m = Terrain(belief, parameters.escape), known.radii_m[me]
    if parameters.algorithm == "schemas":
        return Behaviour(parameters, terrain, records, events, radius_m, known.range_m, known.tick)
    rivals = parameters.rivals
    targets = Targets(parameters.algorithm, rivals, terrain, known.radii_m, known.range_m, sharing.places_m)
    plan, patience = (max(1, round(from_seconds(span) / known.tick)) for span in (rivals.plan_s, rivals.patience_s))
    return Rival(targets, records, events, me, plan, patience)
