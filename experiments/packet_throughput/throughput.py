"""What a link carries at a given Es/N0: a backlogged master, one slave, and every frame on the Bluetooth channel.

The link is set up side by side; then the slave moves away until its received power is the wanted Es/N0 above the
noise, in free space. From then on the master has always a full packet of one type to send and the slave nothing: it
answers NULL. What is counted is what was acknowledged, in a window of simulated time.
"""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from pydantic import Field

from cosim.channels.bluetooth.bits.errors import throughput_kbps
from cosim.channels.bluetooth.bits.powers import POWER_DBM
from cosim.channels.bluetooth.device import BluetoothChannel
from cosim.channels.bluetooth.inquiry import known_offset
from cosim.channels.bluetooth.packets import ACL, AclName, PacketType
from cosim.channels.bluetooth.settings import BluetoothSettings
from cosim.channels.propagation import PropagationSettings
from cosim.errors import CosimError
from cosim.experiment import experiment_function
from cosim.kernel import Kernel
from cosim.machine import Address, Connected, Fate, LinkEvent, Outcome, Outgoing, Page, PageFailed, Reception
from cosim.randomness import Streams
from cosim.settings import Count, Gain, Settings
from cosim.trace import Field as Column
from cosim.trace import Trace
from cosim.units import MS, SLOT, S, Time, to_seconds

MASTER: Final[Address] = 0
SLAVE: Final[Address] = 1
NEAR_M: Final = 1.0
BACKLOG: Final = 3
"""Number of payloads that wait at the master at any time."""
SETTLE: Final[Time] = 100 * MS
SET_UP_WITHIN: Final[Time] = 60 * S
COLUMNS: Final = (
    Column("throughput_kbps", "float", "kb/s", "acknowledged user data"),
    Column("closed_form_kbps", "float", "kb/s", "the same by the closed form"),
    Column("difference_kbps", "float", "kb/s", "throughput_kbps - closed_form_kbps"),
    Column("pairs", "float", "1", "packets that were sent in the window, each with its answer"),
)


class Parameters(Settings):
    """What the experiment varies."""

    packet: AclName = Field(default="DM1", description="type of the master's packets")
    es_n0_db: float = Field(default=14.0, ge=1, le=40, description="dB, Es/N0 of all frames at their receivers")
    error_share: Gain = Field(
        default=0.3, gt=0, description="standard error of the rate, as a share of the larger of 1 % of it and 0.1 kb/s"
    )
    least_pairs: Count = Field(
        default=1000, ge=10, description="slot pairs (or more slots, of longer packets) of a run, at least"
    )
    most_pairs: Count = Field(default=200_000, ge=10, description="and at most")
    runs: Count = Field(default=20, ge=1, description="runs that share the pairs that the standard error needs")


class Host:
    """A host that notes when it is connected and how many of its payloads were acknowledged, and offers another."""

    def __init__(self, channel: BluetoothChannel, payload: bytes) -> None:
        self.connected = False
        self.failed = False
        self.delivered = 0
        self._channel = channel
        self._payload = payload

    def offer(self) -> None:
        """Queue a payload for the slave."""
        self._channel.send(MASTER, Outgoing(SLAVE, self._payload, token=0))

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        """Take a payload."""

    def link(self, event: LinkEvent, now: Time) -> None:
        """Count what was acknowledged, and keep the backlog."""
        if isinstance(event, Fate):
            if event.outcome is not Outcome.DELIVERED:
                raise CosimError(f"the link was lost at {to_seconds(now):g} s")
            self.delivered += 1
            self.offer()
        self.connected = self.connected or isinstance(event, Connected)
        self.failed = self.failed or isinstance(event, PageFailed)

    def drain(self, now: Time) -> None:
        """Do nothing."""


@experiment_function
def measure(parameters: Mapping[str, Any], seed: int) -> dict[str, float]:
    """Return the rate of acknowledged user data in kb/s in one run, beside the closed form."""
    given = Parameters.model_validate(parameters)
    kind = ACL[given.packet]
    pairs = pairs_of_a_run(given)
    duration = pairs * (kind.slots + 1) * SLOT
    delivered = delivered_within(given, duration, seed)
    ours = 8 * kind.capacity * delivered / to_seconds(duration) / 1000
    expected = float(throughput_kbps(kind, given.es_n0_db))
    return {
        "throughput_kbps": ours,
        "closed_form_kbps": expected,
        "difference_kbps": ours - expected,
        "pairs": float(pairs),
    }


def pairs_of_a_run(given: Parameters) -> int:
    """Return how many packets each of ``runs`` runs must send for the standard error that is wanted.

    The number of acknowledged packets is binomial; with p from the closed form, n packets have the standard error
    sqrt(p (1 - p) / n) of their share.
    """
    kind = ACL[given.packet]
    best = _best_kbps(kind)
    share = min(1.0, float(throughput_kbps(kind, given.es_n0_db)) / best)
    wanted = given.error_share * max(0.01 * share, 0.1 / best)
    needed = share * (1 - share) / wanted**2 / given.runs
    return int(min(max(needed, given.least_pairs), given.most_pairs))


def _best_kbps(kind: PacketType) -> float:
    return 8 * kind.capacity / ((kind.slots + 1) * SLOT) * MS


def delivered_within(given: Parameters, duration: Time, seed: int) -> int:
    """Return how many packets the slave acknowledges, as the master hears it, in *duration* ns of backlog.

    Raise CosimError if the link cannot be set up, or is lost because nothing is heard any more.
    """
    settings = BluetoothSettings(
        packet_types=(given.packet,), propagation=PropagationSettings(), power_class=3, clock_ppm=0
    )
    kernel = Kernel()
    channel = BluetoothChannel(settings, kernel, Trace(()), 2, Streams(seed))
    host = Host(channel, bytes(ACL[given.packet].capacity))
    for address in (MASTER, SLAVE):
        channel.attach(address, host)
    channel.moved(np.array([[0.0, 0.0], [NEAR_M, 0.0]]))
    _connect(kernel, channel, host)
    channel.moved(np.array([[0.0, 0.0], [distance_m(settings, given.es_n0_db), 0.0]]))
    for _ in range(BACKLOG):
        host.offer()
    kernel.run(kernel.now + SETTLE)
    before = host.delivered
    kernel.run(kernel.now + duration)
    return host.delivered - before


def distance_m(settings: BluetoothSettings, es_n0_db: float) -> float:
    """Return how far apart two devices are, in free space, whose frames arrive with *es_n0_db*."""
    assert settings.propagation is not None
    received_dbm = settings.noise_dbm + es_n0_db
    loss_db = POWER_DBM[settings.power_class] - received_dbm - settings.propagation.reference_loss_db
    return float(10 ** (loss_db / 20))


def _connect(kernel: Kernel, channel: BluetoothChannel, host: Host) -> None:
    mine, other = (channel.devices[address].identity.clock for address in (MASTER, SLAVE))
    channel.command(MASTER, Page(SLAVE, known_offset(mine, other, kernel.now)))
    while not host.connected:
        if host.failed or kernel.now > SET_UP_WITHIN:
            raise CosimError("the link was not set up")
        kernel.run(kernel.now + SETTLE)
    kernel.run(kernel.now + SETTLE)
