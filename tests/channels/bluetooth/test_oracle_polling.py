"""A connected piconet of the channel equals the slot-by-slot oracle: frames, deliveries, fates, losses, counters."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, partial

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.channels.bluetooth.band_channel import Outcome, outcome_of, run_channel
from tests.oracles.band_cases import Case, settled
from tests.oracles.band_scene import ALL, KINDS, Body, Flush, Input, Join, ScanWindows, Scene, Send, Suspend
from tests.oracles.campaign import CLEAR, Choice, Drawn, Outages, Seeded, chance, draw_outages, pick
from tests.oracles.medium import SLOT, TICK, US, Clock
from tests.tiers import soak_count

MASTER = 0


# ---------------------------------------------------------------- drawing cases


def draw_case(choice: Choice) -> Case:
    """Draw cases until the readings settle one of them."""
    while True:
        case = _draw_any_case(choice)
        if settled(case):
            return case


def _draw_any_case(choice: Choice) -> Case:
    """Draw a case; half of them with hosts that act at exact slot instants, outages at frames, time-outs at slots."""
    near = chance(choice, 2)
    ppm = choice.integer(-250, 250)
    slots = pick(choice, (choice.integer(20, 200), choice.integer(200, 1500)))
    base = pick(choice, (choice.integer(0, 1 << 28), (1 << 28) - choice.integer(0, 2 * slots)))
    phase = max(0, base * TICK + pick(choice, (0, 1, -1, choice.integer(0, TICK - 1))))
    clock, end = Clock(phase, ppm), slots * SLOT
    kinds = pick(choice, (tuple(KINDS), ("DM1", "DH1"), ("DM1", "DM3", "DM5"), ("DH5",), ("DH1", "DH3")))
    slaves = pick(choice, (1, 2, 3, choice.integer(1, 7)))
    body = Body(phase, ppm, choice.integer(0, (1 << 32) - 1), ScanWindows(), ScanWindows(2048))
    scene = Scene(
        bodies=(body,) * (1 + slaves),
        radio=CLEAR.radio(1 + slaves),
        inputs=(),
        end=end,
        t_poll=2 * choice.integer(8, 40),
        n_bc=choice.integer(1, 3),
        kinds=kinds,
        supervision=pick(
            choice,
            (20_000_000_000, choice.integer(20_000_000, 400_000_000), choice.integer(30, 300) * SLOT - 126 * US),
        ),
    )
    when = partial(_draw_instant, choice, clock, end, near)
    joins = _draw_joins(choice, clock, scene, when)
    inputs: list[Input] = [*joins, *_draw_sends(choice, scene, [join.slave for join in joins], when)]
    for _ in range(choice.integer(0, 2)):
        source, destination = MASTER, pick(choice, (ALL, pick(choice, joins).slave))
        if chance(choice, 3):
            source, destination = pick(choice, joins).slave, MASTER
        inputs.append(Flush(when(), source, destination))
    if chance(choice, 3):
        begin, until = sorted((when(), when()))
        inputs.append(Suspend(begin, MASTER, until + 1))
    inputs.sort(key=lambda wish: wish.time)
    case = Case(replace(scene, inputs=tuple(inputs)), 1, idle=chance(choice, 2))
    outages = CLEAR
    for _ in range(choice.integer(0, 3) if near or chance(choice, 2) else 0):
        book = case.book()
        if book.seen or book.idle:
            lengths = (1_250_000, min(scene.supervision, scene.end))
            outages = Outages(outages.rows + draw_outages(choice, book.seen + book.idle, lengths).rows)
            case = replace(case, scene=replace(case.scene, radio=outages.radio(1 + slaves)))
    return case


def _draw_instant(choice: Choice, clock: Clock, end: int, near: bool) -> int:
    """Draw an instant; near: within a nanosecond of the start of a slot pair, or of an answer's slot."""
    time = choice.integer(0, end - 1)
    if near and not chance(choice, 4):
        time = clock.start(clock.tick(time) // 4 * 4 + pick(choice, (0, 0, 2))) + pick(choice, (-1, 0, 0, 1))
    return max(0, time)


def _draw_joins(choice: Choice, clock: Clock, scene: Scene, when: Callable[[], int]) -> list[Join]:
    """Draw 1 to 7 slaves with LT_ADDR in any order; most are there from the beginning."""
    addresses = range(1, len(scene.bodies))
    lt_addrs = list(range(1, 8))
    same = choice.integer(0, 2 * scene.t_poll)
    joins = []
    for address in addresses:
        lt_addr = lt_addrs.pop(choice.integer(0, len(lt_addrs) - 1))
        time = 0 if chance(choice, 2) else when() if chance(choice, 2) else choice.integer(0, 20_000_000)
        ahead = pick(choice, (same, 2 * scene.t_poll, choice.integer(0, 2 * scene.t_poll)))
        joins.append(Join(time, MASTER, address, lt_addr, clock.first_transmit_tick(time) + ahead // 4 * 4))
    return joins


def _draw_sends(choice: Choice, scene: Scene, slaves: list[int], when: Callable[[], int]) -> list[Send]:
    """Draw what hosts send: single payloads and bursts, of all lengths that lie at an edge of a packet type."""
    sends: list[Send] = []
    most = max(KINDS[name].capacity for name in scene.kinds)
    for _ in range(choice.integer(0, 8)):
        time = when()
        for _ in range(pick(choice, (1, 1, 2, choice.integer(1, 8)))):
            slave = pick(choice, slaves)
            pairs = ((MASTER, ALL), (MASTER, slave), (slave, MASTER), (slave, MASTER))
            source, destination = pick(choice, pairs)
            if chance(choice, 30):
                source, destination = pick(choice, ((MASTER, 8), (slave, ALL), (slave, slave % 7 + 1)))
            lengths = (0, 1, 17, 18, 27, 28, 121, 122, 183, 184, 224, 225, choice.integer(0, 339))
            length = pick(choice, lengths)
            if not chance(choice, 12):
                length = min(length, most)
            sends.append(Send(time, source, destination, length, len(sends)))
    return sends


# ---------------------------------------------------------------- comparing


def seeded_cases(count: int, first: int = 0) -> Iterator[Case]:
    return (draw_case(Seeded(4, number)) for number in range(first, first + count))


DEFAULT = 300


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
def test_polling_equals_the_oracle_over_cases_that_shrink(data: st.DataObject) -> None:
    case = draw_case(Drawn(data))
    assert run_channel(case) == outcome_of(case)


@pytest.mark.slow
def test_polling_equals_the_oracle_and_every_outcome_occurs() -> None:
    seen: Counter[str] = Counter()
    for case, slow in default_cases():
        assert run_channel(case) == slow, case
        seen.update(row.outcome for row in slow.frames)
        seen.update(row.kind for row in slow.frames)
        seen.update(outcome for *_, outcome in slow.fates)
        seen.update("lost by the master" if owner == MASTER else "lost by a slave" for _, owner, _ in slow.losses)
    outcomes = ("received", "out_of_range", "delivered", "sent", "flushed", "no_link", "too_long")
    others = ("POLL", "NULL", *KINDS, "lost by the master", "lost by a slave")
    assert all(seen[what] >= 5 for what in (*outcomes, *others)), seen
    assert seen["not_tuned"], seen


@pytest.mark.soak
@pytest.mark.parametrize("part", range(4))
def test_polling_equals_the_oracle_over_ten_thousand_cases(
    part: int, record_property: Callable[[str, object], None]
) -> None:
    count = soak_count(2_500)
    for case in seeded_cases(count, 1_000_000 * (part + 1)):
        assert run_channel(case) == outcome_of(case), case
    record_property("equal polling cases", count)
    print(f"{count} polling cases equal")
