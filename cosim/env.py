"""A run as an environment for reinforcement learning: PettingZoo's ``ParallelEnv``, over the scenario's real channel.

The scenario's protocol is one whose machines do as they are ordered, such as ``agents``. The environment itself is in
:mod:`cosim.parallel`, which needs the libraries of the extra ``gym``; they are loaded when an environment is made.
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final, Literal

from cosim.installed import check_libraries
from cosim.scenario import Scenario

if TYPE_CHECKING:
    from cosim.parallel import TeamEnv

GYM_NEEDS: Final = ("gymnasium>=1.0", "pettingzoo>=1.25")
"""The extra ``gym`` of pyproject.toml."""


def parallel_env(
    scenario: Scenario,
    *,
    reward: Callable[[Any, Any], Sequence[float]] | None = None,
    motion: Literal["drive", "moves"] = "drive",
    ticks_per_step: int = 1,
    sightings: int | None = None,
    setup_s: float = 30.0,
) -> "TeamEnv":
    """Return *scenario* as a ParallelEnv, whose agents are its robots: robot_0, robot_1 and so on.

    A step is *ticks_per_step* ticks of the world. *reward* is given two :class:`cosim.parallel.Truth`, of before and
    after it, and returns a number for each robot; without it all are 0. With the *motion* "drive" an action begins with
    a linear and an angular velocity, with "moves" it is one of :data:`cosim.parallel.MOVES`. An observation tells where
    up to so many others are seen (*sightings*; by default all, but at most 8). Over radios that need links ``reset``
    has the transport make them, for at most *setup_s* of simulated time.

    Raise UserError if libraries are missing, if the protocol is none that takes orders, or for numbers out of range.
    """
    check_libraries("environments", GYM_NEEDS)
    from cosim.parallel import TeamEnv, Terms

    return TeamEnv(scenario, Terms(reward, motion, ticks_per_step, sightings, setup_s))
