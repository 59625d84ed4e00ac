"""Channel selection against published vectors, and the properties that both algorithms promise."""

from collections import Counter
from itertools import pairwise

import pytest

from cosim.channels.ble.bits.access import ADVERTISING_ADDRESS
from cosim.channels.ble.channels import DATA_CHANNELS
from cosim.channels.ble.connections.channel_map import ALL_CHANNELS, ChannelMap, decode_channel_map
from cosim.channels.ble.selection import (
    HOP_INCREMENTS,
    channel_1,
    channel_2,
    event_number,
    identifier,
    subevent_channels,
)
from cosim.errors import WireError

KEY = identifier(ADVERTISING_ADDRESS)
NINE = (9, 10, 21, 22, 23, 33, 34, 35, 36)
FIFTEEN = (0, 1, 2, 4, 10, 14, *range(24, 33), 34)
MAPS = [tuple(range(37)), NINE, FIFTEEN, (0, 36), (3, 4, 5), tuple(range(0, 37, 3)), tuple(range(0, 37, 2))]


# ---------------------------------------------------------------- channel maps


@pytest.mark.parametrize(
    ("octets", "used"),
    [
        ("ff ff ff ff 1f", tuple(range(37))),
        ("00 06 e0 00 1e", NINE),
        ("17 44 00 ff 05", FIFTEEN),
        ("01 00 00 00 10", (0, 36)),
    ],
)
def test_a_map_has_these_octets(octets: str, used: tuple[int, ...]) -> None:
    assert ChannelMap(used).encode() == bytes.fromhex(octets)
    assert decode_channel_map(bytes.fromhex(octets)) == ChannelMap(used)


def test_bits_beyond_channel_36_do_not_count() -> None:
    assert decode_channel_map(bytes.fromhex("00 06 e0 00 fe")) == ChannelMap(NINE)
    with pytest.raises(WireError, match="1 used"):
        decode_channel_map(bytes.fromhex("00 00 00 00 f0"))


@pytest.mark.parametrize(
    ("octets", "why"), [("", "0 octets"), ("ff ff ff ff 1f 00", "6 octets"), ("00 00 00 00 00", "0 used")]
)
def test_octets_that_are_no_map_are_refused(octets: str, why: str) -> None:
    with pytest.raises(WireError, match=why):
        decode_channel_map(bytes.fromhex(octets))


@pytest.mark.parametrize("used", [(), (3,), (3, 3), (4, 3), (0, 37), (-1, 3)])
def test_channels_that_are_no_map_are_refused(used: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="two or more of 0 to 36"):
        ChannelMap(used)


# ---------------------------------------------------------------- algorithm 1


@pytest.mark.parametrize(
    ("hop", "used", "channels"),  # bluetoe, tests/link_layer/channel_map_tests.cpp
    [
        (5, tuple(range(37)), [5, 10, 15, 20, 25, 30, 35, 3, 8, 13, 18, 23, 28]),
        (7, FIFTEEN, [25, 14, 14, 28, 4, 14, 30, 4, 26, 1]),
    ],
)
def test_channels_of_algorithm_1(hop: int, used: tuple[int, ...], channels: list[int]) -> None:
    assert [channel_1(ChannelMap(used), hop, event) for event in range(len(channels))] == channels


@pytest.mark.parametrize("used", MAPS)
@pytest.mark.parametrize("hop", HOP_INCREMENTS)
def test_algorithm_1_is_the_walk_that_the_specification_tells(hop: int, used: tuple[int, ...]) -> None:
    last, walk = 0, []
    for _ in range(100):
        last = (last + hop) % 37
        walk.append(last if last in used else used[last % len(used)])
    assert [channel_1(ChannelMap(used), hop, event) for event in range(100)] == walk


@pytest.mark.parametrize("hop", HOP_INCREMENTS)
def test_any_hop_is_a_cycle_of_all_channels(hop: int) -> None:
    for first in (0, 12, 65_530):  # the event counter has 16 bits, the cycle has not
        cycle = [channel_1(ALL_CHANNELS, hop, event) for event in range(first, first + 38)]
        assert sorted(cycle[:37]) == list(range(37))
        assert cycle[37] == cycle[0]


# ---------------------------------------------------------------- algorithm 2

SAMPLES = [  # the specification's sample data (v5.3, Part C, section 3), as NimBLE's ble_ll_csa2_test.c has them
    (tuple(range(37)), 0, 56857, [25, 1, 16, 36]),
    (tuple(range(37)), 1, 1685, [20, 36, 12, 34]),
    (tuple(range(37)), 2, 38301, [6, 18, 32, 21]),
    (tuple(range(37)), 3, 27475, [21, 4, 22, 8]),
    (NINE, 6, 10975, [23, 35, 21, 36]),
    (NINE, 7, 5490, [9, 22, 36, 33]),
    (NINE, 8, 46970, [34, 9, 33, 10]),
]


@pytest.mark.parametrize(("used", "event", "number", "channels"), SAMPLES)
def test_sample_data_of_algorithm_2(used: tuple[int, ...], event: int, number: int, channels: list[int]) -> None:
    assert KEY == 0x305F
    assert event_number(KEY, event) == number
    assert channel_2(ChannelMap(used), KEY, event) == channels[0]
    for count in range(1, 5):
        assert subevent_channels(ChannelMap(used), KEY, event, count) == channels[:count]


@pytest.mark.parametrize("key", [0, KEY, 0xFFFF, 0x8001])
def test_the_numbers_of_65536_events_are_a_permutation(key: int) -> None:
    assert {event_number(key, counter) for counter in range(1 << 16)} == set(range(1 << 16))
    assert event_number(key, 1 << 16) == event_number(key, 0)


@pytest.mark.slow
@pytest.mark.parametrize("key", [0, KEY])
def test_algorithm_2_uses_all_37_channels_equally(key: int) -> None:
    times = Counter(channel_2(ALL_CHANNELS, key, counter) for counter in range(1 << 16))
    # 65536 = 37 * 1771 + 9
    assert Counter(times.values()) == {1772: 9, 1771: 28}
    assert len(times) == DATA_CHANNELS


@pytest.mark.slow
@pytest.mark.parametrize("used", MAPS[1:])
def test_algorithm_2_uses_the_channels_of_a_map_nearly_equally(used: tuple[int, ...]) -> None:
    times = Counter(channel_2(ChannelMap(used), KEY, counter) for counter in range(1 << 16))
    assert set(times) == set(used)
    # A used channel has its own numbers, 1771 or 1772, and the unused ones of a run of consecutive numbers; a run has
    # as many of these as another, but for the part of a period of 37 with which it ends.
    unused = 65536 - sum(1771 + (channel < 9) for channel in used)
    for channel in used:
        assert times[channel] == pytest.approx(1771 + unused / len(used), abs=1 + 37)


@pytest.mark.parametrize("used", MAPS)
def test_subevents_stay_in_the_map_and_next_ones_are_apart(used: tuple[int, ...]) -> None:
    size = len(used)
    apart = max(1, min(3, size - 5), min(11, (size - 10) // 2))
    seen, distances = set(), set()
    for counter in range(500):
        places = [used.index(channel) for channel in subevent_channels(ChannelMap(used), KEY, counter, 5)]
        assert used[places[0]] == channel_2(ChannelMap(used), KEY, counter)
        for one, other in pairwise(places):
            distances.add(min((one - other) % size, (other - one) % size))
            seen.add(other)
    assert seen == set(range(size))
    assert min(distances) == apart
