"""Connection events: how much they hold, how they end; the acknowledgement scheme under losses."""

from math import sqrt

import pytest

from cosim.channels.ble.bits.l2cap import MOST_OCTETS, MOST_TIME, MOST_TIME_CODED, Message, fragments, longest_payload
from cosim.channels.ble.bits.pdu import DataPdu, Llid
from cosim.channels.ble.connections.arq import RECEIVED, Arq, Fragment, Heard
from cosim.channels.ble.connections.exchange import ConnectionEvent, Packet, Reception, Side, exchange_time, run_event
from cosim.channels.ble.phy import CODED_S2, CODED_S8, LE_1M, LE_2M, PHYS, Phy
from cosim.errors import LocalProtocolError
from tests.oracles.campaign import Seeded

US, MS = 1_000, 1_000_000
HEARD, MISSED, BAD = Reception.HEARD, Reception.MISSED, Reception.BAD_CRC

EXCHANGES_US = {
    "1M": {27: 676, 251: 2_468},
    "2M": {27: 496, 251: 1_392},
    "Coded S=2": {27: 1_656, 251: 5_240},
    "Coded S=8": {27: 3_468, 251: 17_804},
}
"""A packet of n octets, an empty answer and 150 us after each, by the formulas of Vol 6 Part B, 2.

They are 8 (10 + n), 4 (11 + n), 462 + 16 n and 720 + 64 n us.
"""


def data(octets: int, token: object = None) -> Fragment:
    return Fragment(Llid.START, bytes(octets), token)


def always(_: Packet) -> Reception:
    return HEARD


def script(*receptions: Reception):
    """Return what hears packets as *receptions* have it, one after the other, and then all."""
    rest = list(receptions)
    return lambda _: rest.pop(0) if rest else HEARD


def saturated(phy: Phy, octets: int, interval: int, events: int) -> int:
    """Return the octets that a central with any number of full PDUs brings over in *events* events."""
    central, peripheral = Arq(), Arq()
    received = 0
    for number in range(events):
        while len(central.data) < 30_000:
            central.push(data(octets))
        event = ConnectionEvent((central, peripheral), (phy, phy), number * interval, (number + 1) * interval)
        received += sum(len(heard.new.payload) for _, _, heard in run_event(event, always) if heard.new)
    return received


@pytest.mark.parametrize("interval_us", [7_500, 30_000, 400_000])
@pytest.mark.parametrize("octets", [27, 251])
@pytest.mark.parametrize("name", list(PHYS))
def test_a_saturated_link_carries_whole_exchanges_only(name: str, octets: int, interval_us: int):
    exchange_us = EXCHANGES_US[name][octets]
    whole = interval_us // exchange_us
    assert exchange_time(PHYS[name], octets, PHYS[name], 0) == exchange_us * US
    assert interval_us // exchange_us == whole
    assert saturated(PHYS[name], octets, interval_us * US, 3) == 3 * whole * octets


NOTIFICATIONS_US = {
    20: (676, 676, 496, 3_468),
    50: (1_836, 916, 616, 5_388),
    100: (2_696, 1_316, 816, 8_588),
    244: (6_608, 2_468, 1_392, 17_804),
}
"""Time from the start of the first packet of a notification to when the next may start: on 1M with 27 octets, and with
251 octets on 1M, 2M and S = 8 (computed from the same formulas; a header of 4 and one of 3 octets)."""


@pytest.mark.parametrize("octets", list(NOTIFICATIONS_US))
def test_a_notification_takes_as_long_as_its_packets(octets: int):
    columns = ((LE_1M, 27), (LE_1M, 251), (LE_2M, 251), (CODED_S8, 251))
    for (phy, longest), expected_us in zip(columns, NOTIFICATIONS_US[octets], strict=True):
        central = Arq()
        for fragment in fragments(Message(4, bytes(3 + octets)), longest, "it"):
            central.push(fragment)
        packets = run_event(ConnectionEvent((central, Arq()), (phy, phy), 5_000, 10**9), always)
        last, _, heard = packets[-1]
        assert last.end + 150 * US - 5_000 == expected_us * US
        assert heard == Heard(acknowledged=Fragment(heard.acknowledged.llid, heard.acknowledged.payload, "it"))


