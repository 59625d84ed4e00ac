"""Stations in the background as exports and pictures have them: where they are, by names that are no robot's."""

import json
import re
import struct
import zlib
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from cosim.cli import nested_calls
from cosim.decoding import frame_said
from cosim.export.capture import write_capture
from cosim.export.mcap import layout_path, write_mcap
from cosim.export.perfetto import events
from cosim.export.recording import Recording
from cosim.picture.film import write_film
from cosim.picture.moment import View, draw_moment
from cosim.picture.page import packed, write_page
from cosim.units import MS
from tests.export.capture_reading import blocks
from tests.export.stationed import NAMES, PLACES, RADIOS, ROBOTS, SCENARIO, Stationed, make
from tests.export.test_mcap import read as read_mcap
from tests.export.test_page import shown

pytestmark = pytest.mark.slow
NO_ROBOT = re.compile(r"robot[ _][2-9]")
"""What calls a station a robot."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Stationed:
    return make(tmp_path_factory.mktemp("stationed"))


def links(made: Stationed) -> dict[tuple[int, int], int]:
    """Return when each pair has made its link, as the first of them knows."""
    states = made.tables["intervals"]
    rows = states[states.state.isin(["master", "central"])]
    told = zip(rows.robot, rows.detail, rows.start_ns, strict=True)
    return {(robot, int(re.search(r"(?:slave|peer)=(\d+)", detail)[1])): start for robot, detail, start in told}


def moment(made: Stationed, radio: int) -> tuple[int, int]:
    """Return an instant at which the first station with *radio* sends data, and its address."""
    frames, address = made.tables["frames"], RADIOS.index(radio)
    sent = frames[(frames.source == address) & frames.kind.isin(["DM5", "DATA"])].iloc[10]
    return int(sent.time_ns) + int(sent.duration_ns) // 2, address


# ---------------------------------------------------------------- what a recording tells


def test_a_scene_tells_of_stations(made: Stationed) -> None:
    assert made.scene()["stations"] == [
        {"place_m": list(place_m), "radio": radio} for place_m, radio in zip(PLACES, RADIOS[ROBOTS:], strict=True)
    ]


def test_a_recording_knows_where_stations_are_and_what_everybody_is_called(made: Stationed) -> None:
    recording = made.recording
    assert list(recording.addresses) == list(range(len(NAMES)))
    assert [recording.called(address) for address in recording.addresses] == NAMES
    assert recording.called(-1) == "jammers"
    poses = made.tables["poses"]
    now = int(poses.time_ns.iloc[-1])
    places = recording.places(now)
    assert places[:ROBOTS].tolist() == poses[poses.time_ns == now][["x_m", "y_m", "heading_rad"]].values.tolist()
    assert places[ROBOTS:].tolist() == [[*place, 0.0] for place in PLACES]


def test_links_of_stations_last_from_when_their_radios_have_them(made: Stationed) -> None:
    recording = made.recording
    found = {link[2:]: link[:2] for link in recording.links() if link[2] >= ROBOTS}
    assert found.keys() == links(made).keys() == {(2, 3), (4, 5)}
    for pair, begin in links(made).items():
        assert found[pair] == (begin, recording.end + 1)


def test_calls_are_those_of_robots(made: Stationed) -> None:
    assert set(made.tables["calls"].source) == {0, 1}
    assert not NO_ROBOT.search(nested_calls(made.simulation.trace))


def test_the_payload_of_a_station_is_no_message(made: Stationed) -> None:
    sent = made.tables["transmissions"]
    for radio in (1, 2):
        row = sent[(sent.source == RADIOS.index(radio)) & (sent.length >= 100)].iloc[0].to_dict()
        assert "station in the background" in str(frame_said(SCENARIO, bytes.fromhex(row["body"]), row))
    robots = sent[(sent.source < ROBOTS) & (sent.kind == "DATA")].iloc[0].to_dict()
    assert "station" not in str(frame_said(SCENARIO, bytes.fromhex(robots["body"]), robots))


# ---------------------------------------------------------------- files for other programs


def test_foxglove_is_told_where_stations_are_and_what_they_do(made: Stationed, tmp_path: Path) -> None:
    write_mcap(made.recording, tmp_path / "run.mcap")
    file = read_mcap(tmp_path / "run.mcap")
    [(_, scene)] = file.messages["/stations"]
    at = [each["cubes"][0]["pose"]["position"] for each in scene["entities"]]
    assert [(place["x"], place["y"]) for place in at] == PLACES
    assert [each["texts"][0]["text"] for each in scene["entities"]] == NAMES[ROBOTS:]
    frames = made.tables["frames"]
    for _, line in file.messages["/radio/frames"]:
        row = frames.iloc[line["line"]]
        assert line["name"] == NAMES[row.source].replace(" ", "_")
        receiver = "all" if row.destination < 0 else NAMES[row.destination]
        assert re.search(rf" to {receiver}\b", line["message"])
    for address, name in enumerate(NAMES):
        topic = f"/{name.replace(' ', '_')}"
        told = [message for _, message in file.messages[f"{topic}/traffic"]]
        heard = frames[(frames.destination == address) & (frames.time_ns < 3 * 10**9)]
        assert sum(each["frames_received"] for each in told) == (heard.outcome == "received").sum() > 0
        assert ("payloads_received" in told[0]) == (address < ROBOTS)
    radio = [message for _, message in file.messages["/station_0/radio"]]
    assert (radio[-1]["role"], radio[-1]["peers"]) == ("master", "station 1")
    drawn = {each["id"]: each for _, update in file.messages["/radio/links"] for each in update["entities"]}
    for one, other in links(made):
        points = drawn[f"link {one} {other}"]["lines"][0]["points"]
        assert [(point["x"], point["y"]) for point in points] == [PLACES[one - ROBOTS], PLACES[other - ROBOTS]]
    layout = layout_path(tmp_path / "run.mcap").read_text(encoding="utf-8")
    assert {"/stations", "/station_3/radio.state", "/robot_1/radio.state"} < set(re.findall(r'"(/[\w/.]+)"', layout))
    texts = json.dumps([*file.messages.values()]) + layout + json.dumps([*file.messages])
    assert not NO_ROBOT.search(texts)


def test_each_station_is_a_process_of_perfetto(made: Stationed) -> None:
    found = list(events(made.recording))
    names = {each["pid"]: each["args"]["name"] for each in found if each["name"] == "process_name"}
    assert list(names.values()) == NAMES
    slices = Counter(names[each["pid"]] for each in found if each["ph"] == "X" and each["cat"] == "transmissions")
    sent = made.tables["transmissions"].source.value_counts()
    assert {NAMES[address]: count for address, count in sent.items()} == dict(slices)
    assert not NO_ROBOT.search(json.dumps(found))


def named(interface: bytes) -> str:
    """Return the name of an interface, its first option, by the body of its block."""
    code, length = struct.unpack_from("<HH", interface, 8)
    assert code == 2
    return interface[12 : 12 + length].decode()


def test_a_capture_has_the_radios_of_stations(made: Stationed, tmp_path: Path) -> None:
    path = tmp_path / "run.pcapng"
    write_capture(path, made.simulation.channel, made.simulation.trace, "")
    interfaces = [named(body) for kind, body in blocks(path) if kind == 1]
    assert interfaces == [*(f"{name} radio {radio}" for name, radio in zip(NAMES[:4], RADIOS, strict=False)), "radio 2"]
    packets = Counter(struct.unpack_from("<I", body)[0] for kind, body in blocks(path) if kind == 6)
    sent, frames = made.tables["transmissions"], made.tables["frames"]
    heard = frames[(frames.outcome == "received") | (frames.part == "payload")]
    expected = [(sent.source == 0).sum(), (sent.source == 1).sum()]
    expected += [(heard.destination == 2).sum(), (heard.destination == 3).sum(), (sent.radio == 2).sum()]
    assert [packets[number] for number in range(5)] == expected
    assert min(expected[2:]) > 20


# ---------------------------------------------------------------- pictures


@pytest.mark.parametrize("radio", [1, 2])
def test_a_figure_draws_stations_and_names_their_lanes(made: Stationed, radio: int) -> None:
    now, address = moment(made, radio)
    figure, seen = draw_moment(made.recording, View(now, now - 10 * MS, now + 10 * MS))
    [floor] = [each for each in figure.axes if "stationed" in each.get_title(loc="left")]
    [slots] = [each for each in figure.axes if each.get_xlabel().startswith("time")]
    squares = [tuple(line.get_xydata()[0]) for line in floor.lines if line.get_marker() == "s"]
    assert squares == PLACES
    labels = {each.get_text(): each.xy for each in floor.texts if re.fullmatch(r"s\d", each.get_text())}
    assert labels == {f"s{number}": place for number, place in enumerate(PLACES)}
    arrows = [(each.xyann, each.xy) for each in floor.texts if getattr(each, "arrow_patch", None) is not None]
    assert (PLACES[address - ROBOTS], PLACES[address + 1 - ROBOTS]) in arrows
    lines = [each.get_text() for each in slots.texts if each.get_text().split(" ")[0] in ("robot", "station")]
    assert lines == [NAMES[each] for each in sorted({box.robot for box in seen})]
    assert {f"station {address - ROBOTS}", f"station {address + 1 - ROBOTS}"} < set(lines)


def test_a_film_has_stations(made: Stationed, tmp_path: Path) -> None:
    now, _ = moment(made, 1)
    assert write_film(made.recording, tmp_path / "run.gif", (now, now + 2 * MS), 0.01) == 2


def test_the_data_of_a_page_has_the_places_of_stations(made: Stationed) -> None:
    block = zlib.decompress(packed(made.recording, (0, made.recording.end + 1))[0])
    head = json.loads(block[4 : 4 + struct.unpack_from("<I", block)[0]])
    assert head["stations"] == [list(place) for place in PLACES]
    assert len(head["robots"]) == ROBOTS
    assert {tuple(link[2:]) for link in head["links"]} >= {(2, 3), (4, 5)}


def test_a_page_without_a_server_draws_stations_and_names_them(browser: Any, made: Stationed, tmp_path: Path) -> None:
    write_page(made.recording, tmp_path / "run.html", (0, made.recording.end + 1))
    now, address = moment(made, 1)
    script = """() => { window.written = []; const { fillText } = CanvasRenderingContext2D.prototype;
      CanvasRenderingContext2D.prototype.fillText = function (text, ...at) {
        window.written.push(String(text)); fillText.call(this, text, ...at); }; draw(); return window.written; }"""
    with shown(browser, tmp_path / "run.html", f"#t={now / 1e9}&span=0.02") as page:
        written = page.evaluate(script)
        assert {"s0", "s1", "s2", "s3", "robot 0.0", "station 0", "station 3"} <= set(written)
        lane = f"run.lanes.find((lane) => lane.robot === {address} && lane.what === 'sent')"
        page.evaluate(f"choose({lane}, lower({lane}.starts, {now}) - 1, true)")
        told = page.locator("#chosen").inner_text().split("\n")
        assert told[told.index("station") + 1] == "0, sent"
        assert told[told.index("to") + 1] == "station 1"
        assert "at station 1" in told
        page.locator("summary").click()
        rows = page.locator("#rows tr").all_inner_texts()
        assert {row.split("\t")[1] for row in rows} >= {"s0", "s1"}
        assert not NO_ROBOT.search(page.locator("body").inner_text() + " ".join(page.evaluate("window.written")))


def test_scenes_from_before_there_were_stations_have_none(made: Stationed) -> None:
    plain = made.scene()
    del plain["stations"]
    old = Recording({}, plain, {})
    assert list(old.addresses) == [0, 1]
    assert old.places(0).tolist() == [[0.0] * 3] * 2
