"""What paper 001 proposes as future work (section 5) as one-sided tests: each extension against the plain schemas."""

from functools import partial
from pathlib import Path
from typing import Final

import pandas as pd

from cosim.experiment import axis_titles
from cosim.report.comparison import NO_DATA, Answer, Arm, above, less, less_censored, levels, more
from cosim.report.drawing import Named, draw_panels

TIME: Final = "until_95_s"
"""The time until 95 % had been seen; of a run that never came so far the longest, a lower bound."""
MAPS: Final = axis_titles(Path(__file__).parent)["map"]
PANELS: Final[Named] = ("map", MAPS)
PLAIN: Final = "schemas"
MANY: Final = 4
MAINTAINED: Final = 0.75
"""Share of their time for which robots must see another for visibility to be maintained."""
WATCHED: Final = 0.5
"""Share of their time for which moving robots must see one at rest for overwatch to be reproduced."""
COVERED: Final = 0.95
NAMES: Final = {2: "2 robots", MANY: f"{MANY} robots"}


def _arm(floor: str, robots: int, extension: str = PLAIN) -> Arm:
    return {"map": floor, "robots": robots, "extension": extension}


def sooner(extension: str, floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether four robots take less time with the extension than without."""
    return less_censored(runs, [("", _arm(floor, MANY, extension), _arm(floor, MANY))], TIME)


def visibility(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether robots that keep each other in sight see another for longer than without."""
    pairs = [(n, _arm(floor, n, "visibility"), _arm(floor, n)) for n in levels(runs, "robots")]
    return more(runs, [(f"{n} robots:", arm, "in_sight", plain, "in_sight") for n, arm, plain in pairs])


def maintained(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether robots that keep each other in sight see another for most of the time."""
    arms = [(f"{n} robots:", _arm(floor, n, "visibility")) for n in levels(runs, "robots")]
    return above(runs, arms, "in_sight", MAINTAINED)


def covers(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether robots that keep each other in sight cover the floor."""
    return above(runs, [("", _arm(floor, MANY, "visibility"))], "coverage", COVERED)


def near(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether robots that keep each other in sight stay closer to each other."""
    return less(runs, [("", _arm(floor, MANY, "visibility"), _arm(floor, MANY))], "nearest_m")


def leapfrog(floor: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether robots move in sight of others at rest: more than half of the time, and than without."""
    sizes = levels(runs, "robots")
    arms = [(f"{n} robots:", _arm(floor, n, "leapfrog")) for n in sizes]
    words, holds = above(runs, arms, "beacon_in_sight", WATCHED)
    pairs = [(label, arm, "beacon_in_sight", _arm(floor, n)) for n, (label, arm) in zip(sizes, arms, strict=True)]
    _, more_than = more(runs, [(*pair, "beacon_in_sight") for pair in pairs])
    return (words, None if None in (holds, more_than) else bool(holds and more_than)) if words != "-" else NO_DATA


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw times and what robots see of each other by extension, a line a team size."""
    extensions = runs["extension"].unique().tolist() if "extension" in runs else []
    over, lines = ("extension", extensions), ("robots", NAMES)
    return [
        path
        for name, metric, label in (
            ("time_by_extension.png", TIME, "time to 95 %, s"),
            ("in_sight_by_extension.png", "in_sight", "share of the time with another in sight"),
            ("beacon_by_extension.png", "beacon_in_sight", "moving, with a standing one in sight"),
        )
        for path in draw_panels(runs, folder / name, (metric, label), over, lines, PANELS)
    ]


# ---------------------------------------------------------------- the tests that published.csv names

_ON_EACH: Final = (visibility, maintained, covers, near, leapfrog)
globals().update({f"{test.__name__}_{floor}": partial(test, floor) for test in _ON_EACH for floor in MAPS})
globals().update({f"information_{floor}": partial(sooner, "information", floor) for floor in MAPS})
globals().update({f"choice_{floor}": partial(sooner, "choice", floor) for floor in MAPS})
