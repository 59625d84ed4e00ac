"""What waits at a courier to be sent, and in which order: acknowledgements, news, frames of others, parts of letters.

Nothing leaves for which the own radio has no room, or to which there is no link; so what is newer can still replace
news, and robots to which letters go take turns.
"""

from binascii import crc_hqx
from collections import defaultdict, deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from struct import Struct
from typing import Final, NamedTuple

from cosim.machine import BROADCAST, Address, Fate, LinkCommand, Outcome, Outgoing
from cosim.units import Time, from_seconds
from protocols.transport.frames import PART_OVERHEAD, Bulletin, Frame, encode
from protocols.transport.links import Links
from protocols.transport.parameters import CourierParameters
from protocols.transport.streams import Inbound, Outbound, Pace

# ---------------------------------------------------------------- backlog
# What the own radio holds of what it was given to send, as far as its host knows: so that nothing piles up in it.
#
# What waits in the radio can be neither replaced by what is newer nor taken back; what waits here can.


class Held(NamedTuple):
    """A frame in the radio."""

    neighbour: Address
    """To whom it goes over the next hop; ``BROADCAST`` for all."""
    since: Time
    part: tuple[Address, int] | None
    """If it is a part of a letter: for whom, and its number."""


class Radio:
    """The frames in it, by their tokens."""

    def __init__(self, room: int, patience: Time) -> None:
        """Have *room* for frames to each neighbour; after *patience* it has forgotten a frame."""
        self._room = room
        self._patience = patience
        self._tokens = 0
        self._held: dict[int, Held] = {}

    def free(self, neighbour: Address) -> bool:
        """Return whether there is room for a frame to *neighbour*."""
        return sum(held.neighbour == neighbour for held in self._held.values()) < self._room

    def enter(self, neighbour: Address, part: tuple[Address, int] | None, now: Time) -> int:
        """Note that a frame is given to it; return the token to be sent with it."""
        self._tokens += 1
        self._held[self._tokens] = Held(neighbour, now, part)
        return self._tokens

    def leave(self, token: int) -> Held | None:
        """Return the frame of which the radio has told the fate; None for what it has long forgotten."""
        return self._held.pop(token, None)

    def forget(self, now: Time) -> list[Held]:
        """Return the frames, once, whose fate was not told in time."""
        gone = [token for token, held in self._held.items() if now - held.since >= self._patience]
        return [self._held.pop(token) for token in gone]

    @property
    def deadline(self) -> Time | None:
        """When it has forgotten the oldest of its frames."""
        for held in self._held.values():  # in the order in which they were given
            return held.since + self._patience
        return None


LOTS: Final = 1 << 16
_LOT: Final = Struct(">BBBI")
RELAYED: Final = 32
"""Frames of others that a master holds for a slave; the oldest are dropped, and sent again by their authors."""


@dataclass(slots=True)
class Counts:
    """What a courier has sent."""

    frames: int = 0
    octets: int = 0
    parts_again: int = 0
    """Parts of letters that were sent before."""
    relayed: int = 0
    """Frames of others."""


