"""Robots that know different things about what is covered make their knowledge equal before they plan."""

from collections.abc import Sequence

import numpy as np
import pytest

from protocols.pseudonet.algorithms.base import UNJUDGED
from protocols.pseudonet.messages import Action, Kind, Message
from protocols.pseudonet.reconciliation import Equality, Reconciliation
from protocols.pseudonet.setup import Setup, View
from tests.protocols.pseudonet.floors import TIMES, grid_of


class Table:
    """Robots around a table that exchange what they are to say next until they are equal."""

    def __init__(self, setup: Setup, covered: Sequence[set[int]], map_bytes: int) -> None:
        self.views = [View(setup, me, covered=set(cells)) for me, cells in enumerate(covered)]
        self.rooms = [Reconciliation(setup, map_bytes) for _ in covered]
        self.maps = 0

    def exchange(self, kind: Kind) -> set[Equality]:
        said = {}
        for me, (room, view) in enumerate(zip(self.rooms, self.views, strict=True)):
            message = Message(me, kind, 0, 0, 0, Action.STAY, UNJUDGED)
            if kind == Kind.MAP:
                message = Message(me, kind, 0, 0, 0, Action.STAY, UNJUDGED, chunk=room.chunk, marks=room.marks(view))
            elif kind == Kind.ROLL:
                message = Message(me, kind, 0, 0, 0, Action.STAY, UNJUDGED, digest=room.digest(view))
            said[me] = message
        return {room.take(view, said) for room, view in zip(self.rooms, self.views, strict=True)}

    def settle(self) -> None:
        (wanted,) = self.exchange(Kind.ROLL)
        while wanted is Equality.MAP_WANTED:
            self.maps += 1
            (wanted,) = self.exchange(Kind.MAP)
        assert wanted is Equality.EQUAL


def knowledge_of(cells: int) -> Setup:
    return Setup(grid_of(np.ones((1, cells), np.bool_)), 3, TIMES)


@pytest.mark.parametrize(("cells", "map_bytes"), [(5, 1), (8, 1), (9, 1), (100, 5), (41, 5), (300, 96)])
def test_all_know_the_union_after_as_many_maps_as_it_takes(cells: int, map_bytes: int) -> None:
    rng = np.random.default_rng(cells)
    covered = [set(rng.choice(cells, size=cells // 2, replace=False).tolist()) for _ in range(3)]
    table = Table(knowledge_of(cells), covered, map_bytes)
    table.settle()
    assert [view.covered for view in table.views] == [set().union(*covered)] * 3
    assert table.maps == -(-cells // (8 * map_bytes))


def test_those_who_know_the_same_need_no_maps() -> None:
    table = Table(knowledge_of(20), [{1, 2, 19}] * 3, 5)
    table.settle()
    assert table.maps == 0


def test_obstacles_that_not_all_know_of_are_forgotten() -> None:
    table = Table(knowledge_of(20), [{1}] * 3, 5)
    table.views[1].obstacles = frozenset({7})
    table.settle()
    assert [view.obstacles for view in table.views] == [frozenset()] * 3
    assert table.maps == 1


def test_obstacles_that_all_know_of_are_kept() -> None:
    table = Table(knowledge_of(20), [{1}] * 3, 5)
    for view in table.views:
        view.obstacles = frozenset({7})
    table.settle()
    assert [view.obstacles for view in table.views] == [frozenset({7})] * 3


def test_other_messages_call_for_the_roll() -> None:
    table = Table(knowledge_of(20), [{1}, {2}, {3}], 1)
    assert table.exchange(Kind.STATE) == {Equality.ROLL_WANTED}
    assert table.exchange(Kind.ROLL) == {Equality.MAP_WANTED}
    assert table.exchange(Kind.MAP) == {Equality.MAP_WANTED}
    table.rooms[0].chunk = 0  # out of step
    assert table.exchange(Kind.MAP) == {Equality.ROLL_WANTED}
    table.settle()
    assert [view.covered for view in table.views] == [{1, 2, 3}] * 3
