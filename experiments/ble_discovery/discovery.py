"""How long a scanner takes to hear who begins to advertise: on the channel's devices, and on events and windows alone.

Procedures: ``devices`` of the whole channel, of which some begin to advertise at random phases of a scanner's cycle;
``three channels``, the events of an advertiser and the windows of a scanner with the PDU of the reference's table; and
``one channel``, the same on channel 37 without advDelay, at phases that are spread evenly. A ``crowd`` advertises all
the time, and its devices disturb each other.
"""

import math
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any, Final

from pydantic import Field

from cosim.channels.base import Endpoint
from cosim.channels.ble.advertising import Advertiser
from cosim.channels.ble.channel import BleChannel
from cosim.channels.ble.channels import ADVERTISING
from cosim.channels.ble.scanning import ScanWindows, next_heard
from cosim.channels.ble.settings import AdvertiseSettings, BleSettings, Interference, SearchSettings
from cosim.channels.clock import NativeClock
from cosim.experiment import experiment_function
from cosim.kernel import Kernel
from cosim.machine import Address, Discovered, Inquire, LinkEvent, Scan
from cosim.randomness import Streams
from cosim.settings import Count, Seconds, Settings
from cosim.trace import RECEPTIONS, Trace
from cosim.trace import Field as Column
from cosim.units import US, S, Time, from_seconds, to_seconds

SCANNER: Final[Address] = 0
PEERS: Final = 9
"""Devices of a scene that are to be found; their names, and with them their PDUs, have the same length."""
AIR: Final[Time] = 376 * US
SPACING: Final[Time] = 600 * US
"""The PDU of the reference's table, and the time to the next one."""
RUNS: Final = 20
"""Runs that share out even phases."""
HORIZON: Final[Time] = 10_000 * S
"""Time after which a device counts as never found."""
WARMING: Final[Time] = 2 * S
"""Time in which a crowd advertises before anybody scans."""
COLUMNS: Final = (
    Column("devices_s", "float", "s", "latency of a device: from its first PDU to the end of that which is heard"),
    Column("three_channels_s", "float", "s", "the same of events alone, with advDelay and the PDU of the table"),
    Column("one_channel_s", "float", "s", "the same on one channel without advDelay; NaN: never"),
    Column("lost", "float", "1", "whether the first PDU in a window was destroyed by others; NaN without a crowd"),
)


class Parameters(Settings):
    """What the experiment varies."""

    advertise_s: Seconds = Field(default=0.1, gt=0, description="s, advInterval")
    scan_s: Seconds = Field(default=0.03, gt=0, description="s, scanInterval")
    window_s: Seconds = Field(default=0.03, gt=0, description="s, scanWindow")
    crowd: Count = Field(default=0, le=1000, description="devices that advertise all the time; 0: no crowd")
    draws: Count = Field(default=500, ge=1, description="latencies of each procedure, or devices of crowds, in a run")

    @property
    def cycle(self) -> Time:
        """Three scanIntervals, ns."""
        return 3 * from_seconds(self.scan_s)


class Host(Endpoint):
    """A host that notes when its device has found each other one."""

    def __init__(self) -> None:
        self.found: dict[Address, Time] = {}

    def link(self, event: LinkEvent, now: Time) -> None:
        """Note the end of the first PDU of a device that is heard."""
        if isinstance(event, Discovered):
            self.found.setdefault(event.peer, now)


class Scene:
    """A scanner that cannot be found itself, and *size* devices that can."""

    def __init__(self, given: Parameters, streams: Streams, number: int, size: int, interference: Interference) -> None:
        settings = BleSettings(
            advertise=AdvertiseSettings(interval_s=given.advertise_s),
            scan=SearchSettings(interval_s=given.scan_s, window_s=given.window_s),
            clock_ppm=0,
            interference=interference,
        )
        self.kernel, self.trace, self.host = Kernel(), Trace((RECEPTIONS,)), Host()
        seed = int(streams("scene", number).integers(1 << 62))
        self.channel = BleChannel(settings, self.kernel, self.trace, 1 + size, Streams(seed))
        for address in range(1 + size):
            self.channel.attach(address, self.host if address == SCANNER else Host())
        self.channel.command(SCANNER, Scan(False))


