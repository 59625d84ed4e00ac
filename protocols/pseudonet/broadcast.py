"""The broadcast room: one exchange after another, in each of which every robot's message reaches the whole team.

A slave hears nobody but the master, so a message takes two hops (paper 003, section V, Figs 8 and 9a): the master
broadcasts its own message, then for each slave polls it, takes its message and broadcasts that. On the air a broadcast
has LT_ADDR 0 and is answered by nobody, so that the poll is a frame of its own (the paper puts both into one slot).

Exchanges are numbered modulo 256. A robot has one message in an exchange: it is loaded before the poll, as a link
controller can only answer with what it holds. The exchange is complete for a robot once it has heard all others.
A slave that falls out of step (it hears of an exchange that it has nothing for) sends a message that says "busy", which
makes the team repeat itself. A polled slave that does not answer within the poll time-out is dropped, and a roll call
tells the others the new team.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TypeAlias

from cosim.errors import WireError
from cosim.machine import BROADCAST, Address, Disconnect, Fate, LinkCommand, Outcome, Outgoing, Reception
from cosim.units import Time
from protocols.pseudonet.messages import Acknowledgement, Kind, Message, Packet, Sync, decode, encode

EXCHANGES = 256


@dataclass(frozen=True, slots=True)
class Exchanged:
    """An exchange is complete; *messages* holds one of each member, by source."""

    messages: dict[Address, Message]
    roll_call: bool
    """It was the first one of this team."""


@dataclass(frozen=True, slots=True)
class TeamChanged:
    """A roll call has begun: the first message of this team is wanted."""

    members: tuple[Address, ...]


@dataclass(frozen=True, slots=True)
class MessageWanted:
    """The master has begun an exchange for which this slave has not loaded a message yet."""


@dataclass(frozen=True, slots=True)
class Answered:
    """An answer to this robot alone has come in."""

    message: Message


@dataclass(frozen=True, slots=True)
class Garbage:
    """Bytes came in that are no packet."""

    reason: str


Upcall: TypeAlias = Exchanged | TeamChanged | MessageWanted | Answered | Garbage


class Broadcast:
    """The exchanges as one robot sees them, master or slave. What it has to say to the room above goes to *tell*."""

    def __init__(
        self,
        me: Address,
        poll_timeout: Time,
        poll_retries: int,
        acknowledge: bool,
        tell: Callable[[Upcall, Time], None],
    ) -> None:
        self.me = me
        self.master: Address | None = None
        self.members: tuple[Address, ...] = (me,)
        self.exchange = 0
        self.deadline: Time | None = None
        self.out: list[Outgoing | LinkCommand] = []
        self.hop = (0, 0)
        self._poll_timeout = poll_timeout
        self._poll_retries = poll_retries
        self._acknowledge = acknowledge
        self._tell = tell
        self._heard: dict[Address, Message] = {}
        self._early: dict[tuple[Address, int], Message] = {}
        self._submitted: Message | None = None
        self._last: bytes | None = None
        self._roll_call = False
        self._pending: list[Address] = []
        self._token = 0
        self._retries = 0
        self._poll_answered = False

    # ------------------------------------------------------------ the master's side

    def find_master(self) -> Address | None:
        """Return the master's address, or None before there is one (Fig. 12)."""
        return self.master

    def assemble(self, members: tuple[Address, ...], hop: tuple[int, int], now: Time) -> None:
        """As the master, announce a team of *members* (myself included) and begin its roll call."""
        self.master = self.me
        self.hop = hop
        self._announce(members, now)

    def begin(self, message: Message, now: Time) -> None:
        """As the master, run one exchange, beginning with my own *message*."""
        self._heard = {self.me: message}
        self._pending = [member for member in self.members if member != self.me]
        if self._pending:
            self._send_to_all(encode(message))
        self._poll_next(now)

    def _announce(self, members: tuple[Address, ...], now: Time) -> None:
        self.members = members
        self.exchange = (self.exchange + 1) % EXCHANGES
        self._early = {}
        self._heard = {}
        self._roll_call = True
        self._pending = []
        self.deadline = None
        if len(members) > 1:
            self._send_to_all(encode(self._sync()))
        self._tell(TeamChanged(members), now)

    def _sync(self) -> Sync:
        return Sync(self.me, self.exchange, self.members, self._roll_call, *self.hop)

    def _send_to_all(self, data: bytes) -> None:
        """The service broadcast_to_robots of Fig. 12."""
        self.out.append(Outgoing(BROADCAST, data))

    def _poll_next(self, now: Time) -> None:
        self._retries = 0
        if self._pending:
            self._poll(now)
        else:
            self.deadline = None
            self._complete(now)

    def _poll(self, now: Time) -> None:
        self._token += 1
        self._poll_answered = False
        self.deadline = now + self._poll_timeout
        self.out.append(Outgoing(self._pending[0], encode(self._sync()), self._token))

    def _proceed(self, now: Time) -> None:
        """Go on if the polled slave has answered; poll it again if its answer was empty, but not for ever."""
        slave = self._pending[0]
        message = self._early.pop((slave, self.exchange), None)
        if message is not None:
            self._heard[slave] = message
            self._pending.pop(0)
            self._send_to_all(encode(message))
            self._poll_next(now)
        elif self._retries < self._poll_retries:
            self._retries += 1
            self._poll(now)
        else:
            self._drop(slave, now)

    def _drop(self, slave: Address, now: Time) -> None:
        """A robot that misses its poll is unlikely to come back (section IV.A): the others learn the new team."""
        self._early = {key: message for key, message in self._early.items() if key[0] != slave}
        self.out.append(Disconnect(slave))
        self._announce(tuple(member for member in self.members if member != slave), now)

    def fate(self, fate: Fate, now: Time) -> None:
        """Take the fate of a poll."""
        if not self._pending or fate.token != self._token or self._poll_answered:
            return
        if fate.outcome == Outcome.DELIVERED:
            self._poll_answered = True
            self._proceed(now)
        else:
            self._drop(self._pending[0], now)

    def wake(self, now: Time) -> None:
        """Give up the polled slave when its time is over."""
        if self.deadline is not None and now >= self.deadline and self._pending:
            self._drop(self._pending[0], now)

    def lost(self, slave: Address, now: Time) -> None:
        """As the master, take notice that a link is gone."""
        if slave in self.members and slave != self.me:
            self._drop(slave, now)

    # ------------------------------------------------------------ the slaves' side

    def submit(self, message: Message) -> None:
        """As a slave, load the message of the present exchange; the next poll takes it."""
        self._submitted = message
        self._last = encode(message)
        self._heard[self.me] = message
        self._send_to_master(self._last)

    def loaded(self) -> bool:
        """Return whether the present exchange has my message already, or, for the master, is under way."""
        return bool(self._pending) if self.me == self.master else self._submitted is not None

    def _send_to_master(self, data: bytes) -> None:
        if self.master is not None:
            self.out.append(Outgoing(self.master, data))

    def answer(self, message: Message) -> None:
        """Send an answer to one robot alone, through the master."""
        data = encode(message)
        if self.me == self.master:
            self.out.append(Outgoing(self._addressee(message), data))
        else:
            self._send_to_master(data)

    def _addressee(self, message: Message) -> Address:
        return self.me if message.addressee is None else message.addressee

    # ------------------------------------------------------------ both

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        """Take bytes off the air."""
        try:
            packet = decode(data)
        except WireError as error:
            self._refuse(str(error), reception, now)
            return
        if packet.source == self.me:
            return  # a piconet's broadcasts return to their author
        if self.me == self.master:
            self._receive_as_master(packet, data, reception, now)
        else:
            self._receive_as_slave(packet, reception, now)

    def _refuse(self, reason: str, reception: Reception, now: Time) -> None:
        self._tell(Garbage(reason), now)
        if self._acknowledge and self.me == self.master and reception.source in self.members:
            negative = encode(Acknowledgement(self.me, self.exchange, negative=True))
            self.out.append(Outgoing(reception.source, negative))

    def _receive_as_master(self, packet: Packet, data: bytes, reception: Reception, now: Time) -> None:
        if not isinstance(packet, Message) or packet.source not in self.members or reception.source != packet.source:
            return
        self._retries = 0
        if packet.kind == Kind.ANSWER and packet.addressee is not None:
            self._forward(packet, data, now)
            return
        # it may be ahead of its poll: a slave loads its next message once it has heard all others
        if (packet.exchange - self.exchange) % EXCHANGES <= 1 and packet.source not in self._taken(packet.exchange):
            self._early[packet.source, packet.exchange] = packet
        if self._acknowledge and packet.kind in (Kind.HELP, Kind.TRAP):
            self.out.append(Outgoing(packet.source, encode(Acknowledgement(self.me, packet.exchange))))

    def _taken(self, exchange: int) -> Iterable[Address]:
        """Return whose messages of *exchange* are in already: a repetition must not be kept for 256 exchanges."""
        return self._heard if exchange == self.exchange else ()

    def _forward(self, message: Message, data: bytes, now: Time) -> None:
        if message.addressee == self.me:
            self._tell(Answered(message), now)
        elif message.addressee in self.members:
            self.out.append(Outgoing(message.addressee, data))

    def _receive_as_slave(self, packet: Packet, reception: Reception, now: Time) -> None:
        if self.master is not None and reception.source != self.master:
            return
        match packet:
            case Sync():
                self._synchronise(packet, reception, now)
            case Message(kind=Kind.ANSWER, addressee=addressee) if addressee is not None:
                if addressee == self.me:
                    self._tell(Answered(packet), now)
            case Message():
                self._hear(packet, now)
            case Acknowledgement(negative=True) if self._last is not None:
                self._send_to_master(self._last)

    def _synchronise(self, sync: Sync, reception: Reception, now: Time) -> None:
        self.master = reception.source
        self.hop = (sync.hop_address, sync.hop_clock)
        ahead = (sync.exchange - self.exchange) % EXCHANGES
        # a poll of a roll call that this robot has already completed is one behind, that is 255 ahead
        if sync.roll_call and (ahead < EXCHANGES // 2 if ahead else sync.members != self.members):
            self.members = sync.members
            self._join(sync.exchange)
            self._roll_call = True
            self._tell(TeamChanged(sync.members), now)

    def _join(self, exchange: int) -> None:
        self.exchange = exchange
        self._heard = {}
        self._submitted = None
        self._roll_call = False

    def _hear(self, message: Message, now: Time) -> None:
        if message.source not in self.members or self.me not in self.members:
            return
        ahead = (message.exchange - self.exchange) % EXCHANGES
        if ahead == 1:  # the team is one exchange further than this robot: it has missed something
            self._join(message.exchange)
        elif ahead:
            return
        self._heard.setdefault(message.source, message)
        if self._submitted is None:
            self._tell(MessageWanted(), now)
        self._complete(now)

    def _complete(self, now: Time) -> None:
        if len(self._heard) < len(self.members):
            return
        messages = {member: self._heard[member] for member in self.members}
        roll_call = self._roll_call
        self._join((self.exchange + 1) % EXCHANGES)
        self._tell(Exchanged(messages, roll_call), now)
