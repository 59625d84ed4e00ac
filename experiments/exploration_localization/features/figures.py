"""Whether a filter that sets the speed knows better where it is, by filter, scanner and floor, as one-sided tests.

``places_office_features_8`` in published.csv is ``places`` for the map ``office``, the filter by features, and a
scanner that reaches 8 m; the tests by such names are made at the end of this file.
"""

from functools import partial
from itertools import product
from pathlib import Path
from typing import Final

import pandas as pd

from cosim.experiment import axis_titles
from cosim.report.comparison import Answer, Arm, above, by_replicate, less_censored, more

TIME: Final = "until_95_s"
"""The time until 95 % had been seen; of a run that never came so far the longest, a lower bound."""
MAPS: Final = axis_titles(Path(__file__).parent)["map"]
FILTERS: Final = ("features", "grid")
RANGES: Final = {"2": "2.5 m", "8": "8 m"}
"""Ranges of the scanner, by what tests are called."""
CONSTANT: Final = "constant speed"
STOPS: Final = {1: "stop at 1 median", 2: "stop at 2 medians", 4: "stop at 4 medians"}
"""Arms with speed control, by their threshold in median spreads."""
JUDGED: Final = 2
"""The threshold that is held against a constant speed; half of all spreads lie below 1 median by definition."""
MOSTLY: Final = 0.5
"""Share of the waits that must end with the robot localised again for waiting to help."""


class Place:
    """Arms on one floor with one filter and one range of the scanner."""

    def __init__(self, floor: str, kind: str, reach: str) -> None:
        self._own: Arm = {"map": floor, "filter": kind, "range": reach}

    def arm(self, position: str) -> Arm:
        """Return the arm with such a threshold."""
        return self._own | {"position": position}

    def waiting(self, runs: pd.DataFrame) -> list[tuple[str, Arm]]:
        """Return the arms in which robots waited at all, and their labels."""
        arms = [(f"{stop}:", self.arm(stop)) for stop in STOPS.values()]
        return [(label, arm) for label, arm in arms if by_replicate(runs, arm, "waits_localised").notna().any()]


def maps(place: Place, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether the map is truer if the filter sets the speed."""
    return less_censored(runs, [("", place.arm(STOPS[JUDGED]), place.arm(CONSTANT))], "map_error")


def places(place: Place, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether the robot knows better where it is, while it drives, if the filter sets the speed."""
    return less_censored(runs, [("", place.arm(STOPS[JUDGED]), place.arm(CONSTANT))], "pose_error_driving_m")


def costs(place: Place, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether a constant speed explores sooner."""
    return less_censored(runs, [("", place.arm(CONSTANT), place.arm(STOPS[JUDGED]))], TIME)


def stricter(place: Place, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether a robot that waits from 1 median on knows better where it is than one from 4 on."""
    return less_censored(runs, [("", place.arm(STOPS[1]), place.arm(STOPS[4]))], "pose_error_driving_m")


def localised(place: Place, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether waits mostly end with the robot localised again as the filter has it, at each threshold."""
    return above(runs, place.waiting(runs), "waits_localised", MOSTLY)


def waiting(place: Place, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether robots are nearer to where they take themselves to be after waits, at each threshold."""
    names = "pose_error_before_m", "pose_error_after_m"
    return more(runs, [(label, arm, names[0], arm, names[1]) for label, arm in place.waiting(runs)])


# ---------------------------------------------------------------- the tests that published.csv names

PLACES: Final = {
    f"{floor}_{kind}_{name}": Place(floor, kind, reach)
    for floor, kind, (name, reach) in product(MAPS, FILTERS, RANGES.items())
}
TESTS: Final = (maps, places, costs, stricter, localised, waiting)
globals().update({f"{test.__name__}_{name}": partial(test, place) for test in TESTS for name, place in PLACES.items()})
