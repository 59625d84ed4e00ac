"""Random scenes for the oracle of the whole band, most of them near edges.

Masters' slots nearly coincide, hop sequences are equal or often meet, powers stand at the thresholds, powers change and
radios go off and on within a nanosecond of frames.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf

import numpy as np

from cosim.channels.bluetooth.hopping import basic_channel
from cosim.randomness import Draws
from tests.oracles.band import live
from tests.oracles.band_air import Jammer, Matrix, Radio
from tests.oracles.band_scene import (
    ALL,
    KINDS,
    Body,
    Book,
    Flush,
    Input,
    Inquire,
    Join,
    PageFor,
    Scan,
    ScanWindows,
    Scene,
    Seen,
    Send,
    Share,
    Suspend,
)
from tests.oracles.campaign import Choice, chance, pick
from tests.oracles.medium import SLOT, TICK, US, Clock

PAIR = 4 * TICK
EDGES = (0, 68 * US, 72 * US, 126 * US, 366 * US, SLOT, SLOT - 366 * US)
"""By how much slot pairs may be apart for something to happen at the same time."""
STEPS_DB = (0.0, 0.0, 0.0, -11.0, -10.999, -11.001, 0.001, -0.001, 30.0, 29.999, 30.001, 40.0, 40.001, 60.0, -8.0)
"""By how much one power differs from another, so that C/I is at a threshold."""
ES_N0_DB = (9.0, 10.5, 12.0, 13.5, 16.0, 30.0, 30.0, 100.0, 100.0)
FAINT_DB = (0.0, -0.001, 0.001, 4.0)
WORDS = (0x2A96EF25, 0x6587CBA9, 0x00000000, 0x9E8B33)


@dataclass(frozen=True)
class Case:
    """A scene, and how long back-offs are at most, so that a short case holds several."""

    scene: Scene
    longest_backoff: int
    coarse: bool = False
    """Whether back-offs are 0 or 1 more than multiples of 16 slots, which bring the same ID again."""

    def draw(self, device: int, bound: int, tick: int) -> int:
        return self.backoff(device, bound, tick, 0, 1)

    def backoff(self, device: int, bound: int, number: int, link: int, purpose: int) -> int:
        """Return a number of slots that depends on all arguments."""
        draws = Draws(7, "backoff", device)
        slots = draws.below(min(self.longest_backoff, bound), number, 1000 * link + bound, purpose)
        return slots // 16 * 16 + slots % 2 if self.coarse else slots

    def book(self) -> Book:
        return live(self.scene, self.draw)


def draw_case(choice: Choice) -> Case:
    """Draw cases until the readings settle one of them."""
    while True:
        case = draw_any_case(choice)
        if settled(case):
            return case


def settled(case: Case) -> bool:
    """Return whether the readings tell all that happens: not, if a link times out in the instant of a host's act."""
    book = case.book()
    acts = {wish.time for wish in case.scene.inputs}
    return not book.doubts and not any(loss.time in acts for loss in book.losses)


def draw_any_case(choice: Choice) -> Case:
    """Draw a case, then what happens near the frames that it has without it."""
    kinds = pick(choice, (tuple(KINDS), ("DM1", "DH1"), ("DM1", "DM3", "DM5"), ("DH5",), ("DH1", "DH3")))
    end = pick(choice, (choice.integer(16, 40), choice.integer(40, 120), choice.integer(60, 240))) * SLOT
    roles = _Roles(choice)
    bodies = _draw_bodies(choice, roles, end)
    supervision = 20_000_000_000
    if chance(choice, 4):
        supervision = choice.integer(10_000_000, end)
    scene = Scene(
        bodies=bodies,
        radio=Radio(((0, ()),)),
        inputs=(),
        end=end,
        t_poll=2 * choice.integer(8, pick(choice, (12, 40))),
        n_bc=choice.integer(1, 3),
        kinds=kinds,
        supervision=supervision,
        n_inquiry=pick(choice, (1, 1, 2, 256)),
        first_train=pick(choice, ("A", "B")),
        repetitions=pick(choice, (1, 1, 128)),
        page_timeout=4 * pick(choice, (4096, choice.integer(5, 60))),
    )
    scene = replace(scene, inputs=_draw_inputs(choice, scene, roles))
    jammers = chance(choice, 3) * choice.integer(1, 2)
    scene = replace(scene, radio=_draw_radio(choice, len(bodies), jammers, roles))
    case = Case(scene, pick(choice, (1, 4, 32, 1024)))
    book = case.book()
    return replace(case, scene=_near_frames(choice, scene, book.seen + book.idle)) if book.seen or book.idle else case


