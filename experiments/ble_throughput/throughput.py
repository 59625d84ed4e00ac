"""What a link of Bluetooth Low Energy carries: a backlogged central, one peripheral, every packet on the channel.

The link is set up side by side, and has agreed on lengths and PHY when the peripheral moves away to where the received
power is the wanted one, in free space. From then on the central has always something to send, a packet a payload, and
the peripheral nothing: it answers with empty packets. What is counted is what was acknowledged, in whole intervals.
"""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from pydantic import Field

from cosim.channels.ble.bits.errors import SENSITIVITY_G, bit_error_rate, least_dbm
from cosim.channels.ble.bits.l2cap import HEADER_OCTETS
from cosim.channels.ble.channel import BleChannel
from cosim.channels.ble.connections.exchange import exchange_time
from cosim.channels.ble.phy import Phy
from cosim.channels.ble.session import NOTIFICATION
from cosim.channels.ble.settings import LINK_PHYS, BleSettings, ConnectionSettings, PhyName
from cosim.channels.propagation import PropagationSettings
from cosim.errors import CosimError
from cosim.experiment import experiment_function
from cosim.kernel import Kernel
from cosim.machine import Address, Connected, Fate, LinkEvent, Lost, Outcome, Outgoing, Page, Reception
from cosim.randomness import Streams
from cosim.settings import Count, Decibels, Seconds, Settings
from cosim.trace import Field as Column
from cosim.trace import Trace
from cosim.units import US, S, Time, from_seconds, to_seconds

CENTRAL: Final[Address] = 0
PERIPHERAL: Final[Address] = 1
SETTLE: Final[Time] = 15 * S
"""Time after which lengths and PHY are agreed on, with the longest interval."""
OVERHEAD_OCTETS: Final = HEADER_OCTETS + len(NOTIFICATION)
"""Octets of a packet that are not the user's: headers of L2CAP and of ATT."""
COLUMNS: Final = (
    Column("throughput_kbps", "float", "kb/s", "acknowledged user data; 0 if the link was lost"),
    Column(
        "closed_form_kbps", "float", "kb/s", "whole exchanges of an interval, less what is lost; 0 if packets are cut"
    ),
    Column("difference_kbps", "float", "kb/s", "throughput_kbps - closed_form_kbps"),
    Column("lost", "float", "1", "whether the link was lost"),
)


class Parameters(Settings):
    """What the experiment varies."""

    phy: PhyName = Field(default="1M", description="PHY of the link")
    octets: Count = Field(default=251, ge=27, le=251, description="payload of the packets")
    interval_s: Seconds = Field(default=0.03, gt=0, description="s, connInterval")
    margin_db: Decibels = Field(default=60, description="dB of the signal above the sensitivity of that PHY")
    duration_s: Seconds = Field(default=2.0, gt=0, description="s that are counted, rounded up to whole intervals")


class Host:
    """A host that keeps a backlog, and counts what was acknowledged."""

    def __init__(self, channel: BleChannel, payload: bytes) -> None:
        self.connected = False
        self.lost = False
        self.delivered = 0
        self._channel = channel
        self._payload = payload

    def offer(self) -> None:
        """Queue a payload for the peripheral."""
        self._channel.send(CENTRAL, Outgoing(PERIPHERAL, self._payload, token=0))

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        """Take a payload."""

    def link(self, event: LinkEvent, now: Time) -> None:
        """Count what was acknowledged, and keep the backlog."""
        if isinstance(event, Fate) and event.outcome is Outcome.DELIVERED:
            self.delivered += 1
            self.offer()
        self.connected = self.connected or isinstance(event, Connected)
        self.lost = self.lost or isinstance(event, Lost)

    def drain(self, now: Time) -> None:
        """Do nothing."""


