"""From frame to frame by mutual bearings: against rotations by matrices, and along whole chains of robots."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from protocols.reflection.machine import from_peer, turn_between
from protocols.reflection.setup import Pose, into_frame

places = st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0))
poses = st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0), st.floats(-math.pi, math.pi))


def seen(frame: Pose, here: tuple[float, float], there: tuple[float, float]) -> tuple[float, float, float]:
    """Return where a robot at *here* sees one at *there*, and in which direction, in its frame."""
    own, other = into_frame(here, frame), into_frame(there, frame)
    return *other, math.atan2(other[1] - own[1], other[0] - own[0])


def by_matrix(place: tuple[float, float], frame: Pose) -> np.ndarray:
    """The same as into_frame, by the inverse of a homogeneous matrix."""
    cos, sin = math.cos(frame[2]), math.sin(frame[2])
    matrix = np.array([[cos, -sin, frame[0]], [sin, cos, frame[1]], [0.0, 0.0, 1.0]])
    return (np.linalg.inv(matrix) @ np.array([*place, 1.0]))[:2]


@given(places, poses)
def test_a_place_of_the_world_is_named_as_by_the_inverse_matrix(place: tuple[float, float], frame: Pose) -> None:
    assert into_frame(place, frame) == pytest.approx(by_matrix(place, frame), abs=1e-9)


def test_the_paper_s_angle() -> None:
    """Fig. 4: i looks along its x axis at j (0 degrees), j sees i at 90 degrees: F_j is turned by 90 degrees."""
    assert turn_between(0.0, math.radians(90.0)) == pytest.approx(math.radians(90.0))
    assert turn_between(math.radians(30.0), math.radians(-60.0)) == pytest.approx(math.radians(270.0))


@given(st.lists(st.tuples(places, poses), min_size=2, max_size=8), places)
def test_a_goal_that_went_round_a_chain_of_robots_comes_back_to_its_place(
    chain: list[tuple[tuple[float, float], Pose]], goal: tuple[float, float]
) -> None:
    around = [*chain, chain[0]]
    for (one, _), (other, _) in pairwise(around):
        assume(math.dist(one, other) > 0.1)
    told = into_frame(goal, chain[0][1])
    for (sender, frame), (receiver, own_frame) in pairwise(around):
        here = into_frame(sender, frame)
        offset = told[0] - here[0], told[1] - here[1]
        *_, alpha_ji = seen(frame, sender, receiver)
        x, y, alpha_ij = seen(own_frame, receiver, sender)
        told = from_peer(offset, (x, y), turn_between(alpha_ij, alpha_ji))
        assert told == pytest.approx(by_matrix(goal, own_frame), abs=1e-6)
    assert told == pytest.approx(into_frame(goal, chain[0][1]), abs=1e-6)