# ---------------------------------------------------------------- who is who


class _Roles:
    """Who is the master of whom, who searches, and who can be found."""

    def __init__(self, choice: Choice) -> None:
        count = pick(choice, (1, 1, 2, 2, 2, 3, 4))
        self.slaves: dict[int, list[int]] = {}
        self.size = 0
        self.bridged = chance(choice, 3)
        self.twins = not self.bridged and chance(choice, 2)
        """Masters hop alike and poll at the same time."""
        for _ in range(count):
            master = self._new()
            most = pick(choice, (1, 1, 2, 3)) if count > 1 else pick(choice, (1, 2, 7))
            self.slaves[master] = [self._new() for _ in range(most)]
        if self.bridged:
            self._bridge(choice)
        searches = pick(choice, (0, 1, 2) if count == 2 else (0, 1))
        self.inquirers = [self._new() for _ in range(searches if chance(choice, 2) else 0)]
        self.pagers = [self._new() for _ in range(searches if not self.inquirers or chance(choice, 3) else 0)]
        self.found = [self._new() for _ in range(choice.integer(1, 3) if self.inquirers or self.pagers else 0)]
        linked = [slave for slaves in self.slaves.values() for slave in slaves]
        self.asking = [pick(choice, linked)] if self.pagers and not self.bridged and chance(choice, 3) else []
        """Slaves that can be paged, too."""
        if self.pagers and chance(choice, 4):  # a slave that pages
            self.pagers[0] = pick(choice, [slave for slave in linked if slave not in self.asking] or self.pagers)

    def _new(self) -> int:
        self.size += 1
        return self.size - 1

    def _bridge(self, choice: Choice) -> None:
        """Let masters or slaves be slaves of other masters, too, none twice in one piconet."""
        for _ in range(choice.integer(1, 2)):
            masters = list(self.slaves)
            master = pick(choice, masters)
            others = [device for device in range(self.size) if device != master]
            other = pick(choice, others)
            linked = other in self.slaves[master] or master in self.slaves.get(other, [])
            if not linked and len(self.slaves[master]) < 7:
                self.slaves[master].append(other)

    @property
    def links(self) -> list[tuple[int, int]]:
        return [(master, slave) for master, slaves in self.slaves.items() for slave in slaves]

    @property
    def speaking(self) -> list[int]:
        """Those whose clocks decide when something is sent."""
        return [*self.slaves, *self.inquirers, *self.pagers]


# ---------------------------------------------------------------- clocks and addresses


