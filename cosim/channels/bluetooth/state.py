"""What the parts of one piconet share: its parameters and its state, handed on whole.

A piconet is one object in several files. ``piconet`` has its links and what hosts hand in, ``schedule`` chooses what
the master sends next, ``slots`` sends it, ``modes`` has hold, sniff and park, ``afh`` the adapted hop set. All of them
work on one ``PiconetState``.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Final, Literal, NamedTuple, TypeAlias

from cosim.channels.base import Arrival
from cosim.channels.bluetooth import polling
from cosim.channels.bluetooth.links import Links, Parking
from cosim.channels.bluetooth.packets import ACL, PacketType
from cosim.channels.bluetooth.queues import LinkEvents, Queues
from cosim.channels.bluetooth.radio import Air
from cosim.channels.clock import NativeClock
from cosim.kernel import WAKE, Kernel
from cosim.machine import Address, LinkEvent
from cosim.units import S, Time

Deliver: TypeAlias = Callable[[Iterable[Arrival], Iterable[tuple[Address, LinkEvent]]], None]
"""Called with the payloads and the link events that reach hosts at one instant."""
Scheduler: TypeAlias = Literal["lazy", "round_robin", "exhaustive", "backlog"]
SCHEDULERS: Final[dict[Scheduler, int]] = {
    "lazy": polling.LAZY,
    "round_robin": polling.ROUND_ROBIN,
    "exhaustive": polling.EXHAUSTIVE,
    "backlog": polling.BACKLOG,
}
"""The numbers by which the arithmetic of slots knows them."""


class PiconetSettings(NamedTuple):
    """Parameters of a connected piconet."""

    types: tuple[PacketType, ...] = tuple(ACL.values())
    """Packet types in use."""
    n_bc: int = 1
    """Number of times that a broadcast is sent."""
    t_poll_slots: int = 40
    """Slots from one packet to a slave until the next is due; even."""
    supervision: Time = 20 * S
    """Silence after which a side takes the link for lost."""
    scheduler: Scheduler = "lazy"
    """Rule by which the master chooses the slave that it addresses."""
    queue: int | None = None
    """Number of payloads that a device holds; None for any number."""
    flush: Time | None = None
    """Time that a payload may wait for its acknowledgement; None for ever."""
    park_interval_slots: int = 2048
    """Slots from one beacon window for parked slaves to the next; even."""
    park_window_slots: int = 64
    """Slots of a beacon window; even."""
    best_packets: bool = False
    """True if payloads go in the packet type of the best expected rate, else in the smallest that holds them."""
    afh: tuple[Time, Time] | None = None
    """Interval at which the hop set is adapted, and time until a bad channel is tried again; None for the basic one."""
    idle_frames: bool = False
    """True if idle POLL and NULL packets are recorded as well, where frames are recorded."""


@dataclass(frozen=True, slots=True)
class PiconetState:
    """The state of one piconet: its members, the payloads that wait, and the kernel, air and clock that it runs on."""

    kernel: Kernel
    air: Air
    clock: NativeClock
    """The master's clock, on which slots are counted."""
    settings: PiconetSettings
    links: Links
    parking: Parking
    queues: Queues
    deliver: Deliver

    def report(self, events: LinkEvents) -> None:
        """Deliver *events* to their hosts in a new kernel event at this instant."""
        if events:  # WAKE is the last phase before AIR, so this may be called in any that comes before
            self.kernel.at(self.kernel.now, partial(self.deliver, (), events), WAKE)
