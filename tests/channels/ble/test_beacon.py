"""The beacons of several devices, asked together, against each of them asked for itself."""

from functools import partial

from cosim.channels.ble.antenna import Antenna
from cosim.channels.ble.beacon import Beacon, Beacons
from cosim.channels.clock import NativeClock
from cosim.randomness import Streams
from cosim.units import MS, US


def beacons(seed: int) -> list[Beacon]:
    streams = Streams(seed)
    return [
        Beacon(at, NativeClock(at * 7_001, at - 2), (20 + 20 * at) * MS, Antenna(), partial(streams.draws, "delay", at))
        for at in range(4)
    ]


def test_all_together_send_what_each_sends_while_they_begin_and_end() -> None:
    sent = 0
    for seed in range(40):
        draw = Streams(seed)("times")
        asked, alone = beacons(seed), beacons(seed)
        together = Beacons(asked)
        now = told = 0
        for _ in range(200):
            now += int(draw.integers(1, 15 * MS))
            until = min(now, told + int(draw.integers(30 * MS)))  # who tells lags behind
            packets = list(together.packets(told, until))
            assert packets == [packet for each in alone for packet in each.packets(told, until)]
            told, sent = until, sent + len(packets)
            assert together.begins_after(now) == min(each.begins_after(now) for each in alone)
            number, after, ends = int(draw.integers(4)), int(draw.integers(300 * US)), draw.random() < 0.3
            for each in (asked[number], alone[number]):
                if each.advertiser is None:
                    each.begin(now, after)
                elif ends:
                    each.end(now)
    assert sent > 10_000
