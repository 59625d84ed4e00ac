"""The console at the host: it answers an operator's requests and reports what happens, over the host's cable.

"After each task completes (or if it fails), the executive sends a status message back to the planner and GUI. It also
monitors, and periodically transmits, the position and status of each robot" (paper 004, section 5); and the page can
ask for the map, for routes and for pictures. Every message is a JSON object; answers carry the request's number,
reports carry none. Nothing is sent before the first request, so runs without an operator stay the same.

A call that lacks parameters is answered with ``say: error``, why in words, and ``missing``, their names. The
``expected_s`` of a plan is null if it is not known; its ``windows`` still give lower bounds. Positions are rows: robot,
x, y, heading, task, whether it moves (null: it is taken for lost), s since it was heard, its goal.
"""

import json
import math
from collections.abc import Callable
from typing import Annotated, Any, Final, Literal, TypeAlias

from pydantic import Field, TypeAdapter, ValidationError

from cosim.errors import CosimError, WireError
from cosim.machine import OPERATOR, Address, Event
from cosim.settings import Count, Int64, Settings
from cosim.units import S, Time, to_seconds
from protocols.deployment.member.member import Member
from protocols.deployment.messages.messages import Look, Picture
from protocols.deployment.operator.planning import Planning
from protocols.deployment.planning.binding import MissingParametersError
from protocols.deployment.planning.planner import Call
from protocols.deployment.setup import Setup
from protocols.deployment.tasks import events
from protocols.deployment.tasks.facts import Switched, Terminated
from protocols.deployment.tasks.orders import Result
from protocols.deployment.tasks.plan import Place, Plan, Strategy
from protocols.deployment.team.host import Host
from protocols.wire import BadBytes

# ---------------------------------------------------------------- messages
# Requests to the host's console and its answers, as JSON, one object a message.
#
# Requests: plays, call (and execute it, or not, to tailor it), execute, switch, terminate, map, route, picture, state.


MOST_BYTES: Final = 1 << 18
"""Greatest size of a request in bytes."""


class Request(Settings):
    """A request of the operator."""

    request: Int64 = Field(description="number that the answer repeats")


class Plays(Request):
    """Ask for the tree of plays."""

    say: Literal["plays"]


class Calling(Request):
    """Call a play: make a plan of it, and execute that if wanted."""

    say: Literal["call"]
    call: Call
    execute: bool = Field(default=False, description="true to execute the plan at once, false to tailor it first")


class Execute(Request):
    """Execute a plan that was made."""

    say: Literal["execute"]
    plan: Count = Field(ge=0)


class Switch(Request):
    """Switch the rest of the play to another strategy."""

    say: Literal["switch"]
    strategy: Strategy


class Terminate(Request):
    """Terminate a task and all below it."""

    say: Literal["terminate"]
    task: str = Field(default="", description="its name; empty: the whole plan")


class Map(Request):
    """Ask for the floor: walls, extent, base, named places, and the team."""

    say: Literal["map"]


class Route(Request):
    """Ask for the way of a robot to a place."""

    say: Literal["route"]
    robot: Annotated[Count, Field(ge=0)]
    to: Place = Field(description="m")


class Show(Request):
    """Ask for a picture of a robot's camera."""

    say: Literal["picture"]
    robot: Annotated[Count, Field(ge=0)]


class State(Request):
    """Ask for the plan that is being played, and the states of its tasks."""

    say: Literal["state"]


Asked: TypeAlias = Annotated[
    Plays | Calling | Execute | Switch | Terminate | Map | Route | Show | State, Field(discriminator="say")
]
_REQUESTS: Final[TypeAdapter[Asked]] = TypeAdapter(Asked)


def read(data: bytes) -> Asked:
    """Return the request that *data* holds; raise WireError that says in one line what is wrong."""
    if len(data) > MOST_BYTES:
        raise WireError(f"{len(data)} bytes, more than {MOST_BYTES}")
    try:
        return _REQUESTS.validate_json(data)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        place = ".".join(str(part) for part in first["loc"])
        raise WireError(f"{place}: {first['msg']}" if place else first["msg"]) from error


def number_of(data: bytes) -> int | None:
    """Return the number of a request that is otherwise wrong; None if it has none."""
    try:
        found = json.loads(data)
    except (ValueError, RecursionError):
        return None
    number = found.get("request") if isinstance(found, dict) else None
    return number if isinstance(number, int) and not isinstance(number, bool) else None


def write(**what: Any) -> bytes:
    """Return a message to the operator."""
    return json.dumps(what, allow_nan=False, separators=(",", ":")).encode()


POSITIONS: Final = S // 2
"""Interval between reports of positions."""
PATIENCE: Final = 10 * S
"""Time after which a picture that has not come is given up."""
KEPT: Final = 32
"""Number of plans that are kept for execution."""


