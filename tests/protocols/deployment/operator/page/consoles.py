"""A session for tests of the playbook page alone: a still run, and consoles that answer as a test tells them to."""

import threading
from collections.abc import Callable
from typing import Any

from cosim.web.history import Cursor
from cosim.web.messages import Operate, Plain, Wish
from cosim.web.timeline import NO_TIMELINE, Timeline

Answering = Callable[[int, Plain], list[Plain]]
"""From the robot that is addressed, and what it is told, to what it says."""

PLAYS: list[Plain] = [
    {
        "name": "deploy",
        "path": "deploy",
        "about": "Deploy robots to places.",
        "plays": [
            {
                "name": name,
                "path": f"deploy/{name}",
                "about": f"Deploy by {name}.",
                "parameters": {
                    "places": {"kind": "places", "about": "where to"},
                    "robots": {"kind": "robots", "about": "who", "as_many_as": "places", "needs": {"camera": False}},
                }
                | extra,
                "tasks": [{"name": "deploy", "path": f"deploy/{name}/deploy", "kind": "deploy"}],
            }
            for name, extra in (("group", {}), ("wave", {"apart_m": {"kind": "number", "default": 1.5, "least": 0}}))
        ],
    },
    {
        "name": "photo",
        "path": "photo",
        "about": "A picture is taken.",
        "parameters": {
            "place": {"kind": "place"},
            "robot": {"kind": "robot", "needs": {"camera": True}},
            "strategy": {"kind": "strategy", "default": "group"},
        },
        "tasks": [
            {"name": "go", "path": "photo/go", "kind": "go"},
            {"name": "photo", "path": "photo/photo", "kind": "photo"},
        ],
    },
]
MAP: Plain = {
    "say": "map",
    "walls": [],
    "bounds": [0, 0, 12, 8],
    "base": [1.0, 6.0],
    "places": {"posts": [[4, 4], [8, 4]], "base": [[1, 1]]},
    "robots": [
        {"robot": robot, "radius_m": 0.2, "speed_mps": 1.0, "camera": robot != 2, "sensor": "laser"}
        for robot in range(3)
    ],
}


def go(name: str, robot: int, place: tuple[float, float]) -> Plain:
    """Return a task that is a drive."""
    act = {"act": "go", "robot": robot, "place_m": list(place), "via_m": [], "final": True}
    return {"name": name, "label": "", "act": act, "order": "serial", "subtasks": []}


def plan(number: int = 1) -> Plain:
    """Return a plan: two stages, of two drives and one."""
    places = [(4.0, 4.0), (8.0, 4.0)]
    stages = [
        {
            "name": f"group/stage-{at + 1}",
            "label": f"stage-{at + 1}",
            "act": None,
            "order": "parallel",
            "subtasks": [go(f"group/stage-{at + 1}/robot-{robot}", robot, places[at]) for robot in range(at, 2)],
        }
        for at in range(2)
    ]
    root = {"name": "group", "label": "group", "act": None, "order": "serial", "subtasks": stages}
    return {"number": number, "play": "deploy/group", "robots": [0, 1], "root": root, "constraints": []}


WINDOWS: Plain = {"group": [0, 0, 12.5, None], "group/stage-1": [0, 0, 6.25, 40], "group/stage-2": [6.25, 40, 12.5, 80]}


