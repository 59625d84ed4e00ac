"""The inquiry of cosim equals the slot-by-slot oracle, frame for frame, over random cases; planted faults are found."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any, Literal, NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.channels.bluetooth import inquiry as fast_inquiry
from cosim.channels.bluetooth.clock import NativeClock
from cosim.channels.bluetooth.hopping import train_phase
from cosim.channels.bluetooth.radio import Air, Frame, Heard
from cosim.kernel import Kernel
from cosim.randomness import Draws
from tests.oracles import inquiry as oracle
from tests.oracles.campaign import (
    CLEAR,
    Choice,
    Drawn,
    Outages,
    Seeded,
    chance,
    draw_noise,
    draw_outages,
    nudge,
    pick,
    plant,
    soak_count,
)
from tests.oracles.medium import TICK, Clock, OnAir, Sighting, Windows

INQUIRER = 0
CHAIN = ("scanning", "inquiry")


class Device(NamedTuple):
    """A scanner: clock, scan settings, when it is enabled, how many replies it has sent before."""

    address: int
    phase: int
    ppm: int
    offset: int
    interval: int
    interlaced: bool
    version: Literal["1.1", "1.2"]
    begin: int
    n: int
    off: int | None = None
    """When it stops scanning, if it does."""


@dataclass(frozen=True)
class Case:
    """One or two inquiries after each other, among the same scanners."""

    phase: int
    ppm: int
    start: int
    duration: int
    enough: int
    n_inquiry: int
    first_train: Literal["A", "B"]
    devices: tuple[Device, ...]
    longest_backoff: int
    coarse: bool
    """Whether back-offs are 0 or 1 more than multiples of 16 slots, which bring the same ID again."""
    pause: int | None
    """From the end of the first inquiry to the start of the second, if there is one."""
    outages: Outages = CLEAR
    noise: tuple[OnAir, ...] = ()


class Trace(NamedTuple):
    """All that must be equal."""

    sightings: list[Sighting]
    found: list[list[tuple[int, int, int]]]
    ends: list[int]
    n: list[int]
    draws: list[tuple[int, ...]]


class ShortDraws(Draws):
    """Draws that depend on every argument and are short, so that a short case holds several back-offs."""

    def __init__(self, address: int, longest: int, coarse: bool, calls: list[tuple[int, ...]]) -> None:
        super().__init__(1, address)
        self._address = address
        self._longest = longest
        self._coarse = coarse
        self._calls = calls

    def below(self, bound: int, number: int, link: int = 0, purpose: int = 0) -> int:
        self._calls.append((self._address, bound, number, link, purpose))
        slots = super().below(min(self._longest, bound), number, 1000 * link + bound, purpose)
        return slots // 16 * 16 + slots % 2 if self._coarse else slots


def run_slowly(case: Case) -> Trace:
    trace = Trace([], [], [], [], [])
    scanners = [
        oracle.Scanner(
            device.address,
            Windows(Clock(device.phase, device.ppm), device.offset, device.interval, device.interlaced),
            device.version,
            partial(_draw, ShortDraws(device.address, case.longest_backoff, case.coarse, trace.draws)),
            device.begin,
            device.n,
            device.off,
        )
        for device in case.devices
    ]
    start: int | None = case.start
    while start is not None:
        inquiry = oracle.Inquiry(
            INQUIRER,
            Clock(case.phase, case.ppm),
            scanners,
            case.outages.reach,
            start,
            case.duration,
            case.enough,
            case.n_inquiry,
            case.first_train,
            case.noise,
        )
        inquiry.run()
        trace.sightings.extend(inquiry.sightings)
        trace.found.append(inquiry.found)
        trace.ends.append(inquiry.end)
        start = inquiry.end + case.pause if case.pause is not None and start == case.start else None
    trace.sightings.sort()
    trace.draws.sort()
    trace.n.extend(scanner.n for scanner in scanners)
    return trace


def _draw(draws: Draws, bound: int, tick: int) -> int:
    return draws.below(bound, tick, 0, 1)


def run_fast(case: Case, slow: Trace, model: Any = fast_inquiry) -> Trace:
    """Run the case through *model*; a second inquiry starts where the *slow* one has it."""
    kernel, trace = Kernel(), Trace([], [], [], [], [])

    def record(frame: Frame, heard: Heard) -> None:
        row = (frame.start, frame.duration, frame.kind, frame.source, frame.destination, frame.channel, heard.value)
        trace.sightings.append(Sighting(*row))

    air = Air(case.outages.reach, record)
    scanners = []
    for device in case.devices:
        scan = model.InquiryScanSettings(
            version=device.version, interval_s=device.interval * 312.5e-6, interlaced=device.interlaced
        )
        draws = ShortDraws(device.address, case.longest_backoff, case.coarse, trace.draws)
        clock = NativeClock(device.phase, device.ppm)
        scanner = model.InquiryScanner(kernel, air, device.address, clock, scan, device.offset, draws)
        scanner.n = device.n
        kernel.at(device.begin, partial(scanner.enable, device.begin))
        if device.off is not None:
            kernel.at(device.off, scanner.disable)
        scanners.append(scanner)
    for noise in case.noise:
        frame = Frame(noise.start, noise.end - noise.start, "DH1", noise.source, 98, noise.channel)
        kernel.at(noise.start, partial(air.put, frame))

    def inquire() -> None:
        found: list[tuple[int, int, int]] = []
        trace.found.append(found)
        model.Inquiry(
            kernel,
            air,
            INQUIRER,
            NativeClock(case.phase, case.ppm),
            model.InquirySettings(n_inquiry=case.n_inquiry, first_train=case.first_train),
            case.duration,
            case.enough,
            scanners,
            lambda address, estimate: found.append((kernel.now, address, estimate)),
            lambda addresses: trace.ends.append(kernel.now),
        )

    start = case.start
    kernel.at(start, inquire)
    if case.pause is not None:
        start = slow.ends[0] + case.pause
        kernel.at(start, inquire)
    kernel.run(start + (case.duration + 40) * TICK)
    trace.sightings.sort()
    trace.draws.sort()
    trace.n.extend(scanner.n for scanner in scanners)
    return trace


# ---------------------------------------------------------------- drawing cases


def draw_case(choice: Choice) -> Case:
    """Draw a case; half of them near edges, and half of these with outages or noise near their own frames."""
    ppm = choice.integer(-250, 250)
    start = choice.integer(0, 5_000_000)
    duration = 4 * pick(choice, (choice.integer(1, 20), choice.integer(20, 200), choice.integer(200, 2000)))
    base = pick(choice, (choice.integer(0, 1 << 28), (1 << 28) - choice.integer(0, duration)))
    if chance(choice, 2):  # a block boundary within the inquiry; from block 0 to 1 the phase of step 0 changes, too
        boundary = pick(choice, (choice.integer(1, 1 << 16), 16 * choice.integer(1, 1 << 12) + 1))
        base = (boundary << 12) - choice.integer(0, duration)
    phase = base * TICK + pick(choice, (0, 1, -1, choice.integer(0, TICK - 1))) + TICK
    phase -= start + start * ppm // 1_000_000
    case = Case(
        phase=max(0, phase),
        ppm=ppm,
        start=start,
        duration=duration,
        enough=choice.integer(1, 8),
        n_inquiry=pick(choice, (1, 2, 3, 16, 256)),
        first_train=pick(choice, ("A", "B")),
        devices=(),
        longest_backoff=pick(choice, (1, 4, 32, 128, 1024)),
        coarse=chance(choice, 2),
        pause=choice.integer(5_000_000, 60_000_000) if chance(choice, 4) else None,
    )
    version: Literal["1.1", "1.2"] = pick(choice, ("1.1", "1.2"))
    if version == "1.1" and chance(choice, 4):  # the wrong train for longer than a response time-out
        duration = 4 * choice.integer(300, 1200)
        case = replace(case, n_inquiry=16, duration=duration, longest_backoff=256, coarse=True)
    near = chance(choice, 2)
    devices: list[Device] = []
    focus = _draw_focus(choice, case)
    for address in range(1, pick(choice, (1, 1, 2, 3, choice.integer(1, 7))) + 1):
        devices.append(_draw_device(choice, case, address, version, focus if near else None))
        if chance(choice, 2):  # the other half-slot, so that two answers overlap, or somewhere else
            focus = pick(choice, (focus ^ 1, _draw_focus(choice, case)))
    case = replace(case, devices=tuple(devices))
    if near and chance(choice, 2):
        frames = run_slowly(case).sightings
        if frames:
            outages = draw_outages(choice, frames) if chance(choice, 2) else case.outages
            case = replace(case, outages=outages, noise=draw_noise(choice, frames) if chance(choice, 2) else ())
    return case


def _draw_focus(choice: Choice, case: Case) -> int:
    """Draw a transmit tick of the inquirer near a place where faults hide."""
    first = Clock(case.phase, case.ppm).first_transmit_tick(case.start)
    switch = 32 * case.n_inquiry
    place = pick(
        choice,
        (
            first,
            first + case.duration,
            first + switch * choice.integer(1, max(1, case.duration // switch)),
            max(first, (first + case.duration) >> 12 << 12),
            choice.integer(first, first + case.duration),
        ),
    )
    tick = place + pick(choice, (0, 0, choice.integer(-5, 5)))
    tick = min(max(tick, first), first + case.duration - 1)
    return tick - tick % 4 + choice.integer(0, 1)


def _draw_device(choice: Choice, case: Case, address: int, version: Literal["1.1", "1.2"], focus: int | None) -> Device:
    """Draw a scanner; one that meets the ID of the tick *focus*, if there is one, at an edge of its own."""
    interlaced = version == "1.2" and chance(choice, 2)
    intervals = (100, 256, 512, 2048, 4095, 4096, 8192)
    interval = pick(choice, (72, *intervals) if interlaced else (36, 37, *intervals))
    ppm, n = choice.integer(-250, 250), pick(choice, (0, 0, 1, 16, 31, 32))
    if focus is None:
        phase, offset = choice.integer(0, TICK << 28), choice.integer(0, interval - 1)
        begin = pick(choice, (0, case.start, choice.integer(0, case.start + case.duration * TICK)))
        return Device(address, phase, ppm, offset, interval, interlaced, version, begin, n)
    inquirer = Clock(case.phase, case.ppm)
    second = interlaced and chance(choice, 2)
    tick, edge, before = _draw_edge(choice, second)
    first = inquirer.first_transmit_tick(case.start)
    same = (focus - first) // (32 * case.n_inquiry) % 2 == 0
    train = case.first_train if same else ("B" if case.first_train == "A" else "A")
    block = (train_phase(focus, train) - n - 16 * second) % 32
    if tick == 4096:  # its block begins at the edge, or ends there
        block -= choice.integer(0, 1)
    high = pick(choice, (1 << 11, choice.integer(1, 1 << 11)))
    tick += (high << 17) + (block << 12)
    time = inquirer.start(focus)
    local = tick * TICK + nudge(choice)
    begin = max(0, pick(choice, (0, time, time + nudge(choice), case.start)))
    edges = (1, 67_999, 68_001, 624_999, 625_001, choice.integer(0, 1_500_000_000) * 2 + 1)
    off = time + pick(choice, edges) if chance(choice, 8) else None
    return Device(
        address,
        local - (time + before) - (time + before) * ppm // 1_000_000,
        ppm,
        (tick - edge - 36 * second) % interval,
        interval,
        interlaced,
        version,
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
def default_cases() -> list[tuple[Case, Trace]]:
    """Return the cases of the default run and what the oracle says of them."""
    return [(case, run_slowly(case)) for case in seeded_cases(DEFAULT)]


@settings(max_examples=60, deadline=None, derandomize=True, database=None)
@given(st.data())
@pytest.mark.slow
def test_inquiry_equals_the_oracle_over_cases_that_shrink(data: st.DataObject) -> None:
    case = draw_case(Drawn(data))
    slow = run_slowly(case)
    assert run_fast(case, slow) == slow


@pytest.mark.slow
def test_inquiry_equals_the_oracle_and_every_outcome_occurs() -> None:
    seen: Counter[str] = Counter()
    for case, slow in default_cases():
        assert run_fast(case, slow) == slow, case
        seen.update(f"{row.kind} {row.outcome}" for row in slow.sightings)
    fates = ("received", "out_of_range", "not_tuned", "busy", "collided")
    assert all(seen[kind] >= 5 for kind in ("ID received", *(f"FHS {fate}" for fate in fates))), seen


@pytest.mark.soak
@pytest.mark.parametrize("part", range(4))
def test_inquiry_equals_the_oracle_over_ten_thousand_cases(
    part: int, record_property: Callable[[str, object], None]
) -> None:
    count = soak_count(2_500)
    for case in seeded_cases(count, 1_000_000 * (part + 1)):
        slow = run_slowly(case)
        assert run_fast(case, slow) == slow, case
    record_property("equal inquiry cases", count)
    print(f"{count} inquiry cases equal")


# ---------------------------------------------------------------- planted faults

FAULTS = [
    ("the window opens a tick late", "scanning", "edge + part * WINDOW)", "edge + part * WINDOW + 1)"),
    ("the window closes a tick late", "scanning", "(part + 1) * WINDOW)", "(part + 1) * WINDOW + 1)"),
    ("the window opens 1 ns late", "scanning", "_tick(ph, pm, opening - 1) + 1", "_tick(ph, pm, opening) + 1"),
    ("the window closes 1 ns early", "scanning", "closing - ID_AIR", "closing - ID_AIR - 1"),
    ("an ID across the close is heard", "scanning", "closing - ID_AIR", "closing"),
    ("listening starts 1 ns late", "scanning", "since - 1) + 1", "since) + 1"),
    ("the scanner's block ends a tick late", "scanning", "(block + 1) << 12) - 1)", "(block + 1) << 12))"),
    ("the inquirer's block ends a tick late", "scanning", "<< 12) - est - 1", "<< 12) - est"),
    ("the transmit slot that begins now is missed", "scanning", "clock.tick(now - 1)", "clock.tick(now)"),
    ("the train ends a tick late", "scanning", "(turn + 1) * switch - 1", "(turn + 1) * switch"),
    (
        "the train in use changes a tick late",
        "scanning",
        "(tick - self.first) // (32",
        "(tick - self.first - 1) // (32",
    ),
    ("the second window is not 16 on", "scanning", "n + 16 * part", "n + 15 * part"),
    ("the scanner's clock stops at 28 bits", "scanning", "_solve((block", "_solve((min(block, 0xFFFF)"),
    ("N is not counted", "inquiry", "self.n += 1", "self.n += 0"),
    ("the back-off is short by one", "inquiry", "slots * SLOT", "max(slots - 1, 0) * SLOT"),
    (
        "the short back-off begins too late",
        "inquiry",
        "SHORT_BACKOFF_BELOW: Final = 4096",
        "SHORT_BACKOFF_BELOW: Final = 4095",
    ),
    ("the response time-out is short by one slot", "inquiry", "128 * SLOT", "127 * SLOT"),
    ("the response time-out is long by one slot", "inquiry", "128 * SLOT", "129 * SLOT"),
    ("the answer is a tick late", "inquiry", "start + RESPONSE_DELAY", "start + RESPONSE_DELAY + 312_500"),
    (
        "the answer is expected a slot pair late",
        "inquiry",
        "listens = reply.frame, reply.tick + 2",
        "listens = reply.frame, reply.tick + 6",
    ),
    ("the answer in a second window is not 16 on", "inquiry", "16 * meeting.second", "0 * meeting.second"),
    (
        "IDs are sent while an FHS is received",
        "inquiry",
        "frame.start < start < self._locked.end",
        "frame.start < start < 0",
    ),
    (
        "a second FHS can be locked on",
        "inquiry",
        "frame.start < self._locked.end",
        "frame.start < self._locked.frame.start",
    ),
    ("a scanner that is off still answers", "inquiry", "self._answering.cancel()", "self._answering.time"),
    ("one reply too many is waited for", "inquiry", ">= self._enough", "> self._enough"),
    ("the inquiry ends a tick early", "inquiry", "self.ids.end + 1", "self.ids.end"),
    ("the clock in the FHS does not wrap", "inquiry", "* 4 % CLOCK_RANGE", "* 4"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("module", "old", "new"), [fault[1:] for fault in FAULTS], ids=[fault[0] for fault in FAULTS])
def test_a_planted_fault_in_inquiry_is_found(module: str, old: str, new: str, monkeypatch: pytest.MonkeyPatch) -> None:
    model = plant(monkeypatch, CHAIN, module, old, new)
    assert any(run_fast(case, slow, model) != slow for case, slow in default_cases())
