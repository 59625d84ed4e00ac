"""Random valid plays, as a user might write them in YAML, and calls of them that are feasible.

``random_calls()`` is the hypothesis strategy for all who take plans: planner, executive, whole runs. The plays need
nobody but :class:`tests.protocols.deployment.plays_scene.Scene`'s team; every robot ends up at a place of its own.
"""

from typing import Any, NamedTuple

import yaml
from hypothesis import strategies as st

from cosim.documents import parse_yaml, validated
from protocols.deployment.planning.play import Play
from protocols.deployment.planning.playbook import Playbook
from protocols.deployment.tasks.plan import Plan
from tests.protocols.deployment.plays_scene import Scene, built_in

SPACING_M = 4.0
GRID = [[SPACING_M * x, SPACING_M * y] for x in range(1, 6) for y in range(-2, 3)]
APART_M = 0.6
STRATEGIES = ("group", "wave", "leap_frog")


class RandomCall(NamedTuple):
    """A play in YAML, and what a call of it says."""

    text: str
    size: int
    parameters: dict[str, Any]

    def playbook(self) -> Playbook:
        """Return our plays and this one, which is called ``random``."""
        play = validated(Play, parse_yaml(self.text, "random.yaml"), "random.yaml")
        return Playbook(Play(plays=built_in().root.plays | {"random": play}), {"random": "random.yaml"})

    def scene(self) -> Scene:
        return Scene(playbook=self.playbook())

    def plan(self) -> tuple[Plan, Scene]:
        """Return the plan of the call, and the scene that it was made for."""
        scene = self.scene()
        return scene.plan("random", parameters=self.parameters), scene


@st.composite
def random_calls(draw: st.DrawFn, explore: bool = True) -> RandomCall:
    """Draw a play for one to four robots and a call of it; without tasks to explore, if so wished."""
    size = draw(st.integers(1, 4))
    robots = [f"r{number}" for number in range(size)]
    parameters: dict[str, Any] = {name: {"kind": "robot"} for name in robots}
    parameters |= {"p": {"kind": "place", "default": GRID[0]}, "all": {"kind": "places"}}
    parameters |= {"n": {"kind": "number", "default": 3.0, "least": 0}, "s": {"kind": "strategy", "default": "wave"}}
    net = draw(_nets(robots, depth=2, explore=explore))
    places = draw(st.permutations(GRID))
    last = {"kind": "deploy", "label": "last", "strategy": "s", "robots": robots, "places": ["all"]}
    if draw(st.booleans()):
        last = {"kind": "return", "label": "last", "robots": robots}
    play = {
        "about": "A random play.",
        "parameters": parameters,
        "tasks": [{"kind": "net", "label": "first"} | net, last],
    }
    if draw(st.booleans()):
        play["constraints"] = [{"kind": "deadline", "seconds": draw(st.integers(4000, 9000))}]
    given = {"all": places[:size]} | ({"n": draw(st.integers(0, 9))} if draw(st.booleans()) else {})
    given |= {"s": draw(st.sampled_from(STRATEGIES))} if draw(st.booleans()) else {}
    return RandomCall(yaml.safe_dump(play, sort_keys=False), size, given)


@st.composite
def _nets(draw: st.DrawFn, robots: list[str], depth: int, explore: bool) -> dict[str, Any]:
    """Draw a net for *robots*: those of tasks at once are different ones."""
    order = draw(st.sampled_from(["serial", "parallel"]))
    count = draw(st.integers(1, 3))
    if order == "parallel":
        owners = [draw(st.integers(0, count - 1)) for _ in robots]
        teams = [[name for name, owner in zip(robots, owners, strict=True) if owner == at] for at in range(count)]
    else:
        teams = [robots] * count
    tasks = [draw(_tasks(team, depth, explore)) | {"label": f"t{at}"} for at, team in enumerate(teams)]
    return {"order": order, "tasks": tasks} | draw(_constraints(order, count, tasks))


@st.composite
def _constraints(draw: st.DrawFn, order: str, count: int, tasks: list[dict[str, Any]]) -> dict[str, Any]:
    constraints: list[dict[str, Any]] = []
    if count > 1 and draw(st.booleans()):
        then = draw(st.integers(1, count - 1))
        first = draw(st.integers(0, then - 1))
        kind = draw(st.sampled_from(["before", "after", "ends"]))
        least = draw(st.sampled_from([0, 2.5, "n"]))
        if kind == "before":
            constraints.append({"kind": "before", "first": f"t{first}", "then": f"t{then}", "at_least_s": least})
        elif kind == "after":
            constraints.append(
                {"kind": "after", "task": f"t{then}", "of": f"t{first}", "of_edge": "start", "at_least_s": least}
                | ({"at_most_s": 3000} if draw(st.booleans()) else {})
            )
        elif order == "parallel":
            tasks[then]["ends_with"] = f"t{first}"
    if draw(st.booleans()):
        constraints.append({"kind": "within", "task": draw(st.sampled_from(["", "t0"])), "seconds": 3500})
    return {"constraints": constraints} if constraints else {}


@st.composite
def _tasks(draw: st.DrawFn, robots: list[str], depth: int, explore: bool) -> dict[str, Any]:
    kinds = ["wait"]
    if robots:
        kinds += ["go", "photo", "deploy", "gather", "return", "play"] + (["explore"] if explore else [])
    kinds += ["net"] if depth else []
    kind = draw(st.sampled_from(kinds))
    some = draw(st.lists(st.sampled_from(robots), min_size=1, unique=True)) if robots else []
    places = draw(st.permutations(GRID))[: max(len(some), 2)]
    task: dict[str, Any] = {"kind": kind}
    match kind:
        case "wait":
            task["seconds"] = draw(st.sampled_from([0, 1.5, "n"]))
        case "go":
            task |= {"robot": some[0], "to": draw(st.sampled_from([places[0], "p"]))}
            task |= {"via": [places[1]]} if draw(st.booleans()) else {}
        case "photo":
            task |= {"robot": some[0]}
        case "deploy":
            strategy = draw(st.sampled_from([*STRATEGIES, "s"]))
            task |= {"strategy": strategy, "robots": some, "places": places[: len(some)]}
            task |= {"ordered": draw(st.sampled_from(["nearest", "given"])), "augmented": draw(st.booleans())}
        case "gather":
            task |= {"robots": some, "at": places[0], "towards": places[1], "apart_m": APART_M}
        case "return" | "explore":
            task |= {"robots": some}
        case "play":
            play = draw(st.sampled_from(["group", "wave", "leap-frog"]))
            task |= {"play": f"deploy/{play}", "given": {"robots": some, "places": places[: len(some)]}}
        case "net":
            task |= draw(_nets(robots, depth - 1, explore))
    if draw(st.integers(0, 3)) == 0:
        task |= {"time_out_s": 3800, "on_failure": draw(st.sampled_from(["fail", "skip", "retry"]))}
    return task
