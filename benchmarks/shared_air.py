"""What it costs that radios of several kinds hear each other; see ``benchmarks.workloads`` for what works return."""

from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.workloads import FLOORS, Host, Work
from cosim.channels.kinds import ChannelSite
from cosim.channels.radios import SPEC, RadiosSettings
from cosim.geometry.segments import packed_walls, segment_grid
from cosim.kernel import Kernel
from cosim.machine import Disconnect, Fate, LinkEvent, Outgoing, Page, Scan
from cosim.randomness import Streams
from cosim.scenario import Scenario
from cosim.simulation import Simulation
from cosim.trace import Trace
from cosim.units import MS, S, Time

LAW: dict[str, Any] = {"propagation": {}}
BLUETOOTH = {"kind": "bluetooth", **LAW}
WIFI = {"kind": "adhoc", "rate_mbps": 11, "channel": 6, **LAW}
PLACES = np.array([(0.0, 0.0), (5.0, 0.0), (20.0, 0.0), (20.0, 5.0)])
"""Where the masters and slaves of a piconet are, and two stations."""


def exchanges(air: str) -> Callable[[int], Work]:
    """Return a minute of the exchange of states over Bluetooth, beside radios of 802.11 that nobody uses."""

    def prepare(seed: int) -> Work:
        scenario = Scenario.model_validate(
            {
                "name": "exchange",
                "duration_s": 3600,
                "floorplan": {"map": "storey.yaml"},
                "team": {"size": 8, "body": {"drive": "grid"}, "radios": [0, 1]},
                "channel": {"kind": "radios", "air": air, "radios": [BLUETOOTH | {"power_class": 1}, WIFI]},
                "protocol": {"use": "benchmarks.exchange:SPEC"},
            }
        ).placed(FLOORS)
        simulation = Simulation(scenario, seed)
        kernel, machines = simulation.kernel, simulation.machines
        simulation.begin()
        while machines[0].linked < 7:  # type: ignore[attr-defined]
            kernel.run(kernel.now + S)

        def work() -> float:
            kernel.run(kernel.now + 60 * S)
            return 1

        return work

    return prepare


class _Saturated(Host):
    """A host that always has three payloads queued for the other station."""

    def __init__(self, send: Callable[[Outgoing], None]) -> None:
        super().__init__()
        self._send = send

    def link(self, event: LinkEvent, now: Time) -> None:
        """Queue another one."""
        if isinstance(event, Fate):
            self.queue()

    def queue(self) -> None:
        """Queue one."""
        self._send(Outgoing(3, bytes(1500), 1, 1))


def stations(piconet: bool, saturated: bool, air: str) -> Callable[[int], Work]:
    """Return ten seconds of an idle *piconet* beside *saturated* 802.11, in whichever *air*, or of one of them."""

    def prepare(seed: int) -> Work:
        kernel, size = Kernel(), len(PLACES)
        grid, none = segment_grid(np.empty((0, 4))), (None,) * size
        carried = ((0,), (0,), (1,), (1,))
        floor = grid, np.empty(0), packed_walls(grid)
        site = ChannelSite(kernel, Trace(), Streams(seed), size, *floor, carried, none, none, none)
        channel = SPEC.make(RadiosSettings.model_validate({"air": air, "radios": [BLUETOOTH, WIFI]}), site)
        hosts = [Host(), Host(), _Saturated(lambda outgoing: channel.send(2, outgoing)), Host()]
        for address, host in enumerate(hosts):
            channel.attach(address, host)
        channel.moved(PLACES)
        channel.command(0, Page(1))
        while not hosts[0].connected:
            kernel.run(kernel.now + S)
        for address in (0, 1):
            channel.command(address, Scan(False))
        if not piconet:
            channel.command(0, Disconnect(1))
        kernel.run(kernel.now + S)
        for _ in range(3 * saturated):
            hosts[2].queue()  # type: ignore[attr-defined]
        kernel.every(100 * MS, lambda: channel.advance(kernel.now))

        def work() -> float:
            kernel.run(kernel.now + 10 * S)
            channel.summary()
            return 1

        return work

    return prepare
