"""How many frames survive when N piconets share one room: concrete frames on the band, each of which is judged.

Every piconet has a hop address and a master's clock of its own, both random; all devices receive all others equally
strongly. At full load every slot of every piconet holds a frame, the master's and the slave's in turn, on the channel
that the hop kernel gives. The frames are put on the air of ``cosim.channels.bluetooth.medium`` and judged there at
their ends, as those of a run are. No probability enters: two frames overlap or they do not.

In a real link a slave that did not hear its master does not answer, so that the load falls with what is lost. The
closed forms know nothing of that. Here the slave sends in any case; ``links`` is the experiment with real links.
"""

import math
from collections.abc import Mapping
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cosim.channels.bluetooth.bits.errors import ACCESS_CODE
from cosim.channels.bluetooth.hopping import CHANNELS, basic_hop
from cosim.channels.bluetooth.inquiry import CLOCK_RANGE
from cosim.channels.bluetooth.medium import CO_CHANNEL, MET, NEIGHBOURING, RECEIVED, Medium, judge, new_medium, put
from cosim.channels.bluetooth.packets import DH1
from cosim.experiment import experiment_function
from cosim.jit import njit
from cosim.randomness import Streams
from cosim.settings import Count, Settings
from cosim.trace import Field as Column
from cosim.units import SLOT, TICK, Time
from experiments.piconet_interference import links

Traffic = Literal["one_slot", "full_slot", "synchronised", "links"]

FRAME: Final[dict[str, Time]] = {
    "one_slot": DH1.air_time(DH1.capacity),
    "full_slot": SLOT,
    "synchronised": DH1.air_time(DH1.capacity),
}
"""Air time by traffic. No packet of Basic Rate fills its slot, but a closed form is known for one that would."""
MODES: Final = {"co_channel": CO_CHANNEL, "neighbouring": NEIGHBOURING}
MARGIN: Final = 3
"""Slots at either end in which frames are sent, but not counted: some that overlap them are missing."""
COLUMNS: Final = (
    Column("survival", "float", "1", "share of the frames that were received"),
    Column("load", "float", "1", "frames sent in a slot of a piconet"),
    Column("closed_form", "float", "1", "published survival; NaN where there is none"),
    Column("without_repeats", "float", "1", "survival if successive hops are never equal; NaN where it is not known"),
)


class Parameters(Settings):
    """What the experiment varies."""

    piconets: int = Field(default=2, ge=1, le=100, description="piconets in the room")
    traffic: Traffic = Field(default="one_slot", description="what they send, or real links")
    interference: Literal["co_channel", "neighbouring"] = Field(
        default="co_channel", description="which frames destroy which"
    )
    slots: Count = Field(default=400, ge=2, multiple_of=2, description="slots of a run that are counted")
    link_slots: Count = Field(default=100, ge=2, multiple_of=2, description="the same for real links, which cost more")


@experiment_function
def measure(parameters: Mapping[str, Any], seed: int) -> dict[str, float]:
    """Return the share of frames that survive, beside what the closed form lets expect (NaN where there is none)."""
    given = Parameters.model_validate(parameters)
    if given.traffic == "links":
        found = links.survival(given.piconets, given.interference, given.link_slots, seed)
    else:
        found = {"survival": survival(given, Streams(seed)), "load": 1.0}
    return found | {
        "closed_form": closed_form(given.piconets, given.traffic, given.interference),
        "without_repeats": without_repeats(given.piconets, given.traffic, given.interference),
    }


def closed_form(piconets: int, traffic: Traffic, interference: str) -> float:
    """Return the published survival of frames at full load, co-channel only; NaN for anything else."""
    others = piconets - 1
    if interference != "co_channel":
        return math.nan
    match traffic:
        case "one_slot":
            return ((78 / 79) * (1 - 0.1712 / 79)) ** others
        case "full_slot":
            return (78 / 79) ** (2 * others)
        case "synchronised":
            return (78 / 79) ** others
        case "links":
            return math.nan


def without_repeats(piconets: int, traffic: Traffic, interference: str) -> float:
    """Return the same for hops that never stay on a channel, as those of two successive slots never do.

    The published forms take the two frames of one piconet that a frame can overlap for independent; but they are
    on two channels, of which each is hit with probability 1/79.
    """
    if interference != "co_channel" or traffic == "links":
        return math.nan
    second = {"one_slot": 2 * FRAME["one_slot"] / SLOT - 1, "full_slot": 1.0, "synchronised": 0.0}[traffic]
    return float((1 - (1 + second) / CHANNELS) ** (piconets - 1))


def survival(given: Parameters, streams: Streams) -> float:
    """Return the share of the frames of all piconets in one run that are received."""
    stream = streams("piconets")
    words = stream.integers(1 << 32, size=given.piconets)
    phases = stream.integers(CLOCK_RANGE * TICK, size=given.piconets)
    if given.traffic == "synchronised":
        phases -= phases % SLOT
    medium = new_medium(2 * given.piconets, MODES[given.interference])
    received = _received(medium, words, phases, FRAME[given.traffic], given.slots)
    return received / (given.piconets * given.slots)


@njit(cache=True)
def _received(medium: Medium, words: NDArray[np.int64], phases: NDArray[np.int64], air: int, slots: int) -> int:
    """Return how many of the frames of the *slots* in the middle are received."""
    count = 0
    for number in range(slots + 2 * MARGIN):
        for p in range(len(words)):
            start, source, channel = _frame(words[p], phases[p], p, number)
            put(medium, source, start, start + air, channel)
        if number < 2 * MARGIN:
            continue
        # two slots on, all that starts before a frame's end has been put on the air
        for p in range(len(words)):
            start, source, channel = _frame(words[p], phases[p], p, number - MARGIN)
            receiver = source ^ 1
            end = start + air
            fate = judge(medium, None, None, source, receiver, channel, start, end, 0.0, 0, False, ACCESS_CODE)
            count += fate & ~MET == RECEIVED
    return count


@njit(cache=True)
def _frame(word: int, phase: int, p: int, number: int) -> tuple[int, int, int]:
    """Return start, transmitter and channel of the frame of piconet *p* in its slot *number*; the master begins."""
    tick = -(-phase // TICK) // 4 * 4 + 4 + 2 * number
    return tick * TICK - phase, 2 * p + number % 2, basic_hop(word, tick)
