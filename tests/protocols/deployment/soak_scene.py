"""Random deployments through the whole stack, and a judge who knows nothing of the code that is judged.

The judge looks at the true positions at every tick, and at shapes of its own: bodies are discs, walls shapely lines,
what can be reached is labelled on a grid by scipy.
"""

import math
from collections.abc import Set
from typing import Any, Final, NamedTuple

import networkx as nx
import numpy as np
import shapely
from scipy import ndimage

from cosim.randomness import Streams
from cosim.scenario import Scenario
from cosim.simulation import Simulation
from cosim.trace import POSES
from cosim.world.offices import OfficeSettings, office_walls
from protocols.deployment.tasks.plan import Place
from tests.protocols.deployment.soak_wider import Party, widened

DURATION_S: Final = 1500.0
TOUCH_M: Final = 1e-4
"""The simulator stops bodies as they touch: they never overlap by more than a rounding."""
HELD_M: Final = 0.3
SQUEEZE_M: Final = 0.1
"""Nobody is asked to pass where there is less room than that on either side."""
BACK_S: Final = 15.0
"""Who is back for less than this need not have been told what was missed."""
CELL_M: Final = 0.05
BODIES: Final = (
    {"radius_m": 0.33, "speed_mps": 0.5, "acceleration_mps2": 0.3},
    {"radius_m": 0.27, "speed_mps": 0.9, "acceleration_mps2": 0.5},
    {"radius_m": 0.3, "speed_mps": 0.6, "acceleration_mps2": 0.5},
    {"radius_m": 0.2, "speed_mps": 0.4, "acceleration_mps2": 1.0},
)
PLAYS: Final = ("deploy/group", "deploy/wave", "deploy/leap-frog")


class Floor(NamedTuple):
    """Walls, and the rectangle that they fill."""

    name: str
    walls: list[tuple[float, ...]]
    width_m: float
    height_m: float

    @property
    def lines(self) -> Any:
        """Return the walls as one geometry."""
        return shapely.multilinestrings([[(a, b), (c, d)] for a, b, c, d in self.walls])


class Case(NamedTuple):
    """A scenario, and what the judge has to know of it."""

    scenario: Scenario
    floor: Floor
    radii_m: list[float]
    places_m: list[Place]
    """Of the play that is called last."""
    faults: str
    """In a word: what goes wrong."""
    parties: tuple[Party, ...] = ()
    """Who is deployed to which of the places; anybody to any, if nothing is said."""
    strict: bool = True
    """Whether all that can be held is to be held, even if the play fails."""


# ---------------------------------------------------------------- scenarios


def _floor(stream: np.random.Generator) -> Floor:
    kind = str(stream.choice(["hall", "pillars", "rooms", "office", "corridor", "tee"]))
    if kind == "office":
        width, depth = float(stream.uniform(14, 20)), float(stream.uniform(9, 12))
        settings = OfficeSettings(
            width_m=width,
            depth_m=depth,
            rooms=int(stream.integers(3, 8)),
            corridor_m=float(stream.uniform(1.8, 2.6)),
            door_m=1.2,
            seed=int(stream.integers(1, 1_000_000)),
        )
        return Floor(kind, [tuple(map(float, wall)) for wall in office_walls(settings)], width, depth)
    inner: dict[str, list[tuple[float, ...]]] = {
        "hall": [],
        "pillars": [wall for x in (4, 8, 12) for wall in box(x - 0.4, 4.1, x + 0.4, 4.9)],
        "rooms": [(5, 0, 5, 3), (5, 4.6, 5, 9), (11, 0, 11, 5), (11, 6.6, 11, 9)],
        # a base room, a corridor with a bend
        "corridor": [(5, 3, 5, 9), (5, 1.8, 5, 0), (5, 3, 13, 3), (13, 3, 13, 9), (5, 0.6, 16, 0.6)],
        # a corridor with a branch in its middle, a room at each end
        "tee": [
            *[(4, 0, 4, 6), (4, 7.2, 4, 9), (12, 0, 12, 6), (12, 7.2, 12, 9)],
            *[(4, 5.5, 6.8, 5.5), (9.2, 5.5, 12, 5.5), (4, 7.7, 12, 7.7)],
            *[(6.8, 0, 6.8, 5.5), (9.2, 0, 9.2, 5.5)],
        ],
    }
    return Floor(kind, [*box(0, 0, 16, 9), *inner[kind]], 16.0, 9.0)


