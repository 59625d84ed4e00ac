"""The frames of one 802.11 channel: how they get from their senders to all stations that they reach, and what is told.

A frame begins to arrive everywhere after the same delay, so the frames that arrive at a station do so in one order for
all stations; a list has them in that order.
"""

from cosim.channels.adhoc.agenda import ARRIVE, push
from cosim.channels.adhoc.state import DONE, NONE, RECEIVED, Network, Record
from cosim.jit import njit
from cosim.kernel import DELIVER
from cosim.units import Time


@njit(cache=True, borrows=True)
def new_frame(network: Network) -> int:
    """Return the number of a frame that is free."""
    common = network.common[0]
    frame: int = common.free_frame
    common.free_frame = network.frames[frame].next
    return frame


@njit(cache=True, borrows=True)
def begin(network: Network, number: int, now: Time) -> None:
    """Put frame *number*, which begins *now*, on the air."""
    common, frames = network.common[0], network.frames
    frame = frames[number]
    frame.begin, frame.whole, frame.next = now, True, NONE
    if frame.packet != NONE:
        packet = network.packets[frame.packet]
        packet.users += 1
        packet.begun = min(packet.begun, now)
    common.frames += 1
    common.frames_under_way += 1
    if len(network.begun) > 0:
        begun = network.begun[common.begun]
        begun.begin, begun.end, begun.source = now, now + frame.form.duration, frame.source
        common.begun += 1
    last = common.last_begun
    if last == NONE or frames[last].begin != now:  # frames that begin at one instant arrive in one event
        push(network, now + common.delay, DELIVER, ARRIVE, NONE)
    if last == NONE:
        common.first_begun = number
    else:
        frames[last].next = number
    common.last_begun = number


@njit(cache=True, borrows=True)
def next_arrival(network: Network, now: Time) -> int:
    """Return the frame from the station of lowest address among those that begin to arrive *now*; NONE if none does."""
    common, frames = network.common[0], network.frames
    begun, found, before_found, before = now - common.delay, NONE, NONE, NONE
    number = common.first_begun
    while number != NONE and frames[number].begin == begun:
        if found == NONE or frames[number].source < frames[found].source:
            found, before_found = number, before
        before, number = number, frames[number].next
    if found == NONE:
        return NONE
    if before_found == NONE:
        common.first_begun = frames[found].next
    else:
        frames[before_found].next = frames[found].next
    if common.last_begun == found:
        common.last_begun = before_found
    frames[found].next = NONE
    if common.last_there == NONE:
        common.first_there = found
    else:
        frames[common.last_there].next = found
    common.last_there = found
    return found


@njit(cache=True, borrows=True)
def without_row(network: Network, now: Time) -> int:
    """Return the sender of a frame that begins to arrive *now* and whose row is not known; NONE if there is none."""
    common, frames = network.common[0], network.frames
    number = common.first_begun
    while number != NONE and frames[number].begin == now - common.delay:
        sender: int = frames[number].source
        if network.stations[sender].row == NONE:
            return sender
        number = frames[number].next
    return NONE


@njit(cache=True, borrows=True)
def total_mw(network: Network, address: int) -> float:
    """Return the power of all frames that arrive at a station."""
    frames, left, total = network.frames, network.stations[address].arriving, 0.0
    number = network.common[0].first_there
    while left > 0:  # of all on the air most do not arrive here
        mw = network.powers_mw[number, address]
        if mw > 0.0:
            total += mw
            left -= 1
        number = frames[number].next
    return total


@njit(cache=True, borrows=True)
def forget(network: Network, number: int) -> None:
    """Free frame *number*, which has arrived to its end everywhere."""
    common, frames = network.common[0], network.frames
    before, there = NONE, common.first_there
    while there != number:
        before, there = there, frames[there].next
    if before == NONE:
        common.first_there = frames[number].next
    else:
        frames[before].next = frames[number].next
    if common.last_there == number:
        common.last_there = before
    if frames[number].packet != NONE:
        leave_packet(network, frames[number].packet)
    common.over += 1
    common.frames_under_way -= 1
    frames[number].next = common.free_frame
    common.free_frame = number


@njit(cache=True, borrows=True)
def leave_packet(network: Network, number: int) -> None:
    """Free packet *number* if nothing else uses it."""
    common, packet = network.common[0], network.packets[number]
    packet.users -= 1
    if packet.users == 0:
        packet.next = common.free_packet
        common.free_packet = number


@njit(cache=True, borrows=True)
def tell(network: Network, what: int, station: int, packet: int, right: bool) -> Record:
    """Tell the host of *station*, or the tables, what has happened; return the report for the rest of it."""
    common = network.common[0]
    report = network.told[common.told]
    common.told += 1
    if what in (RECEIVED, DONE):
        common.urgent = True
    report.what, report.station, report.packet, report.right = what, station, packet, right
    return report


@njit(cache=True, borrows=True)
def tell_frame(network: Network, what: int, station: int, number: int, right: bool, mw: float) -> Record:
    """Tell the same with all that is known of frame *number*; return the report."""
    frame = network.frames[number]
    report = tell(network, what, station, frame.packet, right)
    report.mw = mw
    report.kind, report.source, report.destination = frame.kind, frame.source, frame.destination
    report.begin, report.duration = frame.begin, frame.form.duration
    report.reserves, report.number = frame.reserves, frame.number
    report.again = False
    if frame.packet != NONE:
        packet = network.packets[frame.packet]
        report.again = packet.short + packet.long > 0  # a CTS has put failures of RTS back to 0
    return report
