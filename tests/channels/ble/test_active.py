"""Active scanning: who inquires asks for names, not too often, and who advertises leaves the time for that."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

import pytest

from cosim.channels.energy import RECEIVE, TRANSMIT
from cosim.machine import Discovered, Inquire, InquiryComplete, Scan
from cosim.trace import TRANSMISSIONS
from cosim.units import US, S, Time
from tests.channels.ble.ble_field import Field

T_IFS = 150 * US
WITHOUT_PAUSE = {"active": True, "interval_s": 0.1, "window_s": 0.1}
Row = tuple[Time, int, int, str, Time]


def scanned(scanners: Sequence[int], size: int, duration: Time, **settings: Any) -> Field:
    """Return devices of which *scanners* look for the others from 5 s on, and do not advertise."""
    field = Field(size, tables=[TRANSMISSIONS], **{"scan": WITHOUT_PAUSE} | settings)
    for address in scanners:
        field.do(address, Scan(False))
    field.until(5 * S)
    for address in scanners:
        field.do(address, Inquire(duration, 99))
    field.until(5 * S + duration + 1)
    return field


def rows(field: Field) -> list[Row]:
    """Return start, source, destination, kind and duration of all packets that tables have, in order."""
    told = field.trace.columns(TRANSMISSIONS.name)
    names = "time_ns", "source", "destination", "kind", "duration_ns"
    return sorted(zip(*(told[name] for name in names), strict=True))


def test_a_name_is_asked_for_and_said_after_the_interframe_space() -> None:
    field = scanned([0], 2, 2 * S)
    (found,) = field.of(0, Discovered)
    advertisement, request, response = rows(field)
    assert [row[1:] for row in (advertisement, request, response)] == [
        (1, -1, "ADV_IND", (8 + 32 + 16 + 8 * (6 + 3) + 24) * US),  # flags, and no name
        (0, 1, "SCAN_REQ", (8 + 32 + 16 + 8 * 12 + 24) * US),
        (1, 0, "SCAN_RSP", (8 + 32 + 16 + 8 * (6 + 2 + 7) + 24) * US),  # "robot 1"
    ]
    ends = [row[0] + row[4] for row in (advertisement, request, response)]
    assert [request[0], response[0], found.time] == [ends[0] + T_IFS, ends[1] + T_IFS, ends[2]]


def test_an_answer_is_over_before_the_next_packet_of_the_event() -> None:
    field = scanned([0], 2, 2 * S, clock_ppm=500)
    advertiser = field.channel.devices[1].station.beacon.advertiser
    assert advertiser is not None
    exchange = sum(row[4] for row in rows(field)) + 2 * T_IFS
    assert exchange < advertiser.start(advertiser.event_from(6 * S), 1) - advertiser.start(
        advertiser.event_from(6 * S), 0
    )


def test_an_advertisement_that_several_hear_is_in_tables_once() -> None:
    for active in (False, True):
        field = scanned([0, 1, 2], 4, S, scan=WITHOUT_PAUSE | {"active": active})
        told = [row for row in rows(field) if row[3] == "ADV_IND"]
        assert told
        assert len(set(told)) == len(told)


@pytest.mark.parametrize("seed", range(4))
def test_scanners_that_ask_at_once_get_out_of_each_others_way(seed: int) -> None:
    field = Field(12, seed, [TRANSMISSIONS], scan=WITHOUT_PAUSE)
    scanners = range(4)
    for address in scanners:
        field.do(address, Scan(False), Inquire(20 * S, 99))
    field.until(21 * S)
    told = Counter(row[3] for row in rows(field))
    assert all(set(each.what.found) == set(range(4, 12)) for each in _complete(field))
    assert told["SCAN_REQ"] > told["SCAN_RSP"] >= 4 * 8  # some have met


def _complete(field: Field) -> list[Any]:
    return [field.of(address, InquiryComplete)[0] for address in range(4)]


def test_where_nothing_collides_the_lowest_of_those_who_ask_at_once_is_answered() -> None:
    field = scanned([0, 1, 2], 4, 10 * S, interference="none")
    asked: dict[Time, list[int]] = {}
    for row in rows(field):
        if row[3] == "SCAN_REQ":
            asked.setdefault(row[0] + row[4] + T_IFS, []).append(row[1])
    assert max(len(scanners) for scanners in asked.values()) > 1
    answered = {row[0]: row[2] for row in rows(field) if row[3] == "SCAN_RSP"}
    assert answered == {at: min(scanners) for at, scanners in asked.items()}
    assert sorted(answered.values()) == [0, 1, 2]


def test_asking_takes_time_of_both_radios() -> None:
    quiet = scanned([0], 2, 2 * S, scan=WITHOUT_PAUSE | {"active": False}, energy="states")
    asked = scanned([0], 2, 2 * S, energy="states")
    request, response = 176 * US, 200 * US
    assert _state(asked, 0, TRANSMIT) - _state(quiet, 0, TRANSMIT) == request
    name = 8 * (2 + 7) * US  # in each of the advertisements, or not
    packets = _state(quiet, 1, TRANSMIT) // (224 * US)
    assert _state(quiet, 1, TRANSMIT) == packets * 224 * US
    assert _state(asked, 1, TRANSMIT) == packets * (224 * US - name) + response
    listened = T_IFS + 40 * US
    assert _state(quiet, 1, RECEIVE) == packets * listened
    assert _state(asked, 1, RECEIVE) == packets * listened + (request - 40 * US) + T_IFS
    assert _state(asked, 0, RECEIVE) == T_IFS + T_IFS + response


def _state(field: Field, address: int, wanted: str) -> Time:
    assert field.channel.accounts is not None
    uses = field.channel.accounts.uses(address, field.kernel.now)
    return sum(time for use, time in uses.items() if use.state == wanted)


def test_an_answer_that_comes_after_the_inquiry_counts_for_nothing() -> None:
    field = scanned([0], 2, 2 * S)
    (found,) = field.of(0, Discovered)
    again = Field(2, tables=[TRANSMISSIONS], scan=WITHOUT_PAUSE)
    again.do(0, Scan(False))
    again.until(5 * S)
    again.do(0, Inquire(found.time - 5 * S - 100 * US, 99))
    again.until(8 * S)
    assert [each.what for each in again.of(0, InquiryComplete)] == [InquiryComplete(())]
    assert not again.of(0, Discovered)
    assert [row[3] for row in rows(again)] == ["ADV_IND", "SCAN_REQ", "SCAN_RSP"]
    again.do(0, Inquire(2 * S, 99))
    again.until(12 * S)
    assert len(again.of(0, Discovered)) == 1
