"""Faults of the air: jammers, and walls of loss. They belong to no robot, so their events have none."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import count, islice
from typing import Final

from cosim.channels.base import Channel
from cosim.channels.jamming import PULSED, SWEEPING
from cosim.channels.propagation import Barrier
from cosim.errors import UserError
from cosim.faults.events import JammerOff, JammerOn, WallDown, WallUp
from cosim.faults.instants import Agenda, Happening, Span, lasting
from cosim.faults.settings import JammerSettings, WallSettings
from cosim.intervals import JAMMER, Intervals
from cosim.kernel import Kernel
from cosim.ranges import ranges_of
from cosim.trace import Trace
from cosim.units import Time

NOBODY: Final = -1
MOST_JAMMINGS: Final = 10_000
"""Largest number of times that a jammer is on the air in a run: radios get all of them before it begins."""


class AirFaults:
    """The jammers and walls of one run; a channel with a radio takes them by its methods ``jam`` and ``obstruct``.

    Where robots have several radios, it is the channels of those that a fault names, or of all that take it.
    """

    def __init__(self, kernel: Kernel, agenda: Agenda, channel: Channel, trace: Trace, intervals: Intervals) -> None:
        self._kernel = kernel
        self._agenda = agenda
        self._channel = channel
        self._trace = trace
        self._intervals = intervals
        self._barriers: dict[Channel, list[Barrier]] = {part: [] for part in channel.parts}

    def jam(self, number: int, fault: JammerSettings, spans: Iterable[Span], run_end: Time) -> None:
        """Have the jammer that is fault *number* on the air at *spans*.

        Raise UserError if no radio could notice it, or if there are more than MOST_JAMMINGS of them.
        """
        known = list(islice(spans, MOST_JAMMINGS + 1))
        if len(known) > MOST_JAMMINGS:
            raise UserError(f"a jammer with rate_per_s {fault.rate_per_s:g} begins more than {MOST_JAMMINGS} times")
        jammers = [fault.jammer(begin, run_end if end is None else end) for begin, end in known]

        def jam(part: Channel) -> None:
            if not hasattr(part, "jam"):
                raise UserError("a jammer needs a channel that can be jammed: bluetooth, ble or adhoc")
            for jammer in jammers:
                part.jam(jammer)

        self._willing(fault.radio, jam)
        details = _details(number, _jammer_words(fault))

        def happenings() -> Iterator[Happening]:
            for span, detail in zip(known, details, strict=False):
                on, off = (partial(self._switch, number, detail, begins) for begins in (True, False))
                yield lasting(span, on, off)

        self._agenda.enter(number, happenings())

    def obstruct(self, number: int, fault: WallSettings, spans: Iterable[Span]) -> None:
        """Have the wall that is fault *number* in the way at *spans*; raise UserError if no radio could notice it."""

        def ask(part: Channel) -> None:
            if not hasattr(part, "obstruct"):
                raise UserError("a wall needs a channel whose signals fade: bluetooth, ble or adhoc, with propagation")
            part.obstruct(())  # refuses if signals do not fade

        parts = self._willing(fault.radio, ask)
        barrier = Barrier(*fault.from_m, *fault.to_m, fault.loss_db)
        details = _details(number, _wall_words(fault))

        def happenings() -> Iterator[Happening]:
            for span, detail in zip(spans, details, strict=False):
                up, down = (partial(self._wall, number, parts, barrier, detail, stands) for stands in (True, False))
                yield lasting(span, up, down)

        self._agenda.enter(number, happenings())

    def _willing(self, radio: int | None, act: Callable[[Channel], None]) -> list[Channel]:
        """Return for which channels of *radio*, or of all, *act* raises no UserError; raise its first if for none."""
        parts = self._channel.parts if radio is None else self._channel.parts[radio : radio + 1]
        willing: list[Channel] = []
        errors: list[UserError] = []
        for part in parts:
            try:
                act(part)
            except UserError as error:
                errors.append(error)
            else:
                willing.append(part)
        if not willing:
            raise errors[0]
        return willing

    def _switch(self, number: int, detail: str, begins: bool) -> None:
        self._note(JammerOn(number) if begins else JammerOff(number))
        self._note_interval("jammer", detail, begins)

    def _wall(self, number: int, parts: Sequence[Channel], barrier: Barrier, detail: str, stands: bool) -> None:
        self._note(WallUp(number) if stands else WallDown(number))
        self._note_interval("wall", detail, stands)
        for part in parts:
            barriers = self._barriers[part]
            if stands:
                barriers.append(barrier)
            else:
                barriers.remove(barrier)
            part.obstruct(barriers)  # type: ignore[attr-defined]  # it has been looked for

    def _note(self, event: object) -> None:
        self._trace.event(self._kernel.now, NOBODY, event)

    def _note_interval(self, state: str, detail: str, begins: bool) -> None:
        (self._intervals.begin if begins else self._intervals.end)(JAMMER, state, self._kernel.now, detail)


# ---------------------------------------------------------------- details of their intervals


def _details(number: int, words: str) -> Iterator[str]:
    """Yield the detail of each interval of the fault *number*; those that overlap differ."""
    return (f"fault={number} nth={nth} {words}" for nth in count())


def _jammer_words(fault: JammerSettings) -> str:
    jammer = fault.jammer(0, 0)
    words = [f"x_m={jammer.x_m}", f"y_m={jammer.y_m}", f"power_dbm={jammer.power_dbm}"]
    words += [f"channels={ranges_of(jammer.channels)}", f"mode={fault.mode}"]
    if jammer.mode == SWEEPING:
        words.append(f"dwell_ns={jammer.dwell}")
    elif jammer.mode == PULSED:
        words += [f"on_ns={jammer.on}", f"period_ns={jammer.period}"]
    return " ".join(words + _radio_words(fault.radio))


def _wall_words(fault: WallSettings) -> str:
    (x1, y1), (x2, y2) = fault.from_m, fault.to_m
    words = [f"x1_m={x1}", f"y1_m={y1}", f"x2_m={x2}", f"y2_m={y2}", f"loss_db={fault.loss_db}"]
    return " ".join(words + _radio_words(fault.radio))


def _radio_words(radio: int | None) -> list[str]:
    return [] if radio is None else [f"radio={radio}"]
