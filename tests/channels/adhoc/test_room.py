"""The stations' kernel stops before an event that may bring more than there is room for, and before no other."""

import numpy as np
import pytest

from cosim.channels.adhoc.advance import FULL, IDLE, advance
from cosim.channels.adhoc.dcf import queue
from cosim.channels.adhoc.log import EACH as SPACES
from cosim.channels.adhoc.log import MORE as MORE_SPACES
from cosim.channels.adhoc.mac import Access, Form, Timing
from cosim.channels.adhoc.state import INTERVAL, NONE, RECEPTION, TRANSMISSION, Log, Network, new_network, new_records
from cosim.machine import BROADCAST
from cosim.units import US

SIZE = 3
EACH = 2
"""What an event may bring for each station: an event of its own, and one of its back-off."""
REPORTS = 4
"""And so many reports: the frame has ended there, is received, the packet is given up, and that for tables."""
MORE = 4
"""What it may bring beside these, and beside the end of each frame that is under way."""
LATER = 2
"""Frames under way in the cases."""


def waiting() -> Network:
    """Return a network whose only event is a station's that begins to contend."""
    form = Form(100 * US)
    timing = Timing(
        20 * US,
        10 * US,
        50 * US,
        60 * US,
        15 * US,
        US,
        40 * US,
        form,
        form,
        form,
        lambda octets: form,
        lambda octets: form,
    )
    network = new_network(SIZE, timing, Access(), None, (1, 2), np.empty(0), 0)
    assert queue(network, 0, BROADCAST, form, False, False, 0) != NONE
    return network


def ended(network: Network, log: Log | None = None) -> int:
    """Return why the kernel ends in the instant of the station's event."""
    return advance(network, log, US, 0)[0]


@pytest.mark.parametrize("under_way", [0, LATER])
def test_of_events(under_way: int) -> None:
    enough = 1 + EACH * SIZE + under_way + MORE
    for room, why in ((enough - 1, FULL), (enough, IDLE)):
        network = waiting()
        network.common["frames_under_way"] = under_way
        assert ended(network._replace(agenda=network.agenda[:room])) == why


@pytest.mark.parametrize("untold", [0, 5])
def test_of_reports(untold: int) -> None:
    enough = untold + REPORTS * SIZE + MORE
    for room, why in ((enough - 1, FULL), (enough, IDLE)):
        network = waiting()
        network.common["told"] = untold
        assert ended(network._replace(told=network.told[:room])) == why


def test_of_frames() -> None:
    network = waiting()
    network.common["free_frame"] = NONE
    assert ended(network) == FULL
    assert ended(waiting()) == IDLE


@pytest.mark.parametrize("kept", [0, 5])
def test_of_what_is_kept_for_tables(kept: int) -> None:
    enough = {
        "intervals": (INTERVAL, kept + SPACES * SIZE + MORE_SPACES),
        "transmissions": (TRANSMISSION, kept + 1),
        "receptions": (RECEPTION, kept + SIZE + 1),
    }
    nothing = Log(*(new_records(0, fields) for fields, _ in enough.values()))
    for name, (fields, rows) in enough.items():
        for room, why in ((rows - 1, FULL), (rows, IDLE)):
            network = waiting()
            network.common[name] = kept
            log = nothing._replace(**{name: new_records(room, fields)})
            assert ended(network, log) == (why if room else IDLE), name
