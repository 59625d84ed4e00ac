"""The command line: results on stdout, progress on stderr, and for wrong input one line and exit 2.

Exit 0: done. 1: a run failed, or the computer did (a full disk). 2: the user's input is wrong. 130: interrupted.

A command imports what it needs when it runs: all of cosim takes seconds to load, and help is wanted at once.
"""

from __future__ import annotations

import gc
import json
import os
import sys
import traceback
from collections.abc import Iterator, Sequence
from functools import cache, partial
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, Final

import click

from cosim import __version__
from cosim.cli_pictures import check_endings, metadata_of, picture, recording_of, write_exports
from cosim.cli_sweeps import COMMANDS as SWEEP_COMMANDS
from cosim.console import JSON, SEED, SETS, as_plain_json, bar, naming, set_up_is_done, told_of_compiling, waiting
from cosim.errors import LocalProtocolError, UserError
from cosim.units import to_seconds
from cosim.web.pacing import FASTEST, SLOWEST

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from cosim.scenario import Scenario
    from cosim.settings import Settings
    from cosim.simulation import Outcome, Simulation
    from cosim.trace import Table, Trace
    from cosim.web.server import Session

MOST_NOTICES = 10
"""The most lines that a run says on stderr."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit with its code."""
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())  # a user's own protocol, module:name, stands where the user stands
    # the arrays here are short, and sweeps have a process for each processor: numpy is not to start threads of its own
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.exit(_guarded(arguments))


def _guarded(arguments: Sequence[str] | None) -> int:
    gc.disable()  # until a command is set up: what it loads and makes stays; to look through it took a seventh of a run
    try:
        code = commands.main(arguments, prog_name="cosim", standalone_mode=False)
        sys.stdout.flush()
    except click.exceptions.NoArgsIsHelpError as error:
        return _complain(error.ctx.get_help(), 2)
    except (UserError, click.ClickException) as error:
        text = error.format_message() if isinstance(error, click.ClickException) else str(error)
        return _complain(" ".join(text.split()), 2)
    except LocalProtocolError as error:  # a bug here or in somebody's protocol: what and where, then how it came to it
        return _complain(f"{error}\n\n{''.join(traceback.format_exception(error))}".rstrip(), 1)
    except (KeyboardInterrupt, click.Abort):
        return _complain("interrupted: what is finished is kept", 130)
    except (BrokenPipeError, SystemExit):  # (click's answer to a closed pipe) the reader has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return 0
    except OSError as error:  # its text ends with the name of the file, if it has one
        return _complain(" ".join(str(error).split()), 1)
    finally:
        set_up_is_done()
    return code if isinstance(code, int) else 0


def _complain(line: str, code: int) -> int:
    print(line, file=sys.stderr)
    return code


