"""The coordination room: where the team is, what each robot means to do, and who gives way (paper 003, section VI).

The rules of conflict. Two robots that mean to enter one cell each send *help* in the next exchange, claiming the cell
with the reasons why their other actions failed. The more constricted one (fewer possible actions) keeps its action,
then the one with the lower number; the others drop theirs, evaluate again and confirm with an *answer*. A robot whose
next cell is somebody's present one always gives way: a body stands there. When no conflict is left everyone answers
*accept*, and the step is made: that exchange is the one in which the state equals the previous state (Fig. 9a).

Where a robot stands that was never found, or was dropped, nobody knows: it may have made its last step or not. A robot
that cannot enter a cell turns back and reports that step as a wall; everybody hears it and goes around that cell. It
may have been a robot that only passed by: before the team takes what it cannot reach for unreachable, it tries again.
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
    """The outcome of comparing everybody's next cells."""

    claimants: frozenset[Address] = frozenset()
    """Those who want the same cell as somebody else and have not given their reasons yet."""
    losers: frozenset[Address] = frozenset()
    """Those who must choose another action."""

    def settled(self) -> bool:
        """Return whether nobody is in anybody's way."""
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
    """Return whether everybody has accepted: the team has agreed on a step."""
    return all(message.kind == Kind.ANSWER and message.reply == Reply.ACCEPT for message in messages)


def in_trouble(message: Message) -> bool:
    """Return whether the message asks for directions: a trap, or help from a robot that has nowhere to go."""
    return message.kind == Kind.TRAP or (message.kind == Kind.HELP and message.action == Action.STAY)


def helper(asker: Address, messages: Mapping[Address, Message]) -> Address | None:
    """Return who answers *asker*: the nearest member that is not in trouble itself, then the lowest number."""
    here = messages[asker]
    candidates = [
        (abs(message.x - here.x) + abs(message.y - here.y), robot)
        for robot, message in messages.items()
        if robot != asker and not in_trouble(message)
    ]
    return min(candidates)[1] if candidates else None


