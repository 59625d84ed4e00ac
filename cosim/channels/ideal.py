"""The null model: every payload reaches everyone after a fixed delay, nothing is lost, links are there at once.

What remains of an experiment's cost on this channel is the algorithm's own; the difference to a radio's column is the
radio's. Roles and link commands are answered as a radio would, by an event at the same instant, so that a machine that
manages links runs here unchanged.
"""

from functools import partial
from typing import ClassVar, Literal, TypeAlias

from pydantic import Field

from cosim.channels.base import Arrival, Channel
from cosim.kernel import Kernel
from cosim.machine import (
    BROADCAST,
    Address,
    Connected,
    Disconnect,
    Discovered,
    Fate,
    Flush,
    Hold,
    Inquire,
    InquiryComplete,
    LinkCommand,
    LinkEvent,
    Lost,
    Metric,
    Mode,
    ModeChanged,
    Outcome,
    Outgoing,
    Page,
    PageFailed,
    Park,
    Reception,
    Role,
    RoleChanged,
    Scan,
    Share,
    Sniff,
    SwitchRole,
    Unpark,
)
from cosim.settings import Settings
from cosim.trace import FRAMES, Trace
from cosim.units import Time, from_seconds

_Sent: TypeAlias = tuple[Address, Outgoing]
"""(sender, what it sent)"""


class IdealSettings(Settings):
    """Parameters of the ideal channel."""

    kind: Literal["ideal"] = "ideal"
    delay_s: float = Field(default=1e-6, gt=0, description="from sending to arrival, for every payload")


