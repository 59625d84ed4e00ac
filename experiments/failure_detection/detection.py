"""One robot's heartbeats, as they come over a channel, judged by all detectors at once: mistakes, and crashes noticed.

Robot 0 runs the machine of ``protocols.monitoring`` and sends heartbeats; what arrives at robot 1, and when, is
recorded, and given to each detector. So all detectors of a run see the same losses and delays. A run is one long
watch over a robot that lives, for the mistakes, and some shorter ones, each over a robot that is killed at a random
instant, for the detection time. Metrics are those of Chen, Toueg and Aguilera
(``protocols.detection.quality``).

With T the time within which a crash is to be noticed, eta the period and E(D) the mean delay:

    nfd_s          freshness points T - eta after a heartbeat is sent; T is a bound
    nfd_e, _32     the same after it is expected, T - eta - E(D); 1000 or 32 arrivals show when that is
    fixed          a time-out of T - E(D): the same mean detection time, but no bound
    fixed_cut_4, _8  heartbeats later than c = 4 or 8 E(D) do not count, time-out T - c: T is a bound
    phi_akka, phi_normal   do not know T, but a threshold; they adapt to what they see
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Annotated, Any, Final, NamedTuple, TypeAlias

import numpy as np
from pydantic import Field

from cosim.channels.adhoc.channel import AdhocChannel
from cosim.channels.adhoc.settings import AdhocSettings
from cosim.channels.ideal import IdealChannel, IdealSettings
from cosim.experiment import experiment_function
from cosim.kernel import Kernel
from cosim.machine import BROADCAST, Address, LinkEvent, Outgoing, Reception
from cosim.node import Node
from cosim.randomness import Streams
from cosim.settings import Count, Gain, Metres, Rate, Seconds, Settings
from cosim.trace import Field as Column
from cosim.trace import Trace
from cosim.units import S, Time, from_seconds
from protocols.detection.accrual import PhiSettings
from protocols.detection.chen import NfdESettings, NfdSSettings
from protocols.detection.detectors import DetectorSettings, FixedTimeoutSettings, make_detector
from protocols.detection.quality import Quality, quality, watch
from protocols.monitoring.heartbeats import decode
from protocols.monitoring.machine import Monitor
from protocols.monitoring.machine import Parameters as Monitoring

SENDER: Final[Address] = 0
WATCHER: Final[Address] = 1
SETTLING: Final = 100
"""Periods before mistakes count, and before a robot is killed: by then detectors have forgotten most of the start."""
OLDEST: Final = 1000
"""Periods after which every robot that is to be killed has been."""
LAST_ARRIVALS: Final = 10 * S
"""Time after the last heartbeat; no message takes as long."""
PATIENCE: Final = 1000
"""Periods after a crash within which it is noticed, or never."""
LONG_WINDOW: Final = 1000
SHORT_WINDOW: Final = 32
CUTS: Final = (4, 8)
Arrivals: TypeAlias = list[tuple[int, Time]]
"""(number of the heartbeat, time of its arrival)"""

COLUMNS: Final = (
    Column("detector", "str", "", "what watches"),
    Column("bound_s", "float", "s", "T, the time within which a crash is to be noticed; NaN for phi accrual"),
    Column("threshold", "float", "1", "of phi accrual; NaN for the others"),
    Column("lost", "float", "1", "share of the heartbeats of the long watch that did not arrive"),
    Column("mistakes", "int", "1", "suspicions of the robot that lives"),
    Column("watched_s", "float", "s", "length of that watch"),
    Column("mistake_rate_per_s", "float", "1/s", "lambda_M, mistakes over the length of the watch"),
    Column("mean_mistake_s", "float", "s", "E(T_M), of the mistakes that were corrected; NaN if there are none"),
    Column("accuracy", "float", "1", "P_A, share of the watch with trust"),
    Column("detection_s", "float", "s", "E(T_D), from a crash until suspicion for good, mean of the crashes"),
    Column("longest_detection_s", "float", "s", "the longest of them"),
)


class Network(Settings):
    """What carries the heartbeats, and how many of them are watched."""

    channel: Annotated[IdealSettings | AdhocSettings, Field(discriminator="kind")] = Field(
        description="two robots are on it; a third, if there is chatter"
    )
    mean_delay_s: Seconds = Field(gt=0, description="s, E(D), as those who set detectors know it")
    heartbeats: Count = Field(default=2_000, gt=2 * SETTLING, description="of the long watch")
    apart_m: Metres = Field(default=10.0, gt=0, description="m, from the sender to the watcher, and on to the third")
    chatter_per_s: Rate = Field(
        default=0.0, ge=0, description="1/s, payloads of the third robot, a Poisson process; 0: there is none"
    )
    chatter_octets: Count = Field(default=1500, ge=1, description="octets of those payloads")


class Parameters(Settings):
    """What the experiment varies."""

    network: Network = Field(description="what carries the heartbeats")
    period_s: Seconds = Field(default=1.0, gt=0, description="s, eta, from one heartbeat to the next")
    bounds_s: tuple[Seconds, ...] = Field(description="s, T, times within which a crash is to be noticed")
    thresholds: tuple[Gain, ...] = Field(description="of phi accrual")
    phi_floor: Gain = Field(default=0.1, gt=0, description="least standard deviation of phi accrual, in periods")
    crashes: Count = Field(default=8, ge=1, description="robots that are killed")


class Recorder:
    """The watcher's end of the channel: it notes which heartbeats arrive when."""

    def __init__(self) -> None:
        self.arrivals: Arrivals = []

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        """Note a heartbeat; the third robot's chatter is none."""
        if reception.source == SENDER:
            self.arrivals.append((decode(data).number, now))

    def link(self, event: LinkEvent, now: Time) -> None:
        """Know no links."""

    def drain(self, now: Time) -> None:
        """Do nothing."""