class Dispatch:
    """One robot's; all times are those of a clock that never goes back."""

    def __init__(self, me: Address, life: int, parameters: CourierParameters, links: Links | None) -> None:
        """Send for robot *me* in its *life*, over *links* if the radio needs any."""
        self.counts = Counts()
        self._me = me
        self._life = life
        self._links = links
        self._radio = Radio(parameters.in_device, from_seconds(parameters.fate_s))
        self._window = parameters.window
        self._octets = parameters.octets - PART_OVERHEAD
        times = parameters.retry_s, parameters.retry_least_s, parameters.retry_most_s, parameters.give_up_s
        self._pace = Pace(*map(from_seconds, times))
        self.outbound: dict[Address, Outbound] = {}
        """Letters, by their destinations."""
        self._turn = 0
        self._spread = from_seconds(parameters.spread_s) if links is None else 0
        self._news: dict[tuple[Address, int], tuple[Time, bytes]] = {}
        """When they may be sent, by author and topic."""
        self._relays: dict[Address, deque[bytes]] = defaultdict(lambda: deque(maxlen=RELAYED))
        self._out: list[Outgoing] = []

    # ------------------------------------------------------------ what is to be sent

    def post(self, destination: Address, number: int, payload: bytes, now: Time) -> None:
        """Queue a letter."""
        if destination not in self.outbound:
            self.outbound[destination] = Outbound(self._window, self._octets, self._pace)
        self.outbound[destination].post(number, payload, now)

    def say(self, author: Address, news: Bulletin, data: bytes, now: Time) -> None:
        """Queue *data*, a frame of *news*, in place of what it replaces.

        It waits a while, and each news another while: robots that tell at one instant, or say again what they have
        heard at one instant, would destroy each other's frames, and over and over.
        """
        lot = crc_hqx(_LOT.pack(self._me, author, news.topic, news.number), 0xFFFF)
        ready, _ = self._news.get((author, news.topic), (now + self._spread * lot // LOTS, data))
        self._news[author, news.topic] = ready, data

    def relay(self, destination: Address, data: bytes) -> None:
        """Queue a frame of another."""
        self._relays[destination].append(data)

    def forget(self, other: Address) -> list[int]:
        """Drop all that is for *other*; return the numbers of its letters."""
        self._relays.pop(other, None)
        return self.outbound[other].give_up() if other in self.outbound else []

    def hasten(self, destinations: Iterable[Address], now: Time) -> None:
        """Try again soon to reach those who have not answered for a while."""
        for destination in destinations:
            if destination in self.outbound:
                self.outbound[destination].hasten(now)

    def fate(self, fate: Fate, now: Time) -> None:
        """Note what the radio says of a frame."""
        held = self._radio.leave(fate.token)
        if held is not None:
            self._left_radio(held, now if fate.outcome in (Outcome.DELIVERED, Outcome.SENT) else None)

    def _left_radio(self, held: Held, sent_at: Time | None) -> None:
        if held.part is not None:
            destination, number = held.part
            self.outbound[destination].left_device(number, sent_at)

    # ------------------------------------------------------------ time

    def time_out(self, now: Time) -> list[tuple[Address, int]]:
        """Act on deadlines; return the destinations and numbers of the letters that are given up."""
        for held in self._radio.forget(now):
            self._left_radio(held, None)
        gone: list[tuple[Address, int]] = []
        for destination, outbound in self.outbound.items():
            if outbound.deadline is not None and outbound.deadline <= now:
                gone += [(destination, number) for number in outbound.time_out(now)]
        return gone

    def deadlines(self, now: Time) -> Iterator[Time]:
        """Yield when something is to be done by itself: not what waits for the radio."""
        for ready, _ in self._news.values():
            if ready > now:
                yield ready
        for outbound in self.outbound.values():
            if outbound.deadline is not None:
                yield outbound.deadline
        if self._radio.deadline is not None:
            yield self._radio.deadline

    # ------------------------------------------------------------ sending

    def send(self, inbound: Iterable[tuple[Address, Inbound]], now: Time) -> None:
        """Send what may be sent now; *inbound* are letters that come in, by their authors."""
        for author, letters in inbound:
            if letters.due is not None and letters.due <= now:
                hop = self._hop(author)
                if hop is not None:
                    self._send(hop, encode(Frame(self._me, author, self._life, letters.acknowledge())), now)
        self._say_news(now)
        self._pass_on(now)
        while self._send_part(now):
            pass

    def _hop(self, destination: Address) -> Address | None:
        """Return to whom to send what is for *destination*, if there is a way, and the radio has room for it."""
        hop = destination if self._links is None else self._links.hop(destination)
        return hop if hop is not None and self._radio.free(hop) else None

    def _send(self, hop: Address, data: bytes, now: Time, part: tuple[Address, int] | None = None) -> None:
        self.counts.frames += 1
        self.counts.octets += len(data)
        self._out.append(Outgoing(hop, data, self._radio.enter(hop, part, now)))

    def _say_news(self, now: Time) -> None:
        audience = BROADCAST if self._links is None else self._links.audience
        for key in [key for key, (ready, _) in self._news.items() if ready <= now]:
            if audience is None or not self._radio.free(audience):
                break
            self.counts.relayed += key[0] != self._me
            self._send(audience, self._news.pop(key)[1], now)

    def _pass_on(self, now: Time) -> None:
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
                self._send(hop, encode(Frame(self._me, destination, self._life, part)), now, (destination, number))
                self._turn = turn + 1
                return True
        return False

    def drain(self) -> list[Outgoing | LinkCommand]:
        """Return what is to be sent, and the link commands before it, once."""
        out, self._out = self._out, []
        return [*out] if self._links is None else [*self._links.drain(), *out]
