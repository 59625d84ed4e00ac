"""The lanes of a run in the trace-event format: as many slices as rows, at their nanosecond, nested in each thread."""

import gzip
import json
from collections import Counter, defaultdict
from itertools import pairwise
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.export.perfetto import events, nested, write_perfetto
from cosim.export.recording import Recording
from tests.export.recordings import BLUETOOTH, RADIOS, WALLS, called, make, sendings, silences, spans

Made = tuple[Recording, dict[str, pd.DataFrame], list[dict[str, Any]], int]


@pytest.fixture(scope="module", params=[BLUETOOTH, WALLS, RADIOS], ids=["bluetooth", "walls", "radios"])
def made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Made:
    recording, tables = make(request.param)
    path = tmp_path_factory.mktemp("perfetto") / "run.json.gz"
    count = write_perfetto(recording, path)
    with gzip.open(path, "rt", encoding="utf-8") as file:
        found = json.load(file)
    assert found["displayTimeUnit"] == "ns"
    assert found["otherData"]["digest"] == recording.metadata["digest"]
    return recording, tables, found["traceEvents"], count


def slices(made: Made) -> list[dict[str, Any]]:
    return [event for event in made[2] if event["ph"] == "X"]


def threads_of(records: list[dict[str, Any]]) -> dict[tuple[int, int], str]:
    """Return the names of threads."""
    return {(each["pid"], each["tid"]): each["args"]["name"] for each in records if each["name"] == "thread_name"}


def ns(microseconds: float) -> int:
    return round(microseconds * 1000)


@pytest.mark.slow
def test_slices_are_as_many_as_rows_and_each_is_at_its_time(made: Made) -> None:
    _, tables, _, count = made
    found = slices(made)
    rows = len(tables["frames"]) + len(sendings(tables)) + len(tables["intervals"])
    sensed = sum(map(len, silences(made[0], tables).values()))
    assert (sensed > 1000) == (tables["frames"]["kind"] == "DATA").any()
    assert len(found) == count == rows + sensed > 100
    threads = threads_of(made[2])

    def of(*whats: str) -> list[tuple[int, int, str]]:
        return sorted(
            (ns(each["ts"]), ns(each["ts"]) + ns(each["dur"]), each["name"].partition(" ")[0])
            for each in found
            if threads[each["pid"], each["tid"]].replace(",", " ").split()[0] in whats
        )

    assert of("received", "broadcasts") == spans(tables["frames"])
    assert of("sent") == spans(sendings(tables))


@pytest.mark.slow
def test_slices_of_a_thread_nest(made: Made) -> None:
    by_thread = defaultdict(list)
    for each in slices(made):
        by_thread[each["pid"], each["tid"]].append((ns(each["ts"]), -ns(each["ts"]) - ns(each["dur"])))
    assert len(by_thread) > 4
    for boxes in by_thread.values():
        open_ends: list[int] = []
        for start, end in sorted(boxes):
            while open_ends and open_ends[-1] <= start:
                open_ends.pop()
            assert not open_ends or -end <= open_ends[-1]
            open_ends.append(-end)


@pytest.mark.slow
def test_a_process_is_a_robot_and_no_thread_stands_in_two(made: Made) -> None:
    recording, tables, events, _ = made
    names = {event["pid"]: event["args"]["name"] for event in events if event["name"] == "process_name"}
    assert {f"robot {robot}" for robot in range(recording.size)} <= set(names.values())
    assert 0 not in names
    owners = defaultdict(set)
    for event in events:
        if event["ph"] in "Xi":
            owners[event["tid"]].add(event["pid"])
    assert all(len(each) == 1 for each in owners.values())
    sent = Counter(names[each["pid"]] for each in slices(made) if each["cat"] == "transmissions")
    assert sent == Counter(f"robot {robot}" for robot in tables["transmissions"]["source"])


@pytest.mark.slow
def test_an_arrow_leads_from_each_transmission_to_each_reception(made: Made) -> None:
    _, tables, events, _ = made
    begins = {event["id"]: event for event in events if event["ph"] == "s"}
    ends = {event["id"]: event for event in events if event["ph"] == "f"}
    received = tables["frames"][tables["frames"]["destination"] >= 0]
    assert len(begins) == len(ends) == sum(event["ph"] in "sf" for event in events) / 2 == len(received)
    process = {each["args"]["name"]: each["pid"] for each in events if each["name"] == "process_name"}
    expected = Counter(
        (time, process[f"robot {source}"], process[f"robot {receiver}"])
        for time, source, receiver in zip(received["time_ns"], received["source"], received["destination"], strict=True)
    )
    assert expected == Counter((ns(begins[at]["ts"]), begins[at]["pid"], ends[at]["pid"]) for at in begins)
    starts = {(each["pid"], each["tid"], ns(each["ts"])) for each in slices(made)}
    for event in (*begins.values(), *ends.values()):  # an arrow is bound to the slice that is open then
        assert (event["pid"], event["tid"], ns(event["ts"])) in starts


