"""The machine of one robot: it notes the goals that others send and the ways that they promise, and reflects them.

At each tick the robot looks where it is and what is in sight (all goals and ghosts in one question), chooses where to
go, and broadcasts what it sees, which goals it knows and what it can promise (rules 1 to 4). Frames come in between
ticks. They count if the robot sees their sender, which is also where the sender's promises and places are put (paper
000, section 3.1).

From one robot's frame of reference into another's lead the directions in which the two see each other (Fig. 4). Let F_i
and F_j be the frames of two robots that see each other, a_ij the direction in which i sees j (in F_i) and a_ji that in
which j sees i (in F_j). Both lie on one line and look opposite ways, so F_j is turned against F_i by

    theta_ji = 180 + a_ij - a_ji        (degrees; the paper writes it for 2 and 1, and swaps the indices of alpha)

and an offset that j sends relative to itself, turned by theta_ji and added to where i sees j, is in F_i. No robot's
pose is needed.
"""

import math
from collections.abc import Mapping
from typing import Final

import cosim.elementary as elementary
from cosim.errors import WireError
from cosim.machine import BROADCAST, Address, Drains, GoTo, LinkEvent, Outgoing, Reception
from cosim.navigation.steering import Navigator
from cosim.observation import Observation, Sighting
from cosim.protocol import Belief
from cosim.units import MS, Time, from_seconds
from protocols.reflection.events import BadBytes, Counters, Displaced
from protocols.reflection.frames import CLOCK_MS, FAR_M, IN_TROUBLE, OBJECTS, Frame, decode, pack
from protocols.reflection.goals import NEW, GoalBook, goal_number
from protocols.reflection.parameters import Parameters
from protocols.reflection.patrolling import Patrol
from protocols.reflection.promises import Ways
from protocols.reflection.seeking import Seeker
from protocols.reflection.setup import Point, Setup
from protocols.reflection.straight import Straight
from protocols.reflection.yielding import Yielding
from protocols.transport.meeting import Meeting

FULL_TURN: Final = 2.0 * math.pi
_new: Final = tuple.__new__  # what a named tuple's own constructor calls; a third faster
JUMP_STEPS = 5.0
"""Motion steps within a tick from which on a robot counts as moved by something else."""


def turn_between(alpha_ij_rad: float, alpha_ji_rad: float) -> float:
    """Return theta_ji, by which F_j is turned against F_i, in radians in [0, 2 pi) (paper 000, section 3.1)."""
    return (math.pi + alpha_ij_rad - alpha_ji_rad) % FULL_TURN


def from_peer(offset_m: Point, peer_m: Point, turn_rad: float) -> Point:
    """Return the place in F_i of an offset from j along the axes of F_j.

    *peer_m* is where i sees j, *turn_rad* is theta_ji.
    """
    cos, sin = elementary.cos(turn_rad), elementary.sin(turn_rad)
    x, y = offset_m
    return peer_m[0] + cos * x - sin * y, peer_m[1] + sin * x + cos * y


