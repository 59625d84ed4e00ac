"""What waits to be sent, and in which order: acknowledgements, publications, frames of others, parts of messages.

A frame leaves only when the own radio has room for it and there is a link. Until then a newer publication can replace
an older one, and the robots to which messages go take turns.
"""

from binascii import crc_hqx
from collections import defaultdict, deque
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from struct import Struct
from typing import Final, NamedTuple

from cosim.machine import BROADCAST, Address, Fate, LinkCommand, Outcome, Outgoing
from cosim.units import Time, from_seconds
from protocols.transport.frames import PART_OVERHEAD, Frame, Publication, encode
from protocols.transport.links import Links
from protocols.transport.parameters import TransportParameters
from protocols.transport.streams import Inbound, Outbound, Pace

# ---------------------------------------------------------------- the own radio
# What waits in the radio can be neither replaced by what is newer nor taken back; what waits here can. So the host
# keeps count of what the radio holds, and gives it little at a time.


class Held(NamedTuple):
    """A frame in the radio."""

    neighbour: Address
    """Destination of the next hop; ``BROADCAST`` for all."""
    since: Time
    part: tuple[Address, int] | None
    """Destination and number of the part, if it is a part of a message."""


class Radio:
    """The frames that the own radio holds, by their tokens, as far as the host knows."""

    def __init__(self, room: int, patience: Time) -> None:
        """Have *room* for so many frames to each neighbour; after *patience* the radio has forgotten a frame."""
        self._room = room
        self._patience = patience
        self._tokens = 0
        self._held: dict[int, Held] = {}

    def free(self, neighbour: Address) -> bool:
        """Return whether there is room for a frame to *neighbour*."""
        held = self._held.values()
        return len(held) < self._room or sum(each.neighbour == neighbour for each in held) < self._room

    def enter(self, neighbour: Address, part: tuple[Address, int] | None, now: Time) -> int:
        """Note that a frame is given to the radio; return the token to be sent with it."""
        self._tokens += 1
        self._held[self._tokens] = Held(neighbour, now, part)
        return self._tokens

    def leave(self, token: int) -> Held | None:
        """Return the frame whose fate the radio has reported; None for one that it has long forgotten."""
        return self._held.pop(token, None)

    def forget(self, now: Time) -> list[Held]:
        """Return the frames, once, whose fate was not reported in time."""
        if not self._held or now - next(iter(self._held.values())).since < self._patience:  # the oldest is the first
            return []
        gone = [token for token, held in self._held.items() if now - held.since >= self._patience]
        return [self._held.pop(token) for token in gone]

    @property
    def deadline(self) -> Time | None:
        """When the radio has forgotten the oldest of its frames."""
        for held in self._held.values():  # in the order in which they were given
            return held.since + self._patience
        return None


LOTS: Final = 1 << 16
_LOT: Final = Struct(">BBBI")
RELAYED: Final = 32
"""Number of frames of others that a master holds for a slave; it drops the oldest, which their authors send again."""


@dataclass(slots=True)
class Counts:
    """What a transport has sent."""

    frames: int = 0
    octets: int = 0
    parts_again: int = 0
    """Parts of messages that were sent before."""
    relayed: int = 0
    """Frames of others."""


