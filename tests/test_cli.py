import gc
import json
import math
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml

from cosim.cli import main, nested_calls
from cosim.console import COMPILING
from cosim.documents import read_yaml
from cosim.jit import njit
from cosim.protocol import Metric
from cosim.results import RunStore
from cosim.simulation import Outcome, Simulation
from cosim.trace import CALLS, Trace
from tests.checkout import DATA

DEPOT: dict[str, Any] = {"name": "depot", "duration_s": 10, "protocol": {"use": "beacon:SPEC"}}
DELAYS = {
    "name": "delays",
    "run": "delays:metrics",
    "parameters": {"size": 1},
    "sweep": {"size": [2, 3]},
    "replicates": 2,
}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in a folder that holds a user's own protocol, functions and files."""
    for name in ("beacon", "delays"):
        shutil.copy(DATA / f"{name}.py", tmp_path)
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    Path("depot.yaml").write_text(yaml.safe_dump(DEPOT))
    Path("sweep.yaml").write_text(yaml.safe_dump(DELAYS, sort_keys=False))
    return tmp_path


def depot(**changes: Any) -> None:
    Path("depot.yaml").write_text(yaml.safe_dump(DEPOT | changes))


def files(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir() if path.name != "__pycache__"}


# ---------------------------------------------------------------- run


def test_run_prints_metrics_seed_and_digest(cosim: Any):
    ended = cosim("run", "depot.yaml")
    assert (ended.code, ended.err) == (0, "")
    lines = dict(line.split(maxsplit=1) for line in ended.out.splitlines())
    assert lines["heard"] == "36"  # four robots call three times, three others hear it
    assert lines["seed"] == "1"
    assert len(lines["digest"]) == 64


def test_run_prints_json_for_programs(cosim: Any):
    found = json.loads(cosim("run", "depot.yaml", "--json", "--seed", "5", "--set", "team.size=2").out)
    assert found["seed"] == 5
    assert found["metrics"]["heard"] == 6
    assert found["parameters"]["team"]["size"] == 2
    assert found.keys() == {"seed", "digest", "parameters", "metrics", "notices"}
    assert found["notices"] == []


def test_json_has_null_for_what_is_no_number(cosim: Any, monkeypatch: pytest.MonkeyPatch):
    outcome = Outcome({"found_s": math.nan, "far_m": math.inf, "heard": 1.0}, "d", Trace([]), 1.0, ())
    monkeypatch.setattr("cosim.simulation.Simulation.run", lambda self: outcome)
    assert strict(cosim("run", "depot.yaml", "--json").out)["metrics"] == {"found_s": None, "far_m": None, "heard": 1.0}
    made = SimpleNamespace(plain=lambda: {"rows": [{"mean": math.nan}, {"mean": 2.0}]})
    monkeypatch.setattr("cosim.report.sweep_report.report", lambda folder: made)
    assert strict(cosim("report", "r", "--json").out) == {"rows": [{"mean": None}, {"mean": 2.0}]}


def strict(text: str) -> Any:
    return json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))


def test_what_a_person_is_to_be_told_is_on_stderr_and_in_the_json(cosim: Any, monkeypatch: pytest.MonkeyPatch):
    made = Outcome({}, "d", Trace([]), 1.0, (), tuple(f"line {number}" for number in range(12)))
    monkeypatch.setattr("cosim.simulation.Simulation.run", lambda self: made)
    ended = cosim("run", "depot.yaml")
    assert ended.code == 0
    assert "line" not in ended.out
    assert ended.err.splitlines() == [*(f"line {number}" for number in range(9)), "and 3 more (--json has all)"]
    assert strict(cosim("run", "depot.yaml", "--json").out)["notices"] == list(made.notices)
    few = Outcome({}, "d", Trace([]), 1.0, (), made.notices[:10])
    monkeypatch.setattr("cosim.simulation.Simulation.run", lambda self: few)
    assert cosim("run", "depot.yaml").err.splitlines() == list(few.notices)


