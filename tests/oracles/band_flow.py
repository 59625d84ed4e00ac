"""Slow hosts for random scenes: places that are full, and free again within a nanosecond of slots and of frames' ends.

A scene keeps its devices and its radio; it gets more traffic, and answers that say "stop" are lost.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import inf

from tests.oracles.band_air import Matrix, Radio
from tests.oracles.band_scene import ALL, KINDS, FlowNote, Join, Loss, PageFor, Scene, Send, Suspend
from tests.oracles.band_stage import Entry
from tests.oracles.campaign import Choice, chance, pick
from tests.oracles.medium import HEADER_AIR, SLOT, Clock

LONGEST = 40 * SLOT
"""Of the transports of payloads of the chosen length."""
MOST_BPS = 10**12
"""As a scenario may have it."""


def slow_hosts(choice: Choice, scene: Scene) -> Scene:
    """Return *scene* with slow hosts, and payloads enough for them to fall behind."""
    length, bps = _draw_rate(choice, scene)
    scene = replace(
        scene,
        host_bps=bps,
        room=pick(choice, (1, 1, 2, 3)),
        end=max(scene.end, choice.integer(120, 240) * SLOT),
        supervision=max(scene.supervision, choice.integer(30, 90) * SLOT),
    )
    sends = [*scene.inputs, *_draw_bursts(choice, scene, length)]
    return replace(scene, inputs=tuple(sorted(sends, key=lambda wish: wish.time)))


def _draw_rate(choice: Choice, scene: Scene) -> tuple[int, int]:
    """Draw a length and a rate: most likely such that a place is free again when that is looked at, or 1 ns off."""
    most = KINDS[pick(choice, scene.kinds)].capacity
    first = choice.integer(1, most)
    if chance(choice, 4):
        return first, _rate(first, choice.integer(SLOT // 4, LONGEST))
    pairs = 2 * SLOT * pick(choice, (choice.integer(1, 3), choice.integer(3, 10), choice.integer(10, 20)))
    place = pick(choice, ("of the master", "of the slave, a POLL", "of the slave, as long a packet"))
    nudge = pick(choice, (-1, 0, 0, 1))
    for length in (*range(first, most + 1), *range(1, first)):
        air = Entry(0, 0, _smallest(scene, length), length).air
        back = {"of the master": (SLOT + air) % (2 * SLOT), "of the slave, a POLL": air - HEADER_AIR}.get(place, 0)
        transport = max(1, pairs - back + nudge)
        if -(-8_000_000_000 * length // _rate(length, transport)) == transport:  # bit/s are whole numbers
            return length, _rate(length, transport)
    return first, _rate(first, pairs)


def _rate(length: int, transport: int) -> int:
    """Return the bit/s with which *length* bytes take *transport* ns or hardly more, as far as settings allow."""
    return min(max(1, 8_000_000_000 * length // transport), MOST_BPS)


def _smallest(scene: Scene, length: int) -> str:
    return min((name for name in scene.kinds if KINDS[name].capacity >= length), key=lambda name: KINDS[name].capacity)


def _unused(scene: Scene) -> int:
    """Return the first token behind all that have been given."""
    return 1 + max((wish.token for wish in scene.inputs if isinstance(wish, Send)), default=-1)


def _draw_bursts(choice: Choice, scene: Scene, length: int) -> Iterator[Send]:
    joins = [wish for wish in scene.inputs if isinstance(wish, Join)]
    token = _unused(scene)
    favourite = pick(choice, joins)
    for _ in range(choice.integer(3, 6)):
        join = pick(choice, joins) if chance(choice, 4) else favourite
        ends = pick(choice, ((join.master, join.slave), (join.slave, join.master)))
        time = join.time + choice.integer(1, max(1, (scene.end - join.time) // 3))
        for _ in range(choice.integer(scene.room, 4 + 3 * scene.room)):
            to_all = ends[0] == join.master and chance(choice, 12)
            size = length if not chance(choice, 4) else pick(choice, (0, choice.integer(0, length)))
            yield Send(min(time, scene.end - 1), ends[0], ALL if to_all else ends[1], size, token)
            token += 1


def rejoin(choice: Choice, scene: Scene, losses: Sequence[Loss]) -> Scene:
    """Let two devices that have lost each other have a link again, perhaps the other way round, and use it.

    Hosts may still be busy with payloads of the earlier link.
    """
    joins = {(wish.master, wish.slave): wish for wish in scene.inputs if isinstance(wish, Join)}
    away = {wish.device for wish in scene.inputs if isinstance(wish, PageFor)}
    away |= {wish.master for wish in scene.inputs if isinstance(wish, Suspend)}
    lost = {(loss.owner, loss.peer): loss.time for loss in losses}
    pairs = [pair for pair in joins if pair in lost and pair[::-1] in lost and away.isdisjoint(pair)]
    if not pairs:
        return scene
    before = pick(choice, pairs)
    time = max(lost[before], lost[before[::-1]]) + pick(choice, (1, choice.integer(1, 10 * SLOT)))
    master, slave = before if not chance(choice, 3) else before[::-1]
    used = {wish.lt_addr for wish in joins.values() if wish.master == master}
    free = [lt_addr for lt_addr in range(1, 8) if lt_addr not in used]
    if not free or time >= scene.end:
        return scene
    clock = Clock(scene.bodies[master].phase, scene.bodies[master].ppm)
    due = clock.first_transmit_tick(time) + 4 * choice.integer(0, 8)
    wishes = [*scene.inputs, Join(time, master, slave, pick(choice, free), due)]
    for token in range(_unused(scene), _unused(scene) + choice.integer(1, 4)):
        ends = pick(choice, ((master, slave), (slave, master)))
        wishes.append(Send(min(scene.end - 1, time + choice.integer(1, 60 * SLOT)), *ends, 17, token))
    return replace(scene, inputs=tuple(sorted(wishes, key=lambda wish: wish.time)))


def lose_stops(choice: Choice, scene: Scene, notes: Sequence[FlowNote]) -> Scene:
    """Let some answers that say "stop" not arrive, those of one or two packets."""
    stops = [note for note in notes if note.what == "slave stops"]
    polls = [note for note in notes if note.what == "polled though stopped"]
    radio = scene.radio
    for _ in range(choice.integer(1, 4) if stops else 0):
        note = pick(choice, polls if polls and not chance(choice, 4) else stops)
        length = pick(choice, (1, 1, 2 * SLOT, 10 * SLOT))
        radio = _without(radio, note.slave, note.master, note.start, note.start + length)
    return replace(scene, radio=radio)


def _without(radio: Radio, source: int, receiver: int, start: int, until: int) -> Radio:
    """Return *radio* with nothing of *source* at *receiver* in [start, until)."""

    def at(time: int) -> Matrix:
        return [matrix for since, matrix in radio.powers if since <= time][-1]

    def silent(matrix: Matrix) -> Matrix:
        row = tuple(-inf if to == receiver else power for to, power in enumerate(matrix[source]))
        return (*matrix[:source], row, *matrix[source + 1 :])

    times = sorted({start, until, *(since for since, _ in radio.powers)})
    powers = tuple((time, silent(at(time)) if start <= time < until else at(time)) for time in times)
    return replace(radio, powers=powers)
