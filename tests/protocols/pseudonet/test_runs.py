"""Pseudonet end to end: whole runs on real channels, judged from the bodies' tracks and not by the protocol."""

import subprocess
import sys
from collections.abc import Mapping, Sequence
from itertools import pairwise, product
from typing import Any

import numpy as np
import pytest

from cosim.geometry.grids import CoverageGrid, coverage_grid
from cosim.scenario import Scenario
from cosim.simulation import Outcome, Simulation
from cosim.trace import CALLS, POSES, Table
from cosim.units import MS, SLOT, S, to_seconds
from tests.checkout import MAPS
from tests.tiers import all_pairs, each_value, soak_count, two_tiers

ROOMS: dict[str, Any] = {
    "map": "walls",
    "bounds_m": [0, 0, 6, 4],
    "walls": [[2, 0, 2, 3], [4, 1, 4, 4], [4.5, 1, 4.5, 3.5], [5, 0.5, 5, 3.5], [5.5, 0.5, 5.5, 3.5]],
}
"""Three rooms, of which the last has corridors of one cell."""
OFFICE: dict[str, Any] = {"map": "office", "office": {"width_m": 14.0, "depth_m": 9.0, "rooms": 4}}
COMPLETE = ("boustrophedon", "spanning_tree")
CHANNELS = ("ideal", "bluetooth")


def scenario(
    algorithm: str = "boustrophedon",
    size: int = 4,
    channel: str = "ideal",
    floor: Mapping[str, Any] = ROOMS,
    duration_s: float = 2_000,
    team: Mapping[str, Any] | None = None,
    radio: Mapping[str, Any] | None = None,
    **parameters: Any,
) -> Scenario:
    return Scenario.model_validate(
        {
            "duration_s": duration_s,
            "floorplan": floor,
            "team": {"size": size, **(team or {})},
            "channel": {"kind": channel, **(radio or {})},
            "protocol": {"use": "pseudonet", "parameters": {"algorithm": algorithm, **parameters}},
        }
    )


def run(chosen: Scenario, seed: int = 1, tables: Sequence[Table] = (POSES,)) -> tuple[Simulation, Outcome]:
    simulation = Simulation(chosen, seed, tables)
    return simulation, simulation.run()


class Tracks:
    """Which cells the bodies were in, from the poses alone; and which there are, from the walls alone."""

    def __init__(self, simulation: Simulation, outcome: Outcome) -> None:
        floor, team = simulation.floorplan, simulation.scenario.team
        poses = outcome.trace.columns(POSES.name)
        self.at = np.stack([poses["x_m"], poses["y_m"]], axis=1).reshape(-1, team.size, 2)
        """shape (ticks, robots, 2)"""
        self.grid: CoverageGrid = coverage_grid(
            floor.bounds_m, 0.5, team.body.radius_m, floor.walls_m, floor.forbidden, self.at[0]
        )
        visited = {self.grid.cell_at(x, y) for x, y in np.unique(self.at.reshape(-1, 2).round(6), axis=0).tolist()}
        self.visited = visited

    def reachable(self, robots: Sequence[int], around: Sequence[int] = ()) -> set[int]:
        """Flood the floor from where *robots* ended, around the places where *others* ended."""
        ends = [self.grid.cell_at(x, y) for x, y in self.at[-1].tolist()]
        solid = {ends[robot] for robot in around}
        found: set[int] = set()
        left = [ends[robot] for robot in robots]
        while left:
            cell = left.pop()
            if cell not in found:
                found.add(cell)
                left += [c for c in self.grid.steps[cell].tolist() if c >= 0 and c not in solid]
        return found

    def nearest_two(self) -> float:
        """Return how near two bodies' centres ever were."""
        gaps = [np.hypot(*(self.at[:, a] - self.at[:, b]).T).min() for b in range(self.at.shape[1]) for a in range(b)]
        return float(min(gaps, default=np.inf))


def check_covered(simulation: Simulation, outcome: Outcome) -> None:
    """Fail unless every cell that can be reached was entered in time, by bodies that never touched."""
    tracks = Tracks(simulation, outcome)
    size = simulation.scenario.team.size
    assert tracks.reachable(range(size)) - tracks.visited == set()
    assert outcome.metrics["coverage"] == 1.0
    assert tracks.nearest_two() > 2 * simulation.scenario.team.body.radius_m
    assert all(machine.finished for machine in simulation.machines)
    assert outcome.simulated_s < simulation.scenario.duration_s


