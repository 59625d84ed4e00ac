"""MCAP files, as the package mcap reads them: topics and schemas as documented, contents those of the tables."""

import json
import re
from base64 import b64decode
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from itertools import pairwise
from math import atan2
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pytest
import yaml

from cosim.export.foxglove import SCHEMAS
from cosim.export.mcap import EPOCH, TOPICS, layout_path, messages, write_mcap
from cosim.export.recording import Recording
from tests.checkout import ROOT
from tests.export.recordings import called, silences

reader = pytest.importorskip("mcap.reader")
Whole = tuple[Recording, dict[str, pd.DataFrame], Path]


class File(NamedTuple):
    """What stands in a file."""

    messages: dict[str, list[tuple[int, dict[str, Any]]]]
    schemas: dict[str, tuple[str, dict[str, Any]]]
    metadata: dict[str, str]
    attachments: dict[str, bytes]
    order: list[int]


def read(path: Path) -> File:
    messages = defaultdict(list)
    schemas, order = {}, []
    with path.open("rb") as stream:
        made = reader.make_reader(stream)
        for schema, channel, message in made.iter_messages(log_time_order=False):
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            schemas[channel.topic] = schema.name, json.loads(schema.data)
            messages[channel.topic].append((message.log_time, json.loads(message.data)))
            order.append(message.log_time)
            assert message.publish_time == message.log_time
        metadata = {each.name: each.metadata for each in made.iter_metadata()}
        attachments = {each.name: each.data for each in made.iter_attachments()}
    assert list(metadata) == ["cosim"]
    return File(messages, schemas, metadata["cosim"], attachments, order)


@pytest.fixture(scope="module")
def radio(piconet: Whole, tmp_path_factory: pytest.TempPathFactory) -> File:
    path = tmp_path_factory.mktemp("mcap") / "run.mcap"
    count = write_mcap(piconet[0], path)
    found = read(path)
    assert count == len(found.order)
    return found


@pytest.fixture(scope="module")
def faulty(walls: Whole, tmp_path_factory: pytest.TempPathFactory) -> File:
    path = tmp_path_factory.mktemp("mcap") / "run.mcap"
    write_mcap(walls[0], path)
    return read(path)


def ns(stamp: dict[str, int]) -> int:
    return stamp["sec"] * 10**9 + stamp["nsec"]


def misfits(value: Any, schema: dict[str, Any], at: str = "") -> list[str]:
    """Return where *value* does not fit *schema*: types, and fields that it does not name or that are missing."""
    kinds = {"object": dict, "array": list, "string": str, "number": (int, float), "integer": int, "boolean": bool}
    if not isinstance(value, kinds[schema["type"]]) or (isinstance(value, bool) and schema["type"] != "boolean"):
        return [f"{at}: {value!r} is no {schema['type']}"]
    if schema["type"] == "array":
        return [each for n, item in enumerate(value) for each in misfits(item, schema["items"], f"{at}[{n}]")]
    if schema["type"] != "object" or "properties" not in schema:
        return []
    fields = schema["properties"]
    found = [f"{at}.{name} is not in the schema" for name in value if name not in fields]
    return found + [
        each for name in value if name in fields for each in misfits(value[name], fields[name], f"{at}.{name}")
    ]


@pytest.mark.slow
def test_messages_fit_their_schemas_and_are_in_the_order_of_time(radio: File, faulty: File) -> None:
    for file in (radio, faulty):
        assert file.order == sorted(file.order)
        for topic, found in file.messages.items():
            name, schema = file.schemas[topic]
            assert schema["title"] == name
            for _, message in found[:200]:
                assert not misfits(message, schema, topic)
                assert {"foxglove.SceneUpdate", "cosim.Metrics"} & {name} or schema[
                    "properties"
                ].keys() == message.keys()


@pytest.mark.slow
def test_topics_are_those_of_the_guide(radio: File, faulty: File) -> None:
    guide = (ROOT / "docs/guides/pictures.md").read_text(encoding="utf-8")
    table = dict(re.findall(r"^\| `(/[\w/]+)` \| `([\w.]+)` \|", guide, re.MULTILINE))
    assert table == {topic: schema for topic, (schema, _) in TOPICS.items()}
    used = {
        re.sub(r"robot_\d+", "robot_N", topic): name
        for file in (radio, faulty)
        for topic, (name, _) in file.schemas.items()
    }
    assert used.items() <= table.items()
    assert set(table) - set(used) <= {"/radio/ranges", "/stations"}


@pytest.mark.slow
def test_poses_are_those_of_the_table(radio: File, piconet: Whole) -> None:
    poses = piconet[1]["poses"].set_index(["time_ns", "source"])
    assert len(radio.messages["/tf"]) == len(poses) / 4
    seen = 0
    for time, message in radio.messages["/tf"]:
        for each in message["transforms"]:
            row = poses.loc[time - EPOCH, int(each["child_frame_id"].removeprefix("robot_"))]
            assert (each["translation"]["x"], each["translation"]["y"]) == (row["x_m"], row["y_m"])
            turned = 2 * atan2(each["rotation"]["z"], each["rotation"]["w"])
            assert np.cos(turned - row["heading_rad"]) == pytest.approx(1)
            assert ns(each["timestamp"]) == time
            seen += 1
    assert seen == len(poses)


