"""Who is a member of a piconet and in which mode, as rows of the table ``intervals``; each side has rows of its own."""

from typing import Final

from cosim.intervals import Intervals
from cosim.machine import Address, Mode
from cosim.trace import Trace
from cosim.units import Time

MODES: Final = {Mode.HOLD: "hold", Mode.SNIFF: "sniff", Mode.PARKED: "park"}
"""The states in which links are that are not active all the time."""


class Memberships:
    """The intervals of the members of the piconet of *master*."""

    def __init__(self, master: Address, intervals: Intervals | None = None) -> None:
        self._master = master
        self._intervals = Intervals(Trace()) if intervals is None else intervals
        self._open: dict[tuple[Address, Address], dict[str, str]] = {}
        """Details by state of what each side of a link is in; a side is (device, slave)."""

    def begin(self, device: Address, slave: Address, lt_addr: int, now: Time) -> None:
        """Note that *device*, the master or the *slave*, takes the link between them to be up."""
        if self._intervals.wanted:
            state = "master" if device == self._master else "slave"
            self._enter(device, slave, state, f"lt_addr={lt_addr}", now)

    def change_mode(self, slave: Address, mode: Mode, now: Time, more: str = "") -> None:
        """Note that the link to *slave* is in *mode* on both sides; *more* tells about the mode."""
        if not self._intervals.wanted:
            return
        wanted = MODES.get(mode)
        for device in (self._master, slave):
            states = self._open.get((device, slave), {})
            member = bool(states) or mode is Mode.PARKED
            for state in [state for state in states if state in MODES.values()]:
                if state != wanted or states[state] != self._detail(device, slave, more):
                    self._leave(device, slave, state, now)
            if wanted is not None and member:
                self._enter(device, slave, wanted, more, now)

    def end(self, device: Address, slave: Address, now: Time) -> None:
        """Note that *device* does not take *slave*, or itself, for a member any more."""
        for state in list(self._open.get((device, slave), ())):
            self._leave(device, slave, state, now)

    def _enter(self, device: Address, slave: Address, state: str, more: str, now: Time) -> None:
        detail = self._detail(device, slave, more)
        self._open.setdefault((device, slave), {})[state] = detail
        self._intervals.begin(device, state, now, detail)

    def _detail(self, device: Address, slave: Address, more: str) -> str:
        peer = f"slave={slave}" if device == self._master else f"master={self._master}"
        return f"{peer} {more}" if more else peer

    def _leave(self, device: Address, slave: Address, state: str, now: Time) -> None:
        self._intervals.end(device, state, now, self._open[device, slave].pop(state))
