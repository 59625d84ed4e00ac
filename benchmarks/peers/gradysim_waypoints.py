"""GrADyS-SIM NextGen's part of waypoints.py: nodes that walk to random points and send a payload a second each.

Runs in GrADyS-SIM's environment. One line of JSON on stdout: what the run took, in seconds of processor time, and what
was sent and received.
"""

import argparse
import json
import random
from time import process_time

from gradysim.protocol.interface import IProtocol
from gradysim.protocol.messages.communication import CommunicationCommand, CommunicationCommandType
from gradysim.protocol.messages.mobility import SetSpeedMobilityCommand
from gradysim.protocol.plugin.random_mobility import RandomMobilityConfig, RandomMobilityPlugin
from gradysim.simulator.handler.communication import CommunicationHandler, CommunicationMedium
from gradysim.simulator.handler.mobility import MobilityConfiguration, MobilityHandler
from gradysim.simulator.handler.timer import TimerHandler
from gradysim.simulator.simulation import SimulationBuilder, SimulationConfiguration

RANGE_M = 51
UPDATE_S = 0.1


def walker(side: float, counts: dict[str, int]) -> type[IProtocol]:
    """Return the protocol of nodes in a square of *side* metres, who add to *counts* what they send and receive."""

    class Walker(IProtocol):
        def initialize(self) -> None:
            bounds = (0, side)
            walk = RandomMobilityPlugin(self, RandomMobilityConfig(x_range=bounds, y_range=bounds, z_range=(0, 0)))
            self.provider.send_mobility_command(SetSpeedMobilityCommand(1.0))
            walk.initiate_random_trip()
            self.provider.schedule_timer("", self.provider.current_time() + random.random())

        def handle_timer(self, timer: str) -> None:
            counts["sent"] += 1
            self.provider.send_communication_command(
                CommunicationCommand(CommunicationCommandType.BROADCAST, "x" * 100)
            )
            self.provider.schedule_timer("", self.provider.current_time() + 1)

        def handle_packet(self, message: str) -> None:
            counts["received"] += 1

        def handle_telemetry(self, telemetry: object) -> None:
            pass

        def finish(self) -> None:
            pass

    return Walker


def main() -> None:
    """Simulate nodes and tell what it took."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--nodes", type=int, required=True)
    parser.add_argument("--side", type=float, required=True)
    parser.add_argument("--seconds", type=float, required=True)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    random.seed(given.seed)  # it has no other generator
    counts = {"sent": 0, "received": 0}
    builder = SimulationBuilder(SimulationConfiguration(duration=given.seconds, execution_logging=False))
    builder.add_handler(TimerHandler())
    builder.add_handler(CommunicationHandler(CommunicationMedium(transmission_range=RANGE_M)))
    builder.add_handler(MobilityHandler(MobilityConfiguration(update_rate=UPDATE_S)))
    node = walker(given.side, counts)
    for _ in range(given.nodes):
        builder.add_node(node, (random.uniform(0, given.side), random.uniform(0, given.side), 0))
    simulation = builder.build()
    started = process_time()
    simulation.start_simulation()
    seconds = process_time() - started
    print(json.dumps({"seconds": seconds, **counts, "received_per_payload": counts["received"] / counts["sent"]}))


if __name__ == "__main__":
    main()
