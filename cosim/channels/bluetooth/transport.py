"""The lines from devices to their hosts: serial, of limited rate, with limited room for what waits for them.

A link may be faster than the line behind it (723 kb/s of DH5 packets into a UART of 115.2 kb/s). A device hands the
payloads that it has received to its host one after the other. What waits fills its receive buffer; while the buffer is
full, the header of the device's packets says STOP (FLOW = 0; Core v1.2, Vol 2 Part B, 6.4.3). Each peer has places of
its own.
Broadcasts, which have no FLOW, wait in the same line but take no place.
"""

from collections import defaultdict, deque
from collections.abc import Callable
from functools import partial

from cosim.channels.base import Arrival
from cosim.kernel import Kernel
from cosim.machine import Address
from cosim.units import S, Time


class Transport:
    """The lines between *size* devices and their hosts, *bps* bit/s each, with *room* places for payloads of a peer.

    *deliver* takes all that reaches hosts at one instant.
    """

    def __init__(
        self, kernel: Kernel, size: int, bps: int, room: int, deliver: Callable[[list[Arrival]], None]
    ) -> None:
        self._kernel = kernel
        self._bps = bps
        self._room = room
        self._deliver = deliver
        self._free_at: list[Time] = [0] * size
        self._under_way: dict[Time, list[Arrival]] = {}
        """Payloads by the instant at which they reach their hosts."""
        self._places: defaultdict[tuple[Address, Address], deque[Time]] = defaultdict(deque)
        """Instants at which the places that are taken become free, ascending, by (device, peer)."""

    def take(self, arrival: Arrival) -> None:
        """Take what a device has received now; its host gets it when the line has carried it, after all before."""
        device, payload, reception = arrival
        end = max(self._free_at[device], self._kernel.now) + max(1, -(-8 * len(payload) * S // self._bps))
        self._free_at[device] = end
        if not reception.broadcast:
            self._places[device, reception.source].append(end)
        if end not in self._under_way:
            self._under_way[end] = []
            self._kernel.at(end, partial(self._through, end))
        self._under_way[end].append(arrival)

    def full_until(self, device: Address, peer: Address) -> Time:
        """Return the instant from which *device* has room for a payload of *peer*: 0 if it has room now."""
        places = self._places[device, peer]
        while places and places[0] <= self._kernel.now:
            places.popleft()
        return places[0] if len(places) >= self._room else 0

    def clear(self, device: Address) -> None:
        """Forget what *device* holds: it is switched off."""
        for arrivals in self._under_way.values():
            arrivals[:] = [arrival for arrival in arrivals if arrival[0] != device]
        for pair in self._places:
            if pair[0] == device:
                self._places[pair].clear()
        self._free_at[device] = 0

    def _through(self, end: Time) -> None:
        self._deliver(self._under_way.pop(end))
