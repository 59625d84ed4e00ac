"""What Bluetooth Low Energy costs that has little to do; see ``benchmarks.workloads`` for what works return."""

from typing import Any

import numpy as np

from benchmarks.exchange import LANES
from benchmarks.workloads import TICK, Host, Shuttles, Work
from cosim.channels.ble.channel import BleChannel
from cosim.channels.ble.settings import BleSettings
from cosim.kernel import WORLD, Kernel
from cosim.machine import Inquire, Page, Scan
from cosim.randomness import Streams
from cosim.trace import Trace
from cosim.units import S

LINKS = {"connection": {"interval_s": 0.05, "latency": 0}}


def _channel(seed: int, size: int, floor: Any = None, **settings: Any) -> tuple[Kernel, BleChannel, list[Host]]:
    kernel = Kernel()
    channel = BleChannel(BleSettings.model_validate(settings), kernel, Trace(), size, Streams(seed), floor)
    hosts = [Host() for _ in range(size)]
    for address, host in enumerate(hosts):
        channel.attach(address, host)
    return kernel, channel, hosts


def idle_hours(seed: int, seconds: int = 3600, **settings: Any) -> Work:
    """*seconds* of three links of one central that nobody uses while four robots drive, ten world ticks each."""
    shuttles = Shuttles(4)
    kernel, channel, hosts = _channel(seed, 4, shuttles.floor, **LINKS, **settings)
    channel.moved(np.array([begin for begin, _ in LANES[:4]]))
    for peer in range(1, 4):
        channel.command(0, Page(peer))
    while len(hosts[0].connected) < 3:
        kernel.run(kernel.now + S)

    def tick() -> None:
        channel.advance(kernel.now)
        shuttles.tick()
        channel.moved(shuttles.fleet.positions_m)

    kernel.every(TICK, tick, WORLD)

    def work() -> float:
        kernel.run(kernel.now + seconds * S)
        channel.summary()
        return seconds / 3600

    return work


def idle_fading_hours(seed: int) -> Work:
    """A minute of it where signals fade with distance and walls, so that every tick changes all gains."""
    return idle_hours(seed, 60, propagation={}, power_dbm=20)


def scans(seed: int) -> Work:
    """Scans of 10 s without a pause, for the names of seven that advertise every 100 ms, and never have enough."""
    kernel, channel, hosts = _channel(seed, 8, advertise={"interval_s": 0.1}, scan={"interval_s": 0.1, "window_s": 0.1})
    channel.command(0, Scan(enabled=False))
    count = 10

    def work() -> float:
        for done in range(count):
            channel.command(0, Inquire(10 * S, 8))
            while hosts[0].inquiries <= done:
                kernel.run(kernel.now + S)
        return count

    return work