@experiment_function
def measure(parameters: Mapping[str, Any], seed: int) -> dict[str, float]:
    """Return the rate of acknowledged user data in kb/s in one run, beside the closed form."""
    given = Parameters.model_validate(parameters)
    interval = from_seconds(given.interval_s)
    events = -(-from_seconds(given.duration_s) // interval)
    delivered, lost = delivered_within(given, events * interval, seed)
    bits = 8 * (given.octets - OVERHEAD_OCTETS)
    ours = bits * delivered / to_seconds(events * interval) / 1000
    expected = expected_kbps(given)
    return {
        "throughput_kbps": ours,
        "closed_form_kbps": expected,
        "difference_kbps": ours - expected,
        "lost": float(lost),
    }


def exchanges(given: Parameters) -> int:
    """Return how many exchanges, a full packet and an empty answer, an interval holds."""
    phy = phy_of(given)
    return from_seconds(given.interval_s) // exchange_time(phy, given.octets, phy, 0)


def is_cut(given: Parameters) -> bool:
    """Return whether packets are cut shorter, as both ends could not send one of that length in an interval."""
    phy = phy_of(given)
    return exchange_time(phy, given.octets, phy, given.octets) > from_seconds(given.interval_s) - 2 * US


def expected_kbps(given: Parameters) -> float:
    """Return the rate in kb/s with losses, as a chain over the exchanges of an event has it; 0 if packets are cut.

    An event ends with a packet of which the header is not received, with the second one in a row that an end receives
    with a wrong CRC, or when no exchange fits any more. Whether the packet at the head of the queue has been received,
    and is only not acknowledged, is what an event leaves to the next one.
    """
    if is_cut(given):
        return 0.0
    g = SENSITIVITY_G * 10 ** (given.margin_db / 10)
    right = 1.0 - bit_error_rate(g)
    down, up = ((right**48, right ** (8 * (octets + 3))) for octets in (given.octets, 0))
    count = exchanges(given)
    ends = [acknowledged(count, down, up, received) for received in (False, True)]
    stays, comes = ends[1][1], ends[0][1]  # probabilities that it is received at the end of an event
    share = comes / (1.0 - stays + comes) if comes else 0.0
    mean = (1.0 - share) * ends[0][0] + share * ends[1][0]
    return 8 * (given.octets - OVERHEAD_OCTETS) * mean / given.interval_s / 1000


def acknowledged(count: int, down: tuple[float, float], up: tuple[float, float], received: bool) -> tuple[float, float]:
    """Return how many packets an event of *count* exchanges acknowledges, in the mean, and what is left of it.

    *down* and *up* are the probabilities that header, and then payload, of a packet and of an answer are received;
    *received*: whether the first packet has been received before. The second number is the probability that so is the
    one that is next after the event.
    """
    alive = {(received, False, False): 1.0}  # (received, wrong CRC last at the peripheral, at the central)
    mean = left = 0.0
    for _ in range(count):
        following: dict[tuple[bool, bool, bool], float] = {}
        for (had, wrong_down, wrong_up), chance in alive.items():
            left += had * chance * (1.0 - down[0])
            broken = chance * down[0] * (1.0 - down[1])
            left += had * broken * wrong_down
            answers = [(True, False, chance * down[0] * down[1]), (had, True, broken * (not wrong_down))]
            for has, wrong, answered in answers:
                left += has * answered * (1.0 - up[0])
                unread, read = answered * up[0] * (1.0 - up[1]), answered * up[0] * up[1]
                left += has * unread * wrong_up
                mean += has * read
                for state, part in (((has, wrong, True), unread * (not wrong_up)), ((False, wrong, False), read)):
                    following[state] = following.get(state, 0.0) + part
        alive = following
    return mean, left + sum(chance for (had, _, _), chance in alive.items() if had)


def phy_of(given: Parameters) -> Phy:
    """Return the PHY of the link."""
    return LINK_PHYS[given.phy]


def delivered_within(given: Parameters, duration: Time, seed: int) -> tuple[int, bool]:
    """Return how many packets are acknowledged in *duration* ns of backlog, and whether the link was lost.

    Raise CosimError if the link is not set up.
    """
    settings = BleSettings(
        propagation=PropagationSettings(),
        clock_ppm=0,
        connection=ConnectionSettings(
            interval_s=given.interval_s, links=1, phy=given.phy, octets=given.octets, supervision_s=20
        ),
    )
    kernel = Kernel()
    channel = BleChannel(settings, kernel, Trace(()), 2, Streams(seed))
    host = Host(channel, bytes(given.octets - OVERHEAD_OCTETS))
    for address in (CENTRAL, PERIPHERAL):
        channel.attach(address, host)
    channel.moved(np.array([[0.0, 0.0], [1.0, 0.0]]))
    channel.command(CENTRAL, Page(PERIPHERAL))
    kernel.run(SETTLE)
    if not host.connected:
        raise CosimError("the link was not set up")
    channel.moved(np.array([[0.0, 0.0], [distance_m(settings, given), 0.0]]))
    for _ in range(2 + exchanges(given)):
        host.offer()
    kernel.run(kernel.now + 2 * from_seconds(given.interval_s))
    before = host.delivered
    kernel.run(kernel.now + duration)
    return host.delivered - before, host.lost


def distance_m(settings: BleSettings, given: Parameters) -> float:
    """Return how far apart two devices are, in free space, whose signals are the wanted margin above sensitivity."""
    assert settings.propagation is not None
    received_dbm = least_dbm(phy_of(given), settings.sensitivity_dbm, SENSITIVITY_G) + given.margin_db
    loss_db = settings.power_dbm - received_dbm - settings.propagation.reference_loss_db
    return float(10 ** (loss_db / 20))
