"""A device as others meet it: what it advertises, and when it listens on which channel."""

from collections.abc import Callable

from cosim.channels.ble.antenna import Antenna
from cosim.channels.ble.beacon import Beacon
from cosim.channels.ble.ether import Ether
from cosim.channels.ble.packets import Sent
from cosim.channels.ble.scanning import ScanWindows
from cosim.kernel import Kernel
from cosim.machine import Address
from cosim.units import Time


class Station:
    """The device *address*, which listens in *windows*."""

    def __init__(self, address: Address, ether: Ether, antenna: Antenna, beacon: Beacon, windows: ScanWindows) -> None:
        self.address = address
        self.antenna = antenna
        self.beacon = beacon
        self.windows = windows
        """When it listens now: other ones during a procedure."""
        self.take: Callable[[Sent, float | None], None] = lambda packet, power_dbm: None
        """Takes a packet for everyone that it has heard, and its power where that is known: what a mesh is made of."""
        self._ether = ether
        self._asked: dict[Address, Callable[[bool], None]] = {}
        """Who has just asked it for a scan response, and what takes whether it answers."""

    def ask(self, kernel: Kernel, scanner: Address, answer: Callable[[bool], None]) -> None:
        """Take a request of *scanner*, heard now; of all requests that are heard at one instant one is answered."""
        if not self._asked:
            kernel.at(kernel.now, self._choose)
        self._asked[scanner] = answer

    def _choose(self) -> None:
        asked, self._asked = self._asked, {}
        for scanner, answer in asked.items():
            answer(scanner == min(asked))

    def is_free(self, start: Time, end: Time) -> bool:
        """Return whether it was on, and its antenna was free to listen, in [start, end)."""
        on = self._ether.was_on(self.address, start)
        return on and self.antenna.taken_until(start, end) is None and self.beacon.taken_until(start, end) is None

    def listens(self, channel: int, start: Time, end: Time) -> bool:
        """Return whether it listened on *channel* all of [start, end)."""
        if not self._ether.was_on(self.address, start):  # most stations of other technologies: they never are
            return False
        windows = self.windows
        return windows.channel(start) == channel == windows.channel(end - 1) and self.is_free(start, end)
