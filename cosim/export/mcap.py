"""A run as an MCAP file with Foxglove's schemas, in JSON: where robots are, what they and their radios do.

Foxglove takes times as Unix time, in which some tools hold 0 for none: simulated time is kept from EPOCH on, and the
file's metadata says so.
"""

import json
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from heapq import merge
from operator import itemgetter
from pathlib import Path
from typing import Any, Final

import numpy as np
from PIL import Image, ImageDraw

from cosim import __version__
from cosim.channels.background import called
from cosim.export import foxglove
from cosim.export.foxglove import colour
from cosim.export.lanes import WHOLE, packet_names, sendings, sensed_lanes
from cosim.export.recording import DOWN, ROBOTS, STATION, UP, Recording
from cosim.machine import Address
from cosim.trace import drafted
from cosim.units import S, Time, to_seconds

EPOCH: Final[Time] = 946_684_800 * S
"""What is added to simulated time, ns: the year 2000 begins then."""
TOPICS: Final[dict[str, tuple[str, str]]] = {
    "/tf": ("foxglove.FrameTransforms", "where each robot is, at each tick of the world"),
    "/map": ("foxglove.Grid", "the floor as cells: walls dark; once"),
    "/walls": ("foxglove.SceneUpdate", "walls as lines; once"),
    "/robots": ("foxglove.SceneUpdate", "bodies and names; again when one goes down or up"),
    "/stations": ("foxglove.SceneUpdate", "stations in the background, as grey cubes, and names; once"),
    "/radio/links": ("foxglove.SceneUpdate", "links of piconets, at each tick, until they are lost"),
    "/radio/ranges": ("foxglove.SceneUpdate", "rings as far as radios reach, if the channel says so; once"),
    "/radio/jammers": ("foxglove.SceneUpdate", "jammers, while they are on"),
    "/radio/frames": ("foxglove.Log", "a line for each row of the table of frames; lost ones are warnings"),
    "/events": ("foxglove.Log", "what machines report, and news of links"),
    "/robot_N/radio": ("cosim.Radio", "what robot N's radios are doing, its role and links; when that changes"),
    "/robot_N/medium": (
        "cosim.Medium",
        "if the medium is busy, or reserved (NAV), to robot N's 802.11 radios; when that changes",
    ),
    "/robot_N/traffic": ("cosim.Traffic", "frames sent, received and lost, and payloads received, in the last second"),
    "/metrics": ("cosim.Metrics", "the metrics of the run, at its end"),
}
"""The topics, their schemas, and what is on them; those of robot N are also there of station N, as ``/station_N``."""
_MOST_CELLS: Final = 1000
"""The most cells of the map's longer side."""

Message = tuple[Time, str, dict[str, Any]]
"""When, in simulated time; on which topic; what."""


def layout_path(path: Path) -> Path:
    """Return where the panels for the file *path* are."""
    return path.with_suffix(".layout.json")


def write_mcap(recording: Recording, path: Path) -> int:
    """Write *recording* to *path*, and the panels for it beside it; return the number of messages."""
    from mcap.writer import Writer

    path.parent.mkdir(parents=True, exist_ok=True)
    count = 0
    with drafted(path) as draft, draft.open("wb") as file:
        writer: Any = Writer(file)
        writer.start(library=f"cosim {__version__}")
        schemas = {
            name: writer.register_schema(name, "jsonschema", json.dumps({"title": name, **schema}).encode())
            for name, schema in foxglove.SCHEMAS.items()
        }
        channels: dict[str, int] = {}
        for time, topic, message in messages(recording):
            count += 1
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "json", schemas[schema_of(topic)])
            at = EPOCH + time
            writer.add_message(channels[topic], at, json.dumps(message, separators=(",", ":")).encode(), at)
        writer.add_metadata("cosim", _metadata(recording))
        _attach(writer, recording)
        writer.finish()
    with drafted(layout_path(path)) as draft:
        names = [_name(recording, address) for address in recording.addresses]
        draft.write_text(json.dumps(foxglove.layout(names, channels), indent=1), encoding="utf-8")
    return count


def schema_of(topic: str) -> str:
    """Return the name of the schema of the messages on *topic*."""
    first, _, rest = topic[1:].partition("/")
    return TOPICS[f"/robot_N/{rest}" if first.startswith(("robot_", "station_")) else topic][0]


def _name(recording: Recording, address: Address) -> str:
    """Return the name of who has *address* in topics and frames: robot_2, or station_0."""
    return called(address, recording.size).replace(" ", "_")


