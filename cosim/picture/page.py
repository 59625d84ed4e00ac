"""One HTML file that shows a run and needs neither a server nor a network: scripts, styles and data are in it.

The data is one deflated block in base64: the length of a JSON text (u32, little-endian), the text, then columns of
whole numbers. The text lists the columns: how many numbers, what was taken from each, how many bytes each takes, and
whether it is the difference to the one before. The bytes of a column stand by their rank, all lowest ones first, which
deflates best. Times are nanoseconds, to the last one.
"""

import base64
import json
import struct
import zlib
from collections.abc import Iterable
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import numpy as np

from cosim.arrays import Int64s
from cosim.export.lanes import STATE, STATES, Lane, lanes, packet_names, with_names
from cosim.export.recording import ROBOTS, Recording
from cosim.picture.colours import is_lost, look, state_fill
from cosim.trace import drafted
from cosim.units import Time

STEP_M: Final = 0.01
"""How exactly places are kept."""
_STEP_RAD: Final = 0.01
_MARKS: Final = {"style": "page.css", "script": "page.js"}


class Columns:
    """Columns of whole numbers, packed one after the other."""

    def __init__(self) -> None:
        self.listed: list[list[int]] = []
        self.parts: list[bytes] = []

    def add(self, values: Any, differences: bool = False) -> int:
        """Pack *values*, or their *differences*, and return the number of their column."""
        whole: Int64s = np.asarray(values, dtype=np.int64)
        if differences and len(whole):
            whole = np.diff(whole, prepend=0)
        least = int(whole.min()) if len(whole) else 0
        whole = whole - least
        width = max(1, (int(whole.max()).bit_length() + 7) // 8) if len(whole) else 1
        self.listed.append([len(whole), least, width, int(differences)])
        self.parts.append(whole.astype("<u8").view(np.uint8).reshape(-1, 8)[:, :width].T.tobytes())
        return len(self.listed) - 1


class Words:
    """Texts that are known by their numbers."""

    def __init__(self) -> None:
        self.numbers: dict[str, int] = {}

    def codes(self, texts: Iterable[str]) -> list[int]:
        """Return the numbers of *texts*."""
        numbers = self.numbers
        return [numbers.setdefault(text, len(numbers)) for text in texts]


def write_page(recording: Recording, path: Path, span: tuple[Time, Time]) -> int:
    """Write the page of *recording* in the *span* of time to *path*, and return the number of boxes in it."""
    block, count = packed(recording, span)
    static = files("cosim.picture") / "static"
    html = (static / "page.html").read_text(encoding="utf-8")
    texts = {name: (static / file).read_text(encoding="utf-8") for name, file in _MARKS.items()}
    title = recording.title.replace("&", "&amp;").replace("<", "&lt;")
    texts |= {"title": title, "data": base64.b64encode(block).decode()}
    for name, text in texts.items():
        html = html.replace(f"<!--{name}-->", text) if name in ("title", "data") else html.replace(f"/*{name}*/", text)
    path.parent.mkdir(parents=True, exist_ok=True)
    with drafted(path) as draft:
        draft.write_text(html, encoding="utf-8")
    return count


def packed(recording: Recording, span: tuple[Time, Time]) -> tuple[bytes, int]:
    """Return the data of the page, and the number of boxes in it."""
    columns, words = Columns(), Words()
    found = [_within(lane, span) for lane in _lanes(recording, span)]
    rows = [_lane(recording, lane, columns, words) for lane in found if len(lane.rows) for lane in _apart(lane)]
    kinds = {kind for lane in found if lane.what != STATE for kind in lane.kinds}
    states = {kind for lane in found if lane.what == STATE for kind in lane.kinds}
    lost = {each for lane in found if lane.what != STATE for each in lane.outcomes if is_lost(lane.what, each)}
    times, poses = recording.poses()
    text: dict[str, Any] = {
        "title": recording.title,
        "digest": recording.metadata.get("digest", ""),
        "span": [str(time) for time in span],
        "scene": {name: recording.scene[name] for name in ("bounds_m", "walls_m", "polygons_m", "radii_m")},
        "robots": [ROBOTS[robot % len(ROBOTS)] for robot in range(recording.size)],
        "links": [[begin, end, master, slave] for begin, end, master, slave in recording.links()],
        "jammers": [[each.x_m, each.y_m, each.begin, each.end] for each in recording.jammers()],
        "ticks": columns.add(times, differences=True),
        "poses": [
            [columns.add(np.round(poses[:, robot, axis] / step), differences=True) for axis, step in enumerate(_STEPS)]
            for robot in range(recording.size)
        ],
        "steps": _STEPS,
        "events": _events(recording, columns, words, span),
        "lanes": rows,
        "looks": {
            **{kind: list(look(kind)) for kind in kinds},
            **{each: [state_fill(each), "#333333"] for each in states},
        },
        "lost": sorted(lost),
    }
    text |= {"words": list(words.numbers), "columns": columns.listed}
    head = json.dumps(text, separators=(",", ":")).encode()
    block = struct.pack("<I", len(head)) + head + b"".join(columns.parts)
    return zlib.compress(block, 9), sum(len(lane.rows) for lane in found)


_STEPS: Final = (STEP_M, STEP_M, _STEP_RAD)


def _lanes(recording: Recording, span: tuple[Time, Time]) -> list[Lane]:
    """Return the lanes as the page has them: what 802.11 senses are states, and routers' packets have their names."""
    names = packet_names(recording, *span)
    found = [with_names(recording, lane, names) for lane in lanes(recording)]
    return [lane._replace(what=STATE) if lane.what in STATES else lane for lane in found]


def _within(lane: Lane, span: tuple[Time, Time]) -> Lane:
    return _chosen(lane, np.flatnonzero((lane.starts < span[1]) & (lane.ends > span[0])))


def _apart(lane: Lane) -> list[Lane]:
    """Return *lane*, or for states as many as there must be for none of their boxes to overlap."""
    if lane.what != STATE:
        return [lane]
    ends: list[Time] = []
    places = []
    for start, end in zip(lane.starts.tolist(), lane.ends.tolist(), strict=True):
        place = next((number for number, before in enumerate(ends) if before <= start), len(ends))
        ends[place : place + 1] = [end]
        places.append(place)
    return [_chosen(lane, np.flatnonzero(np.array(places) == place)) for place in range(len(ends))]


def _chosen(lane: Lane, at: Int64s) -> Lane:
    kinds, outcomes = ([texts[each] for each in at] for texts in (lane.kinds, lane.outcomes))
    return lane._replace(rows=lane.rows[at], starts=lane.starts[at], ends=lane.ends[at], kinds=kinds, outcomes=outcomes)


def _lane(recording: Recording, lane: Lane, columns: Columns, words: Words) -> dict[str, Any]:
    def column(name: str) -> Any:
        return recording.column(lane.table, name)[lane.rows] if recording.has(lane.table, name) else None

    row: dict[str, Any] = {
        "robot": lane.robot,
        "radio": lane.radio,
        "what": lane.what,
        "starts": columns.add(lane.starts, differences=True),
        "lengths": columns.add(lane.ends - lane.starts),
        "kinds": columns.add(words.codes(lane.kinds)),
        "outcomes": columns.add(words.codes(lane.outcomes)),
    }
    for name, other in (("channel", "channels"), ("length", "sizes"), ("source", "sources"), ("destination", "peers")):
        values = column(name)
        if values is not None:
            row[other] = columns.add(values)
    for name in ("part", "detail"):
        texts = column(name)
        if texts is not None:
            row[name] = columns.add(words.codes(texts))
    return row


def _events(recording: Recording, columns: Columns, words: Words, span: tuple[Time, Time]) -> list[int]:
    """Pack the protocol's events: times, robots, names, and their fields as text; return the numbers of the columns."""
    fixed = ("time_ns", "source", "event")
    rows = [row for row in recording.rows("events") if span[0] <= row["time_ns"] < span[1]]
    told = (
        ", ".join(f"{name} {value}" for name, value in row.items() if value is not None and name not in fixed)
        for row in rows
    )
    names = words.codes(row["event"] for row in rows)
    return [
        columns.add([row["time_ns"] for row in rows], differences=True),
        columns.add([row["source"] for row in rows]),
        columns.add(names),
        columns.add(words.codes(told)),
    ]
