"""A small floor for the playbook page: a base room, a corridor with a bend, three posts, and a team of three."""

from pathlib import Path
from typing import Any

import yaml

from cosim.scenario import load
from cosim.web.live import Live

WALLS = [
    # the base room, with a door to the corridor
    *([0, 6, 5, 6], [5, 0, 5, 2.2], [5, 3.8, 5, 6]),
    # the corridor, and its bend
    *([5, 1.8, 16, 1.8], [5, 4.2, 13.6, 4.2], [13.6, 4.2, 13.6, 10]),
]
FLOOR: dict[str, Any] = {
    "name": "annexe",
    "bounds_m": [0, 0, 16, 10],
    "walls": WALLS,
    "places": {"base": [[2.5, 3]], "posts": [[7.5, 3], [11, 3], [14.8, 7.5]], "corner": [[14.8, 3]]},
}
"""The floor, as it stands in YAML."""
PLAIN: dict[str, Any] = {
    "name": "annexe",
    "duration_s": 3600,
    "team": {"size": 3, "body": {"radius_m": 0.2, "speed_mps": 1.0, "acceleration_mps2": 0.8}},
    "channel": {"kind": "ideal"},
    "protocol": {"use": "protocols.deployment.spec:SPEC", "parameters": {}},
}
"""A scenario of it, as it stands in YAML."""


def written(folder: Path, **changes: Any) -> Path:
    """Write the scenario and its floor into *folder*; *changes*: of the scenario; ``parameters``: the protocol's."""
    (folder / "floor.yaml").write_text(yaml.safe_dump(FLOOR), encoding="utf-8")
    protocol = {**PLAIN["protocol"], "parameters": changes.pop("parameters", {})}
    plain = PLAIN | {"floorplan": {"map": "floor.yaml"}, "protocol": protocol} | changes
    path = folder / "scenario.yaml"
    path.write_text(yaml.safe_dump(plain), encoding="utf-8")
    return path


def begun(folder: Path, playing: bool = True, speed: float = 60.0, **changes: Any) -> Live:
    """Begin a run of it; *changes* as in :func:`written`."""
    return Live(load(written(folder, **changes)), 1, playing, speed, attended=True)
