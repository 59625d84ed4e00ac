"""The page procedure of cosim equals the slot-by-slot oracle, frame for frame; planted faults are found."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any, Literal, NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.channels.bluetooth import paging as fast_paging
from cosim.channels.bluetooth.clock import NativeClock
from cosim.channels.bluetooth.hopping import train_phase
from cosim.channels.bluetooth.radio import Air, Frame, Heard
from cosim.errors import LocalProtocolError
from cosim.kernel import Kernel
from tests.oracles import page as oracle
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

PAGER, PAGED = 0, 1
CHAIN = ("scanning", "paging")
REPETITIONS: dict[Literal["R0", "R1", "R2"], int] = {"R0": 1, "R1": 128, "R2": 256}


@dataclass(frozen=True)
class Case:
    """One page of one device."""

    phase: int
    ppm: int
    word: int
    start: int
    mode: Literal["R0", "R1", "R2"]
    timeout: int
    estimate: int
    paged_phase: int
    paged_ppm: int
    paged_word: int
    offset: int
    interval: int
    interlaced: bool
    begin: int
    outages: Outages = CLEAR
    noise: tuple[OnAir, ...] = ()


class Trace(NamedTuple):
    """All that must be equal; instants in lists that are empty if the thing has not happened."""

    sightings: list[Sighting]
    slave: list[int]
    master: list[int]
    failed: list[int]


def run_slowly(case: Case) -> Trace:
    windows = Windows(Clock(case.paged_phase, case.paged_ppm), case.offset, case.interval, case.interlaced)
    scanner = oracle.PageScanner(PAGED, case.paged_word, windows, case.begin)
    page = oracle.Page(
        PAGER,
        case.word,
        Clock(case.phase, case.ppm),
        scanner,
        case.estimate,
        REPETITIONS[case.mode],
        case.outages.reach,
        case.start,
        case.timeout,
        case.noise,
    )
    page.run()
    ends = [[] if time is None else [time] for time in (scanner.connected, page.connected, page.failed)]
    return Trace(page.sightings, *ends)


def run_fast(case: Case, model: Any = fast_paging) -> Trace:
    kernel, trace = Kernel(), Trace([], [], [], [])

    def record(frame: Frame, heard: Heard) -> None:
        row = (frame.start, frame.duration, frame.kind, frame.source, frame.destination, frame.channel, heard.value)
        trace.sightings.append(Sighting(*row))

    air = Air(case.outages.reach, record)
    scanner = model.PageScanner(
        kernel,
        air,
        PAGED,
        case.paged_word,
        NativeClock(case.paged_phase, case.paged_ppm),
        model.ScanSettings(interval_s=case.interval * 312.5e-6, interlaced=case.interlaced),
        case.offset,
        lambda master, lt_addr: trace.slave.append(kernel.now),
    )
    kernel.at(case.begin, partial(scanner.enable, case.begin))
    for noise in case.noise:
        frame = Frame(noise.start, noise.end - noise.start, "DH1", noise.source, 98, noise.channel)
        kernel.at(noise.start, partial(air.put, frame))

    def page() -> None:
        model.Page(
            kernel,
            air,
            PAGER,
            case.word,
            NativeClock(case.phase, case.ppm),
            model.PageSettings(mode=case.mode, timeout_slots=case.timeout // 2),
            scanner,
            case.estimate,
            1,
            lambda tick: trace.master.append(kernel.now),
            lambda: trace.failed.append(kernel.now),
        )

    kernel.at(case.start, page)
    kernel.run(case.start + (case.timeout + 200) * TICK)
    trace.sightings.sort()
    return trace


# ---------------------------------------------------------------- drawing cases


def draw_case(choice: Choice) -> Case:
    """Draw a case; half of them near edges; most of these with outages or noise near their own frames."""
    near = chance(choice, 2)
    ppm, paged_ppm = choice.integer(-250, 250), choice.integer(-250, 250)
    start = choice.integer(0, 5_000_000)
    mode: Literal["R0", "R1", "R2"] = pick(choice, ("R0", "R0", "R1", "R2"))
    timeout = 4 * pick(choice, (choice.integer(1, 30), choice.integer(30, 200), choice.integer(200, 600)))
    if mode == "R1" and chance(choice, 4):  # long enough for a train to end
        timeout = 4096 + 4 * choice.integer(1, 30)
    base = pick(choice, (choice.integer(1, 1 << 28), (1 << 28) - choice.integer(0, timeout)))
    phase = base * TICK + pick(choice, (0, 1, -1, choice.integer(0, TICK - 1))) - start - start * ppm // 1_000_000
    interlaced = chance(choice, 3)
    intervals = (100, 256, 2048, 4096, 8192)
    case = Case(
        phase=max(0, phase),
        ppm=ppm,
        word=choice.integer(0, (1 << 32) - 1),
        start=start,
        mode=mode,
        timeout=timeout,
        estimate=4 * choice.integer(0, 1 << 26),
        paged_phase=choice.integer(0, TICK << 28),
        paged_ppm=paged_ppm,
        paged_word=choice.integer(0, (1 << 32) - 1),
        offset=0,
        interval=pick(choice, (72, *intervals) if interlaced else (36, 36, 37, *intervals)),
        interlaced=interlaced,
        begin=pick(choice, (0, start, start + choice.integer(0, timeout * TICK))),
    )
    case = replace(case, offset=choice.integer(0, case.interval - 1))
    case = _focused(choice, case) if near else _estimated(choice, case)
    for _ in range(choice.integer(0, 3) if near else 0):  # one by one: an outage brings about other frames
        frames = run_slowly(case).sightings
        if frames:
            more = draw_outages(choice, frames)
            case = replace(case, outages=Outages(case.outages.rows + more.rows))
    frames = run_slowly(case).sightings if near and chance(choice, 2) else []
    return replace(case, noise=draw_noise(choice, frames)) if frames else case


def _estimated(choice: Choice, case: Case) -> Case:
    """Let the pager know the other's clock more or less, in half of the cases."""
    if chance(choice, 2):
        return case
    pager, paged = Clock(case.phase, case.ppm), Clock(case.paged_phase, case.paged_ppm)
    exact = (paged.tick(case.start) - pager.tick(case.start)) // 4 * 4
    return replace(case, estimate=exact + 4 * pick(choice, (0, 0, 1, -1, choice.integer(-2000, 2000))))


