"""The machine of a robot that may have to find out where it is: all that it senses is first told in the map's frame."""

import numpy as np

from cosim.machine import Address
from cosim.observation import Observation
from cosim.units import Time
from protocols.deployment.localization.positioning import positioning_of
from protocols.deployment.parameters import Parameters
from protocols.deployment.runner import Runner
from protocols.deployment.setup import Setup


class LocatedRunner(Runner):
    """Drives and reports where it takes itself to be."""

    def __init__(
        self, parameters: Parameters, setup: Setup, me: Address, start: Time, stream: np.random.Generator
    ) -> None:
        super().__init__(parameters, setup, me, start)
        self.positioning = positioning_of(parameters, setup, me, stream, self._events.append)

    def observe(self, observation: Observation, now: Time) -> None:
        """Drive on, look who is there, and tell all where this robot takes itself to be."""
        super().observe(self.positioning.locate(observation), now)