class Chatter(Recorder):
    """The third robot: it sends payloads at the points of a Poisson process, and listens to none."""

    def __init__(self, network: Network, channel: IdealChannel, address: Address, stream: np.random.Generator) -> None:
        super().__init__()
        self._network = network
        self._channel = channel
        self._address = address
        self._stream = stream
        self._wait()

    def _wait(self) -> None:
        gap = from_seconds(self._stream.exponential(1.0 / self._network.chatter_per_s))
        self._channel.kernel.after(gap, self._send)

    def _send(self) -> None:
        self._channel.send(self._address, Outgoing(BROADCAST, bytes(self._network.chatter_octets)))
        self._wait()


def arrivals(given: Parameters, streams: Streams, end: Time, crash: Time | None = None) -> Arrivals:
    """Return which heartbeats arrive when, of a robot that sends number i at i eta until *end* or its *crash*."""
    kernel, trace, network = Kernel(), Trace(()), given.network
    size = 3 if network.chatter_per_s else 2
    channel = _channel(network, kernel, trace, size, streams)
    channel.moved(np.array([(network.apart_m * robot, 0.0) for robot in range(size)]))
    machine = Monitor(Monitoring(period_s=given.period_s, senders=1), size, SENDER, 0)
    sender = Node(SENDER, machine, kernel, channel, trace)
    recorder = Recorder()
    channel.attach(SENDER, sender)
    channel.attach(WATCHER, recorder)
    if network.chatter_per_s:
        channel.attach(size - 1, Chatter(network, channel, size - 1, streams("chatter")))
    kernel.at(0, partial(sender.drain, 0))

    def die() -> None:
        sender.kill()
        channel.power(SENDER, False)

    if crash is not None:
        kernel.at(crash, die)
    kernel.run(end if crash is None else crash + LAST_ARRIVALS)
    return recorder.arrivals


def _channel(network: Network, kernel: Kernel, trace: Trace, size: int, streams: Streams) -> IdealChannel:
    match network.channel:
        case AdhocSettings() as settings:
            return AdhocChannel(settings, kernel, trace, size, streams)
        case IdealSettings() as settings:
            return IdealChannel(settings, kernel, trace, size, streams)


# ---------------------------------------------------------------- detectors


