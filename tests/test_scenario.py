import hashlib
import json
import pickle
import shutil
import sys
from pathlib import Path

import pytest

from cosim.errors import UserError
from cosim.scenario import Scenario, build, digest, dump, load, protocol_spec
from tests.checkout import DATA

DEPOT = {"duration_s": 60, "protocol": {"use": "beacon:SPEC"}}


@pytest.fixture(autouse=True)
def depot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in a folder that holds a user's own protocol and a scenario."""
    shutil.copy(DATA / "beacon.py", tmp_path)
    for name in ("beacon", "delays"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    path = Path("depot.yaml")
    path.write_text("duration_s: 60\nprotocol: {use: 'beacon:SPEC'}\n")
    return path


IDEAL = {"kind": "ideal", "delay_s": 1e-06, "jitter_s": 0.0, "loss": 0.0, "range_m": None}


def complaint(text: str, *sets: str) -> str:
    path = Path("depot.yaml")
    path.write_text("duration_s: 60\nprotocol: {use: 'beacon:SPEC'}\n" + text)
    with pytest.raises(UserError) as raised:
        load(path, sets)
    assert "\n" not in str(raised.value)
    return str(raised.value)


def test_every_default_is_written_out_in_the_dump(depot: Path):
    plain = dump(load(depot))
    assert plain["seed"] == 1
    assert plain["team"]["body"]["radius_m"] == 0.2
    assert plain["channel"] == IDEAL
    assert plain["protocol"]["parameters"] == {"calls": 3, "period_s": 1.0, "fail_at_size": 0}


def test_a_scenario_survives_json_and_pickle(depot: Path):
    scenario = load(depot, ["team.starts=[[1, 1], [2, 2], [3, 3], [4, 4]]", "protocol.parameters.calls=5"])
    again = Scenario.model_validate(json.loads(json.dumps(dump(scenario))))
    assert dump(again) == dump(scenario)
    copy = pickle.loads(pickle.dumps(scenario))
    assert copy == scenario
    assert copy.folder == scenario.folder
    assert copy.protocol.parameters.calls == 5


def test_times_are_integers(depot: Path):
    scenario = load(depot, ["tick_s=0.0125"])
    assert (scenario.tick, scenario.duration) == (12_500_000, 60_000_000_000)


def test_the_digest_knows_defaults_but_not_the_order_of_keys(depot: Path):
    plain = digest(dump(load(depot)))
    depot.write_text("protocol: {use: 'beacon:SPEC'}\nteam: {size: 4}\nduration_s: 60.0\n")
    assert digest(dump(load(depot))) == plain
    assert digest(dump(load(depot, ["team.size=3"]))) != plain
    assert digest({"a": 1, "b": 2}) == digest({"b": 2, "a": 1}) != digest({"a": 2, "b": 1})


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("team: {body: {radius_m: -0.2}}", "depot.yaml: team.body.radius_m: -0.2 is not > 0"),
        ("team: {body: {speed_mps: -1}}", "depot.yaml: team.body.speed_mps: -1 is not > 0"),
        ("team: {size: 9}", "depot.yaml: team.size: 9 is more than the 8 robots that beacon:SPEC can address"),
        ("team: {size: 0, sight_range_m: 0}", "depot.yaml: team.size: 0 is not >= 1 (and 1 more: team.sight_range_m)"),
        ("team: {size: many}", "depot.yaml: team.size: 'many' is not a valid integer"),
        ("team: {groups: []}", "depot.yaml: team.groups: []: tuple should have at least 1 item"),
        ("team: {groups: [{size: 2}, {size: 0}]}", "depot.yaml: team.groups[1].size: 0 is not >= 1"),
        (
            "team: {groups: [{size: 5}, {size: 4}]}",
            "depot.yaml: team.groups: 9 is more than the 8 robots that beacon:SPEC",
        ),
        ("team: {groups: [{power_class: 4}]}", "depot.yaml: team.groups[0].power_class: 4 is not 1, 2 or 3"),
        ("team: {groups: [{body: {radius_m: -1}}]}", "depot.yaml: team.groups[0].body.radius_m: -1 is not > 0"),
        (
            "team: {groups: [{bdy: 1}]}",
            "depot.yaml: team.groups[0].bdy: 1 is not expected here: there is no such key, did",
        ),
        (
            "team: {size: 3, groups: [{size: 2}]}",
            "depot.yaml: team.size: 3 is given, but groups have 2 robots together",
        ),
        (
            "team: {groups: [{size: 2}], starts: [[1, 1]]}",
            "depot.yaml: team.starts: 1 positions are given for 2 robots",
        ),
        ("team: [1]", "depot.yaml: team: [1] is not a mapping of settings"),
        ("team: {szie: 2}", "depot.yaml: team.szie: 2 is not expected here: there is no such key, did you mean size?"),
        ("tick_s: 0.1003", "depot.yaml: tick_s: 0.1003 is not a whole number of slots of 0.000625 s"),
        ("tick_s: 0.0000000001", "depot.yaml: tick_s: 1e-10 is not a whole number of slots of 0.000625 s"),
        ("tick_s: .nan", "depot.yaml: tick_s: nan is not a finite number"),
        ("team: {starts: [[1, 2], [3, 4]]}", "depot.yaml: team.starts: 2 positions are given for 4 robots"),
        ("team: {starts: [[1, 2], [3]]}", "depot.yaml: team.starts[1][1]: is missing"),
        (
            "channel: {kind: smoke}",
            "depot.yaml: channel.kind: 'smoke' is not a channel: expected one of adhoc, ble, bluetooth, ",
        ),
        ("channel: {delay_s: 1}", "depot.yaml: channel.kind: is missing, in {'delay_s': 1}"),
        ("channel: {kind: ideal, delay_s: 0}", "depot.yaml: channel.delay_s: 0 is not > 0"),
        (
            "channel: {kind: ideal, dely_s: 1}",
            "depot.yaml: channel.dely_s: 1 is not expected here: there is no such key, did",
        ),
        (
            "channel: {kind: bluetooth, air: shared}",
            "depot.yaml: channel.air: 'shared' is not expected here: there is no such key, but radios has one",
        ),
        (
            "channel: {kind: bluetooth, host_jitter_s: 1}",
            "depot.yaml: channel.host_jitter_s: 1 is not expected here: there is no such key, but adhoc has one",
        ),
        ("team:\n  size: 3\n  size: 4", "depot.yaml: line 5, column 3: the key 'size' stands twice"),
        ("team: {size: 3", "depot.yaml: line 4, column 1: "),
    ],
)
def test_an_error_names_file_place_value_and_expectation(text: str, expected: str):
    assert complaint(text + "\n").startswith(expected)


