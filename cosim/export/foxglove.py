"""Messages that Foxglove's panels know by the names of their schemas, the schemas, and a layout of panels.

The schemas are our own, written from Foxglove's documentation, and hold the fields that we write. A panel goes by the
schema's name.
"""

import base64
import math
from collections.abc import Container, Iterable, Mapping, Sequence
from typing import Any, Final

from cosim.units import S, Time

Plain = dict[str, Any]
LAYOUT_SPEED: Final = 1.0

NUMBER: Final[Plain] = {"type": "number"}
INTEGER: Final[Plain] = {"type": "integer"}
TEXT: Final[Plain] = {"type": "string"}
FLAG: Final[Plain] = {"type": "boolean"}


def fields(**properties: Any) -> Plain:
    """Return the JSON schema of an object with these *properties*."""
    return {"type": "object", "properties": properties}


def rows(item: Plain) -> Plain:
    """Return the JSON schema of an array of *item*."""
    return {"type": "array", "items": item}


_INSTANT: Final = {"title": "time", **fields(sec=INTEGER, nsec=INTEGER)}
_DURATION: Final = {"title": "duration", **fields(sec=INTEGER, nsec=INTEGER)}
_VECTOR: Final = fields(x=NUMBER, y=NUMBER, z=NUMBER)
_POSE: Final = fields(position=_VECTOR, orientation=fields(x=NUMBER, y=NUMBER, z=NUMBER, w=NUMBER))
_COLOUR: Final = fields(r=NUMBER, g=NUMBER, b=NUMBER, a=NUMBER)
_ENTITY: Final = fields(
    timestamp=_INSTANT,
    frame_id=TEXT,
    id=TEXT,
    lifetime=_DURATION,
    frame_locked=FLAG,
    metadata=rows(fields(key=TEXT, value=TEXT)),
    arrows=rows(fields(pose=_POSE, shaft_length=NUMBER, shaft_diameter=NUMBER, head_length=NUMBER,
                       head_diameter=NUMBER, color=_COLOUR)),
    cubes=rows(fields(pose=_POSE, size=_VECTOR, color=_COLOUR)),
    cylinders=rows(fields(pose=_POSE, size=_VECTOR, bottom_scale=NUMBER, top_scale=NUMBER, color=_COLOUR)),
    lines=rows(fields(type=INTEGER, pose=_POSE, thickness=NUMBER, scale_invariant=FLAG, points=rows(_VECTOR),
                      color=_COLOUR, colors=rows(_COLOUR), indices=rows(INTEGER))),
    texts=rows(fields(pose=_POSE, billboard=FLAG, font_size=NUMBER, scale_invariant=FLAG, color=_COLOUR, text=TEXT)),
)  # fmt: skip

SCHEMAS: Final[dict[str, Plain]] = {
    "foxglove.FrameTransforms": fields(
        transforms=rows(
            fields(timestamp=_INSTANT, parent_frame_id=TEXT, child_frame_id=TEXT, translation=_VECTOR,
                   rotation=_POSE["properties"]["orientation"])
        )
    ),
    "foxglove.Grid": fields(
        timestamp=_INSTANT, frame_id=TEXT, pose=_POSE, column_count=INTEGER, cell_size=fields(x=NUMBER, y=NUMBER),
        row_stride=INTEGER, cell_stride=INTEGER, fields=rows(fields(name=TEXT, offset=INTEGER, type=INTEGER)),
        data={"type": "string", "contentEncoding": "base64"},
    ),
    "foxglove.SceneUpdate": fields(
        deletions=rows(fields(timestamp=_INSTANT, type=INTEGER, id=TEXT)), entities=rows(_ENTITY)
    ),
    "foxglove.Log": fields(timestamp=_INSTANT, level=INTEGER, message=TEXT, name=TEXT, file=TEXT, line=INTEGER),
    "cosim.Radio": fields(timestamp=_INSTANT, state=TEXT, role=TEXT, links=INTEGER, peers=TEXT, down=FLAG),
    "cosim.Medium": fields(timestamp=_INSTANT, state=TEXT),
    "cosim.Traffic": fields(timestamp=_INSTANT, frames_sent=INTEGER, frames_received=INTEGER, frames_lost=INTEGER,
                            payloads_received=INTEGER),
    "cosim.Metrics": {"type": "object", "additionalProperties": NUMBER},
}  # fmt: skip
"""The schemas of all messages by their names."""