class _Commands(click.Group):
    """cosim's own commands, and one for each page that installed protocols bring."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted({*self.commands, *_pages()})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        return self.commands.get(cmd_name) or _page_command(cmd_name)


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__)
def commands() -> None:
    """Robot teams and their radios on one clock: does an algorithm still work when its messages take their time?"""


# ---------------------------------------------------------------- run


@commands.command("run", short_help="Make one run and print its metrics.")
@click.argument("scenario")
@click.option("--seed", type=SEED, help="Instead of the scenario's own.")
@SETS
@click.option(
    "--trace",
    "trace",
    type=click.Path(file_okay=False, path_type=Path),
    help="Write the tables there: poses, what was on the air (frames, transmissions, receptions, unsent), what radios "
    "hold (payloads), what lasts (intervals: links, crashes, jammers ...), what machines get, do and report "
    "(messages, links, wakes, events, calls), and what robots believe (maps, ways, estimates); metrics, energy.",
)
@click.option(
    "--pcapng",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Write the frames of Bluetooth and 802.11 radios there, for Wireshark.",
)
@click.option(
    "--mcap",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Write robots, links, frames and events there, for Foxglove; its panels beside it.",
)
@click.option(
    "--perfetto",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Write what the radios do there, as lanes for ui.perfetto.dev: .json or .json.gz.",
)
@JSON
@told_of_compiling()
def run(
    scenario: str,
    seed: int | None,
    sets: tuple[str, ...],
    trace: Path | None,
    pcapng: Path | None,
    mcap: Path | None,
    perfetto: Path | None,
    as_json: bool,
) -> None:
    """Make one run of SCENARIO, a YAML file or an experiment's name, and print its metrics."""
    from cosim.experiment import scenario_named
    from cosim.scenario import dump
    from cosim.simulation import Simulation

    check_endings(mcap, perfetto)
    chosen = scenario_named(scenario, sets)
    tables = _tables(chosen, trace, pcapng, mcap or perfetto)
    if trace and "trace_calls" in type(chosen.protocol.parameters).model_fields:
        chosen = scenario_named(scenario, (*sets, "protocol.parameters.trace_calls=true"))
    seed = chosen.seed if seed is None else seed
    with naming(scenario, sets), waiting(f"{chosen.name}, seed {seed}"):
        simulation = Simulation(chosen, seed, tables)
        for folder in (trace, *(path and path.parent for path in (pcapng, mcap, perfetto))):
            if folder is not None:  # a folder that cannot be made shows now, not after the run
                folder.mkdir(parents=True, exist_ok=True)
        set_up_is_done()
        outcome = simulation.run()
    for line in _few(outcome.notices):
        click.echo(line, err=True)
    if trace is not None:
        outcome.trace.write(trace, metadata_of(simulation, outcome, seed))
        _write_scene(simulation, seed, trace)
    written = [] if pcapng is None else [_capture(pcapng, simulation, f"{chosen.name}, seed {seed}, {outcome.digest}")]
    if mcap or perfetto:
        written += write_exports(recording_of(simulation, outcome, seed), mcap, perfetto)
    if as_json:
        found = {"seed": seed, "digest": outcome.digest, "parameters": dump(chosen), "metrics": outcome.metrics}
        found["notices"] = outcome.notices
        click.echo(as_plain_json(found))
        return
    click.echo(_metrics(outcome, seed))
    if trace is not None:
        click.echo(
            f"\nthe set-up and one step, as the calls of the rooms:\n{nested_calls(outcome.trace)}\n\ntables in {trace}"
        )
    for line in written:
        click.echo(f"\n{line}")


def _tables(scenario: Scenario, trace: Path | None, pcapng: Path | None, exported: Path | None) -> Sequence[Table]:
    """Return the tables that a run keeps for what is written of it."""
    from cosim.export.recording import DRAWN
    from cosim.trace import TABLES

    wanted = (*(TABLES.values() if trace else ()), *(_captured_tables(scenario) if pcapng else ()))
    return (*wanted, *(DRAWN if exported else ()))


def _few(lines: Sequence[str]) -> list[str]:
    """Return the first of *lines*, and how many more there are."""
    if len(lines) <= MOST_NOTICES:
        return list(lines)
    return [*lines[: MOST_NOTICES - 1], f"and {len(lines) - MOST_NOTICES + 1} more (--json has all)"]


def _write_scene(simulation: Simulation, seed: int, folder: Path) -> None:
    """Write what the pages need beside the tables of a run."""
    from cosim.web.scenes import scene_of, write_scene

    write_scene(scene_of(simulation.scenario, simulation.floorplan, seed), folder)


def _captured_tables(scenario: Scenario) -> Sequence[Table]:
    """Return the tables of what a capture of *scenario* shows; raise UserError if there is nothing."""
    from cosim.export.capture import CAPTURED, captured_tables

    tables = captured_tables(scenario.channel)
    if not tables:
        kind, known = scenario.channel.kind, ", ".join(map(repr, CAPTURED))
        raise UserError(f"--pcapng: channel.kind is {kind!r}, captures are of {known} only")
    return tables


def _capture(path: Path, simulation: Simulation, comment: str) -> str:
    """Write the frames of a run to *path*, and return what to tell of it."""
    from cosim.export.capture import write_capture

    count = write_capture(path, simulation.channel, simulation.trace, comment)
    return f"{count} frames in {path}, {path.stat().st_size / 1e6:.1f} MB"


