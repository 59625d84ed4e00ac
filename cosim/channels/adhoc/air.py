"""The medium of one 802.11 channel: which stations a frame reaches, and when it begins and ends there."""

from collections.abc import Callable, Sequence
from functools import partial

from cosim.channels.adhoc.dcf import Station
from cosim.channels.adhoc.mac import Frame
from cosim.kernel import Kernel
from cosim.machine import Address
from cosim.units import Time


class Medium:
    """Carries frames to all stations that they reach, after a short delay."""

    def __init__(
        self,
        kernel: Kernel,
        delay: Time,
        reach: Callable[[Address], Sequence[tuple[Address, float]]],
        note: Callable[[Frame, Address, bool], None] | None = None,
        ended: Callable[[Frame, bool, Sequence[tuple[Address, float]]], None] | None = None,
    ) -> None:
        """Carry frames to the stations, and with the powers in mW, that *reach* returns for the sender when one begins.

        *note* is called with (frame, station, whether it was received), *ended* with (frame, whether its sender was on
        to its end, the stations and powers that it has reached).
        """
        self.stations: Sequence[Station] = ()
        self._kernel = kernel
        self._delay = delay
        self._reach = reach
        self._note = note
        self._ended = ended
        self.frames = 0
        """Number of frames that have been on the air."""
        self._over = 0
        """Number of frames that have arrived to their end."""
        self._beginning: list[Frame] = []
        """Frames that have begun at one instant, and arrive at one."""
        self._cut: list[Frame] = []

    @property
    def silent(self) -> bool:
        """True if no frame is on the air."""
        return self._over == self.frames

    def begin(self, frame: Frame) -> None:
        """Carry *frame*, which begins now."""
        if not self._beginning or self._beginning[-1].begin != frame.begin:
            self._beginning = []
            self._kernel.after(self._delay, partial(self._arrive, self._beginning))
        self._beginning.append(frame)
        self.frames += 1

    def cut(self, frame: Frame) -> None:
        """Let no station receive *frame*, which is on the air; its energy stays there to its end."""
        self._cut.append(frame)

    def _arrive(self, frames: list[Frame]) -> None:
        for frame in sorted(frames, key=lambda frame: frame.source):
            reached = self._reach(frame.source)
            for address, power_mw in reached:
                self.stations[address].energy_begins(frame, power_mw)
            self._kernel.after(frame.form.duration, partial(self._leave, frame, reached))

    def _leave(self, frame: Frame, reached: Sequence[tuple[Address, float]]) -> None:
        whole = frame not in self._cut
        if not whole:
            self._cut.remove(frame)
        for address, _ in reached:
            received = self.stations[address].energy_ends(frame, whole)
            if self._note is not None:
                self._note(frame, address, received)
        self._over += 1
        if self._ended is not None:
            self._ended(frame, whole, reached)