def _metadata(recording: Recording) -> dict[str, str]:
    names = "seed", "digest", "scenario"
    told: dict[str, str] = {name: recording.metadata[name] for name in names if name in recording.metadata}
    offset = f"{EPOCH} ns are added to simulated time: 0 s of the run is 2000-01-01 00:00:00 UTC"
    return {"cosim": __version__, "run": recording.title, "time": offset, "time_offset_ns": str(EPOCH), **told}


def _attach(writer: Any, recording: Recording) -> None:
    import yaml

    if recording.scenario:
        text = yaml.safe_dump(recording.scenario, sort_keys=False).encode()
        writer.add_attachment(EPOCH, EPOCH, "scenario.yaml", "application/yaml", text)


def messages(recording: Recording) -> Iterator[Message]:
    """Yield the messages in the order of time."""
    sources = (
        _floor(recording),
        _robots(recording),
        _stations(recording),
        _moving(recording),
        _jammers(recording),
        _frames(recording),
        _events(recording),
        iter(sorted(_radios(recording), key=itemgetter(0))),
        iter(sorted(_media(recording), key=itemgetter(0))),
        iter(sorted(_traffic(recording), key=itemgetter(0))),
        _metrics(recording),
    )
    return merge(*sources, key=itemgetter(0))


def _floor(recording: Recording) -> Iterator[Message]:
    shade = colour("#333333")
    walls = foxglove.lines(recording.scene["walls_m"], shade, 0.06, 0.3)
    polygons = [
        (*one, *two)
        for polygon in recording.scene["polygons_m"]
        for one, two in zip(polygon, [*polygon[1:], polygon[0]], strict=True)
    ]
    yield 0, "/map", _map(recording)
    yield (
        0,
        "/walls",
        foxglove.scene([foxglove.entity(EPOCH, "walls", lines=[walls, foxglove.lines(polygons, shade, 0.06, 0.3)])]),
    )


def _map(recording: Recording) -> dict[str, Any]:
    x0, y0, x1, y1 = recording.scene["bounds_m"]
    cell = max(0.05, max(x1 - x0, y1 - y0) / _MOST_CELLS)
    size = int(np.ceil((x1 - x0) / cell)), int(np.ceil((y1 - y0) / cell))
    picture = Image.new("RGBA", size, (235, 235, 235, 255))
    pen = ImageDraw.Draw(picture)

    def cells(points: Any) -> list[tuple[float, float]]:
        # what stands on the upper or right edge belongs to the last cell
        return [(min((x - x0) / cell, size[0] - 1), min((y - y0) / cell, size[1] - 1)) for x, y in points]

    for polygon in recording.scene["polygons_m"]:
        pen.polygon(cells(polygon), fill=(120, 120, 120, 255))
    for a, b, c, d in recording.scene["walls_m"]:
        pen.line(cells(((a, b), (c, d))), fill=(40, 40, 40, 255), width=2)
    return foxglove.grid(EPOCH, (x0, y0), cell, np.asarray(picture))


def _robots(recording: Recording) -> Iterator[Message]:
    radii = recording.scene["radii_m"]

    def body(time: Time, robot: int, down: bool) -> dict[str, Any]:
        shade = colour(ROBOTS[robot % len(ROBOTS)] if not down else "#9a9a9a")
        name = f"robot {robot}" + (", down" if down else "")
        arrow = {
            "pose": foxglove.pose(z=0.45),
            "shaft_length": radii[robot],
            "shaft_diameter": 0.06,
            "head_length": 0.5 * radii[robot],
            "head_diameter": 0.18,
            "color": colour("#000000"),
        }
        parts = {
            "cylinders": [foxglove.cylinder(radii[robot], 0.4, shade)],
            "texts": [foxglove.text(name, 0.8, colour("#000000"))],
            "arrows": [arrow],
        }
        return foxglove.entity(
            EPOCH + time, name.partition(",")[0], f"robot_{robot}", {"robot": robot, "down": down}, **parts
        )

    yield 0, "/robots", foxglove.scene([body(0, robot, False) for robot in range(recording.size)])
    channel = recording.scenario.get("channel", {})
    reach = channel.get("range_m")
    if isinstance(reach, int | float):
        shade = colour("#0072b2", 0.5)
        rings = [
            foxglove.entity(EPOCH, f"range {robot}", f"robot_{robot}", lines=[foxglove.ring(float(reach), shade)])
            for robot in range(recording.size)
        ]
        yield 0, "/radio/ranges", foxglove.scene(rings)
    for row in recording.rows("events"):
        if row["event"] in DOWN | UP and row["source"] >= 0:
            yield row["time_ns"], "/robots", foxglove.scene([body(row["time_ns"], row["source"], row["event"] in DOWN)])