class Console:
    """The console of one robot; only the host's makes and executes plans."""

    def __init__(
        self,
        planning: Planning,
        setup: Setup,
        host: Host,
        member: Member,
        heard: Callable[[Address], Time],
        silent: Callable[[Address, Time], bool],
        note: Callable[[Event], None],
    ) -> None:
        self.attended = False
        """True if an operator has ever sent anything."""
        self._planning = planning
        self._setup = setup
        self._host = host
        self._member = member
        self._heard, self._silent = heard, silent
        self._note = note
        self._out: list[bytes] = []
        self._plans: dict[int, Plan] = {}
        self._number = 0
        """Greatest number of a plan that was made here."""
        self._states: dict[str, str] = {}
        self._pictures: dict[int, tuple[int, Address, Time]] = {}
        """Number in the message -> the operator's request, the robot, and the time of the request."""
        self._looks = 0
        self._told: Time | None = None

    def drain(self) -> list[bytes]:
        """Drain the messages to the operator."""
        out, self._out = self._out, []
        return out

    # ------------------------------------------------------------ requests

    def request(self, data: bytes, now: Time) -> None:
        """Take a request of the operator, and answer it; if it is invalid, with what is wrong."""
        if not self.attended:
            self.attended = True
            # nobody asked for what has ended before
            self._host.breaches.clear()
            self._host.ends.clear()
        try:
            asked = read(data)
        except WireError as error:
            self._note(BadBytes(OPERATOR, len(data)))
            self._out.append(write(answer=number_of(data), say="error", why=str(error)))
            return
        try:
            answer = self._answer(asked, now)
        except MissingParametersError as error:
            answer = {"say": "error", "why": str(error), "missing": list(error.names)}
        except CosimError as error:
            answer = {"say": "error", "why": str(error)}
        if answer is not None:
            self._out.append(write(answer=asked.request, **answer))

    def _answer(self, asked: Asked, now: Time) -> dict[str, Any] | None:
        match asked:
            case Plays():
                return {"say": "plays", "tree": self._setup.playbook.tree()}
            case Map():
                return self._map()
            case Route(robot=robot, to=to):
                return self._route(robot, to)
            case Show(robot=robot, request=request):
                return self._show(robot, request, now)
            case State():
                return self._state()
            case _ if not self._host.leads:
                host = self._host.leader
                return {"say": "error", "why": f"robot {host} is host, not robot {self._host.me}", "host": host}
            case Calling():
                return self._call(asked, now)
            case Execute(plan=number):
                if number not in self._plans:
                    return {"say": "error", "why": f"plan: {number} is no plan that was made here"}
                return self._execute(self._plans[number], now)
            case Switch(strategy=strategy) if self._host.play is not None and self._host.play.runs:
                self._host.say(Switched(strategy=strategy, at=now), now)
                return {"say": "done"}
            case Terminate(task=task) if self._host.play is not None and self._host.play.runs:
                return self._terminate(task, now)
        return {"say": "error", "why": "nothing is being played"}

    def _call(self, asked: Calling, now: Time) -> dict[str, Any]:
        self._number = max(self._number, self._host.newest) + 1
        plan = self._planning.plan(asked.call, self._number, now)
        if not isinstance(plan, Plan):
            self._note(events.PlanRefused(asked.call.play, "; ".join(plan.conflicts), "; ".join(plan.mend)))
            calls = {text: call.model_dump(mode="json", exclude_none=True) for text, call in plan.calls.items()}
            return {"say": "refusal", "conflicts": list(plan.conflicts), "mend": list(plan.mend), "calls": calls}
        self._plans[plan.number] = plan
        while len(self._plans) > KEPT:
            del self._plans[min(self._plans)]
        answer = self._shown(plan, now)
        if asked.execute:
            self._execute(plan, now)
        return answer | {"executed": asked.execute}

    def _shown(self, plan: Plan, now: Time) -> dict[str, Any]:
        return {
            "say": "plan",
            "plan": plan.model_dump(mode="json"),
            "expected_s": _number(self._planning.expected_s(plan, now)),
            "windows": self._planning.windows_s(plan, now),
        }

    def _execute(self, plan: Plan, now: Time) -> dict[str, Any]:
        # another plan has begun since this one was made; only a higher number replaces it
        if plan.number <= self._host.newest:
            self._number = max(self._number, self._host.newest) + 1
            plan = plan.model_copy(update={"number": self._number})
        self._states = {}
        self._host.execute(plan, self._planning.starts_m(now), self._host.calls, now)
        return {"say": "executing", "plan": plan.number}

    def _terminate(self, task: str, now: Time) -> dict[str, Any]:
        play = self._host.play
        assert play is not None
        assert play.executive is not None
        name = task or play.ledger.plan.root.name
        if name not in play.executive.states:
            return {"say": "error", "why": f"task: {name!r} is no task of what is being played"}
        self._host.say(Terminated(task=name, at=now), now)
        return {"say": "done"}

    # ------------------------------------------------------------ what is known

    def _map(self) -> dict[str, Any]:
        known = self._setup
        bodies = [
            {"robot": robot, "radius_m": body.radius_m, "speed_mps": body.speed_mps, "camera": body.camera}
            | {"sensor": body.sensor}
            for robot, body in enumerate(known.crew.bodies)
        ]
        return {
            "say": "map",
            "walls": known.floor.walls.walls_m.tolist(),
            "bounds": list(known.floor.bounds_m),
            "base": list(known.crew.base_m),
            "places": {name: [list(place) for place in places] for name, places in known.named_m.items()},
            "robots": bodies,
        }

    def _route(self, robot: Address, to: tuple[float, float]) -> dict[str, Any]:
        if robot >= self._setup.size:
            return _stranger(robot)
        radius_m = self._setup.crew.bodies[robot].radius_m
        way = self._setup.floor.way(radius_m, self._place_m(robot), to)
        if way is None:
            return {"say": "route", "robot": robot, "way": None, "length_m": None}
        length_m = self._setup.floor.length_m(radius_m, self._place_m(robot), to)
        return {"say": "route", "robot": robot, "way": [list(place) for place in way], "length_m": length_m}

    def _place_m(self, robot: Address) -> tuple[float, float]:
        return self._member.here if robot == self._host.me else self._member.others.place_m(robot)

    def _state(self) -> dict[str, Any]:
        host, play = self._host, self._host.play
        if play is None:
            return {"say": "state", "plan": None, "host": host.leader, "tasks": {}}
        states = {} if play.executive is None else dict(play.executive.states)
        plan = play.ledger.plan.model_dump(mode="json")
        lost = sorted(play.ledger.lost)
        return {"say": "state", "plan": plan, "host": host.leader, "tasks": states, "lost": lost}

    # ------------------------------------------------------------ pictures

    def _show(self, robot: Address, request: int, now: Time) -> dict[str, Any] | None:
        if robot >= self._setup.size:
            return _stranger(robot)
        if not self._setup.crew.bodies[robot].camera:
            return {"say": "error", "why": f"robot {robot} has no camera"}
        self._looks += 1
        self._pictures[self._looks] = request, robot, now
        if robot == self._host.me:
            self._member.camera.ask(robot, self._looks)
        else:
            self._host.mail.post(robot, Look(request=self._looks), now)
        return None

    def picture(self, picture: Picture) -> None:
        """Take a picture that was asked for."""
        waiting = self._pictures.pop(picture.request, None)
        if waiting is None or waiting[1] != picture.robot:
            return
        shown = picture.model_dump(mode="json", exclude={"say", "request"})
        self._out.append(write(answer=waiting[0], say="picture", **shown))

    # ------------------------------------------------------------ reports

    def report(self, now: Time) -> None:
        """Report what has happened, and periodically where the robots are."""
        host = self._host
        self._report_tasks()
        self._out += [write(say="breach", plan=host.number, why=why) for why in host.breaches]
        self._out += [write(say="ended", plan=number, result=result) for number, result in host.ends]
        self._report_pictures(now)
        if self._told is None or not 0 <= now - self._told < POSITIONS:
            self._told = now
            self._report_positions(now)
        host.breaches.clear()
        host.ends.clear()

    def _report_pictures(self, now: Time) -> None:
        """Report pictures that have not come in time."""
        for number, (request, robot, since) in list(self._pictures.items()):
            if now - since > PATIENCE:
                del self._pictures[number]
                self._out.append(write(answer=request, say="error", why=f"robot {robot} does not answer"))

    def _report_tasks(self) -> None:
        """Report tasks that have begun, parents first, then those that have ended, parents last.

        Tasks that are in the tree no longer, since others have replaced them, come before all others.
        """
        play = self._host.play
        if play is None or play.executive is None or not self._host.leads:
            return
        reports = {report.task: report for report in play.ends()}
        states = dict(play.executive.states)
        gone = [
            (task, Result.TERMINATED.value if task not in reports else reports[task].result.value)
            for task in reversed(self._states)
            if self._states[task] == "running" and task not in states
        ]
        changed = [task for task, state in states.items() if self._states.get(task, "waiting") != state]
        begun = [(task, "running") for task in changed if states[task] == "running"]
        ended = [(task, states[task]) for task in reversed(changed) if states[task] != "running"]
        for task, state in [*gone, *begun, *ended]:
            report = reports.get(task)
            robot, why = (None, "") if report is None else (report.robot, report.why)
            self._out.append(write(say="task", plan=play.number, task=task, state=state, robot=robot, why=why))
        self._states = states

    def _report_positions(self, now: Time) -> None:
        own = self._member
        goal = own.goal_m
        rows: list[list[Any]] = [
            [own.me, *own.here, own.heading_rad, own.task, abs(own.speed_mps) > 0.0, 0.0, goal and list(goal)]
        ]
        for robot, (news, _) in sorted(own.others.news.items()):
            place = own.others.place_m(robot)
            heard_s = round(to_seconds(now - self._heard(robot)), 3)
            goal = news.goal_m
            moves = None if self._silent(robot, now) else news.moves
            row = [robot, *place, news.heading_rad, news.task, moves, heard_s, goal and list(goal)]
            rows.append(row)
        self._out.append(write(say="positions", at_s=to_seconds(now), robots=rows))


def _stranger(robot: Address) -> dict[str, Any]:
    return {"say": "error", "why": f"robot: {robot} is not of the team"}


def _number(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else value
