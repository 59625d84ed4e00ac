"""Transports without any air: what tests tell one, and what it sends."""

from typing import Any

from cosim.machine import Address, Connected, Fate, Outcome, Outgoing, Reception, Role
from cosim.units import Time
from protocols.transport.frames import ALL, Frame, Publication, decode, encode
from protocols.transport.parameters import TransportParameters
from protocols.transport.transport import Transport

PLAN = bytes(number * 7919 % 251 for number in range(18_000))
"""A message as long as a plan."""
TIMES = {"patience_s": 6.0, "page_s": 5.0, "page_most_s": 20.0, "silence_s": 15.0, "alone_s": 10.0, "stagger_s": 8.0}
"""Of links, for tests of piconets."""


def transport(me: Address = 0, size: int = 3, start: Time = 0, **parameters: Any) -> Transport:
    return Transport(me, size, TransportParameters.model_validate(parameters), start)


def hears(robot: Transport, author: Address, body: Any, now: Time = 0, incarnation: int = 0) -> None:
    to = ALL if isinstance(body, Publication) else robot.me
    robot.receive(encode(Frame(author, to, incarnation, body)), Reception(author, to == ALL), now)


def all_sent(robot: Transport, now: Time) -> list[Frame]:
    """Return what it sends until it waits, by a radio that sends everything at once."""
    found: list[Frame] = []
    while items := [item for item in robot.drain() if isinstance(item, Outgoing)]:
        for item in items:
            found.append(decode(item.payload))
            assert item.token is not None
            robot.link(Fate(item.token, Outcome.DELIVERED), now)
    return found


# ---------------------------------------------------------------- in a piconet


def bluetooth_transport(me: Address, size: int = 4, **times: float) -> Transport:
    robot = transport(me, size, links=TIMES | times)
    robot.drain()
    return robot


def linked(robot: Transport, role: Role, *peers: Address) -> Transport:
    for peer in peers:
        robot.link(Connected(peer, role), 0)
    robot.drain()
    return robot


def sent(robot: Transport) -> list[tuple[Address, Frame]]:
    return [(item.destination, decode(item.payload)) for item in robot.drain() if isinstance(item, Outgoing)]
