"""The ways in which devices send payloads for everyone, by the setting ``by``."""

from collections.abc import Callable
from typing import Final, NamedTuple, Protocol

from cosim.channels.ble.bits.mesh.upper_transport import LONGEST_PAYLOAD
from cosim.channels.ble.broadcasts.events import Speaker
from cosim.channels.ble.broadcasts.extended import LONGEST_BROADCAST, ExtendedSet
from cosim.channels.ble.broadcasts.legacy import LONGEST_LEGACY, LegacySet
from cosim.channels.ble.broadcasts.mesh import Node
from cosim.channels.ble.broadcasts.sets import Sets
from cosim.channels.ble.settings import BroadcastSettings
from cosim.machine import Outgoing


class Broadcaster(Protocol):
    """What sends a device's payloads for everyone."""

    @property
    def held(self) -> int:
        """The number of payloads that are not over."""

    def send(self, outgoing: Outgoing) -> None:
        """Send a payload."""

    def flush(self) -> list[Outgoing]:
        """Take out, and return, the payloads that have not been on the air, as far as that can be."""

    def cancel(self) -> None:
        """Forget all payloads: the device is off."""


class Way(NamedTuple):
    """A way to send payloads for everyone."""

    longest: int
    """Octets of the longest payload."""
    make: Callable[[Speaker, BroadcastSettings], Broadcaster]


WAYS: Final[dict[str, Way]] = {
    "extended": Way(LONGEST_BROADCAST, lambda speaker, settings: Sets(speaker, ExtendedSet, settings)),
    "legacy": Way(LONGEST_LEGACY, lambda speaker, settings: Sets(speaker, LegacySet, settings)),
    "mesh": Way(LONGEST_PAYLOAD, lambda speaker, settings: Node(speaker, settings.mesh)),
}
"""The ways, by their names."""
