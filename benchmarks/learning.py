"""What a step of an environment for learning costs an agent: eight robots over Bluetooth, silent or with messages."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.workloads import Work
from cosim.env import parallel_env
from cosim.scenario import build

ROBOTS = 8
STEPS = 400


def agent_steps(octets: int) -> Callable[[int], Work]:
    """Return the work of steps of all agents that drive ahead, and say so many *octets* each step, in agent-steps."""

    def prepare(seed: int) -> Work:
        parameters = {"message_octets": octets, "transport": {"links": {}}}
        plain = {
            "duration_s": 120,  # the links are up within half a minute
            "floorplan": {"map": "walls", "bounds_m": [0, 0, 16, 16]},
            "team": {"size": ROBOTS, "body": {"drive": "differential"}},
            "channel": {"kind": "bluetooth"},
            "protocol": {"use": "agents", "parameters": parameters},
        }
        env = parallel_env(build(plain, "learning", Path()))
        env.reset(seed=seed)
        space = env.action_space(env.agents[0])
        action = np.zeros(space.shape or (), np.float32)
        action[0] = 0.3
        action[2:3] = 1.0  # the flag of the message, if there are any
        actions = dict.fromkeys(env.agents, action)

        def work() -> float:
            for _ in range(STEPS):
                env.step(actions)
            assert env.agents, "the episode goes on"
            return STEPS * ROBOTS

        return work

    return prepare
