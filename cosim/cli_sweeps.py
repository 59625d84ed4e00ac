"""The commands about sweeps and what they leave: sweep, status, export; results ls, verify, merge, prune, command."""

from __future__ import annotations

import shlex
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from cosim.console import JSON, SETS, as_plain_json, bar, set_up_is_done, told_of_compiling, waiting
from cosim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterator


_UNITS: Final = {"": 1, "KB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12}
_FOLDER = click.Path(path_type=Path)
_OUTPUT = click.Path(file_okay=False, path_type=Path)
_RESULTS = click.argument("results", type=_FOLDER)


class Memory(click.ParamType[int]):
    """An amount of memory, such as 500MB or 2GB, in bytes."""

    name = "size"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Return the number of bytes."""
        if isinstance(value, int):
            return value
        text = value.upper().replace(" ", "")
        number = text.rstrip("KMGTB")
        try:
            found = float(number) * _UNITS[text[len(number) :]]
        except (ValueError, KeyError):
            found = 0
        if not 0 < found < 1e18:
            self.fail(f"{value!r} is no amount of memory, expected one such as 500MB or 2GB", param, ctx)
        return int(found)


# ---------------------------------------------------------------- sweep


@click.command("sweep", short_help="Make all runs of an experiment.")
@click.argument("experiment")
@click.option("--replicates", type=click.IntRange(min=1), help="Runs of each arm.")
@click.option("--jobs", type=click.IntRange(min=1), help="Processes; as many as there are processors by default.")
@click.option("--dask", metavar="ADDRESS", help="Of a Dask scheduler, whose workers make the runs; or slurm:FILE.")
@click.option(
    "--until-ci",
    "until",
    multiple=True,
    metavar="METRIC=SHARE",
    help="Replicates, 10 at least, --replicates at most, until the mean's 95 % interval is as narrow; may be repeated.",
)
@click.option("--shard", metavar="I/N", help="Make the I-th of N parts: for computers that know nothing of each other.")
@click.option("--run-timeout", type=click.FloatRange(min=0, min_open=True), metavar="SECONDS", help="Of a run at most.")
@click.option("--run-memory", type=Memory(), metavar="SIZE", help="Of a run at most, such as 2GB.")
@click.option("--retry-failed", is_flag=True, help="Make the runs that failed again.")
@click.option("--fail-fast", is_flag=True, help="End with the first run that fails.")
@click.option("--accept-code", "accepted", multiple=True, metavar="DIGEST", help="Keep what that older code has made.")
@click.option("--plan", is_flag=True, help="Say what is there, what is to do and how long it takes; make nothing.")
@click.option("--quick", is_flag=True, help="Cut down for a first look, as the experiment says.")
@SETS
@click.option("-o", "--output", type=_OUTPUT, help="Folder of the results.")
@JSON
@told_of_compiling()
def sweep(
    experiment: str,
    replicates: int | None,
    jobs: int | None,
    dask: str | None,
    until: tuple[str, ...],
    shard: str | None,
    run_timeout: float | None,
    run_memory: int | None,
    retry_failed: bool,
    fail_fast: bool,
    accepted: tuple[str, ...],
    plan: bool,
    quick: bool,
    sets: tuple[str, ...],
    output: Path | None,
    as_json: bool,
) -> int:
    """Make all runs of EXPERIMENT, a name or a sweep.yaml, that are not there yet."""
    from cosim.experiment import find_experiment, load_experiment
    from cosim.processes import Limits
    from cosim.results import RunStore
    from cosim.statistics.stopping import parse_precisions
    from cosim.sweep import WHOLE, Choice, Shard, default_folder, planned, run_sweep, run_until
    from cosim.upkeep import code_of

    if dask is not None and jobs is not None:
        raise UserError("--jobs: is for processes of this computer, not beside --dask")
    chosen = load_experiment(find_experiment(experiment), sets, quick, replicates)
    part = WHOLE if shard is None else Shard.parse(shard)
    folder = output or default_folder(chosen, quick, part)
    codes = tuple(code_of(RunStore(folder), each) for each in accepted)
    choice = Choice(part, codes, retry_failed, fail_fast, Limits(run_timeout, run_memory))
    wanted = parse_precisions(until)
    set_up_is_done()
    if plan:
        found = planned(chosen, folder, jobs, choice)
        click.echo(as_plain_json(found._asdict()) if as_json else found.text())
        return 0
    with _keeping(), _cluster(dask) as engine, bar(chosen.name) as told:
        if wanted:
            summary = run_until(chosen, folder, wanted, jobs, engine, told, choice)
        else:
            summary = run_sweep(chosen, folder, jobs, engine, told, choice)
    if as_json:
        click.echo(as_plain_json(summary._asdict()))
    else:
        click.echo(f"{summary.runs} runs, {summary.resumed} of them were there already, in {summary.folder}")
        if summary.lacking:
            click.echo(f"{summary.lacking} means are not as precise yet: more --replicates may do", err=True)
        for failure in summary.failures:
            click.echo(f"failed: {failure}", err=True)
    return 1 if summary.failures else 0


def _cluster(dask: str | None) -> Any:
    """Return the context of the engine on a cluster; of None if there is no cluster."""
    if dask is None:
        return nullcontext()
    from cosim.cluster import on_cluster

    return on_cluster(dask)


@contextmanager
def _keeping() -> Iterator[None]:
    """Say with an error of the computer's that a sweep loses nothing by it."""
    try:
        yield
    except OSError as error:
        raise OSError(f"{error}: what is finished is kept") from None


# ---------------------------------------------------------------- what a sweep leaves


@click.command("status", short_help="How far a sweep is, from another shell.")
@_RESULTS
@JSON
def status(results: Path, as_json: bool) -> None:
    """Print how many runs of the last sweep into RESULTS are there, how many failed, and how long the rest takes."""
    from cosim.results import RunStore
    from cosim.upkeep import status as status_of

    found = status_of(RunStore(results))
    click.echo(as_plain_json(found._asdict()) if as_json else found.text())


@click.command("report", short_help="Tables and figures of a sweep.")
@click.argument("results", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(dir_okay=False, path_type=Path), help="Write all as one HTML page.")
@JSON
def report(results: Path, output: Path | None, as_json: bool) -> None:
    """Print tables and write figures of RESULTS, ours beside the published ones."""
    from cosim.report.experiment_page import write_page
    from cosim.report.sweep_report import report as make_report

    set_up_is_done()
    with waiting(f"reading {results}"):
        found = make_report(results)
        if output is not None:
            write_page(output, results, found)
    if as_json:
        click.echo(as_plain_json(found.plain()))
    else:
        click.echo(found.text())


@click.command("reproduce", short_help="Run all experiments and judge all claims.")
@click.argument("experiments", nargs=-1)
@click.option("--quick", is_flag=True, help="Cut down for a first look, as each experiment says.")
@click.option("--jobs", type=click.IntRange(min=1), help="Processes; as many as there are processors by default.")
@click.option(
    "-o",
    "--output",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder of results and pages; results by default, or results/quick.",
)
@click.option("--keep", is_flag=True, help="Keep the verdicts beside each published.csv, as those of the whole sheet.")
@JSON
@told_of_compiling()
def reproduce(
    experiments: tuple[str, ...], quick: bool, jobs: int | None, output: Path | None, keep: bool, as_json: bool
) -> int:
    """Run EXPERIMENTS, all if none are named, and write a page for each and an index over all claims of all papers.

    Runs that are there already are not made again. All quick ones take 11 minutes of processor time. Exit code 1: an
    experiment, or a run of one, failed; a claim that fails is a result.
    """
    from cosim.report.reproduction import Reproduction

    found = Reproduction(experiments, output or Path("results/quick" if quick else "results"), quick, jobs)
    if keep and quick:
        raise UserError("--keep: keeps the verdicts of whole sheets, expected no --quick beside it")
    set_up_is_done()
    for number, name in enumerate(found.tried, start=1):
        with _keeping(), bar(f"{number} of {len(found.tried)}, {name}") as told:
            tried = found.make(name, told)
        click.echo(tried.line(), err=True)
    for path in found.keep_verdicts() if keep else ():
        click.echo(f"kept: {path}", err=True)
    click.echo(as_plain_json(found.plain()) if as_json else found.text())
    return 1 if found.failed else 0


@click.command("compare", short_help="What differs between two sweeps, or two arms of one.")
@click.argument("first", type=click.Path(path_type=Path))
@click.argument("second", type=click.Path(path_type=Path), required=False)
@click.option("--arm", "arms", multiple=True, metavar="AXIS=VALUE[,...]", help="Twice: two arms of FIRST.")
@click.option("--bootstrap", is_flag=True, help="Intervals of the BCa bootstrap, for skewed values.")
@JSON
def compare(first: Path, second: Path | None, arms: tuple[str, ...], bootstrap: bool, as_json: bool) -> None:
    """Print how means differ from the folder FIRST to SECOND, seed by seed where both have it, and what else does."""
    from cosim.report.differences import compare as compare_folders

    with waiting("comparing"):
        found = compare_folders(first, second, arms, bootstrap)
    click.echo(as_plain_json(found.plain()) if as_json else found.text())


@click.command("sensitivity", short_help="Which axis of a sweep moves which metric.")
@click.argument("results", type=click.Path(path_type=Path))
@JSON
def sensitivity(results: Path, as_json: bool) -> None:
    """Print Sobol's indices or Morris's effects of RESULTS, of a sweep with the design saltelli or morris."""
    from cosim.report.sensitivity import sensitivity as indices_of

    with waiting(f"reading {results}"):
        found = indices_of(results)
    click.echo(as_plain_json(found.plain()) if as_json else found.text())


@click.command("export", short_help="Write a sweep's table, or a run, as one file.")
@_RESULTS
@click.argument("output", type=click.Path(dir_okay=False, path_type=Path))
@click.option("--table", type=click.Choice(["runs", "observations"]), default="runs", help="Which; runs by default.")
@click.option("--all", "everything", is_flag=True, help="Those of older configurations and code too.")
@JSON
def export(results: Path, output: Path, table: str, everything: bool, as_json: bool) -> None:
    """Write the rows of the last sweep into RESULTS to OUTPUT, a .parquet (with units and meanings) or a .csv.

    If RESULTS is the folder of a run's tables (cosim run --trace), OUTPUT is an .mcap for Foxglove, or a .json or
    .json.gz for ui.perfetto.dev.
    """
    from cosim.cli_pictures import is_export, read_or_make, write_export
    from cosim.export.sweeps import export_results

    if is_export(output):
        recording = read_or_make(str(results), None, ())
        set_up_is_done()
        told = write_export(recording, output)
        click.echo(as_plain_json(told.plain()) if as_json else told.text())
        return
    set_up_is_done()
    count = export_results(results, output, table, everything)
    click.echo(as_plain_json({"rows": count, "output": str(output)}) if as_json else f"{count} rows in {output}")


@click.group("results", short_help="List, verify, merge and prune folders of results.")
def results_commands() -> None:
    """Look after folders of results: list, verify, merge and prune them, or repeat one run."""


@results_commands.command("ls", short_help="What folders of results hold.")
@click.argument("folders", nargs=-1, type=_FOLDER)
@JSON
def ls(folders: tuple[Path, ...], as_json: bool) -> None:
    """Print what the sweeps in FOLDERS, or in the folders in them, hold: by default those in results."""
    from cosim.results import RunStore
    from cosim.upkeep import content

    found = [
        content(RunStore(each))
        for folder in folders or (Path("results"),)
        for each in ([folder] if (folder / "sweep.json").is_file() else sorted(folder.glob("*/")))
        if (each / "sweep.json").is_file()
    ]
    if as_json:
        click.echo(as_plain_json([each.plain() for each in found]))
    else:
        click.echo("\n".join(each.text() for each in found) or "no results there")


@results_commands.command("verify", short_help="Whether what was written is what is there.")
@click.argument("folders", nargs=-1, required=True, type=_FOLDER)
def verify(folders: tuple[Path, ...]) -> int:
    """Compare the files in FOLDERS with the digests that were written down with them, and name what is damaged."""
    from cosim.results import RunStore
    from cosim.upkeep import damaged

    found = False
    for folder in folders:
        told = damaged(RunStore(folder))
        found |= bool(told)
        click.echo("\n".join(told) or f"{folder}: all is as it was written")
    return 1 if found else 0


@results_commands.command("merge", short_help="Join folders from several computers.")
@click.argument("output", type=_OUTPUT)
@click.argument("folders", nargs=-1, required=True, type=_FOLDER)
def merge(output: Path, folders: tuple[Path, ...]) -> None:
    """Join the rows in FOLDERS, all of one sweep (shards of it, or on several computers), into OUTPUT."""
    from cosim.results import RunStore
    from cosim.upkeep import merge as join
    from cosim.upkeep import status as status_of

    added = join(RunStore(output), [RunStore(folder) for folder in folders])
    click.echo(f"{added} rows added; {status_of(RunStore(output)).text()}")


@results_commands.command("prune", short_help="Remove what older settings and code have made.")
@_RESULTS
@click.option("--dry-run", is_flag=True, help="Say how many rows, and remove none.")
def prune(results: Path, dry_run: bool) -> None:
    """Remove the rows in RESULTS that do not belong to the last sweep into it."""
    from cosim.results import RunStore
    from cosim.upkeep import prune as remove_others

    count = remove_others(RunStore(results), dry_run)
    click.echo(f"{count} rows of older settings or code {'are there' if dry_run else 'removed'}")


@results_commands.command("command", short_help="The line that repeats one run.")
@_RESULTS
@click.argument("row", type=click.IntRange(min=0))
def command(results: Path, row: int) -> None:
    """Print the line that repeats the run in ROW of RESULTS, numbered from 0 as cosim export writes them."""
    from cosim.results import RunStore
    from cosim.sweep import command_of

    click.echo(shlex.join(command_of(RunStore(results), row)))


COMMANDS: Final = (sweep, status, report, reproduce, compare, sensitivity, export, results_commands)
"""The commands of this file."""
