"""How long a team stands still when one of its robots dies: a run of robots, and what its events show of the death.

The machines do not know when a robot has died, only when they have noticed; the run does. So the times are read from
the trace: a survivor has *noticed* when it reports that it has lost its team, or that its team goes on without the
dead, and has *resumed* with its first step in a team that was called up after the death.
"""

import math
from collections.abc import Mapping
from typing import Any, Final

from pydantic import Field

from cosim.experiment import experiment_function
from cosim.faults.settings import KillSettings
from cosim.machine import Address
from cosim.scenario import Scenario
from cosim.settings import Count, Seconds, Settings
from cosim.simulation import simulate
from cosim.trace import Field as Column
from cosim.trace import Trace
from cosim.units import Time, from_seconds, to_seconds
from protocols.pseudonet.events import RobotDropped, Stepped, TeamFormed, TeamLost

COLUMNS: Final = (
    Column("notice_s", "float", "s", "from the death until a survivor has noticed, mean over the survivors that did"),
    Column("resume_s", "float", "s", "from the death until a survivor steps again, mean over the survivors that did"),
    Column("last_resume_s", "float", "s", "the same, of the survivor that was last"),
    Column("idle_survivors", "float", "1", "survivors that never stepped again"),
    Column("teams", "float", "1", "teams that the survivors were in when they ended; a robot that is alone is one"),
    Column("coverage", "float", "1", "share of the cells that survivors can reach around the dead that were entered"),
    Column("time_to_cover_s", "float", "s", "when all of them were covered; NaN if never"),
    Column("end_s", "float", "s", "when the last survivor had finished, or the run was over"),
    Column("setup_s", "float", "s", "from the start until a robot was called up for the first time, mean over robots"),
    Column(
        "reform_s", "float", "s", "from noticing the loss of a team until the next step, mean over robots and losses"
    ),
    Column("teams_lost", "float", "1", "how often a robot has lost its team, summed over robots"),
    Column("steps", "float", "1", "steps of the robot that has made most"),
)
_OF_THE_RUN: Final = ("coverage", "time_to_cover_s", "setup_s", "reform_s", "teams_lost", "steps")


class Parameters(Settings):
    """A run of Pseudonet, and the robot that dies in it."""

    scenario: Scenario = Field(description="the run, without faults or with others")
    robot: Count = Field(default=0, ge=0, description="who dies; the first master is robot 0")
    at_s: Seconds | None = Field(default=None, ge=0, description="s, when it dies; nobody does if not given")


@experiment_function
def measure(parameters: Mapping[str, Any], seed: int) -> dict[str, float]:
    """Make the run and return ``COLUMNS``; the times after the death are NaN where no robot dies.

    Raise UserError for a run that cannot be set up.
    """
    given = Parameters.model_validate(parameters)
    scenario = given.scenario
    if given.at_s is not None:
        death = KillSettings(robot=given.robot, at_s=given.at_s)
        plain = scenario.model_dump(mode="json")
        plain["faults"] = [*plain["faults"], death.model_dump(mode="json")]
        scenario = Scenario.model_validate(plain)  # it says so if that robot, or that time, does not exist
    outcome = simulate(scenario, seed)
    survivors = set(range(scenario.team.size)) - {fault.robot for fault in scenario.faults if fault.kind == "kill"}
    of_the_run = {name: outcome.metrics[name] for name in _OF_THE_RUN}
    ends = {"end_s": outcome.simulated_s, "teams": float(teams(outcome.trace, survivors))}
    if given.at_s is None:
        nothing = dict.fromkeys(("notice_s", "resume_s", "last_resume_s", "idle_survivors"), math.nan)
        return of_the_run | ends | nothing
    return of_the_run | ends | after_death(outcome.trace, survivors, from_seconds(given.at_s))


def after_death(trace: Trace, survivors: set[Address], died: Time) -> dict[str, float]:
    """Return what the events of *trace* show of the time after *died*, in ns, with the names of ``COLUMNS``."""
    noticed: dict[Address, Time] = {}
    regrouped: set[Address] = set()
    resumed: dict[Address, Time] = {}
    events = trace.columns("events")
    for at, robot, event in zip(events["time_ns"], events["source"], events["event"], strict=True):
        if at < died or robot not in survivors:
            continue
        if event in (TeamLost.__name__, RobotDropped.__name__):
            noticed.setdefault(robot, at - died)
        elif event == TeamFormed.__name__:
            regrouped.add(robot)
        elif event == Stepped.__name__ and robot in regrouped:
            resumed.setdefault(robot, at - died)
    return {
        "notice_s": _mean_s(list(noticed.values())),
        "resume_s": _mean_s(list(resumed.values())),
        "last_resume_s": to_seconds(max(resumed.values())) if resumed else math.nan,
        "idle_survivors": float(len(survivors - resumed.keys())),
    }


def teams(trace: Trace, survivors: set[Address]) -> int:
    """Return in how many teams the *survivors* ended, from the sizes that they received last.

    As many robots as a team has members have received its size: each that received k makes up 1/k of a team.
    The dead receive nothing any more, and are not in the last team of a robot that has noticed.
    """
    size: dict[Address, int] = {}
    events = trace.columns("events")
    for robot, event, members in zip(events["source"], events["event"], events["size"], strict=True):
        if robot in survivors and event == TeamFormed.__name__:
            size[robot] = members
    return round(sum(1 / members for members in size.values()))


def _mean_s(times: list[Time]) -> float:
    return to_seconds(sum(times)) / len(times) if times else math.nan
