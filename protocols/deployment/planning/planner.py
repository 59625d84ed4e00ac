"""The planner: it makes a plan of a call of a play, or refuses it at once, with the reasons and possible mends.

After MACBeth (paper 004, section 4): hierarchical task nets with constraint reasoning. A play is cast with roles, roles
get robots at the least route cost among those that can play them, the tasks get durations from their routes, and the
temporal network of the whole decides. "If the user attempts to specify an infeasible plan, conflicts and
inconsistencies should be flagged as soon as possible". Every mend that is offered has been tried and gives a plan.
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Final, Literal, NamedTuple

import networkx as nx
from pydantic import Field, JsonValue

from cosim.errors import UserError
from cosim.machine import Address
from cosim.settings import Count, Settings
from cosim.units import to_seconds
from protocols.deployment.planning.augmenting import ExecutiveParameters
from protocols.deployment.planning.binding import Binding, Role, Site, near
from protocols.deployment.planning.casting import Casting, cast, of_robot, picked
from protocols.deployment.planning.mending import Change, Infeasible, Mend, in_a_circle, out_of_time, short_of_robots
from protocols.deployment.planning.methods import expanded, expanded_to
from protocols.deployment.planning.play import MOST_ROBOTS
from protocols.deployment.planning.playbook import Playbook
from protocols.deployment.planning.roles import Shortage, assigned
from protocols.deployment.planning.routes import (
    Routes,
    barred,
    by_departure,
    crowded,
    departures,
    errands,
    missing_ways,
    prices,
)
from protocols.deployment.planning.staging import Stager
from protocols.deployment.planning.timing import (
    LeastExploring,
    Span,
    TimingParameters,
    circle,
    driving,
    ending,
    expected_s,
    exploring,
    first_exploration,
    in_order,
    lasting,
    legs_of,
    precedence,
    standing,
    structure,
    timing_out,
    wanted_at_once,
)
from protocols.deployment.tasks.constraints import EndsWith, PlaceName, Tailored, between, limited, quantities_of
from protocols.deployment.tasks.crew import Body, Crew, Ways
from protocols.deployment.tasks.plan import (
    Between,
    Deployment,
    Explore,
    Go,
    Instant,
    Place,
    Plan,
    Strategy,
    Task,
    actors,
)
from protocols.deployment.tasks.stn import Network, Point, asked

# ---------------------------------------------------------------- tailoring
# Tailoring: what a call changes in a play before it is executed (paper 004, section 4).


def rewritten(task: Task, change: Callable[[Task], Task]) -> Task:
    """Return *task* with *change* applied to it and to all tasks below it, the lowest first."""
    if task.subtasks:
        task = task.model_copy(update={"subtasks": tuple(rewritten(each, change) for each in task.subtasks)})
    return change(task)


def deployed_by(root: Task, strategy: Strategy | None, augmented: bool | None) -> Task:
    """Return *root* with another strategy, and with or without augmentation, of all deployments; None: unchanged."""
    update: dict[str, object] = {} if strategy is None else {"strategy": strategy}
    update |= {} if augmented is None else {"augmented": augmented}

    def change(task: Task) -> Task:
        if update and isinstance(task.act, Deployment):
            return task.model_copy(update={"act": task.act.model_copy(update=update)})
        return task

    return rewritten(root, change)


def timed_out(root: Task, time_outs_s: Mapping[str, float]) -> Task:
    """Return *root* with other time-outs, by the tasks' names."""

    def change(task: Task) -> Task:
        return task.model_copy(update={"time_out_s": time_outs_s[task.name]}) if task.name in time_outs_s else task

    return rewritten(root, change) if time_outs_s else root


def revealed(root: Task, names: Collection[str]) -> Task:
    """Return *root* with the deployments expanded that have tasks of *names*; raise UserError for a name of no task."""

    def change(task: Task) -> Task:
        return expanded(task) if any(name.startswith(f"{task.name}/") for name in names) else task

    root = rewritten(root, change)
    known = {task.name for task in root.walk()}
    for name in names:
        if name and name not in known:
            raise UserError(f"there is no task {name!r} in {root.name}{near(name, known)}")
    return root


