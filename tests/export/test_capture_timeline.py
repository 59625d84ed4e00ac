"""One run, captured and drawn: the frames that tshark finds are boxes of the timeline, in number and in time."""

import shutil
import sys
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import yaml

from cosim.cli import main
from cosim.machine import BROADCAST, Address
from cosim.timeline.index import Index, made
from cosim.units import Time
from tests.checkout import DATA
from tests.export.capture_reading import SUBTYPES, TYPES, find_tshark, read_fields

TEAM = {"size": 3, "starts": [[1, 1], [3, 1], [1, 6]]}
# so deaf that payloads and headers are lost on the longer link
BLUETOOTH = {
    "kind": "bluetooth",
    "idle_frames": True,
    "propagation": {},
    "power_class": 3,
    "sensitivity_dbm": -52.5,
}
ADHOC = {"kind": "adhoc", "range_m": 6.0, "rts_threshold": 30}
TO_ALL = "ff:ff:ff:ff:ff:ff"


class Box(NamedTuple):
    """A frame in a lane of its sender."""

    time: Time
    source: Address
    kind: str
    peer: Address
    lost: str
    """The part of it that a receiver has lost first; "whole" if it did not even look for it."""


def boxes(index: Index) -> list[Box]:
    """Return what the lanes of senders hold."""
    found = []
    for lane in index.lanes:
        if lane.named.what == "sent":
            for start, _, kind, outcome, _, peer in zip(*(column.tolist() for column in lane.boxes), strict=True):
                name, part, *_ = index.codes.outcomes[outcome]
                lost = "" if name in ("", "received") else part or "whole"
                found.append(Box(start, lane.named.robot, index.codes.kinds[kind][1], peer, lost))
    return found


def run(channel: dict[str, Any], duration_s: float) -> Index:
    """Make a run with a capture and tables, and return the lanes of these."""
    protocol = {"use": "chatter:SPEC"}
    scenario = {"name": "three", "seed": 2, "duration_s": duration_s, "team": TEAM}
    Path("run.yaml").write_text(yaml.safe_dump(scenario | {"channel": channel, "protocol": protocol}))
    with pytest.raises(SystemExit) as ended:
        main(["run", "run.yaml", "--pcapng", "run.pcapng", "--trace", "tables"])
    assert ended.value.code == 0
    return made(Path("tables"))


def read(*names: str) -> list[tuple[Time, Address, list[str]]]:
    """Return time, robot of the interface, and the fields *names* of each packet that tshark finds."""
    fields = read_fields(find_tshark(), Path("run.pcapng"), ("frame.time_epoch", "frame.interface_name", *names))
    return [(int(time.replace(".", "")), int(name.removeprefix("robot ")), rest) for time, name, *rest in fields]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    find_tshark()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    for name in ("beacon", "chatter"):
        shutil.copy(DATA / f"{name}.py", tmp_path)
        monkeypatch.delitem(sys.modules, name, raising=False)


@pytest.mark.slow
def test_packets_of_bluetooth_are_the_boxes_whose_headers_were_heard() -> None:
    """A capture has what receivers hear: frames of which nothing, or no header, came are in none."""
    index = run(BLUETOOTH, 20)
    names = {number: name for name, number in TYPES.items()}
    found = read("btbredr_rf.packet_header.type", "frame.packet_flags_crc_error", "btbredr_rf.rf_channel")
    sent = boxes(index)
    for_all = {box.time for box in sent if box.peer == BROADCAST}  # IDs of inquiries
    packets = Counter(
        (time, BROADCAST if time in for_all else to, names[int(kind, 0)] if kind else "ID", spoilt in ("1", "True"))
        for time, to, (kind, spoilt, _) in found
    )
    heard = Counter(
        (box.time, box.peer, box.kind, box.lost == "payload") for box in sent if box.lost in ("", "payload")
    )
    assert packets == heard
    assert len(for_all) < len(found) / 100
    assert {kind for _, _, kind, _ in heard} == {"ID", *TYPES}
    assert {box.lost for box in sent} >= {"", "payload", "header"}
    places = {(box.time, box.source) for box in sent if box.lost in ("", "payload")}
    on_channels = Counter(
        (start, lane.named.channel)
        for lane in index.lanes
        if lane.named.what == "channel"
        for start, source in zip(lane.boxes.starts.tolist(), lane.boxes.peers.tolist(), strict=True)
        if (start, source) in places
    )
    assert Counter((time, int(channel)) for time, _, (_, _, channel) in found) == on_channels


@pytest.mark.slow
def test_packets_of_80211_are_all_boxes_of_senders() -> None:
    """A capture has what senders send, whether or not anybody hears it."""
    index = run(ADHOC, 20)
    packets = Counter(
        (time, source, SUBTYPES[kind], BROADCAST if to == TO_ALL else int(to[12:].replace(":", ""), 16))
        for time, source, (kind, to) in read("wlan.fc.type_subtype", "wlan.ra")
    )
    sent = boxes(index)
    assert packets == Counter(box[:4] for box in sent)
    assert {box.kind for box in sent} == set(SUBTYPES.values())
    assert BROADCAST in {box.peer for box in sent}
