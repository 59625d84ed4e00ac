"""Latencies beside exact solutions, and the claims that no single number decides."""

from collections.abc import Callable, Iterator
from math import nan, sqrt
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cosim.arrays import Floats
from cosim.channels.ble.advertising import REQUEST_ROOM
from cosim.channels.ble.beacon import advertisement
from cosim.channels.ble.phy import HEADER_OCTETS, LE_1M
from cosim.report.saving import save
from cosim.units import MS, S, Time
from experiments.ble_discovery.discovery import AIR, COLUMNS, SPACING
from experiments.ble_discovery.exact import OneChannel, Timing, delayed, geometric, one_channel, overlapping

Answer = tuple[str, bool | None]

UNKNOWN: Final[Answer] = ("-", None)
NEEDED: Final = {"set", *(column.name for column in COLUMNS)}
CROWD: Final = "crowd of "
"""What names of crowds begin with, before their size; names of other sets are three times in ms."""
PHASES: Final = 10_000
"""Even phases in which the exact solutions of one channel can be seen."""
NEAR: Final = 0.005
"""How much means and maxima of so many are off at most, relatively, and shares of phases."""
SIGMAS: Final = 4
"""Standard errors that a mean may be off."""
PUBLISHED_DRAWS: Final = 200_000
"""Draws that the quantiles of the table are of."""
CROWD_MS: Final = (100, 30, 30)
"""The times of crowds."""
COARSE: Final = 1 << 11
"""Cells of a grid of phases that is fine enough for a line."""
SHOWN: Final = ("30-60-30", "100-1000-300", "1000-2560-320", "318.75-1280-11.25", "1022.5-512.5-128.75")
"""Sets whose distributions are drawn."""
SWEPT: Final = "-100-25"
"""What names of sets end with whose advInterval alone differs."""


class Printed(NamedTuple):
    """A row of the reference's table: three channels, advDelay; times in ms."""

    mean: float
    digit: float
    """Unit of the last digit of the mean."""
    quantiles: tuple[float, float, float]
    """Median, 95 %, 99 %."""
    digits: tuple[float, float, float]
    events: tuple[float, ...]
    """Found by event 1, 2, 3."""


SHARES: Final = (0.5, 0.95, 0.99)
TABLE: Final = {
    "100-30-30": Printed(2.80, 0.01, (0.98, 1.58, 104.6), (0.01, 0.01, 0.1), (0.9825, 1.0)),
    "30-60-30": Printed(21.92, 0.01, (30.8, 72.1, 77.8), (0.1, 0.1, 0.1), (0.4937, 0.9097, 0.9987)),
    "500-100-10": Printed(4501, 1, (4538, 9585, 11578), (1, 1, 1), (0.0962, 0.1461, 0.1957)),
    "1000-2560-320": Printed(4981, 1, (4007, 14084, 17084), (1, 1, 1), (0.1249, 0.2497, 0.3746)),
    "318.75-1280-11.25": Printed(27151, 1, (20405, 77010, 114944), (1, 1, 1), (0.0085, 0.0170, 0.0255)),
}


def air_time(address: int) -> Time:
    """Return how long the PDU lasts with which that device advertises."""
    return LE_1M.air_time(len(advertisement(address)) - HEADER_OCTETS)


def timing(name: str, of_devices: bool) -> Timing:
    """Return the times of a set by its *name*, with the PDU of devices of the channel, or that of the table."""
    air = air_time(1) if of_devices else AIR
    interval, scan_interval, window = (round(float(part) * MS) for part in name.split("-"))
    return Timing(interval, scan_interval, window, air, air + REQUEST_ROOM if of_devices else SPACING)


def _latencies(observations: pd.DataFrame, procedure: str) -> Iterator[tuple[str, Floats]]:
    """Yield each set with its latencies, ms, by a *procedure*, a column; NaN where nothing was found."""
    if set(observations) >= NEEDED:
        for name, part in observations[observations["lost"].isna()].groupby("set", sort=False):
            yield str(name), 1e3 * part[procedure].to_numpy(np.float64)


def _counted(right: "list[bool]", what: str, worst: str = "") -> Answer:
    """Return how many of them are *right*, and whether all are."""
    return (f"{sum(right)} of {len(right)} {what}{worst}", all(right)) if right else UNKNOWN


# ---------------------------------------------------------------- one channel, no delay


def _of_phases(observations: pd.DataFrame) -> Iterator[tuple[Floats, OneChannel]]:
    """Yield the latencies of each set of which there are enough phases, ms, beside the exact solution."""
    for name, ms in _latencies(observations, "one_channel_s"):
        if len(ms) >= PHASES:
            yield ms, one_channel(timing(name, False))