def box(x_min: float, y_min: float, x_max: float, y_max: float) -> list[tuple[float, ...]]:
    corners = [(x_min, y_min), (x_max, y_min), (x_max, y_max), (x_min, y_max)]
    return [(*a, *b) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)]


def _places(room: "Room", stream: np.random.Generator, wanted: int, apart_m: float, near: Place | None) -> list[Place]:
    """Draw places so far from each other that all belong to one room; there is always some."""
    for _ in range(200):
        found: list[Place] = []
        for _ in range(300):
            low, high = ((0.0, 0.0), (room.width_m, room.height_m))
            if near is not None:
                low, high = (near[0] - 2.5, near[1] - 2.5), (near[0] + 2.5, near[1] + 2.5)
            x, y = (round(float(each), 3) for each in stream.uniform(low, high))
            clear = all(math.dist((x, y), other) > apart_m for other in found)
            if clear and room.part((x, y)) > 0 and room.part((x, y)) == room.main:
                found.append((x, y))
                if len(found) == wanted:
                    return found
    raise AssertionError("no room")


def drawn(seed: int) -> Case:
    """Return the case number *seed*."""
    stream = Streams(seed)("soak of deployments")
    floor = _floor(stream)
    size = int(stream.integers(2, 7))
    mixed = bool(stream.integers(2))
    kinds = stream.integers(len(BODIES), size=size).tolist() if mixed else [int(stream.integers(len(BODIES)))] * size
    bodies: list[dict[str, Any]] = [{**BODIES[kind], "drive": "differential"} for kind in kinds]
    radii = [float(body["radius_m"]) for body in bodies]
    room = Room(floor, 2.0 * max(radii), [], 0.0)
    base = _places(room, stream, 1, 0.0, None)[0]
    starts = _places(room, stream, size, 2.0 * max(radii) + 0.3, base)
    ends = _places(room, stream, size, 4.0 * max(radii) + 0.3, None)
    faults = _faults(stream, size)
    call = {"play": str(stream.choice(PLAYS)), "places": ends, "augmented": bool(stream.integers(2))}
    words = [str(call["play"]), "augmented" if call["augmented"] else "plain"]
    switches = []
    if stream.random() < 0.15:
        strategy = str(stream.choice(["group", "wave", "leap_frog"]))
        switches.append({"at_s": float(stream.uniform(8, 40)), "strategy": strategy})
        words.append(f"switched to {strategy}")
    channel: dict[str, Any] = {"kind": "adhoc"}
    if stream.random() < 0.7:
        channel = {"kind": "ideal", "delay_s": 0.002}
        if stream.random() < 0.5:
            channel["loss"] = round(float(stream.uniform(0.1, 0.3)), 2)
    plain: dict[str, Any] = {
        "duration_s": DURATION_S,
        "floorplan": {"map": "walls", "walls": floor.walls},
        "team": {
            "groups": [{"size": 1, "body": body} for body in bodies],
            "starts": starts,
            "senses": {"beams": 90, "beam_range_m": 6.0},
        },
        "channel": channel,
        "protocol": {
            "use": "protocols.deployment.spec:SPEC",
            "parameters": {
                "calls": [{"call": call}],
                "switches": switches,
                "executive": str(stream.choice(["central", "distributed"])),
                "silence_s": 6.0,
                "alone_s": 15.0,
            },
        },
        "faults": faults,
    }
    more = Streams(seed)("soak of deployments, what is wider")

    def draw(wanted: int) -> list[Place]:
        return _places(room, more, wanted, 4.0 * max(radii) + 0.3, None)

    parties, wider = widened(plain, more, draw)
    words += [floor.name, f"{size} robots", "mixed" if mixed else "alike", channel["kind"]]
    words += [f"loss {channel['loss']}"] if "loss" in channel else []
    words += [f"kill {fault['robot']} at {fault['at_s']}" for fault in faults]
    calls = plain["protocol"]["parameters"]["calls"]
    strict = str(calls[0]["call"]["play"]) in PLAYS or not plain["faults"]
    scenario = Scenario.model_validate(plain)
    return Case(scenario, floor, radii, ends, ", ".join([*words, *wider]), tuple(parties), strict)


