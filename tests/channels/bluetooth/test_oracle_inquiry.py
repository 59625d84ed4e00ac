"""The inquiry of the channel equals the slot-by-slot oracle, frame for frame, over random cases."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal, NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.channels.bluetooth.hopping import train_phase
from tests.channels.bluetooth.band_channel import Outcome, outcome_of, run_channel
from tests.oracles.band_air import Jammer
from tests.oracles.band_cases import Case, settled
from tests.oracles.band_scene import Body, Input, Inquire, Scan, ScanWindows, Scene
from tests.oracles.campaign import CLEAR, Choice, Drawn, Outages, Seeded, chance, draw_noise, draw_outages, nudge, pick
from tests.oracles.medium import TICK, Clock
from tests.tiers import soak_count

INQUIRER = 0


class Device(NamedTuple):
    """A scanner: clock, offset of its windows, when it is enabled, how many replies it has sent before."""

    address: int
    phase: int
    ppm: int
    offset: int
    begin: int
    n: int
    off: int | None = None
    """When it stops scanning, if it does."""


@dataclass(frozen=True)
class Search:
    """One or two inquiries after each other, among the same scanners."""

    phase: int
    ppm: int
    start: int
    duration: int
    enough: int
    n_inquiry: int
    first_train: Literal["A", "B"]
    version: Literal["1.1", "1.2"]
    interval: int
    interlaced: bool
    devices: tuple[Device, ...]
    longest_backoff: int
    coarse: bool
    pause: int | None
    """From the end of the first inquiry to the start of the second, if there is one."""
    outages: Outages = CLEAR
    noise: tuple[Jammer, ...] = ()

    def case(self) -> Case:
        """Return it as a scene, with the second inquiry if there is one."""
        case = self._case(Inquire(self.start, INQUIRER, self.duration, self.enough))
        if self.pause is None:
            return case
        again = case.book().news[-1].time + self.pause
        return self._case(*case.scene.inputs, Inquire(again, INQUIRER, self.duration, self.enough))

    def _case(self, *inputs: Input) -> Case:
        start = inputs[-1].time
        scene = Scene(
            bodies=(
                Body(self.phase, self.ppm, 0, self._windows(0), self._page_windows(0)),
                *(
                    Body(
                        device.phase,
                        device.ppm,
                        0,
                        self._windows(device.offset, device.n),
                        self._page_windows(device.offset),
                    )
                    for device in self.devices
                ),
            ),
            radio=self.outages.radio(1 + len(self.devices), self.noise),
            inputs=tuple(sorted({*inputs, *self._scans()}, key=lambda wish: (wish.time, wish[1:]))),
            end=start + (self.duration + 40) * TICK,
            n_inquiry=self.n_inquiry,
            first_train=self.first_train,
        )
        return Case(scene, self.longest_backoff, self.coarse)

    def _windows(self, offset: int, n: int = 0) -> ScanWindows:
        return ScanWindows(offset, self.interval, self.interlaced, self.version, n)

    def _page_windows(self, offset: int) -> ScanWindows:
        return ScanWindows((offset + self.interval // 2) % 2048, 2048)  # half an interval behind those for inquiries

    def _scans(self) -> Iterator[Scan]:
        for device in self.devices:
            if device.begin:
                yield Scan(0, device.address, False)
                yield Scan(device.begin, device.address, True)
            if device.off is not None:
                yield Scan(device.off, device.address, False)


# ---------------------------------------------------------------- drawing cases


def draw_case(choice: Choice) -> Case:
    """Draw cases until the readings settle one of them."""
    while True:
        case = _draw_search(choice).case()
        if settled(case):
            return case


def _draw_search(choice: Choice) -> Search:
    """Draw a search; half of them near edges, and half of these with outages or noise near their own frames."""
    ppm = choice.integer(-250, 250)
    start = choice.integer(0, 5_000_000)
    duration = 4 * pick(choice, (choice.integer(1, 20), choice.integer(20, 200), choice.integer(200, 2000)))
    base = pick(choice, (choice.integer(0, 1 << 28), (1 << 28) - choice.integer(0, duration)))
    if chance(choice, 2):  # a block boundary within the inquiry; from block 0 to 1 the phase of step 0 changes, too
        boundary = pick(choice, (choice.integer(1, 1 << 16), 16 * choice.integer(1, 1 << 12) + 1))
        base = (boundary << 12) - choice.integer(0, duration)
    phase = base * TICK + pick(choice, (0, 1, -1, choice.integer(0, TICK - 1))) + TICK
    phase -= start + start * ppm // 1_000_000
    version: Literal["1.1", "1.2"] = pick(choice, ("1.1", "1.2"))
    interlaced = version == "1.2" and chance(choice, 2)
    intervals = (100, 256, 512, 2048, 4095, 4096, 8192)
    search = Search(
        phase=max(0, phase),
        ppm=ppm,
        start=start,
        duration=duration,
        enough=choice.integer(1, 8),
        n_inquiry=pick(choice, (1, 2, 3, 16, 256)),
        first_train=pick(choice, ("A", "B")),
        version=version,
        interval=pick(choice, (72, *intervals) if interlaced else (36, 37, *intervals)),
        interlaced=interlaced,
        devices=(),
        longest_backoff=pick(choice, (1, 4, 32, 128, 1024)),
        coarse=chance(choice, 2),
        pause=choice.integer(5_000_000, 60_000_000) if chance(choice, 4) else None,
    )
    if version == "1.1" and chance(choice, 4):  # the wrong train for longer than a response time-out
        duration = 4 * choice.integer(300, 1200)
        search = replace(search, n_inquiry=16, duration=duration, longest_backoff=256, coarse=True)
    near = chance(choice, 2)
    devices: list[Device] = []
    focus = _draw_focus(choice, search)
    for address in range(1, pick(choice, (1, 1, 2, 3, choice.integer(1, 7))) + 1):
        devices.append(_draw_device(choice, search, address, focus if near else None))
        if chance(choice, 2):  # the other half-slot, so that two answers overlap, or somewhere else
            focus = pick(choice, (focus ^ 1, _draw_focus(choice, search)))
    search = replace(search, devices=tuple(devices))
    if near and chance(choice, 2):
        frames = search.case().book().seen
        if frames:
            outages = draw_outages(choice, frames) if chance(choice, 2) else search.outages
            search = replace(search, outages=outages, noise=draw_noise(choice, frames) if chance(choice, 2) else ())
    return search


def _draw_focus(choice: Choice, search: Search) -> int:
    """Draw a transmit tick of the inquirer near a place where faults hide."""
    first = Clock(search.phase, search.ppm).first_transmit_tick(search.start)
    switch = 32 * search.n_inquiry
    place = pick(
        choice,
        (
            first,
            first + search.duration,
            first + switch * choice.integer(1, max(1, search.duration // switch)),
            max(first, (first + search.duration) >> 12 << 12),
            choice.integer(first, first + search.duration),
        ),
    )
    tick = place + pick(choice, (0, 0, choice.integer(-5, 5)))
    tick = min(max(tick, first), first + search.duration - 1)
    return tick - tick % 4 + choice.integer(0, 1)


def _draw_device(choice: Choice, search: Search, address: int, focus: int | None) -> Device:
    """Draw a scanner; one that meets the ID of the tick *focus*, if there is one, at an edge of its own."""
    interval, interlaced = search.interval, search.interlaced
    ppm, n = choice.integer(-250, 250), pick(choice, (0, 0, 1, 16, 31, 32))
    if focus is None:
        phase, offset = choice.integer(0, TICK << 28), choice.integer(0, interval - 1)
        begin = pick(choice, (0, search.start, choice.integer(0, search.start + search.duration * TICK)))
        return Device(address, phase, ppm, offset, begin, n)
    inquirer = Clock(search.phase, search.ppm)
    second = interlaced and chance(choice, 2)
    tick, edge, before = _draw_edge(choice, second)
    first = inquirer.first_transmit_tick(search.start)
    same = (focus - first) // (32 * search.n_inquiry) % 2 == 0
    train = search.first_train if same else ("B" if search.first_train == "A" else "A")
    block = (train_phase(focus, train) - n - 16 * second) % 32
    if tick == 4096:  # its block begins at the edge, or ends there
        block -= choice.integer(0, 1)
    high = pick(choice, (1 << 11, choice.integer(1, 1 << 11)))
    tick += (high << 17) + (block << 12)
    time = inquirer.start(focus)
    local = tick * TICK + nudge(choice)
    begin = max(0, pick(choice, (0, time, time + nudge(choice), search.start)))
    edges = (1, 67_999, 68_001, 624_999, 625_001, choice.integer(0, 1_500_000_000) * 2 + 1)
    off = time + pick(choice, edges) if chance(choice, 8) else None
    return Device(
        address,
        local - (time + before) - (time + before) * ppm // 1_000_000,
        ppm,
        (tick - edge - 36 * second) % interval,
        begin,
        n,
        off if off is not None and off > begin else None,
    )


def _draw_edge(choice: Choice, second: bool) -> tuple[int, int, int]:
    """Return (tick within its block, ticks from the opening of the window to it, ns before it) of a focus."""
    low = pick(choice, (choice.integer(40, 4050), choice.integer(0, 80), choice.integer(4010, 4095)))
    return pick(
        choice,
        (
            (low, 0, 0),  # the window opens
            (low, 36, 68_000),  # the window closes behind the ID
            (low, 36, choice.integer(1, 67_999)),  # or within it
            (low, choice.integer(1, 35), choice.integer(0, TICK)),
            (4096, choice.integer(1, 35), 0),  # the block changes
        ),
    )


# ---------------------------------------------------------------- comparing


def seeded_cases(count: int, first: int = 0) -> Iterator[Case]:
    return (draw_case(Seeded(2, number)) for number in range(first, first + count))


DEFAULT = 400


@cache
def default_case(number: int) -> Case:
    return next(seeded_cases(1, number))


@cache
def _default_outcome(number: int) -> Outcome:
    return outcome_of(default_case(number))


def default_cases() -> Iterator[tuple[Case, Outcome]]:
    """Yield the cases of the default run and what the oracle says of them."""
    return ((default_case(number), _default_outcome(number)) for number in range(DEFAULT))


@settings(max_examples=60, derandomize=True, database=None)
@given(st.data())
@pytest.mark.slow
def test_inquiry_equals_the_oracle_over_cases_that_shrink(data: st.DataObject) -> None:
    case = draw_case(Drawn(data))
    assert run_channel(case) == outcome_of(case)


@pytest.mark.slow
def test_inquiry_equals_the_oracle_and_every_outcome_occurs() -> None:
    seen: Counter[str] = Counter()
    for case, slow in default_cases():
        assert run_channel(case) == slow, case
        seen.update(f"{row.kind} {row.outcome}" for row in slow.frames)
    fates = ("received", "out_of_range", "not_tuned", "busy", "collided")
    assert all(seen[kind] >= 5 for kind in ("ID received", *(f"FHS {fate}" for fate in fates))), seen


@pytest.mark.soak
@pytest.mark.parametrize("part", range(4))
def test_inquiry_equals_the_oracle_over_ten_thousand_cases(
    part: int, record_property: Callable[[str, object], None]
) -> None:
    count = soak_count(2_500)
    for case in seeded_cases(count, 1_000_000 * (part + 1)):
        assert run_channel(case) == outcome_of(case), case
    record_property("equal inquiry cases", count)
    print(f"{count} inquiry cases equal")
