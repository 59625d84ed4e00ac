"""The floor at an instant: walls, robots and their ways, stations, links, jammers, and frames that are on the air."""

from typing import Any, Final

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.patches import Circle, Polygon

from cosim.export.recording import ROBOTS, STATION, Recording
from cosim.picture.colours import is_lost, look
from cosim.picture.seen import seen_floor
from cosim.picture.window import Box
from cosim.units import S, Time

TRAIL: Final = 10 * S
"""How far back the ways of robots are drawn."""
SEEN: Final = (200, 222, 205, 255)
"""Red, green, blue, alpha of what was seen."""
_LEAST_SHARE: Final = 0.013
"""The least radius of a robot, as a share of the floor's longer side: a small one is still seen."""


def draw_floor(
    plot: Any, recording: Recording, now: Time, on_air: list[Box], seen_m: float | None = None, columns: int = 1
) -> None:
    """Draw into *plot* where everything is *now*; *on_air* are the boxes of frames that are received then.

    What robots have had in sight so far within *seen_m*, if that is given, is shaded. *columns* floors stand side by
    side, so that what has a least size is the larger.
    """
    scene = recording.scene
    x0, y0, x1, y1 = scene["bounds_m"]
    size = max(x1 - x0, y1 - y0)
    plot.set(xlim=(x0 - 0.02 * size, x1 + 0.02 * size), ylim=(y0 - 0.02 * size, y1 + 0.02 * size), aspect="equal")
    plot.set_xticks([])
    plot.set_yticks([])
    for side in plot.spines.values():
        side.set_visible(False)
    if seen_m is not None:
        shade = np.where(seen_floor(recording, now, seen_m)[..., None], SEEN, 0).astype(np.uint8)
        plot.imshow(shade, extent=(x0, x1, y0, y1), origin="lower", interpolation="nearest", zorder=0.5)
    for polygon in scene["polygons_m"]:
        plot.add_patch(Polygon(polygon, facecolor="#bbbbbb", edgecolor="none", zorder=1))
    walls = [((a, b), (c, d)) for a, b, c, d in scene["walls_m"]]
    plot.add_collection(LineCollection(walls, colors="#444444", linewidths=1.4, zorder=2))
    spots: dict[tuple[float, float], bool] = {}
    for each in recording.jammers():
        spot = each.x_m, each.y_m
        spots[spot] = spots.get(spot, False) or each.begin <= now < each.end
    for (x, y), is_on in spots.items():
        _draw_jammer(plot, x, y, is_on, size)
    places = recording.places(now)
    for begin, end, master, slave in recording.links():
        if begin <= now < end:
            (ax, ay), (bx, by) = places[master, :2], places[slave, :2]
            plot.plot([ax, bx], [ay, by], color="#888888", linewidth=2.5, alpha=0.6, zorder=3, solid_capstyle="round")
            plot.plot(ax, ay, "o", markersize=13, markerfacecolor="none", color="#888888", alpha=0.6, zorder=3)
    _draw_trails(plot, recording, now, TRAIL)
    down = recording.down(now)
    for robot, (x, y, heading) in enumerate(places[: recording.size]):
        _draw_robot(
            plot, robot, (x, y, heading), max(scene["radii_m"][robot], _LEAST_SHARE * columns * size), robot in down
        )
    for number, (x, y) in enumerate(recording.stations):
        _draw_station(plot, number, x, y)
    for box in on_air:
        if box.peer >= 0:
            _draw_frame(plot, box, places)
    _draw_scale(plot, (x0, y0, x1, y1), size)


def _draw_trails(plot: Any, recording: Recording, now: Time, trail: Time) -> None:
    times, poses = recording.poses()
    past = (times > now - trail) & (times <= now)
    for robot in range(recording.size):
        x, y = poses[past, robot, 0], poses[past, robot, 1]
        plot.plot(x, y, color=ROBOTS[robot % len(ROBOTS)], linewidth=1.2, alpha=0.7, zorder=4)


def _draw_robot(plot: Any, robot: int, pose: tuple[float, float, float], radius: float, is_down: bool) -> None:
    x, y, _ = pose
    fill = "#ffffff" if is_down else ROBOTS[robot % len(ROBOTS)]
    ink = "#000000" if is_down else "#ffffff"
    plot.add_patch(Circle((x, y), radius, facecolor=fill, edgecolor="#000000", linewidth=0.8, zorder=6))
    if is_down:
        plot.plot(x, y, "x", color="#000000", markersize=12, markeredgewidth=1.5, zorder=6)
        plot.annotate(str(robot), (x, y), (9, 6), textcoords="offset points", fontsize=7, zorder=8)
    else:
        plot.text(x, y, str(robot), color=ink, fontsize=7, ha="center", va="center_baseline", weight="bold", zorder=8)


def _draw_station(plot: Any, number: int, x: float, y: float) -> None:
    plot.plot(x, y, "s", markersize=5, color=STATION, markeredgecolor="#000000", markeredgewidth=0.6, zorder=6)
    plot.annotate(f"s{number}", (x, y), (5, 4), textcoords="offset points", fontsize=7, zorder=8)


def _draw_frame(plot: Any, box: Box, places: Any) -> None:
    """Draw a frame that is on the air, from its sender to who is to receive it."""
    lost = is_lost(box.what, box.outcome)
    plot.annotate(
        "",
        tuple(places[box.robot, :2]),
        tuple(places[box.peer, :2]),
        zorder=5,
        arrowprops={
            "arrowstyle": "-|>",
            "color": look(box.name).fill,
            "linewidth": 1.6,
            "linestyle": (0, (2, 2)) if lost else "-",
            "shrinkA": 7,
            "shrinkB": 7,
        },
    )
    if lost:
        x, y = 0.35 * places[box.peer, :2] + 0.65 * places[box.robot, :2]
        plot.plot(x, y, "x", color="#000000", markersize=7, markeredgewidth=2, zorder=7)


def _draw_jammer(plot: Any, x: float, y: float, is_on: bool, size: float) -> None:
    colour = "#d55e00" if is_on else "#aaaaaa"
    plot.plot(x, y, "*", markersize=11, color=colour, markeredgecolor="#000000", markeredgewidth=0.6, zorder=6)
    for ring in (0.03, 0.05, 0.07) if is_on else ():
        plot.add_patch(Circle((x, y), ring * size, facecolor="none", edgecolor=colour, linewidth=0.9, zorder=5))
    label = "jammer" if is_on else "jammer, off"
    plot.annotate(label, (x, y), (7, -10), textcoords="offset points", fontsize=7, zorder=7)


def _draw_scale(plot: Any, bounds: tuple[float, float, float, float], size: float) -> None:
    """Draw a bar of a round length below the floor."""
    length = next(each for each in (100, 50, 20, 10, 5, 2, 1, 0.5) if each <= size / 5 or each == 0.5)
    x0, y0 = bounds[:2]
    y = y0 - 0.035 * size
    plot.plot([x0, x0 + length], [y, y], color="#000000", linewidth=1.5, clip_on=False, solid_capstyle="butt")
    plot.text(x0 + length + 0.01 * size, y, f"{length:g} m", fontsize=7, va="center", clip_on=False)