def exact_means(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return in how many sets the mean of the phases that are met is the exact one."""
    ratios = [float(np.nanmean(ms)) * MS / exact.mean for ms, exact in _of_phases(observations)]
    worst = f", {100 * max(abs(ratio - 1) for ratio in ratios):.2f} % off at most" if ratios else ""
    return _counted([abs(ratio - 1) <= NEAR for ratio in ratios], "sets", worst)


def exact_maxima(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return in how many sets the longest latency is the exact one."""
    ratios = [float(np.nanmax(ms)) * MS / exact.greatest for ms, exact in _of_phases(observations)]
    return _counted([abs(ratio - 1) <= NEAR for ratio in ratios], "sets")


def never_met(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return in how many sets as many phases are never met as the exact solution says, and in how many some are."""
    pairs = [(float(np.isnan(ms).mean()), 1.0 - exact.met) for ms, exact in _of_phases(observations)]
    locked = f", of which {sum(ours > 0 for ours, _ in pairs)} lock"
    right = [abs(ours - exact) <= NEAR and (ours > 0) == (exact > 0) for ours, exact in pairs]
    return _counted(right, "sets", locked)


# ---------------------------------------------------------------- the table


def _of_table(observations: pd.DataFrame) -> Iterator[tuple[Printed, str, Floats]]:
    for name, ms in _latencies(observations, "three_channels_s"):
        if name in TABLE:
            yield TABLE[name], name, ms


def table_means(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return how many of the printed means ours are."""
    right = []
    for printed, _, ms in _of_table(observations):
        error = SIGMAS * _error(ms) + printed.digit / 2 + 0.003 * printed.mean
        right.append(abs(ms.mean() - printed.mean) <= error)
    return _counted(right, "means")


def table_quantiles(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return how many of the printed quantiles ours are: steps of the distribution hold several."""
    right = []
    for printed, _, ms in _of_table(observations):
        for share, value, digit in zip(SHARES, printed.quantiles, printed.digits, strict=True):
            error = SIGMAS * sqrt(share * (1 - share) * (1 / len(ms) + 1 / PUBLISHED_DRAWS))
            below, up_to = (ms < value - digit / 2).mean(), (ms <= value + digit / 2).mean()
            right.append(bool(below - error <= share <= up_to + error))
    return _counted(right, "quantiles")


def table_events(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return how many of the printed shares found by event 1, 2 and 3 ours are: an event begins before the next can."""
    right = []
    for printed, name, ms in _of_table(observations):
        for event, share in enumerate(printed.events, start=1):
            ours = (ms * MS < event * timing(name, False).interval).mean()
            right.append(abs(ours - share) <= _share_error(share, len(ms)) + 5e-5)
    return _counted(right, "shares")


def _error(values: Floats) -> float:
    return float(values.std()) / sqrt(len(values))


def _share_error(share: float, count: int) -> float:
    return SIGMAS * sqrt(max(share * (1 - share), 1 / count) / count)


# ---------------------------------------------------------------- devices


def devices(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return in how many sets devices are found after the mean time that the density says."""
    errors = [
        (ms.mean() - delayed(timing(name, True)).mean / MS) / _error(ms)
        for name, ms in _latencies(observations, "devices_s")
    ]
    worst = f", {max(map(abs, errors)):.1f} standard errors at most" if errors else ""
    return _counted([bool(abs(error) <= SIGMAS) for error in errors], "sets", worst)


def first_event(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return in how many sets devices are found in their first event as often as the closed form says."""
    right = []
    for name, ms in _latencies(observations, "devices_s"):
        of_set = timing(name, True)
        share = (of_set.window - of_set.air) / of_set.scan_interval
        if of_set.window == of_set.scan_interval:
            share = 1.0 - (2 * of_set.spacing + of_set.air) / (3 * of_set.scan_interval)
        right.append(abs((ms * MS < of_set.interval).mean() - share) <= _share_error(share, len(ms)))
    return _counted(right, "sets")


def always_found(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return how many devices were found."""
    found = [~np.isnan(ms) for _, ms in _latencies(observations, "devices_s")]
    if not found:
        return UNKNOWN
    every = np.concatenate(found)
    return f"{every.sum()} of {len(every)} devices", bool(every.all())


def independent(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return in how many sets the mean is that of events that are heard independently of each other."""
    ratios = [ms.mean() * MS / geometric(timing(name, True)) for name, ms in _latencies(observations, "devices_s")]
    worst = f", {min(ratios):.2f} to {max(ratios):.2f} times" if ratios else ""
    return _counted([bool(abs(ratio - 1) <= 0.1) for ratio in ratios], "sets", worst)


# ---------------------------------------------------------------- crowds


def overlaps(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return what crowds lose, beside the closed form."""
    told, right = [], []
    for size, share, error in _crowds(observations):
        expected = overlapping(crowd_timing(size), size)
        right.append(abs(share - expected) <= SIGMAS * error + 0.05 * expected)
        told.append(f"{size}: {share:.4f} ({expected:.4f})")
    return (", ".join(told), all(right)) if told else UNKNOWN


def crowd_timing(size: int) -> Timing:
    """Return the times of a crowd, with the mean of its PDUs, which are as long as the names in them."""
    air = round(sum(air_time(address) for address in range(1, size + 1)) / size)
    interval, scan_interval, window = (time * MS for time in CROWD_MS)
    return Timing(interval, scan_interval, window, air)


def _crowds(observations: pd.DataFrame) -> Iterator[tuple[int, float, float]]:
    """Yield size of each crowd, share of PDUs lost, and its standard error: two that meet are lost together."""
    if set(observations) >= NEEDED:
        rows = observations[observations["lost"].notna()]
        for name, part in rows.groupby("set", sort=False):
            share = float(part["lost"].mean())
            yield int(str(name).removeprefix(CROWD)), share, sqrt(2 * share * (1 - share) / len(part))


# ---------------------------------------------------------------- figures


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw mean latencies over advInterval beside the exact solutions, and how many devices are not found yet."""
    if not set(observations) >= NEEDED or observations.empty:
        return []
    figure = Figure(figsize=(10.4, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    _over_intervals(left, observations)
    _not_found(right, observations)
    path = folder / "discovery.png"
    save(figure, path)
    return [path]


def _over_intervals(plot: Any, observations: pd.DataFrame) -> None:
    lines: list[tuple[str, bool, float, Callable[[Timing], float]]] = [
        ("devices_s", True, 2.5, lambda of: delayed(of, COARSE).mean / MS),
        ("one_channel_s", False, 0.625, _mean_if_met),
    ]
    labels = {"devices_s": "three channels, advDelay", "one_channel_s": "one channel, no delay"}
    for rank, (procedure, of_devices, step, mean) in enumerate(lines):
        grid = np.arange(20.0, 310.0, step)
        values = [mean(timing(f"{interval}{SWEPT}", of_devices)) for interval in grid]
        plot.plot(grid, values, color=f"C{rank}", linewidth=0.8, label=f"{labels[procedure]}: exact")
        points = [
            (float(name.removesuffix(SWEPT)), float(np.nanmean(ms)), np.isnan(ms).any())
            for name, ms in _latencies(observations, procedure)
            if name.endswith(SWEPT)
        ]
        met = np.array([point[:2] for point in points if not point[2]]).reshape(-1, 2)
        plot.plot(met[:, 0], met[:, 1], "o", color=f"C{rank}", markersize=4, label=f"{labels[procedure]}: ours")
    plot.set(
        xlabel="advInterval, ms", ylabel="mean latency, ms", yscale="log", title="25 ms of every 100 ms are scanned"
    )
    plot.grid(alpha=0.3)
    plot.legend(fontsize="small", loc="lower right")


def _mean_if_met(of_set: Timing) -> float:
    told = one_channel(of_set)
    return told.mean / MS if told.met == 1.0 else nan


def _not_found(plot: Any, observations: pd.DataFrame) -> None:
    shown = [(name, ms) for name, ms in _latencies(observations, "devices_s") if name in SHOWN]
    for rank, (name, ms) in enumerate(shown):
        of_set = timing(name, True)
        left = 1.0 - np.arange(1, len(ms) + 1) / len(ms)
        plot.step(np.sort(ms) * MS / S, left, where="post", color=f"C{rank}", linewidth=1, label=name)
        events = np.arange(3_000)
        alone = (1.0 - delayed(of_set).found[0]) ** (events + 1)
        times_s = (events * (of_set.interval + 5 * MS) + of_set.air) / S
        plot.step(times_s, alone, where="post", color=f"C{rank}", linewidth=0.8, linestyle=":")
    plot.set(xlabel="time since the first PDU, s", ylabel="share of devices not found yet", xscale="log")
    plot.set(
        xlim=(0.01, 300),
        ylim=(0, 1.45),
        yticks=np.linspace(0, 1, 6),
        title="dotted: were events independent of each other",
    )
    plot.grid(alpha=0.3)
    if shown:
        plot.legend(fontsize="small", loc="upper right", ncols=2, title="advInterval-scanInterval-scanWindow, ms")
