"""Hosts cannot tell whether links rest: all that reaches them, and when, is the same if every poll is sent."""

import pytest

from cosim.kernel import Kernel
from cosim.machine import BROADCAST, Connected, Disconnect, Fate, Flush, Inquire, Lost, Page, Scan
from cosim.trace import FRAMES
from cosim.units import MS, US, S
from tests.channels.ble.ble_field import Field, News
from tests.oracles.campaign import Choice, Seeded, pick
from tests.tiers import soak_count

FEW = 8


def script(choice: Choice, size: int) -> list[tuple[int, object]]:
    """Draw what hosts do, and when: (time, what)."""
    todo: list[tuple[int, object]] = []
    for _ in range(choice.integer(5, 40)):
        time = choice.integer(0, 20_000) * MS + choice.integer(0, 999) * US
        one, other = choice.integer(0, size - 1), choice.integer(0, size - 1)
        what = pick(
            choice,
            (
                ("page", one, other),
                ("page", one, other),
                ("page", one, other),
                ("send", one, other, choice.integer(0, 600)),
                ("send", one, other, choice.integer(0, 20)),
                ("send", one, BROADCAST, choice.integer(0, 300)),
                ("inquire", one, choice.integer(1, 3_000)),
                ("close", one, other),
                ("flush", one, other),
                ("scan", one, choice.integer(0, 1)),
                ("power", one, choice.integer(0, 1)),
                ("move", one, choice.integer(0, 30)),
            ),
        )
        todo.append((time, what))
    return sorted(todo, key=lambda item: item[0])


def run(seed: int, idle_frames: bool) -> tuple[list[News], Kernel]:
    choice = Seeded(seed)
    size = choice.integer(2, 5)
    settings = {
        "interference": pick(choice, ("none", "band")),
        "connection": {
            "latency": pick(choice, (0, 0, 2)),
            "supervision_s": 1.0,
            "phy": pick(choice, ("1M", "2M", "coded")),
        },
        **pick(choice, ({}, {"range_m": 20}, {"propagation": {"model": "log_distance"}})),
    }
    field = Field(size, seed, (FRAMES,), idle_frames=idle_frames, **settings)
    places = [(float(a), 0.0) for a in range(size)]
    field.move(places)
    for token, (time, what) in enumerate(script(choice, size)):
        field.until(max(time, field.kernel.now))
        match what:
            case ("page", int(one), int(other)):
                field.do(one, Page(other))
            case ("send", int(one), int(other), int(length)):
                field.send(one, other, bytes(length), token)
            case ("inquire", int(one), int(ms)):
                field.do(one, Inquire(ms * MS, 9))
            case ("close", int(one), int(other)):
                field.do(one, Disconnect(other))
            case ("flush", int(one), int(other)):
                field.do(one, Flush(other))
            case ("scan", int(one), int(enabled)):
                field.do(one, Scan(bool(enabled)))
            case ("power", int(one), int(on)):
                field.channel.power(one, bool(on))
            case ("move", int(one), int(x)):
                places[one] = (float(x), 0.0)
                field.move(places)
    field.until(40 * S)
    return field.news, field.kernel


def compare(seeds: range) -> None:
    spared, news = [], []
    for seed in seeds:
        (resting, few), (sending, many) = run(seed, idle_frames=False), run(seed, idle_frames=True)
        assert resting == sending, f"seed {seed}"
        spared.append(few.executed < many.executed)
        news += resting
    assert any(spared)
    counts = {kind: sum(isinstance(each.what, kind) for each in news) for kind in (Connected, Lost, Fate, tuple)}
    assert min(counts.values()) > len(seeds) // 4, counts  # the cases are about something


def test_hosts_cannot_tell_whether_links_rest() -> None:
    compare(range(FEW))


@pytest.mark.soak
def test_hosts_cannot_tell_in_many_runs() -> None:
    compare(range(FEW, FEW + soak_count(2_000)))