def _stations(recording: Recording) -> Iterator[Message]:
    shade, ink = colour(STATION), colour("#000000")
    entities = []
    for number, (x, y) in enumerate(recording.stations.tolist()):
        name = recording.called(recording.size + number)
        cubes, texts = [foxglove.cube(0.3, shade, x, y)], [foxglove.text(name, 0.8, ink, x, y)]
        entities.append(foxglove.entity(EPOCH, name, metadata={"station": number}, cubes=cubes, texts=texts))
    if entities:
        yield 0, "/stations", foxglove.scene(entities)


def _moving(recording: Recording) -> Iterator[Message]:
    """Yield what changes with each tick: the robots' places, and the links between them, and between stations."""
    times, poses = recording.poses()
    stations = recording.stations.tolist()
    links = recording.links()
    drawn: set[str] = set()
    for time, poses_now in zip(times.tolist(), poses.tolist(), strict=True):
        found = [foxglove.transform(EPOCH + time, f"robot_{robot}", *pose) for robot, pose in enumerate(poses_now)]
        places = poses_now + stations
        yield time, "/tf", {"transforms": found}
        entities = [
            foxglove.entity(
                EPOCH + time,
                f"link {master} {slave}",
                metadata={"master": master, "slave": slave},
                lines=[foxglove.lines([(*places[master][:2], *places[slave][:2])], colour("#009e73"), 0.08, 0.2)],
            )
            for begin, end, master, slave in links
            if begin <= time < end
        ]
        present = {each["id"] for each in entities}
        gone = [(EPOCH + time, name) for name in sorted(drawn - present)]
        if entities or gone:
            yield time, "/radio/links", foxglove.scene(entities, gone)
        drawn = present


def _jammers(recording: Recording) -> Iterator[Message]:
    found: list[Message] = []
    for each in recording.jammers():
        name, shade = f"jammer {each.fault}", colour("#d55e00")
        marks = [foxglove.cylinder(0.2, 0.6, shade)]
        for mark in marks:
            mark["pose"]["position"] |= {"x": each.x_m, "y": each.y_m}
        words = [foxglove.text(name, 1.0, shade, each.x_m, each.y_m)]
        on = foxglove.entity(
            EPOCH + each.begin, name, metadata={"power_dbm": each.power_dbm}, cylinders=marks, texts=words
        )
        found.append((each.begin, "/radio/jammers", foxglove.scene([on])))
        if each.end <= recording.end:
            found.append((each.end, "/radio/jammers", foxglove.scene(gone=[(EPOCH + each.end, name)])))
    yield from sorted(found, key=itemgetter(0))


def _frames(recording: Recording) -> Iterator[Message]:
    names = packet_names(recording, 0, recording.end + 1)
    for number, (row, sending) in enumerate(zip(recording.rows("frames"), sendings(recording, "frames"), strict=True)):
        receiver = "all" if row["destination"] < 0 else recording.called(row["destination"])
        outcome = f"{row['outcome']}{' in the ' + row['part'] if row['part'] else ''}"
        channel = f", channel {row['channel']}" if row["channel"] >= 0 else ""
        kind = names.get(sending, row["kind"])
        words = f"{kind} to {receiver}{channel}, {row['length']} B, {row['duration_ns'] / 1000:g} µs: {outcome}"
        level = foxglove.INFO if row["outcome"] in WHOLE else foxglove.WARNING
        told = foxglove.log(EPOCH + row["time_ns"], level, _name(recording, row["source"]), words, "frames", number)
        yield row["time_ns"], "/radio/frames", told


def _events(recording: Recording) -> Iterator[Message]:
    def told(table: str, fixed: frozenset[str]) -> Iterator[Message]:
        for number, row in enumerate(recording.rows(table)):
            about = [f"{key} {value}" for key, value in row.items() if value not in (None, "") and key not in fixed]
            level = (
                foxglove.ERROR
                if row["event"] in DOWN
                else foxglove.WARNING
                if row["event"] == "Lost"
                else foxglove.INFO
            )
            words = " ".join([row["event"], ", ".join(about)]).strip()
            message = foxglove.log(EPOCH + row["time_ns"], level, f"robot_{row['source']}", words, table, number)
            yield row["time_ns"], "/events", message

    fixed = frozenset({"time_ns", "source", "event"})
    yield from merge(told("events", fixed), told("links", fixed), key=itemgetter(0))


