"""The connected piconet of cosim equals the slot-by-slot oracle: frames, deliveries, fates, lost links, counters."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any, NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.channels.base import Arrival
from cosim.channels.bluetooth import piconet as fast_piconet
from cosim.channels.bluetooth.clock import NativeClock
from cosim.channels.bluetooth.packets import ACL
from cosim.channels.bluetooth.radio import Air, Frame, Heard
from cosim.errors import LocalProtocolError
from cosim.kernel import WAKE, WORLD, Kernel
from cosim.machine import Address, Fate, LinkEvent, Lost, Outgoing
from tests.oracles import polling as oracle
from tests.oracles.campaign import (
    CLEAR,
    Choice,
    Drawn,
    Outages,
    Seeded,
    chance,
    draw_outages,
    pick,
    plant,
    soak_count,
)
from tests.oracles.medium import SLOT, TICK, US, Clock, Sighting
from tests.oracles.polling import ALL, Flush, Input, Join, Send, Suspend

MASTER = 0
CHAIN = ("scanning", "polling", "frames", "links", "queues", "slots", "piconet")


@dataclass(frozen=True)
class Case:
    """One piconet from time 0 to *end*."""

    phase: int
    ppm: int
    word: int
    inputs: tuple[Input, ...]
    end: int
    t_poll: int
    n_bc: int
    kinds: tuple[str, ...]
    supervision: int
    idle: bool
    """Whether idle polls are recorded, or else counted."""
    outages: Outages = CLEAR


class Trace(NamedTuple):
    """All that must be equal. Deliveries are (time, source, receiver, payload, broadcast)."""

    sightings: list[Sighting]
    deliveries: list[tuple[int, int, int, bytes, bool]]
    verdicts: list[tuple[int, int, int, str]]
    losses: list[tuple[int, int, int]]
    counts: dict[str, int]


def payload_of(wish: Send) -> bytes:
    """Return a payload that tells its token, if it is long enough for that."""
    return (wish.token.to_bytes(2, "big") * wish.length)[: wish.length]


def run_slowly(case: Case) -> Trace:
    piconet = oracle.Piconet(
        MASTER,
        case.word,
        Clock(case.phase, case.ppm),
        case.inputs,
        case.outages.reach,
        0,
        case.end,
        case.t_poll,
        case.n_bc,
        case.kinds,
        case.supervision,
    )
    piconet.run()
    payloads = {wish.token: payload_of(wish) for wish in case.inputs if isinstance(wish, Send)}
    seen = sorted(piconet.sightings + piconet.idle)
    counts = Counter({(row.start, row.kind): row.kind for row in seen}.values())
    counts["idle"] = sum(row.kind == "POLL" for row in piconet.idle)
    return Trace(
        seen if case.idle else piconet.sightings,
        sorted((t, s, r, payloads[token], b) for t, s, r, token, b in piconet.deliveries if t < case.end),
        [(t, owner, token, fate) for t, owner, token, fate in piconet.verdicts if t < case.end],
        [(t, owner, peer) for t, owner, peer in piconet.losses],
        {name: count for name, count in counts.items() if count},
    )


def run_fast(case: Case, model: Any = fast_piconet) -> Trace:
    kernel, trace = Kernel(), Trace([], [], [], [], {})

    def record(frame: Frame, heard: Heard) -> None:
        row = (frame.start, frame.duration, frame.kind, frame.source, frame.destination, frame.channel, heard.value)
        trace.sightings.append(Sighting(*row))

    def deliver(arrivals: Iterable[Arrival], news: Iterable[tuple[Address, LinkEvent]]) -> None:
        for receiver, payload, reception in arrivals:
            trace.deliveries.append((kernel.now, reception.source, receiver, payload, reception.broadcast))
        for owner, event in news:
            if isinstance(event, Fate):
                trace.verdicts.append((kernel.now, owner, event.token, event.outcome.value))
            elif isinstance(event, Lost):
                trace.losses.append((kernel.now, owner, event.peer))

    clock = NativeClock(case.phase, case.ppm)
    air = Air(case.outages.reach, record)
    frames = model.FrameLog(air, clock, case.word, wanted=True, idle_wanted=case.idle)
    parameters = model.PiconetSettings(
        tuple(ACL[name] for name in case.kinds), case.n_bc, case.t_poll, case.supervision
    )
    piconet = model.Piconet(kernel, MASTER, clock, parameters, case.outages.reach, frames, deliver)
    for time in sorted({edge for row in case.outages.rows for edge in row[2:] if 0 <= edge < case.end}):
        kernel.at(time, partial(piconet.reach_changed, time), WORLD)
    for wish in sorted(case.inputs, key=lambda wish: wish.time):
        match wish:
            case Join(time, address, lt_addr, due):
                kernel.at(time, partial(piconet.add_slave, address, lt_addr, due), WAKE)
            case Send(time, source, destination):
                outgoing = Outgoing(destination, payload_of(wish), wish.token)
                kernel.at(time, partial(piconet.send, source, outgoing), WAKE)
            case Flush(time, source, destination):
                kernel.at(time, partial(piconet.flush, source, destination), WAKE)
            case Suspend(time, until):
                kernel.at(time, piconet.suspend, WAKE)
                kernel.at(until, piconet.resume, WAKE)
    kernel.run(case.end)
    trace.counts.update({name: count for name, count in piconet.counts().items() if count})
    for rows in trace[:4]:
        rows.sort()
    return trace


# ---------------------------------------------------------------- drawing cases


def draw_case(choice: Choice) -> Case:
    """Draw a case; half of them with hosts that act at exact slot instants, outages at frames, time-outs at slots."""
    near = chance(choice, 2)
    ppm = choice.integer(-250, 250)
    slots = pick(choice, (choice.integer(20, 200), choice.integer(200, 1500)))
    base = pick(choice, (choice.integer(0, 1 << 28), (1 << 28) - choice.integer(0, 2 * slots)))
    phase = max(0, base * TICK + pick(choice, (0, 1, -1, choice.integer(0, TICK - 1))))
    clock, end = Clock(phase, ppm), slots * SLOT
    kinds = pick(choice, (tuple(oracle.KINDS), ("DM1", "DH1"), ("DM1", "DM3", "DM5"), ("DH5",), ("DH1", "DH3")))
    case = Case(
        phase=phase,
        ppm=ppm,
        word=choice.integer(0, (1 << 32) - 1),
        inputs=(),
        end=end,
        t_poll=2 * choice.integer(8, 40),
        n_bc=choice.integer(1, 3),
        kinds=kinds,
        supervision=pick(
            choice,
            (20_000_000_000, choice.integer(20_000_000, 400_000_000), choice.integer(30, 300) * SLOT - 126 * US),
        ),
        idle=chance(choice, 2),
    )
    when = partial(_draw_instant, choice, clock, end, near)
    joins = _draw_joins(choice, clock, case, when)
    inputs: list[Input] = [*joins, *_draw_sends(choice, case, [join.address for join in joins], when)]
    for _ in range(choice.integer(0, 2)):
        source, destination = MASTER, pick(choice, (ALL, pick(choice, joins).address))
        if chance(choice, 3):
            source, destination = pick(choice, joins).address, MASTER
        inputs.append(Flush(when(), source, destination))
    if chance(choice, 3):
        begin, until = sorted((when(), when()))
        inputs.append(Suspend(begin, until + 1))
    case = replace(case, inputs=tuple(inputs))
    for _ in range(choice.integer(0, 3) if near or chance(choice, 2) else 0):
        frames = run_slowly(replace(case, idle=True)).sightings
        if frames:
            more = draw_outages(choice, frames, (1_250_000, min(case.supervision, case.end)))
            case = replace(case, outages=Outages(case.outages.rows + more.rows))
    return case


def _draw_instant(choice: Choice, clock: Clock, end: int, near: bool) -> int:
    """Draw an instant; near: within a nanosecond of the start of a slot pair, or of an answer's slot."""
    time = choice.integer(0, end - 1)
    if near and not chance(choice, 4):
        time = clock.start(clock.tick(time) // 4 * 4 + pick(choice, (0, 0, 2))) + pick(choice, (-1, 0, 0, 1))
    return max(0, time)


def _draw_joins(choice: Choice, clock: Clock, case: Case, when: Callable[[], int]) -> list[Join]:
    """Draw 1 to 7 slaves with LT_ADDR in any order; most are there from the beginning."""
    addresses = list(range(1, pick(choice, (1, 2, 3, choice.integer(1, 7))) + 1))
    lt_addrs = list(range(1, 8))
    same = choice.integer(0, 2 * case.t_poll)
    joins = []
    for address in addresses:
        lt_addr = lt_addrs.pop(choice.integer(0, len(lt_addrs) - 1))
        time = 0 if chance(choice, 2) else when() if chance(choice, 2) else choice.integer(0, 20_000_000)
        ahead = pick(choice, (same, 2 * case.t_poll, choice.integer(0, 2 * case.t_poll)))
        joins.append(Join(time, address, lt_addr, (clock.tick(time) + ahead) // 4 * 4))
    return joins


def _draw_sends(choice: Choice, case: Case, slaves: list[int], when: Callable[[], int]) -> list[Send]:
    """Draw what hosts send: single payloads and bursts, of all lengths that lie at an edge of a packet type."""
    sends: list[Send] = []
    most = max(oracle.KINDS[name].capacity for name in case.kinds)
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
def default_cases() -> list[tuple[Case, Trace]]:
    """Return the cases of the default run and what the oracle says of them."""
    return [(case, run_slowly(case)) for case in seeded_cases(DEFAULT)]


@settings(max_examples=60, deadline=None, derandomize=True, database=None)
@given(st.data())
@pytest.mark.slow
def test_polling_equals_the_oracle_over_cases_that_shrink(data: st.DataObject) -> None:
    case = draw_case(Drawn(data))
    assert run_fast(case) == run_slowly(case)


@pytest.mark.slow
def test_polling_equals_the_oracle_and_every_outcome_occurs() -> None:
    seen: Counter[str] = Counter()
    for case, slow in default_cases():
        assert run_fast(case) == slow, case
        seen.update(row.outcome for row in slow.sightings)
        seen.update(row.kind for row in slow.sightings)
        seen.update(outcome for *_, outcome in slow.verdicts)
        seen.update("lost by the master" if owner == MASTER else "lost by a slave" for _, owner, _ in slow.losses)
    outcomes = ("received", "out_of_range", "delivered", "sent", "flushed", "no_link", "too_long")
    others = ("POLL", "NULL", *oracle.KINDS, "lost by the master", "lost by a slave")
    assert all(seen[what] >= 5 for what in (*outcomes, *others)), seen
    assert seen["not_tuned"], seen


@pytest.mark.soak
@pytest.mark.parametrize("part", range(4))
def test_polling_equals_the_oracle_over_ten_thousand_cases(
    part: int, record_property: Callable[[str, object], None]
) -> None:
    count = soak_count(2_500)
    for case in seeded_cases(count, 1_000_000 * (part + 1)):
        assert run_fast(case) == run_slowly(case), case
    record_property("equal polling cases", count)
    print(f"{count} polling cases equal")


# ---------------------------------------------------------------- planted faults

FAULTS = [
    ("T_poll is long by one slot", "polling", "2 * t_poll_slots", "2 * t_poll_slots + 2"),
    ("payloads go before overdue polls", "polling", "head if k == NOTHING else k", "k if head == NOTHING else head"),
    ("of equals the last is polled", "polling", "due[k] < due[best]", "due[k] <= due[best]"),
    ("idle slots go on one too far", "polling", "or tick >= end", "or tick > end"),
    ("after an answer a slot pair is lost", "polling", "tick + 2 * slots\n", "tick + 2 * slots + 4\n"),
    (
        "the master forgets to repeat SEQN",
        "polling",
        "if first:\n        links[SEQ_DOWN, k] ^= 1",
        "links[SEQ_DOWN, k] ^= 1",
    ),
    ("the slave's SEQN does not change", "polling", "links[SEQ_UP, k] ^= 1", "links[SEQ_UP, k] ^= 0"),
    ("ARQN outlives its packet", "polling", "links[ARQN, k] = 0\n    piconet[NEXT]", "piconet[NEXT]"),
    ("ticks begin 1 ns late", "polling", "return time\n", "return time + 1\n"),
    ("the channel clock stops at 28 bits", "frames", "hop_address, tick)", "hop_address, min(tick, (1 << 28) - 1))"),
    ("a slot at its very start is over", "scanning", "clock.tick(now - 1)", "clock.tick(now)"),
    ("slots are decided before hosts act", "slots", "self._decide, AIR)", "self._decide)"),
    ("one broadcast too many", "slots", ">= self._n_bc", "> self._n_bc"),
    ("repeated broadcasts are delivered again", "slots", "got & ~payload.taken", "got"),
    (
        "supervision is long by 1 ns",
        "piconet",
        "deadline = heard + self._settings.supervision",
        "deadline = heard + self._settings.supervision + 1",
    ),
    ("what has been on the air is flushed", "piconet", " and not p.tries", ""),
    (
        "a resumed piconet waits a slot pair",
        "piconet",
        "int(self.links.piconet[NEXT]), first)",
        "int(self.links.piconet[NEXT]), first + 4)",
    ),
    ("broadcasts outlive the last link", "queues", "master_alone and p.lt_addr", "not master_alone and p.lt_addr"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("module", "old", "new"), [fault[1:] for fault in FAULTS], ids=[fault[0] for fault in FAULTS])
def test_a_planted_fault_in_polling_is_found(module: str, old: str, new: str, monkeypatch: pytest.MonkeyPatch) -> None:
    model = plant(monkeypatch, CHAIN, module, old, new)
    assert any(differs(case, slow, model) for case, slow in default_cases())


def differs(case: Case, slow: Trace, model: Any) -> bool:
    try:
        return run_fast(case, model) != slow
    except (LocalProtocolError, IndexError):  # something was to happen in the past, or taken from an empty queue
        return True
