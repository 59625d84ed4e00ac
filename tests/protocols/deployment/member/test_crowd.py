"""Who passes a place that others stand about has come when they let it come no nearer; who stays there has not."""

from types import SimpleNamespace
from typing import Any

from cosim.units import S
from protocols.deployment.executing.progress import Roster
from protocols.deployment.executing.recovery import lengths, reassigned
from protocols.deployment.member.member import Crowd
from protocols.deployment.tasks.crew import Crew
from protocols.deployment.tasks.plan import Deployment, Go, Task
from tests.protocols.deployment.play_scene import Plain, crew_of

PLACE = (5.0, 0.0)
PASSING = Go(robot=0, place_m=PLACE, final=False)


def crowd(places: dict[int, tuple[float, float]], blocked_by: int | None = None) -> tuple[Crowd, Any]:
    mover: Any = SimpleNamespace(blocked_by=blocked_by)
    return Crowd(Plain(), [0.25] * 4, 0.25, mover, 3.0), SimpleNamespace(places_m=places)  # type: ignore[arg-type]


def test_who_passes_has_come_when_bodies_keep_it_off_for_a_while() -> None:
    crowded, others = crowd({1: PLACE})
    assert not crowded.come(PASSING, (4.3, 0.0), others, 10 * S)
    assert not crowded.come(PASSING, (4.45, 0.0), others, 12 * S)  # it still comes nearer
    assert not crowded.come(PASSING, (4.45, 0.0), others, 14 * S)
    assert crowded.come(PASSING, (4.45, 0.0), others, 15 * S)


def test_who_is_kept_off_by_nobody_or_from_far_has_not_come() -> None:
    for places, here in (({}, (4.8, 0.0)), ({1: PLACE}, (3.9, 0.0)), ({1: (4.0, 0.0)}, (4.6, 0.0))):
        crowded, others = crowd(places)
        assert not any(crowded.come(PASSING, here, others, now * S) for now in range(30))


def test_each_body_more_lets_one_come_less_near() -> None:
    crowded, others = crowd({1: PLACE, 2: (4.4, 0.0)})
    assert crowded.come(PASSING, (3.8, 0.0), others, 0) is False
    assert crowded.come(PASSING, (3.8, 0.0), others, 3 * S)


def test_no_way_round_those_who_stand_there_is_as_good_as_having_waited() -> None:
    crowded, others = crowd({1: PLACE}, blocked_by=1)
    assert crowded.come(PASSING, (4.45, 0.0), others, 0)


def test_who_is_to_end_up_there_has_not_come() -> None:
    crowded, others = crowd({1: PLACE}, blocked_by=1)
    assert not any(crowded.come(Go(robot=0, place_m=PLACE), (4.45, 0.0), others, now * S) for now in range(30))


def test_a_place_that_a_dead_body_covers_is_the_last_to_be_occupied() -> None:
    places, crew = ((1.0, 0.0), (2.0, 0.0), (3.0, 0.0)), crew_of(3)
    for body, wanted in (((1.1, 0.0), {1, 2}), ((2.0, 0.2), {0, 2}), ((9.0, 0.0), {0, 1})):
        roster = _roster(crew)
        roster.lose(2, body)
        for strategy in ("group", "wave", "leap_frog"):
            posts = reassigned(
                strategy,
                [0, 1],
                {0: -1, 1: -1},
                {0: (0.0, 0.0), 1: (0.0, 0.0)},
                places,
                lengths(crew, Plain()),
                roster.covered,
            )
            assert set(posts.values()) == wanted
        roster.find(2)
        assert not any(roster.covered(0, place) for place in places)


def _roster(crew: Crew) -> Roster:
    act = Deployment(strategy="group", robots=(0, 1, 2), places_m=((1.0, 0.0), (2.0, 0.0), (3.0, 0.0)))
    record: Any = SimpleNamespace(
        plan=SimpleNamespace(robots=(0, 1, 2), root=Task(name="play", act=act)), starts_m={}, start=0
    )
    return Roster(record, crew, lengths(crew, Plain()), False)
