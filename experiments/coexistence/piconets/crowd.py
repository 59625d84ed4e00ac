"""Many links of Bluetooth and a station of 802.11 in one air, and how often links are expected to meet each other."""

import math
from collections.abc import Mapping
from typing import Any

from cosim.experiment import experiment_function
from experiments.coexistence.sharing import Parameters, Sharing, Told, along_a_line, channels_of, ruined_by


@experiment_function
def measure(parameters: Mapping[str, Any], seed: int) -> dict[str, float]:
    """Return what was lost in one run, beside what is expected of packets that hop on all channels."""
    given = Parameters.model_validate(parameters)
    run = Sharing(given, seed, along_a_line(given))
    run.connect()
    told = Told(run, *run.run())
    by_station = told.share_hit() * ruined_by(given) / channels_of(given)
    by_links = 1.0 - (1.0 - told.met() / channels_of(given)) ** (given.links - 1)
    expected = math.nan if given.afh else 1.0 - (1.0 - by_station) * (1.0 - by_links)
    return {**told.narrow(), "expected_narrow_loss": expected, **told.wide(), "ruined": ruined_by(given)}
