"""Who is in a scatternet, as its robots agree on it: reports go to the root, roll calls come from it, all pass both on.

What must not be lost here is sent to each neighbour by itself, and acknowledged by the radio.
"""

from abc import abstractmethod
from collections.abc import Callable, Mapping

from cosim.machine import Address, Disconnect, LinkCommand, Outgoing, Role
from cosim.units import Time
from protocols.pseudonet.census import Registry
from protocols.pseudonet.topology import Directory
from protocols.pseudonet.upcalls import EXCHANGES, Broken, TeamChanged, Upcall
from protocols.pseudonet.wide import Census, Dissolution, encode


class Assembly:
    """The team of a scatternet as one robot sees it; *links* is the own role in the link to each neighbour."""

    def __init__(self, me: Address, links: Mapping[Address, Role], tell: Callable[[Upcall, Time], None]) -> None:
        self.me = me
        self.exchange = 0
        self.out: list[Outgoing | LinkCommand] = []
        self.registry = Registry(me)
        self._links = links
        self._tell = tell
        self._active = False

    @abstractmethod
    def _begin(self, exchange: int, now: Time) -> None:
        """Begin the exchanges of a new team."""

    @property
    def members(self) -> tuple[Address, ...]:
        """The team."""
        return self.registry.directory.members or (self.me,)

    @property
    def piconets(self) -> int:
        """How many piconets there are."""
        return len(self.registry.directory.piconets)

    def find_master(self) -> Address | None:
        """Return the root of the scatternet, or None before the roll was called."""
        return self.registry.root if self.registry.directory.piconets else None

    def leads(self) -> bool:
        """Return whether this robot is the root."""
        return self.find_master() == self.me

    def enter(self) -> None:
        """Take part in a new scatternet."""
        self._active = True

    def expect(self, masters: tuple[Address, ...], formation: int, deadline: Time) -> None:
        """As the root, wait for the reports of *masters*, by number of their piconets, until *deadline*."""
        self._active = True
        self.registry.expect(masters, formation, deadline)

    def placed(self, census: Census, now: Time) -> None:
        """Report who is in the own piconet."""
        self.registry.note_own(census)
        self._send_report(census, now)

    def met(self, peer: Address) -> None:
        """Pass on to a new neighbour what reports have come before it."""
        for census in self.registry.reports():
            self.out.append(Outgoing(peer, encode(census, self.registry.directory)))

    def _send_report(self, census: Census, now: Time) -> None:
        if census.root == self.me:
            self._register(census, now)
        else:
            self._pass_on(encode(census, self.registry.directory), self.me)

    def lost(self, peer: Address, now: Time) -> None:
        """Do without a slave on which nobody depends; without any other neighbour the scatternet breaks up."""
        report = self.registry.report_without(peer)
        if report is not None:
            self.registry.note_own(report)
            self._send_report(report, now)
        elif peer in self.members or self.registry.waits_for(peer):
            self.dissolve((peer,), now)

    def dissolve(self, dead: tuple[Address, ...], now: Time) -> None:
        """Tell everybody to leave, and leave."""
        gone = tuple(robot for robot in dead if robot != self.me)
        self._pass_on(encode(Dissolution(gone), self.registry.directory), self.me)
        self._tell(Broken(gone), now)

    def _pass_on(self, data: bytes, source: Address) -> None:
        """Send what must not be lost to all neighbours but *source*."""
        self.out += [Outgoing(peer, data) for peer in self._links if peer != source]

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
        """As the root, take a report; call the roll once all have come, and anew when one changes."""
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
            self._tell(Broken(), now)
            return
        for peer, role in self._links.items():
            if role is Role.MASTER and peer not in self.members:
                self.out.append(Disconnect(peer))  # it was silent for long
        self._begin(exchange, now)
        self._tell(TeamChanged(self.members), now)
