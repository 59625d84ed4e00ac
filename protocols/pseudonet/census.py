"""Who is in a scatternet: masters report their slaves to the root, and the root calls the roll of all piconets."""

from dataclasses import replace

from cosim.machine import Address
from cosim.units import Time
from protocols.pseudonet.topology import Directory, Piconet
from protocols.pseudonet.wide import Census

NUMBERS = 256


class Registry:
    """One robot's knowledge of its scatternet: the roll that was called last, and, for the root, the reports."""

    def __init__(self, me: Address) -> None:
        self.directory = Directory(())
        """Roll that was called last; without piconets if there is no team."""
        self.root: Address | None = None
        self.deadline: Time | None = None
        """Instant at which the root stops waiting for reports."""
        self._me = me
        self._expected: tuple[Address, ...] = ()
        self._reports: dict[int, Census] = {}
        """The root's last report of each piconet."""
        self._own: Census | None = None
        """Last report of the own piconet."""
        self._roll: dict[int, Census] = {}
        """Packets of the next roll that have come so far."""
        self._number = 0
        self._formation = -1
        self._seen: dict[Census, None] = {}

    def forget(self) -> None:
        """Forget the scatternet."""
        self.directory = Directory(())
        self.root = None
        self.deadline = None
        self._own = None
        self._expected = ()
        self._reports.clear()
        self._roll.clear()
        self._seen.clear()

    def is_new(self, census: Census) -> bool:
        """Return whether *census* has not come before."""
        new = census not in self._seen
        self._seen[census] = None
        return new

    def reports(self) -> list[Census]:
        """Return all reports that have come, and the own one, in order."""
        seen = [census for census in self._seen if not census.roll_call]
        return [*seen, self._own] if self._own is not None and self._own.root != self._me else seen

    # ------------------------------------------------------------ reports

    def note_own(self, census: Census) -> None:
        """Keep the report of the own piconet, which may have to be corrected later."""
        self._own = census

    def expect(self, masters: tuple[Address, ...], formation: int, deadline: Time) -> None:
        """Wait as the root for reports of *masters* until *deadline*."""
        self._expected = masters
        self._formation = formation
        self.deadline = deadline

    def take_report(self, census: Census) -> Directory | None:
        """Process a report as the root; return the roll to call once the reports of all piconets have come."""
        if census.formation != self._formation or census.piconet >= len(self._expected):
            return None
        known = self._reports.get(census.piconet)
        if known is not None and not 0 < (census.number - known.number) % NUMBERS < NUMBERS // 2:
            return None
        self._reports[census.piconet] = census
        if len(self._reports) < len(self._expected):
            return None
        return Directory(tuple(report.content for _, report in sorted(self._reports.items())))

    def waits_for(self, peer: Address) -> bool:
        """Return whether the root cannot do without *peer*, a master of which it waits for the report."""
        return self.deadline is not None and peer in self.absent()

    def absent(self) -> tuple[Address, ...]:
        """Return the masters whose reports have not come."""
        return tuple(master for number, master in enumerate(self._expected) if number not in self._reports)

    def report_without(self, peer: Address) -> Census | None:
        """Return the next report of the own piconet if *peer* was in it and no other robot depends on it."""
        own = self._own
        if own is None or peer not in own.content.slaves:
            return None
        if self.directory.piconets and not self.directory.is_plain(peer):
            return None
        slaves = tuple(slave for slave in own.content.slaves if slave != peer)
        return replace(own, number=(own.number + 1) % NUMBERS, content=Piconet(self._me, slaves))

    # ------------------------------------------------------------ rolls

    def roll_without(self, silent: tuple[Address, ...]) -> Directory | None:
        """Return the team without the *silent* robots; None if another robot depends on one of them."""
        if not silent or not all(self.directory.is_plain(robot) for robot in silent):
            return None
        return self.directory.without(silent)

    def roll(self, directory: Directory, exchange: int) -> list[Census]:
        """Make *directory* the team, as the root; return the roll call, which begins with *exchange*."""
        self.root = self._me
        self.directory = directory
        self._number = (self._number + 1) % NUMBERS
        for number, piconet in enumerate(directory.piconets):  # a robot that was dropped is reported no more
            report = self._reports.get(number)
            if report is not None and piconet is not None and report.content != piconet:
                self._reports[number] = replace(report, content=piconet)
        count = len(directory.piconets)
        return [
            Census(True, self._number, exchange, number, count, self._me, self._formation, piconet)
            for number, piconet in enumerate(directory.piconets)
            if piconet is not None
        ]

    def take_roll(self, census: Census) -> bool:
        """Process one packet of a roll call; return whether a new roll is complete."""
        if self._roll and next(iter(self._roll.values())).number != census.number:
            self._roll.clear()
        self._roll[census.piconet] = census
        if len(self._roll) < census.piconets:
            return False
        self.root = census.root
        self.directory = Directory(tuple(part.content for _, part in sorted(self._roll.items())))
        self._roll.clear()
        return True
