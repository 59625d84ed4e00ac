"""The scene of a run, which does not change during it: the floor, the robots' sizes, the names of things.

``stations`` are those in the background, each with its place and the number of its radio: the first has the address
after that of the last robot, and so on.
"""

import json
from pathlib import Path
from typing import Any, Final

import numpy as np

from cosim.channels.adhoc.settings import AdhocSettings
from cosim.channels.bluetooth.settings import BluetoothSettings
from cosim.channels.kinds import ChannelSettings
from cosim.channels.radios import RadiosSettings
from cosim.errors import UserError
from cosim.randomness import Streams
from cosim.scenario import Scenario
from cosim.simulation import frame_turns
from cosim.units import SLOT, Time
from cosim.web.messages import Plain
from cosim.web.reach import radios_of
from cosim.world.floorplan import Floorplan

FILE: Final = "scene.json"
"""Name of the scene's file beside the tables of a trace."""


def scene_of(scenario: Scenario, floor: Floorplan, seed: int) -> Plain:
    """Return the scene of a run of *scenario* on *floor*, as plain data; lengths in metres, times in seconds."""
    return {
        "name": scenario.name,
        "protocol": scenario.protocol.use,
        "channel": scenario.channel.kind,
        "seed": seed,
        "duration_s": scenario.duration_s,
        "tick_s": scenario.tick_s,
        "bounds_m": list(floor.bounds_m),
        "walls_m": np.round(floor.walls_m, 6).tolist(),
        "polygons_m": [[list(point) for point in polygon] for polygon in floor.polygons_m],
        "places_m": {name: [list(point) for point in points] for name, points in floor.places_m.items()},
        "base_m": _base(scenario, floor),
        "radii_m": [body.radius_m for body in scenario.team.bodies],
        "slot_ns": _slot(scenario.channel),
        "wall_losses_db": np.round(floor.wall_loss_db, 3).tolist(),
        "radios": radios_of(scenario),
        "stations": [{"place_m": list(each.place_m), "radio": each.radio} for each in scenario.stations],
        "scanner": _scanner(scenario, seed),
    }


def _slot(settings: ChannelSettings) -> Time | None:
    """Return how long a slot of the channel is, ns; None where there are none."""
    match settings:
        case BluetoothSettings():
            return SLOT
        case AdhocSettings():
            return settings.radio.slot
        case RadiosSettings(radios=radios):
            return next((slot for slot in map(_slot, radios) if slot is not None), None)
    return None


def _scanner(scenario: Scenario, seed: int) -> Plain | None:
    """Return what is told of the robots' range scanners; None if they have none."""
    if not scenario.protocol.spec.needs_view:
        return None
    return {
        "senses": scenario.team.senses.model_dump(mode="json"),
        "turns_rad": frame_turns(scenario, Streams(seed)),
    }


def _base(scenario: Scenario, floor: Floorplan) -> list[float] | None:
    """Return where the team's base is by its protocol's parameters, or else by the floor; None if neither says so."""
    parameters: Any = scenario.protocol.parameters
    for name in ("base_m", "base"):
        point = getattr(parameters, name, None)
        if isinstance(point, tuple) and len(point) == 2 and all(isinstance(value, float | int) for value in point):
            return [float(value) for value in point]
    for name, points in floor.places_m.items():
        if name.lower() == "base" and points:
            return [float(value) for value in points[0]]
    return None


def write_scene(scene: Plain, folder: Path) -> None:
    """Write *scene* beside the tables in *folder*."""
    (folder / FILE).write_text(json.dumps(scene), encoding="utf-8")


def read_scene(folder: Path) -> Plain | None:
    """Return the scene in *folder*, None if there is none; raise UserError for a file that is no scene."""
    path = folder / FILE
    if not path.is_file():
        return None
    try:
        scene = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise UserError(f"{path}: is no JSON: {error}") from None
    if not isinstance(scene, dict) or not {"bounds_m", "walls_m", "radii_m", "tick_s"} <= scene.keys():
        raise UserError(f"{path}: is no scene of a run")
    return scene
