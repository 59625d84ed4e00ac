"""One capture file of a run: all radios that can be captured, side by side, in the order of time.

They are those of the robots, and of the stations in the background.
"""

from collections.abc import Iterator, Mapping, Sequence
from heapq import merge
from itertools import compress
from operator import attrgetter
from pathlib import Path
from typing import Any, Final

from cosim import __version__
from cosim.channels.adhoc.channel import AdhocChannel
from cosim.channels.background import called
from cosim.channels.base import Channel
from cosim.channels.ble.channel import BleChannel
from cosim.channels.bluetooth.device import BluetoothChannel
from cosim.channels.kinds import ChannelSettings
from cosim.channels.radios import RadiosSettings
from cosim.export import baseband, ieee80211, low_energy
from cosim.export.pcapng import Interface, Packet, write_pcapng
from cosim.trace import FRAMES, TRANSMISSIONS, Table, Trace

CAPTURED: Final = {"bluetooth": FRAMES, "adhoc": TRANSMISSIONS, "ble": TRANSMISSIONS}
"""The kinds of channels that can be captured, and the table that a capture of each is made of."""


def captured_tables(settings: ChannelSettings) -> tuple[Table, ...]:
    """Return the tables that a capture of a run with such a channel is made of; none if it has nothing to capture."""
    radios = settings.radios if isinstance(settings, RadiosSettings) else (settings,)
    kinds = {radio.kind for radio in radios}
    return tuple({table: None for kind, table in CAPTURED.items() if kind in kinds})


def write_capture(path: Path, channel: Channel, trace: Trace, comment: str) -> int:
    """Write what the radios of *channel* have sent or received, as *trace* has it, to *path*; return how many packets.

    *comment* is kept with the file; the trace has the tables of ``captured_tables``. Raise OSError if the file cannot
    be written.
    """
    interfaces: list[Interface] = []
    sources: list[Iterator[Packet]] = []
    for radio, part in enumerate(channel.parts):
        carriers = [address for address in range(part.size) if radio in channel.carried(address)]
        several = f" radio {radio}" if len(channel.parts) > 1 else ""
        names = [called(address, channel.size) + several for address in carriers]
        places = {address: len(interfaces) + place for place, address in enumerate(carriers)}
        if isinstance(part, BluetoothChannel):
            devices = [device.identity for device in part.devices]
            interfaces += map(baseband.interface, (devices[address] for address in carriers), names)
            sources.append(_placed(baseband.packets(_rows(trace, FRAMES, radio), devices), places))
        elif isinstance(part, AdhocChannel):
            interfaces += [ieee80211.interface(each, radio, name) for each, name in zip(carriers, names, strict=True)]
            sources.append(_placed(ieee80211.packets(_rows(trace, TRANSMISSIONS, radio), radio), places))
        elif isinstance(part, BleChannel):
            places = dict.fromkeys(carriers, len(interfaces))  # a connection is followed on one interface only
            interfaces.append(low_energy.interface(radio))
            sources.append(_placed(low_energy.packets(_rows(trace, TRANSMISSIONS, radio)), places))
    packets = merge(*sources, key=attrgetter("time"))
    return write_pcapng(path, interfaces, packets, f"cosim {__version__}", comment)


def _rows(trace: Trace, table: Table, radio: int) -> Mapping[str, Sequence[Any]]:
    """Return *table* as lists by column, of one radio only if the trace has a column for radios."""
    columns = trace.columns(table.name)
    if "radio" not in columns:
        return columns
    wanted = [number == radio for number in columns["radio"]]
    return {name: list(compress(column, wanted)) for name, column in columns.items()}


def _placed(packets: Iterator[Packet], places: Mapping[int, int]) -> Iterator[Packet]:
    """Yield *packets*, whose interfaces are addresses, with the interfaces of these in the file."""
    for packet in packets:
        yield packet._replace(interface=places[packet.interface])
