"""Stations that always have something to send, all in reach of each other: what gets through, and what models say.

``bianchi`` solves Bianchi's model (IEEE JSAC 18(3), 2000, equations 7, 9 and 13): n stations, a window W that doubles m
times, no limit of retries.
"""

import math
from collections.abc import Mapping
from functools import partial
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from pydantic import Field
from scipy.optimize import brentq

from cosim.channels.adhoc.channel import AdhocChannel
from cosim.channels.adhoc.mac import Timing
from cosim.channels.adhoc.settings import AdhocSettings
from cosim.experiment import experiment_function
from cosim.kernel import Kernel
from cosim.machine import Address, LinkEvent, Outgoing, Reception
from cosim.randomness import Streams
from cosim.settings import Count, Settings
from cosim.trace import Field as Column
from cosim.trace import Trace
from cosim.units import S, Time, to_seconds

WAITING: Final = 2
"""Number of payloads that a station holds."""
LONGEST: Final = 86_400 * S
"""Time longer than any run."""
COLUMNS: Final = (
    Column("throughput_mbps", "float", "Mb/s", "payload that was acknowledged, by all stations"),
    Column("bianchi_mbps", "float", "Mb/s", "what Bianchi's model says; NaN for the standard's counting"),
    Column("failed", "float", "1", "share of the frames with a payload, or RTS, that got no answer"),
    Column("fairness", "float", "1", "Jain's index of what the stations got through: 1 if all the same"),
)


class Network(Settings):
    """Radios, and what they carry."""

    radio: AdhocSettings = Field(description="all alike")
    payload_octets: Count = Field(default=1500, ge=1, description="octets of every payload")


class Parameters(Settings):
    """A network at full load."""

    network: Network = Field(description="the radios, and what they carry")
    access: Literal["basic", "rts"] = Field(default="basic", description="with RTS and CTS, or without")
    stations: Count = Field(default=5, ge=2, description="all in reach of each other")
    payloads: Count = Field(default=2000, ge=1, description="that are counted")
    before: Count = Field(default=1000, ge=0, description="payloads that get through before: all begin at once")


class Tally:
    """What all stations together have got through."""

    def __init__(self, channel: AdhocChannel, given: Parameters) -> None:
        self.channel = channel
        self.through = np.zeros(given.stations)
        self.sent = 0.0
        """Frames in the time of the count."""
        self.seconds = math.nan
        """Time of the count."""
        self._given = given
        self._total = 0
        self._begin = (0, 0.0)

    def count(self, address: Address) -> None:
        """Note that a payload of *address* has got through; end the run with the last."""
        given, now = self._given, self.channel.kernel.now
        self._total += 1
        self.through[address] += self._total > given.before
        if self._total == given.before:
            self._begin = now, self.channel.summary()["frames_sent"]
        elif self._total == given.before + given.payloads:
            self.seconds = to_seconds(now - self._begin[0])
            self.sent = self.channel.summary()["frames_sent"] - self._begin[1]
            self.channel.kernel.stop()


class Host:
    """The host of a saturated station: whatever is done with, it replaces."""

    def __init__(self, address: Address, tally: Tally, stations: int, payload: bytes) -> None:
        channel = tally.channel
        self._address = address
        self._tally = tally
        self._send = partial(channel.send, address, Outgoing((address + 1) % stations, payload, address))
        for _ in range(WAITING):
            channel.kernel.at(0, self._send)

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        """Take a payload."""

    def link(self, event: LinkEvent, now: Time) -> None:
        """Send the next: retries have no limit, so what is done with has been acknowledged."""
        self._tally.count(self._address)
        self._send()

    def drain(self, now: Time) -> None:
        """Do nothing."""


@experiment_function
def measure(parameters: Mapping[str, Any], seed: int) -> dict[str, float]:
    """Return ``COLUMNS`` of one run."""
    given = Parameters.model_validate(parameters)
    unlimited = {"short_retries": None, "long_retries": None}
    radio = given.network.radio.model_copy(update=unlimited | {"rts_threshold": 0 if given.access == "rts" else None})
    kernel = Kernel()
    channel = AdhocChannel(radio, kernel, Trace(()), given.stations, Streams(seed))
    payload = bytes(given.network.payload_octets)
    tally = Tally(channel, given)
    for address in range(given.stations):
        channel.attach(address, Host(address, tally, given.stations, payload))
    kernel.run(LONGEST)
    through = tally.through
    answers = 3 if given.access == "rts" else 1
    tried = tally.sent - answers * given.payloads
    return {
        "throughput_mbps": given.payloads * 8e-6 * len(payload) / tally.seconds,
        "bianchi_mbps": bianchi_mbps(radio, given) if radio.bianchi_counting else math.nan,
        "failed": 1.0 - given.payloads / tried,
        "fairness": float(through.sum() ** 2 / (len(through) * (through**2).sum())),
    }


# ---------------------------------------------------------------- Bianchi's model


class Chances(NamedTuple):
    """What stations do in a slot of Bianchi's model."""

    tau: float
    """Probability that a station begins a frame."""
    collides: float
    """Probability that another does as well."""


def chances(stations: int, window: int, doublings: int) -> Chances:
    """Return the solution of equations 7 and 9, to 1e-12; the series form, which has no 0/0 at p = 1/2."""

    def tau(p: float) -> float:
        return 2.0 / (1.0 + window + p * window * sum((2.0 * p) ** i for i in range(doublings)))

    if stations == 1:
        return Chances(tau(0.0), 0.0)
    p = brentq(lambda p: p - 1.0 + (1.0 - tau(p)) ** (stations - 1), 0.0, 1.0, xtol=1e-12)
    return Chances(tau(p), p)


def bianchi_mbps(radio: AdhocSettings, given: Parameters) -> float:
    """Return the saturation throughput of equation 13."""
    timing, access, stations = radio.timing(), radio.access, given.stations
    doublings = round(math.log2((access.cw_max + 1) / (access.cw_min + 1)))
    tau, _ = chances(stations, access.cw_min + 1, doublings)
    success, collision = _durations(timing, given)
    some = 1.0 - (1.0 - tau) ** stations
    one = stations * tau * (1.0 - tau) ** (stations - 1)
    mean_slot = (1.0 - some) * to_seconds(timing.slot) + one * success + (some - one) * collision
    return 8e-6 * given.network.payload_octets * one / mean_slot


def _durations(timing: Timing, given: Parameters) -> tuple[float, float]:
    """Return T_s and T_c, s."""
    data = timing.unicast(given.network.payload_octets).duration
    gap = timing.sifs + timing.delay
    end = timing.delay + timing.difs
    exchange = data + gap + timing.ack.duration + end
    if given.access == "basic":
        return to_seconds(exchange), to_seconds(data + end)
    return to_seconds(timing.rts.duration + gap + timing.cts.duration + gap + exchange), to_seconds(
        timing.rts.duration + end
    )
