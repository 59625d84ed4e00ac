"""What the stations of one 802.11 network share: times, rules of access, and frames."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple, TypeAlias

from cosim.machine import BROADCAST, Address
from cosim.units import Time

Kind: TypeAlias = Literal["DATA", "ACK", "RTS", "CTS"]

DATA: Final = "DATA"
ACK: Final = "ACK"
RTS: Final = "RTS"
CTS: Final = "CTS"


class Form(NamedTuple):
    """The length and rate of a frame on the air."""

    duration: Time
    """Time on the air, ns."""
    octets: int = 0
    """Octets of the MAC, with the check sequence."""
    rate_kbps: int = 0
    preamble: Time = 0
    """Duration of the PLCP's preamble and header, ns."""


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

    def gives_up(self, packet: "Packet") -> bool:
        """Return whether *packet* has failed as often as it may."""
        limits = ((packet.short, self.short_retries), (packet.long, self.long_retries))
        return any(limit is not None and tried >= limit for tried, limit in limits)


@dataclass(slots=True, eq=False)
class Packet:
    """A payload that a station has to send, until it is done."""

    destination: Address
    payload: bytes
    token: int | None = None
    number: int = -1
    """Sequence number; -1 before it has one."""
    short: int = 0
    """Failures without a response to an RTS, or to a frame without one."""
    long: int = 0
    """Failures of a frame after an RTS."""


class Frame(NamedTuple):
    """A frame on the air."""

    kind: Kind
    source: Address
    destination: Address
    """Receiver; BROADCAST for all."""
    form: Form
    reserves: Time
    """Time after its end for which the exchange goes on and others keep silent (the duration field)."""
    number: int
    """Sequence number of the DATA that it belongs to, counted by the sender of the DATA."""
    packet: Packet | None = None
    """Packet of a DATA frame."""
    begin: Time = -1
    """Instant at which its sender began; -1 before."""


def request(source: Address, packet: Packet, timing: Timing) -> Frame:
    """Return the RTS before *packet* of *source*."""
    payload = timing.unicast(len(packet.payload)).duration
    rest = 3 * timing.sifs + timing.cts.duration + payload + timing.ack.duration
    return Frame(RTS, source, packet.destination, timing.rts, rest, packet.number)


def data(source: Address, packet: Packet, timing: Timing) -> Frame:
    """Return the frame in which *source* sends *packet*."""
    to_all = packet.destination == BROADCAST
    form = (timing.broadcast if to_all else timing.unicast)(len(packet.payload))
    rest = 0 if to_all else timing.sifs + timing.ack.duration
    return Frame(DATA, source, packet.destination, form, rest, packet.number, packet)