def _metrics(outcome: Outcome, seed: int) -> str:
    units = {metric.name: metric.unit for metric in outcome.metric_columns}
    width = max(map(len, outcome.metrics), default=0)
    lines = [
        f"{name:<{width}}  {outcome.metrics[name]:g} {units.get(name, '').removeprefix('1')}".rstrip()
        for name in dict.fromkeys((*units, *outcome.metrics))  # as they are declared: what matters comes first
        if name in outcome.metrics
    ]
    return "\n".join([*lines, f"{'seed':<{width}}  {seed}", f"{'digest':<{width}}  {outcome.digest}"])


def nested_calls(trace: Trace) -> str:
    """Return the calls of the set-up and of one step in the middle of the run, indented by depth.

    Each is what one robot did from a call at depth 0 to its next; of the steps in the middle, the one with the deepest
    calls, and of those the lowest robot's.
    """
    from cosim.trace import CALLS

    columns = trace.columns(CALLS.name)
    calls = list(zip(*(columns[field.name] for field in CALLS.fields), strict=True))
    tops = [number for number, call in enumerate(calls) if call[2] == 0]
    if not tops:
        return "(this protocol reports no calls)"
    step = _deepest(calls, tops[len(tops) // 3 : len(tops) - len(tops) // 3] or tops)
    return "\n\n".join(_block(calls, top) for top in dict.fromkeys((tops[0], step)))


def _block(calls: Sequence[tuple[Any, ...]], first: int) -> str:
    time, robot = calls[first][:2]
    lines = [f"robot {robot} at {to_seconds(time):.6f} s"]
    for _, source, depth, room, call, detail in calls[first:]:
        if source == robot:
            if depth == 0 and len(lines) > 1:
                break
            lines.append(f"{'  ' * (depth + 1)}{room}.{call}  {detail}".rstrip())
    return "\n".join(lines)


def _deepest(calls: Sequence[tuple[Any, ...]], tops: Sequence[int]) -> int:
    """Return the first of *tops*, numbers of calls at depth 0, below which the calls go deepest."""
    depths: dict[int, int] = dict.fromkeys(tops, 0)
    latest: dict[int, int] = {}
    for number, call in enumerate(calls):
        if call[2] == 0:
            latest[call[1]] = number
        top = latest.get(call[1], -1)
        if top in depths:
            depths[top] = max(depths[top], call[2])
    return max(tops, key=lambda top: (depths[top], -calls[top][1]))


# ---------------------------------------------------------------- live


@commands.command("live", short_help="Make a run on the wall clock, each robot a process.")
@click.argument("scenario")
@click.option("--udp", is_flag=True, help="Robots talk by UDP, on 127.0.0.1 only: there is no other way yet.")
@click.option("--seed", type=SEED, help="Instead of the scenario's own.")
@SETS
@JSON
@told_of_compiling()
def live(scenario: str, udp: bool, seed: int | None, sets: tuple[str, ...], as_json: bool) -> None:
    """Make a run of SCENARIO in real time: each robot's machine is a process, and its payloads are UDP datagrams."""
    from cosim.experiment import scenario_named
    from cosim.live.team import live as make
    from cosim.scenario import dump

    if not udp:
        raise UserError("--udp is missing: robots talk by UDP, on 127.0.0.1 only, and by nothing else yet")
    chosen = scenario_named(scenario, sets)
    seed = chosen.seed if seed is None else seed
    with naming(scenario, sets):
        outcome = make(chosen, seed, partial(click.echo, err=True))
    for line in _few(outcome.notices):
        click.echo(line, err=True)
    if as_json:
        found = {"seed": seed, "parameters": dump(chosen), "metrics": outcome.metrics, "notices": outcome.notices}
        click.echo(as_plain_json(found))
        return
    click.echo(_metrics(outcome, seed))


# ---------------------------------------------------------------- view, and the pages of protocols

WEB_NEEDS: Final = ("starlette>=0.40", "uvicorn>=0.52.1", "websockets>=13")
"""What the server of the pages is made of: the extra ``web`` of pyproject.toml."""
_PAGE = (
    click.option("--seed", type=SEED, help="Instead of the scenario's own."),
    SETS,
    click.option("--port", type=click.IntRange(0, 65535), default=0, help="Of the page, on 127.0.0.1; 0: a free one."),
    click.option("--open", "in_browser", is_flag=True, help="Open the page in the browser."),
    click.option("--paused", is_flag=True, help="Do not begin before the page says so."),
    click.option("--token", "secret", is_flag=True, help="Ask for a secret that only the printed address has."),
)


def _page_options(command: Any) -> Any:
    """Give *command* the options of all commands that show a page."""
    for option in reversed(_PAGE):
        command = option(command)
    return command


@commands.command("view", short_help="Show a run, or two side by side, in a browser.")
@click.argument("what")
@click.argument("other", required=False)
@_page_options
@told_of_compiling()
def view(what: str, other: str | None, seed: int | None, sets: tuple[str, ...], paused: bool, **showing: Any) -> None:
    """Show WHAT in a browser: a scenario, run live, or the folder of an earlier run's tables (cosim run --trace).

    With OTHER both are folders of earlier runs, which are shown side by side on one clock.
    """
    from cosim.experiment import scenario_named
    from cosim.installed import check_libraries
    from cosim.web.anew import Anew
    from cosim.web.beside import Beside
    from cosim.web.live import Live, rehearse
    from cosim.web.recorded import Recorded, is_trace
    from cosim.web.server import PAIR

    check_libraries("pages", WEB_NEEDS)
    session: Session
    for folder in () if other is None else (what, other):
        if not is_trace(Path(folder)):
            raise UserError(
                f"{folder}: two runs side by side are recorded ones: expected a folder of cosim run --trace"
            )
    if is_trace(Path(what)):
        if sets or seed is not None:
            raise UserError(f"{what}: is a recorded run: its seed and settings are what they were")
        runs = []
        for folder in (what,) if other is None else (what, other):
            with bar("lanes of the timeline, once") as told:
                runs.append(Recorded(Path(folder), playing=not paused, told=told, say=_aside))
        if other is not None:
            _show(Beside(runs), PAIR, framed=runs, **showing)
            return
        (session,) = runs
    else:
        chosen = scenario_named(what, sets)
        with naming(what, sets):
            rehearse(chosen, chosen.seed if seed is None else seed)
            session = Anew(lambda: Live(chosen, chosen.seed if seed is None else seed, playing=not paused))
    _show(session, None, **showing)


def _aside(line: str) -> None:
    """Tell the user *line*, beside what the command prints."""
    click.echo(line, err=True)


def _show(
    session: Session,
    html: Path | None,
    port: int,
    in_browser: bool,
    secret: bool,
    framed: Sequence[Session] = (),
) -> None:
    """Serve *session* with the page *html*, or that of ``cosim view``, until the user interrupts it.

    *framed* are the sessions that the page has in frames.
    """
    import secrets
    import webbrowser

    from cosim.web.server import VIEW, serve

    def tell(address: str) -> None:
        click.echo(f"{address}\nCtrl-C ends it")
        sys.stdout.flush()
        if in_browser:
            webbrowser.open(address)

    set_up_is_done()
    serve(session, html or VIEW, port, secrets.token_urlsafe(16) if secret else None, tell, framed)


@cache
def _pages() -> dict[str, EntryPoint]:
    """Return the entry points of the pages that installed protocols bring, by the names of their commands."""
    from importlib.metadata import entry_points

    return {point.name: point for point in entry_points(group="cosim.pages")}


def _page_command(name: str) -> click.Command | None:
    """Return the command that shows the page *name* of a protocol; None if no installed protocol brings one."""
    from cosim.page import WebPage

    if name not in _pages():
        return None
    from cosim.installed import loaded

    try:
        page = loaded(_pages()[name])
        if not isinstance(page, WebPage):
            raise ImportError(f"{_pages()[name].value} is no cosim.page.WebPage")
    except ImportError as error:  # somebody's package that is broken must not hide the other commands
        return _broken_command(name, f"{name}: {error}")

    @click.command(name, help=page.help, short_help=page.about)
    @click.argument("scenario")
    @_page_options
    @click.option("--speed", type=click.FloatRange(SLOWEST, FASTEST), default=1.0, help="Simulated seconds a second.")
    @told_of_compiling()
    def operate(
        scenario: str, seed: int | None, sets: tuple[str, ...], paused: bool, speed: float, **showing: Any
    ) -> None:
        from cosim.experiment import find_beside, scenario_named
        from cosim.installed import check_libraries
        from cosim.web.anew import Anew
        from cosim.web.live import Live, rehearse

        check_libraries("pages", WEB_NEEDS)
        chosen = scenario_named(str(find_beside(scenario, page.scenario)), sets)
        with naming(scenario, sets):
            rehearse(chosen, chosen.seed if seed is None else seed, attended=True)
            session = Anew(
                lambda: Live(chosen, chosen.seed if seed is None else seed, not paused, speed, attended=True)
            )
        # a protocol's own page knows best what its consoles say
        _show(session, (chosen.protocol.spec.page or page).html, **showing)

    return operate


def _broken_command(name: str, why: str) -> click.Command:
    """Return a command that says *why* it does nothing, whatever it is given."""

    def fail() -> None:
        raise UserError(why)

    anything = {"ignore_unknown_options": True, "allow_extra_args": True}
    return click.Command(name, callback=fail, short_help=why, add_help_option=False, context_settings=anything)


# ---------------------------------------------------------------- pin


@commands.command("pin", short_help="Keep what runs compute, and notice when it changes.")
@click.argument("scenarios", nargs=-1)
@click.option("--seed", "seeds", type=SEED, multiple=True, help="Instead of the scenario's own; may be repeated.")
@click.option("-o", "--output", type=click.Path(dir_okay=False, path_type=Path), help="Write the pins there.")
@click.option("--check", type=click.Path(dir_okay=False, path_type=Path), help="Compare with the pins there.")
@JSON
@told_of_compiling()
def pin(
    scenarios: tuple[str, ...], seeds: tuple[int, ...], output: Path | None, check: Path | None, as_json: bool
) -> int:
    """Run SCENARIOS and keep their digests, metrics and, second by second, their events; or --check what was kept.

    Each of SCENARIOS is a YAML file or the name of an experiment, of which all runs are made.
    """
    from cosim.pins import cases_in, check_pins, made_elsewhere, read_pins, write_pins

    if check is None:
        if output is None or not scenarios:
            raise UserError("pin: expected SCENARIOS and -o FILE, or --check FILE")
        cases = cases_in(scenarios, output.parent, seeds)
        set_up_is_done()
        with bar("pins") as told:
            write_pins(output, cases, told)
        click.echo(
            as_plain_json({"runs": len(cases), "pins": str(output)}) if as_json else f"{len(cases)} runs in {output}"
        )
        return 0
    if output is not None or scenarios or seeds:
        raise UserError("--check: the runs are those of the file, expected neither SCENARIOS nor --seed nor -o")
    pins = read_pins(check)
    elsewhere = made_elsewhere(pins)
    set_up_is_done()
    findings = []
    with bar("pins") as told:
        for finding in check_pins(pins, check.parent, told):
            findings.append(finding)
            if not as_json:
                click.echo(f"{finding.case}: {finding.text}")
    differing = sum(not finding.same for finding in findings)
    if as_json:
        runs = [{**each.case._asdict(), "same": each.same, "text": each.text} for each in findings]
        click.echo(as_plain_json({"runs": runs, "differing": differing, "made_elsewhere": elsewhere}))
    else:
        click.echo(f"{len(findings) - differing} of {len(findings)} runs are the same")
    if elsewhere and differing:
        click.echo(f"made with {elsewhere}: so what differs is no failure", err=True)
    return 1 if differing and not elsewhere else 0


# ---------------------------------------------------------------- warm


@commands.command("warm", short_help="Compile what runs commonly use.")
@JSON
def warm(as_json: bool) -> None:
    """Compile what runs commonly use, by short runs on all processors, so that no other run waits for it."""
    from cosim.warm import short_runs
    from cosim.warm import warm as make

    began = perf_counter()
    runs = short_runs()
    finished = []
    with bar("short runs") as told:
        for each in make(runs):
            finished.append(each)
            told(len(finished), len(runs))
            if each.kernels and not as_json:
                protocol, channel = each.run
                click.echo(f"{each.kernels:4d} kernels in {each.wall_s:4.1f} s: {protocol}, {channel}")
    kernels, wall_s = sum(each.kernels for each in finished), perf_counter() - began
    if as_json:
        click.echo(as_plain_json({"kernels": kernels, "wall_s": wall_s, "runs": [each.plain() for each in finished]}))
        return
    for protocol, why in {each.run.protocol: each.refused for each in finished if each.refused}.items():
        click.echo(f"left out: {protocol}: {why}")
    click.echo(f"{f'{kernels} kernels compiled' if kernels else 'nothing to compile'}: {wall_s:.1f} s")


# ---------------------------------------------------------------- validate and list


@commands.command("validate", short_help="Say what is wrong with a file.")
@click.argument("file", type=click.Path(path_type=Path))
@SETS
@told_of_compiling()
def validate(file: Path, sets: tuple[str, ...]) -> None:
    """Say what is wrong with FILE, a scenario or a sweep.yaml, or print it with all defaults and what they mean."""
    import yaml

    from cosim.documents import read_yaml
    from cosim.experiment import is_experiment, load_experiment
    from cosim.scenario import dump, load
    from cosim.simulation import Simulation

    plain = read_yaml(file)
    if is_experiment(plain):
        from cosim.sweep import check_set_up

        experiment = load_experiment(file, sets)
        set_up_is_done()
        check_set_up(experiment)
        base = "parameters" if experiment.settings.scenario is None else "scenario"
        click.echo(yaml.safe_dump(dump(experiment.settings) | {base: experiment.base}, sort_keys=False), nl=False)
        return
    scenario = load(file, sets)
    with naming(str(file), sets):
        Simulation(scenario, scenario.seed)
    click.echo("\n".join(described(scenario)))


def described(settings: Settings, indent: int = 0) -> Iterator[str]:
    """Yield the lines of *settings* as YAML, with the description of each as a comment."""
    import yaml

    from cosim.scenario import dump
    from cosim.settings import Settings

    plain = dump(settings)
    for name, field in type(settings).model_fields.items():
        if name not in plain:  # it follows from others, and is not to be given beside them
            continue
        start = f"{'  ' * indent}{name}:"
        value = getattr(settings, name)
        comment = f"  # {field.description}" if field.description else ""
        if isinstance(value, Settings) and type(value).model_fields:
            yield start + comment
            yield from described(value, indent + 1)
        else:
            flow = yaml.safe_dump(plain[name], default_flow_style=True, width=10**9).removesuffix("...\n").strip()
            yield f"{start} {flow}{comment}"


@commands.command("list", short_help="Print what there is to run.")
@JSON
def list_all(as_json: bool) -> None:
    """Print the experiments, protocols, channels and maps that there are."""
    from cosim.channels.kinds import channel_kinds
    from cosim.documents import read_yaml
    from cosim.experiment import experiment_folders
    from cosim.scenario import protocol_names

    found = {
        "experiments": {
            name: str(read_yaml(at / "sweep.yaml").get("about", "")) for name, at in experiment_folders().items()
        },
        "protocols": {name: _about_protocol(name) for name in protocol_names()},
        "channels": {name: _about_channel(name) for name in channel_kinds()},
        "maps": _maps(),
    }
    if as_json:
        click.echo(json.dumps(found, indent=2))
        return
    width = max(len(name) for names in found.values() for name in names)
    for kind, names in found.items():
        click.echo(kind)
        for name, about in names.items():
            click.echo(f"  {name:<{width}}  {about}".rstrip())


def _about_protocol(name: str) -> str:
    from cosim.scenario import protocol_spec

    try:
        spec = protocol_spec(name)
        return spec.about or _first_line(spec.parameters)
    except ValueError as error:  # somebody's package that is broken must not hide the others
        return str(error)


def _about_channel(name: str) -> str:
    from cosim.channels.kinds import channel_spec

    try:
        return _first_line(channel_spec(name).settings)
    except ValueError as error:  # as above
        return str(error)


def _first_line(thing: object) -> str:
    return (thing.__doc__ or "").strip().partition("\n")[0]


def _maps() -> dict[str, str]:
    from cosim.installed import installed_folders

    maps = {"office": "generated from floorplan.office", "walls": "drawn in the scenario: floorplan.walls and polygons"}
    for folder in installed_folders("cosim.maps").values():
        maps |= {str(path): "a floor of ours" for path in sorted(folder.glob("*.yaml"))}
    return maps


for each in (*SWEEP_COMMANDS, picture):
    commands.add_command(each)

if __name__ == "__main__":
    main()
