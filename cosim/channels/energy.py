"""What radios are doing, ns by ns, and the energy that it takes: times by state, and published currents of parts.

A radio is in one state at a time: off; asleep, when it only keeps the time; idle, when it listens and nothing has come
that it takes up; receiving; or transmitting. Each channel says what these mean for its radios. A part is a radio that
is sold, with the currents that its maker has published: energy is supply voltage x current x time, summed over the
states. No current is guessed: a radio in a state for which a part has no published one is an error. What it takes to
change from one state to the other, and the processor beside the radio, are left out.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Final, NamedTuple, TypeAlias

from cosim.errors import UserError
from cosim.machine import Address
from cosim.protocol import Metric
from cosim.units import Time, to_seconds

OFF: Final = "off"
SLEEP: Final = "sleep"
IDLE: Final = "idle"
RECEIVE: Final = "receive"
TRANSMIT: Final = "transmit"
STATES: Final = (OFF, SLEEP, IDLE, RECEIVE, TRANSMIT)
"""All states."""
UNPRICED: Final = "states"
"""The word for times by state without energy, where others name a part."""


class Use(NamedTuple):
    """What a radio does: its state, and the PHY that it does it on, where there are several."""

    state: str
    phy: str = ""


Uses: TypeAlias = Mapping[Use, Time]
"""How long a radio has done what, ns."""

_SUMS: Final = {
    "radio_tx_s": (TRANSMIT, "in which radios sent, all robots together"),
    "radio_rx_s": (RECEIVE, "in which radios received, all robots together"),
    "radio_idle_s": (IDLE, "in which radios listened and received nothing, all robots together"),
    "radio_sleep_s": (SLEEP, "in which radios slept, all robots together"),
}
_TIMES: Final = tuple(Metric(name, "s", meaning) for name, (_, meaning) in _SUMS.items())
_ENERGY: Final = Metric("radio_energy_j", "J", "that the radios of all robots have used")
USE_METRICS: Final = (*_TIMES, _ENERGY)
"""What a run counts of a channel with the setting ``energy``; the last one only if that names a part."""


class Part(NamedTuple):
    """A radio that is sold."""

    volts: float
    """Supply voltage at which its currents were measured."""
    amperes: Mapping[Use, float]
    """Current in each state but that of sending."""
    sending_amperes: Mapping[tuple[str, float], float]
    """Current while it sends, by PHY and power in dBm."""

    def watts(self, use: Use, power_dbm: float) -> float | None:
        """Return the power that *use* takes of a radio that sends with *power_dbm*; None if it is not published."""
        if use.state == OFF:
            return 0.0
        sends = use.state == TRANSMIT
        amperes = self.sending_amperes.get((use.phy, power_dbm)) if sends else self.amperes.get(use)
        return None if amperes is None else self.volts * amperes


NRF52840: Final = Part(
    3.0,
    {Use(SLEEP): 3.16e-6, Use(IDLE, "1M"): 6.26e-3, Use(RECEIVE, "1M"): 6.26e-3},
    {("1M", 8.0): 16.40e-3, ("1M", 0.0): 6.40e-3, ("1M", -40.0): 3.83e-3},
)
"""Nordic nRF52840: Product Specification, Current consumption, typical values at 3 V and 25 degrees with the DC/DC
regulator: I_RADIO_TX0, TX1, TX2 and RX0 on LE 1M; asleep ION_RAMON_RTC, System ON with all RAM, woken by the RTC. No
current is given for LE 2M and LE Coded."""
PARTS: Final[Mapping[str, Part]] = {"nrf52840": NRF52840}
"""Parts by the names that scenarios give them."""


class Accounts:
    """What the radios of one channel have used: *uses* tells it of each, which sends with its one of *powers_dbm*."""

    def __init__(self, energy: str, uses: Callable[[Address, Time], Uses], powers_dbm: Sequence[float]) -> None:
        """*energy* names a part, or is UNPRICED."""
        self.uses = uses
        """(robot, now) -> how long its radio has done what, up to *now*."""
        self._part = PARTS.get(energy)
        self._name = energy
        self._powers_dbm = powers_dbm

    @property
    def columns(self) -> tuple[Metric, ...]:
        """The metrics that ``summary`` returns."""
        return _TIMES if self._part is None else USE_METRICS

    @property
    def priced(self) -> bool:
        """Whether energy is known: a part is named."""
        return self._part is not None

    def check(self, needed: Iterable[Use]) -> None:
        """Raise UserError if the part has no published current for one of the *needed* uses of one of the radios."""
        if self._part is not None:
            for use in needed:
                for power_dbm in sorted(set(self._powers_dbm)):
                    self._watts(use, power_dbm)

    def _watts(self, use: Use, power_dbm: float) -> float:
        assert self._part is not None
        watts = self._part.watts(use, power_dbm)
        if watts is None:
            known = sorted(dbm for phy, dbm in self._part.sending_amperes if phy == use.phy)
            at = f" with {power_dbm:g} dBm, but with {', '.join(f'{dbm:g}' for dbm in known)}" if known else ""
            on = f" on {use.phy}" if use.phy else ""
            raise UserError(f"channel.energy: {self._name} has no published current to {use.state}{on}{at}")
        return watts

    def rows(self, address: Address, now: Time) -> Iterator[tuple[str, str, float, float | None]]:
        """Yield state, PHY, time in s, and energy in J, None if no part is named, of the radio at *address*."""
        for use, time in sorted(self.uses(address, now).items()):
            yield *use, to_seconds(time), self._joules(address, use, time) if self.priced else None

    def energy_j(self, address: Address, now: Time) -> float:
        """Return what the radio at *address* has used up to *now*, if a part is named."""
        return math.fsum(self._joules(address, use, time) for use, time in self.uses(address, now).items())

    def _joules(self, address: Address, use: Use, time: Time) -> float:
        return self._watts(use, self._powers_dbm[address]) * to_seconds(time)

    def summary(self, now: Time) -> dict[str, float]:
        """Return the sums over all robots up to *now*, by metric name."""
        robots = range(len(self._powers_dbm))
        used = [self.uses(robot, now) for robot in robots]
        sums = {
            name: to_seconds(sum(time for uses in used for use, time in uses.items() if use.state == state))
            for name, (state, _) in _SUMS.items()
        }
        if self.priced:
            sums[_ENERGY.name] = math.fsum(self.energy_j(robot, now) for robot in robots)
        return sums
