"""The broadcast layer: one exchange after another, in each of which every robot's message reaches the whole team.

A slave hears only the master, so a message takes two hops (paper 003, section V, Figs 8 and 9a): the master
broadcasts its own message, then for each slave polls it, takes its message and broadcasts that. On the air a broadcast
has LT_ADDR 0 and is not answered, so that the poll is a frame of its own (the paper puts both into one slot).

Exchanges are numbered modulo 256. A robot has one message in an exchange: it is loaded before the poll, as a link
controller can only answer with what it holds. The exchange is complete for a robot once it has received all other
messages. A slave that is asked before it has a message sends "busy", and the team repeats the exchange. A polled slave
that does not answer within the poll time-out is dropped, and a roll call announces the new team to the others.

Broadcasts are not acknowledged, so that a slave may miss some. It asks the master for those that it lacks when it
learns of the next exchange, or when nothing has come for the repair time; the master keeps the messages of two
exchanges and sends them to that slave alone, by acknowledged packets. The master cannot complete the next exchange
before it has the slave's message of it, which the slave loads only after it has completed this one: so all robots of a
team see the same exchanges, one after the other, and no robot is ever behind by more than one.
"""

from collections.abc import Callable

from cosim.errors import WireError
from cosim.machine import BROADCAST, Address, Disconnect, Fate, LinkCommand, Outcome, Outgoing, Reception
from cosim.units import Time
from protocols.pseudonet.messages import (
    NARROW,
    Acknowledgement,
    Form,
    Kind,
    Message,
    Missing,
    Packet,
    Sync,
    decode,
    encode,
)
from protocols.pseudonet.upcalls import (
    EXCHANGES,
    Answered,
    Broken,
    Exchanged,
    Garbage,
    MessageWanted,
    TeamChanged,
    Upcall,
    ahead_of,
)


class Polls:
    """The master's polls of one exchange, with retries and time-outs (paper 003, sections IV.A and V).

    What is to be sent goes to *out*, the queue of the broadcast layer.
    """

    def __init__(self, timeout: Time, most_retries: int, out: list[Outgoing | LinkCommand]) -> None:
        self.pending: list[Address] = []
        """Slaves whose messages are wanted; the first is being polled."""
        self.deadline: Time | None = None
        self.retries = 0
        """Number of polls of the present slave since anything came from it, less one."""
        self.token = 0
        """Token of the last poll."""
        self._timeout = timeout
        self._most_retries = most_retries
        self._out = out
        self._answered = False

    def begin(self, poll: bytes, now: Time) -> None:
        """Poll the first of the pending slaves."""
        self.retries = 0
        self._poll(poll, now)

    def again(self, poll: bytes, now: Time) -> bool:
        """Poll the same slave once more; return False if its retries are used up."""
        if self.retries >= self._most_retries:
            return False
        self.retries += 1
        self._poll(poll, now)
        return True

    def fate(self, fate: Fate) -> bool | None:
        """Return whether the present poll was acknowledged; None if *fate* is that of something else."""
        if not self.pending or fate.token != self.token or self._answered:
            return None
        self._answered = fate.outcome == Outcome.DELIVERED
        return self._answered

    def stop(self) -> None:
        """Stop polling."""
        self.pending = []
        self.deadline = None

    def _poll(self, poll: bytes, now: Time) -> None:
        self.token += 1
        self._answered = False
        self.deadline = now + self._timeout
        self._out.append(Outgoing(self.pending[0], poll, self.token))