def _faults(stream: np.random.Generator, size: int) -> list[dict[str, Any]]:
    """Kill a robot or two in a third of the cases; the host as likely as another."""
    if stream.random() > 1 / 3:
        return []
    dead = stream.permutation(size)[: 1 if size < 4 else int(stream.integers(1, 3))]
    return [{"kind": "kill", "robot": int(each), "at_s": round(float(stream.uniform(3, 60)), 1)} for each in dead]


# ---------------------------------------------------------------- the judge


class Room:
    """Where the middle of a disc can be, and what of that hangs together."""

    def __init__(self, floor: Floor, radius_m: float, bodies: list[tuple[Place, float]], squeeze_m: float) -> None:
        self.width_m, self.height_m = floor.width_m, floor.height_m
        x, y = np.meshgrid(np.arange(CELL_M / 2, floor.width_m, CELL_M), np.arange(CELL_M / 2, floor.height_m, CELL_M))
        free = shapely.distance(floor.lines, shapely.points(x, y)) >= radius_m + (squeeze_m if bodies else 0.0)
        for place, body_m in bodies:
            free &= np.hypot(x - place[0], y - place[1]) >= radius_m + body_m + squeeze_m
        self._labels, _ = ndimage.label(free)
        sizes = np.bincount(self._labels.ravel())
        sizes[0] = 0
        self.main = int(sizes.argmax())

    def part(self, place: Place) -> int:
        """Return the number of the part of the floor in which a place is; 0: in none."""
        row, column = int(place[1] / CELL_M), int(place[0] / CELL_M)
        inside = 0 <= row < self._labels.shape[0] and 0 <= column < self._labels.shape[1]
        return int(self._labels[row, column]) if inside else 0

    def parts(self, place: Place, within_m: float) -> set[int]:
        """Return the parts of the floor within so much of a place."""
        reach = math.ceil(within_m / CELL_M)
        row, column = int(place[1] / CELL_M), int(place[0] / CELL_M)
        window = self._labels[max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1]
        return {int(each) for each in np.unique(window)} - {0}


class Verdict(NamedTuple):
    """What was wrong with a run; nothing, as it should be."""

    complaints: list[str]
    metrics: dict[str, float]


def judged(case: Case, seed: int) -> Verdict:
    """Execute the case, and judge it by its true positions."""
    outcome = Simulation(case.scenario, seed, [POSES]).run()
    poses = outcome.trace.columns("poses")
    size = len(case.radii_m)
    places = np.stack((poses["x_m"], poses["y_m"]), axis=1).reshape(-1, size, 2).astype(float)
    events = outcome.trace.arrow("events").to_pylist()
    dead = {row["source"] for row in events if row["event"] == "Killed"}
    complaints = touched(case, places)
    if outcome.metrics["simulated_s"] >= DURATION_S:
        complaints.append("the run does not end")
    refused = outcome.metrics["plans_ended"] < 1.0
    told = [] if case.strict and not refused else failure(events)
    if told == ["no reason is told"]:
        complaints += told
    elif not told:
        complaints += deserted(case, [(float(x), float(y)) for x, y in places[-1]], dead, absent(events))
    return Verdict(complaints, dict(outcome.metrics))


