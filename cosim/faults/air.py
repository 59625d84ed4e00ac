"""Faults of the air: jammers, and walls of loss. They are nobody's, so their events have no robot."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Final

from cosim.channels.base import Channel
from cosim.channels.propagation import Barrier
from cosim.errors import UserError
from cosim.faults.events import JammerOff, JammerOn, WallDown, WallUp
from cosim.faults.instants import Span
from cosim.faults.settings import JammerSettings, WallSettings
from cosim.kernel import WORLD, Kernel
from cosim.trace import Trace
from cosim.units import Time

NOBODY: Final = -1


class AirFaults:
    """The jammers and walls of one run; a channel with a radio takes them by its methods ``jam`` and ``obstruct``."""

    def __init__(self, kernel: Kernel, channel: Channel, trace: Trace) -> None:
        self._kernel = kernel
        self._channel = channel
        self._trace = trace
        self._barriers: list[Barrier] = []

    def jam(self, fault: JammerSettings, spans: Sequence[Span], run_end: Time) -> None:
        """Have a jammer on the air at *spans*; raise UserError if there is no radio."""
        jam = getattr(self._channel, "jam", None)
        if jam is None:
            raise UserError("there is no radio to jam on this channel")
        for span in spans:
            jam(fault.jammer(span[0], run_end if span[1] is None else span[1]))
            self._schedule(span, partial(self._note, JammerOn()), partial(self._note, JammerOff()))

    def obstruct(self, fault: WallSettings, spans: Sequence[Span]) -> None:
        """Have a wall in the way at *spans*; raise UserError if no radio could notice it."""
        obstruct = getattr(self._channel, "obstruct", None)
        if obstruct is None:
            raise UserError("there is no radio that a wall could weaken on this channel")
        obstruct(())  # refuses if signals do not fade
        barrier = Barrier(*fault.from_m, *fault.to_m, fault.loss_db)
        for span in spans:
            self._schedule(span, partial(self._wall, barrier, True), partial(self._wall, barrier, False))

    def _schedule(self, span: Span, begin: Callable[[], None], end: Callable[[], None]) -> None:
        self._kernel.at(span[0], begin, WORLD)
        if span[1] is not None:
            self._kernel.at(span[1], end, WORLD)

    def _wall(self, barrier: Barrier, stands: bool) -> None:
        self._note(WallUp() if stands else WallDown())
        if stands:
            self._barriers.append(barrier)
        else:
            self._barriers.remove(barrier)
        self._channel.obstruct(self._barriers)  # type: ignore[attr-defined]  # it has been looked for

    def _note(self, event: object) -> None:
        self._trace.event(self._kernel.now, NOBODY, event)
