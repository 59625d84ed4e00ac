"""The coordination layer: the team's places, each robot's intention, and who gives way (paper 003, section VI).

The rules of conflict. Two robots that mean to enter one cell each send *help* in the next exchange, claiming the cell
with the reasons why their other actions failed. The more constricted one (fewer possible actions) keeps its action,
then the one with the lower number; the others drop theirs, evaluate again and confirm with an *answer*. A robot whose
next cell is the present one of another always gives way: a body stands there. When no conflict is left all robots
answer *accept*, and the step is made: that exchange is the one in which the state equals the previous state (Fig. 9a).

The stop message is sent "to indicate its departure from the team" (section III.A): with *departure* the team goes on
without a robot that has stopped, which stays where it is for good, and all others go around it. A robot on whose radio
others depend, a master or a bridge, has to stay a member (section V: robots remain active in communication, or hopping
would not be synchronous); it is asked for no directions any more, and covers nothing.

The place of a robot that was never found, or was dropped, is unknown: it may have made its last step or not. A robot
that cannot enter a cell turns back and reports that step as a wall; the whole team goes around that cell then. The
obstacle may have been a robot that only passed by: before the team gives up cells as unreachable, it tries again.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from cosim.geometry.grids import Cell
from cosim.machine import Address
from protocols.pseudonet.algorithms.base import STEPS, UNJUDGED, Algorithm, Evaluation, Verdicts
from protocols.pseudonet.messages import Action, Kind, Message, Reply, Verdict
from protocols.pseudonet.messaging import Stance
from protocols.pseudonet.setup import Setup, View


@dataclass(frozen=True, slots=True)
class Contest:
    """The outcome of comparing the next cells of all robots."""

    claimants: frozenset[Address] = frozenset()
    """Robots that want the same cell as another and have not given their reasons yet."""
    losers: frozenset[Address] = frozenset()
    """Robots that must choose another action."""

    def settled(self) -> bool:
        """Return whether no robot is in the way of another."""
        return not self.claimants and not self.losers


def contest(
    messages: Mapping[Address, Message], cells: Mapping[Address, Cell], targets: Mapping[Address, Cell]
) -> Contest:
    """Compare the next cells (*targets*) of all robots, which are in *cells* now."""
    standing = {cell: robot for robot, cell in cells.items()}
    moving = [robot for robot in sorted(targets) if targets[robot] != cells[robot]]
    losers = {robot for robot in moving if targets[robot] in standing or targets[robot] < 0}
    rivals: dict[Cell, list[Address]] = {}
    for robot in moving:
        if robot not in losers:
            rivals.setdefault(targets[robot], []).append(robot)
    claimants: set[Address] = set()
    for group in rivals.values():
        if len(group) < 2:
            continue
        if all(messages[robot].kind == Kind.HELP for robot in group):
            winner = min(group, key=lambda robot: (messages[robot].constricted(), robot))
            losers.update(robot for robot in group if robot != winner)
        else:
            claimants.update(group)
    return Contest(frozenset(claimants), frozenset(losers))


def accepted(messages: Iterable[Message]) -> bool:
    """Return whether all robots have accepted: the team has agreed on a step."""
    return all(message.kind == Kind.ANSWER and message.reply == Reply.ACCEPT for message in messages)


def in_trouble(message: Message) -> bool:
    """Return whether the message asks for directions: a trap, or help from a robot that has nowhere to go."""
    return message.kind == Kind.TRAP or (message.kind == Kind.HELP and message.action == Action.STAY)


def helper(asker: Address, messages: Mapping[Address, Message]) -> Address | None:
    """Return the robot that answers *asker*: the nearest that is not in trouble itself, then the lowest number."""
    here = messages[asker]
    candidates = [
        (abs(message.x - here.x) + abs(message.y - here.y), robot)
        for robot, message in messages.items()
        if robot != asker and not in_trouble(message)
    ]
    return min(candidates)[1] if candidates else None


class Coordination:
    """One robot's picture of the team and its coverage algorithm."""

    def __init__(
        self,
        setup: Setup,
        me: Address,
        algorithm: Algorithm,
        stop_at: int | None,
        rounds: int = 0,
        departure: bool = False,
    ) -> None:
        self.departure = departure and stop_at is not None  # who has made its tour has still to make room for others
        """True if who stops leaves the team."""
        self.view = View(setup, me)
        self.evaluation = Evaluation(Action.STAY, UNJUDGED)
        self.own_cells = 0
        self.dormant = False
        self.plan_due = False
        self.obstructed: Action | None = None
        """Step that this robot had to turn back from, until the team has received it."""
        self._rounds = rounds
        self._rounds_left = rounds
        self._stopped: set[Address] = set()
        self._algorithm = algorithm
        self._stop_at = stop_at
        self._setup = setup

    def localize(self, x_m: float, y_m: float) -> Cell:
        """Return the cell that the robot stands in (Fig. 12)."""
        return self._setup.grid.cell_at(x_m, y_m)

    def evaluate_actions(self) -> Evaluation:
        """Choose the next action, again if the present one was given up: scan the action space (Fig. 12)."""
        if self._stop_at is not None and self.own_cells >= self._stop_at:
            kind = Kind.STATE if self.dormant else Kind.STOP
            self.dormant = True
            self.evaluation = Evaluation(Action.STAY, UNJUDGED, kind)
        else:
            self.evaluation = self._algorithm.evaluate(self.view)
        return self.evaluation

    def negotiate(self, messages: Mapping[Address, Message]) -> Stance:
        """Return this robot's next stance on *messages*; a loser omits its action from the list and evaluates again."""
        outcome = contest(messages, self.view.cells, self.targets(messages))
        if self.view.me in outcome.losers:
            self.view.omitted.add(self.evaluation.action)
            self.evaluate_actions()
            return Stance.YIELD
        if self.view.me in outcome.claimants:
            return Stance.CLAIM
        return Stance.ACCEPT if outcome.settled() else Stance.REPEAT

    def stuck(self, cell: Cell) -> None:
        """Process that this robot stands in *cell*, in its middle or not, and cannot go on."""
        if cell in self._setup.cells:
            self.view.cells[self.view.me] = cell

    def turned_back(self) -> None:
        """Process that the last action cannot be carried out and the robot is on its way back."""
        self.obstructed = self.evaluation.action
        back = self._setup.steps[self.view.cells[self.view.me]][(self.obstructed + 2) % 4]
        self.view.cells[self.view.me] = back

    def obstruction(self) -> Verdicts:
        """Return the verdicts that report the step that this robot had to turn back from."""
        north, east, south, west = (Verdict.WALL if step == self.obstructed else Verdict.POSSIBLE for step in STEPS)
        return north, east, south, west

    def all_placed(self) -> bool:
        """Return whether the places of all members are known."""
        return all(member in self.view.cells for member in self.view.members)

    def complete(self) -> bool:
        """Return whether nothing is left to do: all is covered, or all robots have covered their programmed ratios."""
        return self.view.complete() or self._all_stopped()

    def _all_stopped(self) -> bool:
        return self._stop_at is not None and self._stopped.issuperset(self.view.members)

    def departing(self) -> set[Address]:
        """Return the members that have stopped and are to leave the team; none unless a stop is a departure."""
        return self._stopped & set(self.view.members) if self.departure else set()

    def try_again(self) -> bool:
        """Forget the obstacles before cells that are left, and return True; at most *rounds* times for a team."""
        left = len(self._setup.cells) > len(self.view.covered)
        if not (self.view.obstacles and left and self._rounds_left) or self._all_stopped():
            return False
        self._rounds_left -= 1
        self.view.obstacles = frozenset()
        self.plan_due = True
        return True

    def team_changed(self, members: tuple[Address, ...]) -> None:
        """Take over a new team: forget the places of robots that are gone, and the intentions of the old team.

        A robot that has stopped and left stands where it was: its cell is an obstacle from now on.
        """
        departed = self.departing()
        for gone in set(self.view.cells) - set(members) - {self.view.me}:
            cell = self.view.cells.pop(gone)
            if gone in departed:
                self.view.obstacles |= {cell}
        self.view.members = members
        self.view.omitted.clear()
        self.plan_due = True
        self.dormant = False
        self._stopped.clear()
        self._rounds_left = self._rounds

    def take_positions(self, messages: Mapping[Address, Message]) -> None:
        """Take over the places of all robots; a cell is covered once its robot has reported from it at rest."""
        setup, view, wall, stop, plans = self._setup, self.view, Verdict.WALL, Kind.STOP, (Kind.ROLL, Kind.MAP)
        for robot, message in messages.items():
            cell = setup.cell(message.x, message.y)
            if cell is None or cell not in setup.cells:
                continue  # no robot can be there: a peer's fault, not ours
            if robot != view.me:  # I know better: I may have turned back since
                view.cells[robot] = cell
            if message.kind == stop:
                self._stopped.add(robot)
            elif message.kind in plans:
                self.plan_due = True
            if wall in message.verdicts:
                self._go_around(robot, cell, message)
            if not message.busy:
                if cell in view.obstacles:
                    view.obstacles -= {cell}  # what stood there is the robot that is heard now
                if cell not in view.covered:
                    self.own_cells += robot == view.me
                    view.covered.add(cell)

    def _go_around(self, robot: Address, cell: Cell, message: Message) -> None:
        """Mark cells as obstacles that a robot could not enter, though there is no wall on the plan."""
        for beyond, verdict in zip(self._setup.steps[cell], message.verdicts, strict=True):
            if beyond >= 0 and verdict == Verdict.WALL:
                self.plan_due = self.plan_due or beyond not in self.view.obstacles
                self.view.obstacles |= {beyond}
                if robot == self.view.me:
                    self.obstructed = None

    def plan(self) -> None:
        """Divide the work if the team is new since the last plan; to be called when all robots stand still."""
        if self.plan_due:
            self.plan_due = False
            self._algorithm.enlist(self.view)

    def targets(self, messages: Mapping[Address, Message]) -> dict[Address, Cell]:
        """Return the next cell of each member."""
        return {robot: self.view.target(robot, message.action) for robot, message in messages.items()}

    def commit(self, messages: Mapping[Address, Message]) -> Cell:
        """Apply the agreed step to the picture of the team; return this robot's next cell."""
        for robot, target in self.targets(messages).items():
            if target >= 0:  # or else a peer has accepted its own way into a wall
                self.view.cells[robot] = target
        self.view.omitted.clear()
        mine = self.view.cells[self.view.me]
        self._algorithm.committed(self.evaluation.action, mine)
        return mine

    def directed(self, message: Message) -> None:
        """Process an answer that names a cell."""
        cell = self._setup.cell(*message.target)
        if message.reply == Reply.DIRECT and cell in self._setup.cells and cell is not None:
            self._algorithm.directed(cell)

    def direction_for(self, asker: Address, messages: Mapping[Address, Message]) -> Cell | None:
        """Return the cell to direct *asker* to, if this robot is to answer and knows an uncovered cell; else None."""
        asked = messages.keys() - self.departing() | {asker}
        if helper(asker, {robot: messages[robot] for robot in asked}) != self.view.me:
            return None
        return self.view.nearest_uncovered(self.view.cells[asker])
