"""Two robots with a link and 802.11 each: the one that is master, or central, broadcasts frames as well."""

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from pydantic import Field

from cosim.channels.ble.phy import LE_1M, T_IFS
from cosim.channels.bluetooth.packets import HEADER_AIR
from cosim.experiment import experiment_function
from cosim.settings import Decibels
from cosim.units import SLOT, Time, to_seconds
from experiments.coexistence import sharing
from experiments.coexistence.sharing import (
    NARROW,
    PERIODS,
    WIDE,
    Layout,
    Sharing,
    Told,
    channels_of,
    packet_time,
    ruined_by,
)

ANSWERS: Final = {"bluetooth": HEADER_AIR, "ble": LE_1M.air_time(0)}
"""Durations of an answer that carries nothing."""


class Parameters(sharing.Parameters):
    """What the experiment varies; there is one link, as long as the robots are apart."""

    isolation_db: Decibels = Field(default=20, ge=0, description="dB between the antennas of a robot's radios")
    arbitration: bool = Field(default=False, description="whether a robot's radios ask each other before they send")


@experiment_function
def measure(parameters: Mapping[str, Any], seed: int) -> dict[str, float]:
    """Return what was lost in one run, how long payloads took, and how often a radio had to wait for the other.

    Without arbitration pairs of a radio that is deaf while its robot's station sends fail between ``deaf_least`` and
    ``deaf_most`` of the time: the station waits for what the radio sends on channels in its band, not on others.
    """
    given = Parameters.model_validate(parameters)
    robots = Layout([(0.0, 0.0), (given.link_m, 0.0)], [(NARROW, WIDE)] * 2, [0], 0)
    air = {"isolation_db": given.isolation_db, "arbitration": given.arbitration}
    run = Sharing(given, seed, robots, air)
    run.connect()
    since, until = run.run()
    told = Told(run, since, until)
    heedless = math.nan if given.arbitration else 1.0
    summary, delays, answer = run.channel.summary(), run.hosts[1].delays, ANSWERS[given.narrow]
    return {
        **told.narrow(),
        "deaf_least": heedless * told.share_hit(answer) * (1.0 - ruined_by(given) / channels_of(given)),
        "deaf_most": heedless * told.share_hit(_answer_begins(given) + answer),
        "arrived": len(delays) * PERIODS[given.narrow] / (until - since),
        "delay_ms": 1e3 * to_seconds(int(np.mean(delays))) if delays else math.nan,
        **told.wide(),
        "narrow_refused": summary.get(f"radio_{NARROW}_refused", 0.0),
        "wide_refused": summary.get(f"radio_{WIDE}_refused", 0.0),
    }


def _answer_begins(given: Parameters) -> Time:
    """Return the time from the start of a packet to that of its answer."""
    lasts = packet_time(given)
    return lasts + T_IFS if given.narrow == "ble" else -(-lasts // SLOT) * SLOT