@pytest.mark.slow
@pytest.mark.parametrize(("algorithm", "channel", "size"), all_pairs(COMPLETE, CHANNELS, range(1, 9)))
def test_the_complete_algorithms_cover_rooms_and_corridors(algorithm: str, channel: str, size: int) -> None:
    check_covered(*run(scenario(algorithm, size, channel)))


@pytest.mark.slow
@pytest.mark.parametrize(("algorithm", "channel"), each_value(COMPLETE, CHANNELS))
def test_the_complete_algorithms_cover_a_generated_office(algorithm: str, channel: str) -> None:
    check_covered(*run(scenario(algorithm, 4, channel, OFFICE)))


@pytest.mark.slow
@pytest.mark.parametrize(("size", "seed", "matter"), [(1, 900_001, True), (2, 900_001, True), (2, 900_002, False)])
def test_the_forced_steps_matter_where_nobody_is_left_to_answer(size: int, seed: int, matter: bool) -> None:
    # a robot alone, and two that are in trouble at the same time; in the last world one of two could always answer
    steps = [run(scenario("oscard", size, k_forced=k_forced), seed, ())[1].metrics["steps"] for k_forced in (2, 16)]
    assert (steps[0] != steps[1]) == matter


def on_map(name: str, algorithm: str, channel: str) -> None:
    path = MAPS / name
    if not path.is_file():
        pytest.skip(f"{path.name} is not there: the maps lie beside the checkout, in ../shared/maps")
    check_covered(*run(scenario(algorithm, 8, channel, {"map": str(path)}, 100_000)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "algorithm", "channel"),
    two_tiers([("depot.yaml", "spanning_tree", "bluetooth"), ("room-32-32-4.map", "boustrophedon", "ideal")], 1),
)
def test_a_real_map_is_covered(name: str, algorithm: str, channel: str) -> None:
    on_map(name, algorithm, channel)


ON_MAPS = list(product(("depot.yaml", "room-32-32-4.map", "willow.yaml", "room-64-64-16.map"), COMPLETE, CHANNELS))


@pytest.mark.soak
@pytest.mark.parametrize(("name", "algorithm", "channel"), ON_MAPS[: soak_count(len(ON_MAPS))])
def test_every_real_map_is_covered(name: str, algorithm: str, channel: str) -> None:
    on_map(name, algorithm, channel)


def test_robots_that_start_beside_their_cells_centres_drive_there_first() -> None:
    starts = [[0.22, 0.3], [5.3, 3.73]]
    floor = {"map": "walls", "bounds_m": [0, 0, 6, 4]}
    simulation, outcome = run(scenario(size=2, team={"starts": starts}, floor=floor))
    check_covered(simulation, outcome)
    early = Tracks(simulation, outcome).at[:10]  # in the first second
    for robot, centre in enumerate([(0.25, 0.25), (5.25, 3.75)]):
        assert np.abs(early[:, robot] - centre).max(axis=1).min() < 1e-6


@pytest.mark.slow
def test_robots_in_parts_that_do_not_hang_together_cover_both() -> None:
    floor = {"map": "walls", "bounds_m": [0, 0, 6, 4], "walls": [[2, 0, 2, 4]]}
    starts = [[0.25, 0.25], [5.25, 3.25], [3.25, 0.25]]
    check_covered(*run(scenario(size=3, channel="bluetooth", floor=floor, team={"starts": starts})))


@pytest.mark.slow
def test_robots_that_have_to_turn_cover_as_well() -> None:
    check_covered(*run(scenario(size=4, channel="bluetooth", team={"body": {"drive": "differential"}})))


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["oscard", "random_walk"])
def test_the_others_report_the_share_that_they_have_covered_at_the_step_limit(algorithm: str) -> None:
    simulation, outcome = run(scenario(algorithm, 3, "bluetooth", step_limit=20))
    tracks = Tracks(simulation, outcome)
    floor = tracks.reachable(range(3))
    assert outcome.metrics["steps"] == 20
    assert outcome.metrics["coverage"] == len(tracks.visited) / len(floor) < 1
    assert tracks.nearest_two() > 0.4