@experiment_function
def observe(parameters: Mapping[str, Any], seed: int) -> list[dict[str, float]]:
    """Return a row for each draw, with a latency of each procedure, or for each device of a crowd."""
    given, streams = Parameters.model_validate(parameters), Streams(seed)
    names = [column.name for column in COLUMNS]
    if given.crowd:
        return [dict.fromkeys(names, math.nan) | {"lost": lost} for lost in crowds(given, streams)]
    procedures = devices(given, streams), three_channels(given, streams), one_channel(given, seed)
    return [dict(zip(names, (*latencies_s, math.nan), strict=True)) for latencies_s in zip(*procedures, strict=True)]


def devices(given: Parameters, streams: Streams) -> Iterator[float]:
    """Yield latencies, s, of devices that begin to advertise at random phases of a scanner's cycle."""
    for number in range(-(-given.draws // PEERS)):
        scene = Scene(given, streams, number, PEERS, "none")
        starts = streams("phases", number).integers(given.cycle, size=PEERS).tolist()
        for peer, start in enumerate(starts, start=1):
            scene.channel.command(peer, Scan(False))
            scene.kernel.at(start, partial(scene.channel.command, peer, Scan(True)))
        scene.channel.command(SCANNER, Inquire(HORIZON, PEERS))
        scene.kernel.run(HORIZON)
        for peer, start in enumerate(starts[: given.draws - number * PEERS], start=1):
            yield to_seconds(scene.host.found[peer] - start) if peer in scene.host.found else math.nan


def three_channels(given: Parameters, streams: Streams) -> Iterator[float]:
    """Yield latencies, s, of events with advDelay and PDUs of the reference's table at random phases."""
    phases = streams("phases of events").integers(given.cycle, size=given.draws).tolist()
    windows = _windows(given, ADVERTISING)
    for number, phase in enumerate(phases):
        delays = streams.draws("delays of events", number)
        advertiser = Advertiser(
            NativeClock(0), phase, from_seconds(given.advertise_s), AIR, delays, SPACING - AIR, ADVERTISING
        )
        yield _latency_s(advertiser, windows)


def one_channel(given: Parameters, seed: int) -> Iterator[float]:
    """Yield latencies, s, on one channel without advDelay, at even phases: runs of 20 seeds in a row share them out."""
    interval, cycle, only = from_seconds(given.advertise_s), from_seconds(given.scan_s), ADVERTISING[:1]
    windows, again = _windows(given, only), math.lcm(interval, cycle)  # after which events come to what they have met
    for number in range(given.draws):
        phase = (2 * (seed % RUNS + RUNS * number) + 1) * cycle // (2 * RUNS * given.draws)  # amid its step
        advertiser = Advertiser(NativeClock(0), phase, interval, AIR, None, 0, only)
        yield _latency_s(advertiser, windows, min(again + AIR, HORIZON))


def _windows(given: Parameters, channels: tuple[int, ...]) -> ScanWindows:
    return ScanWindows(NativeClock(0), 0, from_seconds(given.scan_s), from_seconds(given.window_s), channels)


def _latency_s(advertiser: Advertiser, windows: ScanWindows, most: Time = HORIZON) -> float:
    heard = next_heard(advertiser, windows, advertiser.first, advertiser.first + most)
    return math.nan if heard is None else to_seconds(heard.end - advertiser.first)


def crowds(given: Parameters, streams: Streams) -> Iterator[float]:
    """Yield, for each device of crowds, whether the first of its PDUs that lies in a window was destroyed."""
    for number in range(-(-given.draws // given.crowd)):
        scene = Scene(given, streams, number, given.crowd, "band")
        scene.kernel.run(WARMING)
        scene.channel.command(SCANNER, Inquire(HORIZON, given.crowd))
        scene.kernel.run(WARMING + 100 * from_seconds(given.advertise_s) + S)
        told = scene.trace.columns(RECEPTIONS.name)
        first: dict[Address, str] = {}
        for source, outcome in zip(told["source"], told["outcome"], strict=True):
            first.setdefault(source, outcome)
        for outcome in list(first.values())[: given.draws - number * given.crowd]:
            yield float(outcome != "received")
