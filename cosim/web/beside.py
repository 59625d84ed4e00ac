"""Recorded runs side by side on one clock: what a page that holds the pages of all of them is told, and asks for."""

from collections.abc import Sequence
from typing import Final

from cosim.errors import UserError
from cosim.units import Time, to_seconds
from cosim.web.clock import Clock
from cosim.web.history import Cursor
from cosim.web.messages import AskPresent, Plain, Step, Wish
from cosim.web.recorded import Recorded
from cosim.web.timeline import NO_TIMELINE, Timeline

_ABOUT: Final = ("name", "protocol", "channel", "seed", "slot_ns")


class Beside:
    """The session of time alone: play, pause, speed, seek and step of one run are those of all."""

    def __init__(self, runs: Sequence[Recorded]) -> None:
        """Have *runs* go by one clock, that of the first, until the longest has ended."""
        self.runs = runs
        self._ends = [run.clock.end for run in runs]
        self.clock: Clock = runs[0].clock
        self.clock.end = max(self._ends)
        for run in runs:
            run.clock = self.clock

    @property
    def scene(self) -> Plain:
        """What runs there are, and how long the longest is."""
        runs: list[Plain] = [
            {"folder": run.folder.resolve().name}
            | {name: run.scene.get(name) for name in _ABOUT}
            | {"duration_s": to_seconds(end)}
            for run, end in zip(self.runs, self._ends, strict=True)
        ]
        return {
            "name": " beside ".join(run["folder"] for run in runs),
            "live": False,
            "duration_s": to_seconds(self.clock.end),
            "slot_ns": next((run["slot_ns"] for run in runs if run["slot_ns"]), None),
            "radii_m": [],
            "runs": runs,
        }

    def wish(self, wish: Wish) -> None:
        """Do what a page asks for, for all runs; raise UserError, one line, if it cannot be done."""
        if isinstance(wish, Step):
            self.clock.step(self._stepped(wish.by, wish.count), wish.count < 0)
        else:
            self.clock.wish(wish)

    def _stepped(self, by: str, count: int) -> Time:
        """Return the time that the first run gets to by *count* steps: what is next is next in any of them."""
        now, step = self.clock.now, 1 if count > 0 else -1
        for _ in range(abs(count)):
            reached, faults = [], []
            for run in self.runs:
                try:
                    reached.append(run.stepped(now, by, step))
                except UserError as fault:
                    faults.append(fault)
            if not reached:
                raise faults[0]
            now = min(reached) if step > 0 else max(reached)
        return now

    def look(self, cursor: Cursor | None) -> tuple[list[Plain], Cursor]:
        """Return the message for a page that has been sent all up to *cursor*, and the new cursor."""
        now, state, speed = self.clock.now, self.clock.state, self.clock.speed
        new = Cursor(self.clock.jumps, 0, 0, (now, state, speed))
        message = {"say": "now", "time_s": to_seconds(now), "state": state, "speed": speed, "why": ""}
        return [] if new == cursor else [message], new

    def answer(self, asked: AskPresent) -> Plain:
        """Raise UserError: each run answers for itself."""
        raise UserError("ask one of the runs")

    @property
    def timeline(self) -> Timeline:
        """None of its own: each run has one."""
        return NO_TIMELINE

    def close(self) -> None:
        """Do nothing, since nothing runs."""