def test_metrics_are_printed_as_they_are_declared_and_none_is_left_out(cosim: Any, monkeypatch: pytest.MonkeyPatch):
    declared = (Metric("b", "s", ""), Metric("not_there", "1", ""), Metric("a", "1", ""))
    made = Outcome({"late": 3.0, "a": 1.0, "b": 2.0}, "d", Trace([]), 1.0, declared)
    monkeypatch.setattr("cosim.simulation.Simulation.run", lambda self: made)
    lines = [line.split() for line in cosim("run", "depot.yaml").out.splitlines()]
    assert lines == [["b", "2", "s"], ["a", "1"], ["late", "3"], ["seed", "1"], ["digest", "d"]]


def test_garbage_is_looked_for_while_a_run_lasts_and_after_it(cosim: Any, monkeypatch: pytest.MonkeyPatch):
    looked: list[bool] = []

    def run(self: Simulation) -> Outcome:
        looked.append(gc.isenabled())
        return Outcome({}, "d", Trace([]), 1.0, ())

    monkeypatch.setattr("cosim.simulation.Simulation.run", run)
    assert cosim("run", "depot.yaml").code == 0
    assert looked == [True]
    assert cosim("validate", "depot.yaml").code == 0
    assert gc.isenabled()


def test_the_seed_decides_the_digest(cosim: Any):
    digests = [json.loads(cosim("run", "depot.yaml", "--json", "--seed", seed).out)["digest"] for seed in "121"]
    assert digests[0] == digests[2] != digests[1]


def test_trace_writes_the_tables_and_shows_one_step_as_nested_calls(cosim: Any, tmp_path: Path):
    ended = cosim("run", "depot.yaml", "--trace", "tables")
    assert ended.code == 0
    tables = {"poses.parquet", "frames.parquet", "messages.parquet", "unsent.parquet"}
    tables |= {"calls.parquet", "events.parquet", "links.parquet", "payloads.parquet", "wakes.parquet"}
    tables |= {"transmissions.parquet", "receptions.parquet", "intervals.parquet"}
    tables |= {"maps.parquet", "ways.parquet", "estimates.parquet", "metrics.parquet", "energy.parquet"}
    assert files(tmp_path / "tables") == tables | {"scene.json"}
    help_text = cosim("run", "--help").out
    assert all(table.removesuffix(".parquet") in help_text for table in tables)
    assert "\n  beacon.call  2\n    radio.send\n\ntables in tables\n" in ended.out


def test_the_set_up_is_shown_and_a_step_that_lies_in_the_middle_and_goes_deep():
    calls = Trace([CALLS])
    for time, source, depth, name in (
        *((0, 0, 0, "first"), (0, 0, 1, "under_first"), (0, 0, 2, "deep_under_first")),
        *(
            (1, 0, 0, "early"),
            (1, 0, 0, "flat"),
            (2, 0, 0, "middle"),
            (2, 1, 0, "other"),
            (2, 0, 1, "under_middle"),
            (2, 1, 1, "stranger"),
        ),
        *((3, 0, 0, "next"), (4, 0, 0, "last")),
    ):
        calls.row(CALLS, time * 10**9, source, depth, "room", name, "")
    set_up, step = nested_calls(calls).split("\n\n")
    assert set_up == "robot 0 at 0.000000 s\n  room.first\n    room.under_first\n      room.deep_under_first"
    assert step == "robot 0 at 2.000000 s\n  room.middle\n    room.under_middle"
    assert nested_calls(Trace([CALLS])) == "(this protocol reports no calls)"


def test_run_takes_an_experiments_base_scenario(cosim: Any):
    Path("sweep.yaml").write_text(yaml.safe_dump({"scenario": DEPOT, "sweep": {"team.size": [2]}}))
    assert "heard" in cosim("run", "sweep.yaml").out
    assert json.loads(cosim("run", "sweep.yaml", "--json").out)["parameters"]["name"] == "depot"


# ---------------------------------------------------------------- what bad input gets


def write(name: str, content: str | bytes) -> str:
    Path(name).write_bytes(content.encode() if isinstance(content, str) else content)
    return name


def test_broken_yaml(cosim: Any):
    write("depot.yaml", "name: [1\nteam: 2\n")
    refuse(cosim, "depot.yaml: line 2, column 5: ", "run", "depot.yaml", "--trace", "t")


def test_an_unknown_key(cosim: Any):
    depot(teem={"size": 2})
    refuse(cosim, "depot.yaml: teem: {'size': 2} is not expected here: there is no such key, did you mean team?")


