"""The hop kernel against the specification's sample data (tests/data/bluetooth_hop_vectors.txt) and its properties."""

import re

import numpy as np
import pytest

from cosim.channels.bluetooth import hopping
from cosim.channels.bluetooth.hopping import (
    CHANNELS,
    GIAC,
    KOFFSET,
    adapted_channel,
    basic_channel,
    inquiry_channel,
    inquiry_response_channel,
    inquiry_scan_channel,
    master_response_channel,
    page_channel,
    page_scan_channel,
    scan_phase,
    slave_response_channel,
    train_phase,
)
from tests.checkout import DATA

WRAP = 1 << 28
ADDRESSES = [0, GIAC, 0x2A96EF25, 0x6587CBA9, 0xFFFFFFFF]


def read_substates():
    """Return {(address, table): [(first clock, channels)]}: table is the first word of its comment line."""
    tables, address, table = {}, None, None
    text = (DATA / "bluetooth_hop_vectors.txt").read_text()
    for line in text.split("=== SECTION B")[0].splitlines():
        if match := re.match(r"## UAP/LAP = (0x[0-9a-f]+)", line):
            address = int(match[1], 16)
        elif match := re.match(r"# (PAGE SCAN|PAGE STATE|SLAVE|MASTER)", line):
            table = match[1]
        elif match := re.match(r"(0x[0-9a-f]{7}): ([0-9 ]+)$", line):
            row = (int(match[1], 16), [int(channel) for channel in match[2].split()])
            tables.setdefault((address, table), []).append(row)
    return tables


def read_connection():
    """Return [(address, used channels or None, first clock, channels)]."""
    rows, address, used = [], None, None
    text = (DATA / "bluetooth_hop_vectors.txt").read_text()
    for line in text.split("=== SECTION B")[1].splitlines():
        if match := re.match(r"UAP/LAP (0x[0-9a-f]+)  (?:BASIC|ADAPTED used-channels (0x[0-9a-f]+))", line):
            address, mask = int(match[1], 16), int(match[2] or "0", 16)
            used = [channel for channel in range(CHANNELS) if mask >> channel & 1] or None
        elif match := re.match(r"\s+(0x[0-9a-f]+)\.\.0x[0-9a-f]+\s*: ([0-9 ]+)$", line):
            rows.append((address, used, int(match[1], 16), [int(channel) for channel in match[2].split()]))
    return rows


SUBSTATES = read_substates()


def rows(table):
    return [
        pytest.param(address, clock, channels, id=f"{address:#x}-{clock:#x}")
        for (address, name), tables in SUBSTATES.items()
        if name == table
        for clock, channels in tables
    ]


def test_every_row_of_the_file_is_read():
    assert {key: len(tables) for key, tables in SUBSTATES.items()} == {
        (address, table): count
        for address in (0, 0x2A96EF25)
        for table, count in (("PAGE SCAN", 8), ("PAGE STATE", 8), ("SLAVE", 2), ("MASTER", 2))
    }
    assert len(read_connection()) == 20


@pytest.mark.parametrize(("address", "clock", "channels"), rows("PAGE SCAN"))
def test_scan_channels(address, clock, channels):
    clocks = [clock + 0x1000 * i for i in range(8)]
    assert [page_scan_channel(address, clkn) for clkn in clocks] == channels
    assert [inquiry_scan_channel(clkn, address=address) for clkn in clocks] == channels
    assert [inquiry_scan_channel(clkn - 0x3000, 3, address) for clkn in clocks] == channels


@pytest.mark.parametrize(("address", "clock", "channels"), rows("PAGE STATE"))
def test_page_and_inquiry_channels(address, clock, channels):
    train = "B" if clock & 0x1000 else "A"
    assert [page_channel(address, clock + i, train) for i in range(16)] == channels
    assert [inquiry_channel(clock + i, train, address) for i in range(16)] == channels


@pytest.mark.parametrize(("address", "clock", "channels"), rows("SLAVE"))
def test_slave_response_channels(address, clock, channels):
    clocks = range(clock, clock + 2 * len(channels), 2)
    assert [slave_response_channel(address, 0x10, clkn) for clkn in clocks] == channels


@pytest.mark.parametrize(("address", "clock", "channels"), rows("MASTER"))
def test_master_response_channels(address, clock, channels):
    clocks = range(clock, clock + 2 * len(channels), 2)
    assert [master_response_channel(address, 0x12, clke, 24) for clke in clocks] == channels


@pytest.mark.parametrize(("address", "used", "clock", "channels"), read_connection())
def test_connection_channels(address, used, clock, channels):
    clocks = range(clock, clock + 32, 2)
    if used is None:
        assert [basic_channel(address, clk) for clk in clocks] == channels
    else:
        assert [adapted_channel(address, clk, used) for clk in clocks] == channels
        assert [adapted_channel(address, clk, used[::-1]) for clk in clocks] == channels