def _draw_bodies(choice: Choice, roles: _Roles, end: int) -> tuple[Body, ...]:
    """Draw devices with nearly coinciding slots, some of them with equal or similar hop sequences."""
    high = pick(choice, (choice.integer(0, 1 << 26), (1 << 26) - choice.integer(0, 50)))  # or the clock wraps
    if chance(choice, 2):  # soon bits 16-12 change
        high = (choice.integer(1, 1 << 16) << 10) - choice.integer(0, 40)
    base = high * PAIR + choice.integer(0, PAIR - 1)
    interval, interlaced = pick(choice, ((36, False), (36, False), (100, False), (72, True), (256, True)))
    page = pick(choice, ((36, False), (36, False), (72, True), (256, False)))
    version = "1.2" if interlaced else pick(choice, ("1.1", "1.2"))
    drifts = (0,) if roles.twins else pick(choice, ((0,), (-20, 0, 20), (-250, 0, 250, choice.integer(-250, 250))))
    bodies: list[Body] = []
    for address in range(roles.size):
        edge = pick(choice, EDGES) * pick(choice, (1, -1)) + pick(choice, (-1, 0, 0, 1))
        phase = base + pick(choice, (edge, edge, choice.integer(0, PAIR)))
        word = pick(choice, (*WORDS, choice.integer(0, (1 << 32) - 1)))
        if address in roles.slaves and roles.twins:
            phase, word = base + edge, bodies[0].word if bodies else word
        elif address in roles.speaking and bodies and chance(choice, 2):
            word = _similar_word(choice, bodies[0], phase, end)
        elif chance(choice, 3):  # another clock
            phase += PAIR * choice.integer(0, 1 << 26)
        offset = choice.integer(0, interval - 1)
        half = (offset + interval // 2) % page[0]  # page scan windows lie half an interval behind those for inquiries
        scans = ScanWindows(offset, interval, interlaced, version), ScanWindows(half, *page)
        bodies.append(Body(max(0, phase), pick(choice, drifts), word, *scans))
    return tuple(bodies)


def _similar_word(choice: Choice, other: Body, phase: int, end: int) -> int:
    """Return the hop address of *other*, or of many one whose channels are often near those of *other*."""
    if chance(choice, 2):
        return other.word
    ticks = np.arange(0, end // TICK, 2)
    theirs = basic_channel(other.word, ticks + other.phase // TICK)
    words = [choice.integer(0, (1 << 32) - 1) for _ in range(20)]

    def meetings(word: int) -> int:
        return int((np.abs(basic_channel(word, ticks + phase // TICK) - theirs) <= 2).sum())

    return max(words, key=meetings)


# ---------------------------------------------------------------- hosts


def _draw_inputs(choice: Choice, scene: Scene, roles: _Roles) -> tuple[Input, ...]:
    clocks = [Clock(body.phase, body.ppm) for body in scene.bodies]
    joins = _draw_joins(choice, scene, roles, clocks)
    when = partial(_draw_instant, choice, scene.end, [clocks[master] for master in roles.slaves])
    inputs: list[Input] = [*joins, *_draw_sends(choice, scene, roles, when)]
    for _ in range(choice.integer(0, 2)):
        master, slave = pick(choice, roles.links)
        pairs = ((master, ALL), (master, slave), (slave, master), (slave, master))
        inputs.append(Flush(when(), *pick(choice, pairs)))
    if not roles.bridged and chance(choice, 4):
        begin, until = sorted((when(), when()))
        inputs.append(Suspend(begin, pick(choice, list(roles.slaves)), until + 1))
    if roles.bridged and not chance(choice, 4):
        inputs += _draw_shares(choice, scene, roles, when)
    inputs += [Scan(when(), slave, True) for slave in roles.asking]
    inputs += _draw_searches(choice, scene, roles, clocks)
    return tuple(sorted(inputs, key=lambda wish: wish.time))


def _draw_joins(choice: Choice, scene: Scene, roles: _Roles, clocks: Sequence[Clock]) -> list[Join]:
    joins = []
    same = choice.integer(1, 2 * scene.t_poll)
    for master, slaves in roles.slaves.items():
        lt_addrs = list(range(1, 8))
        for number, slave in enumerate(slaves):
            lt_addr = lt_addrs.pop(choice.integer(0, len(lt_addrs) - 1))
            time = pick(choice, (0, 0, 0, choice.integer(0, scene.end // 3)))
            ahead = pick(choice, (0, 8, 2 * scene.t_poll, choice.integer(0, 2 * scene.t_poll)))
            if roles.twins and chance(choice, 2):
                time, ahead = 0, same + 8 * number
            joins.append(Join(time, master, slave, lt_addr, (clocks[master].tick(time) + ahead + 3) // 4 * 4))
    return joins


def _draw_instant(choice: Choice, end: int, clocks: Sequence[Clock]) -> int:
    """Draw an instant, most likely within a nanosecond of a slot."""
    time = choice.integer(0, end - 1)
    if chance(choice, 4):
        return time
    clock = pick(choice, clocks)
    time = clock.start(clock.tick(time) // 2 * 2) + pick(choice, (-1, 0, 0, 1, 126_000, 125_999))
    return min(max(0, time), end - 1)


def _draw_sends(choice: Choice, scene: Scene, roles: _Roles, when: Callable[[], int]) -> list[Send]:
    sends: list[Send] = []
    most = max(KINDS[name].capacity for name in scene.kinds)
    for _ in range(choice.integer(0, 8)):
        time = when()
        same = pick(choice, roles.links)
        for _ in range(pick(choice, (1, 1, 2, choice.integer(1, 6)))):
            master, slave = same if chance(choice, 3) else pick(choice, roles.links)
            source, destination = pick(choice, ((master, ALL), (master, slave), (slave, master), (slave, master)))
            lengths = (0, 17, 18, 27, 28, 121, 183, 224, 339, choice.integer(0, 339))
            length = min(pick(choice, lengths), most + chance(choice, 20))
            sends.append(Send(time, source, destination, length, len(sends)))
    return sends


def _draw_shares(choice: Choice, scene: Scene, roles: _Roles, when: Callable[[], int]) -> list[Share]:
    """Give those in several piconets their parts, most of them such that all members of a piconet share theirs."""
    period = 2 * pick(choice, (choice.integer(8, 20), choice.integer(20, 64)))
    reference = choice.integer(0, roles.size - 1)
    count = len(roles.slaves)
    parts = {}
    for number, master in enumerate(roles.slaves):
        first = period * number // count + pick(choice, (0, 0, choice.integer(0, 4)))
        parts[master] = (master, first, period // count + pick(choice, (0, 0, -1, choice.integer(-8, 8))))
    shares = []
    for device in range(roles.size):
        own = [parts[m] for m, slaves in roles.slaves.items() if device == m or device in slaves]
        if len(own) > 1 or (own and chance(choice, 4)):
            time = pick(choice, (0, 0, when()))
            given = tuple(own) if not chance(choice, 8) else tuple(own[1:])
            shares.append(Share(time, device, period, given, reference))
            if chance(choice, 6):
                shares.append(Share(when(), device, period, (), reference))
    return shares


def _draw_searches(choice: Choice, scene: Scene, roles: _Roles, clocks: Sequence[Clock]) -> list[Input]:
    searches: list[Input] = []
    for device in roles.inquirers:
        time = pick(choice, (0, choice.integer(0, scene.end // 4)))
        duration = 4 * pick(choice, (choice.integer(1, 20), scene.end // PAIR))
        searches.append(Inquire(time, device, duration, choice.integer(1, 3)))
    for device in roles.pagers:
        peer = pick(choice, [*roles.found, *roles.asking])
        time = pick(choice, (0, choice.integer(0, scene.end // 4), choice.integer(0, scene.end // 2)))
        exact = (clocks[peer].tick(time) - clocks[device].tick(time)) // 4 * 4
        offset = exact + pick(choice, (0, 0, 0, 4, -4, 4096, -4096, 4 * choice.integer(-40_000, 40_000)))
        searches.append(PageFor(time, device, peer, offset))
    return searches


# ---------------------------------------------------------------- powers


def _draw_radio(choice: Choice, devices: int, jammers: int, roles: _Roles) -> Radio:
    key = (choice.integer(0, (1 << 32) - 1), choice.integer(0, (1 << 32) - 1))
    mode = pick(choice, ("none", "co_channel", "neighbouring", "neighbouring"))
    if chance(choice, 2 if len(roles.slaves) == 1 else 5):
        powers = _discs(choice, devices, jammers)
        return Radio(((0, powers),), mode=mode, key=key, jammers=_draw_jammers(choice, jammers))
    base = float(pick(choice, (-60, -53, choice.integer(-80, -30))))
    powers = _draw_matrix(choice, base, devices, jammers)
    noise = base - pick(choice, FAINT_DB if chance(choice, 10) else ES_N0_DB)
    return Radio(((0, powers),), (), noise, mode, _draw_jammers(choice, jammers), key)


def _discs(choice: Choice, devices: int, jammers: int) -> Matrix:
    gaps = pick(choice, (10, 1_000))
    return tuple(
        tuple(-inf if a == b or chance(choice, gaps) else 0.0 for b in range(devices)) for a in range(devices + jammers)
    )


def _draw_matrix(choice: Choice, base: float, devices: int, jammers: int) -> Matrix:
    """Draw powers that differ from *base* by thresholds; in half of the cases both ways equally."""
    steps = pick(choice, (STEPS_DB, (0.0,), (0.0, 0.0, 0.0, 0.0, 3.0, -3.0, -11.0)))
    rows = [[base + pick(choice, steps) for _ in range(devices)] for _ in range(devices + jammers)]
    if chance(choice, 2):
        for a in range(devices):
            for b in range(a):
                rows[a][b] = rows[b][a]
    for a in range(devices):
        rows[a][a] = -inf
    return tuple(tuple(row) for row in rows)


def _draw_jammers(choice: Choice, count: int) -> tuple[Jammer, ...]:
    jammers = []
    for _ in range(count):
        first = choice.integer(0, 78)
        channels = pick(choice, (tuple(range(79)), tuple(range(first, 79)), (first,)))
        start = choice.integer(0, 10_000_000)
        until = start + choice.integer(1, 100_000_000)
        mode = pick(choice, ("constant", "sweeping", "sweeping", "pulsed"))
        on = choice.integer(1, 2_000_000)
        dwell = pick(choice, (TICK, SLOT, choice.integer(50_000, 3_000_000)))
        period = on + choice.integer(50_000, 5_000_000)
        jammers.append(Jammer(mode, start, until, channels, dwell, on, period))
    return tuple(jammers)


class _Near:
    """Instants near frames of a scene; every kind of frame is as likely as any other."""

    def __init__(self, choice: Choice, frames: Sequence[Seen]) -> None:
        self.choice = choice
        self.frames = frames
        self.kinds = sorted({frame.kind for frame in frames})

    def frame(self) -> Seen:
        kind = pick(self.choice, self.kinds)
        return pick(self.choice, [frame for frame in self.frames if frame.kind == kind])

    def instant(self) -> int:
        """Return an instant within a nanosecond of an edge of a frame, or one within the frame."""
        frame = self.frame()
        inside = self.choice.integer(0, frame.duration)
        edges = (0, 0, 68_000, 72_000, 126_000, frame.duration, frame.duration, inside)
        return max(1, frame.start + pick(self.choice, edges) + pick(self.choice, (-1, 0, 1)))


def _near_frames(choice: Choice, scene: Scene, frames: Sequence[Seen]) -> Scene:
    """Let powers change, jammers come and hosts act within a nanosecond of frames, and links time out there."""
    near, radio = _Near(choice, frames), scene.radio
    powers = list(radio.powers)
    for time in sorted({near.instant() for _ in range(choice.integer(0, 3))}):
        powers.append((time, _changed(choice, powers[-1][1], len(scene.bodies))))
    jammers = tuple(_jammer_at(choice, jammer, near) if chance(choice, 2) else jammer for jammer in radio.jammers)
    radio = replace(radio, powers=tuple(powers), switches=_draw_switches(choice, scene, near), jammers=jammers)
    inputs: list[Input] = [*scene.inputs, *_draw_late_wishes(choice, scene, near)]
    return replace(
        scene,
        radio=radio,
        inputs=tuple(sorted(inputs, key=lambda wish: wish.time)),
        supervision=_draw_supervision(choice, scene, near),
    )


def _jammer_at(choice: Choice, jammer: Jammer, near: _Near) -> Jammer:
    """Return a jammer that just hits or just misses a frame."""
    frame = near.frame()
    length = choice.integer(1, frame.duration)
    start = frame.start + pick(choice, (-length, -length, frame.duration, 72_000, 126_000)) + pick(choice, (-1, 0, 1))
    until = start + length
    edge = choice.integer(0, length)
    turn = max(1, pick(choice, (length, edge, length // 3)))
    return replace(
        jammer, start=max(0, start), until=max(1, until), channels=(frame.channel,), on=turn, period=turn + 50_000
    )


def _draw_switches(choice: Choice, scene: Scene, near: _Near) -> tuple[tuple[int, int, bool], ...]:
    switches: list[tuple[int, int, bool]] = []
    for _ in range(choice.integer(1, 2) if chance(choice, 4) else 0):
        device, off = choice.integer(0, len(scene.bodies) - 1), near.instant()
        again = max(off + 1, pick(choice, (near.instant(), off + choice.integer(1, 2_000_000))))
        if all(device != other for _, other, _ in switches):
            switches += [(off, device, False), (again, device, True)]
    return tuple(sorted(switches))


def _draw_late_wishes(choice: Choice, scene: Scene, near: _Near) -> list[Input]:
    """Let hosts send or flush near frames."""
    wishes: list[Input] = []
    token = sum(isinstance(wish, Send) for wish in scene.inputs)
    for _ in range(choice.integer(0, 2)):
        frame, time = near.frame(), near.instant()
        if frame.kind in ("ID", "FHS") or time >= scene.end:
            continue
        ends = pick(choice, ((frame.source, frame.destination), (frame.destination, frame.source)))
        wishes.append(Flush(time, *ends) if chance(choice, 2) else Send(time, *ends, 17, token + len(wishes)))
    return wishes


def _draw_supervision(choice: Choice, scene: Scene, near: _Near) -> int:
    """Return a time-out that ends with a frame, or within a nanosecond of that, or the one there is."""
    if not chance(choice, 4):
        return scene.supervision
    first = near.frame()
    later = [
        frame
        for frame in near.frames
        if (frame.source, frame.destination) == (first.source, first.destination) and frame.start > first.start
    ]
    if not later:
        return scene.supervision
    last = pick(choice, later)
    return last.start + last.duration - first.start - first.duration + pick(choice, (-1, 0, 0, 1, -last.duration))


def _changed(choice: Choice, matrix: Matrix, devices: int) -> Matrix:
    """Return other powers: some links a few decibels or a threshold more or less, or one gone."""
    rows = [list(row) for row in matrix]
    for _ in range(choice.integer(1, 4)):
        a, b = choice.integer(0, len(rows) - 1), choice.integer(0, devices - 1)
        if a == b:
            continue
        if rows[a][b] == -inf:
            rows[a][b] = max(max(row) for row in rows)
        else:
            rows[a][b] = pick(choice, (rows[a][b] + pick(choice, STEPS_DB), -inf, rows[a][b] - 3.0))
        if chance(choice, 2) and a < devices:
            rows[b][a] = rows[a][b]
    return tuple(tuple(row) for row in rows)