class Ending(NamedTuple):
    """The constraint of a call by which *task* is terminated when *of* ends."""

    task: str
    of: str

    @property
    def why(self) -> str:
        """The constraint in words, and who asked for it."""
        return f"{CALLER}: {self.task} ends with {self.of}"


def ended(root: Task, endings: Sequence[Ending]) -> Task:
    """Return *root* with tasks that end with others; raise UserError where that means nothing."""
    enders: dict[str, str] = {}
    for task, of in endings:
        if f"{task}/".startswith(f"{of}/") or f"{of}/".startswith(f"{task}/"):
            raise UserError(f"{task} cannot end with {of}: one is part of the other")
        if enders.setdefault(task, of) != of:
            raise UserError(f"{task} ends with {enders[task]}, and cannot end with {of} too")

    def change(task: Task) -> Task:
        if task.name not in enders:
            return task
        if task.ends_with not in (None, enders[task.name]):
            raise UserError(f"{task.name} ends with {task.ends_with}, and cannot end with {enders[task.name]} too")
        return task.model_copy(update={"ends_with": enders[task.name]})

    return rewritten(root, change) if enders else root


def led(root: Task, via_m: Mapping[str, tuple[Place, ...]]) -> Task:
    """Return *root* with waypoints of drives, by the tasks' names; raise UserError for a task that is no drive."""

    def change(task: Task) -> Task:
        if task.name not in via_m:
            return task
        if not isinstance(task.act, Go):
            raise UserError(f"via: {task.name} is no drive of one robot, expected the name of one")
        return task.model_copy(update={"act": task.act.model_copy(update={"via_m": via_m[task.name]})})

    return rewritten(root, change) if via_m else root


CALLER: Final = "the call"
"""Author of the constraints that a call adds."""
AND: Final = "; and "
"""Separator of changes that only mend a play together."""
MOST_TRIALS: Final = 24
"""Greatest number of changes that are tried to mend a play."""
MOST_CHANGES: Final = 3
"""Greatest number of changes that are tried together."""


class PlannerParameters(Settings):
    """Parameters of the planner."""

    cost: Literal["length", "time"] = Field(default="length", description="cost of routes, by which roles are assigned")
    expand: Literal["none", "all"] | Count = Field(
        default="none", description="deployments that the planner expands: down to a level below the play, or all"
    )
    timing: TimingParameters = TimingParameters()


class Call(Settings):
    """A call of a play; it is tailored if it says more than the play's path and its parameters."""

    play: str = Field(description="path in the tree of a play, a folder (the quickest in it), or a task of a play")
    parameters: dict[str, JsonValue] = Field(default_factory=dict, description="of the play")
    places: tuple[PlaceName, ...] | None = Field(default=None, description="short for the parameter places")
    robots: tuple[Count, ...] | None = Field(default=None, description="robots that may take part; None: all")
    roles: dict[str, Count] = Field(default_factory=dict, description="robot of a role; the planner chooses the others")
    constraints: tuple[Tailored, ...] = Field(
        default=(), max_length=MOST_ROBOTS, description="on tasks by their labels below the play"
    )
    via: dict[str, tuple[PlaceName, ...]] = Field(
        default_factory=dict, max_length=MOST_ROBOTS, description="waypoints of drives, by their labels"
    )
    strategy: Strategy | None = Field(default=None, description="of all deployments, instead of the play's own")
    augmented: bool | None = Field(default=None, description="of all deployments, instead of the play's own")
    expand: Literal["none", "all"] | Count | None = Field(default=None, description="instead of the planner's own")


class Refusal(Settings):
    """The refusal of a call that is infeasible."""

    play: str
    conflicts: tuple[str, ...] = Field(min_length=1, description="constraints that cannot all be met, in words")
    mend: tuple[str, ...] = Field(default=(), description="changes, in words; each of them alone gives a plan")
    calls: dict[str, Call] = Field(
        default_factory=dict, description="by a change: the call to make instead, if it can be"
    )