@pytest.mark.slow
def test_each_frame_has_a_line_and_lost_ones_are_warnings(radio: File, piconet: Whole) -> None:
    frames = piconet[1]["frames"]
    lines = [message for _, message in radio.messages["/radio/frames"]]
    assert len(lines) == len(frames)
    for line in lines:
        row = frames.iloc[line["line"]]
        assert ns(line["timestamp"]) == row["time_ns"] + EPOCH
        assert line["name"] == f"robot_{row['source']}"
        assert line["message"].startswith(f"{row['kind']} to robot {row['destination']}, channel {row['channel']}, ")
        assert line["level"] == (2 if row["outcome"] == "received" else 3)
    assert Counter(line["level"] for line in lines)[3] > 5


@pytest.mark.slow
def test_events_and_metrics_are_those_of_the_run(faulty: File, walls: Whole) -> None:
    told = Counter(
        (time - EPOCH, message["file"], message["message"].split()[0]) for time, message in faulty.messages["/events"]
    )
    expected = Counter[tuple[int, str, str]]()
    for name in ("events", "links"):
        expected.update(
            (time, name, event) for time, event in walls[1][name][["time_ns", "event"]].itertuples(index=False)
        )
    assert told == expected
    [(_, metrics)] = faulty.messages["/metrics"]
    known = json.loads(walls[0].metadata["metrics"])
    assert metrics == {name: value for name, value in known.items() if value == value}
    assert metrics["robots_killed"] == 1


@pytest.mark.slow
def test_what_is_down_and_what_jams_is_shown_as_long_as_it_is(faulty: File) -> None:
    changes = [(time - EPOCH, message["entities"]) for time, message in faulty.messages["/robots"][1:]]
    told = [(time, {each["key"]: each["value"] for each in robots[0]["metadata"]}) for time, robots in changes]
    assert [(time / 1e9, each["robot"], each["down"]) for time, each in told] == [
        (20.0, "3", "True"), (30.0, "1", "True"), (35.0, "1", "False")
    ]  # fmt: skip
    (begin, on), (end, off) = faulty.messages["/radio/jammers"]
    assert ((begin - EPOCH) / 1e9, (end - EPOCH) / 1e9) == (40.0, 45.0)
    place = on["entities"][0]["cylinders"][0]["pose"]["position"]
    assert (place["x"], place["y"]) == (20, 6)
    assert off["deletions"][0]["id"] == on["entities"][0]["id"]
    down = [(time - EPOCH, message["down"]) for time, message in faulty.messages["/robot_3/radio"]]
    changed = [two for one, two in pairwise(down) if one[1] != two[1]]
    assert changed == [(20 * 10**9, True)]


@pytest.mark.slow
def test_links_last_as_long_as_the_piconet_does(radio: File, piconet: Whole) -> None:
    links = piconet[1]["links"]
    connected = links[(links["event"] == "Connected") & (links["detail"] == "master")]
    ends = {(row.source, row.peer): row.time_ns for row in connected.itertuples()}
    assert len(ends) == 3
    for time, message in radio.messages["/radio/links"]:
        drawn = {tuple(int(each["value"]) for each in entity["metadata"]) for entity in message["entities"]}
        assert drawn == {pair for pair, since in ends.items() if since <= time - EPOCH or any(
            other <= time - EPOCH and {*pair} == {*other_pair} for other_pair, other in ends.items())}  # fmt: skip
    roles = {robot: radio.messages[f"/robot_{robot}/radio"][-1][1]["role"] for robot in range(4)}
    assert sorted(roles.values()) == ["master", "slave", "slave", "slave"]


