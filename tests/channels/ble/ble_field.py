"""LE devices with hosts that write down what reaches them, and commands at given instants."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from cosim.channels.ble.channel import BleChannel
from cosim.channels.ble.settings import BleSettings
from cosim.kernel import Kernel
from cosim.machine import Address, Connected, Inquire, LinkCommand, LinkEvent, Outgoing, Page, Reception, Role
from cosim.randomness import Streams
from cosim.trace import Table, Trace
from cosim.units import S, Time


class News(NamedTuple):
    """What has reached a host."""

    time: Time
    address: Address
    what: Any
    """A link event, or (payload, how it arrived)."""


class Host:
    """The host at *address*; it writes into *news*."""

    def __init__(self, address: Address, news: list[News]) -> None:
        self.address, self.news = address, news

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        self.news.append(News(now, self.address, (data, reception)))

    def link(self, event: LinkEvent, now: Time) -> None:
        self.news.append(News(now, self.address, event))

    def drain(self, now: Time) -> None:
        """Nothing is to be acted on."""


class Field:
    """A channel of *size* devices with *settings*, in a run of its own."""

    def __init__(self, size: int, seed: int = 1, tables: Iterable[Table] = (), **settings: Any) -> None:
        self.kernel, self.trace = Kernel(), Trace(tables)
        self.channel = BleChannel(BleSettings(**settings), self.kernel, self.trace, size, Streams(seed))
        self.news: list[News] = []
        for address in range(size):
            self.channel.attach(address, Host(address, self.news))

    def until(self, time: Time) -> None:
        self.kernel.run(time)

    def do(self, address: Address, *commands: LinkCommand) -> None:
        for command in commands:
            self.channel.command(address, command)

    def send(self, address: Address, destination: Address, payload: bytes, token: int | None = None) -> None:
        self.channel.send(address, Outgoing(destination, payload, token))

    def move(self, places_m: Sequence[tuple[float, float]]) -> None:
        self.channel.moved(np.array(places_m, dtype=np.float64))

    def link(self, central: Address, *peripherals: Address) -> None:
        """Make links, and let their first procedures be over."""
        self.do(central, *(Page(peer) for peer in peripherals))
        self.until(self.kernel.now + (1 + len(peripherals)) * S)
        for peer in peripherals:
            assert self.of(peer, Connected)[-1].what.role is Role.SLAVE

    def of(self, address: Address, kind: type) -> list[News]:
        """Return the news of one *kind* that have reached *address*."""
        return [each for each in self.news if each.address == address and isinstance(each.what, kind)]

    def arrived(self, address: Address) -> list[bytes]:
        """Return the payloads that have reached *address*, in order."""
        return [each.what[0] for each in self.of(address, tuple)]


def found(field: Field, address: Address, duration: Time = 2 * S, enough: int = 99) -> None:
    field.do(address, Inquire(duration, enough))
    field.until(field.kernel.now + duration + 1)
