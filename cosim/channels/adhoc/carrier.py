"""Carrier sense of 802.11 stations, physical and virtual: no table has it, as it follows from two of them.

The medium is busy for a station while it sends, and while it hears something: a frame that it follows, or energy
enough. Its network allocation vector (NAV) reserves the medium from the end of each frame for others that it has
received, for as long as that frame said (IEEE 802.11-1999, clause 9.2.5.4).

Where signals do not fade, this is what the station itself knows. Where they do, frames too weak to be noticed, and
jammers, are in no table: the energy of these is missing. So is a frame that the station has stopped following to answer
another one, until it does so. Switching off ends all of it, which the interval ``off`` tells.
"""

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from cosim.arrays import Bools, Floats, Int64s
from cosim.machine import BROADCAST, Address
from cosim.units import Time

ENERGY_DBM: Final = -62.0
"""Power from which on energy makes the medium busy, if a scenario does not say otherwise."""


class Carrier(NamedTuple):
    """When the medium was not free for a station: instants in ns, rising, from each first to before each second."""

    busy: Int64s
    """(n, 2)"""
    reserved: Int64s
    """(m, 2), by the NAV."""


def carrier(
    transmissions: Mapping[str, Any],
    receptions: Mapping[str, Any],
    robot: Address,
    delay: Time,
    energy_dbm: float = ENERGY_DBM,
) -> Carrier:
    """Return when the medium was busy or reserved for *robot*, from two tables of one network, by column.

    *delay* is that of the propagation in ns, *energy_dbm* the power of what is busy without being followed.
    """
    sent = {name: np.asarray(transmissions[name]) for name in ("time_ns", "source", "duration_ns", "reserves_ns")}
    mine = np.asarray(receptions["receiver"]) == robot
    heard = {name: np.asarray(receptions[name])[mine] for name in ("time_ns", "source", "outcome")}
    power_dbm, sinr_db = (np.asarray(receptions[name], np.float64)[mine] for name in ("power_dbm", "sinr_db"))
    frames, found = places(sent, heard)
    there = found & (heard["outcome"] != "out_of_range")
    frames = frames[there]
    begins = sent["time_ns"][frames] + delay
    ends = begins + sent["duration_ns"][frames]
    own = sent["source"] == robot
    own_begins = sent["time_ns"][own]
    followed = np.isnan(power_dbm[there]) | ~np.isnan(sinr_db[there])
    busy = (
        (own_begins, own_begins + sent["duration_ns"][own]),
        (begins[followed], ends[followed]),
        _loud(begins, ends, power_dbm[there], energy_dbm),
    )
    to = np.asarray(transmissions["destination"])[frames]
    informs = (heard["outcome"][there] == "received") & (to != robot) & (to != BROADCAST)
    return Carrier(
        _union(np.concatenate([begin for begin, _ in busy]), np.concatenate([end for _, end in busy])),
        _union(ends[informs], ends[informs] + sent["reserves_ns"][frames][informs]),
    )


def places(sent: Mapping[str, Any], heard: Mapping[str, Any]) -> tuple[Int64s, Bools]:
    """Return where in *sent* the frames stand that are *heard*, by time and source, and which do."""
    times = np.unique(sent["time_ns"])
    stations = 1 + max(int(sent["source"].max(initial=0)), int(heard["source"].max(initial=0)))
    keys = np.searchsorted(times, sent["time_ns"]) * stations + sent["source"]
    order = np.argsort(keys)
    wanted = np.searchsorted(times, heard["time_ns"]) * stations + heard["source"]
    places = np.append(order, 0)[np.searchsorted(keys, wanted, sorter=order)]
    return places, np.append(keys, -1)[places] == wanted


def _loud(begins: Int64s, ends: Int64s, power_dbm: Floats, energy_dbm: float) -> tuple[Int64s, Int64s]:
    """Return when all frames from *begins* to *ends* together are as strong as *energy_dbm*, by begin and end."""
    known: Bools = ~np.isnan(power_dbm)
    mw = 10.0 ** (power_dbm[known] / 10.0)
    instants = np.concatenate((begins[known], ends[known]))
    order = np.argsort(instants)
    total_mw = np.cumsum(np.concatenate((mw, -mw))[order])
    instants = instants[order]
    loud = np.flatnonzero(total_mw[:-1] >= 10.0 ** (energy_dbm / 10.0))
    return instants[loud], instants[loud + 1]


def _union(begins: Int64s, ends: Int64s) -> Int64s:
    """Return the times that are in at least one of the intervals, (n, 2)."""
    lasting = ends > begins
    order = np.argsort(begins[lasting])
    begins, ends = begins[lasting][order], np.maximum.accumulate(ends[lasting][order])
    apart = np.flatnonzero(begins[1:] > ends[:-1]) + 1
    first = np.concatenate((np.zeros(min(1, len(begins)), np.int64), apart))
    last = np.concatenate((apart - 1, np.full(min(1, len(begins)), len(begins) - 1)))
    return np.stack((begins[first], ends[last]), axis=1)