@pytest.mark.slow
def test_traffic_counts_what_the_tables_hold(faulty: File, walls: Whole) -> None:
    frames, sent, messages = (walls[1][name] for name in ("frames", "transmissions", "messages"))
    last = (walls[0].end // 10**9) * 10**9
    for robot in range(6):
        found = [message for _, message in faulty.messages[f"/robot_{robot}/traffic"]]
        mine = frames[(frames["destination"] == robot) & (frames["time_ns"] < last)]
        counts = {
            "frames_sent": ((sent["source"] == robot) & (sent["time_ns"] < last)).sum(),
            "frames_received": (mine["outcome"] == "received").sum(),
            "frames_lost": (mine["outcome"] != "received").sum(),
            "payloads_received": ((messages["source"] == robot) & (messages["time_ns"] < last)).sum(),
        }
        assert counts["frames_sent"]
        assert {name: sum(each[name] for each in found) for name in counts} == counts


def media(found: Iterable[tuple[int, dict[str, Any]]], what: str) -> list[tuple[int, int | None]]:
    """Return from when to when the messages *found*, by time, tell of *what*."""
    spans, since = [], None
    for time, message in found:
        there = what in message["state"].split(" + ")
        if there and since is None:
            since = time
        elif not there and since is not None:
            spans.append((since, time))
            since = None
    return [*spans, *([(since, None)] if since is not None else [])]


@pytest.mark.slow
def test_the_medium_is_busy_or_reserved_as_long_as_it_is(faulty: File, radio: File, walls: Whole) -> None:
    check_media(
        {topic: [(time - EPOCH, told) for time, told in each] for topic, each in faulty.messages.items()}, *walls[:2]
    )
    assert not [topic for topic in radio.messages if topic.endswith("/medium")]


def test_messages_of_the_medium_and_of_routers_packets(line: tuple[Recording, dict[str, pd.DataFrame]]) -> None:
    recording, tables = line
    found = defaultdict(list)
    for time, topic, message in messages(recording):
        found[topic].append((time, message))
    check_media(found, recording, tables)
    assert {message["state"] for _, message in found["/robot_1/medium"]} == {"idle", "busy", "NAV", "NAV + busy"}
    assert all(not misfits(message, SCHEMAS["cosim.Medium"]) for _, message in found["/robot_1/medium"])
    names = called(tables)
    columns = (tables["frames"][name] for name in ("time_ns", "source", "kind"))
    expected = [names.get((time, source), kind) for time, source, kind in zip(*columns, strict=True)]
    assert [message["message"].split()[0] for _, message in found["/radio/frames"]] == expected
    assert {"RREQ", "RREP"} < set(expected)


def check_media(found: Mapping[str, Any], recording: Recording, tables: dict[str, pd.DataFrame]) -> None:
    """Check what is told of the medium in *found*, times and messages by topic."""
    expected = silences(recording, tables)
    assert len(expected) >= recording.size
    for robot in range(recording.size):
        told = found[f"/robot_{robot}/medium"]
        assert told[0][0] == 0
        assert all(one[1]["state"] != two[1]["state"] or one[0] == 0 for one, two in pairwise(told))
        for what in ("busy", "NAV"):
            inside = [
                (begin, end if end <= recording.end else None) for begin, end in expected.get((robot, 0, what), [])
            ]
            assert media(told, what) == inside


@pytest.mark.slow
def test_the_map_is_dark_where_walls_are_and_begins_at_the_bottom(faulty: File, walls: Whole) -> None:
    [(time, grid)] = faulty.messages["/map"]
    assert time == EPOCH
    cells = np.frombuffer(b64decode(grid["data"]), np.uint8).reshape(-1, grid["column_count"], 4)
    assert grid["row_stride"] == 4 * grid["column_count"]
    x0, y0, _, y1 = walls[0].scene["bounds_m"]
    size = grid["cell_size"]["x"]
    assert cells.shape[0] * size == pytest.approx(y1 - y0, abs=size)
    for a, b, c, d in walls[0].scene["walls_m"]:
        x, y = (0.3 * a + 0.7 * c - x0) / size, (0.3 * b + 0.7 * d - y0) / size
        near = cells[max(0, int(y) - 1) : int(y) + 2, max(0, int(x) - 1) : int(x) + 2, 0]
        assert near.min() < 100
    assert (cells[..., 0] > 200).mean() > 0.9
    lower, upper = cells[: len(cells) // 3, 400], cells[-len(cells) // 3 :, 400]  # the wall at x = 20 is below y = 6
    assert lower[..., 0].max() < 100 < upper[:-5, 0].min()


@pytest.mark.slow
def test_the_file_tells_scenario_digest_and_where_its_time_begins(radio: File, piconet: Whole, tmp_path: Path) -> None:
    recording = piconet[0]
    assert radio.metadata["digest"] == recording.metadata["digest"]
    assert int(radio.metadata["time_offset_ns"]) == EPOCH
    assert pd.Timestamp(EPOCH).isoformat() == "2000-01-01T00:00:00"
    assert yaml.safe_load(radio.attachments["scenario.yaml"]) == json.loads(radio.metadata["scenario"])
    write_mcap(recording, tmp_path / "run.mcap")
    layout = json.loads(layout_path(tmp_path / "run.mcap").read_text())

    def panels(part: Any) -> set[str]:
        return {part} if isinstance(part, str) else panels(part["first"]) | panels(part["second"])

    assert panels(layout["layout"]) == set(layout["configById"])
    named = re.findall(r'"(/[\w/]+)', json.dumps(layout))
    assert {re.sub(r"robot_\d+", "robot_N", name) for name in named} <= set(TOPICS)
    assert not [name for name in named if name.endswith("/medium")]


def test_panels_show_the_medium_of_robots_with_802_11(line: tuple[Recording, Any], tmp_path: Path) -> None:
    write_mcap(line[0], tmp_path / "run.mcap")
    panels = json.loads(layout_path(tmp_path / "run.mcap").read_text())["configById"]
    paths = [each["value"] for each in panels["StateTransitions!radio"]["paths"]]
    assert paths == [f"/robot_{robot}/{topic}.state" for robot in range(4) for topic in ("radio", "medium")]
