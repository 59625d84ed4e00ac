"""The air of a run that radios of several technologies share: they hear each other, by one law of propagation.

Whoever sends by an event of the kernel tells so at once. What follows from arithmetic is told when somebody asks, as in
any band; but a radio that listens before it talks must notice it as it begins. So while such a radio is attentive,
there is an event whenever one of the others begins to send by itself. So there is for who asks an arbiter before that.

While all others are silent a channel is alone, and need not tell anybody anything. As soon as one of them is about to
send, the channel tells what has been on the air of late.
"""

from collections.abc import Sequence
from typing import Final, Protocol

import numpy as np

from cosim.channels.air.arbitration import Arbitration
from cosim.channels.air.band import Band, Emission, Tenant
from cosim.channels.base import Positions
from cosim.channels.jamming import Jammer
from cosim.channels.propagation import Barrier, Propagation
from cosim.kernel import AIR, Handle, Kernel
from cosim.units import MS, Time

LINGER: Final[Time] = 20 * MS
"""Time, longer than any frame, after which nothing is on the air that has met what is silent since."""
NEVER: Final[Time] = 1 << 62
"""An instant that no run reaches."""


class Neighbour(Tenant, Protocol):
    """A channel that shares the air of a run."""

    @property
    def silent(self) -> bool:
        """True if it sends nothing, and has sent nothing of late that can still disturb."""

    def others_changed(self, alone: bool) -> None:
        """Note that it is *alone* from now on, or is not any more and tell what has been on the air of late."""

    @property
    def attentive(self) -> bool:
        """True if it must notice what others send as it begins."""

    @property
    def punctual(self) -> bool:
        """True if it must be there, after all else of that instant, whenever it begins to send by itself."""

    def begins_after(self, time: Time) -> Time:
        """Return the first instant after *time* at which it begins to send by itself; NEVER if there is none."""

    def send_due(self, now: Time) -> None:
        """Tell the air what it begins to send by itself *now*."""

    def hear(self, emission: Emission) -> None:
        """Take notice of what another channel sends, from now on or soon; only who is attentive is told."""


class SharedAir:
    """The air between the radios of *size* robots; *isolation_db* is what weakens a robot's radios at each other."""

    def __init__(
        self,
        kernel: Kernel,
        size: int,
        propagation: Propagation,
        isolation_db: float,
        arbitration: Arbitration | None = None,
    ) -> None:
        """*arbitration* is None if a robot's radios work at the same time."""
        self.propagation = propagation
        self.arbitration = arbitration
        self.band = Band(size, isolation_db)
        self._kernel = kernel
        self._size = size
        self._neighbours: list[Neighbour] = []
        self._jammers: list[Jammer] = []
        self._positions_m: Positions = np.zeros((size, 2))
        self._stale_since: Time | None = 0
        """Since when the band does not know the gains; None if it does."""
        self._alone: list[bool] = []
        self._several = False
        """True if several channels are not silent."""
        self._loud_until: list[Time] = []
        """Instants from which each counts as silent again; NEVER if it is not."""
        self._due: Handle | None = None
        self._soon: Handle | None = None

    def join(self, neighbour: Neighbour) -> int:
        """Take *neighbour* in; return its number in the band."""
        self._neighbours.append(neighbour)
        self._alone.append(True)
        self._loud_until.append(0)
        return self.band.join(neighbour)

    def review(self) -> None:
        """Note that a channel is silent, or will not be any more: tell all to whom that makes a difference."""
        now, until = self._kernel.now, self._loud_until
        for number, neighbour in enumerate(self._neighbours):
            if not neighbour.silent:
                until[number] = NEVER
            elif until[number] == NEVER:
                until[number] = now + LINGER
                self._kernel.at(until[number], self.review)
        loud = {number for number, end in enumerate(until) if end > now}
        alone = [not loud - {number} for number in range(len(self._neighbours))]
        before, self._alone, self._several = self._alone, alone, len(loud) > 1
        if self._several:
            self.refresh()
        for neighbour, was, will_be in zip(self._neighbours, before, alone, strict=True):
            if was != will_be:
                neighbour.others_changed(will_be)

    # ------------------------------------------------------------ gains

    def moved(self, positions_m: Positions) -> None:
        """Take the robots' new positions, (size, 2)."""
        if not np.array_equal(positions_m, self._positions_m):
            self._positions_m = positions_m.copy()
            self._change()

    def obstruct(self, barriers: Sequence[Barrier]) -> None:
        """Put *barriers*, and no others, in the way of signals from now on; it may be said more than once."""
        self.propagation.set_barriers(tuple(barriers))
        self._change()

    def place(self, jammer: Jammer) -> int:
        """Give *jammer* a place in the band; return its number among the senders."""
        self._jammers.append(jammer)
        self.band.grow(1)
        self._change()
        return self._size + len(self._jammers) - 1

    def _change(self) -> None:
        """Note that gains are others from now on."""
        self._stale_since = self._kernel.now
        if self._several:
            self.refresh()

    def refresh(self) -> None:
        """Have the band know the gains, from when they have changed on."""
        if self._stale_since is not None:
            since, self._stale_since = self._stale_since, None
            places = np.array([(jammer.x_m, jammer.y_m) for jammer in self._jammers]).reshape(-1, 2)
            self.band.moved(self.propagation.gains_db(np.vstack((self._positions_m, places))), since)

    # ------------------------------------------------------------ what is sent

    def tell(self, emission: Emission) -> None:
        """Put *emission* on the air, and have attentive channels hear it.

        It begins now or soon; or it has begun before, when its channel was alone.
        """
        if emission.start < self._kernel.now:
            self.band.reveal(emission)
        else:
            self.band.tell(emission)
        for number, neighbour in enumerate(self._neighbours):
            if number != emission.tenant and neighbour.attentive:
                neighbour.hear(emission)

    # ------------------------------------------------------------ what is sent by itself

    def reconsider(self) -> None:
        """Note that a channel has become attentive, or begins to send by itself at other instants than before."""
        self._wait(self._kernel.now - 1)

    def _wait(self, after: Time) -> None:
        """Be there when a channel that is heard begins to send by itself, later than *after*."""
        due = min((each.begins_after(after) for each in self._awaited()), default=NEVER)
        if self._due is not None:
            if self._due.time == due:
                return
            self._due.cancel()
            self._due = None
        if due < NEVER:
            self._due = self._kernel.at(due, self._arrive, AIR)

    def reconsider_soon(self) -> None:
        """Do so at the end of this instant, as a channel may change until then when it begins to send by itself."""
        if self._soon is None and any(each.attentive or each.punctual for each in self._neighbours):
            self._soon = self._kernel.at(self._kernel.now, self._reconsider, AIR)

    def _reconsider(self) -> None:
        self._soon = None
        self.reconsider()

    def _arrive(self) -> None:
        """Let what is decided at this instant, such as a payload for a slot, go before what begins by itself."""
        self._due = self._kernel.at(self._kernel.now, self._send_due, AIR)

    def _send_due(self) -> None:
        self._due = None
        now = self._kernel.now
        for each in self._awaited():
            if each.begins_after(now - 1) == now:
                each.send_due(now)
        self._wait(now)

    def _awaited(self) -> list[Neighbour]:
        """Return the channels to which another one is attentive, and those that are punctual."""
        attentive = [each for each in self._neighbours if each.attentive]
        if len(attentive) > 1:
            return self._neighbours
        return [each for each in self._neighbours if each.punctual or (attentive and each is not attentive[0])]