@pytest.mark.slow
def test_a_team_whose_robots_have_all_covered_their_share_ends() -> None:
    _, outcome = run(scenario("oscard", 3, "bluetooth", stop_ratio=0.1))
    assert outcome.metrics["messages_stop"] == 3
    # three robots that stop at ten cells each (of 96, rounded up); not one goes on, and the step limit is far
    assert 30 / 96 <= outcome.metrics["coverage"] < 0.5
    assert outcome.simulated_s < 200


# ------------------------------------------------------------------ what messages cost


@pytest.mark.slow
def test_messages_are_counted_by_type() -> None:
    _, outcome = run(scenario("boustrophedon", 4))
    metrics = outcome.metrics
    steps = metrics["steps"]
    # one exchange calls the roll, one finds completion; all others propose or accept
    assert metrics["exchanges"] == 2 * steps + 2
    assert metrics["messages_roll"] == 4
    assert metrics["messages_map"] == 0
    assert metrics["messages_state"] + metrics["messages_stop"] == 4 * (steps + 1)
    assert metrics["messages_answer"] == 4 * steps
    assert metrics["messages_help"] == metrics["messages_trap"] == 0
    sent = outcome.trace.columns("events")["event"].count("MessageSent")
    assert sent == sum(metrics[f"messages_{kind}"] for kind in ("state", "stop", "answer", "roll"))


@pytest.mark.slow
@pytest.mark.parametrize("size", [2, 5, 8])
def test_an_exchange_takes_4m_minus_2_slots_and_the_wait_for_the_next_pair_of_slots(size: int) -> None:
    _, outcome = run(scenario("spanning_tree", size, "bluetooth"))
    least = to_seconds((4 * size - 2) * SLOT)
    # the last broadcast is on the air while the next exchange begins: the host sees it end with its last poll
    seen_by_host = least - to_seconds(2 * SLOT)
    assert seen_by_host <= outcome.metrics["exchange_s"] <= least + to_seconds(4 * SLOT)
    exchanges = outcome.metrics["exchanges"] - 2  # neither the roll call nor the last one ends in a step
    assert outcome.metrics["radio_wait_s"] == pytest.approx(exchanges * outcome.metrics["exchange_s"], rel=0.1)


@pytest.mark.slow
def test_the_ideal_channel_costs_next_to_nothing() -> None:
    _, outcome = run(scenario("spanning_tree", 4))
    # four broadcasts and three polls of a microsecond each; some are sent in the same instant
    assert 0 < outcome.metrics["exchange_s"] <= 7e-6


@pytest.mark.slow
def test_one_step_is_a_nest_of_calls_of_the_five_rooms() -> None:
    _, outcome = run(scenario(size=3, channel="bluetooth", trace_calls=True, step_limit=4), tables=(CALLS,))
    columns = outcome.trace.columns(CALLS.name)
    rows = list(zip(*(columns[name] for name in ("source", "depth", "room", "call")), strict=True))
    mine = [(depth, room, call) for source, depth, room, call in rows if source == 1]
    tops = [number for number, (depth, _, call) in enumerate(mine) if (depth, call) == (0, "move_next_step")]
    step = mine[tops[2] : tops[3]]
    assert step[:7] == [
        (0, "application", "move_next_step"),
        (1, "coordination", "localize"),
        (1, "coordination", "evaluate_actions"),
        (1, "coordination", "communicate"),
        (2, "messaging", "state"),
        (3, "broadcast", "find_master"),
        (3, "broadcast", "send_to_master"),
    ]
    assert [room for _, room, _ in step[7:]][:1] == ["bluetooth"]
    assert all(after <= before + 1 for (before, *_), (after, *_) in pairwise(step))
    masters = {(depth, room, call) for source, depth, room, call in rows if source == 0}
    assert (3, "broadcast", "broadcast_to_robots") in masters
    assert {"l2cap.connection_request", "hci.inquiry", "lm.page", "lc.page"} <= {call for _, _, call in masters}


# ------------------------------------------------------------------ same seed, same digest


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["oscard", "boustrophedon"])
def test_same_seed_same_digest_in_this_process_and_in_another(algorithm: str) -> None:
    chosen = scenario(algorithm, 3, "bluetooth", step_limit=15)
    digest = run(chosen)[1].digest
    assert run(chosen)[1].digest == digest
    assert run(chosen, seed=2)[1].digest != digest
    code = (
        "import sys; from cosim.scenario import Scenario; from cosim.simulation import simulate; "
        "from cosim.trace import POSES; "
        "print(simulate(Scenario.model_validate_json(sys.argv[1]), 1, (POSES,)).digest)"
    )
    other = subprocess.run(
        [sys.executable, "-c", code, chosen.model_dump_json()], capture_output=True, text=True, check=True
    )
    assert other.stdout.strip() == digest


