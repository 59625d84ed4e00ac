"""How large the page of a minute is that ``cosim picture SCENARIO -o run.html`` writes, and how long one waits for it.

    python -m benchmarks.picture_page [--open]

Told are: the boxes in the page, its size and the bound that it is to keep, the processor time to write it from tables
in memory, and with --open the time until Chromium, which reads it from the disk, has drawn it (median of 3).
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

import experiments
from benchmarks.peers import saturation
from cosim.channels.adhoc.settings import AdhocSettings
from cosim.cli_pictures import recording_of
from cosim.export.recording import DRAWN, Recording, of_run
from cosim.kernel import Kernel
from cosim.picture.page import write_page
from cosim.scenario import load
from cosim.simulation import Simulation
from cosim.trace import Trace
from cosim.units import S, Time

MINUTE: Time = 60 * S
PICONET = Path(next(iter(experiments.__path__))).parent / "examples" / "2_bluetooth.yaml"
OPENED = 3


def piconet() -> Recording:
    """Return a minute of four robots with Bluetooth, whose idle frames are kept."""
    scenario = load(PICONET, ("duration_s=60", "channel.idle_frames=true"))
    simulation = Simulation(scenario, scenario.seed, DRAWN)
    return recording_of(simulation, simulation.run(), scenario.seed)


def saturated(radio: dict[str, Any], nodes: int, until: Time) -> Recording:
    """Return a run of *nodes* stations that always have something to send, in the open."""
    kernel, trace = Kernel(), Trace(DRAWN)
    settings = AdhocSettings(**radio, short_retries=None, long_retries=None)
    saturation.saturated(kernel, trace, nodes, 1, settings)
    kernel.run(until)
    bounds = {"bounds_m": [0, 0, 10, 10], "walls_m": [], "polygons_m": [], "radii_m": [0.2] * nodes}
    scenario = json.dumps({"channel": settings.model_dump(mode="json")})  # without it nobody knows what is sensed
    return of_run(trace, {"name": "saturated", **bounds}, {"scenario": scenario})


RUNS: dict[str, tuple[float, Callable[[], Recording]]] = {
    "Bluetooth, 4 robots, idle frames": (1.0, piconet),
    "802.11, 5 saturated, 11 Mb/s": (5.0, lambda: saturated({"phy": "dsss", "rate_mbps": 11}, 5, MINUTE)),
    "802.11, 5 saturated, 54 Mb/s": (5.0, lambda: saturated({"phy": "ofdm", "rate_mbps": 54}, 5, MINUTE)),
}
"""Runs of a minute, with the bound of their pages, MB."""


def opened_s(path: Path) -> float:
    """Return how long Chromium takes to read and draw the page in the file *path*."""
    from benchmarks.timeline_page import browsing

    spent = []
    with browsing() as page:
        page.context.set_offline(True)
        for _ in range(OPENED):
            page.goto("about:blank")
            began = time.perf_counter()
            page.goto(path.as_uri())
            page.wait_for_selector("body[data-ready]")
            spent.append(time.perf_counter() - began)
    return median(spent)


def main(words: Sequence[str] | None = None) -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--open", action="store_true", help="open the pages in Chromium, too")
    asked = parser.parse_args(words)
    with TemporaryDirectory() as folder:
        for name, (bound_mb, make) in RUNS.items():
            recording, path = make(), Path(folder) / "run.html"
            began = time.process_time()
            count = write_page(recording, path, (0, MINUTE))
            spent, size_mb = time.process_time() - began, path.stat().st_size / 1e6
            line = f"{name:34} {count:9,} boxes {size_mb:6.2f} MB, bound {bound_mb:g} MB"
            line += " (MISSED)" if size_mb > bound_mb else ""
            line += f"   written in {spent:4.1f} s"
            print(line + (f", opened in {opened_s(path):4.1f} s" if asked.open else ""), flush=True)


if __name__ == "__main__":
    sys.exit(main())