def test_a_map_that_is_missing(cosim: Any):
    depot(floorplan={"map": "nowhere.yaml"})
    refuse(cosim, "depot.yaml: floorplan.map: 'nowhere.yaml' is neither 'office' nor 'walls' nor a file")


def test_a_missing_map_on_the_command_line_is_not_blamed_on_the_file(cosim: Any):
    change = "floorplan.map=missing.map"
    for command in ("run", "validate"):
        refuse(cosim, f"--set {change}: 'missing.map' is neither", command, "depot.yaml", "--set", change)


def test_a_channel_that_is_no_mapping(cosim: Any):
    expected = "--set channel=ideal: 'ideal' is not a mapping of settings, expected a mapping such as {kind: ideal}"
    refuse(cosim, expected, "run", "depot.yaml", "--set", "channel=ideal")


def test_what_is_no_run_of_robots(cosim: Any):
    expected = "messaging_delay: is no run of robots but of experiments.messaging_delay.delay:measure: "
    refuse(cosim, f"{expected}cosim sweep messaging_delay makes it\n", "run", "messaging_delay")
    refuse(cosim, "sweep.yaml: is no run of robots but of delays:metrics: cosim sweep sweep.yaml", "run", "sweep.yaml")


def test_parameters_that_a_function_refuses(cosim: Any):
    change = "strategy=smoke"
    refuse(cosim, f"--set {change}: 'smoke' is not 'broadcast'", "sweep", "messaging_delay", "--set", change, "-o", "r")


def test_a_map_that_is_not_an_image(cosim: Any):
    write("room.pgm", "no image at all")
    write(
        "room.yaml",
        "image: room.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\n",
    )
    depot(floorplan={"map": "room.yaml"})
    refuse(cosim, "depot.yaml: room.pgm: not an image, expected PGM or PNG")


def test_a_robot_inside_a_wall(cosim: Any):
    depot(team={"size": 1, "starts": [[5.0, 0.1]]}, floorplan={"map": "walls", "walls": [[0, 0, 10, 0], [0, 5, 10, 5]]})
    refuse(cosim, "depot.yaml: ", about=("starts[0]: (5, 0.1) is inside a wall", "expected"))


def test_two_robots_in_one_place(cosim: Any):
    depot(team={"size": 2, "starts": [[3.0, 1.0], [3.1, 1.0]]})
    refuse(cosim, "depot.yaml: ", about=("starts[1]: (3.1, 1)", "two robots in one place"))


def test_more_robots_than_a_protocol_can_address(cosim: Any):
    depot(protocol={"use": "pseudonet"}, team={"size": 33}, channel={"kind": "bluetooth"})
    refuse(cosim, "depot.yaml: team.size: 33 is more than the 32 robots that pseudonet can address")


def test_a_negative_speed(cosim: Any):
    depot(team={"body": {"speed_mps": -0.5}})
    refuse(cosim, "depot.yaml: team.body.speed_mps: -0.5 is not > 0")


def test_a_path_that_set_does_not_find(cosim: Any):
    expected = "--set team.body.sped_mps=1: there is no team.body.sped_mps, did you mean speed_mps?"
    refuse(cosim, expected, "run", "depot.yaml", "--set", "team.body.sped_mps=1", "--trace", "t")


