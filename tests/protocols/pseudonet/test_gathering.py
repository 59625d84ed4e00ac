"""Gathering: where, who is settled, which step; and whole runs, judged from the bodies' tracks."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import networkx as nx
import numpy as np
import pytest
from pydantic import ValidationError

from cosim.geometry.grids import coverage_grid
from cosim.protocol import Death, Surroundings
from cosim.scenario import Scenario
from cosim.simulation import Outcome, Simulation
from cosim.testing import check_machine
from cosim.trace import MESSAGES, POSES
from cosim.units import MS, S, Time
from protocols.gathering.gathering import Gathering, GatheringCoordination, choose_place, settled
from protocols.gathering.spec import SPEC, GatheringReferee, largest_group
from protocols.pseudonet.machine import Pseudonet
from protocols.pseudonet.messages import Action, Kind, Message, Verdict, decode
from protocols.pseudonet.parameters import Parameters as CoverageParameters
from protocols.pseudonet.setup import View
from tests.protocols.pseudonet.floors import floor, view_of
from tests.tiers import two_tiers

ROOMS: dict[str, Any] = {
    "map": "walls",
    "bounds_m": [0, 0, 6, 4],
    "walls": [[2, 0, 2, 3], [4, 1, 4, 4], [4.5, 1, 4.5, 3.5], [5, 0.5, 5, 3.5], [5.5, 0.5, 5.5, 3.5]],
}
"""Three rooms, of which the last has corridors of one cell."""


def view(picture: str, me: int = 0, obstacles: Sequence[str] = ()) -> View:
    """Return the view of robots that stand where *picture* has their numbers."""
    setup, names = floor(picture)
    made = view_of(setup, me, {int(name): cell for name, cell in names.items() if name.isdigit()})
    made.obstacles = frozenset(names[name] for name in obstacles)
    return made


# ---------------------------------------------------------------- where


@pytest.mark.parametrize(
    ("picture", "obstacles", "chosen"),
    [
        ("0...1.2.", (), 1),
        ("0.12.", (), 1),  # sums 5, 4, 4 cannot be told apart but by the number
        ("2.10.", (), 1),
        ("0..#..12", (), 1),  # 0 can be reached by nobody: of two that are equal, the lower number
        ("0.x.1.23", ("x",), 2),
        ("0123", (), 1),
        ("3", (), 3),
    ],
)
def test_the_team_gathers_at_the_member_with_the_shortest_ways(
    picture: str, obstacles: Sequence[str], chosen: int
) -> None:
    seen = view(picture, obstacles=obstacles)
    assert choose_place(seen) == seen.cells[chosen]


def test_ways_go_round_walls() -> None:
    seen = view(
        """
        .....
        .###.
        0.#.2
        ..1..
        """
    )
    assert choose_place(seen) == seen.cells[1]  # 3 + 3; from 0 to 2 it is 6
    assert choose_place(view("0#1\n..2")) == view("0#1\n..2").cells[2]


# ---------------------------------------------------------------- who is settled


@pytest.mark.parametrize(
    ("picture", "expected"),
    [
        ("0123", {0, 1, 2, 3}),
        ("01.23", {0, 1}),
        ("0#123", {0, 1, 2, 3}),  # nobody behind the wall can come
        ("0.1", {0}),
        (".1\n02", {0, 2}),  # 1 could still step to the left
        ("31\n02", {0, 1, 2, 3}),
        (".1.\n203\n...", {0, 1, 2, 3}),
        ("41.\n203\n...", {0, 1, 2, 3, 4}),
        ("4.1\n203", {0, 2, 3}),  # above 0 it is free: nearer for 4 and for 1
    ],
)
def test_settled_is_who_has_settled_robots_in_all_nearer_cells(picture: str, expected: set[int]) -> None:
    seen = view(picture)
    assert settled(seen, seen.cells[0]) == expected


def test_nobody_waits_for_a_cell_in_which_a_dead_body_lies() -> None:
    assert settled(view("x1\n02", obstacles="x"), view("x1\n02").cells[0]) == {0, 1, 2}
    assert settled(view("x1\n02"), view("x1\n02").cells[0]) == {0, 2}
    assert settled(view("0x1", obstacles="x"), view("0x1").cells[0]) == {0, 1}  # 1 cannot come


# ---------------------------------------------------------------- which step


def gathering_at(seen: View, member: int = 0) -> Gathering:
    """Return the algorithm of a team that gathers at *member*."""
    gathering = Gathering()
    gathering.place = seen.cells[member]
    return gathering


def test_a_robot_steps_along_the_side_on_which_it_is_farther() -> None:
    tall = "1..\n...\n...\n..0"
    assert gathering_at(view(tall, 1)).evaluate(view(tall, 1)).action == Action.SOUTH
    flat = "1...\n....\n...0"
    assert gathering_at(view(flat, 1)).evaluate(view(flat, 1)).action == Action.EAST


def test_a_step_that_leads_no_nearer_is_judged_as_done_and_is_not_taken() -> None:
    seen = view("0.1.\n####", 1)
    evaluation = gathering_at(seen).evaluate(seen)
    assert evaluation.action == Action.WEST
    assert evaluation.verdicts == (Verdict.WALL, Verdict.COVERED, Verdict.WALL, Verdict.POSSIBLE)
    seen.omitted.add(Action.WEST)
    evaluation = gathering_at(seen).evaluate(seen)
    assert evaluation.action == Action.STAY
    assert evaluation.verdicts == (Verdict.WALL, Verdict.COVERED, Verdict.WALL, Verdict.LOST)


def test_stop_is_said_once_and_only_by_who_is_settled() -> None:
    queue = view("0.21", 1)
    waiting = gathering_at(queue)
    assert [waiting.evaluate(queue).kind for _ in range(2)] == [Kind.STATE, Kind.STATE]  # 2 stands in the way for now
    queue.cells |= {2: queue.cells[0] + 1, 1: queue.cells[0] + 2}
    assert [waiting.evaluate(queue).kind for _ in range(2)] == [Kind.STOP, Kind.STATE]
    waiting.enlist(queue)  # a new team, of which the middle one is 2
    assert waiting.place == queue.cells[2]
    assert [waiting.evaluate(queue).kind for _ in range(2)] == [Kind.STOP, Kind.STATE]


def test_without_a_place_nobody_moves() -> None:
    seen = view("0.1", 1)
    assert Gathering().evaluate(seen).action == Action.STAY


# ---------------------------------------------------------------- the coordination room


def test_a_new_team_is_not_done_before_it_has_a_place_of_its_own() -> None:
    setup, names = floor("....012.")
    room = GatheringCoordination(setup, 0, rounds=0)
    reports = {
        robot: Message(robot, Kind.ROLL, 0, *setup.place(names[str(robot)]), Action.STAY, (Verdict.POSSIBLE,) * 4)
        for robot in (0, 1, 2)
    }
    room.view.cells[0] = names["0"]
    room.team_changed((0, 1, 2))
    room.take_positions(reports)
    assert not room.complete()
    room.plan()
    assert room.complete()
    room.team_changed((0, 1))  # they may come from different teams, with different places
    assert not room.complete()
    room.plan()
    assert room.complete()
    room.team_changed((0, 1, 2))
    room.take_positions({2: replace(reports[2], x=7)})
    room.plan()
    assert not room.complete()


def test_robots_that_gather_share_no_map() -> None:
    setup, names = floor("0.1")
    room = GatheringCoordination(setup, 0, rounds=0)
    room.take_positions({1: Message(1, Kind.ROLL, 0, 2, 0, Action.STAY, (Verdict.POSSIBLE,) * 4)})
    assert room.view.cells == {1: names["1"]}
    assert room.view.covered == set()


# ---------------------------------------------------------------- the referee


def test_a_group_is_joined_by_steps_and_not_by_cells_that_touch() -> None:
    setup, names = floor("a.bc\n##.#\nd.ef")
    assert largest_group(setup.grid, [names[name] for name in "abc"]) == 2
    assert largest_group(setup.grid, [names[name] for name in "acdf"]) == 1
    assert largest_group(setup.grid, [names[name] for name in "bcef"]) == 2  # a cell lies between
    assert largest_group(setup.grid, [names["a"], names["a"], names["c"]]) == 2
    steps = setup.grid.steps.copy()
    steps[names["b"], Action.EAST] = steps[names["c"], Action.WEST] = -1  # a wall without thickness
    assert largest_group(replace(setup.grid, steps=steps), [names["b"], names["c"]]) == 1


def test_the_referee_judges_the_living_and_forgets_a_group_that_falls_apart() -> None:
    setup, _ = floor("......")
    referee = GatheringReferee(setup)
    row = np.full(3, 0.5)
    for second, places in enumerate([(0.5, 1.5, 2.5), (0.5, 1.5, 3.5), (0.5, 2.5, 3.5), (1.5, 2.5, 3.5)]):
        assert referee.look(np.array(places), row, second * S) is False
    verdict = referee.verdict(9 * S)
    assert verdict["gathered"] == 1.0
    assert verdict["time_to_gather_s"] == 3.0
    assert verdict["spread_m"] == pytest.approx((2 / 3) ** 0.5)  # 1, 0 and 1 m from the middle
    referee.look(np.array([0.5, 2.5, 3.5]), row, 4 * S)
    assert referee.verdict(9 * S)["gathered"] == pytest.approx(2 / 3)
    assert np.isnan(referee.verdict(9 * S)["time_to_gather_s"])
    referee.died(Death(0, 5 * S, 0.5, 0.5, 0.2))
    referee.look(np.array([0.5, 2.5, 3.5]), row, 6 * S)
    assert referee.verdict(9 * S) == {"gathered": 1.0, "time_to_gather_s": 6.0, "spread_m": 0.5}


# ---------------------------------------------------------------- machines


def maker(size: int, **more: Any) -> Callable[[int, Time], Pseudonet]:
    starts = tuple((2.0 * robot + 0.5, 0.5) for robot in range(size))

    def forbidden(points: np.ndarray) -> np.ndarray:
        return (points[:, 0] < 0) | (points[:, 0] > 20) | (points[:, 1] < 0) | (points[:, 1] > 4)

    floor_m = (0.0, 0.0, 20.0, 4.0)
    around = Surroundings(starts, 0.2, 0.5, 1.0, 100 * MS, np.zeros((0, 4)), floor_m, forbidden)
    parameters = SPEC.parameters(cell_m=1.0, **more)  # type: ignore[call-arg]
    setup = SPEC.prepare(parameters, around)

    def make(me: int, start: Time) -> Pseudonet:
        machine = SPEC.make(parameters, setup, me, np.random.default_rng(me), start)
        assert isinstance(machine, Pseudonet)
        return machine

    return make


@pytest.mark.slow
@pytest.mark.parametrize(
    ("size", "more"), two_tiers([(6, {"piconet_size": 3, "topology": "tree"}), (2, {}), (8, {})], 1)
)
def test_machines_that_gather_keep_the_laws(size: int, more: Mapping[str, Any]) -> None:
    check_machine(maker(size, **more), [(2.0 * robot + 0.5, 0.5) for robot in range(size)], duration=5 * S)


@pytest.mark.parametrize("name", ["algorithm", "stop_ratio", "patience", "history", "revisits", "k_forced"])
def test_parameters_of_coverage_algorithms_are_refused_even_with_their_default(name: str) -> None:
    given = {name: CoverageParameters.model_fields[name].default}
    assert CoverageParameters.model_validate(given)
    with pytest.raises(ValidationError, match=rf"{name}\n  Extra inputs are not permitted"):
        SPEC.parameters.model_validate(given)


# ---------------------------------------------------------------- whole runs


def run(
    size: int,
    channel: str = "ideal",
    seed: int = 1,
    on: Mapping[str, Any] = ROOMS,
    faults: Sequence[Mapping[str, Any]] = (),
    **parameters: Any,
) -> tuple[Simulation, Outcome]:
    scenario = Scenario.model_validate(
        {
            "duration_s": 2000,
            "floorplan": on,
            "team": {"size": size, "body": {"radius_m": 0.2, "speed_mps": 0.5, "drive": "grid"}},
            "channel": {"kind": channel},
            "protocol": {"use": "protocols.gathering.spec:SPEC", "parameters": {"cell_m": 0.5, **parameters}},
            "faults": faults,
        }
    )
    simulation = Simulation(scenario, seed, (POSES, MESSAGES))
    return simulation, simulation.run()


def graph_of(simulation: Simulation) -> nx.Graph:
    """Return cells as (column, row), joined where one can step: from the walls alone."""
    plan, body = simulation.floorplan, simulation.scenario.team.body
    grid = coverage_grid(plan.bounds_m, 0.5, body.radius_m, plan.walls_m, plan.forbidden)
    graph = nx.Graph()
    for cell in np.flatnonzero(grid.free).tolist():
        graph.add_node((cell % grid.nx, cell // grid.nx))
        for beyond in grid.steps[cell].tolist():
            if beyond >= 0:
                graph.add_edge((cell % grid.nx, cell // grid.nx), (beyond % grid.nx, beyond // grid.nx))
    return graph


def tracks(simulation: Simulation, outcome: Outcome) -> np.ndarray:
    """Return where the bodies were, in metres, shape (ticks, robots, 2)."""
    poses = outcome.trace.columns(POSES.name)
    return np.stack([poses["x_m"], poses["y_m"]], axis=1).reshape(-1, simulation.scenario.team.size, 2)


def check_gathered(simulation: Simulation, outcome: Outcome, living: Sequence[int]) -> None:
    """Fail unless the living stand together, none can come nearer to one of them, and bodies never touched."""
    graph, at = graph_of(simulation), tracks(simulation, outcome)
    origin = simulation.floorplan.bounds_m[:2]
    cells = [tuple(int(v) for v in np.floor((at[-1, robot] - origin) / 0.5)) for robot in living]
    assert nx.is_connected(graph.subgraph(cells))
    ways = [nx.single_source_shortest_path_length(graph, cell) for cell in cells]
    assert any(
        all(away[beyond] > away[cell] or beyond in cells for cell in cells for beyond in graph[cell]) for away in ways
    )
    pairs = [np.hypot(*(at[:, a] - at[:, b]).T).min() for b in range(at.shape[1]) for a in range(b)]
    assert min(pairs) > 0.4
    assert outcome.metrics["gathered"] == 1.0
    assert outcome.metrics["time_to_gather_s"] <= outcome.simulated_s < 2000
    assert all(simulation.machines[robot].finished for robot in living)


@pytest.mark.slow
@pytest.mark.parametrize("seed", two_tiers([1, 2], 1))
@pytest.mark.parametrize(("size", "channel"), [(3, "ideal"), (8, "ideal"), (3, "bluetooth"), (8, "bluetooth")])
def test_a_team_gathers_in_rooms_and_corridors(size: int, channel: str, seed: int) -> None:
    check_gathered(*run(size, channel, seed), range(size))


@pytest.mark.slow
@pytest.mark.parametrize("channel", ["ideal", "bluetooth"])
def test_a_scatternet_gathers(channel: str) -> None:
    simulation, outcome = run(7, channel, piconet_size=3, topology="tree")
    check_gathered(simulation, outcome, range(7))


@pytest.mark.slow
@pytest.mark.parametrize("channel", ["ideal", "bluetooth"])
@pytest.mark.parametrize("killed", [0, 2])
def test_the_survivors_of_a_death_gather(killed: int, channel: str) -> None:
    open_floor = {"map": "walls", "bounds_m": [0, 0, 8, 6], "walls": [[4, 0, 4, 2], [4, 3, 4, 6]]}
    simulation, outcome = run(5, channel, 3, open_floor, [{"kind": "kill", "robot": killed, "at_s": 9.0}])
    check_gathered(simulation, outcome, [robot for robot in range(5) if robot != killed])
    assert outcome.metrics["messages_map"] == 0  # there is nothing that some know and others do not


@pytest.mark.slow
def test_in_every_step_somebody_comes_nearer_and_nobody_goes_farther_away() -> None:
    simulation, outcome = run(8, seed=2)
    events, graph = outcome.trace.columns("events"), graph_of(simulation)
    steps: dict[int, dict[int, tuple[int, int]]] = {}
    for name, step, robot, *cell in zip(
        *(events[column] for column in ("event", "step", "source", "column", "row")), strict=True
    ):
        if name == "Stepped":
            steps.setdefault(step, {})[robot] = (cell[0], cell[1])
    assert len(steps) > 8
    assert all(len(cells) == len(set(cells.values())) == 8 for cells in steps.values())
    still = set(steps[1].items()).intersection(*(cells.items() for cells in steps.values()))
    places = [
        nx.single_source_shortest_path_length(graph, cell)
        for _, cell in still  # the place is where somebody stood from the beginning to the end
    ]
    ways = [[[away[cells[robot]] for robot in range(8)] for _, cells in sorted(steps.items())] for away in places]
    assert any(
        all(
            sum(after) < sum(before) and all(x <= y for x, y in zip(after, before, strict=True))
            for before, after in pairwise(of_place)
        )
        for of_place in ways
    )


@pytest.mark.slow
def test_a_step_limit_ends_a_team_that_gathers_as_any_other() -> None:
    _, outcome = run(3, step_limit=3)
    assert outcome.metrics["steps"] == 3
    assert outcome.metrics["gathered"] < 1


@pytest.mark.slow
def test_all_that_is_on_the_air_are_packets_of_pseudonet() -> None:
    _, outcome = run(4, "bluetooth")
    payloads = {bytes.fromhex(payload) for payload in outcome.trace.columns(MESSAGES.name)["payload"]}
    assert {decode(payload).__class__.__name__ for payload in payloads} >= {"Message", "Sync"}
    assert max(len(payload) for payload in payloads) <= 17  # DM1
