"""Who hears what: frames that overlap on one channel destroy each other where both are heard."""

import pytest

from cosim.channels.bluetooth.radio import Air, Frame, Heard
from cosim.machine import Address
from cosim.units import US, Time

SLOT_FRAME, LONG_FRAME = 366 * US, 2871 * US
"""Air times of DM1/DH1 and DM5/DH5 with a full payload (Core v1.2, Vol 2 Part B, section 6.5)."""


def everywhere(source: Address, receiver: Address, time: Time) -> bool:
    return True


def frame(start: Time, source: Address, channel: int = 7, duration: Time = SLOT_FRAME) -> Frame:
    return Frame(start, duration, "DM1", source, 0, channel)


def is_clear(air: Air, wanted: Frame, receiver: Address = 0) -> bool:
    return air.clear(receiver, wanted.source, wanted.channel, wanted.start, wanted.start + wanted.duration)


def test_a_frame_that_is_alone_is_clear():
    air = Air(everywhere)
    air.put(frame(1000, 1))
    assert is_clear(air, frame(1000, 1))


@pytest.mark.parametrize("offset", [-SLOT_FRAME + 1, -1, 0, 1, SLOT_FRAME - 1])
def test_frames_that_overlap_on_one_channel_destroy_each_other(offset: Time):
    air = Air(everywhere)
    frames = sorted([frame(1_000_000, 1), frame(1_000_000 + offset, 2)])
    for each in frames:
        air.put(each)
    assert [is_clear(air, each) for each in frames] == [False, False]


@pytest.mark.parametrize("offset", [-SLOT_FRAME, SLOT_FRAME])
def test_frames_that_touch_do_not(offset: Time):
    air = Air(everywhere)
    frames = sorted([frame(1_000_000, 1), frame(1_000_000 + offset, 2)])
    for each in frames:
        air.put(each)
    assert [is_clear(air, each) for each in frames] == [True, True]


def test_frames_on_other_channels_do_not():
    air = Air(everywhere)
    air.put(frame(1000, 1, channel=7))
    air.put(frame(1000, 2, channel=8))
    assert is_clear(air, frame(1000, 1, channel=7))


def test_a_collision_happens_only_where_both_are_heard():
    air = Air(lambda source, receiver, time: abs(source - receiver) == 1)
    air.put(frame(1000, 1))
    air.put(frame(1000, 3))
    assert is_clear(air, frame(1000, 1), receiver=0)
    assert not is_clear(air, frame(1000, 1), receiver=2)


def test_reach_is_asked_for_the_start_of_the_disturbing_frame():
    air = Air(lambda source, receiver, time: time < 1500)
    air.put(frame(1000, 1))
    air.put(frame(2000, 2))
    assert is_clear(air, frame(1000, 1))
    assert not is_clear(air, frame(2000, 2))


def test_ones_own_frames_disturb_nobody_who_waits_for_oneself():
    air = Air(everywhere)
    air.put(frame(1000, 0))
    air.put(frame(1000, 1))
    air.put(frame(1100, 1))
    assert is_clear(air, frame(1000, 1), receiver=0)


def test_a_long_frame_is_destroyed_by_one_that_was_ending_when_it_began():
    air = Air(everywhere)
    air.put(frame(0, 1, duration=LONG_FRAME))
    long = frame(LONG_FRAME - 1, 2, duration=LONG_FRAME)
    air.put(long)
    air.put(frame(long.start + long.duration, 3, channel=50))  # the last moment at which it can be judged
    assert not is_clear(air, long)


def test_frames_of_the_past_are_forgotten():
    air = Air(everywhere)
    for number in range(1000):
        air.put(frame(number * 625 * US, 1))
    assert len(air._frames) < 10


def test_fates_go_to_the_record_if_there_is_one():
    rows: list[tuple[Frame, Heard]] = []
    Air(everywhere, lambda *row: rows.append(row)).record(frame(5, 1), Heard.COLLIDED)
    assert rows == [(frame(5, 1), Heard.COLLIDED)]
    Air(everywhere).record(frame(5, 1), Heard.COLLIDED)
    assert len(rows) == 1
