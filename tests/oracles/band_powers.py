"""Powers, jammers and instants near frames for random scenes: thresholds, and edges to the nanosecond."""

from collections.abc import Sequence
from dataclasses import replace
from math import inf

from tests.oracles.band_air import Jammer, Matrix, Radio
from tests.oracles.band_scene import Flush, Input, Join, Scene, Seen, Send
from tests.oracles.campaign import Choice, chance, pick
from tests.oracles.medium import SLOT, TICK, Clock

STEPS_DB = (0.0, 0.0, 0.0, -11.0, -10.999, -11.001, 0.001, -0.001, 30.0, 29.999, 30.001, 40.0, 40.001, 60.0, -8.0)
"""By how much one power differs from another, so that C/I is at a threshold."""
ES_N0_DB = (9.0, 10.5, 12.0, 13.5, 16.0, 30.0, 30.0, 100.0, 100.0)
FHS_SUFFERS_DB = (8.5, 9.0, 9.5, 10.0)
FAINT_DB = (0.0, -0.001, 0.001, 4.0)


def draw_radio(choice: Choice, devices: int, jammers: int, disc_one_in: int, searched: bool) -> Radio:
    """Draw powers at thresholds, or a disc; *searched*: often so noisy that the FHS of a search suffers."""
    key = (choice.integer(0, (1 << 32) - 1), choice.integer(0, (1 << 32) - 1))
    mode = pick(choice, ("none", "co_channel", "neighbouring", "neighbouring"))
    if chance(choice, disc_one_in):
        powers = _discs(choice, devices, jammers)
        return Radio(((0, powers),), mode=mode, key=key, jammers=_draw_jammers(choice, jammers))
    base = float(pick(choice, (-60, -53, choice.integer(-80, -30))))
    powers = _draw_matrix(choice, base, devices, jammers)
    es_n0_db = FAINT_DB if chance(choice, 10) else FHS_SUFFERS_DB if searched and chance(choice, 3) else ES_N0_DB
    noise = base - pick(choice, es_n0_db)
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


class Near:
    """Instants near frames of a scene; every kind of frame is as likely as any other."""

    def __init__(self, choice: Choice, frames: Sequence[Seen]) -> None:
        self.choice = choice
        self.frames = frames
        self.kinds = sorted({frame.kind for frame in frames})
        self.hit = [frame for frame in frames if frame.outcome == "collided"]

    def frame(self) -> Seen:
        if self.hit and chance(self.choice, 2):
            return pick(self.choice, self.hit)
        kind = pick(self.choice, self.kinds)
        return pick(self.choice, [frame for frame in self.frames if frame.kind == kind])

    def instant(self) -> int:
        """Return an instant within a nanosecond of an edge of a frame, or one within the frame."""
        frame = self.frame()
        inside = self.choice.integer(0, frame.duration)
        edges = (0, 0, 68_000, 72_000, 126_000, frame.duration, frame.duration, inside)
        return max(1, frame.start + pick(self.choice, edges) + pick(self.choice, (-1, 0, 1)))


def near_frames(choice: Choice, scene: Scene, frames: Sequence[Seen], late: bool) -> Scene:
    """Let powers change, jammers come and hosts act within a nanosecond of frames, and links time out there.

    *late*: let all piconets but the first begin in the midst of a frame.
    """
    near, radio = Near(choice, frames), scene.radio
    powers = list(radio.powers)
    for time in sorted({near.instant() for _ in range(choice.integer(0, 3))}):
        powers.append((time, _changed(choice, powers[-1][1], len(scene.bodies))))
    jammers = tuple(_jammer_at(choice, jammer, near) if chance(choice, 2) else jammer for jammer in radio.jammers)
    radio = replace(radio, powers=tuple(powers), switches=_draw_switches(choice, scene, near), jammers=jammers)
    inputs: list[Input] = [*scene.inputs, *_draw_late_wishes(choice, scene, near)]
    if late:
        inputs = [_late(choice, scene, wish, near) if isinstance(wish, Join) else wish for wish in inputs]
    return replace(
        scene,
        radio=radio,
        inputs=tuple(sorted(inputs, key=lambda wish: wish.time)),
        supervision=_draw_supervision(choice, scene, near),
    )


def _late(choice: Choice, scene: Scene, join: Join, near: Near) -> Join:
    """Return *join*, if it is not in the first piconet, in the midst of a frame; its first poll is due at once."""
    frames = [frame for frame in near.frames if frame.source == 0 and frame.start > 5_000_000]
    if join.master == 0 or not frames:
        return join
    frame, body = pick(choice, frames), scene.bodies[join.master]
    time = frame.start + pick(choice, (0, 1, choice.integer(0, frame.duration)))
    return join._replace(time=time, due=Clock(body.phase, body.ppm).first_transmit_tick(time))


def _jammer_at(choice: Choice, jammer: Jammer, near: Near) -> Jammer:
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


def _draw_switches(choice: Choice, scene: Scene, near: Near) -> tuple[tuple[int, int, bool], ...]:
    switches: list[tuple[int, int, bool]] = []
    for _ in range(choice.integer(1, 2) if chance(choice, 4) else 0):
        device, off = choice.integer(0, len(scene.bodies) - 1), near.instant()
        again = max(off + 1, pick(choice, (near.instant(), off + choice.integer(1, 2_000_000))))
        if all(device != other for _, other, _ in switches):
            switches += [(off, device, False), (again, device, True)]
    return tuple(sorted(switches))


def _draw_late_wishes(choice: Choice, scene: Scene, near: Near) -> list[Input]:
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


def _draw_supervision(choice: Choice, scene: Scene, near: Near) -> int:
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
    last = min(later, key=lambda frame: frame.start)
    return last.start + last.duration - first.start - first.duration + pick(choice, (-1, 0, 0, 1, -last.duration))


def _changed(choice: Choice, matrix: Matrix, devices: int) -> Matrix:
    """Return other powers: some links a few decibels or a threshold more or less, or one gone."""
    rows = [list(row) for row in matrix]
    if chance(choice, 2):  # one device is louder than before, or silent
        source, step = choice.integer(0, len(rows) - 1), pick(choice, (-inf, 12.0, 42.0, -12.0))
        rows[source] = [power + step if power > -inf else power for power in rows[source]]
        return tuple(tuple(row) for row in rows)
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
