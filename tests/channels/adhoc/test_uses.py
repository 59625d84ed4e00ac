"""What 802.11 stations do, ns by ns: against the frames that tables have, and closed forms."""

from typing import Any

import numpy as np
import pytest

from cosim.channels.adhoc.channel import AdhocChannel
from cosim.channels.adhoc.settings import AdhocSettings
from cosim.channels.energy import IDLE, OFF, RECEIVE, TRANSMIT, Use
from cosim.kernel import Kernel
from cosim.machine import BROADCAST, Address, Outgoing
from cosim.randomness import Streams
from cosim.trace import TRANSMISSIONS, Trace
from cosim.units import MS, US, S, Time


class Deaf:
    """A host that acts on nothing."""

    def receive(self, *_: Any) -> bool:
        return False

    def link(self, *_: Any) -> bool:
        return False

    def drain(self, now: Time) -> None:
        """Nothing is to be acted on."""


class Net:
    """A channel of stations at *places_m*, in a run of its own."""

    def __init__(self, places_m: list[tuple[float, float]], tables: bool = True, **settings: Any) -> None:
        self.kernel, self.trace = Kernel(), Trace((TRANSMISSIONS,) if tables else ())
        made, size = AdhocSettings(energy="states", **settings), len(places_m)
        self.channel = AdhocChannel(made, self.kernel, self.trace, size, Streams(5))
        for address in range(size):
            self.channel.attach(address, Deaf())
        self.channel.moved(np.array(places_m))

    def send(self, source: Address, destination: Address, octets: int, times: int = 1) -> None:
        for _ in range(times):
            self.channel.send(source, Outgoing(destination, bytes(octets)))

    def used(self, address: Address) -> dict[str, Time]:
        assert self.channel.accounts is not None
        uses = self.channel.accounts.uses(address, self.kernel.now)
        return {state: uses.get(Use(state), 0) for state in (OFF, IDLE, RECEIVE, TRANSMIT)}


def test_a_broadcast_costs_its_sender_its_air_time_and_the_others_as_much():
    net = Net([(0.0, 0.0), (5.0, 0.0)], tables=False)
    net.send(0, BROADCAST, 64, times=100)
    net.kernel.run(2 * S)
    frame = 192 * US + 8 * (64 + 36) * US  # long preamble and header, then 1 Mb/s
    assert net.used(0) == {OFF: 0, IDLE: 2 * S - 100 * frame, RECEIVE: 0, TRANSMIT: 100 * frame}
    assert net.used(1) == {OFF: 0, IDLE: 2 * S - 100 * frame, RECEIVE: 100 * frame, TRANSMIT: 0}


def test_a_saturated_sender_costs_payloads_and_their_acknowledgements():
    net = Net([(0.0, 0.0), (5.0, 0.0)], tables=False, rate_mbps=2.0)
    net.send(0, 1, 1464, times=300)
    net.kernel.run(3 * S)
    data, ack = 192 * US + 4 * (1464 + 36) * US, 192 * US + 4 * 14 * US
    assert net.used(0) == {OFF: 0, IDLE: 3 * S - 300 * (data + ack), RECEIVE: 300 * ack, TRANSMIT: 300 * data}
    assert net.used(1) == {OFF: 0, IDLE: 3 * S - 300 * (data + ack), RECEIVE: 300 * data, TRANSMIT: 300 * ack}


def followed(arrivals: list[tuple[Time, Time]], own: list[tuple[Time, Time]], until: Time) -> Time:
    """Return how long before *until* a station follows frames of those that arrive, while it sends its *own*.

    Where signals do not fade it follows one that begins while nothing else is there, to its end or until it sends.
    """
    total = 0
    for at, (begin, end) in enumerate(arrivals):
        alone = not any(b <= begin < e for b, e in arrivals[:at])
        if alone and not any(b <= begin < e for b, e in own):
            over = min((b for b, _ in own if begin <= b < end), default=end)
            total += max(0, min(over, until) - begin)
    return total


@pytest.mark.parametrize("instant", [100 * MS, 777 * MS + 123_457, 2 * S])
@pytest.mark.parametrize("settings", [{}, {"rts_threshold": 200}, {"range_m": 8.0}])
def test_stations_send_and_follow_what_tables_tell(settings: dict[str, Any], instant: Time):
    places = [(0.0, 0.0), (5.0, 0.0), (10.0, 0.0)]
    net = Net(places, **settings)
    net.send(0, 1, 700, times=400)
    net.send(2, 1, 100, times=200)
    net.send(1, BROADCAST, 300, times=50)
    net.kernel.run(instant)
    used = [net.used(address) for address in range(3)]
    net.kernel.run(instant + 100 * MS)  # so that tables have what was on the air
    net.channel.close(net.kernel.now)
    told = net.trace.columns(TRANSMISSIONS.name)
    frames = sorted(zip(told["time_ns"], told["source"], told["duration_ns"], strict=True))
    delay = 1 * US
    for address in range(3):
        own = [(begin, begin + air) for begin, source, air in frames if source == address]
        near = {other for other in range(3) if 0 < abs(other - address) * 5.0 <= settings.get("range_m", 99.0)}
        arrivals = [(begin + delay, begin + delay + air) for begin, source, air in frames if source in near]
        sent = sum(max(0, min(end, instant) - begin) for begin, end in own)
        heard = followed(arrivals, own, instant)
        assert used[address] == {OFF: 0, IDLE: instant - sent - heard, RECEIVE: heard, TRANSMIT: sent}
        assert min(sent, heard) > instant // 100


def test_a_station_that_is_off_is_nothing_else():
    net = Net([(0.0, 0.0), (5.0, 0.0)], tables=False)
    net.send(0, BROADCAST, 2000, times=3)
    net.kernel.run(5 * MS)  # in the midst of the first frame
    for on in (False, False):
        net.channel.power(0, on)
    before = net.used(0)
    net.kernel.run(1 * S)
    assert net.used(0) == {**before, OFF: 995 * MS}
    net.channel.power(0, True)
    net.kernel.run(2 * S)
    assert net.used(0) == {**before, OFF: 995 * MS, IDLE: before[IDLE] + 1 * S}
    assert before[TRANSMIT] + before[IDLE] == 5 * MS
    assert before[TRANSMIT] > 4 * MS


def test_a_frame_that_captures_a_station_is_received_from_where_the_other_is_left():
    law = {"model": "log_distance", "exponent": 3.0}
    net = Net([(-10.0, 0.0), (0.0, 0.0), (70.0, 0.0)], tables=False, propagation=law, capture_db=10.0)
    net.kernel.run(1 * S)
    assert net.channel.in_reach(2) == (1,)  # it is hidden from 0
    net.send(2, BROADCAST, 100)
    net.kernel.run(1 * S + 20 * US)
    net.send(0, BROADCAST, 200)
    net.kernel.run(2 * S)
    far, near = 192 * US + 8 * 136 * US, 192 * US + 8 * 236 * US
    assert (net.used(2)[TRANSMIT], net.used(0)[TRANSMIT]) == (far, near)
    assert net.used(1)[RECEIVE] == 20 * US + near
