"""A figure of a moment, for a paper: the floor at that time, and below it the boxes around it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import matplotlib as mpl
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from cosim.errors import UserError
from cosim.export.lanes import HEARD, Lane, lanes
from cosim.export.recording import Recording
from cosim.picture.colours import is_lost, look
from cosim.picture.floor import draw_floor
from cosim.picture.slots import Lines, draw_slots, legend, lines_of, time_axis
from cosim.picture.window import Box, boxes
from cosim.trace import drafted
from cosim.units import S, Time

WIDE_IN: Final = 7.2
"""Width of a figure: that of a page's text, inches."""
_A_LANE_IN: Final = 0.42
_TALLEST_FLOOR_IN: Final = 3.0
FORMATS: Final = (".svg", ".pdf", ".png")
DPI: Final = 200
"""Of a .png."""
MOST_BOXES: Final = 20_000
"""The most boxes that a figure draws."""


class Room(NamedTuple):
    """Lines for boxes, and marks that tell what these are: for a film, in which they stay the same."""

    lines: Lines
    marks: Sequence[Patch]


def room_for(seen: Sequence[Box]) -> Room:
    """Return room for the boxes *seen*."""
    return Room(lines_of(seen), legend(seen))


class View(NamedTuple):
    """What a picture shows."""

    at: Time
    """The moment of the floor."""
    begin: Time
    end: Time
    """The time of the boxes below it."""
    channels: bool = False
    """True if a third part shows the same frames on their RF channels."""
    earlier: tuple[Time, ...] = ()
    """Moments before, whose floors stand to the left of it."""
    seen_m: float | None = None
    """If given, what robots have had in sight so far within that range is shaded, m."""
    room: Room | None = None
    """What lines and marks there are; if None, those of the boxes that are seen."""


def draw_moment(recording: Recording, view: View, found: Sequence[Lane] | None = None) -> tuple[Figure, list[Box]]:
    """Return the figure of *view*, and the boxes in it; *found* are the lanes of *recording*, if they are at hand.

    Raise UserError if there are more boxes than anybody could see.
    """
    found = lanes(recording) if found is None else found
    seen = boxes(recording, found, view.begin, view.end)
    if len(seen) > MOST_BOXES:
        span = f"{view.begin / S:g} to {view.end / S:g} s"
        raise UserError(f"--from, --to: {len(seen)} boxes from {span}, a figure shows {MOST_BOXES} at most")
    with mpl.rc_context({"hatch.linewidth": 0.5, "font.family": "DejaVu Sans"}):
        return _figure(recording, view, seen), seen


def _figure(recording: Recording, view: View, seen: Sequence[Box]) -> Figure:
    lines, marks = view.room or room_for(seen)
    x0, y0, x1, y1 = recording.scene["bounds_m"]
    moments = (*view.earlier, view.at)
    floor_in = min(_TALLEST_FLOOR_IN, (WIDE_IN - 0.8) / len(moments) * (y1 - y0) / (x1 - x0)) + 0.2
    parts = [floor_in, 0.3 + _A_LANE_IN * lines.height]
    channels = view.channels and any(box.channel >= 0 for box in seen)
    if channels:
        parts.append(1.5)
    figure = Figure(figsize=(WIDE_IN, sum(parts) + 0.75 + 0.3 * channels), layout="constrained")
    grid = figure.add_gridspec(len(parts), 1, height_ratios=parts)
    plots = [figure.add_subplot(grid[part]) for part in range(1, len(parts))]
    on_air = [box for box in seen if box.what == HEARD and box.start <= view.at < box.end]
    for column, moment in enumerate(moments):
        plot = figure.add_subplot(grid[0].subgridspec(1, len(moments))[column])
        draw_floor(plot, recording, moment, on_air if moment == view.at else [], view.seen_m, len(moments))
        digits = 6 if len(moments) == 1 else 0
        name = f"{recording.scene.get('name', '')} at " if column == 0 else ""
        plot.set_title(f"{name}{moment / S:.{digits}f} s", fontsize=9, loc="left")
    draw_slots(plots[0], recording, seen, lines, (view.begin, view.end), view.at)
    if channels:
        _draw_channels(plots[1], view, seen)
    if marks:
        figure.legend(handles=marks, loc="outside lower center", ncols=min(len(marks), 7), fontsize=7, frameon=False)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # whose places would be a little others each time it is drawn
    return figure


def _draw_channels(plot: Any, view: View, seen: Sequence[Box]) -> None:
    """Draw the frames on their RF channels, on the axis of time of the lanes."""
    unit, origin, _ = time_axis(view.begin, view.end)
    left, right = (view.begin - origin) / unit, (view.end - origin) / unit
    frames = [box for box in seen if box.channel >= 0 and box.what == HEARD]
    corners = []
    for box in frames:
        a, b, y = (box.start - origin) / unit, (box.end - origin) / unit, box.channel
        b = max(b, a + (right - left) / 600)
        corners.append([(a, y - 0.5), (b, y - 0.5), (b, y + 0.5), (a, y + 0.5)])
    fills = ["#000000" if is_lost(box.what, box.outcome) else look(box.name).fill for box in frames]
    plot.add_collection(PolyCollection(corners, facecolors=fills, edgecolors=fills, linewidths=0.4))
    for box, corner in zip(frames, corners, strict=True):
        if is_lost(box.what, box.outcome):
            plot.plot((corner[0][0] + corner[1][0]) / 2, box.channel, "x", color="#000000", markersize=5)
    plot.set(xlim=(left, right), ylim=(-1, 79))
    plot.set_ylabel("RF channel", fontsize=8)
    plot.tick_params(labelsize=8)
    for side in ("right", "top"):
        plot.spines[side].set_visible(False)


def save_moment(figure: Figure, path: Path) -> None:
    """Write *figure* to *path*, in the format that its ending names: the same figure gives the same file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    kind = path.suffix.lower().removeprefix(".")
    metadata: dict[str, Any] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind, {})
    with (
        mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "cosim", "hatch.linewidth": 0.5}),
        drafted(path) as draft,
    ):
        figure.savefig(draft, format=kind, dpi=DPI, metadata=metadata)