class Broadcast:
    """The exchanges as one robot sees them, master or slave; *upcall* informs the layer above."""

    polled = True
    """True: messages are asked for, whether they are ready or not."""
    piconets = 1

    def __init__(
        self,
        me: Address,
        times: tuple[Time, Time],
        poll_retries: int,
        acknowledge: bool,
        upcall: Callable[[Upcall, Time], None],
        form: Form = NARROW,
    ) -> None:
        """Take the poll time-out and the repair time as *times*; packets are of this *form*."""
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
        self._upcall = upcall
        self._form = form
        self._heard: dict[Address, Message] = {}
        self._before: dict[Address, Message] = {}
        self._early: dict[Address, Message] = {}
        self._submitted = False
        self._last: bytes | None = None
        self._poll = b""
        """Poll of all slaves in this exchange."""
        self._roll_call = False

    def find_master(self) -> Address | None:
        """Return the master's address, or None before there is one (Fig. 12)."""
        return self.master

    def leads(self) -> bool:
        """Return whether this robot begins the exchanges."""
        return self.master == self.me

    @property
    def deadline(self) -> Time | None:
        """Instant at which this layer is to be woken."""
        return self.polls.deadline if self.leads() else self._repair_at

    def assemble(self, members: tuple[Address, ...], hop: tuple[int, int], now: Time) -> None:
        """Announce a team of *members*, this robot included, as its master, and begin its roll call."""
        self.master = self.me
        self.hop = hop
        self._announce(members, now)

    def load(self, message: Message, now: Time) -> None:
        """Load this robot's *message* of the present exchange: the master begins it, a slave waits for its poll."""
        if self.leads():
            self._begin(message, now)
        else:
            self._submit(message, now)

    def loaded(self) -> bool:
        """Return whether this robot's message is loaded already, or, for the master, the exchange is under way."""
        return bool(self.polls.pending) if self.leads() else self._submitted

    def leave(self) -> None:
        """Forget the team: there is none until the next roll call."""
        self.master = None
        self.members = (self.me,)
        self._before = {}
        self._join((self.exchange + 2) % EXCHANGES)
        self.polls.stop()

    def dispensable(self, robot: Address) -> bool:
        """Return whether the others can talk without *robot*, a member: not without the master."""
        return robot != self.master

    def release(self, robots: tuple[Address, ...], now: Time) -> None:
        """Let *robots* go, as the master, and announce the new team: they are polled no more."""
        self.out += [Disconnect(robot) for robot in robots]
        self._announce(tuple(member for member in self.members if member not in robots), now)

    def wake(self, now: Time) -> None:
        """Drop the polled slave when its time is over; as a slave, ask for what is missing."""
        if self.leads():
            if self.polls.deadline is not None and now >= self.polls.deadline:
                self._drop(self.polls.pending[0], now)
        elif self._repair_at is not None and now >= self._repair_at:
            self._ask(now)

    def fate(self, fate: Fate, now: Time) -> None:
        """Process the fate of a poll."""
        delivered = self.polls.fate(fate)
        if delivered:
            self._proceed(now)
        elif delivered is not None:
            self._drop(self.polls.pending[0], now)

    def lost(self, peer: Address, now: Time) -> None:
        """Process the loss of a link."""
        if self.leads():
            if peer in self.members and peer != self.me:
                self._drop(peer, now)
        elif peer == self.master:
            self._upcall(Broken((peer,)), now)

    # ------------------------------------------------------------ the master's side (Fig. 9a)

    def _begin(self, message: Message, now: Time) -> None:
        self._heard[self.me] = message
        self.polls.pending = [member for member in self.members if member != self.me]
        if self.polls.pending:
            self._send_to_all(self._encode(message))
            self._poll = self._encode(self._sync())
        self._poll_next(now)

    def _announce(self, members: tuple[Address, ...], now: Time) -> None:
        self.members = members
        self._before = {}
        self._join((self.exchange + 1) % EXCHANGES)
        self._roll_call = True
        self.polls.stop()
        if len(members) > 1:
            self._send_to_all(self._encode(self._sync()))
        self._upcall(TeamChanged(members), now)

    def _sync(self) -> Sync:
        return Sync(self.me, self.exchange, self.members, self._roll_call, *self.hop)

    def _send_to_all(self, data: bytes) -> None:
        """Broadcast *data*: the service broadcast_to_robots of Fig. 12."""
        self.out.append(Outgoing(BROADCAST, data))

    def _poll_next(self, now: Time) -> None:
        if self.polls.pending:
            self.polls.begin(self._poll, now)
        else:
            self.polls.stop()
            self._complete(now)

    def _proceed(self, now: Time) -> None:
        """Go on if the polled slave has answered; poll it again if its answer was empty, as often as allowed."""
        slave = self.polls.pending[0]
        message = self._heard.get(slave)
        if message is not None:
            self.polls.pending.pop(0)
            self._send_to_all(self._encode(message))
            self._poll_next(now)
        elif not self.polls.again(self._poll, now):
            self._drop(slave, now)

    def _drop(self, slave: Address, now: Time) -> None:
        """Drop *slave* and announce the new team."""
        # a robot that misses its poll is unlikely to come back (section IV.A)
        self.release((slave,), now)

    def _refuse(self, reason: str, reception: Reception, now: Time) -> None:
        self._upcall(Garbage(reason), now)
        if self._acknowledge and self.leads() and reception.source in self.members:
            negative = self._encode(Acknowledgement(self.me, self.exchange, negative=True))
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
            self.out.append(Outgoing(packet.source, self._encode(Acknowledgement(self.me, packet.exchange))))

    def _send_again(self, missing: Missing) -> None:
        behind = ahead_of(missing.exchange, self.exchange)
        known = self._before if behind == 1 else {} if behind else self._heard
        for robot in missing.robots:
            if robot in known and robot != missing.source:
                self.out.append(Outgoing(missing.source, self._encode(known[robot])))

    def _forward(self, message: Message, data: bytes, now: Time) -> None:
        if message.addressee == self.me:
            self._upcall(Answered(message), now)
        elif message.addressee in self.members:
            self.out.append(Outgoing(message.addressee, data))

    # ------------------------------------------------------------ the slaves' side

    def _submit(self, message: Message, now: Time) -> None:
        self._submitted = True
        self._last = self._encode(message)
        self._heard[self.me] = message
        self._send_to_master(self._last)
        self._complete(now)

    def _send_to_master(self, data: bytes) -> None:
        if self.master is not None:
            self.out.append(Outgoing(self.master, data))

    def answer(self, message: Message) -> None:
        """Send an answer to one robot alone, by way of the master."""
        data = self._encode(message)
        if self.leads():
            self.out.append(Outgoing(self.me if message.addressee is None else message.addressee, data))
        else:
            self._send_to_master(data)

    def _ask_once(self, now: Time) -> None:
        """Ask the master once for what was missed, as the others are one exchange further."""
        if not self._asked:
            self._ask(now)

    def _ask(self, now: Time) -> None:
        """Ask the master for the missing messages of this exchange."""
        missing = tuple(member for member in self.members if member not in self._heard)
        self._asked = True
        self._repair_at = now + self._repair if missing else None
        if missing:
            self._send_to_master(self._encode(Missing(self.me, self.exchange, missing)))

    def _receive_as_slave(self, packet: Packet, reception: Reception, now: Time) -> bool:
        if self.master is None and isinstance(packet, Sync) and packet.roll_call:
            self._enlist(packet, reception.source, now)
        if reception.source != self.master:
            return True
        match packet:
            case Message(addressee=None):
                return self._hear(packet, now)
            case Message(kind=Kind.ANSWER, addressee=addressee):
                if addressee == self.me:
                    self._upcall(Answered(packet), now)
            case Sync():
                self._synchronise(packet, now)
            case Acknowledgement(negative=True) if self._last is not None:
                self._send_to_master(self._last)
        return True

    def _enlist(self, sync: Sync, master: Address, now: Time) -> None:
        """Process the first roll call of a team."""
        self.master = master
        self.hop = (sync.hop_address, sync.hop_clock)
        self._begin_roll_call(sync, now)

    def _synchronise(self, sync: Sync, now: Time) -> None:
        ahead = ahead_of(self.exchange, sync.exchange)
        # a poll of a roll call that this robot has already completed is one behind, that is 255 ahead
        if sync.roll_call and (ahead < EXCHANGES // 2 if ahead else sync.members != self.members):
            self._begin_roll_call(sync, now)
        elif ahead == 1:
            self._ask_once(now)
        elif ahead == 0:
            self._repair_at = now + self._repair
            if not self._submitted:
                self._upcall(MessageWanted(), now)

    def _begin_roll_call(self, sync: Sync, now: Time) -> None:
        self._join(sync.exchange)
        if self.me not in sync.members:
            self._upcall(Broken(), now)
            return
        self.members = sync.members
        self._roll_call = True
        self._upcall(TeamChanged(sync.members), now)

    def _hear(self, message: Message, now: Time) -> bool:
        """Process a message of another robot; return False if it has only been kept."""
        if message.source not in self.members:
            return True
        ahead = ahead_of(self.exchange, message.exchange)
        if ahead == 0:
            waits = self._submitted and self._repair_at is not None
            self._heard.setdefault(message.source, message)
            self._repair_at = now + self._repair
            self._asked = False
            if not self._submitted:
                self._upcall(MessageWanted(), now)
            return self._complete(now) or not waits
        if ahead == 1:
            self._early.setdefault(message.source, message)
            self._ask_once(now)
        return True

    # ------------------------------------------------------------ both

    def receive(self, data: bytes, reception: Reception, now: Time) -> bool:
        """Process received bytes; return False if nothing has come of them but a later deadline."""
        try:
            packet = decode(data, self._form)
        except WireError as error:
            self._refuse(str(error), reception, now)
            return True
        if packet.source == self.me:
            return False  # a piconet's broadcasts return to their author
        if self.leads():
            self._receive_as_master(packet, data, reception, now)
            return True
        return self._receive_as_slave(packet, reception, now)

    def _encode(self, packet: Packet) -> bytes:
        return encode(packet, self._form)

    def overhear(self, data: bytes, now: Time) -> None:
        """Process bytes of a robot without a link to this one: they matter only if they are no packet."""
        try:
            decode(data, self._form)
        except WireError as error:
            self._upcall(Garbage(str(error)), now)

    def _join(self, exchange: int) -> None:
        self.exchange = exchange
        self._heard = {}
        self._early = {}
        self._submitted = False
        self._roll_call = False
        self._repair_at = None
        self._asked = False

    def _complete(self, now: Time) -> bool:
        """End the exchange if all messages of it are there; return whether they are."""
        if len(self._heard) < len(self.members):
            return False
        messages = {member: self._heard[member] for member in self.members}
        roll_call = self._roll_call
        early = self._early
        self._before = messages
        self._join((self.exchange + 1) % EXCHANGES)
        if self.leads():
            self._heard = early
        self._upcall(Exchanged(messages, roll_call), now)
        if not self.leads():
            for message in early.values():
                self._hear(message, now)
        return True