class Coordination:
    """One robot's picture of the team and its coverage algorithm."""

    def __init__(self, setup: Setup, me: Address, algorithm: Algorithm, stop_at: int | None, rounds: int = 0) -> None:
        self.view = View(setup, me)
        self.evaluation = Evaluation(Action.STAY, UNJUDGED)
        self.own_cells = 0
        self.dormant = False
        self.plan_due = False
        self.obstructed: Action | None = None
        """The step that I had to turn back from, until the team has heard of it."""
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
        """Scan the action space (Fig. 12): choose the next action, anew or after the present one was given up."""
        if self._stop_at is not None and self.own_cells >= self._stop_at:
            kind = Kind.STATE if self.dormant else Kind.STOP
            self.dormant = True
            self.evaluation = Evaluation(Action.STAY, UNJUDGED, kind)
        else:
            self.evaluation = self._algorithm.evaluate(self.view)
        return self.evaluation

    def negotiate(self, messages: Mapping[Address, Message]) -> Stance:
        """Return what I say to *messages* next; a loser omits its action from the list and evaluates again."""
        outcome = contest(messages, self.view.cells, self.targets(messages))
        if self.view.me in outcome.losers:
            self.view.omitted.add(self.evaluation.action)
            self.evaluate_actions()
            return Stance.YIELD
        if self.view.me in outcome.claimants:
            return Stance.CLAIM
        return Stance.ACCEPT if outcome.settled() else Stance.REPEAT

    def stuck(self, cell: Cell) -> None:
        """Take notice that I stand in *cell*, in its middle or not, and cannot go on to where I meant to go."""
        if cell in self._setup.cells:
            self.view.cells[self.view.me] = cell

    def turned_back(self) -> None:
        """Take notice that my last action cannot be carried out: I am on the way back."""
        self.obstructed = self.evaluation.action
        back = self._setup.steps[self.view.cells[self.view.me]][(self.obstructed + 2) % 4]
        self.view.cells[self.view.me] = back

    def obstruction(self) -> Verdicts:
        """Return the verdicts that tell the team of the step that I had to turn back from."""
        north, east, south, west = (Verdict.WALL if step == self.obstructed else Verdict.POSSIBLE for step in STEPS)
        return north, east, south, west

    def all_placed(self) -> bool:
        """Return whether it is known where everybody is."""
        return all(member in self.view.cells for member in self.view.members)

    def complete(self) -> bool:
        """Return whether nothing is left to do: all is covered, or everybody has covered its programmed ratio."""
        return self.view.complete() or self._all_stopped()

    def _all_stopped(self) -> bool:
        return self._stop_at is not None and self._stopped.issuperset(self.view.members)

    def try_again(self) -> bool:
        """Forget what stood in the way of cells that are left, and return True; not more often than *rounds* a team."""
        left = len(self._setup.cells) > len(self.view.covered)
        if not (self.view.obstacles and left and self._rounds_left) or self._all_stopped():
            return False
        self._rounds_left -= 1
        self.view.obstacles = frozenset()
        self.plan_due = True
        return True

    def team_changed(self, members: tuple[Address, ...]) -> None:
        """Take a new team; who is gone is believed nowhere, and what was meant or said in the old one is void."""
        for gone in set(self.view.cells) - set(members) - {self.view.me}:
            self.view.cells.pop(gone)
        self.view.members = members
        self.view.omitted.clear()
        self.plan_due = True
        self.dormant = False
        self._stopped.clear()
        self._rounds_left = self._rounds

    def take_positions(self, messages: Mapping[Address, Message]) -> None:
        """Take where everybody stands; a cell is covered once its robot has reported from it at rest."""
        for robot, message in messages.items():
            cell = self._setup.cell(message.x, message.y)
            if cell is None or cell not in self._setup.cells:
                continue  # nobody can be there: a peer's fault, not ours
            if robot != self.view.me:  # I know better: I may have turned back since
                self.view.cells[robot] = cell
            if message.kind == Kind.STOP:
                self._stopped.add(robot)
            self.plan_due = self.plan_due or message.kind in (Kind.ROLL, Kind.MAP)
            self._go_around(robot, cell, message)
            if not message.busy:
                self.view.obstacles -= {cell}  # whatever stood there, it is the robot that is heard now
                self.own_cells += robot == self.view.me and cell not in self.view.covered
                self.view.covered.add(cell)

    def _go_around(self, robot: Address, cell: Cell, message: Message) -> None:
        """Take the cells that a robot could not enter, though there is no wall on the plan, for obstacles."""
        for step, verdict in zip(STEPS, message.verdicts, strict=True):
            beyond = self._setup.steps[cell][step]
            if verdict == Verdict.WALL and beyond >= 0:
                self.plan_due = self.plan_due or beyond not in self.view.obstacles
                self.view.obstacles |= {beyond}
                if robot == self.view.me:
                    self.obstructed = None

    def plan(self) -> None:
        """Divide the work if the team is new since the last plan; to be called when everybody stands still."""
        if self.plan_due:
            self.plan_due = False
            self._algorithm.enlist(self.view)

    def targets(self, messages: Mapping[Address, Message]) -> dict[Address, Cell]:
        """Return the next cell of each member."""
        return {robot: self.view.target(robot, message.action) for robot, message in messages.items()}

    def commit(self, messages: Mapping[Address, Message]) -> Cell:
        """Carry the agreed step over into the picture of the team; return my own next cell."""
        for robot, target in self.targets(messages).items():
            if target >= 0:  # or else a peer has accepted its own way into a wall
                self.view.cells[robot] = target
        self.view.omitted.clear()
        mine = self.view.cells[self.view.me]
        self._algorithm.committed(self.evaluation.action, mine)
        return mine

    def directed(self, message: Message) -> None:
        """Take an answer that names a cell."""
        cell = self._setup.cell(*message.target)
        if message.reply == Reply.DIRECT and cell in self._setup.cells and cell is not None:
            self._algorithm.directed(cell)

    def direction_for(self, asker: Address, messages: Mapping[Address, Message]) -> Cell | None:
        """Return where to direct *asker*, if it is me who answers and if I know an uncovered cell."""
        if helper(asker, messages) != self.view.me:
            return None
        return self.view.nearest_uncovered(self.view.cells[asker])