def _focused(choice: Choice, case: Case) -> Case:
    """Let the paged device meet one page ID, near a place where faults hide, at an edge of its own."""
    pager = Clock(case.phase, case.ppm)
    first = pager.first_transmit_tick(case.start)
    switch = 32 * REPETITIONS[case.mode]
    places = (
        first,
        first + case.timeout,
        first + switch * choice.integer(1, max(1, case.timeout // switch)),
        choice.integer(first, first + case.timeout),
    )
    focus = min(max(pick(choice, places) + pick(choice, (0, choice.integer(-5, 5))), first), first + case.timeout - 1)
    focus += choice.integer(0, 1) - focus % 4
    # the estimate, so that blocks of the estimated clock change near the focus, or anywhere
    block = pick(choice, (choice.integer(1, 1 << 16), 16 * choice.integer(1, 1 << 12) + 1))
    near_block = (block << 12) + 4 * pick(choice, (0, 0, choice.integer(-5, 5)))
    estimate = pick(choice, (case.estimate, near_block - focus // 4 * 4))
    train: Literal["A", "B"] = "A" if (focus - first) // switch % 2 == 0 else "B"
    second = case.interlaced and chance(choice, 2)
    low, edge, before = _draw_edge(choice, case.interval == 36)
    block = (train_phase(focus + estimate, train) - 16 * second) % 32
    if low == 4096:  # its block begins at the edge, or ends there
        block -= choice.integer(0, 1)
    tick = (pick(choice, (1 << 11, choice.integer(1, 1 << 11))) << 17) + (block << 12) + low
    time = pager.start(focus)
    local = tick * TICK + nudge(choice)
    moment = time + before
    return replace(
        case,
        estimate=estimate,
        paged_phase=local - moment - moment * case.paged_ppm // 1_000_000,
        offset=(tick - edge - 36 * second) % case.interval,
        begin=pick(choice, (0, max(0, time + nudge(choice)), case.start)),
    )


def _draw_edge(choice: Choice, continuous: bool) -> tuple[int, int, int]:
    """Return (tick within its block, ticks from the opening of the window to it, ns before it) of a focus."""
    low = pick(choice, (choice.integer(40, 4050), choice.integer(0, 80), choice.integer(4010, 4095)))
    inside = (low, choice.integer(1, 35), choice.integer(0, TICK))
    close = (low, 36, pick(choice, (68_000, choice.integer(1, 67_999))))
    change = (4096, choice.integer(1, 35), 0)
    return pick(choice, (inside, change) if continuous else ((low, 0, 0), close, inside, change))


# ---------------------------------------------------------------- comparing


def seeded_cases(count: int, first: int = 0) -> Iterator[Case]:
    return (draw_case(Seeded(3, number)) for number in range(first, first + count))


DEFAULT = 800


@cache
def default_cases() -> list[tuple[Case, Trace]]:
    """Return the cases of the default run and what the oracle says of them."""
    return [(case, run_slowly(case)) for case in seeded_cases(DEFAULT)]


@settings(max_examples=60, deadline=None, derandomize=True, database=None)
@given(st.data())
@pytest.mark.slow
def test_page_equals_the_oracle_over_cases_that_shrink(data: st.DataObject) -> None:
    case = draw_case(Drawn(data))
    assert run_fast(case) == run_slowly(case)


@pytest.mark.slow
def test_page_equals_the_oracle_and_every_outcome_occurs() -> None:
    seen: Counter[str] = Counter()
    for case, slow in default_cases():
        assert run_fast(case) == slow, case
        seen.update(f"{row.kind} {row.outcome}" for row in slow.sightings)
        seen.update(name for name in ("slave", "master", "failed") if getattr(slow, name))
    lost = [f"{kind} out_of_range" for kind in ("ID", "FHS", "POLL", "NULL")]
    taken = [f"{kind} received" for kind in ("ID", "FHS", "POLL", "NULL")]
    others = ["FHS not_tuned", "FHS collided", "ID collided", "slave", "master", "failed"]
    assert all(seen[what] >= 5 for what in (*lost, *taken, *others)), seen


@pytest.mark.soak
@pytest.mark.parametrize("part", range(4))
def test_page_equals_the_oracle_over_ten_thousand_cases(
    part: int, record_property: Callable[[str, object], None]
) -> None:
    count = soak_count(2_500)
    for case in seeded_cases(count, 1_000_000 * (part + 1)):
        assert run_fast(case) == run_slowly(case), case
    record_property("equal page cases", count)
    print(f"{count} page cases equal")


# ---------------------------------------------------------------- planted faults

FAULTS = [
    ("the window opens a tick late", "scanning", "edge + part * WINDOW)", "edge + part * WINDOW + 1)"),
    ("the window closes a tick late", "scanning", "(part + 1) * WINDOW)", "(part + 1) * WINDOW + 1)"),
    ("the window opens 1 ns late", "scanning", "_tick(ph, pm, opening - 1) + 1", "_tick(ph, pm, opening) + 1"),
    ("listening starts 1 ns late", "scanning", "since - 1) + 1", "since) + 1"),
    ("the paged device's block ends a tick late", "scanning", "(block + 1) << 12) - 1)", "(block + 1) << 12))"),
    ("the estimated block ends a tick late", "scanning", "<< 12) - est - 1", "<< 12) - est"),
    ("the train ends a tick late", "scanning", "(turn + 1) * switch - 1", "(turn + 1) * switch"),
    ("the train of the exchange is read too late", "paging", "train(meeting.tick)]", "train(meeting.tick + 4)]"),
    ("the second window is not 16 on", "paging", "meeting.second << 16", "meeting.second << 15"),
    (
        "the response is late by one tick",
        "paging",
        "start + RESPONSE_DELAY, self._respond",
        "start + RESPONSE_DELAY + 312_500, self._respond",
    ),
    ("the first FHS is late by one slot pair", "paging", "self._base + 4, partial", "self._base + 8, partial"),
    ("the FHS goes out three times", "paging", "FHS_TRIES: Final = 4", "FHS_TRIES: Final = 3"),
    (
        "paging goes on a slot pair late",
        "paging",
        "self._fail(self._base + 4 * (n + 1))",
        "self._fail(self._base + 4 * (n + 2))",
    ),
    # 7 and 9 slots make no difference in 60,000 cases: the next ID on the channel comes 10 ms after the last
    ("the response time-out is too long", "paging", "[Time] = 8 * SLOT", "[Time] = 16 * SLOT"),
    ("the connection time-out is short by one slot", "paging", "[Time] = 32 * SLOT", "[Time] = 31 * SLOT"),
    ("there are fifteen POLLs", "paging", "POLL_TRIES: Final = 16", "POLL_TRIES: Final = 15"),
    ("the channel clock stops at 28 bits", "paging", "hop_address, tick)", "hop_address, min(tick, (1 << 28) - 1))"),
    ("the page lasts a slot pair too long", "paging", "2 * settings.timeout_slots", "2 * settings.timeout_slots + 4"),
    ("the exchange under way is cut off", "paging", "max(tick, self.ids.end)", "self.ids.end"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("module", "old", "new"), [fault[1:] for fault in FAULTS], ids=[fault[0] for fault in FAULTS])
def test_a_planted_fault_in_paging_is_found(module: str, old: str, new: str, monkeypatch: pytest.MonkeyPatch) -> None:
    model = plant(monkeypatch, CHAIN, module, old, new)
    assert any(differs(case, slow, model) for case, slow in default_cases())


def differs(case: Case, slow: Trace, model: Any) -> bool:
    try:
        return run_fast(case, model) != slow
    except LocalProtocolError:  # something was to happen in the past
        return True
