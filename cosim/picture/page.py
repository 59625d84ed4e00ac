"""One HTML file that shows a run and needs neither a server nor a network: scripts, styles and data are in it.

The data is one deflated block in base64: the length of a JSON text (u32, little-endian), the text, then columns of
whole numbers. The text lists the columns: how many numbers, how many bytes each takes, whether it is the difference to
the one before, and a list. If that has several numbers, the column's are numbers of places in it; if it has one, this
was taken from each. The bytes of a column stand by their rank, all lowest ones first, which deflates best. Times are
nanoseconds, to the last one.

Boxes stand in two tables, states and frames, each in one order of time over all lanes: radios in reach of each other do
much at the same instants, and for equally long, so that a box mostly differs little from the one before. Texts (what
part was lost, the details of a state) are kept word by word, as most differ in a number only. How many words each has
stands in the order of time; then come all first words, all second ones and so on, lane by lane.
"""

import base64
import json
import struct
import zlib
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from itertools import chain
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


_FEW: Final = 16
"""Different numbers are listed if there are so many times as many numbers in all."""


class Columns:
    """Columns of whole numbers, packed one after the other."""

    def __init__(self) -> None:
        self.listed: list[tuple[int, int, int, list[int]]] = []
        self.parts: list[bytes] = []

    def add(self, values: Any, differences: bool = False) -> int:
        """Pack *values*, or their *differences*, and return the number of their column."""
        whole: Int64s = np.asarray(values, dtype=np.int64)
        if differences and len(whole):
            whole = np.diff(whole, prepend=0)
        few = _few(whole)
        whole = np.searchsorted(few, whole) if len(few) > 1 else whole - few
        width = max(1, (int(whole.max(initial=0)).bit_length() + 7) // 8)
        self.listed.append((len(whole), width, int(differences), few.tolist()))
        self.parts.append(whole.astype("<u8").view(np.uint8).reshape(-1, 8)[:, :width].T.tobytes())
        return len(self.listed) - 1


def _few(whole: Int64s) -> Int64s:
    """Return the different numbers in *whole*, ascending, if a list of them pays; else the least one, if any."""
    if len(whole) and np.ptp(whole) >> 8:  # what fits a byte as it is needs no list
        distinct: Int64s = np.unique(whole)
        return distinct if len(distinct) * _FEW < len(whole) else distinct[:1]
    return whole.min(keepdims=True) if len(whole) else whole


class Words:
    """Texts that are known by their numbers."""

    def __init__(self) -> None:
        self.numbers: dict[str, int] = {}

    def codes(self, texts: Iterable[str]) -> Int64s:
        """Return the numbers of *texts*."""
        every = list(texts)
        for text in dict.fromkeys(every):
            self.numbers.setdefault(text, len(self.numbers))
        return np.fromiter(map(self.numbers.__getitem__, every), np.int64, len(every))


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
    shown = [part for lane in found if len(lane.rows) for part in _apart(lane)]
    states, frames = (
        {number: lane for number, lane in enumerate(shown) if (lane.what == STATE) is state} for state in (True, False)
    )
    kinds = {kind for lane in found if lane.what != STATE for kind in lane.kinds}
    named = {kind for lane in found if lane.what == STATE for kind in lane.kinds}
    lost = {each for lane in found if lane.what != STATE for each in lane.outcomes if is_lost(lane.what, each)}
    times, poses = recording.poses()
    text: dict[str, Any] = {
        "title": recording.title,
        "digest": recording.metadata.get("digest", ""),
        "span": [str(time) for time in span],
        "scene": {name: recording.scene[name] for name in ("bounds_m", "walls_m", "polygons_m", "radii_m")},
        "stations": recording.stations.tolist(),
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
        "lanes": [[lane.robot, lane.radio, lane.what] for lane in shown],
        "tables": [_table(recording, lanes, columns, words) for lanes in (states, frames) if lanes],
        "looks": {
            **{kind: list(look(kind)) for kind in sorted(kinds)},
            **{each: [state_fill(each), "#333333"] for each in sorted(named)},
        },
        "lost": sorted(lost),
    }
    text |= {"words": list(words.numbers), "columns": columns.listed}
    head = json.dumps(text, separators=(",", ":")).encode()
    block = struct.pack("<I", len(head)) + head + b"".join(columns.parts)
    return zlib.compress(block), sum(len(lane.rows) for lane in found)


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
    if lane.what != STATE or (lane.starts[1:] >= lane.ends[:-1]).all():
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


def _table(recording: Recording, lanes: Mapping[int, Lane], columns: Columns, words: Words) -> dict[str, Any]:
    """Pack the boxes of *lanes*, which are known by their numbers, in one order of time; return where what stands."""
    boxes = list(lanes.values())
    numbers = np.repeat(list(lanes), [len(lane.rows) for lane in boxes])
    starts = np.concatenate([lane.starts for lane in boxes])
    order = np.lexsort((numbers, starts))
    table: dict[str, Any] = {
        "lane": columns.add(numbers[order]),
        "starts": columns.add(starts[order], differences=True),
        "lengths": columns.add(np.concatenate([lane.ends - lane.starts for lane in boxes])[order]),
        "kinds": columns.add(words.codes(chain.from_iterable(lane.kinds for lane in boxes))[order]),
        "outcomes": columns.add(words.codes(chain.from_iterable(lane.outcomes for lane in boxes))[order]),
    }
    having = [set(recording.names(lane.table)) for lane in boxes]
    for name, other in _NUMBERS.items():
        if name in set.intersection(*having):
            table[other] = columns.add(_values(recording, boxes, name)[order])
    for name in _TEXTS:
        if name in set.union(*having):
            table[name] = _texts(_values(recording, boxes, name), order, columns, words)
    return table


_NUMBERS: Final = {"channel": "channels", "length": "sizes", "source": "sources", "destination": "peers"}
_TEXTS: Final = ("part", "detail")


def _values(recording: Recording, boxes: Sequence[Lane], name: str) -> Any:
    """Return what stands in the column *name* for all *boxes*; no text where a table has no such column."""
    values = {
        table: recording.column(table, name)
        if recording.has(table, name)
        else np.full(recording.count(table), "", dtype=object)
        for table in {lane.table for lane in boxes}
    }
    return np.concatenate([values[lane.table][lane.rows] for lane in boxes])


def _texts(texts: Any, order: Int64s, columns: Columns, words: Words) -> list[int]:
    """Pack *texts* word by word, and return the columns: how many words each has, in *order*; the first words; ..."""
    known = Words()
    codes = known.codes(texts)
    split = [text.split(" ") if text else [] for text in known.numbers]
    counts = np.array([len(each) for each in split])
    packed = [columns.add(counts[codes][order])]
    for place in range(counts.max()):
        word = words.codes(each[place] if place < len(each) else "" for each in split)
        packed.append(columns.add(word[codes[counts[codes] > place]]))
    return packed


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
