"""The broadcast layer of a scatternet: every robot's message of an exchange reaches the team over several piconets.

In a single piconet the master polls (module ``broadcast``). Across piconets no robot can poll all others: here a robot
sends its message to its masters as soon as it has one, a master broadcasts what it receives, and bridges forward what
is new to them; what they know already, by origin and number of the exchange, they drop. An exchange is complete for a
robot once it has the messages of all members. As no robot can complete an exchange without all messages, no robot is
ever ahead of another by more than one.

What a slave sends to its master is acknowledged by the radio; broadcasts are not, so that some are missed. A robot that
lacks messages and has received nothing new for a while asks its neighbours, which keep the messages of the last
exchanges.

The root, the coordinator that has formed the scatternet, decides who belongs to the team (module ``census``): reports
go to it, roll calls come from it, all robots forward both. What must not be lost here is sent to each neighbour by
itself, and acknowledged by the radio.
"""

from collections.abc import Callable, Mapping

from cosim.errors import WireError
from cosim.machine import BROADCAST, Address, Disconnect, Fate, LinkCommand, Outgoing, Reception, Role
from cosim.units import Time
from protocols.pseudonet.census import Registry
from protocols.pseudonet.messages import Kind, Message, Missing
from protocols.pseudonet.topology import Directory
from protocols.pseudonet.upcalls import EXCHANGES, Answered, Broken, Exchanged, Garbage, TeamChanged, Upcall, ahead_of
from protocols.pseudonet.wide import Assignment, Census, Dissolution, Welcome, decode, encode

PATIENCE = 3
"""Number of repair times after which a master asks its slaves as well."""