def failure(events: list[dict[str, Any]]) -> list[str]:
    """Return the reasons, in words, for which the last plan has failed, or was refused; none if it was done.

    As long as nothing has gone wrong with any robot, no play is to be refused.
    """
    ends = [row for row in events if row["event"] == "PlanEnded"]
    if ends and ends[-1]["result"] == "done":
        return []
    hurt = min((row["time_ns"] for row in events if row["event"] in ("Killed", "Crashed", "RadioOff")), default=None)
    told = [row for row in events if row["event"] == "Breached" or row.get("result") == "failed"]
    told += [row for row in events if row["event"] == "PlanRefused" and hurt is not None and hurt < row["time_ns"]]
    reasons = [row["why"] for row in told if len((row.get("why") or "").split()) > 1]
    reasons += [f"robot {row['robot']} was lost" for row in events if row["event"] == "RobotLost"]
    return reasons or ["no reason is told"]


def absent(events: list[dict[str, Any]]) -> set[int]:
    """Return whose computer was down, or radio off, when the last plan ended, or had not been back for long then."""
    ended = max((row["time_ns"] for row in events if row["event"] == "PlanEnded"), default=0)
    away: dict[tuple[int, str], int] = {}
    absent = set()
    for row in events:
        change = {"Crashed": "down", "Rebooted": "down", "RadioOff": "off", "RadioOn": "off"}.get(row["event"])
        if change is None:
            continue
        if row["event"] in ("Crashed", "RadioOff"):
            away[row["source"], change] = row["time_ns"]
        elif away.pop((row["source"], change)) < ended < row["time_ns"] + BACK_S * 1e9:
            absent.add(row["source"])
    return absent | {robot for (robot, _), since in away.items() if since < ended}


def touched(case: Case, places: Any) -> list[str]:
    """Return which bodies touch each other or a wall at any tick; *places* has the shape (ticks, robots, 2)."""
    complaints = []
    for a, radius_m in enumerate(case.radii_m):
        for b in range(a):
            gaps = np.hypot(*(places[:, a] - places[:, b]).T) - radius_m - case.radii_m[b]
            if gaps.min() < TOUCH_M:
                complaints.append(f"robots {b} and {a} touch at tick {int(gaps.argmin())}")
        room = shapely.distance(case.floor.lines, shapely.points(places[:, a])) - radius_m
        if room.min() < TOUCH_M:
            complaints.append(f"robot {a} touches a wall at tick {int(room.argmin())}")
    return complaints


def deserted(case: Case, places: list[Place], dead: set[int], absent: Set[int] = frozenset()) -> list[str]:
    """Return a complaint if the living robots hold fewer places than those of them could, one each, who were there."""
    bodies = [(places[robot], case.radii_m[robot]) for robot in sorted(dead | absent)]
    parties = case.parties or (Party(tuple(range(len(places))), tuple(case.places_m)),)
    graph: Any = nx.Graph()
    for robots, wanted in parties:
        present = [robot for robot in robots if robot not in dead | absent]
        graph.add_nodes_from(present, bipartite=0)
        for robot in present:
            room = Room(case.floor, case.radii_m[robot], bodies, SQUEEZE_M)
            mine = room.parts(places[robot], 0.1)
            for place in wanted:
                if mine & room.parts(place, 0.0):
                    graph.add_edge(robot, ("place", place))
    most = len(nx.bipartite.maximum_matching(graph, {n for n in graph if isinstance(n, int)})) // 2
    living = [robot for robot in range(len(places)) if robot not in dead]
    held = sum(any(math.dist(places[robot], place) <= HELD_M for robot in living) for place in case.places_m)
    return [f"{held} places are held, {most} could be"] if held < most else []
