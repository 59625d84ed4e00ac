"""The master's side of the broadcast room: it polls its slaves one by one, and broadcasts what they say (Fig. 9a)."""

from abc import abstractmethod
from collections.abc import Callable

from cosim.machine import BROADCAST, Address, Fate, LinkCommand, Outgoing, Reception
from cosim.units import Time
from protocols.pseudonet.messages import Acknowledgement, Kind, Message, Missing, Packet, Sync, encode
from protocols.pseudonet.polls import Polls
from protocols.pseudonet.upcalls import EXCHANGES, Answered, Garbage, TeamChanged, Upcall, ahead_of


class Leading:
    """The state of an exchange, and what the master does in it."""

    def __init__(
        self,
        me: Address,
        times: tuple[Time, Time],
        poll_retries: int,
        acknowledge: bool,
        tell: Callable[[Upcall, Time], None],
    ) -> None:
        """Take the poll time-out and the repair time as *times*."""
        self.me = me
        self.master: Address | None = None
        self.members: tuple[Address, ...] = (me,)
        self.exchange = 0
        self.out: list[Outgoing | LinkCommand] = []
        self.hop = (0, 0)
        self.polls = Polls(times[0], poll_retries, self.out)
        self._repair = times[1]
        self._repair_at: Time | None = None
        self._asked = False
        self._acknowledge = acknowledge
        self._tell = tell
        self._heard: dict[Address, Message] = {}
        self._before: dict[Address, Message] = {}
        self._early: dict[Address, Message] = {}
        self._submitted = False
        self._last: bytes | None = None
        self._roll_call = False

    def find_master(self) -> Address | None:
        """Return the master's address, or None before there is one (Fig. 12)."""
        return self.master

    def leads(self) -> bool:
        """Return whether this robot begins the exchanges."""
        return self.master == self.me

    @abstractmethod
    def _complete(self, now: Time) -> None:
        """End the exchange if all have been heard."""

    def _join(self, exchange: int) -> None:
        self.exchange = exchange
        self._heard = {}
        self._early = {}
        self._submitted = False
        self._roll_call = False
        self._repair_at = None
        self._asked = False

    # ------------------------------------------------------------ exchanges

    def assemble(self, members: tuple[Address, ...], hop: tuple[int, int], now: Time) -> None:
        """As the master, announce a team of *members* (myself included) and begin its roll call."""
        self.master = self.me
        self.hop = hop
        self._announce(members, now)

    def _begin(self, message: Message, now: Time) -> None:
        self._heard[self.me] = message
        self.polls.pending = [member for member in self.members if member != self.me]
        if self.polls.pending:
            self._send_to_all(encode(message))
        self._poll_next(now)

    def _announce(self, members: tuple[Address, ...], now: Time) -> None:
        self.members = members
        self._before = {}
        self._join((self.exchange + 1) % EXCHANGES)
        self._roll_call = True
        self.polls.stop()
        if len(members) > 1:
            self._send_to_all(encode(self._sync()))
        self._tell(TeamChanged(members), now)

    def _sync(self) -> Sync:
        return Sync(self.me, self.exchange, self.members, self._roll_call, *self.hop)

    def _send_to_all(self, data: bytes) -> None:
        """The service broadcast_to_robots of Fig. 12."""
        self.out.append(Outgoing(BROADCAST, data))

    def _poll_next(self, now: Time) -> None:
        if self.polls.pending:
            self.polls.begin(encode(self._sync()), now)
        else:
            self.polls.stop()
            self._complete(now)

    def _proceed(self, now: Time) -> None:
        """Go on if the polled slave has answered; poll it again if its answer was empty, but not for ever."""
        slave = self.polls.pending[0]
        message = self._heard.get(slave)
        if message is not None:
            self.polls.pending.pop(0)
            self._send_to_all(encode(message))
            self._poll_next(now)
        elif not self.polls.again(encode(self._sync()), now):
            self._drop(slave, now)

    def _drop(self, slave: Address, now: Time) -> None:
        """A robot that misses its poll is unlikely to come back (section IV.A): the others learn the new team."""
        self.polls.dismiss(slave)
        self._announce(tuple(member for member in self.members if member != slave), now)

    def fate(self, fate: Fate, now: Time) -> None:
        """Take the fate of a poll."""
        delivered = self.polls.fate(fate)
        if delivered:
            self._proceed(now)
        elif delivered is not None:
            self._drop(self.polls.pending[0], now)

    # ------------------------------------------------------------ what slaves say

    def _refuse(self, reason: str, reception: Reception, now: Time) -> None:
        self._tell(Garbage(reason), now)
        if self._acknowledge and self.leads() and reception.source in self.members:
            negative = encode(Acknowledgement(self.me, self.exchange, negative=True))
            self.out.append(Outgoing(reception.source, negative))

    def _receive_as_master(self, packet: Packet, data: bytes, reception: Reception, now: Time) -> None:
        if packet.source not in self.members or reception.source != packet.source:
            return
        self.polls.retries = 0
        if isinstance(packet, Missing):
            self._send_again(packet)
        if not isinstance(packet, Message):
            return
        if packet.kind == Kind.ANSWER and packet.addressee is not None:
            self._forward(packet, data, now)
            return
        ahead = ahead_of(self.exchange, packet.exchange)
        if ahead == 0:
            self._heard.setdefault(packet.source, packet)
        elif ahead == 1:  # a slave loads its next message once it has heard all others
            self._early.setdefault(packet.source, packet)
        if self._acknowledge and packet.kind in (Kind.HELP, Kind.TRAP):
            self.out.append(Outgoing(packet.source, encode(Acknowledgement(self.me, packet.exchange))))

    def _send_again(self, missing: Missing) -> None:
        behind = ahead_of(missing.exchange, self.exchange)
        known = self._before if behind == 1 else {} if behind else self._heard
        for robot in missing.robots:
            if robot in known and robot != missing.source:
                self.out.append(Outgoing(missing.source, encode(known[robot])))

    def _forward(self, message: Message, data: bytes, now: Time) -> None:
        if message.addressee == self.me:
            self._tell(Answered(message), now)
        elif message.addressee in self.members:
            self.out.append(Outgoing(message.addressee, data))
