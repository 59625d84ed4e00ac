"""What a robot-step of goal reflection costs: sense, decide, move and talk, in the arms of ``reflection_tables``."""

from collections.abc import Callable
from pathlib import Path

import experiments
from benchmarks.workloads import Work
from cosim.documents import read_yaml
from cosim.scenario import build
from cosim.simulation import Simulation
from cosim.units import S

FOLDER = Path(next(iter(experiments.__path__))) / "reflection_tables"
FLOORS = ("../floors/corridor.yaml", "../floors/nested.yaml")
SIZES = (1, 2, 3, 4)
SIMULATED = 60 * S


def robot_steps(algorithm: str) -> Callable[[int], Work]:
    """Return the work of a minute of each floor and team size of the experiment, in robot-steps."""

    def prepare(seed: int) -> Work:
        plain = read_yaml(FOLDER / "sweep.yaml")["scenario"]
        plain["protocol"]["parameters"]["algorithm"] = algorithm
        runs: list[Simulation] = []
        for floor in FLOORS:
            for size in SIZES:
                arm = plain | {"floorplan": {"map": floor}, "team": plain["team"] | {"size": size}}
                runs.append(Simulation(build(arm, "sweep.yaml", FOLDER), seed))

        def work() -> float:
            steps = 0.0
            for run in runs:
                run.begin()
                run.kernel.run(SIMULATED)
                steps += len(run.nodes) * (run.fleet.time // run.fleet.tick)
            return steps

        return work

    return prepare
