"""Flow control: a slow line to the host fills the receive buffer, and STOP keeps the other side's payloads back."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from cosim.kernel import WORLD
from cosim.machine import BROADCAST, Disconnect, Outcome, Outgoing
from cosim.units import MS, SLOT, S, Time
from tests.channels.bluetooth.bluetooth_net import Net

UART = 115_200
LONG = 339
"""Bytes of a DH5."""
SCHEDULER = {0: "lazy", 1: "round_robin"}
"""By source: a lazy master lets a slave send once in T_poll only, slower than any line."""


def line(payload: int, bps: int = UART) -> Time:
    """Return the ns that *payload* bytes take to the host."""
    return -(-8 * payload * S // bps)


def pair(**settings: Any) -> Net:
    return Net(2, [(0, 1)], host_bps=UART, **settings)


def burst(net: Net, source: int, count: int, length: int = LONG) -> None:
    for token in range(count):
        net.channel.send(source, Outgoing(1 - source, bytes([token]) * length, token))


def payload_frames(frames: list[dict[str, Any]], kind: str = "DH5") -> list[dict[str, Any]]:
    return [frame for frame in frames if frame["kind"] == kind]


def test_a_payload_reaches_its_host_when_the_line_is_through_with_it_and_with_all_before_it() -> None:
    net = pair()
    burst(net, 0, 4)
    frames = payload_frames(net.run_for(1 * S))
    received = [frame["time_ns"] + frame["duration_ns"] for frame in frames]
    ends = [received[0] + line(LONG)]
    for end in received[1:]:
        ends.append(max(end, ends[-1]) + line(LONG))
    assert [time for time, *_ in net.hosts[1].received] == ends
    assert [data[0] for _, _, data, _ in net.hosts[1].received] == [0, 1, 2, 3]


@pytest.mark.parametrize("source", [0, 1], ids=["down", "up"])
@pytest.mark.parametrize("room", [1, 3])
def test_no_more_payloads_are_on_the_air_than_there_is_room_for_and_none_is_refused_without_losses(
    source: int, room: int
) -> None:
    net = pair(receive_payloads=room, scheduler=SCHEDULER[source])
    burst(net, source, 12)
    frames = payload_frames(net.run_for(2 * S))
    assert [frame["outcome"] for frame in frames] == ["received"] * 12
    taken = [frame["time_ns"] + frame["duration_ns"] for frame in frames]
    through = [time for time, *_ in net.hosts[1 - source].received]
    for time in taken:
        held = sum(begin <= time < end for begin, end in zip(taken, through, strict=True))
        assert held <= room
    assert max(sum(b <= t < e for b, e in zip(taken, through, strict=True)) for t in taken) == room
    assert net.outcomes(source) == [(token, Outcome.DELIVERED) for token in range(12)]


@pytest.mark.parametrize("source", [0, 1], ids=["down", "up"])
def test_a_link_carries_in_the_long_run_what_the_line_behind_it_carries(source: int) -> None:
    net = pair(receive_payloads=4, scheduler=SCHEDULER[source])
    burst(net, source, 200)
    net.run_for(10 * S)
    times = [time for time, *_ in net.hosts[1 - source].received]
    assert len(times) == 200
    # asked every 25 ms or more often, with room for four of 23.5 ms each, the line is never idle
    assert times[-1] - times[0] == 199 * line(LONG)


def test_with_room_for_one_the_master_asks_at_each_poll_and_sends_one_payload_for_every_go() -> None:
    net = pair(receive_payloads=1, t_poll_slots=40)
    burst(net, 0, 5)
    frames = net.run_for(1 * S)
    sent = payload_frames(frames)
    # received 2.87 ms after its start, a payload is through 23.54 ms later: the poll 25 ms after that start hears
    # STOP, the one at 50 ms GO, and the next payload goes in the slot pair after it
    gaps = [after["time_ns"] - before["time_ns"] for before, after in pairwise(sent)]
    assert gaps == [(2 * 40 + 2) * SLOT] * 4


def test_what_is_for_others_overtakes_what_waits_for_a_stopped_slave_but_a_broadcast_does_not() -> None:
    net = Net(3, [(0, 1), (0, 2)], host_bps=UART, receive_payloads=1)
    for token, (to, length) in enumerate([(1, LONG), (1, LONG), (2, 17), (BROADCAST, 17), (2, 17)]):
        net.channel.send(0, Outgoing(to, bytes([token]) * length, token))
    net.run_for(1 * S)
    assert [token for token, _ in net.outcomes(0)] == [0, 2, 1, 3, 4]
    assert [data[0] for _, _, data, _ in net.hosts[2].received] == [2, 3, 4]


def test_a_payload_that_comes_after_an_answer_was_lost_is_refused_and_sent_again() -> None:
    net = Net(2, [(0, 1)], host_bps=UART // 2, receive_payloads=1, t_poll_slots=40)
    burst(net, 0, 2)
    while not net.outcomes(0):
        net.run_for(1 * MS)
    first = next(frame["time_ns"] for frame in net.frames() if frame["kind"] == "DH5")
    # the poll 25 ms after the first payload's start is answered by STOP, which is lost: GO
    silence_answers(net, first + 41 * SLOT)
    net.run_for(1 * S)
    frames = net.frames()
    assert [(frame["time_ns"] - first, frame["outcome"]) for frame in payload_frames(frames)] == [
        (0, "received"),
        (42 * SLOT, "refused"),
        (84 * SLOT, "received"),  # asked again at 82 slots, when the first was through: 2.87 + 47.08 ms
    ]
    assert [data[0] for _, _, data, _ in net.hosts[1].received] == [0, 1]
    assert net.outcomes(0) == [(0, Outcome.DELIVERED), (1, Outcome.DELIVERED)]


def silence_answers(net: Net, until: Time) -> None:
    """Let the master hear nothing of device 1 before *until*."""
    everything = np.array([[-np.inf, 0.0], [0.0, -np.inf]])
    deaf = np.array([[-np.inf, 0.0], [-np.inf, -np.inf]])
    net.channel.air.set_powers(deaf, net.kernel.now)
    net.kernel.at(until, lambda: net.channel.air.set_powers(everything, net.kernel.now), WORLD)


def test_broadcasts_wait_in_the_line_but_need_no_room() -> None:
    net = pair(receive_payloads=1)
    for token, destination in enumerate((BROADCAST, BROADCAST, 1)):
        net.channel.send(0, Outgoing(destination, bytes([token]) * LONG, token))
    frames = payload_frames(net.run_for(1 * S))
    times = [time for time, *_ in net.hosts[1].received]
    begins = [frame["time_ns"] - frames[0]["time_ns"] for frame in frames]
    assert begins == [0, 6 * SLOT, 12 * SLOT]
    assert [frame["outcome"] for frame in frames] == ["received"] * 3
    assert times == [frames[0]["time_ns"] + frames[0]["duration_ns"] + (i + 1) * line(LONG) for i in range(3)]


def test_what_a_device_holds_reaches_its_host_after_the_link_has_ended_unless_the_device_is_switched_off() -> None:
    for off, expected in ((False, [0]), (True, [])):
        net = pair()
        burst(net, 0, 1)
        while not net.outcomes(0):
            net.run_for(1 * MS)
        assert not net.hosts[1].received
        net.command(0, Disconnect(1))
        if off:
            net.channel.power(1, False)
            net.channel.power(1, True)
        net.run_for(1 * S)
        assert [data[0] for _, _, data, _ in net.hosts[1].received] == expected
        assert net.peers_lost(0) == [1]


def test_without_a_slow_host_payloads_come_at_the_end_of_their_frames() -> None:
    net = Net(2, [(0, 1)], receive_payloads=1)
    burst(net, 0, 5)
    frames = payload_frames(net.run_for(1 * S))
    ends = [frame["time_ns"] + frame["duration_ns"] for frame in frames]
    assert [time for time, *_ in net.hosts[1].received] == ends
    assert len(ends) == 5
