"""Couriers without any air: what tests tell one, and what it sends."""

from typing import Any

from cosim.machine import Address, Connected, Fate, Outcome, Outgoing, Reception, Role
from cosim.units import Time
from protocols.transport.frames import ALL, Bulletin, Frame, decode, encode
from protocols.transport.parameters import CourierParameters
from protocols.transport.transport import Courier

PLAN = bytes(number * 7919 % 251 for number in range(18_000))
"""A letter as long as a plan."""
TIMES = {"patience_s": 6.0, "page_s": 5.0, "page_most_s": 20.0, "silence_s": 15.0, "alone_s": 10.0, "stagger_s": 8.0}
"""Of links, for tests of piconets."""


def courier(me: Address = 0, size: int = 3, start: Time = 0, **parameters: Any) -> Courier:
    return Courier(me, size, CourierParameters.model_validate(parameters), start)


def hears(robot: Courier, author: Address, message: Any, now: Time = 0, life: int = 0) -> None:
    to = ALL if isinstance(message, Bulletin) else robot.me
    robot.receive(encode(Frame(author, to, life, message)), Reception(author, to == ALL), now)


def all_sent(robot: Courier, now: Time) -> list[Frame]:
    """Return what it sends until it waits, by a radio that sends everything at once."""
    found: list[Frame] = []
    while items := [item for item in robot.drain() if isinstance(item, Outgoing)]:
        for item in items:
            found.append(decode(item.payload))
            assert item.token is not None
            robot.link(Fate(item.token, Outcome.DELIVERED), now)
    return found


# ---------------------------------------------------------------- in a piconet


def bluetooth_courier(me: Address, size: int = 4, **times: float) -> Courier:
    robot = courier(me, size, links=TIMES | times)
    robot.drain()
    return robot


def linked(robot: Courier, role: Role, *peers: Address) -> Courier:
    for peer in peers:
        robot.link(Connected(peer, role), 0)
    robot.drain()
    return robot


def sent(robot: Courier) -> list[tuple[Address, Frame]]:
    return [(item.destination, decode(item.payload)) for item in robot.drain() if isinstance(item, Outgoing)]
