"""The page procedure of the channel equals the slot-by-slot oracle, frame for frame, and so does the link after it."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.channels.bluetooth.hopping import train_phase
from tests.channels.bluetooth.band_channel import Outcome, outcome_of, run_channel
from tests.oracles.band_air import Jammer
from tests.oracles.band_cases import Case, settled
from tests.oracles.band_scene import Body, PageFor, Scan, ScanWindows, Scene
from tests.oracles.campaign import CLEAR, Choice, Drawn, Outages, Seeded, chance, draw_noise, draw_outages, nudge, pick
from tests.oracles.medium import TICK, Clock
from tests.tiers import soak_count

PAGER, PAGED = 0, 1


@dataclass(frozen=True)
class Page:
    """One page of one device, and the link that it may bring."""

    phase: int
    ppm: int
    word: int
    start: int
    repetitions: int
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
    noise: tuple[Jammer, ...] = ()

    def case(self) -> Case:
        """Return it as a scene; inquiry scan windows lie half an interval before those for pages."""
        inquiry = ScanWindows((self.offset - self.interval // 2) % self.interval, self.interval)
        page = ScanWindows(self.offset, self.interval, self.interlaced)
        scans = (Scan(0, PAGED, False), Scan(self.begin, PAGED, True)) if self.begin else ()
        inputs = (*scans, PageFor(self.start, PAGER, PAGED, self.estimate))
        scene = Scene(
            bodies=(
                Body(self.phase, self.ppm, self.word, inquiry, page),
                Body(self.paged_phase, self.paged_ppm, self.paged_word, inquiry, page),
            ),
            radio=self.outages.radio(2, self.noise),
            inputs=tuple(sorted(inputs, key=lambda wish: wish.time)),
            end=self.start + (self.timeout + 200) * TICK,
            repetitions=self.repetitions,
            page_timeout=self.timeout,
        )
        return Case(scene, 1)


# ---------------------------------------------------------------- drawing cases


def draw_case(choice: Choice) -> Case:
    """Draw cases until the readings settle one of them."""
    while True:
        case = _draw_page(choice).case()
        if settled(case):
            return case


def _draw_page(choice: Choice) -> Page:
    """Draw a page; half of them near edges; most of these with outages or noise near their own frames."""
    near = chance(choice, 2)
    ppm, paged_ppm = choice.integer(-250, 250), choice.integer(-250, 250)
    start = choice.integer(0, 5_000_000)
    repetitions = pick(choice, (1, 1, 128, 256))
    timeout = 4 * pick(choice, (choice.integer(1, 30), choice.integer(30, 200), choice.integer(200, 600)))
    if repetitions == 128 and chance(choice, 4):  # long enough for a train to end
        timeout = 4096 + 4 * choice.integer(1, 30)
    base = pick(choice, (choice.integer(1, 1 << 28), (1 << 28) - choice.integer(0, timeout)))
    phase = base * TICK + pick(choice, (0, 1, -1, choice.integer(0, TICK - 1))) - start - start * ppm // 1_000_000
    interlaced = chance(choice, 3)
    intervals = (100, 256, 2048, 4096, 8192)
    page = Page(
        phase=max(0, phase),
        ppm=ppm,
        word=choice.integer(0, (1 << 32) - 1),
        start=start,
        repetitions=repetitions,
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
    page = replace(page, offset=choice.integer(0, page.interval - 1))
    page = _focused(choice, page) if near else _estimated(choice, page)
    for _ in range(choice.integer(0, 3) if near else 0):  # one by one: an outage brings about other frames
        frames = page.case().book().seen
        if frames:
            more = draw_outages(choice, frames)
            page = replace(page, outages=Outages(page.outages.rows + more.rows))
    frames = page.case().book().seen if near and chance(choice, 2) else []
    return replace(page, noise=draw_noise(choice, frames)) if frames else page


def _estimated(choice: Choice, page: Page) -> Page:
    """Let the pager know the other's clock more or less, in half of the cases."""
    if chance(choice, 2):
        return page
    pager, paged = Clock(page.phase, page.ppm), Clock(page.paged_phase, page.paged_ppm)
    exact = (paged.tick(page.start) - pager.tick(page.start)) // 4 * 4
    return replace(page, estimate=exact + 4 * pick(choice, (0, 0, 1, -1, choice.integer(-2000, 2000))))


def _focused(choice: Choice, page: Page) -> Page:
    """Let the paged device meet one page ID, near a place where faults hide, at an edge of its own."""
    pager = Clock(page.phase, page.ppm)
    first = pager.first_transmit_tick(page.start)
    switch = 32 * page.repetitions
    places = (
        first,
        first + page.timeout,
        first + switch * choice.integer(1, max(1, page.timeout // switch)),
        choice.integer(first, first + page.timeout),
    )
    focus = min(max(pick(choice, places) + pick(choice, (0, choice.integer(-5, 5))), first), first + page.timeout - 1)
    focus += choice.integer(0, 1) - focus % 4
    # the estimate, so that blocks of the estimated clock change near the focus, or anywhere
    block = pick(choice, (choice.integer(1, 1 << 16), 16 * choice.integer(1, 1 << 12) + 1))
    near_block = (block << 12) + 4 * pick(choice, (0, 0, choice.integer(-5, 5)))
    estimate = pick(choice, (page.estimate, near_block - focus // 4 * 4))
    train: Literal["A", "B"] = "A" if (focus - first) // switch % 2 == 0 else "B"
    second = page.interlaced and chance(choice, 2)
    low, edge, before = _draw_edge(choice, page.interval == 36)
    block = (train_phase(focus + estimate, train) - 16 * second) % 32
    if low == 4096:  # its block begins at the edge, or ends there
        block -= choice.integer(0, 1)
    tick = (pick(choice, (1 << 11, choice.integer(1, 1 << 11))) << 17) + (block << 12) + low
    time = pager.start(focus)
    local = tick * TICK + nudge(choice)
    moment = time + before
    return replace(
        page,
        estimate=estimate,
        paged_phase=local - moment - moment * page.paged_ppm // 1_000_000,
        offset=(tick - edge - 36 * second) % page.interval,
        begin=pick(choice, (0, max(0, time + nudge(choice)), page.start)),
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
def test_page_equals_the_oracle_over_cases_that_shrink(data: st.DataObject) -> None:
    case = draw_case(Drawn(data))
    assert run_channel(case) == outcome_of(case)


@pytest.mark.slow
def test_page_equals_the_oracle_and_every_outcome_occurs() -> None:
    seen: Counter[str] = Counter()
    for case, slow in default_cases():
        assert run_channel(case) == slow, case
        seen.update(f"{row.kind} {row.outcome}" for row in slow.frames)
        seen.update({row[2]: 1 for row in slow.news})
    lost = [f"{kind} out_of_range" for kind in ("ID", "FHS", "POLL", "NULL")]
    taken = [f"{kind} received" for kind in ("ID", "FHS", "POLL", "NULL")]
    others = ["FHS not_tuned", "FHS collided", "ID collided", "slave", "master", "page failed"]
    assert all(seen[what] >= 5 for what in (*lost, *taken, *others)), seen


@pytest.mark.soak
@pytest.mark.parametrize("part", range(4))
def test_page_equals_the_oracle_over_ten_thousand_cases(
    part: int, record_property: Callable[[str, object], None]
) -> None:
    count = soak_count(2_500)
    for case in seeded_cases(count, 1_000_000 * (part + 1)):
        assert run_channel(case) == outcome_of(case), case
    record_property("equal page cases", count)
    print(f"{count} page cases equal")