class Candidate(NamedTuple):
    """A detector as it is set."""

    name: str
    settings: DetectorSettings
    bound_s: float = math.nan
    threshold: float = math.nan
    cut: Time | None = None
    """Delay above which heartbeats do not count."""

    def told(self, heard: Arrivals, period: Time) -> Arrivals:
        """Return those of the arrivals that it gets."""
        cut = self.cut
        return heard if cut is None else [(number, time) for number, time in heard if time - number * period <= cut]

    def judged(self, heard: Arrivals, period: Time, span: tuple[Time, Time], crash: Time | None = None) -> Quality:
        """Return the quality over the *span* from its start to its end."""
        detector = make_detector(self.settings, period, 0)
        return quality(watch(detector, self.told(heard, period), span[1]), *span, crash)


def candidates(given: Parameters) -> Iterator[Candidate]:
    """Yield all detectors; one that would have to suspect a robot before its next heartbeat is due is left out."""
    delay_s, period_s = given.network.mean_delay_s, given.period_s
    for bound_s in given.bounds_s:
        shift_s = bound_s - period_s
        if shift_s <= delay_s:
            continue
        yield Candidate("nfd_s", NfdSSettings(shift_s=shift_s), bound_s)
        for name, window in (("nfd_e", LONG_WINDOW), ("nfd_e_32", SHORT_WINDOW)):
            yield Candidate(name, NfdESettings(margin_s=shift_s - delay_s, window=window), bound_s)
        yield Candidate("fixed", FixedTimeoutSettings(timeout_s=bound_s - delay_s), bound_s)
        for times in CUTS:
            cut_s = times * delay_s
            settings = FixedTimeoutSettings(timeout_s=bound_s - cut_s)
            yield Candidate(f"fixed_cut_{times}", settings, bound_s, cut=from_seconds(cut_s))
    for kind in ("phi_akka", "phi_normal"):
        for threshold in given.thresholds:
            floor_s = given.phi_floor * period_s
            phi = {"kind": kind, "threshold": threshold, "min_deviation_s": floor_s, "acceptable_pause_s": 0.0}
            yield Candidate(kind, PhiSettings.model_validate(phi), threshold=threshold)


# ---------------------------------------------------------------- a run


@experiment_function
def measure(parameters: Mapping[str, Any], seed: int) -> list[dict[str, Any]]:
    """Return a row for each detector: ``COLUMNS``."""
    given = Parameters.model_validate(parameters)
    streams, period = Streams(seed), from_seconds(given.period_s)
    count = given.network.heartbeats
    heard = arrivals(given, streams, count * period)
    lost = 1.0 - len({number for number, _ in heard}) / count
    crashes = [_crash(given, streams("crash", number), period) for number in range(given.crashes)]
    rows = []
    for candidate in candidates(given):
        found = candidate.judged(heard, period, (SETTLING * period, count * period))
        times_s = detection_times_s(candidate, crashes, period)
        rows.append(
            {
                "detector": candidate.name,
                "bound_s": candidate.bound_s,
                "threshold": candidate.threshold,
                "lost": lost,
                "mistakes": found.mistakes,
                "watched_s": found.observed_s,
                "mistake_rate_per_s": found.mistake_rate_per_s,
                "mean_mistake_s": math.nan if found.mean_mistake_s is None else found.mean_mistake_s,
                "accuracy": found.accuracy,
                "detection_s": float(np.mean(times_s)),
                "longest_detection_s": max(times_s),
            }
        )
    return rows


def _crash(given: Parameters, stream: np.random.Generator, period: Time) -> tuple[Time, Arrivals]:
    """Return when a robot was killed, and what arrived of its heartbeats."""
    crash = int(stream.integers(SETTLING * period, OLDEST * period))
    return crash, arrivals(given, Streams(int(stream.integers(1 << 62))), crash, crash)


def detection_times_s(candidate: Candidate, crashes: Sequence[tuple[Time, Arrivals]], period: Time) -> list[float]:
    """Return T_D of every crash; inf for one that was never noticed."""
    found = []
    for crash, heard in crashes:
        time_s = candidate.judged(heard, period, (0, crash + PATIENCE * period), crash).detection_s
        assert time_s is not None
        found.append(time_s)
    return found
