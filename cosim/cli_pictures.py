"""What a run, or the folder of an earlier one, is turned into: files for other programs, and pictures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import click

from cosim.console import SEED, SETS, bar, naming, set_up_is_done, told_of_compiling, waiting
from cosim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from cosim.export.recording import Recording
    from cosim.simulation import Outcome, Simulation

MCAP_NEEDS: Final = ("mcap>=1.2",)
"""What writes MCAP files: the extra ``mcap`` of pyproject.toml."""


def metadata_of(simulation: Simulation, outcome: Outcome, seed: int) -> dict[str, str]:
    """Return what is kept with the tables of a run."""
    from cosim.scenario import dump

    return {
        "scenario": json.dumps(dump(simulation.scenario)),
        "seed": str(seed),
        "digest": outcome.digest,
        "metrics": json.dumps(outcome.metrics),
    }


def recording_of(simulation: Simulation, outcome: Outcome, seed: int) -> Recording:
    """Return what the exports read of a run that has been made."""
    from cosim.export.recording import of_run
    from cosim.web.scenes import scene_of

    scene = scene_of(simulation.scenario, simulation.floorplan, seed)
    return of_run(outcome.trace, scene, metadata_of(simulation, outcome, seed))


class Written(NamedTuple):
    """A file that was written of a run."""

    path: Path
    size: int
    what: str
    """Of which there are *size* in it."""
    more: str = ""

    def text(self) -> str:
        """Return a line for people."""
        return f"{self.size} {self.what} in {self.path}, {_size(self.path)}{self.more}"

    def plain(self) -> dict[str, Any]:
        """Return the same as plain data."""
        return {self.what: self.size, "output": str(self.path)}


def is_export(path: Path) -> bool:
    """Return whether *path* has the ending of what a run, not a sweep, is exported to."""
    return path.name.endswith((".mcap", ".json", ".json.gz"))


def check_endings(mcap: Path | None, perfetto: Path | None) -> None:
    """Raise UserError if the libraries that these files need are not there, or their names would not be known."""
    if mcap is not None:
        if mcap.suffix != ".mcap":
            raise UserError(f"--mcap {mcap}: expected a file that ends in .mcap")
        _check_mcap()
    if perfetto is not None and not perfetto.name.endswith((".json", ".json.gz")):
        raise UserError(f"--perfetto {perfetto}: expected a file that ends in .json or .json.gz")


def _check_mcap() -> None:
    from cosim.installed import check_libraries

    check_libraries("MCAP files", MCAP_NEEDS)


def write_exports(recording: Recording, mcap: Path | None, perfetto: Path | None) -> list[str]:
    """Write the files that were asked for, and return a line to tell of each."""
    return [write_export(recording, path).text() for path in (mcap, perfetto) if path is not None]


def write_export(recording: Recording, path: Path) -> Written:
    """Write *recording* to *path* in the format that its ending names."""
    if path.suffix == ".mcap":
        _check_mcap()
        from cosim.export.mcap import layout_path, write_mcap

        return Written(path, write_mcap(recording, path), "messages", f"; panels for it in {layout_path(path)}")
    from cosim.export.perfetto import write_perfetto

    return Written(path, write_perfetto(recording, path), "slices")


def _size(path: Path) -> str:
    return f"{path.stat().st_size / 1e6:.1f} MB"


# ---------------------------------------------------------------- picture


@click.command("picture", short_help="Draw a moment of a run, film it, or put it on one page.")
@click.argument("what")
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    help="A figure (.svg, .pdf, .png), a film (.mp4, .webp, .gif), or one page that needs no server (.html).",
)
@click.option("--at", "ats_s", type=float, multiple=True, help="s, the moment of a figure; several: as many floors.")
@click.option("--from", "from_s", type=float, help="s, where its boxes, a film, or a page begin.")
@click.option("--to", "to_s", type=float, help="s, where they end.")
@click.option("--seen", "seen_m", type=click.FloatRange(0, 1e6), help="m, shade what robots have had in sight within.")
@click.option("--channels", is_flag=True, help="Show a figure's frames on their RF channels, too.")
@click.option("--speed", type=click.FloatRange(1e-9, 1e6), default=1.0, help="Simulated seconds a second of a film.")
@click.option(
    "--boxes", type=click.Path(dir_okay=False, path_type=Path), help="Write what a figure draws as CSV there."
)
@click.option("--seed", type=SEED, help="Instead of the scenario's own.")
@SETS
@told_of_compiling()
def picture(what: str, output: Path, seed: int | None, sets: tuple[str, ...], **options: Any) -> None:
    """Draw WHAT, a scenario or the folder of an earlier run's tables: the floor, and below it the slots of its radios.

    A figure shows the moment --at, and the boxes from 10 ms before it to 10 ms after, or --from --to.
    """
    writer = _writers().get(output.suffix.lower())
    if writer is None:
        raise UserError(f"--output {output}: expected a file that ends in one of {', '.join(_writers())}")
    if output.suffix.lower() == ".mp4":
        from cosim.picture.film import encoder

        encoder()  # without one a run would be made for nothing
    recording = read_or_make(what, seed, sets)
    set_up_is_done()
    click.echo(writer(recording, output, options))


def read_or_make(what: str, seed: int | None, sets: tuple[str, ...]) -> Recording:
    """Return the recording in the folder *what*, or of a run of the scenario *what* that is made for it."""
    from cosim.experiment import scenario_named
    from cosim.export.recording import DRAWN, of_folder
    from cosim.simulation import Simulation
    from cosim.web.recorded import is_trace
    from cosim.web.scenes import read_scene

    if is_trace(Path(what)) or (Path(what).is_dir() and not (Path(what) / "sweep.yaml").is_file()):
        if sets or seed is not None:
            raise UserError(f"{what}: is a recorded run: its seed and settings are what they were")
        return of_folder(Path(what), read_scene(Path(what)))
    chosen = scenario_named(what, sets)
    seed = chosen.seed if seed is None else seed
    with naming(what, sets), waiting(f"{chosen.name}, seed {seed}"):
        simulation = Simulation(chosen, seed, DRAWN)
        set_up_is_done()
        outcome = simulation.run()
    return recording_of(simulation, outcome, seed)


def _writers() -> dict[str, Callable[[Recording, Path, Mapping[str, Any]], str]]:
    """Return who writes a file, by its ending."""
    figures = dict.fromkeys((".svg", ".pdf", ".png"), _figure)
    films = dict.fromkeys((".mp4", ".webp", ".gif"), _film)
    return {**figures, **films, ".html": _page}


def _figure(recording: Recording, path: Path, options: Mapping[str, Any]) -> str:
    from cosim.export.lanes import lanes
    from cosim.picture.moment import View, draw_moment, save_moment
    from cosim.picture.window import HALF, as_csv, first_moment

    found = lanes(recording)
    begin, end = (_time(recording, options, name) for name in ("from_s", "to_s"))
    moments = sorted(_checked(recording, "--at", at_s) for at_s in options["ats_s"])
    if not moments:
        moments = [first_moment(recording, found) if begin is None or end is None else (begin + end) // 2]
    *earlier, at = moments
    begin, end = max(0, at - HALF) if begin is None else begin, at + HALF if end is None else end
    _check_span(begin, end)
    figure, seen = draw_moment(
        recording, View(at, begin, end, options["channels"], tuple(earlier), options["seen_m"]), found
    )
    save_moment(figure, path)
    if options["boxes"] is not None:
        options["boxes"].write_text(as_csv(seen), encoding="utf-8")
    return f"{len(seen)} boxes in {path}"


def _film(recording: Recording, path: Path, options: Mapping[str, Any]) -> str:
    from cosim.picture.film import write_film

    begin, end = _time(recording, options, "from_s") or 0, _time(recording, options, "to_s") or recording.end
    _check_span(begin, end)
    with bar("pictures") as told:
        count = write_film(recording, path, (begin, end), options["speed"], told)
    return f"{count} pictures in {path}, {_size(path)}"


def _page(recording: Recording, path: Path, options: Mapping[str, Any]) -> str:
    from cosim.picture.page import write_page

    begin, end = _time(recording, options, "from_s") or 0, _time(recording, options, "to_s") or recording.end + 1
    _check_span(begin, end)
    count = write_page(recording, path, (begin, end))
    return f"{count} boxes in {path}, {_size(path)}"


def _time(recording: Recording, options: Mapping[str, Any], name: str) -> int | None:
    value = options[name]
    return None if value is None else _checked(recording, "--" + name.removesuffix("_s"), value)


def _checked(recording: Recording, option: str, value: float) -> int:
    from cosim.units import from_seconds, to_seconds

    if not 0 <= value <= to_seconds(recording.end) + 1:
        raise UserError(f"{option} {value:g}: is not from 0 to {to_seconds(recording.end):g} s, the end of the run")
    return from_seconds(value)


def _check_span(begin: int, end: int) -> None:
    if end <= begin:
        raise UserError(f"--to: {end / 1e9:g} s is not after {begin / 1e9:g} s, where it begins")
