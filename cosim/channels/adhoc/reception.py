"""The frames that arrive at one station, and which of them it receives.

Where signals do not fade, every frame in reach is equally strong. One that begins while nothing else is there is
followed; any other that overlaps it spoils it, and so does a jammer.

Where they fade, frames have powers. One that is strong enough is followed; all others, jammers and noise disturb it,
each for as long as it lasts. A much stronger one that begins during the preamble of the first takes its place
(capture). Whether the frame that was followed is received is drawn at its end, from the probability that all its parts
have no errors, of which the logarithms are added up whenever the disturbance changes.

A station whose robot's other radio sends is deaf, where an arbiter divides the air between them.
"""

import math
from typing import Final

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.channels.adhoc.air import total_mw
from cosim.channels.adhoc.errors import log_bit
from cosim.channels.adhoc.state import NEVER, NONE, Network, Record
from cosim.jit import njit
from cosim.randomness import philox_words
from cosim.units import Time

RECEPTION: Final = 2
"""Purpose of the draws of errors."""

IGNORED: Final = 0
"""The station has not followed the frame."""
WRONG: Final = 1
RIGHT: Final = 2


@njit(cache=True, borrows=True)
def energy(network: Network, address: int) -> bool:
    """Return whether the medium is busy with what others send: much energy, or a frame that is followed."""
    common, station = network.common[0], network.stations[address]
    if not common.fades:
        return bool(station.arriving > 0 or station.jammed_from != NEVER)
    if station.followed != NONE:
        return True
    return bool(station.jammers_mw + total_mw(network, address) >= common.busy_mw)


@njit(cache=True, borrows=True)
def is_calm(network: Network, address: int, more_mw: float) -> bool:
    """Return whether a station follows no frame and, if signals fade, finds the medium idle with *more_mw* as well.

    There a frame that begins or ends, and is too weak to be followed, changes nothing but the power.
    """
    common, station = network.common[0], network.stations[address]
    if station.followed != NONE:
        return False
    return bool(station.jammers_mw + (total_mw(network, address) + more_mw) < common.busy_mw)  # 0 if they do not fade


@njit(cache=True, borrows=True)
def begins(network: Network, address: int, number: int, mw: float, now: Time) -> bool:
    """Note that a frame begins to arrive; a station that sends follows none. Return whether silence ends."""
    common, station = network.common[0], network.stations[address]
    was_busy, deaf = energy(network, address), station.sending != NONE or now < station.deaf_until
    if common.fades:
        follows = not deaf and mw >= common.follows_mw and _takes_over(network, station, address, mw, now)
    else:
        station.spoilt |= station.followed != NONE
        follows = not deaf and station.arriving == 0
    if follows:
        stop_following(station, now)
        station.followed, station.followed_from, station.spoilt = number, now, False
        station.deafened = False
        station.log_chance, station.level_from, station.least_level = 0.0, 0, math.inf
    network.powers_mw[number, address] = mw
    station.arriving += 1
    note_level(network, address, now)
    if was_busy or not energy(network, address):
        return False
    station.energy_from = now
    return True


@njit(cache=True, borrows=True)
def stop_following(station: Record, now: Time) -> None:
    """Follow no frame any more, if the station has followed one."""
    if station.followed != NONE:
        station.followed_for += now - station.followed_from
        station.followed = NONE


@njit(cache=True, borrows=True)
def _takes_over(network: Network, station: Record, address: int, mw: float, now: Time) -> bool:
    """Return whether a frame that begins is followed from now on."""
    followed = station.followed
    if followed == NONE:
        return True
    early = now - station.followed_from < network.frames[followed].form.preamble
    return bool(early and mw >= network.common[0].capture * network.powers_mw[followed, address])


@njit(cache=True, borrows=True)
def ends(network: Network, address: int, number: int, now: Time) -> int:
    """Note that a frame ends; return RIGHT if it was received, WRONG if with errors, IGNORED if it was not followed."""
    common, station, frame = network.common[0], network.stations[address], network.frames[number]
    station.arriving -= 1
    network.powers_mw[number, address] = 0.0
    if station.followed != number:
        note_level(network, address, now)
        return IGNORED
    _spoil(station, now)
    stop_following(station, now)
    right = _is_right(network, address, number) if common.fades else not station.spoilt
    return RIGHT if right and frame.whole and not station.deafened else WRONG


@njit(cache=True, borrows=True)
def disturb(network: Network, address: int, mw: float, at: Time) -> bool:
    """Note the power of jammers from *at* on; return whether silence begins or ends then.

    Where signals do not fade, a jammer of any power but 0 spoils what is followed.
    """
    station = network.stations[address]
    was_busy = energy(network, address)
    if mw == station.jammers_mw:
        return False
    _spoil(station, at)
    station.jammers_mw = mw
    station.jammed_from = at if mw > 0.0 else NEVER
    note_level(network, address, at)
    if energy(network, address) and not was_busy:
        station.energy_from = at
    return energy(network, address) != was_busy


@njit(cache=True, borrows=True)
def deafen(network: Network, address: int, until: Time) -> None:
    """Note that another radio of the robot sends from now *until* then: nothing is received across that."""
    station = network.stations[address]
    station.deaf_until = max(station.deaf_until, until)
    station.deafened = True


@njit(cache=True, borrows=True)
def _spoil(station: Record, until: Time) -> None:
    """Spoil the frame that is followed if a jammer has been there before *until*."""
    if station.jammed_from < until:
        station.spoilt = True


# ---------------------------------------------------------------- errors


@njit(cache=True, borrows=True)
def note_level(network: Network, address: int, now: Time) -> None:
    """Note how much stronger than all else the frame that is followed is from now on."""
    common, station = network.common[0], network.stations[address]
    if not common.fades or station.followed == NONE:
        return
    since = now - station.followed_from
    _add_errors(station, network.frames[station.followed].form, since, network.cck)
    mw = network.powers_mw[station.followed, address]
    others_mw = total_mw(network, address) - mw
    station.level = mw / (common.noise_mw + station.jammers_mw + max(others_mw, 0.0))
    station.least_level = min(station.least_level, station.level)
    station.level_from = since


@njit(cache=True, borrows=True)
def _add_errors(station: Record, form: Record, until: Time, cck: Floats) -> None:
    """Add the chance of no error in the part of a frame since the last change, up to *until*."""
    since = station.level_from
    for header in (True, False):
        if header:
            begin, end, kbps, bits = form.header, form.preamble, form.header_kbps, form.header_bits
        else:
            begin, end, kbps, bits = form.preamble, form.end, form.rate_kbps, 8 * form.octets
        overlap = min(until, end) - max(since, begin)
        if overlap > 0:
            station.log_chance += bits * overlap / (end - begin) * log_bit(kbps, station.level, cck)


@njit(cache=True, borrows=True)
def _is_right(network: Network, address: int, number: int) -> bool:
    """Draw whether a frame that was followed to its end arrives without errors."""
    common, station, frame = network.common[0], network.stations[address], network.frames[number]
    _add_errors(station, frame.form, NEVER, network.cck)
    begin, link = frame.begin, frame.source << 16 | address
    words = philox_words(begin & 0xFFFFFFFF, begin >> 32, link, RECEPTION, common.key_0, common.key_1)
    return (words[0] << 21 | words[1] >> 11) * 2.0**-53 < elementary.exp(station.log_chance)