def test_a_central_serves_as_many_links_as_events_fit():
    polls, short, long = (exchange_time(LE_1M, n, LE_1M, n) for n in (0, 27, 251))
    assert (polls, short, long) == (460 * US, 892 * US, 4_476 * US)
    assert [7_500 * US // event for event in (polls, short, long)] == [16, 8, 1]
    assert [30 * MS // event for event in (polls, short, long)] == [65, 33, 6]


def test_the_longest_payload_fits_into_the_time_with_its_integrity_check():
    assert [longest_payload(phy, MOST_OCTETS, 328 * US) for phy in (LE_1M, LE_2M)] == [27, 67]
    assert [longest_payload(phy, MOST_OCTETS, MOST_TIME) for phy in (LE_1M, LE_2M)] == [251, 251]
    assert [longest_payload(phy, MOST_OCTETS, MOST_TIME_CODED) for phy in (CODED_S2, CODED_S8)] == [251, 251]
    assert longest_payload(CODED_S8, MOST_OCTETS, 5_000 * US) == 62  # 720 + 64 (62 + 4) = 4944
    assert longest_payload(CODED_S8, MOST_OCTETS, 0) == 27
    assert longest_payload(LE_1M, 100, MOST_TIME) == 100


# ---------------------------------------------------------------- how events end


def event_of(central: Arq, peripheral: Arq, until: int = 400 * MS, listening: bool = True) -> ConnectionEvent:
    return ConnectionEvent((central, peripheral), (LE_1M, LE_1M), 0, until, listening)


def loaded(*octets: int) -> Arq:
    end = Arq()
    for number, length in enumerate(octets):
        end.push(data(length, number))
    return end


def course(event: ConnectionEvent, *receptions: Reception) -> list[tuple[int, int, int, int]]:
    """Return start in us, sender, NESN and SN of the packets."""
    packets = [packet for packet, _, _ in run_event(event, script(*receptions))]
    return [(packet.start // US, int(packet.sender), packet.pdu.nesn, packet.pdu.sn) for packet in packets]


def test_with_nothing_to_send_there_is_a_poll_and_an_answer():
    assert course(event_of(Arq(), Arq())) == [(0, 0, 0, 0), (230, 1, 1, 0)]


def test_an_event_goes_on_as_long_as_either_has_more():
    assert len(course(event_of(loaded(1, 1, 1), Arq()))) == 6
    assert len(course(event_of(Arq(), loaded(1, 1, 1)))) == 6
    assert course(event_of(loaded(1), loaded(1))) == [(0, 0, 0, 0), (238, 1, 1, 0)]


def test_a_packet_that_is_not_heard_ends_the_event():
    assert len(course(event_of(loaded(1, 1), Arq()), MISSED)) == 1
    assert len(course(event_of(loaded(1, 1), Arq()), HEARD, MISSED)) == 2
    asleep = event_of(loaded(1, 1), Arq(), listening=False)
    assert len(course(asleep)) == 1
    assert not asleep.anchored


def test_two_wrong_crcs_in_a_row_end_an_event():
    assert len(course(event_of(loaded(1, 1, 1), Arq()), BAD)) == 6 + 2  # one of them is only sent again
    assert len(course(event_of(loaded(1, 1, 1), Arq()), BAD, HEARD, BAD)) == 3
    assert len(course(event_of(loaded(1, 1, 1), Arq()), HEARD, BAD, HEARD, BAD)) == 4
    assert len(course(event_of(loaded(1, 1, 1), Arq()), BAD, BAD, HEARD, HEARD, BAD, BAD)) == 10  # one at either end


def test_a_wrong_crc_anchors_and_is_answered_but_tells_nothing():
    event = event_of(Arq(), Arq())
    assert course(event, BAD) == [(0, 0, 0, 0), (230, 1, 0, 0)]
    assert event.anchored
    assert event.last_heard == [(230 + 80) * US, None]
    assert not event.quiet


def test_after_an_answer_with_a_wrong_crc_a_central_without_more_stops():
    assert len(course(event_of(Arq(), loaded(1, 1)), HEARD, BAD)) == 2
    assert len(course(event_of(Arq(), loaded(1, 1)), HEARD, HEARD, HEARD, BAD)) == 4


@pytest.mark.parametrize(("short", "count"), [(0, 4), (1, 2)])
def test_another_exchange_begins_only_if_it_ends_in_time(short: int, count: int):
    assert len(course(event_of(loaded(27, 27, 27), Arq(), 2 * 676 * US - short))) == count


def test_without_time_for_data_an_empty_packet_keeps_the_connection_alive():
    central = loaded(251)
    assert course(event_of(central, Arq(), 460 * US)) == [(0, 0, 0, 0), (230, 1, 1, 0)]
    assert event_of(central, Arq(), 460 * US - 1).packet is None
    assert [fragment.token for fragment in central.data] == [0]


def test_a_peripheral_that_lacks_time_for_its_data_answers_with_an_empty_packet():
    packets = run_event(event_of(Arq(), loaded(251), 2_468 * US - 1), always)
    assert [len(packet.pdu.payload) for packet, _, _ in packets[:2]] == [0, 0]
    assert packets[1][0].pdu.more
    packets = run_event(event_of(Arq(), loaded(251), 2_468 * US), always)
    assert [len(packet.pdu.payload) for packet, _, _ in packets] == [0, 251]


def test_what_may_have_to_be_sent_again_has_its_room():
    central, peripheral = Arq(), loaded(251)
    course(event_of(central, peripheral))  # the central has its payload, the peripheral does not know
    central.push(data(251))
    packets = run_event(event_of(central, peripheral, 4_475 * US), script(BAD))  # 251 each way take 4476 us
    assert [len(packet.pdu.payload) for packet, _, _ in packets] == [0, 251]


def test_a_packet_that_is_not_on_the_air_cannot_end():
    event = event_of(Arq(), Arq(), 0)
    with pytest.raises(LocalProtocolError, match="no packet is on the air"):
        event.ended(HEARD)


# ---------------------------------------------------------------- acknowledgement


def test_the_table_says_what_the_rules_say():
    assert len(RECEIVED) == 16
    for (own_sn, own_nesn, sn, nesn), row in RECEIVED.items():
        acknowledges, new = nesn != own_sn, sn == own_nesn
        assert row == (acknowledges, new, own_sn ^ acknowledges, own_nesn ^ new)


def test_without_room_what_is_new_comes_again():
    central, peripheral = loaded(5), Arq()
    event = event_of(central, peripheral)
    assert event.ended(HEARD, room=False) == Heard()
    assert event.ended(HEARD) == Heard()
    assert central.sent == data(5, 0)
    assert [heard.new for _, _, heard in run_event(event_of(central, peripheral), always)] == [data(5), None]


def test_a_peer_that_acknowledges_what_was_never_sent_changes_nothing():
    end = Arq()
    assert end.receive(DataPdu(Llid.START, nesn=1, sn=0, payload=bytes(3))) == Heard(new=data(3))
    assert (end.sn, end.nesn) == (0, 1)


def test_control_pdus_go_before_data():
    end = loaded(1)
    end.push(Fragment(Llid.CONTROL, b"\x02\x13"))
    assert end.next().llid is Llid.CONTROL
    assert end.send(end.next()).more


def lossy(seed: int, p: float, q: float, packets: int, wrong: bool) -> tuple[Arq, Arq, int]:
    """Bring *packets* PDUs from central to peripheral; return both, and how many acknowledgements were not heard.

    *p* of the central's packets are not heard, or, if *wrong*, have a wrong CRC; *q* of the answers are either.
    """
    choice, lost = Seeded(seed), 0
    central, peripheral = loaded(), Arq()
    for number in range(packets):
        central.push(Fragment(Llid.START, number.to_bytes(4, "big"), number))
    arrived: list[int] = []
    acknowledged: list[object] = []

    def heard(packet: Packet) -> Reception:
        down = packet.sender is Side.CENTRAL
        if choice.integer(0, 999) >= 1_000 * (p if down else q):
            return HEARD
        if down:
            return BAD if wrong else MISSED
        return (MISSED, BAD)[choice.integer(0, 1)]

    while central.busy:
        for packet, reception, news in run_event(event_of(central, peripheral), heard):
            if news.new:
                arrived.append(int.from_bytes(news.new.payload, "big"))
            if news.acknowledged:
                acknowledged.append(news.acknowledged.token)
            lost += packet.sender is Side.PERIPHERAL and reception is not HEARD
            assert len(acknowledged) <= len(arrived) <= len(acknowledged) + 1
    assert arrived == acknowledged == list(range(packets))
    return central, peripheral, lost


@pytest.mark.slow
@pytest.mark.parametrize(("p", "q"), [(0.1, 0.1), (0.5, 0.0), (0.0, 0.5), (0.3, 0.6), (0.6, 0.3), (0.0, 0.0)])
def test_what_arrives_is_what_was_sent_once_each(p: float, q: float):
    count = 4_000
    central, peripheral, lost = lossy(round(100 * p + q), p, q, count, wrong=False)
    success = (1 - p) * (1 - q)  # of a transmission; their number up to the first success is geometric
    deviation = sqrt(1 - success) / success / sqrt(count)
    assert abs(central.transmissions / count - 1 / success) <= 4 * deviation
    assert peripheral.duplicates == lost


@pytest.mark.slow
@pytest.mark.parametrize(("p", "q"), [(0.3, 0.0), (0.3, 0.6)])
def test_an_answer_to_a_wrong_crc_acknowledges_what_came_before(p: float, q: float):
    """So fewer transmissions are needed than if loss of either cost a repetition; the order is kept all the same."""
    count = 4_000
    central, _, _ = lossy(7, p, q, count, wrong=True)
    assert 1 / (1 - p) * 0.9 < central.transmissions / count
    assert (central.transmissions / count < 0.95 / ((1 - p) * (1 - q))) == (q > 0)
