"""A Bluetooth channel with hosts that write down what they get."""

from collections.abc import Callable, Sequence
from typing import Any

from cosim.channels.bluetooth.device import BluetoothChannel
from cosim.channels.bluetooth.settings import BluetoothSettings
from cosim.kernel import Kernel
from cosim.machine import Address, Connected, Inquire, InquiryComplete, LinkCommand, LinkEvent, Page, Reception
from cosim.randomness import Streams
from cosim.trace import CALLS, FRAMES, Table, Trace
from cosim.units import MS, S, Time


class Host:
    """An endpoint that writes down what it gets, and acts on link events as *react* has it."""

    def __init__(self, world: "World", address: Address) -> None:
        self.world = world
        self.address = address
        self.events: list[tuple[Time, LinkEvent]] = []
        self.received: list[tuple[Time, Address, bytes, bool]] = []
        self.rssi_dbm: list[float | None] = []
        self.react: Callable[[LinkEvent], None] = lambda event: None
        self.drained = 0

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        self.received.append((now, reception.source, data, reception.broadcast))
        self.rssi_dbm.append(reception.rssi_dbm)

    def link(self, event: LinkEvent, now: Time) -> None:
        assert not self.world.commanding, "a link event came inside a command"
        self.events.append((now, event))
        self.react(event)

    def drain(self, now: Time) -> None:
        self.drained += 1

    def got(self, kind: type) -> list[LinkEvent]:
        return [event for _, event in self.events if isinstance(event, kind)]

    def when(self, kind: type) -> list[Time]:
        return [time for time, event in self.events if isinstance(event, kind)]


class World:
    """A Bluetooth channel for *size* devices with a host on each; *streams*, if given, stand in place of the seed's."""

    def __init__(
        self,
        size: int,
        seed: int = 1,
        streams: Streams | None = None,
        tables: Sequence[Table] = (FRAMES, CALLS),
        **settings: object,
    ) -> None:
        self.kernel = Kernel()
        self.trace = Trace(tables)
        self.channel = BluetoothChannel(
            BluetoothSettings.model_validate(settings), self.kernel, self.trace, size, streams or Streams(seed)
        )
        self.commanding = False
        self.hosts = [Host(self, address) for address in range(size)]
        for host in self.hosts:
            self.channel.attach(host.address, host)

    def command(self, address: Address, *commands: LinkCommand) -> None:
        self.commanding = True
        for command in commands:
            self.channel.command(address, command)
        self.commanding = False

    def at(self, time: Time, act: Callable[[], None], phase: int = 1) -> None:
        self.kernel.at(time, act, phase)

    def connect(self, *slaves: Address, master: Address = 0) -> None:
        """Inquire until all slaves are found, then page them in this order, and run until all are connected."""
        self.hosts[master].react = lambda event: (
            self.command(master, *(Page(slave) for slave in slaves)) if isinstance(event, InquiryComplete) else None
        )
        self.at(self.kernel.now, lambda: self.command(master, Inquire(11 * S, len(slaves))))
        while len(self.hosts[master].got(Connected)) < len(slaves):
            assert self.kernel.now < 60 * S
            self.kernel.run(self.kernel.now + 100 * MS)
        self.hosts[master].react = lambda event: None

    def frames(self) -> list[dict[str, Any]]:
        columns = self.trace.columns("frames")
        return [dict(zip(columns, row, strict=True)) for row in sorted(zip(*columns.values(), strict=True))]
