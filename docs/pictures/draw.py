"""Make the pictures of the handbook: what a run looks like when something happens that is worth a look.

    python docs/pictures/draw.py               all of them
    python docs/pictures/draw.py setting_up    this one

Each comes from a scenario beside it, and is a figure NAME.svg and the list of its boxes, NAME.csv: when, of whom, what
kind, on which RF channel, with which outcome. A test makes the runs again and compares the lists with their tables.
``setting_up.webp``, which README shows, is a film of the first.
"""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[1]), str(HERE)]

from cosim.cli_pictures import recording_of  # noqa: E402
from cosim.export.recording import DRAWN, Recording  # noqa: E402
from cosim.picture.film import write_film  # noqa: E402
from cosim.picture.moment import View, draw_moment, save_moment  # noqa: E402
from cosim.picture.window import as_csv  # noqa: E402
from cosim.scenario import load  # noqa: E402
from cosim.simulation import Simulation  # noqa: E402
from cosim.units import MS, S, Time  # noqa: E402


class Picture(NamedTuple):
    """A picture: its file, the scenario that it is of, and how to find what it shows."""

    name: str
    scenario: str
    view: Callable[[Recording], View]


def first_frame(recording: Recording, after: Time = 0, **wanted: str) -> Time:
    """Return when the first frame after *after* began whose columns are as *wanted*."""
    for row in recording.rows("frames"):
        if row["time_ns"] >= after and all(row[name] == value for name, value in wanted.items()):
            return int(row["time_ns"])
    raise LookupError(f"there is no frame with {wanted}")


def first_state(recording: Recording, state: str, after: Time = 0) -> Time:
    """Return when the first interval of *state* after *after* began."""
    return next(
        row["start_ns"] for row in recording.rows("intervals") if row["state"] == state and row["start_ns"] >= after
    )


def setting_up(recording: Recording) -> View:
    """Return the whole set-up: inquiry, three pages, the first polls."""
    last = max(begin for begin, *_ in recording.links())
    return View(last, 0, last + 60 * MS)


def paging(recording: Recording) -> View:
    """Return the end of the first page: ID, its answer, FHS, ID, POLL, NULL."""
    linked = min(begin for begin, *_ in recording.links())
    return View(linked - MS // 10, linked - 15 * MS, linked + 8 * MS, channels=True)


def lost_payload(recording: Recording) -> View:
    """Return the first payload that was lost, and what its sender did about it."""
    lost = first_frame(recording, part="payload")
    return View(lost + MS // 10, lost - 5 * MS, lost + 15 * MS, channels=True)


def masters_death(recording: Recording) -> View:
    """Return the death, and the piconet that the others make."""
    again = first_state(recording, "master", 8 * S)
    return View(again, 7 * S + S // 2, again + S)


def hidden_terminal(recording: Recording) -> View:
    """Return the first frames that collide, and their repetitions until one gets through."""
    lost, came = first_frame(recording, outcome="collided"), first_frame(recording, kind="ACK")
    return View(lost + MS, lost - MS, came + 2 * MS)


def aodv_repair(recording: Recording) -> View:
    """Return the last payload over the relay that dies, and the first over the other one."""
    died = first_state(recording, "killed")
    again = next(row["time_ns"] for row in recording.rows("messages") if row["time_ns"] > died + 50 * MS)
    return View(again - MS // 2, died - 40 * MS, again + 20 * MS)


def jammer_with_afh(recording: Recording) -> View:
    """Return the jammer's first seconds: losses on its channels, until these are left out."""
    on = first_state(recording, "jammer")
    return View(on + S, on - S // 2, on + 7 * S // 2, channels=True)


def growing_map(recording: Recording) -> View:
    """Return what was seen after 20, 60 and 100 s, and the messages that share it about then."""
    sent = first_frame(recording, 100 * S)
    return View(sent + MS // 10, sent - 2 * S, sent + 2 * S, earlier=(20 * S, 60 * S), seen_m=4.0)


PICTURES = (
    Picture("setting_up", "setting_up", setting_up),
    Picture("paging", "setting_up", paging),
    *(
        Picture(view.__name__, view.__name__, view)
        for view in (lost_payload, masters_death, hidden_terminal, aodv_repair, jammer_with_afh, growing_map)
    ),
)
FILM = "setting_up"


def recorded(scenario: str) -> Recording:
    """Make the run of *scenario*, and return its recording."""
    given = load(HERE / f"{scenario}.yaml")
    simulation = Simulation(given, given.seed, DRAWN)
    return recording_of(simulation, simulation.run(), given.seed)


def main(names: Sequence[str]) -> None:
    """Make the pictures *names*, or all."""
    made: dict[str, Recording] = {}
    for name, scenario, view in PICTURES:
        if names and name not in names:
            continue
        recording = made.setdefault(scenario, recorded(scenario)) if scenario not in made else made[scenario]
        figure, seen = draw_moment(recording, view(recording))
        save_moment(figure, HERE / f"{name}.svg")
        (HERE / f"{name}.csv").write_text(as_csv(seen), encoding="utf-8")
        print(f"{name}: {len(seen)} boxes")
        if name == FILM:
            shown = paging(recording)
            write_film(recording, HERE / f"{name}.webp", (shown.begin + 10 * MS, shown.end), 0.0025)


if __name__ == "__main__":
    main(sys.argv[1:])
