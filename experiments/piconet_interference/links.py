"""The same room with real links: piconets set up by paging, backlogged on both sides, with acknowledgements and all."""

from collections.abc import Sequence
from typing import Final, Literal

from cosim.channels.bluetooth.device import BluetoothChannel
from cosim.channels.bluetooth.inquiry import known_offset
from cosim.channels.bluetooth.packets import DH1
from cosim.channels.bluetooth.settings import BluetoothSettings
from cosim.errors import CosimError
from cosim.kernel import Kernel
from cosim.machine import Address, Connected, LinkEvent, Outgoing, Page, PageFailed, Reception, Role
from cosim.randomness import Streams
from cosim.trace import FRAMES, Trace
from cosim.units import MS, SLOT, S

SET_UP_WITHIN: Final = 60 * S
SUPERVISION_S: Final = 2.0
SETTLE: Final = 20 * MS
"""Time from the beginning of the load to that of the count."""


class Host:
    """The host of one device: of a master, with an even address, it pages the next address."""

    def __init__(self, address: Address, channel: BluetoothChannel) -> None:
        self.address = address
        self.connected = False
        self.paging = False
        self._channel = channel

    def page(self) -> None:
        """Page the slave, whose clock is known from a former inquiry."""
        self.paging = True
        mine, other = (self._channel.devices[a].identity.clock for a in (self.address, self.address + 1))
        self._channel.command(self.address, Page(self.address + 1, known_offset(mine, other, self._channel.kernel.now)))

    def receive(self, data: bytes, reception: Reception, now: int) -> None:
        """Take a payload."""

    def link(self, event: LinkEvent, now: int) -> None:
        """Note how the page has ended."""
        if isinstance(event, PageFailed):
            self.paging = False
        elif isinstance(event, Connected) and event.role is Role.MASTER:
            self.connected = True

    def drain(self, now: int) -> None:
        """Do nothing."""


def survival(
    piconets: int, interference: Literal["co_channel", "neighbouring"], slots: int, seed: int
) -> dict[str, float]:
    """Return the share of frames that are received, and the frames sent in a slot and piconet, in one run."""
    settings = BluetoothSettings(
        packet_types=("DH1",), interference=interference, supervision_s=SUPERVISION_S, clock_ppm=0
    )
    kernel, trace = Kernel(), Trace((FRAMES,))
    channel = BluetoothChannel(settings, kernel, trace, 2 * piconets, Streams(seed))
    hosts = [Host(address, channel) for address in range(2 * piconets)]
    for host in hosts:
        channel.attach(host.address, host)
    _connect(kernel, hosts[::2])
    for host in hosts:
        _load(channel, host.address, slots)
    begin = kernel.now + SETTLE
    end = begin + slots * SLOT
    kernel.run(end + SETTLE)
    frames = trace.columns("frames")
    outcomes = [
        outcome
        for time, kind, outcome in zip(frames["time_ns"], frames["kind"], frames["outcome"], strict=True)
        if begin <= time < end and kind == DH1.name
    ]
    return {"survival": outcomes.count("received") / len(outcomes), "load": len(outcomes) / (slots * piconets)}


def _connect(kernel: Kernel, masters: Sequence[Host]) -> None:
    """Page until all links are up.

    A page fails at once while the slave still believes in a link that the master never got: till supervision ends it.
    """
    while waiting := [host for host in masters if not host.connected]:
        if kernel.now > SET_UP_WITHIN:
            raise CosimError(f"the piconets were not set up within {SET_UP_WITHIN // S} s")
        for host in waiting:
            if not host.paging:
                host.page()
        kernel.run(kernel.now + 100 * MS)


def _load(channel: BluetoothChannel, address: Address, slots: int) -> None:
    """Queue more than a device can send during the count and the time around it."""
    payload = Outgoing(address ^ 1, bytes(DH1.capacity))
    for _ in range((slots + 3 * SETTLE // SLOT) // 2):
        channel.send(address, payload)
