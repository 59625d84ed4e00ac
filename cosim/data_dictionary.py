"""The data dictionary: one page about every column that cosim and the installed protocols write, made from their code.

The page is ``docs/tables.md``. After a change of a table, an event type or a metric it is made anew:

    python -m cosim.data_dictionary > docs/tables.md
"""

from collections.abc import Iterable, Sequence
from inspect import getdoc
from typing import Final

from cosim.channels.adhoc.channel import AdhocChannel
from cosim.channels.base import Channel
from cosim.channels.ble.channel import BleChannel
from cosim.channels.bluetooth.device import BluetoothChannel
from cosim.channels.energy import USE_METRICS
from cosim.channels.ideal import IdealChannel
from cosim.channels.vision import OpticalChannel
from cosim.faults.course import ENERGY_METRICS
from cosim.faults.events import EVENTS as FAULT_EVENTS
from cosim.intervals import STATES
from cosim.protocol import Metric, ProtocolSpec
from cosim.results import FIXED, OBSERVATION_FIXED
from cosim.scenario import protocol_names, protocol_spec
from cosim.simulation import METRICS
from cosim.trace import TABLES, Field, event_fields, events_table

CHANNELS: Final[dict[str, type[Channel]]] = {
    "ideal": IdealChannel,
    "optical": OpticalChannel,
    "bluetooth": BluetoothChannel,
    "ble": BleChannel,
    "adhoc": AdhocChannel,
}
INTRODUCTION: Final = """\
# Tables

Made from the code by `python -m cosim.data_dictionary > docs/tables.md`; do not edit.
All tables are Parquet; unit and meaning also stand in the metadata of each column. A unit of 1 is a plain number.
"""


def page(specs: Sequence[ProtocolSpec]) -> str:
    """Return the page, in Markdown, about cosim's tables and those of the protocols *specs*."""
    sections = [
        INTRODUCTION,
        "## What sweeps write\n",
        _section("runs", "a row a run; then follow the axes of the experiment and the metrics below", FIXED),
        _section("observations", "a row for each thing that a run counts more than once", OBSERVATION_FIXED),
        "### Metrics of every run\n\nThe channel's own counts and the metrics of the protocol follow.\n",
        _metrics(METRICS),
        *(f"### Metrics of the channel {name}\n\n{_metrics(channel.metrics)}" for name, channel in CHANNELS.items()),
        "### Metrics of what radios use\n\nOf ble, bluetooth, adhoc with `energy`; the last if that names a part.\n",
        _metrics(USE_METRICS),
        "### Metrics of what else batteries pay for\n\nIf the fault `battery` has `energy: states`.\n",
        _metrics(ENERGY_METRICS),
        "## What `cosim run --trace` writes\n",
        *(_section(table.name, table.meaning, table.fields) for table in TABLES.values()),
        "States of intervals:\n",
        _grid(("state", "meaning"), ((f"`{state}`", meaning) for state, meaning in STATES.items())),
        _section("events", "what machines report; the columns of the protocol's event types follow", _EVERY_EVENT),
        "Faults that a scenario schedules stand there too:\n",
        *map(_fault, FAULT_EVENTS),
        *(_protocol(spec) for spec in specs),
    ]
    return "\n".join(sections)


_EVERY_EVENT: Final = events_table(()).fields


def _fault(kind: type) -> str:
    columns = event_fields(kind)
    return f"`{kind.__name__}`: {getdoc(kind)}\n" + (f"\n{_columns(columns)}" if columns else "")


def _protocol(spec: ProtocolSpec) -> str:
    parts = [f"## Protocol {spec.name}\n", "### Metrics\n", _metrics(spec.metrics), "### Events\n"]
    for kind in spec.events:
        meaning = (getdoc(kind) or "").partition("\n")[0]
        parts.append(f"`{kind.__name__}`: {meaning}\n")
        parts.append(_columns(event_fields(kind)))
    return "\n".join(parts)


def _section(name: str, meaning: str, fields: Iterable[Field]) -> str:
    return f"### `{name}`\n\n{meaning[0].upper()}{meaning[1:]}.\n\n{_columns(fields)}"


def _columns(fields: Iterable[Field]) -> str:
    return _grid(("column", "type", "unit", "meaning"), ((f"`{f.name}`", f.kind, f.unit, f.meaning) for f in fields))


def _metrics(metrics: Iterable[Metric]) -> str:
    return _grid(("metric", "unit", "meaning"), ((f"`{m.name}`", m.unit, m.meaning) for m in metrics))


def _grid(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(cell.replace('|', '/') for cell in line)} |\n" for line in lines)


if __name__ == "__main__":
    print(page([protocol_spec(name) for name in protocol_names()]), end="")