def refuse(cosim: Any, expected: str, *words: str, about: tuple[str, ...] = ()) -> None:
    """Assert that the command ends with 2 and one line, which starts as *expected*, and writes nothing."""
    before = files(Path())
    for command in (words,) if words else (("run", "depot.yaml", "--trace", "t"), ("validate", "depot.yaml")):
        code, out, err = cosim(*command)
        assert (code, out) == (2, "")
        assert err.startswith(expected)
        assert err.count("\n") == 1
        assert all(part in err for part in about)
    assert files(Path()) == before


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("run", "nowhere.yaml"), "nowhere.yaml: is neither a file nor an experiment"),
        (("run",), "Missing argument 'SCENARIO'."),
        (("fly",), "No such command 'fly'."),
        (("run", "depot.yaml", "--sed", "1"), "No such option '--sed'. (Did you mean"),
        (("run", "depot.yaml", "--seed", "-1"), "Invalid value for '--seed': -1 is not in the range 0<=x<="),
        (("sweep", "sweep.yaml", "--jobs", "0"), "Invalid value for '--jobs': 0 is not in the range x>=1."),
        (
            ("sweep", "sweep.yaml", "--jobs", "1", "--dask", "a:1"),
            "--jobs: is for processes of this computer, not beside",
        ),
        (("sweep", "sweep.yaml", "--set", "sise=3"), "--set sise=3: there is no sise, did you mean size?"),
        (("sweep", "depot.yaml"), "depot.yaml: duration_s: 10 is not expected here: there is no such key"),
        (("view", "nowhere.yaml"), "nowhere.yaml: is neither a file nor an experiment"),
        (("view", "depot.yaml", "--set", "team.sise=3"), "--set team.sise=3: there is no team.sise, did you mean"),
        (("view", "depot.yaml", "--port", "99999"), "Invalid value for '--port': 99999 is not in the range"),
        (("report", "nowhere"), "nowhere: holds no results, expected a folder that cosim sweep has written"),
        (("validate", "nowhere.yaml"), "nowhere.yaml: cannot be read, expected a file: no such file or directory"),
        (
            ("run", "depot.yaml", "--trace", "depot.yaml"),
            "Invalid value for '--trace': Directory 'depot.yaml' is a file.",
        ),
    ],
)
def test_a_wrong_command_is_told_in_one_line(cosim: Any, words: tuple[str, ...], expected: str):
    refuse(cosim, expected, *words)


def test_without_a_command_there_is_help_in_lines(cosim: Any):
    ended = cosim()
    assert (ended.code, ended.out) == (2, "")
    assert any(
        line.split() == ["run", "Make", "one", "run", "and", "print", "its", "metrics."]
        for line in ended.err.splitlines()
    )


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("duration_s=1.0e+308", ": 1e+308 is not <= 1e+09"),
        ("tick_s=1.0e+308", ": 1e+308 is not <= 1e+09"),
        (
            "floorplan.bounds_m=[0,0,1.0e+200,1.0e+200]",
            ": [2]: 1e+200 is not <= 1e+06 (and 1 more: floorplan.bounds_m[3])",
        ),
        ("floorplan.walls=[[0,0,1.0e+308,1]]", ": [0][2]: 1e+308 is not <= 1e+06"),
        ("floorplan.resolution_m=1.0e+300", ": 1e+300 is not <= 1e+06"),
        ("faults=[{kind: jammer, x_m: 1, y_m: 1, dwell_s: 1.0e+12}]", ": [0].dwell_s: 1000000000000.0 is not <= 1e+09"),
        ("team.size=100000", ": 100000 is not <= 10000"),
        ("protocol.parameters=!!timestamp x", ": line 1, column 1: 'x' is no timestamp"),
    ],
)
def test_numbers_beyond_all_measure_are_one_line(cosim: Any, setting: str, said: str):
    refuse(cosim, f"--set {setting}{said}\n", "validate", "depot.yaml", "--set", setting)


@pytest.mark.parametrize("setting", ["map", "wall_kind"])
def test_a_name_beyond_all_measure_is_one_line_that_can_be_read(cosim: Any, setting: str):
    code, out, err = cosim("validate", "depot.yaml", "--set", f"floorplan.{setting}={'x' * 5000}")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "xxx ... xxx" in err
    assert len(err) <= 301


def test_a_device_and_a_pipe_are_no_documents(cosim: Any):
    os.mkfifo("pipe")
    for name in ("pipe", "/dev/zero"):
        refuse(cosim, f"{name}: cannot be read, expected a file: is a pipe or a device", "validate", name)


def test_several_wrong_settings_are_all_named(cosim: Any):
    words = ("validate", "depot.yaml", "--set", "team.size=0", "--set", "tick_s=-1", "--set", "duration_s=0")
    refuse(cosim, "--set duration_s=0: 0 is not > 0 (and 2 more: tick_s, team.size)", *words)


def test_a_sweep_with_bad_input_writes_nothing(cosim: Any):
    Path("sweep.yaml").write_text(
        yaml.safe_dump({"scenario": DEPOT, "sweep": {"floorplan.map": ["office", "no.yaml"]}})
    )
    refuse(cosim, "sweep.yaml with map=no.yaml: floorplan.map: 'no.yaml' is neither", "sweep", "sweep.yaml", "-o", "r")


