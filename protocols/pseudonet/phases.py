"""The state diagram of the application (paper 003, Figs 4 and 5) as a table.

A robot that loses its team goes back to the initialisation phase, until it is called up again.
"""

from enum import Enum, auto
from typing import Final


class Phase(Enum):
    """The four phases of Figs 4 and 5; robots drive while they wait for the next exchange."""

    INITIALISATION = auto()
    STATE_EXCHANGE = auto()
    DECISION = auto()
    TERMINATION = auto()


class Input(Enum):
    """What moves the application from phase to phase."""

    TEAM = auto()
    """A team, or a new one, is called up."""
    ARRIVED = auto()
    """The robot stands in the cell that it was to go to."""
    EXCHANGED = auto()
    DISAGREED = auto()
    AGREED = auto()
    DONE = auto()
    """Everything is covered, or the step limit is reached."""
    BROKEN = auto()
    """The team is no more, or goes on without this robot."""


TABLE: Final = {
    (Phase.INITIALISATION, Input.TEAM): ("answer_roll_call", Phase.STATE_EXCHANGE),
    (Phase.INITIALISATION, Input.ARRIVED): ("stand", Phase.INITIALISATION),
    (Phase.INITIALISATION, Input.BROKEN): ("stand", Phase.INITIALISATION),
    (Phase.STATE_EXCHANGE, Input.TEAM): ("answer_roll_call", Phase.STATE_EXCHANGE),
    (Phase.STATE_EXCHANGE, Input.ARRIVED): ("move_next_step", Phase.STATE_EXCHANGE),
    (Phase.STATE_EXCHANGE, Input.EXCHANGED): ("decide", Phase.DECISION),
    (Phase.STATE_EXCHANGE, Input.BROKEN): ("stand_by", Phase.INITIALISATION),
    (Phase.DECISION, Input.DISAGREED): ("talk_on", Phase.STATE_EXCHANGE),
    (Phase.DECISION, Input.AGREED): ("drive", Phase.STATE_EXCHANGE),
    (Phase.DECISION, Input.DONE): ("finish", Phase.TERMINATION),
    (Phase.TERMINATION, Input.TEAM): ("stand", Phase.TERMINATION),
    (Phase.TERMINATION, Input.ARRIVED): ("stand", Phase.TERMINATION),
    (Phase.TERMINATION, Input.EXCHANGED): ("stand", Phase.TERMINATION),
    (Phase.TERMINATION, Input.BROKEN): ("stand", Phase.TERMINATION),
}