class Consoles:
    """What the consoles of a team of three say; a test may change what is told of them."""

    def __init__(self) -> None:
        self.host = 0
        self.dead: set[int] = set()
        self.refused = False
        self.expected_s: float | None = 12.5
        self.lacks = ""
        """Parameters without which it makes no plan, in one word each."""
        self.number = 0
        self.asked: list[tuple[int, Plain]] = []
        self.playing: Plain | None = None
        self.tasks: dict[str, str] = {}

    def said(self, kind: str) -> list[Plain]:
        """Return the requests of a kind so far."""
        return [data for _, data in self.asked if data.get("say") == kind]

    def __call__(self, robot: int, data: Plain) -> list[Plain]:
        self.asked.append((robot, data))
        if robot in self.dead:
            return []
        return [{"answer": data.get("request"), **answer} for answer in self._answer(robot, data)]

    def _answer(self, robot: int, data: Plain) -> list[Plain]:
        match data["say"]:
            case "plays":
                return [{"say": "plays", "tree": PLAYS}]
            case "map":
                return [MAP]
            case "state":
                return [{"say": "state", "plan": self.playing, "host": self.host, "tasks": self.tasks, "lost": []}]
            case "route":
                return [{"say": "route", "robot": data["robot"], "way": [[1, 1], [4, 1], data["to"]], "length_m": 6.0}]
            case "picture":
                columns = [1.0 + 0.1 * column for column in range(63)]
                shown = {"robot": data["robot"], "at_m": [1, 2], "heading_rad": 0.0, "view_rad": 1.0}
                return [{"say": "picture", **shown, "columns_m": [*columns, None]}]
            case _ if robot != self.host:
                return [{"say": "error", "why": f"robot {self.host} is host, not robot {robot}", "host": self.host}]
            case "call":
                return [self._call(data)]
            case _:
                return [{"say": "done"}]

    def _call(self, data: Plain) -> Plain:
        if self.refused:
            conflicts = ["the call: group ends at most 3 s after the plan begins", "group/stage-1: takes 6 s at least"]
            return {"say": "refusal", "conflicts": conflicts, "mend": ["the call: at most 12.5 s"]}
        missing = [name for name in self.lacks.split() if name not in data["call"]["parameters"]]
        if missing:
            return {"say": "error", "why": f"photo wants to know more: {', '.join(missing)}", "missing": missing}
        self.number += 1
        made = plan(self.number)
        if data["execute"]:
            self.playing = made
        return {
            "say": "plan",
            "plan": made,
            "expected_s": self.expected_s,
            "windows": WINDOWS,
            "executed": data["execute"],
        }


class Still:
    """A session of three robots that do not move; time is what a test says it is."""

    timeline: Timeline = NO_TIMELINE

    def __init__(self, answering: Answering) -> None:
        self.answering = answering
        self.time_s = 1.0
        self.gap_m = 1.0
        self.state = "playing"
        self.down: set[int] = set()
        self.wishes: list[Wish] = []
        self._told: list[Plain] = []
        self._lock = threading.Lock()

    @property
    def scene(self) -> Plain:
        return {
            "name": "double",
            "protocol": "double",
            "channel": "ideal",
            "seed": 1,
            "live": True,
            "attended": True,
            "duration_s": 100.0,
            "tick_s": 0.1,
            "bounds_m": [0, 0, 12, 8],
            "walls_m": [[0, 3, 8, 3]],
            "polygons_m": [],
            "places_m": MAP["places"],
            "base_m": None,
            "radii_m": [0.2] * 3,
        }

    def wish(self, wish: Wish) -> None:
        if isinstance(wish, Operate):
            for answer in self.answering(wish.robot, dict(wish.data)):
                self.tell(answer, wish.robot)
        else:
            self.wishes.append(wish)

    def tell(self, data: Any, robot: int = 0) -> None:
        """Have a robot say something to its operator."""
        with self._lock:
            self._told.append({"say": "operator", "robot": robot, "time_s": self.time_s, "data": data})

    def look(self, cursor: Cursor | None) -> tuple[list[Plain], Cursor]:
        with self._lock:
            known = 0 if cursor is None else cursor.operator
            new = Cursor(0, 0, 0, (self.time_s, self.state, tuple(self.down)), len(self._told))
            robots = [[1.0 + self.gap_m * robot, 1.0, 0.0, robot in self.down] for robot in range(3)]
            now = {"say": "now", "time_s": self.time_s, "state": self.state, "speed": 1.0, "why": "", "robots": robots}
            now |= {"frames": [], "events": [], "left_out": 0}
            now |= {"fresh": True, "trails": []} if cursor is None else {}
            fresh = cursor is None or cursor.shown != new.shown
            return ([now] if fresh else []) + self._told[known:], new

    def close(self) -> None:
        pass