@pytest.mark.parametrize("address", ADDRESSES)
@pytest.mark.parametrize("block", [0, 0x5000, 0x1F000, WRAP - 0x1000])
def test_the_trains_of_a_block_are_disjoint_and_make_up_the_scan_channels(address, block):
    clocks = range(block, block + 32)
    sent = {train: [page_channel(address, clke, train) for clke in clocks if not clke & 2] for train in KOFFSET}
    assert all(len(set(channels)) == 16 for channels in sent.values())
    scanned = {page_scan_channel(address, step << 12) for step in range(32)}
    assert len(scanned) == 32
    assert set(sent["A"]) | set(sent["B"]) == scanned
    assert page_scan_channel(address, block) in sent["A"]
    answers = {page_channel(address, clke, train) for clke in clocks if clke & 2 for train in KOFFSET}
    assert not answers & scanned


@pytest.mark.parametrize("address", ADDRESSES)
def test_pager_and_scanner_are_on_one_channel_exactly_when_their_phases_are_equal(address):
    rng = np.random.default_rng(1)
    clke, clkn = rng.integers(WRAP, size=(2, 4000)) & ~2
    for train in KOFFSET:
        same_phase = train_phase(clke, train) == scan_phase(clkn)
        assert (same_phase == (page_channel(address, clke, train) == page_scan_channel(address, clkn))).all()
        assert 60 < same_phase.sum() < 200


def test_a_scan_channel_holds_for_4096_ticks_and_comes_back_after_32_of_them():
    phases = scan_phase(np.arange(0, 33 * 4096, 1024))
    assert (phases == np.arange(33 * 4) // 4 % 32).all()


@pytest.mark.parametrize("address", ADDRESSES)
def test_arrays_give_what_single_clocks_give_and_only_28_bits_of_a_clock_are_read(address):
    rng = np.random.default_rng(2)
    clocks = np.concatenate([rng.integers(WRAP, size=200), [0, 1, 2, 3, WRAP - 1, WRAP - 2]])
    frozen = int(rng.integers(WRAP))
    functions = [
        lambda clk: page_scan_channel(address, clk),
        lambda clk: page_channel(address, clk, "A"),
        lambda clk: page_channel(address, clk, "B"),
        lambda clk: inquiry_scan_channel(clk, 5, address),
        lambda clk: inquiry_channel(clk, "B", address),
        lambda clk: inquiry_response_channel(clk, 7, address),
        lambda clk: slave_response_channel(address, frozen, clk),
        lambda clk: master_response_channel(address, frozen, clk, 8),
        lambda clk: basic_channel(address, clk),
        lambda clk: adapted_channel(address, clk, range(20, 50)),
    ]
    for function in functions:
        single = [function(int(clk)) for clk in clocks]
        assert all(type(channel) is int and 0 <= channel < CHANNELS for channel in single)
        assert type(function(clocks[0])) is int
        assert function(clocks).tolist() == single
        assert function(clocks.astype(np.uint32)).tolist() == single
        assert function(clocks + 5 * WRAP).tolist() == single
        assert function(int(clocks[0]) + (1 << 40)) == single[0]
        assert function(clocks.reshape(2, -1)).ravel().tolist() == single


def test_the_giac_is_the_default_and_responses_leave_the_scan_channels():
    scanned = {inquiry_scan_channel(step << 12) for step in range(32)}
    assert scanned == {page_scan_channel(0x9E8B33, step << 12) for step in range(32)}
    assert not scanned & {inquiry_response_channel(step << 12) for step in range(32)}


def test_the_basic_sequence_visits_all_channels_evenly():
    counts = np.bincount(basic_channel(0x6587CBA9, np.arange(0, 1 << 22, 2)), minlength=CHANNELS)
    assert counts.min() > 0.98 * counts.mean()
    assert counts.max() < 1.02 * counts.mean()


def test_an_adapted_sequence_stays_on_the_used_channels_and_keeps_the_channel_for_the_answer():
    used = [3, 4, 8, 15, 16, 23, 42]
    clocks = np.arange(0, 40000, 2)
    channels = adapted_channel(0x6587CBA9, clocks, used)
    assert set(channels.tolist()) == set(used)
    assert (channels[::2] == channels[1::2]).all()


@pytest.mark.parametrize("used", [[], [79], [-1, 3]])
def test_an_impossible_set_of_used_channels_is_refused(used):
    with pytest.raises(ValueError, match="used channels"):
        adapted_channel(0, 0, used)


def test_the_exchanges_form_a_permutation_for_every_control_word():
    images = {tuple(sorted(hopping._permuted(z, control, 5) for z in range(32))) for control in range(0, 1 << 14, 7)}
    assert images == {tuple(range(32))}
