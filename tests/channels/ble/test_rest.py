"""A link that rests comes to the same as one whose polls and empty answers are sent, one by one, without errors."""

from itertools import product

import pytest

from cosim.channels.ble.bits.pdu import LLData, Llid
from cosim.channels.ble.connections.arq import Fragment
from cosim.channels.ble.connections.channel_map import ALL_CHANNELS
from cosim.channels.ble.connections.exchange import Reception, Side
from cosim.channels.ble.connections.link import Link, run_event
from cosim.channels.clock import NativeClock
from cosim.errors import LocalProtocolError
from cosim.units import MS, US, S

INTERVAL = 30 * MS


def begun(latency: int, events: int) -> Link:
    """Return a link of which so many events have been, with a payload in the first ones."""
    ll_data = LLData(0x71764129, 0x123456, 1_250 * US, 5 * MS, INTERVAL, latency, 4 * S, ALL_CHANNELS, 7, 5)
    link = Link(ll_data, 100 * MS, (NativeClock(17, 40), NativeClock(5 * S, -50)), 50)
    link.peripheral.arq.push(Fragment(Llid.START, b"payload"))
    for _ in range(events):
        run_one(link)
    return link


def run_one(link: Link) -> None:
    run_event(link, link.anchor + INTERVAL, lambda packet: Reception.HEARD)


def state(link: Link) -> object:
    ends = [(end.arq.sn, end.arq.nesn, end.arq.sent, end.supervision, end.loss) for end in link.ends]
    return link.event, link.anchor, link.expected, ends, [link.deadline(side) for side in Side]


@pytest.mark.parametrize(
    ("latency", "before", "rested"), [*product((0, 1, 3), (4, 5, 6, 9), (0, 1, 2, 3, 4, 5, 100, 999))]
)
def test_resting_comes_to_the_same(latency: int, before: int, rested: int) -> None:
    resting, running = begun(latency, before), begun(latency, before)
    assert resting.may_rest
    resting.rest(before + rested)
    for _ in range(rested):
        run_one(running)
    assert state(resting) == state(running)
    for link in (resting, running):  # and goes on alike
        link.central.arq.push(Fragment(Llid.START, b"more"))
        for _ in range(2 * latency + 3):
            run_one(link)
    assert not resting.central.arq.busy
    assert state(resting) == state(running)


def test_a_link_with_something_to_say_does_not_rest() -> None:
    link = begun(0, 5)
    link.central.arq.push(Fragment(Llid.START, b"more"))
    assert not link.may_rest
    with pytest.raises(LocalProtocolError, match="does not rest"):
        link.rest(9)
    link = begun(0, 5)
    with pytest.raises(LocalProtocolError, match="5 does not rest until event 4"):
        link.rest(4)


def test_a_link_that_has_not_begun_does_not_rest() -> None:
    assert not begun(0, 0).may_rest
