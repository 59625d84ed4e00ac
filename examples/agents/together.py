"""A scripted policy, an example of an environment: robots that come together by telling each other where they are.

Each robot says its position once a second, eight octets. It drives towards the middle of itself and of those that it
has heard, as they said last, and stands when it is near. Nobody sees anybody: what is known has come by the channel.
"""

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

from cosim.env import parallel_env
from cosim.scenario import load

NEAR_M = 1.5
"""Distance from the middle at which a robot stands."""
PERIOD = 10
"""Steps from one message of a robot to the next."""


def spread_m(positions_m: Any) -> float:
    """Return how far the farthest robot is from the middle of all."""
    away_m = positions_m - positions_m.mean(axis=0)
    return float(np.sqrt((away_m**2).sum(axis=1)).max())


def reward(before: Any, after: Any) -> list[float]:
    """Reward all robots for each metre that the team is less spread than before."""
    return [spread_m(before.positions_m) - spread_m(after.positions_m)] * len(after.alive)


def act(row: Any, layout: Any, says: bool) -> Any:
    """Return the action of a robot that observes *row*."""
    x_m, y_m, heading_rad = row[layout.columns["pose"]]
    told = {}
    for source, _, *octets in row[layout.columns["heard"]].reshape(layout.inbox, -1):
        if source >= 0 and source not in told:  # the latest of each stands first
            told[source] = np.array(octets, np.uint8).view(np.float32)
    places_m = np.array([(x_m, y_m), *told.values()])
    dx_m, dy_m = places_m.mean(axis=0) - (x_m, y_m)
    turn_rad = math.remainder(math.atan2(dy_m, dx_m) - heading_rad, 2 * math.pi)
    drives = told and math.hypot(dx_m, dy_m) > NEAR_M
    speed_mps = 0.5 if drives and abs(turn_rad) < 0.5 else 0.0
    turn_radps = turn_rad if drives else 0.0
    octets = np.array([x_m, y_m], np.float32).view(np.uint8)
    return np.array([speed_mps, turn_radps, 1.0 if says else -1.0, *octets], np.float32)


def play(sets: list[str], seed: int) -> dict[str, float]:
    """Play one episode, and return how far apart the robots were and are, and when the first step was."""
    env = parallel_env(load(Path(__file__).with_suffix(".yaml"), sets), reward=reward)
    observations, infos = env.reset(seed=seed)
    began_s, apart_m, gained_m, steps = infos["robot_0"]["time_s"], spread_m(env.truth.positions_m), 0.0, 0
    while env.agents:
        actions = {
            agent: act(observations[agent], layout, says=(steps + robot) % PERIOD == 0)
            for robot, (agent, layout) in enumerate(zip(env.agents, env.layouts, strict=True))
        }
        observations, rewards, *_ = env.step(actions)
        gained_m += rewards["robot_0"]
        steps += 1
    return {"began_s": began_s, "apart_m": apart_m, "together_m": apart_m - gained_m}


if __name__ == "__main__":
    for name, value in play(sys.argv[1:], seed=1).items():
        print(f"{name:12}{value:.2f}")