INFO, WARNING, ERROR = 2, 3, 4
"""Levels of a log."""
_UINT8: Final = 1
_LINE_STRIP, _LINE_LIST = 0, 2
_HERE: Final = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}


def instant(time: Time) -> dict[str, int]:
    """Return *time*, ns, as Foxglove has it."""
    return {"sec": time // S, "nsec": time % S}


def vector(x: float, y: float, z: float = 0.0) -> dict[str, float]:
    """Return a point or a size, m."""
    return {"x": x, "y": y, "z": z}


def pose(x: float = 0.0, y: float = 0.0, z: float = 0.0, heading: float = 0.0) -> Plain:
    """Return a pose: m, and radians counter-clockwise."""
    turned = {"x": 0.0, "y": 0.0, "z": math.sin(heading / 2), "w": math.cos(heading / 2)} if heading else dict(_HERE)
    return {"position": vector(x, y, z), "orientation": turned}


def colour(text: str, alpha: float = 1.0) -> dict[str, float]:
    """Return the colour #rrggbb."""
    red, green, blue = (int(text[at : at + 2], 16) / 255 for at in (1, 3, 5))
    return {"r": round(red, 3), "g": round(green, 3), "b": round(blue, 3), "a": alpha}


def transform(time: Time, child: str, x: float, y: float, heading: float) -> Plain:
    """Return where the frame *child* is on the floor."""
    place = pose(x, y, 0.0, heading)
    return {
        "timestamp": instant(time),
        "parent_frame_id": FLOOR,
        "child_frame_id": child,
        "translation": place["position"],
        "rotation": place["orientation"],
    }


FLOOR: Final = "floor"
"""The frame that everything else is placed in."""


def grid(time: Time, corner: tuple[float, float], cell_m: float, pixels: Any) -> Plain:
    """Return a map of coloured cells; *pixels* (rows, columns, 4) of red, green, blue, alpha, the lowest row first."""
    columns = pixels.shape[1]
    names = ("red", "green", "blue", "alpha")
    return {
        "timestamp": instant(time),
        "frame_id": FLOOR,
        "pose": pose(*corner, -0.01),
        "column_count": columns,
        "cell_size": {"x": cell_m, "y": cell_m},
        "row_stride": 4 * columns,
        "cell_stride": 4,
        "fields": [{"name": name, "offset": at, "type": _UINT8} for at, name in enumerate(names)],
        "data": base64.b64encode(pixels.tobytes()).decode(),
    }


def entity(
    time: Time, name: str, frame: str = FLOOR, metadata: Mapping[str, object] | None = None, **parts: Any
) -> Plain:
    """Return a thing to draw; it replaces the one of the same *name* on its topic, and stays."""
    return {
        "timestamp": instant(time),
        "frame_id": frame,
        "id": name,
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": True,
        "metadata": [{"key": key, "value": str(value)} for key, value in (metadata or {}).items()],
        **parts,
    }


def lines(segments: Iterable[Sequence[float]], shade: Plain, thickness: float, z: float = 0.0) -> Plain:
    """Return *segments*, (x1, y1, x2, y2) each, as one primitive of lines."""
    points = [vector(x, y, z) for a, b, c, d in segments for x, y in ((a, b), (c, d))]
    return _lines(_LINE_LIST, points, shade, thickness)


def ring(radius_m: float, shade: Plain, thickness: float = 0.03, corners: int = 64) -> Plain:
    """Return a circle about the entity's frame."""
    turns = [2 * math.pi * corner / corners for corner in range(corners + 1)]
    points = [vector(radius_m * math.cos(turn), radius_m * math.sin(turn)) for turn in turns]
    return _lines(_LINE_STRIP, points, shade, thickness)


def _lines(kind: int, points: Sequence[Plain], shade: Plain, thickness: float) -> Plain:
    fixed = {"type": kind, "pose": pose(), "thickness": thickness, "scale_invariant": False}
    return {**fixed, "points": points, "color": shade, "colors": [], "indices": []}


def cylinder(radius_m: float, height_m: float, shade: Plain) -> Plain:
    """Return an upright cylinder that stands on the floor."""
    size = vector(2 * radius_m, 2 * radius_m, height_m)
    return {"pose": pose(z=height_m / 2), "size": size, "bottom_scale": 1.0, "top_scale": 1.0, "color": shade}


def cube(side_m: float, shade: Plain, x: float, y: float) -> Plain:
    """Return a cube that stands on the floor."""
    return {"pose": pose(x, y, side_m / 2), "size": vector(side_m, side_m, side_m), "color": shade}


def text(words: str, z: float, shade: Plain, x: float = 0.0, y: float = 0.0) -> Plain:
    """Return *words* that always face who looks."""
    return {
        "pose": pose(x, y, z),
        "billboard": True,
        "font_size": 14.0,
        "scale_invariant": True,
        "color": shade,
        "text": words,
    }


def scene(entities: Sequence[Plain] = (), gone: Sequence[tuple[Time, str]] = ()) -> Plain:
    """Return an update of a topic: *entities* that are new or changed, and the names of those that are *gone*."""
    deletions = [{"timestamp": instant(time), "type": 0, "id": name} for time, name in gone]
    return {"deletions": deletions, "entities": list(entities)}


def log(time: Time, level: int, name: str, message: str, file: str, line: int) -> Plain:
    """Return a line of a log; *file* and *line* are the table and the number of the row that it tells of."""
    return {"timestamp": instant(time), "level": level, "message": message, "name": name, "file": file, "line": line}


def layout(names: Sequence[str], topics: Container[str] = ()) -> Plain:
    """Return panels for the robots, and stations, of these *names*: the floor, states, traffic, frames and events.

    They are as Foxglove imports them. Those of *topics* that only some runs have are shown, too.
    """
    shown = ("/map", "/walls", "/robots", "/radio/links", "/radio/jammers")
    panels = {
        "3D!floor": {
            "cameraState": {"perspective": False, "distance": 40, "phi": 0, "thetaOffset": 90},
            "followTf": FLOOR,
            "topics": {topic: {"visible": True} for topic in (*shown, *("/stations",) * ("/stations" in topics))}
            | {"/radio/ranges": {"visible": False}},
        },
        "StateTransitions!radio": {
            "isSynced": True,
            "paths": [
                {"value": f"/{name}/{topic}.state", "timestampMethod": "receiveTime", "label": label}
                for name in names
                for topic, label in (("radio", name), ("medium", f"{name}: medium"))
                if topic == "radio" or f"/{name}/{topic}" in topics
            ],
        },
        "Plot!traffic": {
            "title": "frames lost a second",
            "isSynced": True,
            "showLegend": True,
            "paths": [
                {
                    "value": f"/{name}/traffic.frames_lost",
                    "timestampMethod": "receiveTime",
                    "enabled": True,
                    "label": name,
                }
                for name in names
            ],
        },
        "RosOut!frames": {"topicToRender": "/radio/frames", "minLogLevel": INFO, "searchTerms": []},
        "RosOut!events": {"topicToRender": "/events", "minLogLevel": INFO, "searchTerms": []},
    }
    logs = {"direction": "row", "first": "RosOut!frames", "second": "RosOut!events", "splitPercentage": 50}
    times = {"direction": "column", "first": "StateTransitions!radio", "second": "Plot!traffic", "splitPercentage": 60}
    right = {"direction": "column", "first": times, "second": logs, "splitPercentage": 60}
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": LAYOUT_SPEED},
        "layout": {"direction": "row", "first": "3D!floor", "second": right, "splitPercentage": 50},
    }
