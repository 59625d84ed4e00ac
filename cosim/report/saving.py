"""A figure as files: its picture, the same as SVG, and the numbers that are drawn in it.

The SVG is for a page: its text is text, its black is the colour of the page's text, and its ground is the page's.
"""

import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.category import StrCategoryFormatter
from matplotlib.collections import PathCollection, PolyCollection
from matplotlib.container import BarContainer, ErrorbarContainer
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FuncFormatter

DPI: Final = 120
"""Of the picture."""
MOST_POINTS: Final = 400
"""The most points of one series that its table holds: of more, evenly chosen ones."""
NUMBERS: Final = ".numbers.csv"
"""The end of the name of the file with the numbers in a figure."""
COLUMNS: Final = ("panel", "series", "x", "y", "low", "high")
_NEAREST: Final = 0.4
"""A point that is so near to a tick with a text, in steps of the axis, belongs to it."""


def save(figure: Figure, path: Path) -> Path:
    """Write *figure* to *path*, a .png, and beside it to an .svg, and its numbers to a table; return *path*."""
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": path.stem}):
        file = io.StringIO()
        figure.savefig(file, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    path.with_suffix(".svg").write_text(_for_a_page(file.getvalue()), encoding="utf-8")
    drawn(figure).to_csv(path.with_suffix(NUMBERS), index=False)
    figure.savefig(path, dpi=DPI)
    return path


def _for_a_page(svg: str) -> str:
    """Return *svg* without what only a file of its own needs, its black and white those of the page around it."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r"<style[^>]*>.*?</style>", "", svg, flags=re.DOTALL)
    # black that is meant as text: matplotlib leaves out what SVG takes for granted, a black fill
    svg = re.sub(r"#000000\b", "currentColor", svg).replace("<svg ", '<svg fill="currentColor" ', 1)
    return re.sub(r"#ffffff\b", "var(--paper, #ffffff)", svg)


# ---------------------------------------------------------------- numbers


def drawn(figure: Figure) -> pd.DataFrame:
    """Return the points of the lines, bars, bands and marks of *figure*, a row each.

    ``low`` and ``high`` are the ends of an interval or of a band. An x that stands at a tick with a text has that text.
    """
    figure.draw_without_rendering()  # only then the ticks have their texts
    rows = []
    for number, plot in enumerate(figure.axes, start=1):
        panel = plot.get_title() or plot.get_ylabel() or str(number)
        names = _names(plot)
        for series, points in _series(plot):
            step = -(-len(points) // MOST_POINTS) or 1
            rows += [(panel, series, _named(x, names), *rest) for x, *rest in points[::step].tolist()]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def _names(plot: Any) -> dict[float, str]:
    """Return the texts of the ticks of the x axis of *plot* by their places, where these are not their numbers."""
    if not isinstance(plot.xaxis.get_major_formatter(), FixedFormatter | FuncFormatter | StrCategoryFormatter):
        return {}
    texts = [tick.get_text() for tick in plot.get_xticklabels()]
    pairs = zip(plot.get_xticks(), texts, strict=False)
    return {float(at): text for at, text in pairs if text not in ("", f"{at:g}")}


def _named(x: float, names: dict[float, str]) -> Any:
    near = min(names, key=lambda at: abs(at - x), default=None)
    return names[near] if near is not None and abs(near - x) <= _NEAREST else x


def _series(plot: Any) -> Iterator[tuple[str, np.ndarray[Any, Any]]]:
    """Yield the label and the points (n, 4), of x, y, low, high, of what is drawn in *plot*."""
    within: set[int] = set()
    for group in plot.containers:
        within |= {id(part) for part in group.get_children()}
        if isinstance(group, ErrorbarContainer) and group[0] is not None:
            yield _label(group, group[0]), _with_intervals(group)
        elif isinstance(group, BarContainer):
            middle = [bar.get_x() + bar.get_width() / 2 for bar in group]
            yield _label(group), _points(middle, [bar.get_y() + bar.get_height() for bar in group])
    for line in plot.lines:
        if id(line) not in within and len(line.get_xdata()):
            yield _label(line), _points(line.get_xdata(orig=False), line.get_ydata(orig=False))
    for marks in plot.collections:
        if id(marks) in within:
            continue
        if isinstance(marks, PathCollection):
            yield _label(marks), _points(*np.asarray(marks.get_offsets(), float).T)
        elif isinstance(marks, PolyCollection):
            yield from ((_label(marks), _band(path.vertices)) for path in marks.get_paths())


def _label(*things: Any) -> str:
    """Return the first label of *things* that is not one of matplotlib's own."""
    return next((str(each.get_label()) for each in things if not str(each.get_label()).startswith("_")), "")


def _points(x: Any, y: Any) -> np.ndarray[Any, Any]:
    nothing = np.full(len(x), np.nan)
    return np.column_stack([np.asarray(x, float), np.asarray(y, float), nothing, nothing])


def _with_intervals(group: Any) -> np.ndarray[Any, Any]:
    points = _points(group[0].get_xdata(orig=False), group[0].get_ydata(orig=False))
    segments = group[2][-1].get_segments() if group.has_yerr else []
    if len(segments) == len(points):
        for point, segment in zip(points, segments, strict=True):
            if np.ndim(segment) == 2 and len(segment):  # where there is no interval, there is no segment
                point[2:] = segment[:, 1].min(), segment[:, 1].max()
    return points


def _band(outline: Any) -> np.ndarray[Any, Any]:
    """Return the lowest and the highest point at each x of an *outline* (n, 2)."""
    table = pd.DataFrame(np.asarray(outline, float), columns=["x", "y"]).groupby("x")["y"].agg(["min", "max"])
    return np.column_stack([table.index, np.full(len(table), np.nan), table["min"], table["max"]])
