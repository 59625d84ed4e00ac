"""Lanes of boxes: above a robot's line what it sends, below it what is meant for it, and below that its states.

Last of an 802.11 radio's states come two strips that follow from frames: when the medium was busy, and reserved (NAV).
"""

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

from matplotlib.collections import LineCollection
from matplotlib.patches import Patch, Rectangle

from cosim.export.lanes import HEARD, SENT, STATES
from cosim.export.recording import Recording
from cosim.picture.colours import LOST_HATCH, STATE_INK, is_lost, look, state_fill
from cosim.picture.window import Box
from cosim.units import MS, US, S, Time

HIGH: Final = 0.36
"""Height of a box, in lanes."""
_STRIP: Final = 0.3
"""Height of a strip of a state."""
_LETTER: Final = 0.0105
"""Width of a letter, as a share of the axis: a text that has no room is left out."""
LONGEST: Final = 40
"""The longest text of a state that is written whole."""
MOST_HAIRLINES: Final = 300
"""The most frames that are joined with their receptions."""


class Lines(NamedTuple):
    """Where robots' boxes are drawn, from top to bottom."""

    tops: dict[int, float]
    """Height of each robot's line, in lanes: the first at 0, the others below."""
    strips: dict[Box, int]
    """The strip of each state below its robot's line: those that do not overlap share one."""
    height: float


def lines_of(room: Sequence[Box]) -> Lines:
    """Return lines with room for the boxes *room*: robots in order, then stations, jammers last."""
    strips: dict[Box, int] = {}
    tops, at = {}, 0.0
    for robot in sorted({box.robot for box in room}, key=lambda robot: robot % (1 << 62)):
        tops[robot] = at
        at -= 1.0
        count = 0
        for what in STATES:
            ends: list[Time] = []
            for box in sorted(box for box in room if box.robot == robot and box.what == what):
                strip = next((each for each, end in enumerate(ends) if end <= box.start), len(ends))
                ends[strip : strip + 1] = [box.end]
                strips[box] = count + strip
            count += len(ends)
        at -= _STRIP * count
    return Lines(tops, strips, 0.1 - at)


def draw_slots(
    plot: Any, recording: Recording, seen: Sequence[Box], lines: Lines, span: tuple[Time, Time], now: Time | None = None
) -> None:
    """Draw into *plot* the boxes *seen* of *recording* on *lines* in the *span* of time, with a mark at *now*."""
    begin, end = span
    unit, origin, name = time_axis(begin, end)
    strips, tops = lines.strips, lines.tops
    stacked = _stacked([box for box in seen if box.what not in STATES])

    def x(time: Time) -> float:
        return (min(max(time, begin), end) - origin) / unit

    def width(text: str) -> float:
        return len(text) * _LETTER * (end - begin) / unit

    for box in seen:
        line = tops.get(box.robot)
        if line is not None:
            y, high = _height(box, strips)
            row, rows = stacked.get(box, (0, 1))
            place = line + y + row * high / rows, high / rows
            _draw_box(plot, box, (x(box.start), x(box.end)), place, width)
    _draw_hairlines(plot, seen, tops, x)
    if now is not None:
        plot.axvline(x(now), color="#d00000", linewidth=0.9, zorder=6)
    for robot, line in tops.items():
        plot.axhline(line, color="#777777", linewidth=0.6, zorder=1)
        where = plot.get_yaxis_transform()
        plot.text(-0.012, line, recording.called(robot), transform=where, ha="right", va="center", fontsize=8)
    plot.set(xlim=(x(begin), x(end)), ylim=(0.55 - lines.height, 0.55))
    plot.set_yticks([])
    for side in ("left", "right", "top"):
        plot.spines[side].set_visible(False)
    after = "" if unit == S else f" after {origin / S:.3f} s"
    plot.set_xlabel(f"time, {name}{after}", fontsize=8)
    plot.tick_params(labelsize=8)


def legend(seen: Sequence[Box]) -> list[Patch]:
    """Return a mark for each kind among the boxes *seen*, for what is lost, and for each state."""
    frames = sorted({box.name for box in seen if box.what not in STATES})
    marks = [Patch(facecolor=look(kind).fill, edgecolor="#000000", linewidth=0.5, label=kind) for kind in frames]
    if any(is_lost(box.what, box.outcome) for box in seen):
        marks.append(Patch(facecolor="#ffffff", edgecolor="#000000", hatch=LOST_HATCH, linewidth=0.5, label="lost"))
    states = sorted({box.kind for box in seen if box.what in STATES})
    return marks + [
        Patch(facecolor=state_fill(each), edgecolor="#999999", linewidth=0.5, label=each) for each in states
    ]


