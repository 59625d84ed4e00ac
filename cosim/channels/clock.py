"""Native clocks (Bluetooth Core v1.2, Vol 2 Part B, section 1.1): one tick every 312.5 us, never adjusted.

Integers only: local_ns = phase + t + t * ppm // 1_000_000 and tick = local_ns // TICK. Ticks are unwrapped; the 28 bits
of the specification matter only where the hop kernel reads them. Two devices' ticks are not aligned with each other.
"""

from dataclasses import dataclass

from cosim.arrays import Int64s
from cosim.jit import njit
from cosim.units import TICK, Time

MILLION = 1_000_000


@dataclass(frozen=True, slots=True)
class NativeClock:
    """One device's clock: *phase* is its local time (ns, >= 0) at simulated time 0, *ppm* its constant drift."""

    phase: Time
    ppm: int = 0

    def local(self, time: Time) -> Time:
        """Return the local time, in ns, at the simulated *time*."""
        return self.phase + time + time * self.ppm // MILLION

    def tick(self, time: Time) -> int:
        """Return the unwrapped clock value CLKN at *time*."""
        return (self.phase + time + time * self.ppm // MILLION) // TICK

    def at_local(self, local: Time) -> Time:
        """Return the first simulated instant whose local time is at least *local* (the inverse of :meth:`local`)."""
        elapsed = local - self.phase
        # local(t) >= local  <=>  floor(t * (M + ppm) / M) >= elapsed  <=>  t >= elapsed * M / (M + ppm)
        return -(-elapsed * MILLION // (MILLION + self.ppm))

    def time_of(self, tick: int) -> Time:
        """Return the instant at which *tick* begins."""
        return self.at_local(tick * TICK)

    def times_of(self, ticks: Int64s) -> Int64s:
        """Return the instants at which *ticks* begin."""
        rate = MILLION + self.ppm
        elapsed = ticks * TICK - self.phase
        turns = elapsed // rate  # in whole turns and a rest, lest a product leaves 64 bits
        return turns * MILLION - (turns * rate - elapsed) * MILLION // rate

    def ticks_at(self, times: Int64s) -> Int64s:
        """Return the unwrapped clock values CLKN at *times*."""
        return (self.phase + times + times * self.ppm // MILLION) // TICK


@njit(cache=True)
def local_at(phase: Time, ppm: int, time: Time) -> Time:
    """Return :meth:`NativeClock.local`, for kernels."""
    return phase + time + time * ppm // MILLION


@njit(cache=True)
def tick_at(phase: Time, ppm: int, time: Time) -> int:
    """Return :meth:`NativeClock.tick`, for kernels."""
    return local_at(phase, ppm, time) // TICK


@njit(cache=True)
def instant_of(phase: Time, ppm: int, local: Time) -> Time:
    """Return :meth:`NativeClock.at_local`, for kernels: in whole turns and a rest, lest a product leaves 64 bits."""
    rate = MILLION + ppm
    elapsed = local - phase
    turns = elapsed // rate
    return turns * MILLION - (turns * rate - elapsed) * MILLION // rate


@njit(cache=True)
def start_of(phase: Time, ppm: int, tick: int) -> Time:
    """Return :meth:`NativeClock.time_of`, for kernels."""
    return instant_of(phase, ppm, tick * TICK)