@pytest.mark.slow
def test_events_and_counts_are_those_of_the_tables(made: Made) -> None:
    _, tables, events, _ = made
    instants = Counter((event["cat"], ns(event["ts"]), event["name"]) for event in events if event["ph"] == "i")
    expected = Counter(
        (name, time, event)
        for name in ("events", "links")
        for time, event in zip(tables[name]["time_ns"], tables[name]["event"], strict=True)
    )
    expected.update(("wakes", time, "wake") for time in tables["wakes"]["time_ns"])
    assert any(key[0] == "wakes" for key in expected)
    assert {key: count for key, count in instants.items() if key[0] != "unsent"} == expected
    counted = Counter[str]()
    for event in events:
        if event["ph"] == "C":
            counted[event["name"]] += event["args"]["value"]
    frames = tables["frames"]
    lost = ((frames["outcome"] != "received") & (frames["destination"] >= 0)).sum()
    assert lost or "radio" in frames
    assert counted == Counter({"payloads a second": len(tables["messages"]), "frames lost a second": lost})


@pytest.fixture(scope="module")
def routed(line: tuple[Recording, dict[str, pd.DataFrame]]) -> Made:
    found = list(events(line[0]))
    return *line, found, len(found)


def test_what_is_busy_or_reserved_is_a_slice_of_its_robot_s_lane(routed: Made) -> None:
    recording, tables, records, _ = routed
    threads, processes = threads_of(records), {f"robot {robot}": robot for robot in range(recording.size)}
    names = {each["pid"]: each["args"]["name"] for each in records if each["name"] == "process_name"}
    found = defaultdict(list)
    starts = set(zip(tables["transmissions"]["time_ns"], tables["transmissions"]["source"], strict=True))
    for each in slices(routed):
        if each["cat"] in ("busy", "NAV"):
            assert each["name"] == each["cat"] == threads[each["pid"], each["tid"]]
            begin, end = ns(each["ts"]), ns(each["ts"]) + ns(each["dur"])
            found[processes[names[each["pid"]]], 0, each["name"]].append((begin, end))
            if each["name"] == "busy":  # its arguments are those of what is sent then, or arrives
                assert {(begin - delay, each["args"]["source"]) for delay in (0, 1000)} & starts
    assert found == silences(recording, tables)
    assert len(found) == 8


def test_routers_packets_have_their_names_where_they_are_sent_and_received(routed: Made) -> None:
    _, tables, records, _ = routed
    threads, names = threads_of(records), called(tables)
    frames, sent = tables["frames"], tables["transmissions"]
    expected = Counter[tuple[int, str, str]]()
    for table, what in ((sent, "sent"), (frames[frames["destination"] >= 0], "received")):
        columns = (table[name] for name in ("time_ns", "source", "kind"))
        for time, source, kind in zip(*columns, strict=True):
            expected[time, what, names.get((time, source), kind)] += 1
    found = Counter(
        (ns(each["ts"]), threads[each["pid"], each["tid"]].split()[0], each["name"].split()[0])
        for each in slices(routed)
        if each["cat"] in ("frames", "transmissions") and not threads[each["pid"], each["tid"]].startswith("broadcasts")
    )
    assert found == expected
    kinds = {each["name"].split()[0]: each["args"]["kind"] for each in slices(routed) if "kind" in each["args"]}
    assert kinds["RREQ"] == kinds["RREP"] == "DATA"


def test_a_plain_file_is_the_same_as_a_compressed_one_and_as_the_next(tmp_path: Path, short: Recording) -> None:
    names = ("one.json", "one.json.gz", "two.json.gz")
    assert len({write_perfetto(short, tmp_path / name) for name in names}) == 1
    one, two, three = ((tmp_path / name).read_bytes() for name in names)
    assert two == three
    assert gzip.decompress(two) == one
    assert one.startswith(b"{")


SPANS = st.lists(st.tuples(st.integers(0, 30), st.integers(1, 12)), max_size=25)


@given(SPANS)
def test_spans_that_overlap_without_nesting_never_share_a_track(lengths: list[tuple[int, int]]) -> None:
    boxes = [(start, start + length) for start, length in sorted(lengths)]
    tracks = nested([start for start, _ in boxes], [end for _, end in boxes])
    assert len(tracks) == len(boxes)
    for at, (a, b) in enumerate(boxes):
        for other, (c, d) in enumerate(boxes[:at]):
            if tracks[at] == tracks[other]:
                apart, within = b <= c or d <= a, (a <= c and d <= b) or (c <= a and b <= d)
                assert apart or within
    if all(one[1] <= two[0] for one, two in pairwise(boxes)):
        assert set(tracks) <= {0}
