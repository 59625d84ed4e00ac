"""How long a page takes until the paged device answers, by scan mode and by what the pager knows of the other's clock.

Every page has a channel of its own with two devices: clocks with random phases, a scan window with a random offset.
The pager knows, as from an inquiry, how far the other's clock is from its own: the truth, or anything. What happens
then is read off the frames: the first ID that the paged device sends is its response.
"""

import math
from collections.abc import Mapping
from typing import Any, Final, Literal, NamedTuple, TypeAlias

from pydantic import Field

from cosim.channels.bluetooth.device import BluetoothChannel
from cosim.channels.bluetooth.inquiry import CLOCK_RANGE, known_offset
from cosim.channels.bluetooth.paging import PageSettings
from cosim.channels.bluetooth.scanning import ScanSettings, first_transmission
from cosim.channels.bluetooth.settings import BluetoothSettings
from cosim.experiment import experiment_function
from cosim.kernel import Kernel
from cosim.machine import Address, Connected, LinkEvent, Page, PageFailed, Reception
from cosim.randomness import Streams
from cosim.settings import Count, Settings
from cosim.trace import FRAMES, Trace
from cosim.trace import Field as Column
from cosim.units import MS, Time, to_seconds

Mode: TypeAlias = Literal["R0", "R1", "R2"]

PAGER: Final[Address] = 0
PAGED: Final[Address] = 1
INTERVAL_S: Final[dict[Mode, float]] = {"R0": 0.01125, "R1": 1.28, "R2": 2.56}
"""Interval from one page scan window to the next; R0 scans all the time."""
LOOK: Final[Time] = 160 * MS
"""Interval between checks of the outcome of a page."""
COLUMNS: Final = (
    Column("page", "int", "", "number of the page in the run, from 0"),
    Column("page_time_s", "float", "s", "from the first transmit slot to the start of the response; NaN: none"),
    Column("page_time_from_command_s", "float", "s", "the same from the host's command"),
)


class Parameters(Settings):
    """What the experiment varies."""

    mode: Mode = Field(default="R1", description="scan mode of the paged device, which the pager knows")
    estimate: Literal["exact", "random"] = Field(
        default="exact", description="what the pager knows of the other's clock"
    )
    timeout_slots: Count = Field(default=8192, ge=2, multiple_of=2, description="pageTO in slots of 625 us")
    pages: Count = Field(default=500, ge=1, description="pages of a run")


class Times(NamedTuple):
    """Seconds until the start of the response; NaN if there was none."""

    from_slot_s: float
    """Time from the pager's first transmit slot."""
    from_command_s: float
    """Time from the host's command, which may come at any time."""


class Host:
    """An endpoint that notes whether the page is over."""

    def __init__(self) -> None:
        self.over = False

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        """Expect nothing: no device sends."""

    def link(self, event: LinkEvent, now: Time) -> None:
        """Note the end of the page."""
        self.over = self.over or isinstance(event, Connected | PageFailed)

    def drain(self, now: Time) -> None:
        """Do nothing."""


@experiment_function
def observe(parameters: Mapping[str, Any], seed: int) -> list[dict[str, Any]]:
    """Return a row for each page, with the time in s until the other answers, NaN if it did not before pageTO."""
    given = Parameters.model_validate(parameters)
    streams = Streams(seed)
    rows = []
    for number in range(given.pages):
        times = page_times(given, streams, number)
        rows.append(
            {"page": number, "page_time_s": times.from_slot_s, "page_time_from_command_s": times.from_command_s}
        )
    return rows


def page_times(given: Parameters, streams: Streams, number: int) -> Times:
    """Return how long it takes from the page to the start of the paged device's first response."""
    stream = streams("page", number)
    settings = BluetoothSettings(
        clock_ppm=0,
        page=PageSettings(mode=given.mode, timeout_slots=given.timeout_slots),
        page_scan=ScanSettings(interval_s=INTERVAL_S[given.mode]),
    )
    kernel, trace, hosts = Kernel(), Trace((FRAMES,)), (Host(), Host())
    channel = BluetoothChannel(settings, kernel, trace, 2, Streams(int(stream.integers(1 << 62))))
    for address, host in enumerate(hosts):
        channel.attach(address, host)
    pager, paged = (channel.devices[address].identity.clock for address in (PAGER, PAGED))
    begin = pager.time_of(first_transmission(pager, 0))
    exact = given.estimate == "exact"
    offset = known_offset(pager, paged, 0) if exact else int(stream.integers(CLOCK_RANGE)) & ~3
    channel.command(PAGER, Page(PAGED, offset))
    while not hosts[PAGER].over:
        kernel.run(kernel.now + LOOK)
    frames = trace.columns("frames")
    response = next(
        (
            time
            for time, source, kind in zip(frames["time_ns"], frames["source"], frames["kind"], strict=True)
            if source == PAGED and kind == "ID"
        ),
        None,
    )
    if response is None:
        return Times(math.nan, math.nan)
    return Times(to_seconds(response - begin), to_seconds(response))
