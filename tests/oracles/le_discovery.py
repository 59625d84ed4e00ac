"""Legacy advertising and scanning of Bluetooth Low Energy, PDU by PDU and window by window, and instant by instant.

``heard`` writes down all PDUs and all windows and looks which first PDU lies in a window of its channel.
``heard_by_instants`` looks at every instant whether the scanner still is in the window in which it was; it is for short
cases. All times are integers of one unit, which need not be a nanosecond.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from tests.oracles.medium import Clock


class Pdu(NamedTuple):
    """A PDU in simulated time."""

    event: int
    channel: int
    start: int
    end: int


@dataclass(frozen=True)
class Case:
    """An advertiser, a scanner, and the time in which a PDU has to lie."""

    advertiser: Clock
    first: int
    interval: int
    air: int
    gap: int
    delay: Callable[[int], int]
    """advDelay after an event"""
    channels: tuple[int, ...]
    scanner: Clock
    offset: int
    scan_interval: int
    window: int
    scanned: tuple[int, ...]
    since: int
    until: int


def pdus(case: Case) -> list[Pdu]:
    """Return all PDUs that begin before *until*, from event 0 on."""
    sent: list[Pdu] = []
    event, local = 0, case.first
    while case.advertiser.at_local(local) < case.until:
        begin = local
        for channel in case.channels:
            start = case.advertiser.at_local(begin)
            sent.append(Pdu(event, channel, start, start + case.air))
            begin += case.air + case.gap
        local += case.interval + case.delay(event)
        event += 1
    return sent


def windows(case: Case) -> list[tuple[int, int, int]]:
    """Return (channel, opening, closing) of all windows that may have to do with the case, in simulated time."""
    number = (case.scanner.local(case.since) - case.offset) // case.scan_interval - 2  # before all that count
    found: list[tuple[int, int, int]] = []
    while not found or found[-1][1] < case.until:
        edge = case.offset + number * case.scan_interval
        opening, closing = case.scanner.at_local(edge), case.scanner.at_local(edge + case.window)
        found.append((case.scanned[number % len(case.scanned)], opening, closing))
        number += 1
    return found


def heard(case: Case) -> Pdu | None:
    """Return the first PDU that is heard."""
    listening = windows(case)
    for pdu in pdus(case):
        if case.since <= pdu.start and pdu.end <= case.until:
            for channel, opening, closing in listening:
                if channel == pdu.channel and opening <= pdu.start and pdu.end <= closing:
                    return pdu
    return None


def heard_by_instants(case: Case) -> Pdu | None:
    """Return the first PDU that is heard, from one instant to the next."""
    ends = {pdu.end: pdu for pdu in pdus(case)}
    unbroken, number_before = case.since, None
    for now in range(case.since, case.until + 1):
        # what was on the air until now has been listened to at all instants before
        pdu = ends.get(now)
        tuned = None if number_before is None else case.scanned[number_before % len(case.scanned)]
        if pdu is not None and tuned == pdu.channel and unbroken <= pdu.start:
            return pdu
        number = (case.scanner.local(now) - case.offset) // case.scan_interval
        listens = case.scanner.local(now) - case.offset - number * case.scan_interval < case.window
        if not listens:
            number_before = None
        elif number != number_before:
            unbroken, number_before = now, number
    return None
