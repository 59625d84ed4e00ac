"""How far a robot is heard: on a floor, what arrives from it at each place of a coarse grid, or a radius.

So it is for a station in the background, which has an address, too. That is what the channel's law says of distance and
walls, as a scene has it. Shadowing is not in it, which is one value for each pair of robots, nor are walls of loss that
faults put up.
"""

import math
from typing import Any, Final

import numpy as np

from cosim.channels.adhoc.settings import AdhocSettings
from cosim.channels.ble.settings import BleSettings
from cosim.channels.bluetooth.bits.powers import POWER_DBM, noise_dbm
from cosim.channels.bluetooth.settings import BluetoothSettings
from cosim.channels.kinds import ChannelSettings
from cosim.channels.propagation import NEAREST_M, PropagationSettings
from cosim.channels.vision import OpticalSettings
from cosim.errors import UserError
from cosim.geometry.segments import crossed_weight
from cosim.scenario import Scenario
from cosim.web.messages import Plain

CELLS: Final = 64
"""Number of cells along the longer side of a floor."""
_LEAST_CELL_M: Final = 0.1
_OPAQUE_DB: Final = 1000
"""Loss of a wall that nothing passes."""
_UNIT_DB: Final = 0.001


def radios_of(scenario: Scenario) -> list[Plain]:
    """Return what a scene tells of the reach of each radio; by address: of the robots, and of stations after them.

    ``range_m`` of each (None: without limit, or decided by the law), ``law``: None, or reference_db, exponent and
    whether walls count; ``power_dbm`` of each and ``faintest_dbm`` go with a law; ``carried``: by whom.
    """
    everyone = (*scenario.team.carried, *((station.radio,) for station in scenario.stations))
    return [
        _radio(part, scenario) | {"carried": [address for address, own in enumerate(everyone) if radio in own]}
        for radio, part in enumerate(scenario.radios)
    ]


def _radio(settings: ChannelSettings, scenario: Scenario) -> Plain:
    team, stations = scenario.team, len(scenario.stations)
    ranges = _own(team.reaches_m, stations, getattr(settings, "range_m", None))
    about: Plain = {"kind": settings.kind, "range_m": ranges, "law": None}
    match settings:
        case OpticalSettings():
            return (
                about
                | {"law": {"reference_db": 0.0, "exponent": 0.0, "walls": "opaque"}}
                | _faint([0.0] * (team.size + stations), -1.0)
            )
        case AdhocSettings(propagation=PropagationSettings() as fading):
            powers = _own(team.powers_dbm, stations, settings.power_dbm)
            return about | {"law": _law(fading)} | _faint(powers, settings.detection_dbm)
        case BleSettings(propagation=PropagationSettings() as fading):
            powers = _own(team.powers_dbm, stations, settings.power_dbm)
            return about | {"law": _law(fading)} | _faint(powers, settings.sensitivity_dbm)
        case BluetoothSettings(propagation=PropagationSettings() as fading):
            powers = [POWER_DBM[number] for number in _own(team.power_classes, stations, settings.power_class)]
            faintest = settings.noise_dbm + settings.sensitivity_dbm - noise_dbm(settings.sensitivity_dbm)
            return about | {"law": _law(fading)} | _faint(powers, faintest)
    return about


def _own(own: Any, stations: int, usual: Any) -> list[Any]:
    """Return what robots have of their *own*, or else the *usual*, and that for each of the *stations*."""
    return [usual if value is None else value for value in (*own, *(None,) * stations)]


def _law(law: PropagationSettings) -> Plain:
    exponent = 2.0 if law.model == "free_space" else law.exponent
    return {"reference_db": law.reference_loss_db, "exponent": exponent, "walls": "lossy" if law.walls else "none"}


def _faint(powers_dbm: list[float], faintest_dbm: float) -> Plain:
    return {"power_dbm": powers_dbm, "faintest_dbm": round(faintest_dbm, 3)}


def reach(scene: Plain, robot: int, place_m: tuple[float, float]) -> Plain:
    """Return how far *robot* is heard from a place of *scene*: the message ``reach``, a row for each of its radios.

    It may be the address of a station in the background. A row has ``radio``, ``kind`` and ``range_m`` (None: no limit
    is known); by a law also ``corner_m``, ``cell_m``, ``columns``, ``rows``, ``faintest_dbm`` and ``power_dbm``, whole
    dBm in the middle of each cell, row by row from the corner on. Raise UserError for a robot that there is not.
    """
    if not 0 <= robot < len(scene["radii_m"]) + len(scene.get("stations", ())):
        raise UserError(f"there is no robot {robot}: the team has robots 0 to {len(scene['radii_m']) - 1}")
    radios = [
        {"radio": number, "kind": radio["kind"], "range_m": radio["range_m"][robot]}
        | _map(scene, radio, robot, place_m)
        for number, radio in enumerate(scene.get("radios", []))
        if robot in radio["carried"]
    ]
    return {"say": "reach", "robot": robot, "place_m": list(place_m), "radios": radios}


def _map(scene: Plain, radio: Plain, robot: int, place_m: tuple[float, float]) -> Plain:
    law = radio["law"]
    if law is None:
        return {}
    x_min, y_min, x_max, y_max = scene["bounds_m"]
    cell_m = max(_LEAST_CELL_M, max(x_max - x_min, y_max - y_min) / CELLS)
    columns, rows = (max(1, math.ceil(span / cell_m - 1e-9)) for span in (x_max - x_min, y_max - y_min))
    x, y = x_min + cell_m * (np.arange(columns) + 0.5), y_min + cell_m * (np.arange(rows) + 0.5)
    far = np.hypot(x[None, :] - place_m[0], y[:, None] - place_m[1])
    lost = law["reference_db"] + 10.0 * law["exponent"] * np.log10(np.maximum(far, NEAREST_M))
    lost += _walls_db(scene, law["walls"], x, y, place_m)
    if law["walls"] == "opaque":
        lost[far > (radio["range_m"][robot] or math.inf)] = _OPAQUE_DB
    powers = np.maximum(radio["power_dbm"][robot] - lost, -_OPAQUE_DB)
    about = {"corner_m": [x_min, y_min], "cell_m": cell_m, "columns": columns, "rows": rows}
    return about | {"faintest_dbm": radio["faintest_dbm"], "power_dbm": np.rint(powers).astype(int).ravel().tolist()}


def _walls_db(scene: Plain, walls: str, x: Any, y: Any, place_m: tuple[float, float]) -> Any:
    """Return what the walls take from signals at each cell, dB, shape (rows, columns)."""
    walls_m = np.array(scene["walls_m"], dtype=np.float64).reshape(-1, 4)
    if walls == "none" or not len(walls_m):
        return 0.0
    loss_db = [_OPAQUE_DB] * len(walls_m) if walls == "opaque" else scene["wall_losses_db"]
    units = np.rint(np.array(loss_db) / _UNIT_DB).astype(np.int64)
    crossed = [[crossed_weight(walls_m, units, *place_m, float(to_x), float(to_y)) for to_x in x] for to_y in y]
    return np.array(crossed) * _UNIT_DB
