"""The section of a frame that was lost: of Bluetooth by its packets, of Low Energy by the PHY, of others the whole."""

import json
from pathlib import Path
from typing import Any, Final

import pytest

from cosim.channels.ble.phy import PHYS
from cosim.channels.radios import with_radio
from cosim.present import Present
from cosim.timeline.growing import Growing
from cosim.timeline.index import opened
from cosim.timeline.sections import Section, of_low_energy
from cosim.trace import FRAMES, TABLES, Trace
from cosim.units import US

HEADERS: Final = {
    "1M": (8 + 32 + 16) * US,  # preamble, access address and header of the PDU, a bit a microsecond
    "2M": (16 + 32 + 16) * US // 2,
    "Coded S=8": (80 + 256 + 16 + 24 + 16 * 8) * US,  # with coding indicator and TERM1
    "Coded S=2": (80 + 256 + 16 + 24 + 16 * 2) * US,
}
ADDRESS, ADI, AUX, PIECE = 6, 2, 3, 4
EXTENDED: Final = 2  # its length with the mode, and its flags


def packets() -> list[tuple[str, str, int, int]]:
    """Return (PHY, kind, octets of the payload of the PDU, octets of users) of packets that a device may send."""
    found = [("1M", kind, octets, 0) for kind, octets in (("ADV_IND", 18), ("ADV_EXT_IND", 7), ("CONNECT_IND", 34))]
    found += [("1M", "ADV_NONCONN_IND", ADDRESS + PIECE + octets, octets) for octets in range(28)]
    found += [("1M", "ADV_NONCONN_IND", ADDRESS + 2 + 29, octets) for octets in range(13)]  # segments of a mesh
    for phy in PHYS:
        found.append((phy, "EMPTY", 0, 0))
        found += [(phy, "DATA", octets, octets) for octets in range(1, 252)]
        found += [(phy, "CONTROL", octets, 0) for octets in (2, 3, 5, 8, 9, 12)]  # as long as there are any
        for octets in range(239):
            if octets + EXTENDED + ADDRESS + ADI + AUX + PIECE <= 255:
                found.append((phy, "AUX_ADV_IND", octets + EXTENDED + ADDRESS + ADI + AUX + PIECE, octets))
            found.append((phy, "AUX_ADV_IND", octets + EXTENDED + ADDRESS + ADI + PIECE, octets))
            found.append((phy, "AUX_CHAIN_IND", octets + EXTENDED + ADI + AUX + PIECE, octets))
            found.append((phy, "AUX_CHAIN_IND", octets + EXTENDED + ADI + PIECE, octets))
    return found


def test_the_header_of_low_energy_ends_where_its_phy_says() -> None:
    for phy, kind, octets, of_users in packets():
        duration = PHYS[phy].air_time(octets)
        assert of_low_energy("header", kind, duration, of_users) == (0, HEADERS[phy]), (phy, kind, octets)
        assert of_low_energy("payload", kind, duration, of_users) == (HEADERS[phy], None)


def test_what_is_on_no_phy_is_lost_as_a_whole() -> None:
    assert of_low_energy("header", "DATA", 1, 5) == Section(0, None)


SENT: Final = (
    # duration, kind, octets, outcome, part, radio: radio 0 is of Low Energy, 1 of Bluetooth, 2 of 802.11
    (240 * US, "DATA", 20, "collided", "header", 0),
    (240 * US, "DATA", 20, "bit_errors", "payload", 0),
    (124 * US, "DATA", 20, "collided", "header", 0),
    (240 * US, "DATA", 20, "not_tuned", "", 0),
    (366 * US, "DM1", 17, "collided", "access_code", 1),
    (366 * US, "DM1", 17, "collided", "header", 1),
    (366 * US, "DM1", 17, "bit_errors", "payload", 1),
    (300 * US, "DATA", 20, "collided", "", 2),
)
LOST: Final = [
    ("collided", "header", [0, 56_000]),
    ("bit_errors", "payload", [56_000, None]),
    ("collided", "header", [0, 32_000]),
    ("not_tuned", "", [0, None]),
    ("collided", "access_code", [0, 72_000]),
    ("collided", "header", [72_000, 126_000]),
    ("bit_errors", "payload", [126_000, None]),
    ("collided", "", [0, None]),
]
CHANNEL: Final = {"kind": "radios", "radios": [{"kind": "ble"}, {"kind": "bluetooth"}, {"kind": "adhoc"}]}


def rows() -> list[tuple[Any, ...]]:
    return [
        (1000 * at, 0, 1, duration, kind, 3, 0, length, outcome, part, radio)
        for at, (duration, kind, length, outcome, part, radio) in enumerate(SENT)
    ]


def told(lanes: Any, codes: Any) -> list[tuple[str, str, list[int | None]]]:
    """Return outcome, part and section of the frames at their receiver, as pages are told them."""
    outcomes = codes.plain["outcomes"]
    boxes = [
        (start, outcomes[outcome])
        for lane in lanes
        if lane.named.what == "received"
        for start, outcome in zip(lane.boxes.starts.tolist(), lane.boxes.outcomes.tolist(), strict=True)
    ]
    in_order = sorted(boxes, key=lambda box: box[0])
    return [(outcome["name"], outcome["part"], outcome["lost_ns"]) for _, outcome in in_order]


def test_pages_are_told_which_section_of_a_frame_was_lost(tmp_path: Path) -> None:
    tables = with_radio([FRAMES])
    trace = Trace(tables)
    for row in rows():
        trace.row(trace.tables["frames"], *row)
    trace.write(tmp_path, {"scenario": json.dumps({"channel": CHANNEL})})
    for _ in range(2):  # made, then mapped
        index = opened(tmp_path)
        assert told(index.lanes, index.codes) == LOST
    growing = Growing(tables, low_energy={0})
    growing.take({"frames": rows()}, Present(10_000))
    assert told(growing.lanes, growing.codes) == LOST


@pytest.mark.parametrize("scenario", ["", "[]", '{"channel": 3}', '{"channel": {"kind": "radios"}}'])
def test_a_run_whose_radios_are_not_known_is_taken_for_one_of_others(tmp_path: Path, scenario: str) -> None:
    trace = Trace([TABLES["frames"]])
    trace.row(TABLES["frames"], *rows()[0][:-1])
    trace.write(tmp_path, {"scenario": scenario})
    index = opened(tmp_path)
    assert told(index.lanes, index.codes) == [("collided", "header", [72_000, 126_000])]
