"""The air of a run that radios of several technologies share: they hear each other, by one law of propagation.

Whoever sends by an event of the kernel tells so at once. What follows from arithmetic is told when somebody asks, as in
any band; but a radio that listens before it talks must notice it as it begins. So while such a radio is attentive,
there is an event whenever one of the others begins to send by itself.
"""

from collections.abc import Sequence
from typing import Final, Protocol

import numpy as np

from cosim.channels.air.band import Band, Emission, Tenant
from cosim.channels.base import Positions
from cosim.channels.jamming import Jammer
from cosim.channels.propagation import Barrier, Propagation
from cosim.kernel import AIR, Handle, Kernel
from cosim.units import Time

NEVER: Final[Time] = 1 << 62
"""An instant that no run reaches."""


class Neighbour(Tenant, Protocol):
    """A channel that shares the air of a run."""

    @property
    def attentive(self) -> bool:
        """True if it must notice what others send as it begins."""

    def begins_after(self, time: Time) -> Time:
        """Return the first instant after *time* at which it begins to send by itself; NEVER if there is none."""

    def send_due(self, now: Time) -> None:
        """Tell the air what it begins to send by itself *now*."""

    def hear(self, emission: Emission) -> None:
        """Take notice of what another channel sends, from now on or soon; only who is attentive is told."""


class SharedAir:
    """The air between the radios of *size* robots; *isolation_db* is what weakens a robot's radios at each other."""

    def __init__(self, kernel: Kernel, size: int, propagation: Propagation, isolation_db: float) -> None:
        self.propagation = propagation
        self.band = Band(size, isolation_db)
        self._kernel = kernel
        self._size = size
        self._neighbours: list[Neighbour] = []
        self._jammers: list[Jammer] = []
        self._positions_m: Positions = np.zeros((size, 2))
        self._due: Handle | None = None
        self._soon: Handle | None = None

    def join(self, neighbour: Neighbour) -> int:
        """Take *neighbour* in; return its number in the band."""
        self._neighbours.append(neighbour)
        return self.band.join(neighbour)

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
        """Have the band know the gains of now."""
        places = np.array([(jammer.x_m, jammer.y_m) for jammer in self._jammers]).reshape(-1, 2)
        gains_db = self.propagation.gains_db(np.vstack((self._positions_m, places)))
        self.band.moved(gains_db, self._kernel.now)

    # ------------------------------------------------------------ what is sent

    def tell(self, emission: Emission) -> None:
        """Put *emission*, which begins now or soon, on the air, and have attentive channels hear it."""
        self.band.tell(emission)
        for number, neighbour in enumerate(self._neighbours):
            if number != emission.tenant and neighbour.attentive:
                neighbour.hear(emission)

    # ------------------------------------------------------------ what is sent by itself

    def reconsider(self) -> None:
        """Note that a channel has become attentive, or begins to send by itself at other instants than before."""
        now = self._kernel.now
        due = min((each.begins_after(now - 1) for each in self._heard_by_others()), default=NEVER)
        if self._due is not None:
            if self._due.time == due:
                return
            self._due.cancel()
            self._due = None
        if due < NEVER:
            self._due = self._kernel.at(due, self._send_due, AIR)

    def reconsider_soon(self) -> None:
        """Do so at the end of this instant, as a channel may change until then when it begins to send by itself."""
        if self._soon is None and any(each.attentive for each in self._neighbours):
            self._soon = self._kernel.at(self._kernel.now, self._reconsider, AIR)

    def _reconsider(self) -> None:
        self._soon = None
        self.reconsider()

    def _send_due(self) -> None:
        self._due = None
        now = self._kernel.now
        for each in self._heard_by_others():
            if each.begins_after(now - 1) == now:
                each.send_due(now)
        due = min((each.begins_after(now) for each in self._heard_by_others()), default=NEVER)
        if due < NEVER and self._due is None:
            self._due = self._kernel.at(due, self._send_due, AIR)

    def _heard_by_others(self) -> list[Neighbour]:
        """Return the channels to which another one is attentive."""
        attentive = {number for number, each in enumerate(self._neighbours) if each.attentive}
        return [each for number, each in enumerate(self._neighbours) if attentive - {number}]
