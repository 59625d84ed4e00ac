"""What will happen on one 802.11 channel: events in the order (time, phase, insertion), as the kernel has them."""

from typing import Final

from cosim.channels.adhoc.state import NONE, Network
from cosim.jit import njit
from cosim.units import Time

CONTEND: Final = 0
"""A station that has a packet looks at the medium."""
MAY_SEND: Final = 1
"""Its back-off is over."""
SENT: Final = 2
"""Its frame is over."""
GIVE_UP: Final = 3
"""No answer has come in time."""
ANSWER: Final = 4
"""It sends the answer that it owes."""
SEND_DATA: Final = 5
"""It sends the DATA that a CTS has asked for."""
ARRIVE: Final = 6
"""Frames that began a propagation delay ago begin to arrive."""
LEAVE: Final = 7
"""A frame has arrived to its end."""

ORDER_BITS: Final = 48
"""Number of low bits of a rank that are the order of insertion; above them is the phase."""


@njit(cache=True, borrows=True)
def push(network: Network, time: Time, phase: int, kind: int, who: int) -> int:
    """Have an event of that *kind* happen to *who*, a station or a frame; return its number."""
    common, agenda = network.common[0], network.agenda
    order: int = common.orders
    common.orders += 1
    rank = phase << ORDER_BITS | order
    at = common.events
    common.events += 1
    while at > 0:
        above = agenda[(at - 1) >> 1]
        if above.time < time or (above.time == time and above.rank < rank):
            break
        agenda[at] = above
        at = (at - 1) >> 1
    event = agenda[at]
    event.time, event.rank, event.kind, event.who = time, rank, kind, who
    event.life = network.stations[who].life if kind < ARRIVE else NONE
    return order


@njit(cache=True, borrows=True)
def drop_first(network: Network) -> None:
    """Take the first event off the agenda."""
    common, agenda = network.common[0], network.agenda
    common.events -= 1
    last = agenda[common.events]
    at = 0
    while 2 * at + 1 < common.events:
        low = 2 * at + 1
        if low + 1 < common.events and _precedes(network, low + 1, low):
            low += 1
        if last.time < agenda[low].time or (last.time == agenda[low].time and last.rank < agenda[low].rank):
            break
        agenda[at] = agenda[low]
        at = low
    agenda[at] = last


@njit(cache=True, borrows=True)
def _precedes(network: Network, one: int, other: int) -> bool:
    one_event, other_event = network.agenda[one], network.agenda[other]
    if one_event.time != other_event.time:
        return bool(one_event.time < other_event.time)
    return bool(one_event.rank < other_event.rank)