class IdealChannel(Channel):
    """Instant links between all devices that are switched on, and a fixed delay without loss."""

    metrics: ClassVar[tuple[Metric, ...]] = (Metric("frames_sent", "1", "payloads sent"),)

    def __init__(self, settings: IdealSettings, kernel: Kernel, trace: Trace, size: int) -> None:
        super().__init__(kernel, trace, size)
        self.delay: Time = max(1, from_seconds(settings.delay_s))
        self.sent = 0
        self._on = [True] * size
        self._on_since: list[Time] = [0] * size
        self._scanning = [True] * size
        self._paged: set[tuple[Address, Address]] = set()  # (master, slave)
        self._batch: list[_Sent] = []
        self._batch_time: Time | None = None
        self._news: list[tuple[Address, LinkEvent]] = []

    def send(self, source: Address, outgoing: Outgoing) -> None:
        """Deliver after the delay; the fate is DELIVERED or SENT at that instant, or NO_LINK to a dead device, at once.

        A device that is switched off sends nothing.
        """
        if not self._on[source]:
            return
        if outgoing.destination != BROADCAST and not self._hears(source, outgoing.destination):
            if outgoing.token is not None:
                self._tell((source, Fate(outgoing.token, Outcome.NO_LINK)))
            return
        self.sent += 1
        if self._batch_time != self.kernel.now:
            self._batch, self._batch_time = [], self.kernel.now
            self.kernel.after(self.delay, partial(self._arrive, self._batch))
        self._batch.append((source, outgoing))  # sent at the same instant: one event for all

    def command(self, source: Address, command: LinkCommand) -> None:
        """Answer like a radio that takes no time. Nothing happens if the device is off."""
        if not self._on[source]:
            return
        match command:
            case Inquire(enough=enough):
                found = tuple(a for a in self.in_reach(source) if self._scanning[a])[:enough]
                self._tell(*((source, Discovered(peer)) for peer in found), (source, InquiryComplete(found)))
            case Page(peer=peer) if self._hears(source, peer) and self._scanning[peer]:
                self._paged.discard((peer, source))
                self._paged.add((source, peer))
                self._tell((source, Connected(peer, Role.MASTER)), (peer, Connected(source, Role.SLAVE)))
            case Page(peer=peer):
                self._tell((source, PageFailed(peer)))
            case Scan(enabled=enabled):
                self._scanning[source] = enabled
            case Disconnect(peer=peer) if self._hears(source, peer):
                self._paged -= {(source, peer), (peer, source)}
                self._tell((source, Lost(peer)), (peer, Lost(source)))
            case Hold(peer=peer) | Sniff(peer=peer) | Park(peer=peer) | Unpark(peer=peer):
                mode = Mode.ACTIVE if self._hears(source, peer) else Mode.NONE  # links are never at rest
                self._tell((source, ModeChanged(peer, mode)))
            case SwitchRole(peer=peer) if self._hears(source, peer):
                self._switch(source, peer)
            case SwitchRole(peer=peer):
                self._tell((source, ModeChanged(peer, Mode.NONE)))
            case Disconnect() | Flush() | Share():
                pass  # there is no such link; nothing ever waits in a queue, and time is not divided

    def _switch(self, source: Address, peer: Address) -> None:
        """Exchange the roles that the last page between two devices has given them."""
        for pair in ((source, peer), (peer, source)):
            if pair in self._paged:
                self._paged.remove(pair)
                self._paged.add(pair[::-1])
                roles = (Role.SLAVE, Role.MASTER) if pair[0] == source else (Role.MASTER, Role.SLAVE)
                self._tell((source, RoleChanged(peer, roles[0])), (peer, RoleChanged(source, roles[1])))
                return
        self._tell((source, RoleChanged(peer, Role.PEER)))

    def in_reach(self, address: Address) -> tuple[Address, ...]:
        """Return all other devices that are switched on, if this one is."""
        return tuple(a for a in range(self.size) if self._hears(address, a))

    def power(self, address: Address, on: bool) -> None:
        """Switch a device on or off; the others lose a dead one at once."""
        lost_by = () if on else self.in_reach(address)
        self._on[address] = on
        if on:  # what was before is nothing to it
            self._on_since[address] = self.kernel.now
            self._paged = {pair for pair in self._paged if address not in pair}
        self._tell(*((a, Lost(address)) for a in lost_by))

    def summary(self) -> dict[str, float]:
        """Return the number of payloads sent."""
        return {"frames_sent": float(self.sent)}

    def _hears(self, one: Address, other: Address) -> bool:
        return one != other and 0 <= other < self.size and self._on[one] and self._on[other]

    def _knows_of(self, source: Address, begin: Time) -> bool:
        """Return whether the device of *source* is on, and has been since it began to send at *begin*."""
        return self._on[source] and self._on_since[source] <= begin

    def _lose_links(self) -> None:
        """Tell both ends of each link between devices that no longer hear each other; for channels with a reach."""
        for pair in sorted(self._paged):
            if not self._hears(*pair):
                self._paged.discard(pair)
                self._tell((pair[0], Lost(pair[1])), (pair[1], Lost(pair[0])))

    def _arrive(self, batch: list[_Sent]) -> None:
        """Deliver what was sent one delay ago to those who are switched on now, and tell the senders."""
        arrivals: list[Arrival] = []
        news: list[tuple[Address, LinkEvent]] = []
        for source, outgoing in batch:
            to_all = outgoing.destination == BROADCAST
            receivers = range(self.size) if to_all else (outgoing.destination,)
            heard = [a for a in receivers if a != source and self._on[a]]
            arrivals += [(address, outgoing.payload, Reception(source, to_all)) for address in heard]
            self._record(source, outgoing, bool(heard))
            if outgoing.token is not None and self._knows_of(source, self.kernel.now - self.delay):
                fate = Outcome.SENT if to_all else Outcome.DELIVERED if heard else Outcome.NO_LINK
                news.append((source, Fate(outgoing.token, fate)))
        self.deliver(arrivals, news)

    def _tell(self, *news: tuple[Address, LinkEvent]) -> None:
        if not self._news and news:
            self.kernel.soon(self._pass_on)
        self._news.extend(news)

    def _pass_on(self) -> None:
        news, self._news = self._news, []
        self.deliver((), [item for item in news if self._on[item[0]]])

    def _record(self, source: Address, outgoing: Outgoing, heard: bool) -> None:
        self.trace.row(
            FRAMES,
            self.kernel.now - self.delay,
            source,
            outgoing.destination,
            self.delay,
            "IDEAL",
            -1,
            0,
            len(outgoing.payload),
            "received" if heard else "out_of_range",
            "",
        )
