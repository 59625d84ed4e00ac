"""The page on which a person calls plays: ``cosim playbook`` runs a scenario that waits for its operator.

What is said at the consoles is the protocol's: here it is passed on unread, and only the page knows its words.
"""

from typing import Final

from cosim.scenario import Scenario
from cosim.web.live import Live

PLAYBOOK: Final = "playbook.html"
"""The page, of :mod:`cosim.web.pages`."""


def attended(scenario: Scenario, seed: int, playing: bool = True, speed: float = 1.0) -> Live:
    """Begin a run of *scenario* that lasts as long as its operator may speak: until it is closed.

    Raise UserError for a scenario that cannot be set up.
    """
    return Live(scenario, seed, playing, speed, attended=True)