# ---------------------------------------------------------------- the computer's fault


def no_space(file: int) -> None:
    raise OSError(28, "No space left on device")


def test_a_full_disk_is_one_line_and_no_half_file(cosim: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("os.fsync", no_space)
    for words, kept in (
        (("run", "depot.yaml", "--trace", "t"), ""),
        (("sweep", "sweep.yaml", "--jobs", "1", "-o", "t"), ": what is finished is kept"),
    ):
        ended = cosim(*words)
        assert ended.code == 1
        assert ended.err == f"[Errno 28] No space left on device{kept}\n"
        assert not [path for path in (tmp_path / "t").rglob("*") if path.suffix in (".parquet", ".part")]


def test_a_folder_that_cannot_be_made_is_told_before_the_run(cosim: Any, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("cosim.simulation.Simulation.run", lambda self: pytest.fail("it has run"))
    ended = cosim("run", "depot.yaml", "--trace", "depot.yaml/t")
    assert (ended.code, ended.err) == (1, "[Errno 20] Not a directory: 'depot.yaml/t'\n")


@pytest.mark.parametrize("command", [("sweep", "sweep.yaml", "--jobs", "1", "-o", "r"), ("report", "r")])
def test_a_damaged_part_is_told_in_one_line(cosim: Any, command: tuple[str, ...]):
    cosim("sweep", "sweep.yaml", "--jobs", "1", "-o", "r")
    (part,) = Path("r/runs").glob("*.parquet")
    part.write_bytes(part.read_bytes()[:100])
    refuse(cosim, f"{part}: is not a whole Parquet file; delete it and sweep again\n", *command)


def test_a_bug_keeps_its_traceback(monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(RuntimeError, match="the beacons have broken down"):
        main(["run", "depot.yaml", "--set", "protocol.parameters.fail_at_size=4"])


def test_a_protocol_that_is_used_wrongly_is_told_in_the_first_line(cosim: Any, monkeypatch: pytest.MonkeyPatch):
    (Path("beacon.py")).write_text(Path("beacon.py").read_text().replace("bytes([self.me, self.called])", "'called'"))
    ended = cosim("run", "depot.yaml")
    first, second, *rest = ended.err.splitlines()
    assert ended.code == 1
    assert re.match(r"robot \d at 1\.0000\d\d s: Outgoing\(.*payload='called'.*: its payload is of the type str", first)
    assert (second, rest[0], rest[-1].partition(": ")[2]) == ("", "Traceback (most recent call last):", first)


def test_an_interrupt_ends_with_130(cosim: Any, monkeypatch: pytest.MonkeyPatch):
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("cosim.simulation.Simulation", interrupt)
    ended = cosim("run", "depot.yaml")
    assert (ended.code, ended.err.strip()) == (130, "interrupted: what is finished is kept")


@pytest.mark.slow
def test_a_closed_pipe_is_no_error():
    command = f"{sys.executable} -m cosim.cli validate depot.yaml | true; echo ${{PIPESTATUS[0]}}"
    ended = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=True)
    assert (ended.stdout, ended.stderr) == ("0\n", "")


# ---------------------------------------------------------------- sweep and report


def test_sweep_resumes_and_report_reads(cosim: Any, tmp_path: Path):
    assert (
        cosim("sweep", "sweep.yaml", "--jobs", "1").out == "4 runs, 0 of them were there already, in results/delays\n"
    )
    ended = cosim("sweep", "sweep.yaml", "--jobs", "1", "--replicates", "3", "--json")
    assert json.loads(ended.out) == {"folder": "results/delays", "runs": 6, "resumed": 4, "failures": [], "lacking": 0}
    assert len(RunStore(tmp_path / "results" / "delays").present()) == 6


def test_export_writes_the_last_sweep_as_one_file(cosim: Any):
    cosim("sweep", "sweep.yaml", "--jobs", "1", "-o", "r")
    cosim("sweep", "sweep.yaml", "--jobs", "1", "-o", "r", "--set", "size=2")
    assert cosim("export", "r", "out.csv").out == "2 rows in out.csv\n"
    assert Path("out.csv").read_text().splitlines()[0].startswith('"experiment","replicate","configuration","seed"')
    assert json.loads(cosim("export", "r", "out.csv", "--all", "--json").out) == {"rows": 4, "output": "out.csv"}
    assert cosim("export", "r", "out.parquet", "--table", "observations").out == "0 rows in out.parquet\n"
    refuse(cosim, "out.txt: expected a file that ends in .parquet or .csv", "export", "r", "out.txt")
    refuse(cosim, "sweep.yaml: holds no results", "export", "sweep.yaml", "out.csv")


@pytest.mark.slow
def test_report_prints_tables_and_the_paths_of_figures(cosim: Any):
    cosim("sweep", "sweep.yaml", "--jobs", "1", "--quick")
    ended = cosim("report", "results/delays-quick")
    assert (ended.code, ended.err) == (0, "")
    assert "figure: results/delays-quick/delay_s.png\n" in ended.out
    assert Path("results/delays-quick/delay_s.png").is_file()
    assert json.loads(cosim("report", "results/delays-quick", "--json").out)["experiment"] == "delays"


def test_a_failed_run_ends_with_1(cosim: Any):
    ended = cosim("sweep", "sweep.yaml", "--jobs", "1", "--set", "size=2", "-o", "r")
    assert ended.code == 0
    Path("sweep.yaml").write_text(yaml.safe_dump(DELAYS | {"parameters": {"size": 1, "broken": 2}}))
    ended = cosim("sweep", "sweep.yaml", "--jobs", "1", "-o", "r")
    assert ended.code == 1
    assert ended.err.splitlines()[0] == "failed: size=2, seed 1: ZeroDivisionError: nobody is there"


# ---------------------------------------------------------------- validate and list


def test_validate_prints_what_loads_to_the_same(cosim: Any, tmp_path: Path):
    depot(team={"size": 2, "starts": [[1.0, 1.0], [2.0, 1.0]]}, name="a: b # c")
    ended = cosim("validate", "depot.yaml")
    assert (ended.code, ended.err) == (0, "")
    assert "  size: 2  # number of robots; groups have sizes of their own\n" in ended.out
    assert "    calls: 3  # calls that each robot makes\n" in ended.out
    Path("again.yaml").write_text(ended.out)
    assert cosim("validate", "again.yaml").out == ended.out
    assert read_yaml(tmp_path / "again.yaml")["team"]["starts"] == [[1.0, 1.0], [2.0, 1.0]]


@pytest.mark.parametrize(("terminal", "told"), [(True, COMPILING), (False, "")])
def test_compiling_is_told_on_a_terminal_only(cosim: Any, terminal: bool, told: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("cosim.simulation.Simulation", lambda *_: njit()(lambda: 1)())
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal)
    ended = cosim("validate", "depot.yaml")
    assert ended.code == 0
    assert ended.err.startswith(told)
    assert ended.err.count("\n") == terminal


def test_validate_prints_a_mixed_team_without_the_size_that_follows(cosim: Any):
    depot(team={"groups": [{"size": 1}, {"size": 2, "radios": [0]}]})
    ended = cosim("validate", "depot.yaml")
    assert (ended.code, ended.err) == (0, "")
    assert "size" not in yaml.safe_load(ended.out)["team"]
    Path("again.yaml").write_text(ended.out)
    assert cosim("validate", "again.yaml").out == ended.out


def test_validate_prints_an_experiment(cosim: Any):
    plain = yaml.safe_load(cosim("validate", "sweep.yaml").out)
    unset = {"low": None, "high": None, "log": False, "titles": {}}
    assert plain["sweep"]["size"] == {"path": "size", "values": [2, 3]} | unset
    assert plain["design"] == {"kind": "product", "points": None}
    assert plain["replicates"] == 2


def test_list_names_what_there_is(cosim: Any):
    found = json.loads(cosim("list", "--json").out)
    assert found.keys() == {"experiments", "protocols", "channels", "maps"}
    assert "pseudonet" in found["protocols"]
    assert found["channels"].keys() == {"ideal", "optical", "bluetooth", "ble", "adhoc", "radios"}
    assert "pseudonet_coverage" in cosim("list").out


def test_help_and_version_end_with_0(cosim: Any):
    for words in (["--help"], ["run", "--help"], ["--version"]):
        assert cosim(*words).code == 0
