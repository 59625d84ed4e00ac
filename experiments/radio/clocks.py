"""What a device knows of another's clock from an inquiry, for experiments that page without one."""

from cosim.channels.bluetooth.clock import NativeClock
from cosim.channels.bluetooth.inquiry import CLOCK_RANGE
from cosim.channels.bluetooth.scanning import first_transmission
from cosim.units import Time


def known_offset(pager: NativeClock, paged: NativeClock, now: Time) -> int:
    """Return how far *paged* is ahead of *pager* in ticks, as an inquiry at *now* would have reported it to a host.

    An FHS carries bits 27-2 of a clock, so the offset is a multiple of 4.
    """
    first = first_transmission(pager, now)
    return ((paged.tick(pager.time_of(first)) - first) & ~3) % CLOCK_RANGE