class Planner:
    """Plans for one team on one floor."""

    def __init__(
        self,
        playbook: Playbook,
        crew: Crew,
        ways: Ways,
        parameters: PlannerParameters | None = None,
        places_m: Mapping[str, Sequence[Place]] | None = None,
        homes_m: Mapping[Address, Place] | None = None,
        executing: ExecutiveParameters | None = None,
        exploring: LeastExploring | None = None,
    ) -> None:
        """Take what does not change from call to call.

        *places_m*: places that the floor names; *homes_m*: place of each robot at base (default: the base's place);
        *executing*: the executive's augmentations, for a stage that is called alone; *exploring*: the least time of
        exploring, if it is known.
        """
        self.playbook, self.crew, self.ways = playbook, crew, ways
        self.parameters = parameters or PlannerParameters()
        self._places_m = {name: tuple(places) for name, places in (places_m or {}).items()}
        self._homes_m = dict(homes_m or {})
        self.executing = executing or ExecutiveParameters()
        self._exploring = exploring

    def call(
        self,
        call: Call,
        starts_m: Mapping[Address, Place],
        number: int = 0,
        unheard_s: Mapping[Address, float] = MappingProxyType({}),
    ) -> Plan | Refusal:
        """Return the plan of a *call*, with that *number*, or its refusal.

        *starts_m*: places of the robots that can take part; *unheard_s*: time since the others were heard last. Raise
        UserError for a call that is wrong.
        """
        path, inner = self.playbook.find(call.play)
        found, refusals, errors = list[Plan](), list[Refusal](), list[UserError]()
        for play in self.playbook.below(path):
            try:
                outcome = _Calling(self, call, play, inner, starts_m, number, unheard_s).outcome()
            except UserError as error:
                errors.append(error)
                continue
            if isinstance(outcome, Plan):
                found.append(outcome)
            else:
                refusals.append(outcome)
        if len(found) > 1:
            # plays that explore have no expected end: among them the least time decides
            return min(found, key=lambda plan: (self.expected_s(plan, starts_m), self._least_s(plan, starts_m)))
        if found or refusals:
            return found[0] if found else refusals[0]
        raise errors[0]

    def expected_s(self, plan: Plan, starts_m: Mapping[Address, Place]) -> float:
        """Return the expected end of a plan, s after its begin; infinite if it is not known."""
        root = expanded_to(plan.root)
        return expected_s(root, self._spans_of(root, plan.constraints, starts_m), plan.constraints)

    def _least_s(self, plan: Plan, starts_m: Mapping[Address, Place]) -> float:
        earliest_s, _ = self.windows_s(plan, starts_m)[Instant(task=plan.root.name, edge="end")]
        return earliest_s or 0.0

    def windows_s(
        self, plan: Plan, starts_m: Mapping[Address, Place]
    ) -> dict[Instant, tuple[float | None, float | None]]:
        """Return the earliest and latest times of all starts and ends of a plan, s after its begin; None: no limit."""
        root = expanded_to(plan.root)
        network = network_of(root, self._spans_of(root, plan.constraints, starts_m), plan.constraints)
        if not network.consistent:
            raise UserError(f"the plan of {plan.play} has no schedule from these places")
        return {
            Instant(task=task, edge="end" if edge == "end" else "start"): (
                None if earliest is None else to_seconds(earliest),
                None if latest is None else to_seconds(latest),
            )
            for (task, edge), (earliest, latest) in network.windows().items()
        }

    def _spans_of(
        self, root: Task, constraints: Sequence[Between], starts_m: Mapping[Address, Place]
    ) -> dict[str, Span]:
        graph = precedence(root, constraints)
        return self.spans(in_order(root, graph), graph, starts_m, self.crew.bodies, Routes(self.ways))

    def spans(
        self,
        leaves: Sequence[Task],
        graph: "nx.DiGraph[Point]",
        starts_m: Mapping[Address, Place],
        bodies: Sequence[Body],
        routes: Routes,
    ) -> dict[str, Span]:
        """Return the durations of *leaves*, in the order of their starts, as far as they are known."""
        legs, explored_s = legs_of(leaves, starts_m), self._explored_s(leaves, graph, starts_m, bodies)
        spans: dict[str, Span] = {}
        for leaf in leaves:
            span = standing(leaf, bodies, self.parameters.timing)
            if isinstance(leaf.act, Explore):
                span = exploring(leaf, explored_s.get(leaf.name, 0.0))
            if leaf.name in legs:
                leg = legs[leaf.name]
                length_m = routes.leg_m(leg.places_m, bodies[leg.robot].radius_m)
                if not isinstance(length_m, str):
                    span = driving(leg, length_m, bodies[leg.robot], self.parameters.timing)
            if span is not None:
                spans[leaf.name] = span
        return spans

    def _explored_s(
        self,
        leaves: Sequence[Task],
        graph: "nx.DiGraph[Point]",
        starts_m: Mapping[Address, Place],
        bodies: Sequence[Body],
    ) -> dict[str, float]:
        """Return the least durations of explorations, as far as they are known."""
        if self._exploring is None or len(starts_m) < len(bodies):
            return {}  # robots that are lost may have seen more than the others know, and may come back
        first = first_exploration(leaves, graph, starts_m)
        if first is None:
            return {}
        leaf, places_m = first
        return {leaf.name: self._exploring({robot: bodies[robot] for robot in actors(leaf.act)}, places_m)}

    def site(self, routes: Routes, change: Change) -> Site:
        """Return the site of a play after a *change*."""
        radius_m = max((body.radius_m for body in self.crew.bodies), default=0.0)
        apart_m = math.inf if change.apart_m is None else change.apart_m
        return Site(routes, self.crew.base_m, self._places_m, radius_m, dict(change.moved_m), apart_m)

    def home_m(self, robot: Address) -> Place:
        """Return the place of a robot at base."""
        return self._homes_m.get(robot, self.crew.base_m)


