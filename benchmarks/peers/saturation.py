"""802.11b stations in reach of each other that always have something to send.

    python -m benchmarks.peers.saturation --nodes=20 --seconds=60 --seed=1

Equal to ``ns3_saturation.cc`` as far as README.md says.
"""

import argparse
from functools import partial

from benchmarks.peers.timing import Work, tell
from cosim.channels.adhoc.channel import AdhocChannel
from cosim.channels.adhoc.settings import AdhocSettings
from cosim.kernel import Kernel
from cosim.machine import Address, LinkEvent, Outgoing, Reception
from cosim.randomness import Streams
from cosim.trace import Trace
from cosim.units import Time, from_seconds

OCTETS = 1500
WAITING = 2
"""Payloads that a station holds."""
RADIO = AdhocSettings(phy="dsss", rate_mbps=1, basic_rates_mbps=(1,), short_retries=None, long_retries=None)
"""1 Mb/s, without RTS; what is not acknowledged is sent again without end."""


class Station:
    """The host of a station: sends the next payload when one is done with."""

    def __init__(self, channel: AdhocChannel, address: Address) -> None:
        self.through = 0
        """Payloads that were acknowledged."""
        payload = Outgoing((address + 1) % channel.size, bytes(OCTETS), address)
        self._send = partial(channel.send, address, payload)
        for _ in range(WAITING):
            channel.kernel.at(0, self._send)

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        """Take a payload."""

    def link(self, event: LinkEvent, now: Time) -> None:
        """Send the next: what is done with has been acknowledged."""
        self.through += 1
        self._send()

    def drain(self, now: Time) -> None:
        """Do nothing."""


def saturated(
    kernel: Kernel, trace: Trace, nodes: int, seed: int, radio: AdhocSettings = RADIO
) -> tuple[AdhocChannel, list[Station]]:
    """Return a channel and the stations on it, which always have something to send from time 0 on."""
    channel = AdhocChannel(radio, kernel, trace, nodes, Streams(seed))
    stations = [Station(channel, address) for address in range(nodes)]
    for address, station in enumerate(stations):
        channel.attach(address, station)
    return channel, stations


def simulation(nodes: int, seconds: float, seed: int) -> Work:
    """Set up a run, and return it."""
    kernel = Kernel()
    _, stations = saturated(kernel, Trace(()), nodes, seed)

    def work() -> dict[str, float]:
        kernel.run(from_seconds(seconds))
        through = sum(station.through for station in stations)
        return {"throughput_mbps": through * OCTETS * 8e-6 / seconds}

    return work


def main() -> None:
    """Simulate stations and tell what it took."""
    parser = argparse.ArgumentParser("python -m benchmarks.peers.saturation")
    parser.add_argument("--nodes", type=int, required=True)
    parser.add_argument("--seconds", type=float, required=True)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    tell(simulation(given.nodes, 1.0, 99), lambda: simulation(given.nodes, given.seconds, given.seed))


if __name__ == "__main__":
    main()
