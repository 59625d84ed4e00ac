"""The frames that arrive at one station, and which of them it receives.

``RangeReceiver``: every frame in reach is equally strong. One that begins while nothing else is there is followed; any
other that overlaps it spoils it, and so does a jammer.

``SinrReceiver``: frames have powers. One that is strong enough is followed; all others, jammers and noise disturb it,
each for as long as it lasts. A much stronger one that begins during the preamble of the first takes its place
(capture). Whether the frame that was followed is received is drawn at its end, from the probability that all its parts
have no errors.
"""

from collections.abc import Callable
from typing import NamedTuple, Protocol, TypeAlias

from cosim.channels.adhoc.mac import Frame
from cosim.units import Time

Levels: TypeAlias = list[tuple[Time, float]]
"""(ns since the frame began, ratio of its power to all others and noise from then on)"""


class Receiver(Protocol):
    """The receiver of a station."""

    energy_from: Time
    """Instant at which the medium became busy last."""
    power_mw: float | None
    """Power of the frame that was followed to its end last; None where all in reach are equally strong."""

    @property
    def energy(self) -> bool:
        """True if the medium is busy with what others send."""

    @property
    def follows(self) -> bool:
        """True if a frame is being received, also if in vain."""

    def begins(self, frame: Frame, power_mw: float, deaf: bool, now: Time) -> bool:
        """Note that *frame* begins; a station that sends is *deaf* and follows none. Return whether silence ends."""

    def ends(self, frame: Frame, whole: bool, now: Time) -> bool | None:
        """Note that *frame* ends; return whether it was received, None if it was not followed."""

    def drop(self) -> None:
        """Follow no frame any more."""

    def disturb(self, power_mw: float, at: Time) -> bool:
        """Note the power of jammers from *at* on; return whether silence begins or ends then."""


class RangeReceiver:
    """A receiver by range: frames in reach are equally strong."""

    def __init__(self) -> None:
        self.energy_from: Time = 0
        self.power_mw: float | None = None
        self._arriving = 0
        self._followed: Frame | None = None
        self._spoilt = False
        self._jammed_from: Time | None = None

    @property
    def energy(self) -> bool:
        """True if anything is arriving, also of a jammer."""
        return self._arriving > 0 or self._jammed_from is not None

    @property
    def follows(self) -> bool:
        """True if a frame is being received, spoilt or not."""
        return self._followed is not None

    def begins(self, frame: Frame, power_mw: float, deaf: bool, now: Time) -> bool:
        """Note that *frame* begins."""
        if self._followed is not None:
            self._spoilt = True
        elif not self._arriving and not deaf:
            self._followed, self._spoilt = frame, False
        was_busy = self.energy
        self._arriving += 1
        if not was_busy:
            self.energy_from = now
        return not was_busy

    def ends(self, frame: Frame, whole: bool, now: Time) -> bool | None:
        """Note that *frame* ends."""
        self._arriving -= 1
        if frame is not self._followed:
            return None
        self._spoil(now)
        self._followed = None
        return whole and not self._spoilt

    def drop(self) -> None:
        """Follow no frame any more."""
        self._followed = None

    def disturb(self, power_mw: float, at: Time) -> bool:
        """Note whether a jammer, of any power but 0, is there from *at* on."""
        was_jammed, is_jammed = self._jammed_from is not None, power_mw > 0.0
        if is_jammed == was_jammed:
            return False
        self._spoil(at)
        self._jammed_from = at if is_jammed else None
        if self._arriving:
            return False
        if is_jammed:
            self.energy_from = at
        return True

    def _spoil(self, until: Time) -> None:
        """Spoil the frame that is followed if a jammer has been there before *until*."""
        if self._jammed_from is not None and self._jammed_from < until:
            self._spoilt = True


class Limits(NamedTuple):
    """Noise and thresholds of a receiver."""

    noise_mw: float
    follows_mw: float
    """Power in mW below which a frame is not noticed as one."""
    busy_mw: float
    """Energy in mW that makes the medium busy, whatever it is."""
    capture: float
    """Ratio of powers at which a frame takes the place of another; inf: never."""


class SinrReceiver:
    """A receiver by powers, noise and interference."""

    def __init__(self, limits: Limits, judge: Callable[[Frame, Levels], bool]) -> None:
        """Have *judge* decide whether a frame that was followed to its end is received."""
        self.energy_from: Time = 0
        self.power_mw: float | None = None
        self._limits = limits
        self._judge = judge
        self._arriving: dict[int, float] = {}
        """Power in mW of every frame that arrives, by its identity."""
        self._followed: Frame | None = None
        self._since: Time = 0
        self._levels: Levels = []
        self._jammers_mw = 0.0

    @property
    def energy(self) -> bool:
        """True if there is much energy, or a frame that is followed."""
        return self._followed is not None or self._jammers_mw + sum(self._arriving.values()) >= self._limits.busy_mw

    @property
    def follows(self) -> bool:
        """True if a frame is being received, also if in vain."""
        return self._followed is not None

    def begins(self, frame: Frame, power_mw: float, deaf: bool, now: Time) -> bool:
        """Note that *frame* begins."""
        was_busy = self.energy
        self._arriving[id(frame)] = power_mw
        if not deaf and power_mw >= self._limits.follows_mw and self._takes_over(power_mw, now):
            self._followed, self._since, self._levels = frame, now, []
        self._note(now)
        if was_busy or not self.energy:
            return False
        self.energy_from = now
        return True

    def ends(self, frame: Frame, whole: bool, now: Time) -> bool | None:
        """Note that *frame* ends."""
        power_mw = self._arriving.pop(id(frame))
        if frame is not self._followed:
            self._note(now)
            return None
        self._followed, self.power_mw = None, power_mw
        return whole and self._judge(frame, self._levels)

    def drop(self) -> None:
        """Follow no frame any more."""
        self._followed = None

    def disturb(self, power_mw: float, at: Time) -> bool:
        """Note the power of jammers from *at* on."""
        if power_mw == self._jammers_mw:
            return False
        was_busy = self.energy
        self._jammers_mw = power_mw
        self._note(at)
        if self.energy and not was_busy:
            self.energy_from = at
        return self.energy != was_busy

    def _takes_over(self, power_mw: float, now: Time) -> bool:
        """Return whether a frame that begins is followed from now on."""
        followed = self._followed
        if followed is None:
            return True
        early = now - self._since < followed.form.preamble
        return early and power_mw >= self._limits.capture * self._arriving[id(followed)]

    def _note(self, now: Time) -> None:
        """Note the SINR of the frame that is followed from now on."""
        if self._followed is not None:
            power_mw = self._arriving[id(self._followed)]
            others_mw = sum(self._arriving.values()) - power_mw
            noise_mw = self._limits.noise_mw + self._jammers_mw
            self._levels.append((now - self._since, power_mw / (noise_mw + max(others_mw, 0.0))))
