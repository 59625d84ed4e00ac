"""How long a device takes to be found: inquiries on the Bluetooth channel, each with devices of its own.

Every inquiry has a channel of its own: clocks with random phases and drifts, scan windows with random offsets, and a
first train drawn for it. Hosts do nothing but ask for an inquiry (device 0) and record its results; all else is
done by the link controllers of ``cosim.channels.bluetooth``.
"""

import math
from collections.abc import Mapping
from typing import Any, Final

from pydantic import Field

from cosim.channels.base import Endpoint
from cosim.channels.bluetooth.device import BluetoothChannel
from cosim.channels.bluetooth.inquiry import InquiryScanSettings, InquirySettings
from cosim.channels.bluetooth.scanning import first_transmission
from cosim.channels.bluetooth.settings import BluetoothSettings
from cosim.experiment import experiment_function
from cosim.kernel import Kernel
from cosim.machine import Address, Discovered, Inquire, LinkEvent
from cosim.randomness import Streams
from cosim.settings import Count, Seconds, Settings
from cosim.trace import Field as Column
from cosim.trace import Trace
from cosim.units import SLOT, Time, from_seconds, to_seconds

INQUIRER: Address = 0

COLUMNS: Final = (
    Column("version", "str", "", "version of the specification that inquiry scan follows"),
    Column("interlaced", "bool", "", "whether the scan is interlaced"),
    Column("scan_interval_s", "float", "s", "from the start of a scan window to the next"),
    Column("drift_ppm", "int", "ppm", "bound of the drift of each clock, either way"),
    Column("inquiry", "int", "", "number of the inquiry in the run, from 0"),
    Column("scanner", "int", "", "number of the scanning device in the inquiry, from 1"),
    Column("discovery_time_s", "float", "s", "from the first ID to the end of the first received FHS; NaN: not found"),
)


class Parameters(Settings):
    """What the experiment varies."""

    scan: InquiryScanSettings = Field(
        default_factory=InquiryScanSettings, description="how devices let themselves be found"
    )
    drift_ppm: int = Field(default=0, ge=0, le=250, description="native clocks drift by up to so many ppm, either way")
    duration_s: Seconds = Field(default=51.2, gt=0, description="s, length of an inquiry")
    scanners: Count = Field(default=1, ge=1, description="devices that scan, of each inquiry")
    inquiries: Count = Field(default=100, ge=1, description="inquiries of a run")


class Host(Endpoint):
    """An endpoint that records when its device discovered each other one."""

    def __init__(self) -> None:
        self.found: dict[Address, Time] = {}

    def link(self, event: LinkEvent, now: Time) -> None:
        """Note the end of the first FHS of a device."""
        if isinstance(event, Discovered):
            self.found.setdefault(event.peer, now)


@experiment_function
def observe(parameters: Mapping[str, Any], seed: int) -> list[dict[str, Any]]:
    """Return a row for each device that scanned, with its discovery time in s, NaN if it was not found."""
    given = Parameters.model_validate(parameters)
    row = {
        "version": given.scan.version,
        "interlaced": given.scan.interlaced,
        "scan_interval_s": given.scan.interval_s,
        "drift_ppm": given.drift_ppm,
    }
    return [
        row | {"inquiry": number, "scanner": scanner, "discovery_time_s": time_s}
        for number in range(given.inquiries)
        for scanner, time_s in enumerate(discovery_times_s(given, Streams(seed), number), start=1)
    ]


def discovery_times_s(given: Parameters, streams: Streams, number: int) -> list[float]:
    """Return the time, for each scanner of one inquiry, from its first ID to the end of the FHS that is received first.

    NaN if there is none.
    """
    stream = streams("inquiry", number)
    settings = BluetoothSettings(
        clock_ppm=given.drift_ppm,
        inquiry=InquirySettings(first_train="A" if stream.integers(2) else "B"),
        inquiry_scan=given.scan,
    )
    kernel, size = Kernel(), 1 + given.scanners
    channel = BluetoothChannel(settings, kernel, Trace(()), size, Streams(int(stream.integers(1 << 62))))
    hosts = [Host() for _ in range(size)]
    for address, host in enumerate(hosts):
        channel.attach(address, host)
    duration = from_seconds(given.duration_s)
    channel.command(INQUIRER, Inquire(duration, given.scanners))
    clock = channel.devices[INQUIRER].identity.clock
    begin = clock.time_of(first_transmission(clock, 0))
    kernel.run(duration + 10 * SLOT)
    found = hosts[INQUIRER].found
    return [to_seconds(found[scanner] - begin) if scanner in found else math.nan for scanner in range(1, size)]