class Sender:
    """All that one robot has to send; all times are those of a clock that never goes back."""

    def __init__(self, me: Address, incarnation: int, parameters: TransportParameters, links: Links | None) -> None:
        """Send for robot *me* in its *incarnation*, over *links* if the radio needs any."""
        self.counts = Counts()
        self._me = me
        self._incarnation = incarnation
        self._links = links
        self._radio = Radio(parameters.in_device, from_seconds(parameters.fate_s))
        self._window = parameters.window
        self._octets = parameters.octets - PART_OVERHEAD
        times = parameters.retry_s, parameters.retry_least_s, parameters.retry_most_s, parameters.give_up_s
        self._pace = Pace(*map(from_seconds, times))
        self.outbound: dict[Address, Outbound] = {}
        """Messages, by their destinations."""
        self._turn = 0
        self._spread = from_seconds(parameters.spread_s) if links is None else 0
        self._publications: dict[tuple[Address, int], tuple[Time, bytes]] = {}
        """When each may be sent, and its frame, by author and topic."""
        self._relays: dict[Address, deque[bytes]] = defaultdict(partial(deque, maxlen=RELAYED))
        self._out: list[Outgoing] = []

    # ------------------------------------------------------------ what is to be sent

    def enqueue(self, destination: Address, number: int, payload: bytes, now: Time) -> None:
        """Queue a message."""
        if destination not in self.outbound:
            self.outbound[destination] = Outbound(self._window, self._octets, self._pace)
        self.outbound[destination].enqueue(number, payload, now)

    def publish(self, author: Address, publication: Publication, data: bytes, now: Time) -> None:
        """Queue *data*, the frame of a *publication*, in place of an older one of the same topic."""
        key = author, publication.topic
        ready, _ = self._publications.get(key) or (now + self._lag(author, publication), data)
        self._publications[key] = ready, data

    def _lag(self, author: Address, publication: Publication) -> Time:
        """Return how long a publication waits: robots of which each waits for a time of its own do not collide.

        Those that publish at one instant, or relay what they have received at one instant, would destroy each other's
        frames, and again each time.
        """
        if not self._spread:
            return 0
        lot = crc_hqx(_LOT.pack(self._me, author, publication.topic, publication.number), 0xFFFF)
        return self._spread * lot // LOTS

    def relay(self, destination: Address, data: bytes) -> None:
        """Queue a frame of another robot."""
        self._relays[destination].append(data)

    def forget(self, other: Address) -> list[int]:
        """Drop all that is for *other*; return the numbers of the messages for it."""
        self._relays.pop(other, None)
        return self.outbound[other].give_up() if other in self.outbound else []

    def hasten(self, destinations: Iterable[Address], now: Time) -> None:
        """Try again soon to reach those of *destinations* that have not answered for a while."""
        for destination in destinations:
            if destination in self.outbound:
                self.outbound[destination].hasten(now)

    def fate(self, fate: Fate, now: Time) -> bool:
        """Note what the radio reports of a frame; return whether anything may have waited for that."""
        held = self._radio.leave(fate.token)
        if held is not None:
            self._left_radio(held, now if fate.outcome in (Outcome.DELIVERED, Outcome.SENT) else None)
        return bool(self._publications or self._relays or self.outbound)

    def _left_radio(self, held: Held, sent_at: Time | None) -> None:
        if held.part is not None:
            destination, number = held.part
            self.outbound[destination].left_device(number, sent_at)

    # ------------------------------------------------------------ time

    def time_out(self, now: Time) -> list[tuple[Address, int]]:
        """Act on deadlines; return destinations and numbers of the messages that are given up."""
        for held in self._radio.forget(now):
            self._left_radio(held, None)
        gone: list[tuple[Address, int]] = []
        for destination, outbound in self.outbound.items():
            if outbound.deadline is not None and outbound.deadline <= now:
                gone += [(destination, number) for number in outbound.time_out(now)]
        return gone

    def deadlines(self, now: Time) -> list[Time]:
        """Return the times at which something is due; what waits for the radio has none."""
        dues = []
        for ready, _ in self._publications.values():
            if ready > now:
                dues.append(ready)
        for outbound in self.outbound.values():
            if outbound.deadline is not None:
                dues.append(outbound.deadline)
        if self._radio.deadline is not None:
            dues.append(self._radio.deadline)
        return dues

    # ------------------------------------------------------------ sending

    def send(self, inbound: Iterable[tuple[Address, Inbound]], now: Time) -> None:
        """Send what may be sent now; *inbound* are the streams of messages that come in, with their authors."""
        for author, stream in inbound:
            if stream.due is not None and stream.due <= now:
                hop = self._hop(author)
                if hop is not None:
                    self._send(hop, encode(Frame(self._me, author, self._incarnation, stream.acknowledge())), now)
        if self._publications:
            self._send_publications(now)
        if self._relays:
            self._send_relayed(now)
        while self.outbound and self._send_part(now):
            pass

    def _hop(self, destination: Address) -> Address | None:
        """Return the next hop to *destination*, if there is one and the radio has room for a frame to it."""
        hop = destination if self._links is None else self._links.hop(destination)
        return hop if hop is not None and self._radio.free(hop) else None

    def _send(self, hop: Address, data: bytes, now: Time, part: tuple[Address, int] | None = None) -> None:
        self.counts.frames += 1
        self.counts.octets += len(data)
        self._out.append(Outgoing(hop, data, self._radio.enter(hop, part, now)))

    def _send_publications(self, now: Time) -> None:
        audience = BROADCAST if self._links is None else self._links.audience
        for key in [key for key, (ready, _) in self._publications.items() if ready <= now]:
            if audience is None or not self._radio.free(audience):
                break
            self.counts.relayed += key[0] != self._me
            self._send(audience, self._publications.pop(key)[1], now)

    def _send_relayed(self, now: Time) -> None:
        for destination, frames in self._relays.items():
            if self._links is None or destination not in self._links.slaves:
                frames.clear()  # their authors send them again, maybe another way
            while frames:
                hop = self._hop(destination)
                if hop is None:
                    break
                self.counts.relayed += 1
                self._send(hop, frames.popleft(), now)

    def _send_part(self, now: Time) -> bool:
        """Send one part to the next robot in turn that is to get one; return whether there was any."""
        destinations = list(self.outbound)
        for step in range(len(destinations)):
            turn = (self._turn + step) % len(destinations)
            destination = destinations[turn]
            outbound = self.outbound[destination]
            number, hop = outbound.due(), self._hop(destination)
            if number is not None and hop is not None:
                again, part = outbound.take(number, now)
                self.counts.parts_again += again
                self._send(
                    hop, encode(Frame(self._me, destination, self._incarnation, part)), now, (destination, number)
                )
                self._turn = turn + 1
                return True
        return False

    def drain(self) -> list[Outgoing | LinkCommand]:
        """Return the frames to be sent, and the link commands before them, once."""
        out, self._out = self._out, []
        return [*out] if self._links is None else [*self._links.drain(), *out]
