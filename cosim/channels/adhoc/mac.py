"""What the stations of one 802.11 network share: times, rules of access, thresholds, and packets."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from cosim.machine import BROADCAST, Address
from cosim.units import Time

DATA: Final = 0
ACK: Final = 1
RTS: Final = 2
CTS: Final = 3
KINDS: Final = ("DATA", "ACK", "RTS", "CTS")
"""Names of the kinds of frames, by number."""


class Form(NamedTuple):
    """The length and rate of a frame on the air, and where its bits are."""

    duration: Time
    """Time on the air, ns."""
    octets: int = 0
    """Octets of the MAC, with the check sequence."""
    rate_kbps: int = 0
    preamble: Time = 0
    """Duration of the PLCP's preamble and header, ns, after which the octets begin."""
    header: Time = 0
    """Time from the beginning to the header, ns."""
    header_kbps: int = 0
    header_bits: int = 0
    end: Time = 0
    """Time from the beginning to the end of the octets, ns; silence may follow."""


class Timing(NamedTuple):
    """Times of the physical layer in ns, and its frames (IEEE 802.11-1999, clause 9.2.10)."""

    slot: Time
    sifs: Time
    difs: Time
    eifs: Time
    cca: Time
    """Time from when energy arrives until it is sensed; less than a slot."""
    delay: Time
    """Propagation delay, the same for all."""
    timeout: Time
    """Time after the end of a frame for which an answer is waited for (9.2.8); for Bianchi's model less than DIFS."""
    ack: Form
    rts: Form
    cts: Form
    unicast: Callable[[int], Form]
    """Form of a frame to one station, by the octets of its payload."""
    broadcast: Callable[[int], Form]
    """Form of a frame to all, at the lowest basic rate, by the octets of its payload."""


class Access(NamedTuple):
    """The rules by which stations get at the medium."""

    cw_min: int = 31
    cw_max: int = 1023
    rts_threshold: int | None = None
    """Octets above which a payload is preceded by RTS and CTS; None: no payload is."""
    short_retries: int | None = 7
    """Number of tries of an RTS, or of a frame without one; None: until it succeeds."""
    long_retries: int | None = 4
    """Number of tries of a frame after an RTS."""
    bianchi_counting: bool = False
    """True if a busy period takes a slot from every back-off."""

    def asks(self, packet: "Packet") -> bool:
        """Return whether *packet* is preceded by an RTS."""
        threshold = self.rts_threshold
        return threshold is not None and len(packet.payload) > threshold and packet.destination != BROADCAST


class Limits(NamedTuple):
    """Noise and thresholds of a receiver."""

    noise_mw: float
    follows_mw: float
    """Power in mW below which a frame is not noticed as one."""
    busy_mw: float
    """Energy in mW that makes the medium busy, whatever it is."""
    capture: float
    """Ratio of powers at which a frame takes the place of another; inf: never."""


@dataclass(slots=True, eq=False)
class Packet:
    """A payload that a station has to send, until it is done."""

    destination: Address
    payload: bytes
    token: Any = None
    """What its sender is handed back with its fate; None if it does not ask for that."""
    only_failure: bool = False
    """True if it asks to hear of a failure only."""
