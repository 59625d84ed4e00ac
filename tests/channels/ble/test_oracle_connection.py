"""A connection equals the oracle that counts every event: packets, what arrives, acknowledgements, losses."""

from collections.abc import Iterator
from dataclasses import replace

import pytest

from cosim.channels.ble.bits import control
from cosim.channels.ble.bits.pdu import CLOCK_ACCURACIES_PPM, LLData, Llid
from cosim.channels.ble.connections.anchors import Anchors
from cosim.channels.ble.connections.arq import Fragment
from cosim.channels.ble.connections.channel_map import ChannelMap
from cosim.channels.ble.connections.exchange import Reception, Side
from cosim.channels.ble.connections.link import Link, LinkEnd
from cosim.channels.ble.connections.parameters import ConnectionParameters, TransmitWindow
from cosim.channels.ble.phy import PHYS
from cosim.channels.clock import NativeClock
from tests.oracles.campaign import Choice, Seeded, chance, pick
from tests.oracles.le_connection import BAD, HEARD, MISSED, US, Bye, Case, Input, Map, Model, Put, Result, Sent, Update
from tests.tiers import soak_count

UNIT = 1_250 * US
MS = 1_000 * US
AFTER = 40_000 * MS
"""How long silence lasts at the end of a run."""


# ---------------------------------------------------------------- drawing cases


def draw_parameters(choice: Choice) -> tuple[int, int, int]:
    """Draw interval, latency and supervision timeout."""
    interval = UNIT * pick(choice, (6, 6, 7, choice.integer(6, 40), choice.integer(6, 400)))
    latency = pick(choice, (0, 0, 1, choice.integer(0, 10)))
    least = 2 * (1 + latency) * interval // (10 * MS) + 1
    tens = 3_200 if chance(choice, 10) else pick(choice, (least, least + 1, choice.integer(least, least + 100)))
    return interval, latency, 10 * MS * max(10, tens)