@pytest.mark.parametrize(
    ("choice", "expected"),
    [
        ("{use: 'beacon:SPEC', parameters: {calls: 0}}", "protocol.parameters.calls: 0 is not >= 1"),
        (
            "{use: 'beacon:SPEC', parameters: {cals: 1}}",
            "protocol.parameters.cals: 1 is not expected here: there is no such key, did you mean calls?",
        ),
        (
            "{use: 'beacon:NOT_A_SPEC'}",
            "protocol.use: 'beacon:NOT_A_SPEC' is not a protocol: a int, expected a ProtocolSpec",
        ),
        ("{use: 'nowhere:SPEC'}", "protocol.use: 'nowhere:SPEC' is not a protocol: No module named 'nowhere'"),
        (
            "{use: 'beacon:NOPE'}",
            "protocol.use: 'beacon:NOPE' is not a protocol: module 'beacon' has no attribute 'NOPE'",
        ),
        ("{use: smoke}", "protocol.use: 'smoke' is not a protocol: expected one of "),
        ("{parameters: {}}", "protocol.use: is missing"),
    ],
)
def test_a_protocol_and_its_parameters_are_checked_with_the_rest(choice: str, expected: str):
    Path("depot.yaml").write_text(f"duration_s: 60\nprotocol: {choice}\n")
    with pytest.raises(UserError) as raised:
        load(Path("depot.yaml"))
    assert str(raised.value).startswith(f"depot.yaml: {expected}")


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ("team.size=9", "--set team.size=9: 9 is more than the 8 robots that beacon:SPEC can address"),
        ("team.body.radius_m=-1", "--set team.body.radius_m=-1: -1 is not > 0"),
        ("team={size: 0}", "--set team={size: 0}: size: 0 is not >= 1"),
        ("team.szie=2", "--set team.szie=2: there is no team.szie, did you mean size?"),
        ("team.q=2", "--set team.q=2: there is no team.q, expected one of body, groups, power_class,"),
        ("team.size.x=2", "--set team.size.x=2: there is no team.size.x: team.size is 4"),
        ("protocol.parameters.call=2", "--set protocol.parameters.call=2: there is no protocol.parameters.call, did"),
        ("team.starts[0]=1", "--set team.starts[0]=1: there is no team.starts[0]: team.starts is None"),
        ("protocol.use=smoke", "--set protocol.use=smoke: 'smoke' is not a protocol"),
        ("team.size", "--set team.size: expected path=value"),
        ("team..size=3", "--set team..size=3: expected path=value"),
        ("team.size=[", "--set team.size=[: line 1, column 2: "),
        ("team.size=3", "depot.yaml with --set team.size=3: team.starts: 4 positions are given for 3 robots"),
    ],
)
def test_an_error_on_the_command_line_names_what_stood_there(change: str, expected: str):
    assert complaint(
        "team: {starts: [[1, 1], [2, 2], [3, 3], [4, 4]]}\n" if change == "team.size=3" else "", change
    ).startswith(expected)


