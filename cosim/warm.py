"""What compiles before anybody waits for it: short runs of each installed protocol over each kind of channel.

A kernel is compiled when it is called first, for the types it is called with, and kept (:mod:`cosim.jit`). So what runs
commonly use is found by making runs, seconds long, in several processes, whose caches are one.
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any, Final, NamedTuple

from cosim.errors import UserError
from cosim.jit import counted_compilations
from cosim.processes import in_processes
from cosim.scenario import build, protocol_names
from cosim.simulation import simulate
from cosim.trace import INTERVALS, RECEPTIONS, TRANSMISSIONS

FADING: Final = {"model": "log_distance"}
CHANNELS: Final[Mapping[str, Mapping[str, Any]]] = {
    "bluetooth with propagation": {"kind": "bluetooth", "propagation": FADING},
    "adhoc with propagation and routing": {"kind": "adhoc", "propagation": FADING, "routing": {"kind": "aodv"}},
    "ideal": {"kind": "ideal"},
    "optical": {"kind": "optical"},
    "bluetooth": {"kind": "bluetooth"},
    "ble with propagation": {"kind": "ble", "propagation": FADING},
    "adhoc": {"kind": "adhoc"},
}
"""The channels of the short runs, by what they are called; first those that compile most."""
TEAM: Final = {
    "duration_s": 20,  # until robots have found each other over Bluetooth, and have something to say
    "floorplan": {"map": "office"},
    "team": {"size": 4, "senses": {"beams": 20, "beam_range_m": 4}},
}
"""What the scenarios of all short runs have in common."""


class ShortRun(NamedTuple):
    """A short run that is to be made."""

    protocol: str
    channel: str


class Warmed(NamedTuple):
    """What a short run has compiled, in how long; or why it could not be made."""

    run: ShortRun
    kernels: int
    wall_s: float
    refused: str = ""

    def plain(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {**self.run._asdict(), "kernels": self.kernels, "wall_s": self.wall_s, "refused": self.refused}


def short_runs(protocols: Sequence[str] = (), channels: Sequence[str] = ()) -> list[ShortRun]:
    """Return the short runs of *protocols* (all that are installed) over *channels* (all), in the order to make them.

    Neighbours in it, which run at once, differ in both: they compile less of the same.
    """
    names, kinds = list(protocols or protocol_names()), list(channels or CHANNELS)
    return [
        ShortRun(names[(turn + at) % len(names)], channel)
        for turn in range(len(names))
        for at, channel in enumerate(kinds)
    ]


def warm(runs: Sequence[ShortRun]) -> Iterator[Warmed]:
    """Make *runs* in a process for each processor, and yield what each has compiled as soon as it is finished."""
    yield from in_processes(min(os.cpu_count() or 1, len(runs)), compile_for, runs)


def compile_for(run: ShortRun) -> Warmed:
    """Make *run*: what it compiles is kept."""
    plain = {**TEAM, "channel": CHANNELS[run.channel], "protocol": {"use": run.protocol}}
    began, refused = perf_counter(), ""
    with counted_compilations() as count:
        try:
            scenario = build(plain, run.protocol, Path())
            for tables in (), (INTERVALS, TRANSMISSIONS, RECEPTIONS):  # some kernels are others if these are kept
                simulate(scenario, scenario.seed, tables)
        except UserError as error:  # a protocol may need more than its defaults
            refused = str(error)
    return Warmed(run, count.kernels, perf_counter() - began, refused)