def network_of(root: Task, spans: Mapping[str, Span], constraints: Sequence[Between]) -> Network:
    """Return the temporal network of a whole plan: its shape, its durations, then its constraints and time-outs."""
    network = Network(structure(root))
    network.extend(lasting(root, spans))
    network.extend(ending(root))
    network.extend(asked(each) for each in constraints)
    network.extend(bound for bound, _ in timing_out(root))
    return network


class _Calling:
    """One call of one play."""

    def __init__(
        self,
        planner: Planner,
        call: Call,
        path: str,
        inner: tuple[str, ...],
        starts_m: Mapping[Address, Place],
        number: int,
        unheard_s: Mapping[Address, float],
    ) -> None:
        self.unheard_s = unheard_s
        self.planner, self.call, self.path, self.inner, self.number = planner, call, path, inner, number
        self.starts_m = {robot: place for robot, place in starts_m.items() if robot in planner.crew.robots}
        self.routes = Routes(planner.ways)
        self.trials = 0
        self.cast: Mapping[str, Role] = {}
        """The roles as the play has them, with robots that its parameters name."""
        self.asked: Sequence[str] = ()
        """What the constraints of the call are called."""

    def outcome(self) -> Plan | Refusal:
        """Return the plan, or a refusal with the reasons and mends."""
        found = self._attempt(Change())
        if isinstance(found, Plan):
            return found
        mends = self._mends(found, Change(), MOST_CHANGES)
        different = {frozenset(mend.text.split(AND)): mend for mend in reversed(mends)}
        offered = tuple(reversed(different.values()))
        calls = {mend.text: self._amended(mend.change) for mend in offered}
        return Refusal(
            play=self.call.play,
            conflicts=found.conflicts,
            mend=tuple(mend.text for mend in offered),
            calls={text: call for text, call in calls.items() if call is not None},
        )

    def _amended(self, change: Change) -> Call | None:
        """Return the call that says what *change* does; None if it is about the team, the floor, or the play itself."""
        spans_s = {why: (least_s, most_s) for why, least_s, most_s in change.spans_s}
        others = change.bodies or change.moved_m or change.before or change.apart_m is not None
        if others or not {*spans_s, *change.dropped} <= {*self.asked}:
            return None
        if change.uncast and any(role.fixed is not None for role in self.cast.values()):
            return None
        changed: dict[str, Any] = {"robots": None} if change.everyone else {}
        if spans_s or change.dropped:
            changed["constraints"] = tuple(
                limited(each, *spans_s[why]) if why in spans_s and not isinstance(each, EndsWith) else each
                for why, each in zip(self.asked, self.call.constraints, strict=True)
                if why not in change.dropped
            )
        changed |= {"roles": {}} if change.uncast else {}
        return self.call.model_copy(update=changed)

    def _mends(self, infeasible: Infeasible, before: Change, most: int) -> list[Mend]:
        """Return the changes that give a plan: single ones, or else combinations."""
        tried, further = list[Mend](), list[tuple[Mend, Change, Infeasible]]()
        for mend in infeasible.mends:
            if self.trials == MOST_TRIALS:
                break
            self.trials += 1
            change = before.with_(mend.change)
            found = self._attempt(change)
            if isinstance(found, Plan):
                tried.append(Mend(mend.text, change))
            else:
                further.append((mend, change, found))
        for mend, change, found in further if most > 1 and not tried else ():
            more = self._mends(found, change, most - 1)
            tried += [Mend(f"{mend.text}{AND}{other.text}", other.change) for other in more]
        return tried

    # ------------------------------------------------------------ one attempt

    def _attempt(self, change: Change) -> Plan | Infeasible:
        """Return the plan of the call after a *change*, or why there is none."""
        call, planner = self.call, self.planner
        crew = planner.crew._replace(bodies=planner.crew.bodies + change.bodies)
        starts_m = self.starts_m | dict.fromkeys(crew.robots[len(planner.crew.bodies) :], crew.base_m)
        given = dict(call.parameters) | ({} if call.places is None else {"places": list(call.places)})
        site = planner.site(self.routes, change)
        casting = cast(planner.playbook, self.path, self.inner, given, site)
        if casting.faults:
            texts = tuple(text for text, _ in casting.faults)
            return Infeasible(texts, _closer([apart_m for _, apart_m in casting.faults]))
        robots = self._robots(casting, crew, starts_m, change)
        if isinstance(robots, Infeasible):
            return robots
        homes_m = {robot: planner.home_m(robot) for robot in crew.robots}
        casting = cast(planner.playbook, self.path, self.inner, given, site, robots, homes_m)
        root, constraints = self._tailored(casting, change, crew)
        infeasible = self._hindered(root, constraints, crew, starts_m)
        if infeasible is not None:
            return infeasible
        used = sorted({robot for task in root.walk() for robot in actors(task.act)})
        play = "/".join((self.path, *self.inner))
        return Plan(number=self.number, play=play, robots=tuple(used), root=root, constraints=tuple(constraints))

    def _robots(
        self, casting: Casting, crew: Crew, starts_m: Mapping[Address, Place], change: Change
    ) -> dict[str, Address] | Infeasible:
        """Return the robot of each role, or why there is none."""
        bodies = {robot: crew.bodies[robot] for robot in sorted(starts_m) if self._invites(robot, change)}
        roles = self._roles(casting, change)
        template = min(crew.bodies, key=lambda body: body.radius_m, default=Body())
        left_out = [robot for robot in sorted(starts_m) if robot not in bodies]
        unheard_s = {robot: lost_s for robot, lost_s in self.unheard_s.items() if self._invites(robot, change)}
        cost = self.planner.parameters.cost
        able = assigned(list(roles.values()), list(bodies), prices(roles, {}, bodies, starts_m, self.routes, cost))
        if isinstance(able, Shortage):  # reported before any time is spent on routes
            return short_of_robots(able, roles, template, left_out, unheard_s)
        root = expanded_to(deployed_by(casting.root, self.call.strategy, self.call.augmented))
        if not casting.unused:  # the robots after which drives are named are not known yet
            root = led(root, {name: at for name, at in self._via_m(root, casting).items() if not of_robot(name)})
        leaves = in_order(root, precedence(root, casting.between))
        by_number = errands(leaves)
        places_m = {casting.numbers[robot]: places for robot, places in by_number.items()}
        infeasible = self._barred(places_m, crew, starts_m)
        if infeasible is not None:
            return infeasible
        costs = prices(roles, places_m, bodies, starts_m, self.routes, cost)
        ranks = departures(leaves, crew.base_m, min(body.radius_m for body in crew.bodies), self.routes)
        by_role = {casting.numbers[robot]: rank for robot, rank in ranks.items()}
        firsts_m = {name: places[0] for name, places in places_m.items()}
        costs = by_departure(costs, by_role, firsts_m, starts_m, bodies, self.routes)
        found = assigned(list(roles.values()), list(bodies), costs)
        if isinstance(found, Shortage):
            return short_of_robots(found, roles, template, left_out, unheard_s)
        return found

    def _invites(self, robot: Address, change: Change) -> bool:
        """Return whether the call lets a robot take part."""
        invited = self.call.robots
        return invited is None or change.everyone or robot in invited or robot >= len(self.planner.crew.bodies)

    def _roles(self, casting: Casting, change: Change) -> dict[str, Role]:
        roles = self.cast = casting.roles
        for name, robot in self.call.roles.items():
            if name not in roles:
                raise UserError(f"roles: there is no role {name!r}{near(name, roles)}")
            roles = roles | {name: replace(roles[name], fixed=robot)}
        for role in roles.values():
            if role.fixed is not None and role.fixed not in self.planner.crew.robots:
                size = len(self.planner.crew.bodies)
                raise UserError(f"roles: {role.name} is to be robot {role.fixed}, expected one of 0 to {size - 1}")
        return {name: replace(role, fixed=None) for name, role in roles.items()} if change.uncast else roles

    def _barred(
        self, places_m: Mapping[str, Sequence[Place]], crew: Crew, starts_m: Mapping[Address, Place]
    ) -> Infeasible | None:
        """Return the conflict of places that no robot of the team can get to; None if there are none."""
        bodies = [crew.bodies[robot] for robot in sorted(starts_m)]
        places = [place for each in places_m.values() for place in each]
        if not bodies:
            return None
        found = list(barred(places, list(dict.fromkeys(bodies)), crew.base_m, list(starts_m.values()), self.routes))
        if not found:
            return None
        texts = tuple(f"no robot can get to ({place[0]:g}, {place[1]:g})" for place, _ in found)
        moved = [(place, instead) for place, instead in found if instead is not None]
        if len(moved) < len(found):
            return Infeasible(texts)
        words = [f"({to[0]:g}, {to[1]:g}) instead of ({place[0]:g}, {place[1]:g})" for place, to in moved]
        return Infeasible(texts, (Mend(" and ".join(words), Change(moved_m=tuple(moved))),))

    # ------------------------------------------------------------ tailoring

    def _tailored(self, casting: Casting, change: Change, crew: Crew) -> tuple[Task, list[Between]]:
        """Return the tasks as tailored by the call, and all constraints on them."""
        call, binding = self.call, casting.binding
        assert binding is not None
        root = deployed_by(casting.root, call.strategy, call.augmented)
        if casting.unused:
            root = self._picked(expanded(root), casting.unused, crew)
        below = {task.name for task in root.walk()}
        constraints = [each for each in casting.between if not casting.unused or _tasks_of(each) <= below]
        asked = [_asked(each, root.name, binding) for each in call.constraints]
        self.asked = [each.why for each in asked]
        constraints += [each for each in asked if isinstance(each, Between)]
        endings = [each for each in asked if isinstance(each, Ending) and each.why not in change.dropped]
        constraints += [_before(first, then) for first, then in change.before]
        spans_s = {why: (least_s, most_s) for why, least_s, most_s in change.spans_s}
        constraints = [_respanned(each, spans_s) for each in constraints if each.why not in change.dropped]
        via_m = self._via_m(root, casting)
        expand = self.planner.parameters.expand if call.expand is None else call.expand
        root = expanded_to(root, {"none": -1, "all": None}[expand] if isinstance(expand, str) else expand)
        named = [name for each in constraints for name in sorted(_tasks_of(each))]
        named += [name for each in endings for name in each]
        root = ended(led(revealed(root, [*via_m, *named]), via_m), endings)
        return timed_out(root, {name: most for name, (_, most) in spans_s.items() if most is not None}), constraints

    def _via_m(self, root: Task, casting: Casting) -> dict[str, tuple[Place, ...]]:
        """Return the waypoints of the call, by the names of drives below *root*."""
        assert casting.binding is not None
        via = {f"{root.name}/{name}" if name else root.name: at for name, at in self.call.via.items()}
        return {name: casting.binding.places_of(at) for name, at in via.items()}

    def _picked(self, whole: Task, labels: Sequence[str], crew: Crew) -> Task:
        """Return the task to which *labels* lead; augment a stage of a deployment as if it were not called alone."""
        root = picked(whole, labels)
        goes = [task.act for task in root.subtasks if isinstance(task.act, Go)]
        if not isinstance(whole.act, Deployment) or not goes:
            return root
        stager = Stager(
            whole.act.places_m, whole.act.strategy, whole.act.augmented, crew, self.routes, self.planner.executing
        )
        staged = zip(root.subtasks, stager.staged(goes), strict=True)
        return root.model_copy(update={"subtasks": tuple(task.model_copy(update={"act": go}) for task, go in staged)})

    # ------------------------------------------------------------ checking

    def _hindered(
        self, root: Task, constraints: Sequence[Between], crew: Crew, starts_m: Mapping[Address, Place]
    ) -> Infeasible | None:
        """Return why a plan cannot be carried out; None if it can."""
        whole = expanded_to(root)
        graph = precedence(whole, constraints)
        leaves = in_order(whole, graph)
        spans = self.planner.spans(leaves, graph, starts_m, crew.bodies, self.routes)
        network = network_of(whole, spans, constraints)
        if not network.consistent:
            return out_of_time(network, [(asked(each), each) for each in constraints], list(timing_out(whole)))
        round_ = circle(whole, graph, constraints)
        if round_:
            return in_a_circle(round_)
        vain = self._in_vain(whole, graph)
        if vain is not None:
            return vain
        clashes = wanted_at_once(leaves, graph, lambda task: actors(task.act))
        if clashes:
            texts = tuple(f"robot {robot} is wanted by {a} and by {b} at once" for robot, a, b in clashes)
            orders = [(Change(before=((a, b),)), f"{b} after {a}") for _, a, b in clashes[:2]]
            orders += [(Change(before=((b, a),)), f"{a} after {b}") for _, a, b in clashes[:2]]
            return Infeasible(texts, tuple(Mend(text, change) for change, text in orders))
        legs = list(legs_of(leaves, starts_m).values())
        no_way = tuple(missing_ways(legs, crew.bodies, self.routes))
        overlaps = tuple(crowded(leaves, crew.bodies))
        return Infeasible(no_way + overlaps) if no_way or overlaps else None

    def _in_vain(self, whole: Task, graph: "nx.DiGraph[Point]") -> Infeasible | None:
        """Return the conflict of tasks that the call has end with what ends before they start; None without any."""
        endings = [Ending(task.name, task.ends_with) for task in whole.walk() if task.ends_with is not None]
        vain = [
            each
            for each in endings
            if each.why in self.asked and nx.has_path(graph, (each.of, "end"), (each.task, "start"))
        ]
        if not vain:
            return None
        texts = tuple(f"{each.why}, which ends before {each.task} starts" for each in vain)
        return Infeasible(texts, tuple(Mend(f"without: {each.why}", Change(dropped=(each.why,))) for each in vain))


