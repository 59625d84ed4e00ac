"""Which targets the explorers have: given, or drawn in the middle of rooms (paper 000, section 6)."""

from cosim.errors import UserError
from cosim.randomness import Draws
from protocols.reflection.parameters import Parameters
from protocols.reflection.setup import Point

ROOM, ALONG, ACROSS = range(3)
"""Purposes of draws."""


def targets(parameters: Parameters, seed: int) -> tuple[tuple[Point, ...], ...]:
    """Return the targets of each explorer, in the world's frame, metres; raise UserError where there are none.

    *seed* is that of the run, which decides on the set if the parameters do not.
    """
    if parameters.targets is not None:
        if len(parameters.targets) != parameters.explorers:
            raise UserError(
                f"protocol.parameters.targets: {len(parameters.targets)} lists, expected one for each of the "
                f"{parameters.explorers} explorers"
            )
        return parameters.targets
    if parameters.explorers and len(parameters.rooms) < 2:
        raise UserError("protocol.parameters.rooms: expected at least two rooms, or targets")
    return tuple(
        drawn(parameters, seed if parameters.target_set is None else parameters.target_set, explorer)
        for explorer in range(parameters.explorers)
    )


def drawn(parameters: Parameters, target_set: int, explorer: int) -> tuple[Point, ...]:
    """Return random targets: rooms are equally likely, but no target lies in the room of the one before.

    A set depends on its number and the explorer's only: every team, algorithm and channel has the same targets.
    """
    draws = Draws(target_set, "reflection", "targets", explorer)
    rooms = parameters.rooms
    spread = parameters.target_spread_m
    found: list[Point] = []
    room = -1
    for number in range(parameters.target_count):
        if room < 0:
            room = draws.below(len(rooms), number, ROOM)
        else:
            room = (room + 1 + draws.below(len(rooms) - 1, number, ROOM)) % len(rooms)
        x, y = rooms[room]
        dx, dy = (spread * (2.0 * draws.uniform(number, purpose) - 1.0) for purpose in (ALONG, ACROSS))
        found.append((x + dx, y + dy))
    return tuple(found)