MIXED = "team: {power_class: 3, groups: [{size: 2}, {body: {radius_m: 0.3}, power_class: 1}]}\n"


def test_a_mixed_team_has_the_size_bodies_and_radios_of_its_groups(depot: Path):
    depot.write_text(depot.read_text() + MIXED)
    team = load(depot, ["team.body.speed_mps=2"]).team
    assert team.size == 3
    assert [body.radius_m for body in team.bodies] == [0.2, 0.2, 0.3]
    assert [body.speed_mps for body in team.bodies] == [2.0, 2.0, 0.5]  # a group's body is its own as a whole
    assert team.power_classes == (3, 3, 1)


def test_robots_that_are_all_alike_have_one_body_and_leave_the_power_class_to_the_channel(depot: Path):
    team = load(depot, ["team.size=2", "team.body.radius_m=0.1"]).team
    assert [body.radius_m for body in team.bodies] == [0.1, 0.1]
    assert team.power_classes == (None, None)
    assert load(depot, ["team.size=2", "team.power_class=1"]).team.power_classes == (1, 1)


def test_the_groups_of_a_mixed_team_can_be_changed_one_by_one_and_its_size_only_with_them(depot: Path):
    depot.write_text(depot.read_text() + MIXED)
    assert load(depot, ["team.groups[0].size=4"]).team.size == 5
    scenario = load(depot)
    assert Scenario.model_validate(dump(scenario)) == scenario
    with pytest.raises(UserError, match=r"^--set team\.size=2: there is no team\.size"):
        load(depot, ["team.size=2"])


def test_values_of_set_are_yaml(depot: Path):
    scenario = load(depot, ["team.starts=[[1, 1], [2, 2], [3, 3], [4.5, 4]]", "team.starts[1][0]=7", "name=a b"])
    assert scenario.team.starts == ((1, 1), (7, 2), (3, 3), (4.5, 4))
    assert scenario.name == "a b"


def test_a_place_beyond_the_end_of_a_list_is_told():
    text = "team: {size: 1, starts: [[1, 1]]}\n"
    assert complaint(text, "team.starts[1][0]=7").startswith("--set team.starts[1][0]=7: there is no team.starts[1]: ")


