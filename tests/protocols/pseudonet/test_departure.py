"""A stop as a departure (paper 003, section III.A): who has stopped is polled no more, and never moves again."""

from functools import cache

import pytest

from cosim.simulation import Outcome, Simulation
from cosim.trace import FRAMES, MESSAGES, POSES
from cosim.units import SLOT, Time
from tests.protocols.pseudonet.test_kills import Case
from tests.protocols.pseudonet.test_kills import run as run_over
from tests.protocols.pseudonet.test_runs import run, scenario

SEED = 2
STOPPERS = 4
"""Number of robots of the runs below; each is to cover a quarter of the floor."""


@cache
def four(departure: bool) -> tuple[Simulation, Outcome]:
    chosen = scenario("oscard", STOPPERS, "bluetooth", stop_ratio=0.25, departure=departure)
    return run(chosen, SEED, (FRAMES, MESSAGES, POSES))


def when(outcome: Outcome, kind: str) -> dict[int, Time]:
    """Return when each robot first sent a message of *kind*."""
    events = outcome.trace.columns("events")
    rows = zip(events["time_ns"], events["source"], events["event"], events["kind"], strict=True)
    return {robot: time for time, robot, event, said in reversed([*rows]) if (event, said) == ("MessageSent", kind)}


def departures(outcome: Outcome) -> dict[int, Time]:
    """Return when each robot that has departed did so."""
    events = outcome.trace.columns("events")
    rows = zip(events["time_ns"], events["source"], events["event"], events["reason"], strict=True)
    return {robot: time for time, robot, event, why in rows if (event, why) == ("Finished", "departed")}


def frames_to(outcome: Outcome, robot: int, after: Time) -> int:
    frames = outcome.trace.columns(FRAMES.name)
    rows = zip(frames["time_ns"], frames["destination"], strict=True)
    return sum(to == robot and time > after for time, to in rows)


@pytest.mark.slow
def test_a_robot_that_has_departed_is_polled_no_more() -> None:
    _, outcome = four(departure=True)
    left = departures(outcome)
    assert left
    for robot, at in left.items():
        assert at < 1_000_000_000 * outcome.simulated_s - 10_000 * SLOT  # the others go on for long
        # the exchange of its stop, whose end it has heard, ends for the master within one of 4M - 2 slots
        assert frames_to(outcome, robot, at + (4 * STOPPERS - 2) * SLOT) == 0
        assert frames_to(outcome, robot, 0) > 10
    heard = outcome.trace.columns(MESSAGES.name)
    for time, robot in zip(heard["time_ns"], heard["source"], strict=True):
        assert robot not in left or time <= left[robot] + (4 * STOPPERS - 2) * SLOT


@pytest.mark.slow
def test_a_robot_that_stops_and_stays_is_polled_to_the_end() -> None:
    _, outcome = four(departure=False)
    stops = when(outcome, "stop")
    assert stops
    assert not departures(outcome)
    for robot, at in stops.items():
        assert robot == 0 or frames_to(outcome, robot, at + (4 * STOPPERS - 2) * SLOT) > 100


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["boustrophedon", "spanning_tree"])
def test_a_robot_whose_tour_is_over_departs_not_as_it_has_still_to_make_room(algorithm: str) -> None:
    _, outcome = run(scenario(algorithm, 3, "ideal", departure=True))
    assert when(outcome, "stop")
    assert not departures(outcome)


@pytest.mark.slow
def test_a_robot_that_has_departed_stays_where_it_is_and_the_others_go_around_it() -> None:
    simulation, outcome = four(departure=True)
    poses = outcome.trace.columns(POSES.name)
    rows = [*zip(poses["time_ns"], poses["source"], poses["x_m"], poses["y_m"], strict=True)]
    for robot, at in departures(outcome).items():
        places = {(x, y) for time, who, x, y in rows if who == robot and time >= at}
        assert len(places) == 1
        machine = simulation.machines[robot]
        mine = machine.application.coordination.view.cells[robot]  # type: ignore[attr-defined]
        for other in simulation.machines:
            if not other.application.departed:  # type: ignore[attr-defined]
                assert mine in other.application.coordination.view.obstacles  # type: ignore[attr-defined]
    assert "RobotDropped" not in set(outcome.trace.columns("events")["event"])
    assert outcome.metrics["robots_dropped"] == 0  # who leaves of its own accord was not lost
    assert outcome.metrics["teams_lost"] == 0


@pytest.mark.slow
@pytest.mark.parametrize(("size", "piconet_size", "ratio"), [(5, 8, 0.15), (8, 4, 0.1)])
@pytest.mark.parametrize("seed", [1, 2])
def test_those_who_are_left_go_on_whatever_is_lost(
    size: int, piconet_size: int, ratio: float, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    parameters = {"algorithm": "oscard", "stop_ratio": ratio, "departure": True, "piconet_size": piconet_size}
    simulation, outcome = run_over(Case(seed, size, (), parameters), "links", monkeypatch, loss=0.2)
    applications = [machine.application for machine in simulation.machines]  # type: ignore[attr-defined]
    assert all(each.finished for each in applications)
    left = {each.me for each in applications if each.departed}
    stayed = [each for each in applications if not each.departed]
    assert left
    for each in stayed:
        assert set(each.broadcast.members) == set(range(size)) - left
    assert outcome.metrics["robots_dropped"] == outcome.metrics["teams_lost"] == 0