def _radios(recording: Recording) -> Iterator[Message]:
    """Yield what the radios of each robot and station do, whenever that changes."""
    changes: dict[int, list[_Change]] = {address: [(0, 0, "", "")] for address in recording.addresses}
    for row in recording.rows("intervals"):
        if row["robot"] >= 0:
            changes[row["robot"]] += [
                (row["start_ns"], 1, "state", row["state"]),
                (row["end_ns"], -1, "state", row["state"]),
            ]
    for begin, end, master, slave in recording.links():
        for robot, role, peer in ((master, "master", slave), (slave, "slave", master)):
            for time, change in ((begin, 1), (end, -1)):
                name = str(peer) if peer < recording.size else recording.called(peer)
                changes[robot] += [(time, change, "role", role), (time, change, "peer", name)]
    for row in recording.rows("events"):
        if row["event"] in DOWN | UP and row["source"] in changes:
            changes[row["source"]].append((row["time_ns"], 1 if row["event"] in DOWN else -1, "down", "down"))
    for robot, found in changes.items():
        for time, on in _settled(found, recording.end):
            yield (
                time,
                f"/{_name(recording, robot)}/radio",
                {
                    "timestamp": foxglove.instant(EPOCH + time),
                    "state": " + ".join(on["state"]) or "idle",
                    "role": " + ".join(on["role"]) or "none",
                    "links": len(on["peer"]),
                    "peers": ", ".join(on["peer"]),
                    "down": bool(on["down"]),
                },
            )


def _media(recording: Recording) -> Iterator[Message]:
    """Yield for all with 802.11 whether their radios sense a busy or reserved medium, whenever that changes."""
    changes: dict[int, list[_Change]] = {}
    for lane in sensed_lanes(recording):
        found = changes.setdefault(lane.robot, [(0, 0, "", "")])
        for start, end in zip(lane.starts.tolist(), lane.ends.tolist(), strict=True):
            found += [(start, 1, "state", lane.what), (end, -1, "state", lane.what)]
    for robot, found in changes.items():
        for time, on in _settled(found, recording.end):
            state = " + ".join(on["state"]) or "idle"
            topic = f"/{_name(recording, robot)}/medium"
            yield time, topic, {"timestamp": foxglove.instant(EPOCH + time), "state": state}


_Change = tuple[Time, int, str, str]
"""When how many more are there, of what, and the word for it."""


def _settled(changes: list[_Change], last: Time) -> Iterator[tuple[Time, Mapping[str, list[str]]]]:
    """Yield at each instant of *changes* up to *last* the words for all that is there then, by what they are of."""
    counts: Counter[tuple[str, str]] = Counter()
    changes.sort(key=itemgetter(0))
    for number, (time, change, what, word) in enumerate(changes):
        counts[what, word] += change
        if time > last or (number + 1 < len(changes) and changes[number + 1][0] == time):
            continue  # several changes at one instant are one message
        on: defaultdict[str, list[str]] = defaultdict(list)
        for name, each in sorted(key for key, count in counts.items() if count > 0):
            on[name].append(each)
        yield time, on


def _traffic(recording: Recording) -> Iterator[Message]:
    """Yield for each robot and station, and each second, how much it has sent and received in it."""
    counts: Counter[tuple[int, int, str]] = Counter()
    sent: set[tuple[Time, int, int, str]] = set()
    if recording.count("frames"):
        columns = [
            recording.column("frames", name).tolist()
            for name in ("time_ns", "source", "destination", "kind", "outcome")
        ]
        for time, source, receiver, kind, outcome, radio in zip(
            *columns, recording.radio("frames").tolist(), strict=True
        ):
            sent.add((time, source, radio, kind))
            if receiver >= 0:
                counts[receiver, time // S, "frames_received" if outcome in WHOLE else "frames_lost"] += 1
    if recording.count("transmissions"):
        columns = [recording.column("transmissions", name).tolist() for name in ("time_ns", "source", "kind")]
        sent |= {
            (time, source, radio, kind)
            for time, source, kind, radio in zip(*columns, recording.radio("transmissions").tolist(), strict=True)
        }
    for time, source, _, _ in sent:
        counts[source, time // S, "frames_sent"] += 1
    if recording.count("messages"):
        columns = [recording.column("messages", name).tolist() for name in ("time_ns", "source")]
        counts.update((robot, time // S, "payloads_received") for time, robot in zip(*columns, strict=True))
    of_all = ("frames_sent", "frames_received", "frames_lost")
    for address in recording.addresses:
        topic = f"/{_name(recording, address)}/traffic"
        names = (*of_all, "payloads_received") if address < recording.size else of_all  # a station has no machine
        for second in range(recording.end // S):
            time = (second + 1) * S
            numbers = {name: counts[address, second, name] for name in names}
            yield time, topic, {"timestamp": foxglove.instant(EPOCH + time), **numbers}


def _metrics(recording: Recording) -> Iterator[Message]:
    metrics = json.loads(recording.metadata.get("metrics", "{}"))
    numbers = {name: value for name, value in metrics.items() if isinstance(value, int | float) and value == value}
    if numbers:
        yield (
            recording.end,
            "/metrics",
            {**numbers, "simulated_s": numbers.get("simulated_s", to_seconds(recording.end))},
        )