def time_axis(begin: Time, end: Time) -> tuple[Time, Time, str]:
    """Return the unit of the axis from *begin* to *end*, where its zero is, and the unit's name."""
    length = end - begin
    unit, name = (S, "s") if length >= 2 * S else (MS, "ms") if length >= 2 * MS else (US, "µs")
    return unit, 0 if unit == S else begin - begin % MS, name


def _height(box: Box, strips: dict[Box, int]) -> tuple[float, float]:
    """Return how far above its robot's line *box* begins, and how high it is, in lanes."""
    if box.what in STATES:
        return -0.45 - _STRIP * (1 + strips[box]), 0.85 * _STRIP
    return 0.0 if box.what == SENT else -HIGH, HIGH


def _stacked(frames: Sequence[Box]) -> dict[Box, tuple[int, int]]:
    """Return for frames that overlap others of their robot its row, and how many rows there are then."""
    found: dict[Box, tuple[int, int]] = {}
    groups: dict[tuple[int, bool], list[Box]] = {}
    for box in sorted(frames):
        groups.setdefault((box.robot, box.what == SENT), []).append(box)
    for group in groups.values():
        cluster: list[Box] = []
        rows: list[Time] = []
        for box in group:
            if rows and box.start >= max(rows):
                cluster, rows = [], []
            row = next((number for number, end in enumerate(rows) if end <= box.start), len(rows))
            rows[row : row + 1] = [box.end]
            cluster.append(box)
            found[box] = row, len(rows)
            if row == len(rows) - 1:
                found |= {each: (found[each][0], len(rows)) for each in cluster}
    return found


def _draw_box(plot: Any, box: Box, span: tuple[float, float], place: tuple[float, float], width: Any) -> None:
    (left, right), (y, high) = span, place
    if box.what in STATES:
        style: dict[str, Any] = {"facecolor": state_fill(box.kind), "edgecolor": "#999999", "linewidth": 0.4}
        plot.add_patch(Rectangle((left, y), right - left, high, zorder=2, **style))
        words = f"{box.kind} {box.detail}"
        text = words if len(words) <= LONGEST and width(words) <= right - left else box.kind
        ink, tall, ground = STATE_INK, high, None
    else:
        fill, ink = look(box.name)
        thin = right - left < width("x") / 4  # its edge would be all that is seen
        if is_lost(box.what, box.outcome):
            style = {"facecolor": "#ffffff", "edgecolor": fill, "hatch": LOST_HATCH, "linewidth": 0}
            plot.add_patch(Rectangle((left, y), right - left, high, zorder=3, **style))
            plot.add_patch(Rectangle((left, y), right - left, high, zorder=4, fill=False, linewidth=0.8))
            ink, ground = "#000000", {"facecolor": "#ffffff", "edgecolor": "none", "pad": 0.3}
        else:
            style = {"facecolor": fill, "edgecolor": fill if thin else "#000000", "linewidth": 0.4}
            plot.add_patch(Rectangle((left, y), right - left, high, zorder=3, **style))
            ground = None
        text, tall = box.name, high
    if width(text) <= right - left:
        how: dict[str, Any] = {"ha": "center", "va": "center_baseline", "zorder": 5, "clip_on": True}
        plot.text(
            (left + right) / 2,
            y + tall / 2,
            text,
            color=ink,
            fontsize=6.5 if tall >= HIGH / 1.5 else 5,
            bbox=ground,
            **how,
        )


def _draw_hairlines(plot: Any, seen: Sequence[Box], tops: dict[int, float], x: Any) -> None:
    """Join frames with their receptions."""
    received = [box for box in seen if box.what == HEARD and box.peer in tops and box.robot in tops]
    if len(received) > MOST_HAIRLINES:
        return
    ends = [
        ((x(box.start), tops[box.peer] + (0.0 if tops[box.peer] > tops[box.robot] else HIGH)),
         (x(box.start), tops[box.robot] + (0.0 if tops[box.peer] > tops[box.robot] else -HIGH)))
        for box in received
    ]  # fmt: skip
    plot.add_collection(LineCollection(ends, colors="#999999", linewidths=0.5, zorder=1.5))