def draw_window(choice: Choice, interval: int) -> tuple[int, int]:
    """Draw size and offset of a transmit window."""
    size = UNIT * pick(choice, (1, min(8, interval // UNIT - 1)))
    return size, UNIT * pick(choice, (0, interval // UNIT, choice.integer(0, interval // UNIT)))


def draw_map(choice: Choice) -> tuple[int, ...]:
    if chance(choice, 3):
        return tuple(range(37))
    used = {choice.integer(0, 36) for _ in range(choice.integer(1, 12))}
    return tuple(sorted(used | {36, choice.integer(0, 35)}))


def draw_inputs(choice: Choice, events: int) -> Iterator[Input]:
    longest = pick(choice, (27, 251))
    for _ in range(choice.integer(0, 12)):
        yield Put(choice.integer(0, events), choice.integer(0, 1), pick(choice, (1, 27, longest)))
    for _ in range(pick(choice, (0, 0, 1, 2))):
        yield Map(choice.integer(0, events // 2), draw_map(choice))
    if chance(choice, 3):
        interval, latency, timeout = draw_parameters(choice)
        size, offset = draw_window(choice, interval)
        yield Update(choice.integer(0, events // 2), size, offset, interval, latency, timeout)
    if chance(choice, 6):
        yield Bye(choice.integer(0, events), choice.integer(0, 1))


def draw_case(choice: Choice) -> Case:
    """Draw a case, often with drift at what the clocks promise, windows that touch, and counters that wrap."""
    interval, latency, timeout = draw_parameters(choice)
    size, offset = draw_window(choice, interval)
    sca = choice.integer(0, 7)
    most = CLOCK_ACCURACIES_PPM[sca]
    drift = pick(choice, (most, -most, choice.integer(-most, most), 4 * most))
    other = pick(choice, (250, -250, choice.integer(-250, 250), -2_000 if chance(choice, 3) else 0))
    events = choice.integer(1, 60)
    luck = pick(choice, ((HEARD,), (HEARD,) * 8 + (BAD,), (HEARD,) * 6 + (MISSED, BAD), (HEARD, MISSED, BAD)))
    quiet = (MISSED,) * pick(choice, (0, 0, choice.integer(1, 60)))
    phy = pick(choice, tuple(PHYS))
    return Case(
        *(interval, latency, timeout, size, offset),
        start=pick(choice, (0, size, choice.integer(0, size))),
        created=choice.integer(0, 1_000 * MS),
        clocks=((choice.integer(0, 1_000 * MS), drift), (choice.integer(0, 1_000 * MS), other)),
        ppm=most + 250,
        address=choice.integer(0, (1 << 32) - 1),
        hop=choice.integer(5, 16),
        algorithm_2=chance(choice, 2),
        used=draw_map(choice),
        phy=phy,
        first=pick(choice, (0, 0, 65_536 - choice.integer(0, 30))),
        events=events,
        limits=draw_limits(choice, interval, phy),
        receptions=(*(pick(choice, luck) for _ in range(choice.integer(1, 100))), *quiet),
        inputs=tuple(sorted(draw_inputs(choice, events), key=lambda wish: wish.before)),
    )


def draw_limits(choice: Choice, interval: int, phy: str) -> tuple[int, ...]:
    """Draw limits of events: an interval, or what some exchanges need, to the ns."""
    air = PHYS[phy].air_time
    exact = [sum(air(pick(choice, (0, 1, 27, 251))) + 150 * US for _ in range(2 * n)) for n in range(1, 4)]
    others = (exact[choice.integer(0, 2)] + choice.integer(-1, 1), choice.integer(0, interval))
    return pick(choice, ((interval,), tuple(min(interval, limit) for limit in others)))


# ---------------------------------------------------------------- the fast one


def link_of(case: Case) -> Link:
    sca = next(code for code, ppm in enumerate(CLOCK_ACCURACIES_PPM) if ppm == case.ppm - 250)
    ll_data = LLData(
        case.address, 0x555555, case.size, case.offset, case.interval, case.latency, case.timeout,
        ChannelMap(case.used), case.hop, sca,
    )  # fmt: skip
    clocks = tuple(NativeClock(*clock) for clock in case.clocks)
    link = Link(ll_data, case.created, clocks, 250, PHYS[case.phy], case.algorithm_2, start=case.start)
    link.event = case.first  # as if it had lasted for long
    link.anchors = Anchors(case.first, link.anchors.local, case.interval)
    link.expected = replace(link.expected, event=case.first)
    return link


def hand_in(link: Link, wish: Input, numbers: list[int]) -> None:
    if isinstance(wish, Put):
        number = numbers[wish.side]
        payload = number.to_bytes(1) * wish.octets
        link.ends[wish.side].arq.push(Fragment(Llid.START, payload, number))
        numbers[wish.side] += 1
    elif isinstance(wish, Map):
        link.announce(lambda instant: control.ChannelMapInd(ChannelMap(wish.used), instant))
    elif isinstance(wish, Update):
        parameters = ConnectionParameters(wish.interval, wish.latency, wish.timeout)
        window = TransmitWindow(wish.size, wish.offset)
        link.announce(lambda instant: control.ConnectionUpdateInd(window, parameters, instant))
    else:
        link.terminate(Side(wish.side))


def run_link(case: Case) -> Result:
    link, numbers, anchor = link_of(case), [0, 0], 0
    result = Result([], [], [], (None, None))
    for count in range(case.events):
        for wish in case.inputs:
            if wish.before == count:
                hand_in(link, wish, numbers)
        anchor = link.anchor
        link.advance(anchor)
        if link.central.loss is not None:
            break
        run_one(link, case, anchor + case.limits[count % len(case.limits)], result)
    link.advance(anchor + AFTER)
    return result._replace(losses=tuple(loss_of(end) for end in link.ends))


def run_one(link: Link, case: Case, until: int, result: Result) -> None:
    event = link.begin(until)
    while (packet := event.packet) is not None:
        reception = case.receptions[len(result.packets) % len(case.receptions)]
        channel = link.channel(Side.CENTRAL, link.event)
        anchored = event.anchored
        heard = link.ended(Reception(reception))
        if packet.sender is Side.CENTRAL and not anchored and not event.anchored:
            reception = MISSED
        pdu = packet.pdu
        result.packets.append(
            Sent(
                link.event, channel, packet.start, packet.air, packet.sender, pdu.llid, pdu.nesn, pdu.sn, pdu.more,
                len(pdu.payload), reception,
            )
        )  # fmt: skip
        if heard.new is not None and heard.new.llid is not Llid.CONTROL:
            result.delivered.append((1 - packet.sender, heard.new.payload[0], packet.end))
        if heard.acknowledged is not None and heard.acknowledged.llid is not Llid.CONTROL:
            result.acknowledged.append((1 - packet.sender, heard.acknowledged.token, packet.end))
    link.finish()


def loss_of(end: LinkEnd) -> tuple[str, int] | None:
    return None if end.loss is None else (str(end.loss), end.lost_at)


# ---------------------------------------------------------------- the comparison


def compare(seed: int) -> Result:
    case = draw_case(Seeded(seed))
    fast, slow = run_link(case), Model(case).run()
    assert fast == slow, case
    return fast


@pytest.mark.slow
@pytest.mark.parametrize("block", range(10))
def test_a_connection_equals_the_oracle_event_for_event(block: int):
    for seed in range(40 * block, 40 * block + 40):
        compare(seed)


@pytest.mark.soak
def test_a_connection_equals_the_oracle_in_a_long_campaign():
    for seed in range(soak_count(100_000)):
        compare(10_000 + seed)