def _closer(distances_m: Sequence[float | None]) -> tuple[Mend, ...]:
    """Return the mend that robots gather closer to each other; none where there is no way at all."""
    known_m = [each for each in distances_m if each is not None]
    if len(known_m) < len(distances_m):
        return ()
    return (Mend(f"robots gather at most {min(known_m):g} m apart", Change(apart_m=min(known_m))),)


def _tasks_of(constraint: Between) -> set[str]:
    return {constraint.earlier.task, constraint.later.task} - {""}


def _asked(constraint: Tailored, prefix: str, binding: Binding) -> Between | Ending:
    """Return a constraint of the call, on the tasks below *prefix*."""
    if isinstance(constraint, EndsWith):
        return Ending(*(f"{prefix}/{task}" if task else prefix for task in (constraint.task, constraint.of)))
    numbers = {key: binding.number_of(value) for key, value in quantities_of(constraint).items()}
    return between(constraint, prefix, numbers, CALLER)


def _before(first: str, then: str) -> Between:
    earlier, later = Instant(task=first, edge="end"), Instant(task=then)
    return Between(earlier=earlier, later=later, why=f"{CALLER}: {then} after {first}")


def _respanned(constraint: Between, spans_s: Mapping[str, tuple[float, float | None]]) -> Between:
    if constraint.why not in spans_s:
        return constraint
    least_s, most_s = spans_s[constraint.why]
    return constraint.model_copy(update={"at_least_s": least_s, "at_most_s": most_s})