# ------------------------------------------------------------------ robots that die


def run_with_losses(chosen: Scenario, losses: Sequence[tuple[int, int, str]], seed: int = 1) -> tuple[Tracks, Outcome]:
    """Run *chosen*; at each (time, robot, what) of *losses* switch a radio off, or kill the host, or both."""
    simulation = Simulation(chosen, seed, (POSES,))
    for time, robot, what in losses:
        if "radio" in what:
            simulation.kernel.at(time, lambda robot=robot: simulation.channel.power(robot, False))  # type: ignore[misc]
        if "host" in what:
            simulation.kernel.at(time, simulation.nodes[robot].kill)
    outcome = simulation.run()
    assert outcome.simulated_s < chosen.duration_s
    return Tracks(simulation, outcome), outcome


def check_finished_without(tracks: Tracks, outcome: Outcome, gone: Sequence[int]) -> None:
    """Fail unless the others have covered what can be reached around the bodies of *gone*."""
    assert outcome.metrics["robots_dropped"] == len(gone)
    others = [robot for robot in range(tracks.at.shape[1]) if robot not in gone]
    assert tracks.reachable(others, around=gone) - tracks.visited == set()


@pytest.mark.slow
@pytest.mark.parametrize(("channel", "what"), each_value(CHANNELS, ["radio", "host", "radio and host"]))
def test_the_others_finish_without_a_robot_that_is_gone(channel: str, what: str) -> None:
    losses = [(14 * S + 103 * MS, 2, what)]
    tracks, outcome = run_with_losses(scenario(size=4, channel=channel), losses)
    check_finished_without(tracks, outcome, [2])


@pytest.mark.slow
def test_a_robot_that_was_never_found_is_gone_around() -> None:
    losses = [(1, 3, "radio and host")]
    tracks, outcome = run_with_losses(scenario(size=4, channel="bluetooth", inquiries=1), losses)
    check_finished_without(tracks, outcome, [3])


@pytest.mark.slow
@pytest.mark.parametrize(("channel", "what"), each_value(CHANNELS, ["radio", "host", "radio and host"]))
def test_without_their_master_the_others_form_a_team_and_finish(channel: str, what: str) -> None:
    losses = [(14 * S, 0, what)]
    tracks, outcome = run_with_losses(scenario(size=4, channel=channel), losses)
    if what == "radio":  # it goes on alone, and covers what it can by itself
        assert tracks.reachable(range(4)) - tracks.visited == set()
    else:
        check_finished_without(tracks, outcome, [0])
    formed = outcome.trace.columns("events")
    sizes = {
        (int(source), int(size))
        for source, event, size in zip(formed["source"], formed["event"], formed["size"], strict=True)
        if event == "TeamFormed"
    }
    assert {(1, 3), (2, 3), (3, 3)} <= sizes


@pytest.mark.slow
def test_a_host_whose_radio_is_dead_goes_on_by_itself() -> None:
    chosen = scenario(size=2, channel="ideal", silence_s=30.0, stagger_s=20.0)
    tracks, outcome = run_with_losses(chosen, [(5 * S, 1, "radio")])
    assert outcome.metrics["robots_dropped"] == 1
    assert tracks.reachable(range(2)) - tracks.visited == set()


@pytest.mark.slow
@pytest.mark.parametrize("case", two_tiers(range(12), 4))
def test_whoever_dies_and_whenever_the_rest_is_covered(case: int) -> None:
    rng = np.random.default_rng(case)
    size = int(rng.integers(3, 9))
    gone = rng.choice(np.arange(1, size), size=int(rng.integers(1, 3)), replace=False).tolist()
    losses = [
        # within 30 ms of a tick: that is when an exchange is under way
        (int(rng.integers(40, 150)) * 100 * MS + int(rng.integers(30 * MS)), robot, str(rng.choice(["radio", "host"])))
        for robot in gone
    ]
    chosen = scenario(COMPLETE[case % 2], size, CHANNELS[case // 2 % 2])
    check_finished_without(*run_with_losses(chosen, losses, case), gone)
