"""Channel selection algorithms #1 and #2: on which channel an event is (Core v5.x, Vol 6 Part B, section 4.5.8).

#1: the unmapped channel of an event is that of the event before plus hopIncrement, modulo 37, and 0 before event 0. An
unused one is replaced by the used channel at the place (unmapped mod N) of the N used ones.

#2: with the identifier of an access address as key, three rounds of bit reversal and of 17 a + b permute the event
counter to prn_e; the unmapped channel is prn_e mod 37. An unused one is replaced by the place floor(N prn_e / 2^16).
The subevents of an isochronous event go on from its channel's place, by d at least.
"""

from typing import Final

from cosim.channels.ble.channels import DATA_CHANNELS
from cosim.channels.ble.connections.channel_map import ChannelMap

HOP_INCREMENTS: Final = range(5, 17)
"""Values that hopIncrement may have."""

_WORD: Final = 0xFFFF
_REVERSED: Final = tuple(int(f"{octet:08b}"[::-1], 2) for octet in range(256))


def channel_1(used: ChannelMap, hop: int, event: int) -> int:
    """Return the channel index of an *event* by algorithm #1; *hop* is hopIncrement.

    *event* counts all events since the connection was made, skipped ones too, and does not wrap at 16 bits.
    """
    unmapped = hop * (event + 1) % DATA_CHANNELS
    return unmapped if unmapped in used.used else used.used[unmapped % len(used.used)]


def identifier(access_address: int) -> int:
    """Return the channel identifier of an access address: its halves, combined by exclusive or."""
    return (access_address >> 16 ^ access_address) & _WORD


def event_number(key: int, counter: int) -> int:
    """Return prn_e, the pseudo-random number of an event; *key* is an identifier, 16 bits of *counter* count."""
    return _mixed(key, counter) ^ key


def channel_2(used: ChannelMap, key: int, counter: int) -> int:
    """Return the channel index of an event by algorithm #2; *key* is an identifier, 16 bits of *counter* count."""
    return used.used[_place(used, event_number(key, counter))]


def subevent_channels(used: ChannelMap, key: int, counter: int, count: int) -> list[int]:
    """Return the channel indices of the first *count* subevents of an event by algorithm #2, its own channel first."""
    number = _mixed(key, counter)
    place = _place(used, number ^ key)
    size = len(used.used)
    distance = max(1, min(3, size - 5), min(11, (size - 10) // 2))
    channels = [used.used[place]]
    for _ in range(count - 1):
        number = _round(number, key)
        place += ((number ^ key) * (size - 2 * distance + 1) >> 16) + distance
        channels.append(used.used[place % size])
    return channels


def _mixed(key: int, counter: int) -> int:
    """Return prn_s, from which prn_e and the subevents come."""
    number = (counter ^ key) & _WORD
    for _ in range(3):
        number = _round(number, key)
    return number


def _round(number: int, key: int) -> int:
    return (17 * (_REVERSED[number & 0xFF] | _REVERSED[number >> 8] << 8) + key) & _WORD


def _place(used: ChannelMap, number: int) -> int:
    """Return the place among the *used* channels that the event with this pseudo-random *number* has."""
    unmapped = number % DATA_CHANNELS
    return used.used.index(unmapped) if unmapped in used.used else len(used.used) * number >> 16
