"""Whether the machines of a protocol can live apart: each in a process of its own, with a knowledge of its own.

What ``prepare`` returns is handed to all machines. Mostly nobody changes it, or it only remembers what each would
compute for itself. But it may be a memory that all have in common, as the one map of exploration is, by which they know
of each other without a message. So the beginning of the run is made twice, over the ideal channel: as always, and with
machines of which each was made with a preparation of its own. If anything comes out otherwise, they share state.

The rehearsal also compiles the kernels that the run needs.
"""

import pickle
from typing import Final

from cosim.errors import UserError
from cosim.live.handing import handed
from cosim.scenario import Scenario
from cosim.simulation import Simulation
from cosim.trace import POSES
from cosim.units import S, Time

REHEARSED: Final[Time] = 10 * S
"""The length of a rehearsal, simulated time."""


def check_apart(scenario: Scenario, seed: int) -> None:
    """Raise UserError unless the machines of *scenario*, over whatever channel it names, can be processes."""
    use = scenario.protocol.use
    together, alone = Simulation(scenario, seed, (POSES,)), Simulation(scenario, seed, (POSES,))
    for robot, node in enumerate(alone.nodes):
        node.machine = alone.machines[robot] = Simulation(scenario, seed).machines[robot]
    if _begun(together) != _begun(alone):
        raise UserError(f"protocol.use: the machines of {use} share state, and live each is a process of its own")
    try:
        for machine in together.machines:
            pickle.loads(handed(machine))
    except (pickle.PicklingError, TypeError, AttributeError) as error:
        raise UserError(f"protocol.use: the machines of {use} cannot go from process to process: {error}") from None


def _begun(simulation: Simulation) -> tuple[str, str]:
    """Return what comes out of the beginning of a run: digests of its events and metrics, and of where robots were."""
    simulation.begin()
    simulation.advance(min(REHEARSED, simulation.scenario.duration))
    outcome = simulation.outcome()
    return outcome.digest, outcome.trace.digest([POSES.name])