class Reflection(Drains):
    """The machine of one robot. It lives on observations, and has no deadlines."""

    def __init__(
        self,
        parameters: Parameters,
        setup: Setup,
        me: Address,
        navigator: Navigator,
        start: Time,
    ) -> None:
        """Use *navigator* as the algorithm A of a robot with goals, and as the way back of a lost helper."""
        super().__init__()
        task = setup.tasks[me]
        self.me = me
        self.counters = Counters()
        self.book = GoalBook(me, setup.size)
        self.ways = Ways(self.book, from_seconds(parameters.promise_life_s), parameters.comparison)
        self._start = start
        self._size = setup.size
        times = from_seconds(parameters.inquiry_s), from_seconds(parameters.page_s)
        meets = me, bool(task.goals_m), *times, self._outbox, setup.piconet
        self._meeting = Meeting(*meets) if parameters.links else None
        self._going: Point | None = None
        self._objects_m = task.objects_m if parameters.goals == "object" else None
        """Where the goals of each robot are; None if goals are places."""
        self._stale = from_seconds(parameters.stale_s)
        self._metres_per_ms = tuple(step_m * MS / setup.tick for step_m in setup.steps_m)
        self._share_goals = parameters.share_goals
        self._share_states = parameters.states_shared
        self._speaks = self._share_goals or self._share_states
        self._period = 0 if parameters.period_s is None else from_seconds(parameters.period_s)
        self._jump_m = JUMP_STEPS * setup.steps_m[me]
        self._here: Point | None = None
        self._looked_ms = 0
        """When the robot saw the others where they are seen, ms since the start."""
        self._seen: tuple[Sighting, ...] = ()
        self._sightings: dict[Address, Point] = {}
        self._states: dict[Address, bool] = {}
        self._next_frame = start
        step_m = setup.steps_m[me]
        straight = Straight(setup.radius_m, step_m, from_seconds(parameters.patience_s), start)
        self.patrol = (
            Patrol(task.patrol_m, parameters.patrol == "shuttle", step_m, straight, navigator)
            if task.patrol_m
            else None
        )
        self._yielding = Yielding(self.ways, setup.radius_m, from_seconds(parameters.hold_s), self._events)
        self.seeker = (
            Seeker(parameters, setup, self.ways, navigator, straight, self._events, self.counters, start)
            if task.goals_m
            else None
        )

    # ------------------------------------------------------------ the contract of machines

    @property
    def finished(self) -> bool:
        """True if all goals are reached or given up; a helper has none, and helps as long as it is asked to."""
        return self.seeker is None or self.seeker.finished

    def receive(self, data: bytes, reception: Reception, now: Time) -> bool:
        """Take a frame, if its sender is in sight; return False if nothing is to be done about it."""
        peer = reception.source
        if peer == self.me:
            return False
        try:
            frame = decode(data)
        except WireError as error:
            self._events.append(BadBytes(str(error)))
            return True
        peer_m = self._sightings.get(peer)
        if peer_m is None:
            self._unseen(frame)
            return False
        self._states[peer] = frame.in_trouble
        self._note_goals(frame, peer_m)
        if frame.pledges and self._note_promises(frame, peer, peer_m, now) and self.seeker is not None:
            self.seeker.promised(now)
        return self.left()

    def link(self, event: LinkEvent, now: Time) -> None:
        """Take an event of a link, if links are used; else frames go to all in reach."""
        if self._meeting is not None:
            self._meeting.link(event, now)

    def observe(self, observation: Observation, now: Time) -> bool:
        """Look, choose where to go, and broadcast; return False if nothing has come of it."""
        x, y = observation.x_m, observation.y_m
        here, last = (x, y), self._here
        if last is not None and abs(x - last[0]) + abs(y - last[1]) > self._jump_m:
            self._note_jump(here, now)
        self._here = here
        self._looked_ms = (now - self._start) // MS
        seen = observation.sightings
        if seen is not self._seen:
            self._seen = seen
            self._sightings = {address: (x_m, y_m) for address, x_m, y_m in seen}
        seeker = self.seeker
        if seeker is not None:
            seeker.arrive(x, y, now)
        if self.book.known or self.patrol is not None:
            self._look(observation, here, now)
        going = self._choose(observation, now)
        if going is not self._going and going is not None and going != self._going:
            self._commands.append(_new(GoTo, going))
            self._going = going
        if self._sightings and now >= self._next_frame and self._speaks:
            self._send(here, now)
        if self._meeting is not None:
            self._meeting.look(self._sightings, now)
        return self.left()

    def wake(self, now: Time) -> None:
        """Do nothing: there are no deadlines."""

    def wake_at(self) -> Time | None:
        """Return None: there are no deadlines."""
        return None

    def believed(self) -> Belief:
        """Return where it heads and which goal it has, for who looks on.

        That is the place of a promise, a ghost or a helper, or the end of a few steps by the algorithm A.
        """
        way = () if self._going is None else (self._going,)
        if self.seeker is None or self.seeker.finished:
            return Belief(way_m=way)
        place, goal = self.seeker.place_m, None if self._objects_m is not None else self.seeker.goal_m
        return Belief(way_m=way if place is None else (place,), goal_m=goal)

    # ------------------------------------------------------------ what comes in

    def _look(self, observation: Observation, here: Point, now: Time) -> None:
        """Ask once which of all the places that matter are in sight."""
        points = self.ways.points()
        patrol = self.patrol
        count = len(points)
        if patrol is not None and patrol.off_its_way:
            points += patrol.places()
        visible = observation.sees(points) if points else []
        self.ways.look(visible, here[0], here[1], now)
        if patrol is not None:
            patrol.look(visible[count:], here)

    def _note_jump(self, here: Point, now: Time) -> None:
        assert self._here is not None
        self._events.append(Displaced(math.dist(here, self._here)))
        self.ways.displaced()
        self._going = None
        if self.seeker is not None:
            self.seeker.displaced(now)
        if self.patrol is not None:
            self.patrol.displaced(now)

    def _unseen(self, frame: Frame) -> None:
        """Count promises from a robot that is not in sight: they are of no use."""
        for owner, _, _, _ in frame.pledges:
            if owner == self.me:
                self.counters.unseen_advice += 1

    def _note_goals(self, frame: Frame, peer_m: Point) -> None:
        """Store the goals that a robot sends which is seen at *peer_m* and sees this one (rules 1 and 2)."""
        identifiers, me, size = self.book.identifiers, self.me, self._size
        for owner, identifier, _, _ in frame.terms:  # most are not new: only for others the turn is computed
            if owner >= size or (owner != me and identifier >= identifiers[owner]):
                self._store(frame, peer_m)
                return

    def _store(self, frame: Frame, peer_m: Point) -> None:
        me, book = self.me, self.book
        for robot, angle in frame.bearings:
            if robot == me:
                bearing = angle
                break
        else:
            return
        here, turn = self._here, None
        assert here is not None  # a peer in sight was seen by an observation
        for owner, identifier, along, across in frame.terms:
            if owner >= self._size:
                self._events.append(BadBytes(f"a goal of robot {owner} in a team of {self._size}"))
            elif owner != me and identifier >= book.identifiers[owner]:
                place: Point | None
                if self._objects_m is None:
                    if turn is None:
                        turn = turn_between(elementary.atan2(peer_m[1] - here[1], peer_m[0] - here[0]), bearing)
                    place = from_peer((along, across), peer_m, turn)
                else:
                    place = self._looks_like(owner, identifier)
                if place is not None and book.consider(owner, identifier, *place) is NEW:
                    self.ways.forget(owner)

    def _note_promises(self, frame: Frame, peer: Address, peer_m: Point, now: Time) -> bool:
        """Store the promises of *peer*, which is seen at *peer_m* (rules 3 and 4).

        Return whether one of them is now the way to the own goal.
        """
        me, team, ways, here = self.me, self._size, self.ways, self._here
        assert here is not None
        identifiers, of = self.book.identifiers, ways.of
        arrival_ms = (now - self._start) // MS
        moved_m = 0.0 if frame.stamp_ms == self._looked_ms else self._moved_since(frame.stamp_ms, peer)
        own = False
        for owner, identifier, length, seen_ms in frame.pledges:
            if owner >= team:
                self._events.append(BadBytes(f"a promise for robot {owner} in a team of {team}"))
                continue
            known = identifiers[owner]
            same_goal = identifier == known or (known and (identifier - 1) // team == (known - 1) // team)
            if owner == me:
                late = (arrival_ms - frame.stamp_ms) % CLOCK_MS * MS > self._stale
                self.counters.count_advice(not same_goal, late)
            way = of[owner]
            if same_goal and not (way is not None and way.direct):  # no promise is shorter than what is in sight
                seen = now - (arrival_ms - seen_ms) % CLOCK_MS * MS
                taken = ways.offer(owner, peer_m, length + moved_m, seen, peer, here)
                own = own or (taken and owner == me)
        return own

    def _looks_like(self, owner: Address, identifier: int) -> Point | None:
        """Return where the object with an *identifier* is, for ``sees`` to answer whether it is in sight."""
        assert self._objects_m is not None
        objects = self._objects_m[owner]
        number = goal_number(identifier, self._size)
        return objects[number - 1] if number <= len(objects) else None

    def _moved_since(self, stamp_ms: int, peer: Address) -> float:
        """Return how far *peer* can have driven, metres, from when it sent its promises to when it was seen last."""
        # A way leads to where the peer is seen, but was measured from where it stood when it sent. In the paper both
        # are one instant; a frame that takes longer than a tick would otherwise promise less than the straight line.
        lag_ms = (self._looked_ms - stamp_ms) % CLOCK_MS
        return self._metres_per_ms[peer] * min(lag_ms, CLOCK_MS - lag_ms) if lag_ms else 0.0

    # ------------------------------------------------------------ what comes out

    def _choose(self, observation: Observation, now: Time) -> Point | None:
        seeker = self.seeker
        if seeker is not None and not seeker.finished:
            return seeker.choose(observation, self._sightings, self._states, now)
        aside = self._yielding.evade(observation, self._sightings, now)
        patrol = self.patrol
        if patrol is None:
            return aside
        if aside is not None:
            patrol.left((observation.x_m, observation.y_m))
            return aside
        return patrol.choose(observation, self._sightings, now)

    def _send(self, here: Point, now: Time) -> None:
        """Send a frame with all that others may use."""
        self._next_frame = now + self._period
        in_trouble = self._share_states and self.seeker is not None and self.seeker.trouble.active
        flags = (IN_TROUBLE if in_trouble else 0) | (OBJECTS if self._objects_m is not None else 0)
        ways = self.ways if self._share_goals else None
        payload = compose(flags, here, self._sightings, ways, self._start, now)
        counters = self.counters
        counters.frames += 1
        counters.payload_bytes += len(payload)
        if self._meeting is None:
            self._outbox.append(_new(Outgoing, (BROADCAST, payload, None, 0)))
        else:
            self._outbox += [Outgoing(peer, payload) for peer in sorted(self._meeting.linked)]


# ---------------------------------------------------------------- what is broadcast


def compose(
    flags: int,
    here_m: Point,
    sightings: Mapping[Address, Point],
    ways: Ways | None,
    start: Time,
    now: Time,
) -> bytes:
    """Return the frame of a robot at *here_m*, which sees *sightings*, metres in its own frame.

    *ways* are those to the goals that it knows, None if it does not share them; times count from *start*.
    """
    x, y = here_m
    flat: list[float] = []
    for peer, (seen_x, seen_y) in sightings.items():
        flat += peer, elementary.atan2(seen_y - y, seen_x - x)
    terms, pledges = (0, 0) if ways is None else _collect(ways, x, y, start, flat)
    return pack(flags, (now - start) // MS % CLOCK_MS, len(sightings), terms, pledges, flat)


def _collect(ways: Ways, x: float, y: float, start: Time, flat: list[float]) -> tuple[int, int]:
    """Add all goals that may be passed on, and what is left of the ways to others' goals; return the number of each."""
    terms = 0
    pledges: list[float] = []
    book = ways.book
    xs, ys, of, me = book.x_m, book.y_m, ways.of, book.me
    for owner in book.known:
        identifier = book.sent_as(owner)
        along, across = xs[owner] - x, ys[owner] - y
        if identifier and -FAR_M < along < FAR_M and -FAR_M < across < FAR_M:
            flat += owner, identifier, along, across
            terms += 1
        way = of[owner]
        if way is not None and owner != me:
            length = way.rest_m + math.hypot(way.x_m - x, way.y_m - y)
            if length < FAR_M:
                pledges += owner, book.identifiers[owner], length, (way.seen - start) // MS % CLOCK_MS
    flat += pledges
    return terms, len(pledges) // 4