class Relay:
    """The exchanges of a scatternet as one robot sees them; *upcall* informs the layer above.

    *links* is the own role in the link to each neighbour, kept by the Bluetooth layer, to which assignments and
    welcomes are passed by *instruct*.
    """

    polled = False
    """False: messages are sent when they are ready."""

    def __init__(
        self,
        me: Address,
        times: tuple[Time, Time],
        links: Mapping[Address, Role],
        upcall: Callable[[Upcall, Time], None],
        instruct: Callable[[Assignment | Welcome, Address, Time], None],
    ) -> None:
        """Take the repair time and the time after which silent robots are dropped as *times*."""
        self.me = me
        self.exchange = 0
        self.out: list[Outgoing | LinkCommand] = []
        self.registry = Registry(me)
        self._links = links
        self._upcall = upcall
        self._active = False
        self._repair, self._silence = times
        self._instruct = instruct
        self._stored: dict[int, dict[Address, Message]] = {0: {}}
        """Messages by exchange: the last, the present, and the next one."""
        self._answers: set[bytes] = set()
        self._roll_call = False
        self._ask_at: Time | None = None
        self._asked = 0
        self._stall_at: Time | None = None

    @property
    def members(self) -> tuple[Address, ...]:
        """Members of the team."""
        return self.registry.directory.members or (self.me,)

    @property
    def piconets(self) -> int:
        """Number of piconets."""
        return len(self.registry.directory.piconets)

    def find_master(self) -> Address | None:
        """Return the root of the scatternet; None before the roll was called."""
        return self.registry.root if self.registry.directory.piconets else None

    def leads(self) -> bool:
        """Return whether this robot is the root."""
        return self.find_master() == self.me

    @property
    def deadline(self) -> Time | None:
        """Instant at which this layer is to be woken."""
        deadlines = (self._ask_at, self._stall_at, self.registry.deadline)
        return min((deadline for deadline in deadlines if deadline is not None), default=None)

    def load(self, message: Message, now: Time) -> None:
        """Send this robot's *message* of the present exchange to all."""
        self._take(message, self.me, now)

    def loaded(self) -> bool:
        """Return whether the present exchange has this robot's message already."""
        return self.me in self._stored[self.exchange]

    def answer(self, message: Message) -> None:
        """Send an answer to one robot alone."""
        self._pass_on(encode(message, self.registry.directory), self.me)

    def leave(self) -> None:
        """Forget the team: there is none until the next roll call."""
        self._active = False
        self.registry.forget()
        self._join((self.exchange + 2) % EXCHANGES)
        self._ask_at = self._stall_at = None

    def dispensable(self, robot: Address) -> bool:
        """Return whether the others can talk without *robot*, a member: not without a master or a bridge."""
        return self.registry.directory.is_plain(robot)

    def release(self, robots: tuple[Address, ...], now: Time) -> None:
        """Let *robots* go, which all are dispensable, and call the roll of the others, as the root."""
        without = self.registry.roll_without(robots)
        if without is not None:
            self._call_roll(without, now)

    def fate(self, fate: Fate, now: Time) -> None:
        """Ignore fates: nothing that this layer sends has a token."""

    def wake(self, now: Time) -> None:
        """Ask for what is missing; drop robots that have been silent for long."""
        if self.registry.deadline is not None and now >= self.registry.deadline:
            self.registry.deadline = None
            self.dissolve(self.registry.absent(), now)
        if self._stall_at is not None and now >= self._stall_at:
            self._give_up(now)
        if self._ask_at is not None and now >= self._ask_at:
            self._ask(now)

    # ------------------------------------------------------------ what is missing

    def _missing(self) -> tuple[Address, ...]:
        heard = self._stored[self.exchange]
        return tuple(member for member in self.members if member not in heard)

    def _ask(self, now: Time) -> None:
        """Ask the masters, in the end also the slaves, for the missing messages of this exchange."""
        missing = tuple(robot for robot in self._missing() if robot != self.me)
        self._asked += 1
        self._ask_at = now + self._repair * min(2**self._asked, 16) if missing else None
        if not missing:
            return
        data = encode(Missing(self.me, self.exchange, missing), self.registry.directory)
        for peer, role in self._links.items():
            if role is not Role.MASTER or self._asked > PATIENCE:
                self.out.append(Outgoing(peer, data))

    def _give_up(self, now: Time) -> None:
        """Go on without silent robots if no other depends on them and this robot is the root; else break up."""
        silent = self._missing()
        if self.me in silent:  # the others wait for this robot
            self._stall_at = now + self._silence
            return
        without = self.registry.roll_without(silent) if self.leads() else None
        if without is None:
            self.dissolve(silent if self.leads() else (), now)
        else:
            self._call_roll(without, now)

    # ------------------------------------------------------------ who is in the scatternet

    def enter(self) -> None:
        """Take part in a new scatternet."""
        self._active = True

    def placed(self, census: Census, now: Time) -> None:
        """Report the members of the own piconet."""
        self.registry.note_own(census)
        self._send_report(census, now)

    def met(self, peer: Address) -> None:
        """Forward the reports that have come so far to a new neighbour."""
        for census in self.registry.reports():
            self.out.append(Outgoing(peer, encode(census, self.registry.directory)))

    def lost(self, peer: Address, now: Time) -> None:
        """Drop a slave on which no other robot depends; break the scatternet up if it is any other neighbour."""
        report = self.registry.report_without(peer)
        if report is not None:
            self.registry.note_own(report)
            self._send_report(report, now)
        elif peer in self.members or self.registry.waits_for(peer):
            self.dissolve((peer,), now)

    def dissolve(self, dead: tuple[Address, ...], now: Time) -> None:
        """Dissolve the scatternet: have all robots leave, and leave."""
        gone = tuple(robot for robot in dead if robot != self.me)
        self._pass_on(encode(Dissolution(gone), self.registry.directory), self.me)
        self._upcall(Broken(gone), now)

    def _send_report(self, census: Census, now: Time) -> None:
        if census.root == self.me:
            self._register(census, now)
        else:
            self._pass_on(encode(census, self.registry.directory), self.me)

    def _receive_census(self, census: Census, data: bytes, source: Address, now: Time) -> None:
        if not self._active:
            return
        if census.root == self.me:
            if not census.roll_call:
                self._register(census, now)
        elif self.registry.is_new(census):
            self._pass_on(data, source)
            if census.roll_call and self.registry.take_roll(census):
                self._called_up(census.exchange, now)

    def _register(self, census: Census, now: Time) -> None:
        """Process a report as the root; call the roll once all have come, and again when one changes."""
        directory = self.registry.take_report(census)
        if directory is not None:
            self._call_roll(directory, now)

    def _call_roll(self, directory: Directory, now: Time) -> None:
        self.registry.deadline = None
        # others may be one exchange ahead and take messages of the one after it: none of those is of the new team
        number = (self.exchange + 4) % EXCHANGES
        for census in self.registry.roll(directory, number):
            self._pass_on(encode(census, directory), self.me)
        self._called_up(number, now)

    def _called_up(self, exchange: int, now: Time) -> None:
        if self.me not in self.registry.directory.members:
            self._upcall(Broken(), now)
            return
        for peer, role in self._links.items():
            if role is Role.MASTER and peer not in self.members:
                self.out.append(Disconnect(peer))  # it was silent for long
        self._begin(exchange, now)
        self._upcall(TeamChanged(self.members), now)

    # ------------------------------------------------------------ what comes in

    def receive(self, data: bytes, reception: Reception, now: Time) -> bool:
        """Process bytes of a neighbour; return True, as something may have come of them."""
        try:
            packet = decode(data, self.registry.directory)
        except WireError as error:
            self._upcall(Garbage(str(error)), now)
            return True
        match packet:
            case Assignment() | Welcome():
                self._instruct(packet, reception.source, now)
            case Census():
                self._receive_census(packet, data, reception.source, now)
            case Dissolution(dead=dead) if self._active:
                self._pass_on(data, reception.source)
                self._upcall(Broken(dead), now)
            case Message() | Missing():
                self._receive_from_member(packet, data, reception.source, now)
        return True

    def overhear(self, data: bytes, now: Time) -> None:
        """Process bytes of a robot without a link to this one: they matter only if they are no packet."""
        try:
            decode(data, self.registry.directory)
        except WireError as error:
            self._upcall(Garbage(str(error)), now)

    def _receive_from_member(self, packet: Message | Missing, data: bytes, source: Address, now: Time) -> None:
        match packet:
            case Missing():
                self._send_again(packet, source)
            case Message(kind=Kind.ANSWER, addressee=addressee) if addressee is not None:
                self._receive_answer(packet, data, source, now)
            case Message() if packet.source != self.me:
                self._take(packet, source, now)

    def _receive_answer(self, answer: Message, data: bytes, source: Address, now: Time) -> None:
        if answer.addressee == self.me:
            self._upcall(Answered(answer), now)
        elif data not in self._answers and answer.source != self.me:
            self._answers.add(data)
            self._pass_on(data, source)

    def _send_again(self, missing: Missing, asker: Address) -> None:
        known = self._stored.get(missing.exchange, {})
        for robot in missing.robots:
            if robot in known and robot != asker:
                self.out.append(Outgoing(asker, encode(known[robot], self.registry.directory)))

    # ------------------------------------------------------------ forwarding

    def _pass_on(self, data: bytes, source: Address) -> None:
        """Send what must not be lost to each neighbour but *source*."""
        self.out += [Outgoing(peer, data) for peer in self._links if peer != source]

    def _take(self, message: Message, source: Address, now: Time) -> None:
        """Store a new message and forward it."""
        ahead = ahead_of(self.exchange, message.exchange)
        known = self._stored.setdefault(message.exchange, {}) if ahead <= 1 else {}
        if ahead > 1 or message.source in known or message.source not in self.members:
            return
        known[message.source] = message
        data = encode(message, self.registry.directory)
        for peer, role in self._links.items():
            if role is not Role.MASTER and peer != source:
                self.out.append(Outgoing(peer, data))
        if any(role is Role.MASTER and peer != message.source for peer, role in self._links.items()):
            self.out.append(Outgoing(BROADCAST, data))
        self._asked = 0
        self._ask_at = now + self._repair
        self._await_others(now)
        self._complete(now)

    def _complete(self, now: Time) -> None:
        heard = self._stored[self.exchange]
        if len(heard) < len(self.members):
            return
        messages = {member: heard[member] for member in self.members}
        roll_call, self._roll_call = self._roll_call, False
        self._join((self.exchange + 1) % EXCHANGES)
        self._upcall(Exchanged(messages, roll_call), now)
        self._complete(now)

    def _join(self, exchange: int) -> None:
        """Go on to *exchange*; keep the messages of the one before and of the one after it."""
        kept = ((exchange - 1) % EXCHANGES, exchange, (exchange + 1) % EXCHANGES)
        self._stored = {number: heard for number, heard in self._stored.items() if number in kept}
        self._stored.setdefault(exchange, {})
        self.exchange = exchange
        self._answers.clear()
        self._ask_at = None

    def _begin(self, exchange: int, now: Time) -> None:
        self._stored = {}
        self._join(exchange)
        self._roll_call = True
        self._await_others(now)

    def _await_others(self, now: Time) -> None:
        """Restart the time-out of silent robots; the root acts first, as it alone can go on without them."""
        self._stall_at = now + self._silence * (1 if self.leads() else 2)
