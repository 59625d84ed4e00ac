"""Random scenes for the oracle of the whole band, most of them near edges.

Masters' slots nearly coincide, hop sequences are equal or often meet, powers stand at the thresholds, powers change and
radios go off and on within a nanosecond of frames.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from cosim.channels.bluetooth.hopping import basic_channel
from cosim.randomness import Draws
from tests.oracles.band import live
from tests.oracles.band_air import Radio
from tests.oracles.band_flow import lose_stops, rejoin, slow_hosts
from tests.oracles.band_powers import draw_radio, near_frames
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
    Send,
    Share,
    Suspend,
)
from tests.oracles.campaign import Choice, chance, pick
from tests.oracles.medium import SLOT, TICK, US, Clock

PAIR = 4 * TICK
EDGES = (0, 68 * US, 72 * US, 126 * US, 366 * US, SLOT, SLOT - 366 * US)
"""By how much slot pairs may be apart for something to happen at the same time."""
WORDS = (0x2A96EF25, 0x6587CBA9, 0x00000000, 0x9E8B33)


@dataclass(frozen=True)
class Case:
    """A scene, and how long back-offs are at most, so that a short case holds several."""

    scene: Scene
    longest_backoff: int
    coarse: bool = False
    """Whether back-offs are 0 or 1 more than multiples of 16 slots, which bring the same ID again."""
    idle: bool = True
    """Whether idle frames are recorded, or else counted: a piconet that is alone may take its shortcut then."""

    def draw(self, device: int, bound: int, tick: int) -> int:
        return self.backoff(device, bound, tick, 0, 1)

    def backoff(self, device: int, bound: int, number: int, link: int, purpose: int) -> int:
        """Return a number of slots that depends on all arguments."""
        draws = Draws(7, "backoff", device)
        slots = draws.below(min(self.longest_backoff, bound), number, 1000 * link + bound, purpose)
        return slots // 16 * 16 + slots % 2 if self.coarse else slots

    def book(self, watched: bool = False) -> Book:
        return live(self.scene, self.draw, watched)


def draw_case(choice: Choice) -> Case:
    """Draw cases until the readings settle one of them; one in four gets slow hosts."""
    case = draw_any_case(choice)
    while not settled(case):
        case = draw_any_case(choice)
    return draw_slow_hosts(choice, case) if chance(choice, 4) else case


def draw_slow_hosts(choice: Choice, fast: Case) -> Case:
    """Return *fast* with hosts that are slow, if possible so that they stop somebody and the readings settle it."""
    found = fast
    for _ in range(6):
        case = replace(fast, scene=slow_hosts(choice, fast.scene))
        flow = case.book().flow
        case = replace(case, scene=lose_stops(choice, case.scene, flow))
        if chance(choice, 2):
            case = replace(case, scene=rejoin(choice, case.scene, case.book().losses))
        if settled(case):
            found = case
            if flow:
                break
    return found


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
    if roles.lone:
        end = choice.integer(60, 200) * SLOT
    elif chance(choice, 20):
        end = choice.integer(240, 1_200) * SLOT
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
    jammers = 0 if roles.lone else chance(choice, 3) * choice.integer(1, 2)
    searched = bool(roles.inquirers or roles.pagers)
    scene = replace(scene, radio=draw_radio(choice, len(bodies), jammers, 1 if roles.lone else 5, searched))
    case = Case(scene, pick(choice, (1, 4, 32, 1024)), idle=chance(choice, 2))
    book = case.book()
    frames = book.seen + book.idle
    return replace(case, scene=near_frames(choice, scene, frames, roles.lone)) if frames else case


# ---------------------------------------------------------------- who is who


class _Roles:
    """Who is the master of whom, who searches, and who can be found."""

    def __init__(self, choice: Choice) -> None:
        self.lone = chance(choice, 4)
        """One piconet without noise; in the midst of its traffic others begin to send on its channels."""
        count = pick(choice, (1, 2) if self.lone else (1, 1, 2, 2, 2, 3, 4))
        self.slaves: dict[int, list[int]] = {}
        self.size = 0
        self.bridged = not self.lone and chance(choice, 3)
        self.twins = self.lone or (not self.bridged and chance(choice, 2))
        """Masters hop alike and poll at the same time."""
        for _ in range(count):
            master = self._new()
            most = pick(choice, (1, 1, 2, 3)) if count > 1 else pick(choice, (1, 2, 7))
            self.slaves[master] = [self._new() for _ in range(most)]
        if self.bridged:
            self._bridge(choice)
        searches = 2 - count if self.lone else pick(choice, (0, 1, 2) if count == 2 else (0, 1))
        self.inquirers = [self._new() for _ in range(searches if chance(choice, 4 if self.lone else 2) else 0)]
        self.pagers = [self._new() for _ in range(searches if not self.inquirers or chance(choice, 3) else 0)]
        self.found = [self._new() for _ in range(choice.integer(1, 3) if self.inquirers or self.pagers else 0)]
        linked = [slave for slaves in self.slaves.values() for slave in slaves]
        self.asking = [pick(choice, linked)] if self.pagers and not self.bridged and chance(choice, 3) else []
        """Slaves that can be paged, too."""
        if (
            self.pagers and not self.lone and chance(choice, 2)
        ):  # a slave that pages, or a master that has slaves already
            masters = [] if self.bridged else [master for master, slaves in self.slaves.items() if len(slaves) < 7]
            slaves = [slave for slave in linked if slave not in (*self.asking, *self.slaves)]
            self.pagers[0] = pick(choice, [*masters, *slaves] or self.pagers)
        if self.inquirers and not self.bridged and chance(choice, 3):
            self.inquirers[0] = pick(choice, list(self.slaves))

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
        if roles.twins and (address in roles.slaves or (roles.lone and address in roles.speaking)):
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
    idle = [master for master in roles.slaves if master not in (*roles.inquirers, *roles.pagers)]
    if idle and not roles.bridged and chance(choice, 4):
        begin, until = sorted((when(), when()))
        inputs.append(Suspend(begin, pick(choice, idle), until + 1))
    if roles.bridged and not chance(choice, 4):
        inputs += _draw_shares(choice, scene, roles, when)
    inputs += [Scan(when(), slave, True) for slave in roles.asking]
    inputs += _draw_searches(choice, scene, roles, clocks, when)
    return tuple(sorted(inputs, key=lambda wish: wish.time))


def _draw_joins(choice: Choice, scene: Scene, roles: _Roles, clocks: Sequence[Clock]) -> list[Join]:
    joins = []
    same = choice.integer(1, 2 * scene.t_poll)
    for master, slaves in roles.slaves.items():
        lt_addrs = list(range(1, 8))
        for number, slave in enumerate(slaves):
            lt_addr = lt_addrs.pop(choice.integer(0, len(lt_addrs) - 1))
            time = pick(choice, (0, 0, 0, choice.integer(0, scene.end // 3)))
            if master in roles.pagers:  # a page has chosen its LT_ADDR already
                time = 0
            ahead = pick(choice, (0, 8, 2 * scene.t_poll, choice.integer(0, 2 * scene.t_poll)))
            if roles.twins and chance(choice, 2):
                time, ahead = 0, same + 8 * number
            joins.append(Join(time, master, slave, lt_addr, clocks[master].first_transmit_tick(time) + ahead // 4 * 4))
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
    for _ in range(choice.integer(0, 12 if roles.bridged or roles.lone else 6)):
        time = when()
        same = pick(choice, roles.links)
        for _ in range(pick(choice, (1, 1, 2, choice.integer(1, 6)))):
            master, slave = same if chance(choice, 3) else pick(choice, roles.links)
            source, destination = pick(choice, ((master, ALL), (master, slave), (slave, master), (slave, master)))
            lengths = (0, 17, 18, 27, 28, 121, 183, 224, 339, choice.integer(0, 339))
            length = min(pick(choice, lengths), most + chance(choice, 20))
            sends.append(Send(time, source, destination, length, len(sends)))
    for _ in range(choice.integer(10, 60) if roles.lone and chance(choice, 2) else 0):  # no slot remains free
        sends.append(Send(1_000, 0, roles.slaves[0][0], min(pick(choice, (27, 27, 183, 339)), most), len(sends)))
    for _ in range(2 if roles.bridged and chance(choice, 2) else 0):  # a part may have room for the second only
        time, (master, slave) = when(), pick(choice, roles.links)
        sends += [Send(time, master, slave, length, len(sends) + i) for i, length in enumerate((most, 0))]
    return sends


def _draw_shares(choice: Choice, scene: Scene, roles: _Roles, when: Callable[[], int]) -> list[Share]:
    """Give those in several piconets their parts, most of them such that all members of a piconet share theirs."""
    period = 2 * pick(choice, (choice.integer(8, 20), choice.integer(20, 64)))
    reference = choice.integer(0, roles.size - 1)
    count = len(roles.slaves)
    parts = []
    for number, master in enumerate(roles.slaves):
        first = period * number // count + pick(choice, (0, 0, choice.integer(0, 3)))
        parts.append((master, first, max(1, period // count + pick(choice, (0, 0, -1, choice.integer(-8, 8))))))
    shares = []
    for device in range(roles.size):
        own = [part for part in parts if device == part[0] or device in roles.slaves[part[0]]]
        if len(own) > 1 or (own and chance(choice, 4)):
            time = pick(choice, (0, 0, when()))
            given = own[1:] if chance(choice, 8) else own
            shares.append(Share(time, device, period, _apart(given, period), reference))
            if chance(choice, 6):
                shares.append(Share(when(), device, period, (), reference))
    return shares


def _apart(parts: Sequence[tuple[int, int, int]], period: int) -> tuple[tuple[int, int, int], ...]:
    """Return *parts*, in the order of their first slots, cut so that none reaches into the next one."""
    if not parts:
        return ()
    later = [*(first for _, first, _ in parts[1:]), parts[0][1] + period]
    return tuple(
        (master, first, min(slots, after - first)) for (master, first, slots), after in zip(parts, later, strict=True)
    )


def _draw_searches(
    choice: Choice, scene: Scene, roles: _Roles, clocks: Sequence[Clock], when: Callable[[], int]
) -> list[Input]:
    searches: list[Input] = []
    for device in roles.inquirers:
        time = pick(choice, (0, choice.integer(0, scene.end // 4), when()))
        duration = 4 * pick(choice, (choice.integer(1, 20), scene.end // PAIR))
        searches.append(Inquire(time, device, duration, choice.integer(1, 3)))
    for device in roles.pagers:
        peer = pick(choice, [*roles.found, *(slave for slave in roles.asking if (device, slave) not in roles.links)])
        time = pick(choice, (0, choice.integer(0, scene.end // 4), when(), when()))
        exact = (clocks[peer].tick(time) - clocks[device].tick(time)) // 4 * 4
        offset = exact + pick(choice, (0, 0, 0, 4, -4, 4096, -4096, 4 * choice.integer(-40_000, 40_000)))
        searches.append(PageFor(time, device, peer, offset))
    return searches