def test_another_kind_of_channel_replaces_the_settings_of_the_first(depot: Path):
    depot.write_text(depot.read_text() + "channel: {kind: ideal, delay_s: 0.5}\n")
    plain = dump(load(depot, ["channel.n_bc=2", "channel.kind=bluetooth"]).channel)
    assert plain["kind"] == "bluetooth"
    assert plain["n_bc"] == 2
    assert dump(load(depot, ["channel.kind=ideal"]).channel) == IDEAL | {"delay_s": 0.5}


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "depot.yaml: holds nothing, expected a mapping of settings"),
        (b"- 1\n", "depot.yaml: holds [1], expected a mapping of settings"),
        (b"name: \xff\n", "depot.yaml: byte 6 is not UTF-8 text"),
        (b"a: \x00\n", "depot.yaml: is not YAML: unacceptable character #x0000"),
        (b"? [a]\n: 1\n", "depot.yaml: line 1, column 3: found unhashable key"),
    ],
)
def test_a_file_that_is_no_scenario_is_told_in_one_line(depot: Path, content: bytes, expected: str):
    depot.write_bytes(content)
    with pytest.raises(UserError) as raised:
        load(depot)
    assert str(raised.value).startswith(expected)
    assert "\n" not in str(raised.value)


def test_a_missing_file_is_told_in_one_line(tmp_path: Path):
    with pytest.raises(UserError, match=r"^nowhere\.yaml: cannot be read, expected a file: no such file or directory$"):
        load(Path("nowhere.yaml"))
    with pytest.raises(UserError, match=r"cannot be read, expected a file: is a directory$"):
        load(tmp_path)


def test_a_map_on_the_command_line_is_looked_for_where_the_user_stands(tmp_path: Path):
    (tmp_path / "scenarios").mkdir()
    for folder in (tmp_path, tmp_path / "scenarios"):
        (folder / "room.map").write_text(f"type octile\nheight 1\nwidth 1\nmap\n.\n{folder}")
    plain = {"duration_s": 1, "protocol": {"use": "beacon:SPEC"}, "floorplan": {"map": "room.map"}}
    path = tmp_path / "scenarios" / "one.yaml"
    path.write_text(json.dumps(plain))
    assert load(path).floorplan.map == "room.map"
    assert load(path).folder == path.parent
    assert load(path, ["floorplan.map=room.map"]).floorplan.map == str(tmp_path / "room.map")


def test_an_edited_map_is_another_configuration(tmp_path: Path):
    room = tmp_path / "room.yaml"
    room.write_text("image: room.pgm")
    (tmp_path / "room.pgm").write_text("one")
    scenario = build(DEPOT | {"floorplan": {"map": "room.yaml"}}, "depot.yaml", tmp_path)
    before = scenario.map_digests()
    assert len(before) == 2
    (tmp_path / "room.pgm").write_text("two")
    assert scenario.map_digests() != before
    assert build(DEPOT, "depot.yaml", tmp_path).map_digests() == []


def test_an_edited_image_of_any_name_is_another_configuration(tmp_path: Path):
    (tmp_path / "room.yaml").write_text("image: images/pic.pgm\n")
    (tmp_path / "images").mkdir()
    image = tmp_path / "images" / "pic.pgm"
    image.write_text("one")
    scenario = build(DEPOT | {"floorplan": {"map": "room.yaml"}}, "depot.yaml", tmp_path)
    before = scenario.map_digests()
    assert len(before) == 2
    image.write_text("two")
    assert scenario.map_digests() != before


@pytest.mark.parametrize(
    "content", [b"image: [", b"- 1\n", b"image: 3\n", b"\xff", b"image: nowhere.pgm\n", b"image: .\n"]
)
def test_a_map_that_is_broken_has_a_digest_of_its_own(tmp_path: Path, content: bytes):
    (tmp_path / "room.yaml").write_bytes(content)
    scenario = build(DEPOT | {"floorplan": {"map": "room.yaml"}}, "depot.yaml", tmp_path)
    assert scenario.map_digests() == [hashlib.sha256(content).hexdigest()]


def test_an_installed_protocol_is_found_by_its_name():
    assert protocol_spec("pseudonet").name == "pseudonet"
